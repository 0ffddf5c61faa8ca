//! What must hold of the shim, with devices and services made up, each test in a domain of its own.

use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc;
use std::thread;
use std::time::{Duration, Instant};

use kinds_messages::{
    Command, Domain, FrameReader, KindReport, Node, OwnDomain, Pose, ReportPublisher, SensorName,
    monotonic_ns, ns_since_epoch,
};
use kinds_trips::{FrameLayout, Stamp};

use crate::{Capture, FOLLOW_WINDOW, Flow, Notice, Reading, Sensor, SensorError, Shim, Summary};

const DEADLINE: Duration = Duration::from_secs(20);
const LAYOUT: FrameLayout = FrameLayout { rows: 2, columns: 3, metres_per_count: 0.002 };
const POSE: Pose = Pose { x_m: 1.0, y_m: 2.0, yaw_rad: 0.5 };
const TRUE_POSE: Pose = Pose { x_m: 1.1, y_m: 2.2, yaw_rad: 0.6 };
const COMMAND: Command = Command { forward_m_s: 0.2, turn_rad_s: 0.1 };

/// Counts frames: each holds its number, plus one, in every reading.
struct Counter {
    n_frames: u64,
    next: u64,
}

impl Counter {
    fn new(n_frames: u64) -> Self {
        Self { n_frames, next: 0 }
    }
}

impl Sensor for Counter {
    fn layout(&self) -> FrameLayout {
        LAYOUT
    }

    fn read(&mut self, counts: &mut [u16], _timeout: Duration) -> Result<Reading, SensorError> {
        if self.next == self.n_frames {
            return Ok(Reading::End);
        }
        self.next += 1;
        counts.fill(self.next as u16);
        let captured = Stamp(self.next as i64);
        Ok(Reading::Frame(Capture {
            captured,
            pose: Some(POSE),
            command: Some(COMMAND),
            true_pose: Some(TRUE_POSE),
        }))
    }
}

/// Never has a frame, and writes to the slice it is given each time.
struct Sleeper<'a> {
    n_reads: u64,
    stop: &'a AtomicBool,
}

impl Sensor for Sleeper<'_> {
    fn layout(&self) -> FrameLayout {
        LAYOUT
    }

    fn read(&mut self, counts: &mut [u16], _timeout: Duration) -> Result<Reading, SensorError> {
        assert!(
            counts.iter().all(|&count| u64::from(count) == self.n_reads),
            "not the slice of the last call"
        );
        self.n_reads += 1;
        counts.fill(self.n_reads as u16);
        if self.n_reads == 3 {
            self.stop.store(true, Ordering::Relaxed);
        }
        Ok(Reading::NotYet)
    }
}

fn ring() -> SensorName {
    "crunch/ring".parse().unwrap()
}

fn open(domain: &Domain) -> Node {
    Node::open(domain, "test").unwrap()
}

/// A shim over counted frames in a thread of its own. Stopped when this is dropped, so that a test that fails ends.
struct Running<'scope> {
    notices: mpsc::Receiver<Notice>,
    thread: Option<thread::ScopedJoinHandle<'scope, Summary>>,
    stop: &'scope AtomicBool,
}

impl<'scope> Running<'scope> {
    fn start<'env>(
        scope: &'scope thread::Scope<'scope, 'env>,
        domain: &'scope Domain,
        stop: &'scope AtomicBool,
        n_frames: u64,
        flow: Flow,
    ) -> Self {
        let (sender, notices) = mpsc::channel();
        let thread = scope.spawn(move || {
            let mut shim = Shim::new(&open(domain), &ring(), Counter::new(n_frames), flow).unwrap();
            shim.run(stop, &mut |notice| sender.send(notice).unwrap()).unwrap()
        });
        Self { notices, thread: Some(thread), stop }
    }

    fn expect(&self, notice: Notice) {
        assert_eq!(self.notices.recv_timeout(DEADLINE), Ok(notice));
    }

    /// Waits for the end, and expects that nothing more was said.
    fn join(mut self) -> Summary {
        let summary = self.thread.take().unwrap().join().unwrap();
        assert_eq!(self.notices.try_iter().collect::<Vec<_>>(), []);
        summary
    }
}

impl Drop for Running<'_> {
    fn drop(&mut self) {
        self.stop.store(true, Ordering::Relaxed);
    }
}

/// A service that reports only when a test tells it to.
struct Service {
    frames: FrameReader,
    reports: ReportPublisher,
    _node: Node,
}

impl Service {
    fn start(domain: &Domain) -> Self {
        let node = open(domain);
        let frames = FrameReader::open(&node, &ring()).unwrap();
        let reports = ReportPublisher::create(&node, &ring()).unwrap();
        Self { frames, reports, _node: node }
    }

