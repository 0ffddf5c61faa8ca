//! What must hold of the two channels, each test in a domain of its own.

use std::io::{BufRead, BufReader};
use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant};

use crate::OwnDomain;
use crate::testing::{frames_channel, header, lies_in_shared_memory, shared_memory_bytes};
use crate::{
    ChannelError, Domain, FRAME_BUFFER, Frame, FramePublisher, FrameReader, KindReport, Node, REPORT_BUFFER,
    ReportPublisher, ReportReader, SensorName, WakeUp, monotonic_ns,
};

const N_READINGS: usize = 4;
const DEADLINE: Duration = Duration::from_secs(10);

fn ring() -> SensorName {
    "crunch/ring".parse().unwrap()
}

fn open(domain: &Domain) -> Node {
    Node::open(domain, "test").unwrap()
}

fn send_frame(publisher: &FramePublisher, sequence: u64) {
    let mut loan = publisher.loan().unwrap();
    loan.counts_mut().fill(sequence as u16 + 100);
    loan.send(&header(sequence)).unwrap();
}

fn report(sequence: u64) -> KindReport {
    let mut report = KindReport::default();
    report.sequence = sequence;
    report
}

/// Sequences of all frames that wait.
fn sequences(reader: &FrameReader) -> Vec<u64> {
    std::iter::from_fn(|| reader.receive().unwrap()).map(|frame| frame.header().sequence).collect()
}

/// Sequences of all reports that wait.
fn reported(reader: &ReportReader) -> Vec<u64> {
    std::iter::from_fn(|| reader.receive().unwrap()).map(|report| report.sequence).collect()
}

#[test]
fn frame_is_read_where_the_publisher_wrote_it() {
    let domain = OwnDomain::make().unwrap();
    let node = open(&domain);
    let reader = FrameReader::open(&node, &ring()).unwrap();
    let publisher = FramePublisher::create(&node, &ring(), N_READINGS).unwrap();
    let before = monotonic_ns();
    let mut loan = publisher.loan().unwrap();
    assert_eq!(loan.counts_mut(), [0, 0, 0, 0]);
    assert!(lies_in_shared_memory(loan.counts_mut()));
    loan.counts_mut().copy_from_slice(&[1, 2, 3, u16::MAX]);
    loan.send(&header(0)).unwrap();

    let frame = reader.receive().unwrap().unwrap();
    assert_eq!(frame.counts(), [1, 2, 3, u16::MAX]);
    assert!(lies_in_shared_memory(frame.counts()));
    let sent = frame.header().sent_monotonic_ns;
    assert!((before..=monotonic_ns()).contains(&sent));
    assert_eq!(*frame.header(), crate::FrameHeader { sent_monotonic_ns: sent, ..header(0) });
}

#[test]
fn memory_of_this_process_is_not_taken_for_shared() {
    assert!(!lies_in_shared_memory(&[0; 4]));
    assert!(!lies_in_shared_memory(&vec![0; 10_000]));
}

#[test]
fn either_end_of_a_channel_may_come_first() {
    let domain = OwnDomain::make().unwrap();
    let (node, other) = (open(&domain), open(&domain));
    let early = FrameReader::open(&other, &ring()).unwrap();
    assert!(!early.is_published());
    let publisher = FramePublisher::create(&node, &ring(), N_READINGS).unwrap();
    assert!(early.is_published());
    let late = FrameReader::open(&other, &ring()).unwrap();
    assert_eq!(publisher.n_readers(), 2);
    send_frame(&publisher, 0);
    assert_eq!((sequences(&early), sequences(&late)), (vec![0], vec![0]));
}

#[test]
fn full_buffer_loses_the_oldest_first() {
    let domain = OwnDomain::make().unwrap();
    let node = open(&domain);
    let frames = FrameReader::open(&node, &ring()).unwrap();
    let publisher = FramePublisher::create(&node, &ring(), N_READINGS).unwrap();
    let n_frames = FRAME_BUFFER as u64 + 5;
    (0..n_frames).for_each(|sequence| send_frame(&publisher, sequence));
    assert_eq!(sequences(&frames), (5..n_frames).collect::<Vec<_>>());

    let reports = ReportReader::open(&node, &ring()).unwrap();
    let publisher = ReportPublisher::create(&node, &ring()).unwrap();
    let n_reports = REPORT_BUFFER as u64 + 5;
    for sequence in 0..n_reports {
        publisher.send(&report(sequence)).unwrap();
    }
    assert_eq!(reported(&reports), (5..n_reports).collect::<Vec<_>>());
}

