//! Two ends in one process, over this machine's own network, and what else may come over a link.

use std::net::TcpListener;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

use kinds_messages::{Domain, KindReport, Node, OwnDomain, ReportPublisher, ReportReader, SensorName};
use zenoh::Wait;

use crate::link::{Link, key};
use crate::{Arrived, BridgeError, Endpoint, FarEnd, NearEnd};

const DEADLINE: Duration = Duration::from_secs(60);

fn sensor() -> SensorName {
    "crunch/ring".parse().unwrap()
}

fn node(domain: &Domain) -> Node {
    Node::open(domain, "test").unwrap()
}

/// An address at which nobody listens.
fn endpoint() -> Endpoint {
    let port = TcpListener::bind("127.0.0.1:0").unwrap().local_addr().unwrap().port();
    format!("tcp/127.0.0.1:{port}").parse().unwrap()
}

fn report(sequence: u64) -> KindReport {
    let mut report = KindReport::default();
    (report.run, report.sequence, report.reported_monotonic_ns) = (1, sequence, 5);
    report.set_probabilities(&[0.25, 0.75], &[0.5, 0.5]);
    report
}

/// Runs a far end on a thread of its own while a body looks at the reports there, and returns what it told and what arrived.
fn with_far_end(endpoint: &Endpoint, body: impl FnOnce(&ReportReader)) -> (Vec<String>, Arrived) {
    let domain = OwnDomain::make().unwrap();
    let reader = ReportReader::open(&node(&domain), &sensor()).unwrap();
    let stop = AtomicBool::new(false);
    std::thread::scope(|scope| {
        let far = scope.spawn(|| {
            let mut told = Vec::new();
            let mut far = FarEnd::connect(&node(&domain), &sensor(), endpoint).unwrap();
            let arrived = far.run(&stop, &mut |words| told.push(words), &mut |_| ()).unwrap();
            (told, arrived)
        });
        body(&reader);
        stop.store(true, Ordering::Relaxed);
        far.join().unwrap()
    })
}

/// The next report there.
fn await_report(reader: &ReportReader) -> KindReport {
    let start = Instant::now();
    loop {
        if let Some(report) = reader.receive().unwrap() {
            return report;
        }
        assert!(start.elapsed() < DEADLINE, "no report came");
        reader.wait(Duration::from_millis(50)).unwrap();
    }
}

#[test]
fn a_report_comes_as_it_is_to_whoever_comes_when() {
    let (robot, endpoint, stop) = (OwnDomain::make().unwrap(), endpoint(), AtomicBool::new(false));
    let service = ReportPublisher::create(&node(&robot), &sensor()).unwrap();
    service.pass_on(&report(7)).unwrap();
    std::thread::scope(|scope| {
        let near = scope.spawn(|| {
            let mut near = NearEnd::listen(&node(&robot), &sensor(), &endpoint).unwrap();
            near.run(&stop, &mut |_| (), &mut |_| ()).unwrap()
        });
        // The service's readers get what it has when it ticks.
        let start = Instant::now();
        let (told, arrived) = with_far_end(&endpoint, |reader| {
            while reader.receive().unwrap().is_none_or(|last| last.as_bytes() != report(7).as_bytes()) {
                assert!(start.elapsed() < DEADLINE, "the last report has not come");
                service.update().unwrap();
                reader.wait(Duration::from_millis(20)).unwrap();
            }
            service.pass_on(&report(8)).unwrap();
            assert_eq!(await_report(reader).as_bytes(), report(8).as_bytes());
        });
        assert_eq!(arrived, Arrived { n_passed_on: 2, ..Arrived::default() });
        assert_eq!(told.last(), Some(&format!("the robot's end at {endpoint} is there")));
        stop.store(true, Ordering::Relaxed);
        assert_eq!(near.join().unwrap().n_sent, 2);
    });
}

#[test]
fn what_others_send_is_refused_in_words_and_what_is_whole_is_passed_on() {
    let endpoint = endpoint();
    let link = Link::listen(&endpoint).unwrap();
    let publisher = link.session().declare_publisher(key(&sensor())).wait().unwrap();
    let (told, arrived) = with_far_end(&endpoint, |reader| {
        let start = Instant::now();
        while !publisher.matching_status().wait().unwrap().matching() {
            assert!(start.elapsed() < DEADLINE, "nobody came");
            std::thread::sleep(Duration::from_millis(5));
        }
        let mut other = report(0);
        other.version = 999;
        publisher.put(other.as_bytes()).wait().unwrap();
        publisher.put(&report(0).as_bytes()[..40]).wait().unwrap();
        publisher.put(report(1).as_bytes()).wait().unwrap();
        assert_eq!(await_report(reader).sequence, 1);
    });
    assert_eq!(arrived, Arrived { n_passed_on: 1, n_refused: 2, ..Arrived::default() });
    let words = format!(
        "crunch/ring: what comes cannot be passed on: they are of layout version 999, this program reads version {}; run all \
         programs in the same version",
        KindReport::VERSION
    );
    assert!(told.contains(&words), "{told:?}");
}

#[test]
fn a_port_that_is_taken_is_a_sentence() {
    let domain = OwnDomain::make().unwrap();
    let taken = TcpListener::bind("127.0.0.1:0").unwrap();
    let endpoint: Endpoint = format!("tcp/{}", taken.local_addr().unwrap()).parse().unwrap();
    let refused = NearEnd::listen(&node(&domain), &sensor(), &endpoint).unwrap_err();
    assert_eq!(
        refused.to_string(),
        format!("cannot listen at {endpoint}: Address already in use (os error 98)")
    );
    let error = BridgeError::Link { attempt: "listen", endpoint };
    assert!(error.to_string().ends_with("the network's library failed; KINDS_LOG=debug says more"));
}
