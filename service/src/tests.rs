//! What must hold of the service, with a stand-in for the model, each test in a domain of its own.

use std::cell::RefCell;
use std::ops::Range;
use std::rc::Rc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread;
use std::time::Duration;

use kinds_messages::{
    FrameHeader, FramePublisher, FrameReader, KindReport, Node, OwnDomain, ReportReader, ReportStatus,
    SensorName, Waiting, monotonic_ns,
};
use kinds_model::{Classification, Command, Filter, MedianFilter, ModelId, SensorLayout, Status};

use crate::{Classify, DriftWindow, Service, Summary};

const LAYOUT: SensorLayout = SensorLayout { rows: 2, columns: 4, metres_per_count: 0.001 };
const N_READINGS: usize = 8;
const MODEL_ID: [u8; 16] = *b"the spy's model.";

/// Answers with the first count as kind, and notes where each frame lay and what it held.
struct Spy {
    compares_commands: bool,
    seen: Rc<RefCell<Vec<Seen>>>,
    classification: Classification,
}

struct Seen {
    counts: Vec<u16>,
    command: Option<Command>,
    address: Range<usize>,
    /// The mapping of /dev/shm that the frame lay in, as /proc/self/maps says.
    mapping: Option<String>,
}

impl Spy {
    fn new() -> (Self, Rc<RefCell<Vec<Seen>>>) {
        let seen = Rc::default();
        let classification = Classification {
            status: Status::Classified,
            kind: 0,
            n_invalid: 0,
            probabilities: vec![0.25, 0.75],
            coordinates: vec![1.5, -2.5, 3.5],
            log_likelihood: -4.5,
            novelty: 0.125,
        };
        (Self { compares_commands: false, seen: Rc::clone(&seen), classification }, seen)
    }
}

impl Classify for Spy {
    fn layout(&self) -> SensorLayout {
        LAYOUT
    }

    fn model_id(&self) -> ModelId {
        ModelId(MODEL_ID)
    }

    fn introduce(&self, report: &mut KindReport) {
        report.model_id = MODEL_ID;
        report.set_kinds([4, 7].into_iter(), [(0, 1)].into_iter());
    }

    fn compares_commands(&self) -> bool {
        self.compares_commands
    }

    fn is_novel(&self, novelty: f64) -> bool {
        novelty > 0.5
    }

    fn median(&self) -> Option<MedianFilter> {
        None
    }

    fn filter(&self) -> Filter {
        Filter::new(0.5, &[0.5, 0.5])
    }

    fn drift(&self) -> DriftWindow {
        DriftWindow::new(&[0.5, 0.5], 0.01, None)
    }

    fn half_split_error(&mut self) -> Option<f64> {
        None
    }

    fn classify(&mut self, counts: &[u16], command: Option<Command>) -> &Classification {
        let address = counts.as_ptr_range();
        let address = address.start as usize..address.end as usize;
        let mapping = shared_mapping(&address);
        self.seen.borrow_mut().push(Seen { counts: counts.to_vec(), command, address, mapping });
        let invalid = counts.iter().filter(|&&count| count == 0).count();
        self.classification.n_invalid = invalid;
        self.classification.kind = usize::from(counts[0]);
        self.classification.status =
            if invalid == counts.len() { Status::Invalid } else { Status::Classified };
        &self.classification
    }
}

/// The line of /proc/self/maps by which an address range lies in memory mapped from /dev/shm.
fn shared_mapping(address: &Range<usize>) -> Option<String> {
    let maps = std::fs::read_to_string("/proc/self/maps").unwrap();
    let covers = |line: &&str| {
        let (start, end) = line.split(' ').next().unwrap().split_once('-').unwrap();
        let hex = |text| usize::from_str_radix(text, 16).unwrap();
        hex(start) <= address.start && address.end <= hex(end)
    };
    maps.lines().filter(|line| line.contains(" /dev/shm/")).find(covers).map(str::to_owned)
}

fn ring() -> SensorName {
    "crunch/ring".parse().unwrap()
}

fn header(run: u64, sequence: u64) -> FrameHeader {
    let SensorLayout { rows, columns, metres_per_count } = LAYOUT;
    let captured_ns = 1000 + sequence as i64;
    FrameHeader { run, sequence, captured_ns, rows, columns, metres_per_count, ..FrameHeader::default() }
}

fn send(shim: &FramePublisher, header: &FrameHeader, counts: &[u16]) {
    let mut loan = shim.loan().unwrap();
    loan.counts_mut().copy_from_slice(counts);
    loan.send(header).unwrap();
}