#[test]
fn late_joiner_gets_the_last_report_at_the_next_tick_and_is_woken() {
    let domain = OwnDomain::make().unwrap();
    let node = open(&domain);
    let publisher = ReportPublisher::create(&node, &ring()).unwrap();
    for sequence in 0..3 {
        publisher.send(&report(sequence)).unwrap();
    }
    let reader = ReportReader::open(&node, &ring()).unwrap();
    publisher.update().unwrap();
    assert_eq!(reader.wait(DEADLINE).unwrap(), WakeUp::Event);
    assert_eq!(reported(&reader), [2]);
    publisher.update().unwrap();
    assert_eq!(reader.wait(Duration::ZERO).unwrap(), WakeUp::Timeout, "woken though nobody joined");
}

#[test]
fn late_joiner_gets_no_frames_of_the_past() {
    let domain = OwnDomain::make().unwrap();
    let node = open(&domain);
    let publisher = FramePublisher::create(&node, &ring(), N_READINGS).unwrap();
    send_frame(&publisher, 0);
    let reader = FrameReader::open(&node, &ring()).unwrap();
    publisher.update().unwrap();
    assert_eq!(sequences(&reader), []);
    send_frame(&publisher, 1);
    assert_eq!(sequences(&reader), [1]);
}

#[test]
fn wait_ends_with_an_event_or_at_its_timeout() {
    let domain = OwnDomain::make().unwrap();
    let node = open(&domain);
    let reader = FrameReader::open(&node, &ring()).unwrap();
    assert_eq!(reader.wait(Duration::from_millis(1)).unwrap(), WakeUp::Timeout);
    let publisher = FramePublisher::create(&node, &ring(), N_READINGS).unwrap();
    assert_eq!(reader.wait(DEADLINE).unwrap(), WakeUp::Event, "a publisher that comes wakes its readers");
    send_frame(&publisher, 0);
    assert_eq!(reader.wait(DEADLINE).unwrap(), WakeUp::Event);
    assert_eq!(reader.wait(Duration::ZERO).unwrap(), WakeUp::Timeout);
}

#[test]
fn second_publisher_is_refused_in_words_until_the_first_goes() {
    let domain = OwnDomain::make().unwrap();
    let (node, other) = (open(&domain), open(&domain));
    let shim = FramePublisher::create(&node, &ring(), N_READINGS).unwrap();
    assert_eq!(
        FramePublisher::create(&other, &ring(), N_READINGS).unwrap_err().to_string(),
        "sensor crunch/ring is already published by another driver shim; stop that one first, or publish under \
         another sensor name"
    );
    let service = ReportPublisher::create(&node, &ring()).unwrap();
    assert_eq!(
        ReportPublisher::create(&other, &ring()).unwrap_err().to_string(),
        "sensor crunch/ring is already served by another service; stop that one first, or serve another sensor name"
    );
    drop((shim, service));
    FramePublisher::create(&other, &ring(), N_READINGS).unwrap();
    ReportPublisher::create(&other, &ring()).unwrap();
}

#[test]
fn frames_not_yet_taken_outlive_a_publisher_that_the_reader_has_connected_to() {
    let domain = OwnDomain::make().unwrap();
    let reader_node = open(&domain);
    let reader = FrameReader::open(&reader_node, &ring()).unwrap();
    {
        let node = open(&domain);
        let publisher = FramePublisher::create(&node, &ring(), N_READINGS).unwrap();
        // The publisher's arrival wakes the reader, which looks.
        assert_eq!(reader.wait(DEADLINE).unwrap(), WakeUp::Event);
        assert_eq!(sequences(&reader), []);
        (0..3).for_each(|sequence| send_frame(&publisher, sequence));
    }
    let frames: Vec<Frame> = (0..2).map(|_| reader.receive().unwrap().unwrap()).collect();
    assert_eq!(frames[1].counts(), [101; N_READINGS]);
    drop(frames);
    assert_eq!(sequences(&reader), [2]);
    assert_eq!(sequences(&reader), []);
}

