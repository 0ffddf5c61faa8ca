//! What is seen of a sensor that is served on another machine: the reports that a bridge passes on, since the service's health
//! stays there.

use std::collections::VecDeque;
use std::time::{Duration, Instant};

use kinds_messages::{KindReport, Node, ReportReader, SensorName};

/// Over how long a rate is taken.
const WINDOW: Duration = Duration::from_secs(5);

/// How long a bridge is watched before its rate can be told.
const FIRST_LOOK: Duration = Duration::from_secs(1);

/// The end at which a bridge is heard, and what it has passed on.
pub(crate) struct Bridged {
    reader: ReportReader,
    pub(crate) passed_on: PassedOn,
}

/// What a bridge has passed on.
#[derive(Debug, PartialEq)]
pub(crate) struct PassedOn {
    since: Instant,
    /// When reports came within the last seconds, but for the first of all: who comes late gets the last one, however old.
    arrivals: VecDeque<Instant>,
    last: Option<KindReport>,
}

impl Bridged {
    pub(crate) fn open(node: &Node, sensor: &SensorName) -> Result<Self, String> {
        let reader = ReportReader::open(node, sensor).map_err(|error| error.to_string())?;
        Ok(Self { reader, passed_on: PassedOn::begun(Instant::now()) })
    }

    /// Whether somebody publishes the kinds.
    pub(crate) fn is_there(&self) -> bool {
        self.reader.service().is_some()
    }

    /// Takes what has come.
    pub(crate) fn receive(&mut self) -> Result<(), String> {
        while let Some(report) = self.reader.receive().map_err(|error| error.to_string())? {
            self.passed_on.add(report, Instant::now());
        }
        Ok(())
    }
}

impl PassedOn {
    pub(crate) fn begun(now: Instant) -> Self {
        Self { since: now, arrivals: VecDeque::new(), last: None }
    }

    pub(crate) fn add(&mut self, report: KindReport, now: Instant) {
        if self.last.replace(report).is_some() {
            self.arrivals.push_back(now);
        }
        while self.arrivals.front().is_some_and(|&arrival| now.duration_since(arrival) > WINDOW) {
            self.arrivals.pop_front();
        }
    }

    /// The last report, if there was one.
    pub(crate) fn last(&self) -> Option<&KindReport> {
        self.last.as_ref()
    }

    /// Reports in a second; none as long as nobody can tell.
    pub(crate) fn rate_hz(&self, now: Instant) -> Option<f64> {
        let watched = now.duration_since(self.since);
        let over = watched.min(WINDOW);
        let n_reports = self.arrivals.iter().filter(|&&arrival| now.duration_since(arrival) <= over).count();
        (watched >= FIRST_LOOK).then(|| n_reports as f64 / over.as_secs_f64())
    }

    /// For how long no report has come.
    pub(crate) fn silence(&self, now: Instant) -> Duration {
        now.duration_since(self.arrivals.back().copied().unwrap_or(self.since))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_rate_is_that_of_the_last_seconds_without_the_report_that_latecomers_get() {
        let mut report = KindReport::default();
        let begin = Instant::now();
        let at = |ms| begin + Duration::from_millis(ms);
        let mut passed_on = PassedOn::begun(begin);
        passed_on.add(report, at(0));
        assert_eq!((passed_on.rate_hz(at(999)), passed_on.rate_hz(at(1000))), (None, Some(0.0)));
        assert_eq!(passed_on.silence(at(3000)), Duration::from_secs(3));
        for tenth in 1..=100 {
            report.sequence = tenth;
            passed_on.add(report, at(100 * tenth));
        }
        // Ten a second, both ends counted.
        assert_eq!(passed_on.rate_hz(at(10_000)), Some(51.0 / 5.0));
        assert_eq!(passed_on.silence(at(12_000)), Duration::from_secs(2));
        assert_eq!(passed_on.rate_hz(at(16_000)), Some(0.0));
        assert_eq!(passed_on.last().unwrap().sequence, 100);
        assert!(passed_on.arrivals.len() <= 51, "what is older is forgotten");
    }
}
