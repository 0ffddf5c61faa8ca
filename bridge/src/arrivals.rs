//! What comes over the link at the far end: which of it is passed on, and what there is to tell of it.

use std::collections::VecDeque;

use kinds_messages::{KindReport, Spell};

/// What came over the link.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Arrived {
    /// Reports that were passed on.
    pub n_passed_on: u64,
    /// Reports that never came, by their sequence.
    pub n_lost: u64,
    /// What was no report that this program reads.
    pub n_refused: u64,
}

/// The state of what comes.
#[derive(Debug, Default)]
pub(crate) struct Arrivals {
    last: Option<KindReport>,
    n_passed_on: u64,
    lost: Spell,
    refused: Spell,
    news: VecDeque<String>,
}

impl Arrivals {
    /// The report that these bytes are, if it is to be passed on.
    pub(crate) fn take(&mut self, bytes: &[u8]) -> Option<KindReport> {
        let report = match KindReport::from_bytes(bytes) {
            Ok(report) => report,
            Err(reason) => {
                if self.refused.count(1) {
                    self.news.push_back(format!("what comes cannot be passed on: {reason}"));
                }
                return None;
            }
        };
        if let Some(n) = self.refused.calm() {
            self.news.push_back(format!("reports that can be passed on come again; {n} could not"));
        }
        if let Some(last) = &self.last {
            // A near end repeats its last report, for whoever has just come.
            if report.run == last.run && report.sequence <= last.sequence {
                return None;
            }
            self.look_for_gap(report.n_missed_since(last));
        }
        self.last = Some(report);
        self.n_passed_on += 1;
        Some(report)
    }

    fn look_for_gap(&mut self, n_missed: u64) {
        if n_missed > 0 {
            if self.lost.count(n_missed) {
                self.news.push_back(format!(
                    "reports are lost on the way: {n_missed} before the one that just came"
                ));
            }
        } else if let Some(n) = self.lost.calm() {
            self.news.push_back(format!("no more reports are lost on the way; {n} were"));
        }
    }

    /// The oldest that has not been told.
    pub(crate) fn news(&mut self) -> Option<String> {
        self.news.pop_front()
    }

    pub(crate) fn arrived(&self) -> Arrived {
        Arrived { n_passed_on: self.n_passed_on, n_lost: self.lost.n(), n_refused: self.refused.n() }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn report(run: u64, sequence: u64) -> KindReport {
        let mut report = KindReport::default();
        (report.run, report.sequence) = (run, sequence);
        report
    }

    /// Sequences of what is passed on of these, and all that is told.
    fn pass(
        arrivals: &mut Arrivals,
        reports: impl IntoIterator<Item = KindReport>,
    ) -> (Vec<u64>, Vec<String>) {
        let taken = reports.into_iter().filter_map(|report| arrivals.take(report.as_bytes()));
        let sequences = taken.map(|report| report.sequence).collect();
        (sequences, std::iter::from_fn(|| arrivals.news()).collect())
    }

    #[test]
    fn reports_are_passed_on_once_and_in_order() {
        let mut arrivals = Arrivals::default();
        let sequences = [5, 6, 6, 5, 7].map(|sequence| report(1, sequence));
        assert_eq!(pass(&mut arrivals, sequences), (vec![5, 6, 7], vec![]));
        // A run begins anew, also where a clock was set back.
        assert_eq!(pass(&mut arrivals, [report(2, 0), report(1, 0)]), (vec![0, 0], vec![]));
        let expected = Arrived { n_passed_on: 5, ..Arrived::default() };
        assert_eq!(arrivals.arrived(), expected);
    }

    #[test]
    fn gaps_are_told_when_they_begin_and_when_a_hundred_reports_came_without_one() {
        let mut arrivals = Arrivals::default();
        let with_gaps = [0, 3, 4, 9].map(|sequence| report(1, sequence));
        let beginning = "reports are lost on the way: 2 before the one that just came";
        assert_eq!(pass(&mut arrivals, with_gaps).1, [beginning]);
        assert_eq!(pass(&mut arrivals, (10..109).map(|sequence| report(1, sequence))).1, [""; 0]);
        assert_eq!(pass(&mut arrivals, [report(1, 109)]).1, ["no more reports are lost on the way; 6 were"]);
        assert_eq!(arrivals.arrived().n_lost, 6);
        // Frames that never reached the service are no reports that are lost.
        let mut after_lost_frames = report(1, 120);
        after_lost_frames.n_lost = 10;
        assert_eq!(pass(&mut arrivals, [after_lost_frames]).1, [""; 0]);
    }

    #[test]
    fn what_is_no_report_of_this_version_is_refused_and_told_once_with_the_reason() {
        let mut arrivals = Arrivals::default();
        let mut other = report(1, 0);
        other.version += 1;
        let (taken, told) = pass(&mut arrivals, [other, other]);
        assert_eq!(taken, [0; 0]);
        assert_eq!(told.len(), 1);
        assert_eq!(
            told[0],
            format!(
                "what comes cannot be passed on: they are of layout version {}, this program reads version {}; run all programs \
                 in the same version",
                other.version,
                KindReport::VERSION
            )
        );
        assert_eq!(arrivals.take(b"noise"), None);
        let (taken, told) = pass(&mut arrivals, (0..100).map(|sequence| report(1, sequence)));
        assert_eq!(
            (taken.len(), told),
            (100, vec!["reports that can be passed on come again; 3 could not".to_string()])
        );
        assert_eq!(arrivals.arrived().n_refused, 3);
    }
}