#[test]
fn frames_of_a_publisher_that_no_reader_looked_at_go_with_it() {
    let domain = OwnDomain::make().unwrap();
    let reader_node = open(&domain);
    let reader = FrameReader::open(&reader_node, &ring()).unwrap();
    {
        let node = open(&domain);
        let publisher = FramePublisher::create(&node, &ring(), N_READINGS).unwrap();
        send_frame(&publisher, 0);
    }
    assert_eq!(sequences(&reader), [], "then driver shims need not linger");
}

#[test]
fn one_loan_at_a_time_and_two_frames_in_hand() {
    let domain = OwnDomain::make().unwrap();
    let node = open(&domain);
    let reader = FrameReader::open(&node, &ring()).unwrap();
    let publisher = FramePublisher::create(&node, &ring(), N_READINGS).unwrap();
    let loan = publisher.loan().unwrap();
    assert_eq!(
        publisher.loan().unwrap_err().to_string(),
        "channel natural-kinds/crunch/ring/frames: this program already holds 1 messages, the most it may; drop one \
         before taking the next"
    );
    drop(loan);
    (0..3).for_each(|sequence| send_frame(&publisher, sequence));
    let held: Vec<Frame> = (0..2).map(|_| reader.receive().unwrap().unwrap()).collect();
    assert_eq!(
        reader.receive().unwrap_err().to_string(),
        "channel natural-kinds/crunch/ring/frames: this program already holds 2 messages, the most it may; drop one \
         before taking the next"
    );
    drop(held);
    assert_eq!(sequences(&reader), [2], "a refused frame waits on");
}

#[test]
fn a_frame_sent_in_part_has_as_many_counts_and_leaves_the_next_whole() {
    let domain = OwnDomain::make().unwrap();
    let node = open(&domain);
    let reader = FrameReader::open(&node, &ring()).unwrap();
    let publisher = FramePublisher::create(&node, &ring(), 4).unwrap();
    for n_readings in [3, 0, 4] {
        let mut loan = publisher.loan().unwrap();
        loan.counts_mut().copy_from_slice(&[5, 6, 7, 8]);
        loan.send_first(n_readings, &header(1)).unwrap();
        let frame = reader.receive().unwrap().unwrap();
        assert_eq!(frame.counts(), &[5, 6, 7, 8][..n_readings]);
        assert_eq!(frame.header().columns, 4);
    }
}

#[test]
fn more_readers_than_a_channel_has_room_for_are_refused_in_words() {
    let domain = OwnDomain::make().unwrap();
    let node = open(&domain);
    let _readers: Vec<_> = (0..8).map(|_| FrameReader::open(&node, &ring()).unwrap()).collect();
    assert_eq!(
        FrameReader::open(&node, &ring()).unwrap_err().to_string(),
        "channel natural-kinds/crunch/ring/frames already has 8 readers, the most it has room for; stop one of them"
    );
}

#[test]
fn channel_of_another_layout_is_refused_in_words() {
    let domain = OwnDomain::make().unwrap();
    let node = open(&domain);
    let name = frames_channel(&domain, "crunch/ring").service_name();
    let _other = node.inner.service_builder(&name).publish_subscribe::<[u32]>().create().unwrap();
    assert_eq!(
        FrameReader::open(&node, &ring()).unwrap_err().to_string(),
        "channel natural-kinds/crunch/ring/frames exists with another message layout or other limits than this \
         program's; stop the programs that use it, and start all of them in the same version"
    );
}

#[test]
fn report_of_another_version_is_refused_in_words() {
    let domain = OwnDomain::make().unwrap();
    let node = open(&domain);
    let reader = ReportReader::open(&node, &ring()).unwrap();
    let publisher = ReportPublisher::create(&node, &ring()).unwrap();
    let mut other = report(0);
    other.version = 2;
    publisher.send(&other).unwrap();
    publisher.send(&report(1)).unwrap();
    assert_eq!(
        reader.receive().unwrap_err().to_string(),
        "channel natural-kinds/crunch/ring/kinds carries messages of layout version 2, this program reads version 3; \
         run all programs in the same version"
    );
    assert_eq!(reported(&reader), [1]);
}

#[test]
fn another_service_has_another_identity() {
    let domain = OwnDomain::make().unwrap();
    let node = open(&domain);
    let reader = ReportReader::open(&node, &ring()).unwrap();
    assert_eq!(reader.service(), None);
    let first = ReportPublisher::create(&node, &ring()).unwrap();
    let first_id = reader.service();
    assert_eq!(reader.service(), first_id);
    drop(first);
    assert_eq!(reader.service(), None);
    let _second = ReportPublisher::create(&node, &ring()).unwrap();
    assert!(reader.service().is_some() && reader.service() != first_id);
}