fn send_all(shim: &FramePublisher, frames: &[(u64, u64)]) {
    for &(run, sequence) in frames {
        send(shim, &header(run, sequence), &[sequence as u16 + 1; N_READINGS]);
    }
}

fn received(reports: &ReportReader) -> Vec<KindReport> {
    std::iter::from_fn(|| reports.receive().unwrap()).collect()
}

/// Serves what waits, and returns.
fn serve_waiting(service: &mut Service<Spy>) -> Summary {
    service.run(&AtomicBool::new(true)).unwrap()
}

#[test]
fn frames_are_classified_where_they_lie_in_shared_memory() {
    let domain = OwnDomain::make().unwrap();
    let node = Node::open(&domain, "test").unwrap();
    let (spy, seen) = Spy::new();
    let mut service = Service::start(&node, &ring(), spy).unwrap();
    let shim = FramePublisher::create(&node, &ring(), N_READINGS).unwrap();
    let witness = FrameReader::open(&node, &ring()).unwrap();
    for sequence in 0..3 {
        send_all(&shim, &[(7, sequence)]);
        serve_waiting(&mut service);
        // Another reader of the channel finds the frame in the same slot of the same shared memory, through its own
        // mapping.
        let frame = witness.receive().unwrap().unwrap();
        let lent = frame.counts().as_ptr_range();
        let lent = lent.start as usize..lent.end as usize;
        let seen = seen.borrow();
        let seen = seen.last().unwrap();
        assert_eq!(seen.counts, frame.counts());
        let classified =
            place_in_file(seen.mapping.as_ref().expect("classified outside shared memory"), &seen.address);
        let mapping = shared_mapping(&lent).expect("lent outside shared memory");
        assert_eq!(classified, place_in_file(&mapping, &lent));
    }
}

/// File, inode and bytes in it that an address range of a mapping stands for.
fn place_in_file(mapping: &str, address: &Range<usize>) -> (String, Range<usize>) {
    let fields: Vec<&str> = mapping.split_whitespace().collect();
    let start = usize::from_str_radix(fields[0].split_once('-').unwrap().0, 16).unwrap();
    let offset = usize::from_str_radix(fields[2], 16).unwrap();
    let place = |address: usize| address - start + offset;
    (format!("{} {}", fields[4], fields[5]), place(address.start)..place(address.end))
}

#[test]
fn every_frame_gets_one_report_that_says_all_the_classifier_said() {
    let domain = OwnDomain::make().unwrap();
    let node = Node::open(&domain, "test").unwrap();
    let mut service = Service::start(&node, &ring(), Spy::new().0).unwrap();
    let reports = ReportReader::open(&node, &ring()).unwrap();
    let shim = FramePublisher::create(&node, &ring(), N_READINGS).unwrap();
    let before = monotonic_ns();
    send(&shim, &header(7, 0), &[1, 0, 3, 4, 5, 0, 7, 8]);
    let summary = serve_waiting(&mut service);
    assert_eq!(summary, Summary { n_frames: 1, n_classified: 1, ..Summary::default() });

    let [report] = received(&reports)[..] else { panic!("not one report") };
    assert_eq!(report.status(), ReportStatus::Classified);
    assert_eq!((report.kind, report.n_invalid), (1, 2));
    assert_eq!((report.run, report.sequence, report.n_lost, report.captured_ns), (7, 0, 0, 1000));
    assert_eq!(report.model_id, MODEL_ID);
    assert_eq!((report.numbers(), report.at_level(1).groups()), (&[4, 7][..], &[0, 0][..]));
    assert_eq!((report.log_likelihood, report.novelty), (-4.5, 0.125));
    assert_eq!(report.probabilities(), [0.25, 0.75]);
    assert_eq!(report.coordinates(), [1.5, -2.5, 3.5]);
    let times = [
        before,
        report.sent_monotonic_ns,
        report.received_monotonic_ns,
        report.reported_monotonic_ns,
        monotonic_ns(),
    ];
    assert!(times.is_sorted(), "{times:?}");
}

#[test]
fn all_invalid_frame_is_reported_as_invalid() {
    let domain = OwnDomain::make().unwrap();
    let node = Node::open(&domain, "test").unwrap();
    let mut service = Service::start(&node, &ring(), Spy::new().0).unwrap();
    let reports = ReportReader::open(&node, &ring()).unwrap();
    let shim = FramePublisher::create(&node, &ring(), N_READINGS).unwrap();
    send(&shim, &header(7, 0), &[0; N_READINGS]);
    let summary = serve_waiting(&mut service);
    assert_eq!(summary, Summary { n_frames: 1, n_invalid: 1, ..Summary::default() });
    let [report] = received(&reports)[..] else { panic!("not one report") };
    assert_eq!((report.status(), report.n_invalid), (ReportStatus::Invalid, 8));
}

