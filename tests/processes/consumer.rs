//! A consumer of kind reports: this process, in a robot's domain.

use std::time::{Duration, Instant};

use kinds_messages::{Domain, KindReport, Node, ReportReader};

use crate::running::{DEADLINE, Running};

/// A reader of kind reports in this process.
pub(crate) struct Consumer {
    reader: ReportReader,
    reports: Vec<KindReport>,
}

impl Consumer {
    pub(crate) fn join(domain: &Domain, sensor: &str) -> Self {
        let node = Node::open(domain, "consumer").unwrap();
        Self { reader: ReportReader::open(&node, &sensor.parse().unwrap()).unwrap(), reports: Vec::new() }
    }

    /// Takes reports until there are as many in all.
    pub(crate) fn await_reports(&mut self, n_reports: usize) -> &[KindReport] {
        let start = Instant::now();
        while self.take() < n_reports {
            assert!(start.elapsed() < DEADLINE, "{} of {n_reports} reports came", self.reports.len());
            self.reader.wait(Duration::from_millis(50)).unwrap();
        }
        &self.reports
    }

    /// Takes reports until that on the frame of this number has come.
    pub(crate) fn await_frame(&mut self, sequence: u64) -> &[KindReport] {
        let start = Instant::now();
        while self.take() == 0 || self.reports.last().is_none_or(|last| last.sequence < sequence) {
            assert!(start.elapsed() < DEADLINE, "{} reports came, none on {sequence}", self.reports.len());
            self.reader.wait(Duration::from_millis(50)).unwrap();
        }
        &self.reports
    }

    /// The next report, if one waits.
    pub(crate) fn take_one(&mut self) -> Option<KindReport> {
        self.reader.receive().unwrap()
    }

    /// Takes reports until a condition holds, and returns how many came in all.
    pub(crate) fn await_that(&mut self, mut condition: impl FnMut() -> bool) -> usize {
        let start = Instant::now();
        while !condition() {
            self.take();
            assert!(start.elapsed() < DEADLINE, "what was waited for has not come");
            self.reader.wait(Duration::from_millis(20)).unwrap();
        }
        self.take()
    }

    /// Takes reports until the shim has ended, and returns all that came. A shim ends when its frames are reported.
    pub(crate) fn await_end_of(mut self, shim: &mut Running) -> Vec<KindReport> {
        let start = Instant::now();
        loop {
            // In this order: what it left is taken.
            let has_ended = shim.has_ended();
            self.take();
            if has_ended {
                return self.reports;
            }
            assert!(start.elapsed() < DEADLINE, "the shim has not ended; {:?}", shim.err());
            self.reader.wait(Duration::from_millis(50)).unwrap();
        }
    }

    fn take(&mut self) -> usize {
        while let Some(report) = self.reader.receive().unwrap() {
            self.reports.push(report);
        }
        self.reports.len()
    }
}
