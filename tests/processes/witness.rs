//! Somebody who sees every frame and every report of a robot, whoever else comes and goes: a thread of this process.

use std::collections::HashMap;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex};
use std::thread::JoinHandle;
use std::time::Duration;

use kinds_messages::{Domain, FrameReader, Node, ReportReader};

use crate::robot::SENSOR;

/// One frame: its run, and its number in that.
pub(crate) type FrameId = (u64, u64);

/// What was seen of a frame.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct SeenFrame {
    pub(crate) id: FrameId,
    pub(crate) n_readings: usize,
    pub(crate) sent_ns: u64,
}

/// What was seen of a report.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct SeenReport {
    pub(crate) id: FrameId,
    pub(crate) n_lost: u64,
    /// When its frame was sent.
    pub(crate) sent_ns: u64,
    pub(crate) reported_ns: u64,
}

/// All that was seen, in order.
#[derive(Clone, Debug, Default)]
pub(crate) struct Ledger {
    pub(crate) frames: Vec<SeenFrame>,
    pub(crate) reports: Vec<SeenReport>,
}

impl Ledger {
    /// Frames that were reported more than once.
    pub(crate) fn reported_twice(&self) -> Vec<FrameId> {
        let mut n_reports: HashMap<FrameId, u32> = HashMap::new();
        for report in &self.reports {
            *n_reports.entry(report.id).or_default() += 1;
        }
        n_reports.into_iter().filter(|&(_, n)| n > 1).map(|(id, _)| id).collect()
    }
}

/// The thread. Ends when this is dropped.
pub(crate) struct Witness {
    ledger: Arc<Mutex<Ledger>>,
    stop: Arc<AtomicBool>,
    watching: Option<JoinHandle<()>>,
}

impl Witness {
    pub(crate) fn of(domain: &Domain) -> Self {
        let (ledger, stop) = (Arc::<Mutex<Ledger>>::default(), Arc::<AtomicBool>::default());
        let (theirs, domain, stopped) = (Arc::clone(&ledger), domain.clone(), Arc::clone(&stop));
        let watching = std::thread::spawn(move || {
            let node = Node::open(&domain, "witness").unwrap();
            let sensor = SENSOR.parse().unwrap();
            let reports = ReportReader::open(&node, &sensor).unwrap();
            let frames = FrameReader::open(&node, &sensor).unwrap();
            while !stopped.load(Ordering::Relaxed) {
                frames.wait(Duration::from_millis(5)).unwrap();
                let mut ledger = theirs.lock().unwrap();
                while let Some(frame) = frames.receive().unwrap() {
                    let header = frame.header();
                    ledger.frames.push(SeenFrame {
                        id: (header.run, header.sequence),
                        n_readings: frame.counts().len(),
                        sent_ns: header.sent_monotonic_ns,
                    });
                }
                while let Some(report) = reports.receive().unwrap() {
                    ledger.reports.push(SeenReport {
                        id: (report.run, report.sequence),
                        n_lost: report.n_lost,
                        sent_ns: report.sent_monotonic_ns,
                        reported_ns: report.reported_monotonic_ns,
                    });
                }
            }
        });
        Self { ledger, stop, watching: Some(watching) }
    }

    /// Frames and reports seen so far.
    pub(crate) fn n_seen(&self) -> (usize, usize) {
        let ledger = self.ledger.lock().unwrap();
        (ledger.frames.len(), ledger.reports.len())
    }

    /// A copy of all that was seen so far.
    pub(crate) fn ledger(&self) -> Ledger {
        self.ledger.lock().unwrap().clone()
    }
}

impl Drop for Witness {
    fn drop(&mut self) {
        self.stop.store(true, Ordering::Relaxed);
        if let Some(watching) = self.watching.take() {
            // Its panic is told already; another while one is on its way would hide both.
            let _ = watching.join();
        }
    }
}
