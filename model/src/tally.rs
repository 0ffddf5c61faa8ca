//! Counts what several threads have done, for whoever shows progress.

use std::sync::Mutex;

/// Tells how many pieces of work are done, one thread at a time.
pub(crate) struct Tally<'a>(Mutex<(usize, &'a mut (dyn FnMut(usize) + Send))>);

impl<'a> Tally<'a> {
    /// `told` is called with 1, 2, … in this order, whichever piece it was.
    pub(crate) fn new(told: &'a mut (dyn FnMut(usize) + Send)) -> Self {
        Self(Mutex::new((0, told)))
    }

    /// One more is done.
    pub(crate) fn add(&self) {
        let mut state = self.0.lock().expect("whoever is told does not panic");
        state.0 += 1;
        let n_done = state.0;
        (state.1)(n_done);
    }
}
