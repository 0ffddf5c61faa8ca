//! What long work tells whoever shows its progress.

use std::path::Path;

use kinds_model::Step;

/// A part of the work.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Stage<'a> {
    /// Reading a trip, in bytes.
    Reading(&'a Path),
    /// Fitting a model.
    Fitting(Step),
    /// Classifying the frames of both trips.
    Classifying,
}

/// Told a stage, how much of it is done, and of how much. One thread at a time, but not always the same one.
pub type Progress<'a> = dyn FnMut(Stage, u64, u64) + Send + 'a;

/// Passes the steps of fitting on.
pub(crate) fn fitting<'a>(progress: &'a mut Progress) -> impl FnMut(Step, usize, usize) + 'a {
    |step, done, all| progress(Stage::Fitting(step), done as u64, all as u64)
}