    /// Takes frames until there are `n_frames`, and a moment longer to see whether more come. Returns run and sequence
    /// of each.
    fn take(&self, n_frames: usize) -> Vec<(u64, u64)> {
        let start = Instant::now();
        let mut taken = Vec::new();
        loop {
            let n_before = taken.len();
            let frames = std::iter::from_fn(|| self.frames.receive().unwrap());
            taken.extend(frames.map(|frame| (frame.header().run, frame.header().sequence)));
            if taken.len() >= n_frames && taken.len() == n_before {
                return taken;
            }
            assert!(start.elapsed() < DEADLINE, "only {} frames of {n_frames} came", taken.len());
            self.frames.wait(Duration::from_millis(20)).unwrap();
        }
    }

    fn report(&self, frames: &[(u64, u64)]) {
        self.reports.update().unwrap();
        for &(run, sequence) in frames {
            let mut report = KindReport::default();
            report.run = run;
            report.sequence = sequence;
            self.reports.send(&report).unwrap();
        }
    }
}

#[test]
fn frames_of_a_device_are_numbered_and_say_all_that_is_known() {
    let domain = OwnDomain::make().unwrap();
    let node = open(&domain);
    let reader = FrameReader::open(&node, &ring()).unwrap();
    let (wall, monotonic) = (ns_since_epoch() as u64, monotonic_ns());
    let mut shim = Shim::new(&node, &ring(), Counter::new(5), Flow::Live).unwrap();
    let summary = shim.run(&AtomicBool::new(false), &mut |notice| panic!("{notice}")).unwrap();
    assert_eq!((summary.n_frames, summary.n_unreported), (5, 0));
    for sequence in 0..5 {
        let frame = reader.receive().unwrap().unwrap();
        assert_eq!(frame.counts(), [sequence as u16 + 1; 6]);
        let header = frame.header();
        assert_eq!((header.sequence, header.captured_ns), (sequence, sequence as i64 + 1));
        assert_eq!((header.rows, header.columns, header.metres_per_count), (2, 3, 0.002));
        assert_eq!((header.known_pose(), header.known_command()), (Some(POSE), Some(COMMAND)));
        assert_eq!(header.known_true_pose(), Some(TRUE_POSE));
        assert!((wall..=ns_since_epoch() as u64).contains(&header.run));
        assert!((monotonic..=monotonic_ns()).contains(&header.sent_monotonic_ns));
    }
    assert!(reader.receive().unwrap().is_none());
}

#[test]
fn stop_flag_ends_a_shim_whose_device_has_no_frame_and_the_loan_stays_the_same() {
    let domain = OwnDomain::make().unwrap();
    let stop = AtomicBool::new(false);
    let mut shim =
        Shim::new(&open(&domain), &ring(), Sleeper { n_reads: 0, stop: &stop }, Flow::Live).unwrap();
    let summary = shim.run(&stop, &mut |notice| panic!("{notice}")).unwrap();
    assert_eq!(summary.n_frames, 0);
    assert_eq!(shim.device().n_reads, 3);
}

#[test]
fn stop_flag_ends_a_shim_that_publishes_and_one_that_waits() {
    let domain = OwnDomain::make().unwrap();
    let stop = AtomicBool::new(true);
    for flow in [Flow::Live, Flow::FromFirstReader, Flow::Followed] {
        let mut shim = Shim::new(&open(&domain), &ring(), Counter::new(5), flow).unwrap();
        assert_eq!(shim.run(&stop, &mut |_| {}).unwrap().n_frames, 0);
    }
}

#[test]
fn run_that_is_over_at_once_is_not_lost_on_a_reader_that_waits() {
    let domain = OwnDomain::make().unwrap();
    let (ready, is_ready) = mpsc::channel();
    thread::scope(|scope| {
        let reading = scope.spawn(|| {
            let node = open(&domain);
            let reader = FrameReader::open(&node, &ring()).unwrap();
            ready.send(()).unwrap();
            let start = Instant::now();
            let mut sequences = Vec::new();
            while sequences.len() < 3 {
                assert!(start.elapsed() < DEADLINE, "only {sequences:?} came");
                reader.wait(Duration::from_millis(50)).unwrap();
                let frames = std::iter::from_fn(|| reader.receive().unwrap());
                sequences.extend(frames.map(|frame| frame.header().sequence));
            }
            sequences
        });
        is_ready.recv().unwrap();
        let mut shim = Shim::new(&open(&domain), &ring(), Counter::new(3), Flow::Live).unwrap();
        shim.run(&AtomicBool::new(false), &mut |_| {}).unwrap();
        drop(shim);
        assert_eq!(reading.join().unwrap(), [0, 1, 2]);
    });
}

