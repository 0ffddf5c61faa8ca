//! What tests of several devices use.

use std::cell::Cell;
use std::rc::Rc;
use std::time::Duration;

use crate::paced::Clock;

/// A clock on which only sleeping takes time. Its copies are the same clock.
#[derive(Clone, Default)]
pub(crate) struct SleepClock(Rc<Cell<Duration>>);

impl Clock for SleepClock {
    fn now(&self) -> Duration {
        self.0.get()
    }

    fn sleep(&self, duration: Duration) {
        self.0.set(self.0.get() + duration);
    }
}