#[test]
fn transports_words_stay_out_of_other_sentences() {
    let domain = OwnDomain::make().unwrap();
    let channel = frames_channel(&domain, "crunch/ring");
    for (error, sentence) in [
        (
            ChannelError::transport("open", &channel, "SystemInFlux"),
            "could not open channel natural-kinds/crunch/ring/frames (\"SystemInFlux\"); if it happens again, stop all \
             programs that use it; its log at level debug says more",
        ),
        (
            ChannelError::Permission { channel: channel.name(), root: "/run/kinds".into() },
            "channel natural-kinds/crunch/ring/frames cannot be opened: permission denied under /run/kinds or in \
             /dev/shm; run all programs of a robot as one user",
        ),
        (
            ChannelError::TooManyPrograms { channel: channel.name(), limit: 16 },
            "channel natural-kinds/crunch/ring/frames is already open in 16 programs, the most it has room for; stop \
             one of them",
        ),
    ] {
        assert_eq!(error.to_string(), sentence);
    }
}

/// Run as a process of its own by the test below: publishes and serves until it is killed.
#[test]
#[ignore = "a part of killed_publishers_leave_their_places_at_once"]
fn publish_until_killed() {
    let Ok(root) = std::env::var("KINDS_TEST_ROOT") else { return };
    let node = open(&Domain::in_folder(root.as_ref()));
    let publisher = FramePublisher::create(&node, &ring(), N_READINGS).unwrap();
    let reports = ReportPublisher::create(&node, &ring()).unwrap();
    for sequence in 0.. {
        send_frame(&publisher, sequence);
        reports.send(&report(sequence)).unwrap();
        std::thread::sleep(Duration::from_millis(1));
    }
}

#[test]
fn killed_publishers_leave_their_places_at_once() {
    let domain = OwnDomain::make().unwrap();
    let node = open(&domain);
    let frames = FrameReader::open(&node, &ring()).unwrap();
    let reports = ReportReader::open(&node, &ring()).unwrap();
    for _ in 0..3 {
        let mut child = start_publisher(&domain);
        let start = Instant::now();
        while sequences(&frames).is_empty() || reported(&reports).is_empty() {
            assert!(start.elapsed() < DEADLINE, "nothing came from the other process");
            frames.wait(Duration::from_millis(10)).unwrap();
        }
        child.kill().unwrap();
        child.wait().unwrap();
        sequences(&frames);
        reported(&reports);
        // Here, as another process would.
        let publisher = FramePublisher::create(&node, &ring(), N_READINGS).unwrap();
        let service = ReportPublisher::create(&node, &ring()).unwrap();
        send_frame(&publisher, 1000);
        service.send(&report(1000)).unwrap();
        assert_eq!(sequences(&frames).last(), Some(&1000));
        assert_eq!(reported(&reports).last(), Some(&1000));
    }
}

fn start_publisher(domain: &Domain) -> Child {
    let mut child = Command::new(std::env::current_exe().unwrap())
        .args(["--exact", "tests::publish_until_killed", "--ignored"])
        .env("KINDS_TEST_ROOT", &domain.root)
        .stdout(Stdio::piped())
        .spawn()
        .unwrap();
    let stdout = BufReader::new(child.stdout.take().unwrap());
    assert!(stdout.lines().map_while(Result::ok).any(|line| line == "running 1 test"));
    child
}

#[test]
fn nothing_but_the_transports_own_small_file_is_left_behind() {
    let domain = OwnDomain::make().unwrap();
    {
        let node = open(&domain);
        let reader = FrameReader::open(&node, &ring()).unwrap();
        let publisher = FramePublisher::create(&node, &ring(), N_READINGS).unwrap();
        send_frame(&publisher, 0);
        assert_eq!(sequences(&reader), [0]);
    }
    assert_eq!(shared_memory_bytes(&domain), 16);
    {
        let _node = open(&domain);
        domain.remove_remains().unwrap();
        assert_eq!(shared_memory_bytes(&domain), 16, "a program is still in the domain");
    }
    domain.remove_remains().unwrap();
    assert_eq!(shared_memory_bytes(&domain), 0);
}
