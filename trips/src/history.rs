//! A bounded window of what a trip said at certain moments, looked up by time.

use std::collections::VecDeque;

use crate::Stamp;

/// Values kept: four seconds at 1 kHz, which is more than frames are ever logged late. 128 KiB of poses.
pub(crate) const MAX_VALUES: usize = 4096;

/// The last [`MAX_VALUES`] values, in order of their stamps.
#[derive(Clone)]
pub(crate) struct History<T> {
    values: VecDeque<(Stamp, T)>,
}

impl<T> Default for History<T> {
    fn default() -> Self {
        Self { values: VecDeque::new() }
    }
}

impl<T: Copy> History<T> {
    /// Adds a value; one that comes out of order goes to its place. Forgets the oldest beyond [`MAX_VALUES`].
    pub(crate) fn insert(&mut self, at: Stamp, value: T) {
        let index = self.values.partition_point(|(stamp, _)| *stamp <= at);
        self.values.insert(index, (at, value));
        if self.values.len() > MAX_VALUES {
            self.values.pop_front();
        }
    }

    /// Whether a value at or after `at` is known, so that waiting for one is over.
    pub(crate) fn reaches(&self, at: Stamp) -> bool {
        self.values.back().is_some_and(|(newest, _)| *newest >= at)
    }

    /// The last value at or before a moment, and the first after it.
    pub(crate) fn around(&self, at: Stamp) -> [Option<(Stamp, T)>; 2] {
        let index = self.values.partition_point(|(stamp, _)| *stamp <= at);
        let before = index.checked_sub(1).and_then(|before| self.values.get(before));
        [before.copied(), self.values.get(index).copied()]
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn values_stand_in_order_of_their_stamps_and_later_ones_of_a_moment_after_the_earlier() {
        let mut history = History::default();
        for (stamp, value) in [(3, 'c'), (1, 'a'), (5, 'd'), (3, 'b')] {
            history.insert(Stamp(stamp), value);
        }
        let around = |at| history.around(Stamp(at)).map(|found| found.map(|(stamp, value)| (stamp.0, value)));
        assert_eq!(around(0), [None, Some((1, 'a'))]);
        assert_eq!(around(1), [Some((1, 'a')), Some((3, 'c'))]);
        assert_eq!(around(4), [Some((3, 'b')), Some((5, 'd'))]);
        assert_eq!(around(9), [Some((5, 'd')), None]);
    }

    #[test]
    fn a_history_never_grows_beyond_its_bound_and_keeps_the_newest() {
        let mut history = History::default();
        let newest = 3 * MAX_VALUES as i64 - 1;
        for stamp in 0..=newest {
            history.insert(Stamp(stamp), ());
            assert!(history.values.len() <= MAX_VALUES);
        }
        assert_eq!(history.values.front().unwrap().0, Stamp(2 * MAX_VALUES as i64));
        assert!(history.reaches(Stamp(newest)));
        assert!(!history.reaches(Stamp(newest + 1)));
    }
}
