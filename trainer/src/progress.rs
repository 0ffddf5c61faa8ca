//! What long work tells whoever shows its progress.

use std::path::Path;
use std::sync::{Mutex, PoisonError};

use kinds_model::Step;

/// A part of the work.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Stage<'a> {
    /// Reading a trip, in bytes.
    Reading(&'a Path),
    /// Fitting a model.
    Fitting(Step),
    /// Classifying the frames of all trips.
    Classifying,
    /// Comparing the kinds of trips where they meet.
    Comparing,
}

/// Told a stage, how much of it is done, and of how much. One thread at a time, but not always the same one.
pub type Progress<'a> = dyn FnMut(Stage, u64, u64) + Send + 'a;

/// Adds up what several threads have done of a stage, and tells it.
pub(crate) struct Told<'a, 'b> {
    stage: Stage<'a>,
    all: u64,
    done: Mutex<(u64, &'a mut Progress<'b>)>,
}

impl<'a, 'b> Told<'a, 'b> {
    pub(crate) fn new(stage: Stage<'a>, all: u64, progress: &'a mut Progress<'b>) -> Self {
        Self { stage, all, done: Mutex::new((0, progress)) }
    }

    pub(crate) fn add(&self, n: u64) {
        let mut guard = self.done.lock().unwrap_or_else(PoisonError::into_inner);
        let (done, progress) = &mut *guard;
        *done += n;
        progress(self.stage, *done, self.all);
    }
}

/// Passes the steps of fitting on.
pub(crate) fn fitting<'a>(progress: &'a mut Progress) -> impl FnMut(Step, usize, usize) + 'a {
    |step, done, all| progress(Stage::Fitting(step), done as u64, all as u64)
}