#[test]
fn first_frame_waits_for_the_first_reader() {
    let (domain, stop) = (OwnDomain::make().unwrap(), AtomicBool::new(false));
    thread::scope(|scope| {
        let shim = Running::start(scope, &domain, &stop, 3, Flow::FromFirstReader);
        shim.expect(Notice::WaitingForReader { sensor: ring() });
        let node = open(&domain);
        let reader = FrameReader::open(&node, &ring()).unwrap();
        let mut sequences = Vec::new();
        let start = Instant::now();
        while sequences.len() < 3 {
            assert!(start.elapsed() < DEADLINE, "only {sequences:?} came");
            reader.wait(Duration::from_millis(10)).unwrap();
            let frames = std::iter::from_fn(|| reader.receive().unwrap());
            sequences.extend(frames.map(|frame| frame.header().sequence));
        }
        assert_eq!(sequences, [0, 1, 2]);
        shim.expect(Notice::Publishing { sensor: ring() });
        assert_eq!(shim.join().n_frames, 3);
    });
}

#[test]
fn followed_shim_sends_a_window_ahead_of_the_reports_and_no_more() {
    const N_FRAMES: u64 = 5 * FOLLOW_WINDOW + 3;
    let (domain, stop) = (OwnDomain::make().unwrap(), AtomicBool::new(false));
    thread::scope(|scope| {
        let shim = Running::start(scope, &domain, &stop, N_FRAMES, Flow::Followed);
        shim.expect(Notice::WaitingForService { sensor: ring() });
        let service = Service::start(&domain);
        shim.expect(Notice::Publishing { sensor: ring() });
        let mut expected = 0..N_FRAMES;
        while !expected.is_empty() {
            let n_ahead = FOLLOW_WINDOW.min(expected.end - expected.start);
            let taken = service.take(n_ahead as usize);
            let sequences: Vec<u64> = taken.iter().map(|&(_, sequence)| sequence).collect();
            assert_eq!(sequences, expected.by_ref().take(n_ahead as usize).collect::<Vec<_>>());
            service.report(&taken);
        }
        let summary = shim.join();
        assert_eq!((summary.n_frames, summary.n_unreported), (N_FRAMES, 0));
    });
}

#[test]
fn followed_shim_waits_for_another_service_when_the_first_goes_and_counts_what_it_left() {
    let (domain, stop) = (OwnDomain::make().unwrap(), AtomicBool::new(false));
    thread::scope(|scope| {
        let first = Service::start(&domain);
        let shim = Running::start(scope, &domain, &stop, 12, Flow::Followed);
        let taken = first.take(FOLLOW_WINDOW as usize);
        first.report(&taken[..2]);
        assert_eq!(first.take(2).len(), 2);
        drop(first);
        shim.expect(Notice::ServiceGone { sensor: ring(), n_unreported: FOLLOW_WINDOW });
        shim.expect(Notice::WaitingForService { sensor: ring() });
        let second = Service::start(&domain);
        shim.expect(Notice::Publishing { sensor: ring() });
        let rest = second.take(2);
        assert_eq!(rest.iter().map(|&(_, sequence)| sequence).collect::<Vec<_>>(), [10, 11]);
        second.report(&rest);
        let summary = shim.join();
        assert_eq!((summary.n_frames, summary.n_unreported), (12, FOLLOW_WINDOW));
    });
}

#[test]
fn silence_of_a_service_is_noticed_and_ends_the_wait_for_its_last_reports() {
    let (domain, stop) = (OwnDomain::make().unwrap(), AtomicBool::new(false));
    thread::scope(|scope| {
        let service = Service::start(&domain);
        let shim = Running::start(scope, &domain, &stop, FOLLOW_WINDOW + 1, Flow::Followed);
        let taken = service.take(FOLLOW_WINDOW as usize);
        shim.expect(Notice::ServiceSilent { sensor: ring(), sequence: 0 });
        service.report(&taken[..1]);
        assert_eq!(service.take(1), [(taken[0].0, FOLLOW_WINDOW)]);
        let summary = shim.join();
        assert_eq!((summary.n_frames, summary.n_unreported), (FOLLOW_WINDOW + 1, FOLLOW_WINDOW));
    });
}

#[test]
fn notices_are_sentences() {
    let sensor = ring();
    for (notice, sentence) in [
        (
            Notice::WaitingForReader { sensor: sensor.clone() },
            "waiting for a program that reads the frames of crunch/ring",
        ),
        (Notice::WaitingForService { sensor: sensor.clone() }, "waiting for a service for crunch/ring"),
        (Notice::Publishing { sensor: sensor.clone() }, "publishing crunch/ring"),
        (
            Notice::ServiceGone { sensor: sensor.clone(), n_unreported: 3 },
            "the service for crunch/ring is gone and left 3 frames unreported",
        ),
        (
            Notice::ServiceSilent { sensor, sequence: 12 },
            "the service for crunch/ring has not reported on frame 12; waiting (does it have a model of this sensor?)",
        ),
    ] {
        assert_eq!(notice.to_string(), sentence);
    }
}