#[test]
fn gaps_are_counted_and_repeated_frames_are_not_classified_again() {
    let domain = OwnDomain::make().unwrap();
    let node = Node::open(&domain, "test").unwrap();
    let (spy, seen) = Spy::new();
    let mut service = Service::start(&node, &ring(), spy).unwrap();
    let reports = ReportReader::open(&node, &ring()).unwrap();
    let shim = FramePublisher::create(&node, &ring(), N_READINGS).unwrap();
    send_all(&shim, &[(7, 0), (7, 0), (7, 3), (7, 1), (7, 4), (8, 1), (8, 2)]);
    let summary = serve_waiting(&mut service);
    assert_eq!(
        summary,
        Summary { n_frames: 7, n_classified: 5, n_repeated: 2, n_lost: 3, ..Summary::default() }
    );
    let told: Vec<_> = received(&reports).iter().map(|r| (r.run, r.sequence, r.n_lost)).collect();
    assert_eq!(told, [(7, 0, 0), (7, 3, 2), (7, 4, 0), (8, 1, 1), (8, 2, 0)]);
    assert_eq!(seen.borrow().len(), 5);
}

#[test]
fn filtered_kinds_follow_from_those_of_a_run_and_know_how_many_frames_were_lost() {
    let domain = OwnDomain::make().unwrap();
    let node = Node::open(&domain, "test").unwrap();
    let mut service = Service::start(&node, &ring(), Spy::new().0).unwrap();
    let reports = ReportReader::open(&node, &ring()).unwrap();
    let shim = FramePublisher::create(&node, &ring(), N_READINGS).unwrap();
    send_all(&shim, &[(7, 0), (7, 3)]);
    send(&shim, &header(7, 4), &[0; N_READINGS]);
    send_all(&shim, &[(8, 0)]);
    serve_waiting(&mut service);
    // The spy's frames speak three to one for the second of two kinds of equal weight, and a kind is kept with probability ½.
    let weighed = |second: f64| 3.0 * second / (3.0 * second + (1.0 - second));
    let kept = |second: f64, share: f64| share * second + (1.0 - share) * 0.5;
    let after_gap = weighed(kept(0.75, 0.125));
    let expected = [0.75, after_gap, kept(after_gap, 0.5), 0.75];
    let received = received(&reports);
    for (report, expected) in received.iter().zip(expected) {
        let [first, second] = report.filtered() else { panic!("not two kinds") };
        assert!((second - expected).abs() < 1e-15 && (first + second - 1.0).abs() < 1e-15, "{report:?}");
    }
    let told: Vec<_> = received.iter().map(|r| (r.filtered_kind, r.n_filtered)).collect();
    assert_eq!(told, [(1, 1), (1, 2), (1, 3), (1, 1)]);
}

#[test]
fn service_that_joins_a_run_does_not_call_its_beginning_lost() {
    let domain = OwnDomain::make().unwrap();
    let node = Node::open(&domain, "test").unwrap();
    let shim = FramePublisher::create(&node, &ring(), N_READINGS).unwrap();
    send_all(&shim, &[(7, 0), (7, 1)]);
    let mut service = Service::start(&node, &ring(), Spy::new().0).unwrap();
    send_all(&shim, &[(7, 2), (7, 4)]);
    let summary = serve_waiting(&mut service);
    assert_eq!(summary, Summary { n_frames: 2, n_classified: 2, n_lost: 1, ..Summary::default() });
}

#[test]
fn frames_of_another_sensor_are_never_classified_and_the_service_stays_up() {
    let right = header(7, 0);
    let others = [
        FrameHeader { version: 2, ..right },
        FrameHeader { rows: 3, ..right },
        FrameHeader { rows: 4, columns: 2, ..right },
        FrameHeader { metres_per_count: 0.002, ..right },
        FrameHeader { metres_per_count: f64::NAN, ..right },
    ];
    let domain = OwnDomain::make().unwrap();
    let node = Node::open(&domain, "test").unwrap();
    let (spy, seen) = Spy::new();
    let mut service = Service::start(&node, &ring(), spy).unwrap();
    let shim = FramePublisher::create(&node, &ring(), N_READINGS).unwrap();
    for other in others {
        send(&shim, &other, &[1; N_READINGS]);
    }
    serve_waiting(&mut service);
    drop(shim);
    let shim = FramePublisher::create(&node, &ring(), N_READINGS - 1).unwrap();
    send(&shim, &FrameHeader { rows: 1, columns: 7, ..right }, &[1; N_READINGS - 1]);
    let summary = serve_waiting(&mut service);
    assert_eq!(summary, Summary { n_frames: 6, n_refused: 6, ..Summary::default() });
    assert!(seen.borrow().is_empty());

    drop(shim);
    let shim = FramePublisher::create(&node, &ring(), N_READINGS).unwrap();
    send(&shim, &FrameHeader { metres_per_count: 0.1 / 100.0, ..right }, &[1; N_READINGS]);
    assert_eq!(serve_waiting(&mut service).n_classified, 1);
}

