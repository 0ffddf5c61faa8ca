//! From receiving a frame to the finished report nothing is allocated, over real channels. Alone in its program, since the
//! allocator counts for all tests of one.
#![allow(unsafe_code, reason = "an allocator that counts")]

mod trained;

use std::alloc::{GlobalAlloc, Layout, System};
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};
use std::sync::{Arc, Mutex};
use std::time::Duration;

use kinds_messages::{
    FrameHeader, FramePublisher, FrameReader, HealthPublisher, HealthReader, KindReport, Node, OwnDomain,
    ReportPublisher, ReportReader, ReportStatus, Waiting, WakeUp,
};
use kinds_model::{Classification, Classifier, Command, Filter, MedianFilter, ModelId, SensorLayout};
use kinds_service::{Classify, DriftWindow, Service};

use crate::trained::{LOAN_BYTES, N_FRAMES, classifier, trip};

/// The system's allocator, which counts.
struct Counting {
    n_allocated: AtomicUsize,
    bytes_allocated: AtomicUsize,
    bytes_freed: AtomicUsize,
}

#[global_allocator]
static ALLOCATOR: Counting = Counting {
    n_allocated: AtomicUsize::new(0),
    bytes_allocated: AtomicUsize::new(0),
    bytes_freed: AtomicUsize::new(0),
};

// SAFETY: all is left to the system's allocator. Growing and zeroing are this trait's own, which call these two.
unsafe impl GlobalAlloc for Counting {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        self.n_allocated.fetch_add(1, Ordering::Relaxed);
        self.bytes_allocated.fetch_add(layout.size(), Ordering::Relaxed);
        // SAFETY: the caller keeps to the same contract.
        unsafe { System.alloc(layout) }
    }

    unsafe fn dealloc(&self, memory: *mut u8, layout: Layout) {
        self.bytes_freed.fetch_add(layout.size(), Ordering::Relaxed);
        // SAFETY: the caller keeps to the same contract.
        unsafe { System.dealloc(memory, layout) }
    }
}

/// What was allocated and freed.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
struct Taken {
    n_allocated: usize,
    bytes_allocated: usize,
    bytes_freed: usize,
}

const NOTHING: Taken = Taken { n_allocated: 0, bytes_allocated: 0, bytes_freed: 0 };

/// What the transport does for a loan, whichever it is.
const A_LOAN: Taken = Taken { n_allocated: 1, bytes_allocated: LOAN_BYTES, bytes_freed: LOAN_BYTES };

impl Taken {
    fn so_far() -> Self {
        Self {
            n_allocated: ALLOCATOR.n_allocated.load(Ordering::Relaxed),
            bytes_allocated: ALLOCATOR.bytes_allocated.load(Ordering::Relaxed),
            bytes_freed: ALLOCATOR.bytes_freed.load(Ordering::Relaxed),
        }
    }

    fn since(earlier: Self) -> Self {
        Self::so_far().less(earlier)
    }

    fn times(self, n: usize) -> Self {
        Self {
            n_allocated: n * self.n_allocated,
            bytes_allocated: n * self.bytes_allocated,
            bytes_freed: n * self.bytes_freed,
        }
    }

    fn less(self, earlier: Self) -> Self {
        Self {
            n_allocated: self.n_allocated - earlier.n_allocated,
            bytes_allocated: self.bytes_allocated - earlier.bytes_allocated,
            bytes_freed: self.bytes_freed - earlier.bytes_freed,
        }
    }
}

/// A classifier that notes when it has answered.
struct Noting {
    classifier: Classifier,
    answered: Arc<AtomicUsize>,
}

impl Classify for Noting {
    fn layout(&self) -> SensorLayout {
        self.classifier.layout()
    }

    fn model_id(&self) -> ModelId {
        self.classifier.model_id()
    }

    fn introduce(&self, report: &mut KindReport) {
        self.classifier.introduce(report);
    }

    fn compares_commands(&self) -> bool {
        self.classifier.compares_commands()
    }

    fn is_novel(&self, novelty: f64) -> bool {
        self.classifier.is_novel(novelty)
    }

    fn median(&self) -> Option<MedianFilter> {
        self.classifier.median()
    }

    fn filter(&self) -> Filter {
        self.classifier.filter()
    }

    fn drift(&self) -> DriftWindow {
        self.classifier.drift()
    }

    fn half_split_error(&mut self) -> Option<f64> {
        self.classifier.half_split_error()
    }

    fn classify(&mut self, counts: &[u16], command: Option<Command>) -> &Classification {
        let classification = Classify::classify(&mut self.classifier, counts, command);
        self.answered.store(Taken::so_far().n_allocated, Ordering::Relaxed);
        classification
    }
}

#[test]
fn a_frame_takes_no_memory_but_the_transports_loan_of_the_next_report() {
    for sensor in [
        SensorLayout { rows: 1, columns: 16, metres_per_count: 0.001 },
        SensorLayout { rows: 124, columns: 160, metres_per_count: 0.001 },
    ] {
        for waiting in [Waiting::ByEvent, Waiting::Polling] {
            check(sensor, waiting);
        }
    }
    check_health();
}

