//! A consumer that is too slow: a thread that takes one report a second.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

use kinds_messages::{Domain, KindReport, Node, ReportReader};

use crate::robot::SENSOR;

const PERIOD: Duration = Duration::from_secs(1);

pub(crate) struct Sluggard {
    stop: Arc<AtomicBool>,
    taking: JoinHandle<(u64, u64)>,
}

impl Sluggard {
    pub(crate) fn of(domain: &Domain) -> Self {
        let stop = Arc::<AtomicBool>::default();
        let (domain, stopped) = (domain.clone(), Arc::clone(&stop));
        let taking = std::thread::spawn(move || {
            let node = Node::open(&domain, "sluggard").unwrap();
            let reader = ReportReader::open(&node, &SENSOR.parse().unwrap()).unwrap();
            let (mut n_taken, mut n_lost) = (0, 0);
            let mut last: Option<KindReport> = None;
            let mut taken = Instant::now();
            while !stopped.load(Ordering::Relaxed) {
                std::thread::sleep(Duration::from_millis(50));
                if taken.elapsed() < PERIOD {
                    continue;
                }
                taken = Instant::now();
                let Some(report) = reader.receive().unwrap() else { continue };
                n_taken += 1;
                if let Some(last) = last.filter(|last| last.run == report.run) {
                    assert!(report.sequence > last.sequence, "reports come in order, or not at all");
                    n_lost += report.sequence - last.sequence - 1 - report.n_lost;
                }
                last = Some(report);
            }
            (n_taken, n_lost)
        });
        Self { stop, taking }
    }

    /// Reports that it took, and that it lost within the runs that it saw.
    pub(crate) fn end(self) -> (u64, u64) {
        self.stop.store(true, Ordering::Relaxed);
        self.taking.join().unwrap()
    }
}
