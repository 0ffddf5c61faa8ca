//! Reports that wait at the near end for the link to take them: the newest, and few.
//!
//! Knows no clock: ages are by the time that the caller says it is.

use std::collections::VecDeque;
use std::time::Duration;

use kinds_messages::{KindReport, REPORT_BUFFER};

/// Oldest report that waits for the link to take it, unless it is the last of all: who reads kinds on another machine wants to
/// know how it is now, and would otherwise be behind for as long as the link is too slow.
pub const AGE_MAX: Duration = Duration::from_secs(5);

/// Reports that wait, the oldest first.
#[derive(Debug, Default)]
pub(crate) struct Outbox {
    waiting: VecDeque<KindReport>,
}

impl Outbox {
    /// One more. Where there is no room the oldest goes; returns whether it did.
    pub(crate) fn push(&mut self, report: KindReport) -> bool {
        let is_full = self.waiting.len() == REPORT_BUFFER;
        if is_full {
            self.waiting.pop_front();
        }
        self.waiting.push_back(report);
        is_full
    }

    /// Leaves out what is too old, but for the last of all, and returns how many that were.
    pub(crate) fn leave_out_old(&mut self, now_monotonic_ns: u64) -> u64 {
        let is_old = |report: &KindReport| {
            u128::from(now_monotonic_ns.saturating_sub(report.reported_monotonic_ns)) > AGE_MAX.as_nanos()
        };
        let mut n_left_out = 0;
        while self.waiting.len() > 1 && self.waiting.front().is_some_and(is_old) {
            self.waiting.pop_front();
            n_left_out += 1;
        }
        n_left_out
    }

    pub(crate) fn is_empty(&self) -> bool {
        self.waiting.is_empty()
    }

    /// The oldest.
    pub(crate) fn pop(&mut self) -> Option<KindReport> {
        self.waiting.pop_front()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const SECOND_NS: u64 = 1_000_000_000;

    /// A report of each second, from 0.
    fn outbox(n_reports: u64) -> (Outbox, u64) {
        let mut outbox = Outbox::default();
        let report = |sequence| {
            let mut report = KindReport::default();
            (report.sequence, report.reported_monotonic_ns) = (sequence, sequence * SECOND_NS);
            report
        };
        let n_left_out = (0..n_reports).filter(|&sequence| outbox.push(report(sequence))).count();
        (outbox, n_left_out as u64)
    }

    fn sequences(mut outbox: Outbox) -> Vec<u64> {
        std::iter::from_fn(|| outbox.pop()).map(|report| report.sequence).collect()
    }

    #[test]
    fn what_is_too_old_is_left_out_and_the_newest_go_in_their_order() {
        let (mut outbox, n_left_out) = outbox(10);
        assert_eq!((n_left_out, outbox.leave_out_old(9 * SECOND_NS)), (0, 4));
        assert_eq!(outbox.leave_out_old(9 * SECOND_NS), 0);
        assert_eq!(sequences(outbox), [4, 5, 6, 7, 8, 9]);
    }

    #[test]
    fn the_last_of_all_waits_however_old_it_is() {
        let (mut outbox, _) = outbox(3);
        assert_eq!(outbox.leave_out_old(1000 * SECOND_NS), 2);
        assert_eq!(sequences(outbox), [2]);
    }

    #[test]
    fn where_there_is_no_room_the_oldest_goes() {
        let n_more = 7;
        let (outbox, n_left_out) = outbox(REPORT_BUFFER as u64 + n_more);
        assert_eq!(n_left_out, n_more);
        let sequences = sequences(outbox);
        assert_eq!((sequences.len(), sequences[0]), (REPORT_BUFFER, n_more));
    }
}