/// Working out how the service fares takes no memory, saying it the transport's loan. What is taken beside that is the
/// transport's: twenty times a second to connect readers that came, and every other second to clean up after killed programs.
fn check_health() {
    const N_SECONDS: usize = 5;
    let domain = OwnDomain::make().unwrap();
    let node = Node::open(&domain, "test").unwrap();
    let name = "crunch/ring".parse().unwrap();
    let sensor = SensorLayout { rows: 1, columns: 16, metres_per_count: 0.001 };
    let mut service = Service::start_with(&node, &name, classifier(sensor), Waiting::Polling).unwrap();
    let shim = FramePublisher::create(&node, &name, sensor.n_readings()).unwrap();
    let reader = HealthReader::open(&node, &name).unwrap();
    // Set when health is worked out and not yet said.
    let told = Arc::new((AtomicBool::new(false), Mutex::new(NOTHING)));
    let listener = Arc::clone(&told);
    service.listen_to_health(move |_| {
        *listener.1.lock().unwrap() = Taken::so_far();
        listener.0.store(true, Ordering::Relaxed);
    });
    let mut workings = Vec::new();
    let trip = trip(sensor, N_FRAMES);
    for (sequence, counts) in (0..).zip(trip.chunks_exact(sensor.n_readings())).take(N_SECONDS) {
        let SensorLayout { rows, columns, metres_per_count } = sensor;
        let header =
            FrameHeader { run: 7, sequence, rows, columns, metres_per_count, ..FrameHeader::default() };
        let mut loan = shim.loan().unwrap();
        loan.counts_mut().copy_from_slice(counts);
        loan.send(&header).unwrap();
        service.run(&AtomicBool::new(true)).unwrap();
        told.0.store(false, Ordering::Relaxed);
        let before = Taken::so_far();
        service.run(&told.0).unwrap();
        let after = Taken::so_far();
        let worked_out = *told.1.lock().unwrap();
        assert_eq!(reader.receive().unwrap().unwrap().n_classified, sequence + 1);
        // The first seconds connect publishers and readers.
        if sequence >= 2 {
            workings.push(worked_out.less(before));
            assert_eq!(after.less(worked_out), A_LOAN, "second {sequence}");
        }
    }
    let look = {
        let other = "crunch/other".parse().unwrap();
        let reports = ReportPublisher::create(&node, &other).unwrap();
        let health_reports = HealthPublisher::create(&node, &other).unwrap();
        let before = Taken::so_far();
        reports.update().unwrap();
        health_reports.update().unwrap();
        Taken::since(before)
    };
    let is_looks_alone = |taken: &Taken| *taken == look.times(taken.n_allocated / look.n_allocated);
    assert!(workings.iter().any(is_looks_alone), "{workings:?}, and {look:?} to look for readers once");
}

fn check(sensor: SensorLayout, waiting: Waiting) {
    let domain = OwnDomain::make().unwrap();
    let node = Node::open(&domain, "test").unwrap();
    let name = "crunch/ring".parse().unwrap();
    let mut classifier = classifier(sensor);
    classifier.warm_up();
    let answered = Arc::default();
    let noting = Noting { classifier, answered: Arc::clone(&answered) };
    let mut service = Service::start_with(&node, &name, noting, waiting).unwrap();
    let frames = FrameReader::open(&node, &name).unwrap();
    let reports = ReportReader::open_with(&node, &name, waiting).unwrap();
    let shim = FramePublisher::create(&node, &name, sensor.n_readings()).unwrap();
    let SensorLayout { rows, columns, metres_per_count } = sensor;
    let stop = AtomicBool::new(true);
    let trip = trip(sensor, N_FRAMES);
    for (sequence, counts) in (0..).zip(trip.chunks_exact(sensor.n_readings())) {
        let header =
            FrameHeader { run: 7, sequence, rows, columns, metres_per_count, ..FrameHeader::default() };
        let before = Taken::so_far();
        let mut loan = shim.loan().unwrap();
        loan.counts_mut().copy_from_slice(counts);
        loan.send(&header).unwrap();
        let published = Taken::since(before);

        // Another reader, which waits by event.
        let before = Taken::so_far();
        assert_eq!(frames.wait(Duration::from_secs(10)).unwrap(), WakeUp::Event);
        drop(frames.receive().unwrap().unwrap());
        let read = Taken::since(before);

        let before = Taken::so_far();
        service.run(&stop).unwrap();
        let served = Taken::since(before);
        let n_until_answer = answered.load(Ordering::Relaxed) - before.n_allocated;

        let before = Taken::so_far();
        if waiting == Waiting::ByEvent {
            assert_eq!(reports.wait(Duration::from_secs(10)).unwrap(), WakeUp::Event);
        }
        let report = reports.receive().unwrap().unwrap();
        let reported = Taken::since(before);

        assert_eq!((report.sequence, report.status()), (sequence, ReportStatus::Classified));
        // The first frames connect publishers and readers.
        if sequence >= 3 {
            let all = (published, read, n_until_answer, served, reported);
            assert_eq!(all, (A_LOAN, NOTHING, 0, A_LOAN, NOTHING), "frame {sequence}, {waiting:?}");
        }
    }
}