#[test]
fn second_service_for_a_sensor_is_refused_and_the_first_goes_on() {
    let domain = OwnDomain::make().unwrap();
    let (node, other) = (Node::open(&domain, "test").unwrap(), Node::open(&domain, "test").unwrap());
    let mut service = Service::start(&node, &ring(), Spy::new().0).unwrap();
    let Err(error) = Service::start(&other, &ring(), Spy::new().0) else { panic!("two services") };
    assert_eq!(
        error.to_string(),
        "sensor crunch/ring is already served by another service; stop that one first, or serve another sensor name"
    );
    let shim = FramePublisher::create(&node, &ring(), N_READINGS).unwrap();
    send_all(&shim, &[(7, 0)]);
    assert_eq!(serve_waiting(&mut service).n_classified, 1);
}

#[test]
fn service_is_woken_by_frames_outlives_its_shim_and_serves_what_waits_when_stopped() {
    check_that_two_runs_are_served(Waiting::ByEvent);
}

#[test]
fn service_that_polls_outlives_its_shim_and_serves_what_waits_when_stopped() {
    check_that_two_runs_are_served(Waiting::Polling);
}

fn check_that_two_runs_are_served(waiting: Waiting) {
    let domain = OwnDomain::make().unwrap();
    let stop = AtomicBool::new(false);
    thread::scope(|scope| {
        let serving = scope.spawn(|| {
            let node = Node::open(&domain, "service").unwrap();
            let service = Service::start_with(&node, &ring(), Spy::new().0, waiting);
            service.unwrap().run(&stop).unwrap()
        });
        let node = Node::open(&domain, "test").unwrap();
        let reports = ReportReader::open(&node, &ring()).unwrap();
        while reports.service().is_none() {
            reports.wait(Duration::from_millis(10)).unwrap();
        }
        let mut told = Vec::new();
        for run in 1..=2 {
            let shim = FramePublisher::create(&node, &ring(), N_READINGS).unwrap();
            for sequence in 0..40 {
                send_all(&shim, &[(run, sequence)]);
                while told.last() != Some(&(run, sequence)) {
                    reports.wait(Duration::from_secs(10)).unwrap();
                    told.extend(received(&reports).iter().map(|report| (report.run, report.sequence)));
                }
            }
            if run == 2 {
                send_all(&shim, &[(run, 40), (run, 41)]);
                stop.store(true, Ordering::Relaxed);
            }
        }
        let summary = serving.join().unwrap();
        assert_eq!(summary, Summary { n_frames: 82, n_classified: 82, ..Summary::default() });
        told.extend(received(&reports).iter().map(|report| (report.run, report.sequence)));
        let sent = (0..40).map(|sequence| (1, sequence)).chain((0..42).map(|sequence| (2, sequence)));
        assert!(told.into_iter().eq(sent));
    });
}

#[test]
fn a_frames_command_reaches_the_model_and_frames_without_one_are_counted() {
    let domain = OwnDomain::make().unwrap();
    let node = Node::open(&domain, "test").unwrap();
    let (spy, seen) = Spy::new();
    let mut service = Service::start(&node, &ring(), Spy { compares_commands: true, ..spy }).unwrap();
    let shim = FramePublisher::create(&node, &ring(), N_READINGS).unwrap();
    let told = |forward_m_s, turn_rad_s| Some(kinds_messages::Command { forward_m_s, turn_rad_s });
    let commands = [None, told(0.25, -1.5), told(f64::NAN, 0.0), told(0.0, f64::INFINITY), None];
    for (sequence, command) in (0..).zip(commands) {
        // The last frame is invalid: whatever its command, it is not classified.
        let count = if sequence == 4 { 0 } else { 1 };
        send(&shim, &header(7, sequence).with_command(command), &[count; N_READINGS]);
    }
    let summary = serve_waiting(&mut service);
    assert_eq!((summary.n_classified, summary.n_invalid, summary.n_uncommanded), (4, 1, 3));
    let seen: Vec<_> = seen.borrow().iter().map(|seen| seen.command).collect();
    assert_eq!(seen, [None, Some(Command { forward_m_s: 0.25, turn_rad_s: -1.5 }), None, None, None]);
}
