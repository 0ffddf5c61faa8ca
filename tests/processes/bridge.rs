//! `kinds bridge`: a robot's kinds on another machine, over wires that are whole, cut and bad, and ends that are killed.

#![allow(clippy::print_stderr, reason = "how long a test took is for whoever reads its output")]

use std::io::{Read, Write};
use std::net::{Shutdown, TcpListener, TcpStream};
use std::path::Path;
use std::sync::mpsc;
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

use kinds_messages::{KindReport, ReportPublisher, monotonic_ns};
use rustix::process::Signal;
use serde_json::Value;

use crate::consumer::Consumer;
use crate::network::{Host, Network, ROBOT};
use crate::robot::{Robot, SECOND, SENSOR};
use crate::running::{Running, await_that};
use crate::world::Trip;

const PORT: u16 = 7447;

/// Starts the robot's end on it.
fn start_near(network: &Network, robot: &Robot) -> Running {
    let listen = format!("tcp/0.0.0.0:{PORT}");
    let near = network.start(Host::Robot, robot, &["bridge", "--sensor", SENSOR, "--listen", &listen]);
    near.await_out(&format!("sending the kinds of {SENSOR} to whoever connects to {listen}"));
    near
}

/// Starts the other machine's end there.
fn start_far(network: &Network, other: &Robot) -> Running {
    let connect = format!("tcp/{ROBOT}:{PORT}");
    let far = network.start(Host::Other, other, &["bridge", "--sensor", SENSOR, "--connect", &connect]);
    far.await_out(&format!("passing on the kinds of {SENSOR} from {connect}"));
    far
}

/// How often a program has said what begins so.
fn n_said(program: &Running, beginning: &str) -> usize {
    program.err().iter().filter(|line| line.starts_with(beginning)).count()
}

/// Takes all reports on a machine as they come, up to that on a frame of this number: a reader has room for so many.
fn collect(other: &Robot, last: u64) -> JoinHandle<Vec<KindReport>> {
    let (domain, (ready, is_ready)) = (other.domain().clone(), mpsc::channel());
    let collecting = std::thread::spawn(move || {
        let mut consumer = Consumer::join(&domain, SENSOR);
        ready.send(()).unwrap();
        consumer.await_frame(last).to_vec()
    });
    is_ready.recv().unwrap();
    collecting
}

fn bytes(reports: &[KindReport]) -> Vec<&[u8]> {
    reports.iter().map(KindReport::as_bytes).collect()
}

/// Sequences of the robot's reports that did not come; panics where one that came is not as it was sent, or out of order.
fn missing(on_the_robot: &[KindReport], elsewhere: &[KindReport]) -> Vec<u64> {
    let mut came = elsewhere.iter().peekable();
    let mut missing = Vec::new();
    for report in on_the_robot {
        match came.next_if(|other| other.as_bytes() == report.as_bytes()) {
            Some(_) => {}
            None => missing.push(report.sequence),
        }
    }
    assert!(came.peek().is_none(), "{:?} was not sent, or came out of order", came.peek());
    missing
}

#[test]
fn reports_on_another_machine_are_those_of_the_robot_bit_for_bit() {
    let Some(network) = Network::make() else { return };
    let (robot, other) = (Robot::trained(), Robot::new());
    // The other machine's end is there first.
    let far = start_far(&network, &other);
    far.await_err(&format!("kinds: waiting for the robot's end at tcp/{ROBOT}:{PORT}"));
    let consumer = robot.join();
    let mut elsewhere = other.join();
    let near = start_near(&network, &robot);
    near.await_err(&format!("kinds: another machine reads {SENSOR}"));
    let service = robot.serve();
    let reports = consumer.await_end_of(&mut robot.publish(SECOND, "max"));
    assert_eq!(reports.len(), 130);
    assert_eq!(bytes(elsewhere.await_frame(129)), bytes(&reports));
    // Who comes later gets the last one.
    assert_eq!(bytes(other.join().await_reports(1)), bytes(&reports[129..]));
    service.stop(Signal::TERM);
    let told = near.stop(Signal::TERM);
    assert!(
        told.ends_with("sent 130 reports; 0 were left out, since the link would not take them in time\n"),
        "{told}"
    );
    far.await_err(&format!("kinds: the link to the robot's end at tcp/{ROBOT}:{PORT} is lost"));
    let told = far.stop(Signal::TERM);
    let summary = "passed on 130 reports; 0 were lost on the way, 0 were refused\n";
    assert!(told.ends_with(summary), "{told}");
    drop(elsewhere);
    assert_eq!((robot.shared_memory(), other.shared_memory()), (vec![], vec![]));
}

#[test]
fn while_the_wire_is_cut_the_robot_goes_on_and_afterwards_the_newest_reports_come() {
    let Some(network) = Network::make() else { return };
    let (robot, other) = (Robot::trained(), Robot::new());
    let n_frames = 1500;
    Trip { n_frames, ..Trip::SECOND }.write(&robot.path("long.mcap"));
    let service = robot.serve();
    let (near, far) = (start_near(&network, &robot), start_far(&network, &other));
    near.await_err(&format!("kinds: another machine reads {SENSOR}"));
    let mut consumer = robot.join();
    let elsewhere = collect(&other, n_frames as u64 - 1);
    let mut shim = robot.publish("long.mcap", "10");
    other.join().await_reports(50);
    network.cut();
    let lost = format!("kinds: the link to the robot's end at tcp/{ROBOT}:{PORT} is lost");
    consumer.await_that(|| n_said(&far, &lost) == 1);
    let nobody = format!("kinds: no other machine reads {SENSOR} any more");
    consumer.await_that(|| n_said(&near, &nobody) == 1);
    let missed_from_ns = monotonic_ns();
    // The robot's own programs have all reports meanwhile.
    let n_before = consumer.await_that(|| true);
    consumer.await_reports(n_before + 100);
    network.mend();
    let back = format!("kinds: the link to the robot's end at tcp/{ROBOT}:{PORT} is back");
    consumer.await_that(|| n_said(&far, &back) == 1);
    let back_ns = monotonic_ns();
    consumer.await_that(|| shim.has_ended());
    let reports = consumer.await_frame(n_frames as u64 - 1).to_vec();
    assert_eq!(
        reports.iter().map(|report| report.sequence).collect::<Vec<_>>(),
        Vec::from_iter(0..n_frames as u64)
    );
    let told = service.stop(Signal::TERM);
    assert!(told.ends_with("0 refused; 0 lost\n"), "{told}");

    let missing = missing(&reports, &elsewhere.join().unwrap());
    // What was on its way when the wire was cut, and then the oldest of what waited.
    assert!(
        missing.is_empty() || missing.len() as u64 == missing[missing.len() - 1] - missing[0] + 1,
        "{missing:?}"
    );
    let three_seconds_before_ns = back_ns - 3_000_000_000;
    for sequence in missing {
        let reported_ns = reports[sequence as usize].reported_monotonic_ns;
        assert!(
            reported_ns < missed_from_ns.max(three_seconds_before_ns),
            "a report came no more than three seconds before the wire was mended, and is lost"
        );
    }
    for (program, words) in [(&far, &lost), (&far, &back), (&near, &nobody)] {
        assert_eq!(n_said(program, words), 1, "{words}: {:?}", program.err());
    }
    near.stop(Signal::TERM);
    far.stop(Signal::TERM);
}

/// Listens in place of a robot's end, and brings whoever connects what that sends, slowly. Returns where. Ends with the test.
fn slow_way_to(endpoint: &str) -> String {
    // 50 kB a second: some 35 reports.
    const N_BYTES: usize = 512;
    const PAUSE: Duration = Duration::from_millis(10);
    let listener = TcpListener::bind("127.0.0.1:0").unwrap();
    let address = format!("tcp/{}", listener.local_addr().unwrap());
    let robot = endpoint.strip_prefix("tcp/").unwrap().to_string();
    std::thread::spawn(move || {
        let (mut other, _) = listener.accept().unwrap();
        let mut near = TcpStream::connect(robot).unwrap();
        let (mut from_other, mut to_near) = (other.try_clone().unwrap(), near.try_clone().unwrap());
        std::thread::spawn(move || std::io::copy(&mut from_other, &mut to_near));
        let mut bytes = [0; N_BYTES];
        while let Ok(n_bytes @ 1..) = near.read(&mut bytes) {
            if other.write_all(&bytes[..n_bytes]).is_err() {
                break;
            }
            std::thread::sleep(PAUSE);
        }
        let _ = other.shutdown(Shutdown::Both);
    });
    address
}

#[test]
fn a_link_that_is_too_slow_loses_the_oldest_and_the_robot_does_not_wait_for_it() {
    let (robot, other, endpoint) = (Robot::trained(), Robot::new(), free_endpoint());
    let n_frames = 1000;
    Trip { n_frames, ..Trip::SECOND }.write(&robot.path("long.mcap"));
    let service = robot.serve();
    let near = robot.start(&["bridge", "--sensor", SENSOR, "--listen", &endpoint]);
    near.await_out("sending");
    let slow_way = slow_way_to(&endpoint);
    let far = other.start(&["bridge", "--sensor", SENSOR, "--connect", &slow_way]);
    near.await_err(&format!("kinds: another machine reads {SENSOR}"));
    let mut consumer = robot.join();
    let elsewhere = collect(&other, n_frames as u64 - 1);
    // 100 frames a second.
    let mut shim = robot.publish("long.mcap", "10");
    consumer.await_that(|| shim.has_ended());
    let reports = consumer.await_frame(n_frames as u64 - 1).to_vec();
    assert_eq!(reports.len(), n_frames);
    let told = service.stop(Signal::TERM);
    assert!(told.ends_with("0 refused; 0 lost\n"), "{told}");
    // However many are lost, the last one comes.
    let missing = missing(&reports, &elsewhere.join().unwrap());
    assert!(!missing.is_empty());
    let left_out =
        format!("kinds: the link takes fewer reports of {SENSOR} than there are; the oldest are left out");
    assert_eq!(n_said(&near, &left_out), 1, "{:?}", near.err());
    // Perhaps more than once: a hundred in a row come, when the system makes room for so many.
    far.await_err(&format!("kinds: {SENSOR}: reports are lost on the way: "));
    near.stop(Signal::TERM);
    let told = far.stop(Signal::TERM);
    let summary = format!("; {} were lost on the way, 0 were refused\n", missing.len());
    assert!(told.ends_with(&summary), "{told}");
}

/// An address of this machine at which nobody listens.
fn free_endpoint() -> String {
    format!("tcp/{}", TcpListener::bind("127.0.0.1:0").unwrap().local_addr().unwrap())
}

#[test]
fn either_end_may_be_killed_and_come_back() {
    let (robot, other, endpoint) = (Robot::new(), Robot::new(), free_endpoint());
    let service = ReportPublisher::create(&robot.node(), &SENSOR.parse().unwrap()).unwrap();
    let near = || robot.start(&["bridge", "--sensor", SENSOR, "--listen", &endpoint]);
    let far = || other.start(&["bridge", "--sensor", SENSOR, "--connect", &endpoint]);
    let mut elsewhere = other.join();
    let mut sequence = 0;
    // Reports are sent until one comes: one that is sent before the far end is there again is only the last one, at most.
    let mut comes = || {
        let before = sequence;
        await_that(|| {
            sequence += 1;
            let mut report = KindReport::default();
            (report.run, report.sequence) = (1, sequence);
            service.send(&report).unwrap();
            elsewhere.take_one().is_some_and(|report| report.sequence > before)
        });
    };
    let (mut first, mut second) = (near(), far());
    comes();
    for _ in 0..2 {
        second.kill();
        first.await_err(&format!("kinds: no other machine reads {SENSOR} any more"));
        second = far();
        comes();
        first.kill();
        second
            .await_err(&format!("kinds: the link to the robot's end at {endpoint} is lost; waiting for it"));
        first = near();
        second.await_err(&format!("kinds: the link to the robot's end at {endpoint} is back"));
        comes();
    }
    first.stop(Signal::TERM);
    second.stop(Signal::INT);
    drop(elsewhere);
    drop(service);
    assert_eq!((robot.shared_memory(), other.shared_memory()), (vec![], vec![]));
}

#[test]
fn a_wire_that_takes_nothing_keeps_no_end_from_ending() {
    let Some(network) = Network::make() else { return };
    let (robot, other) = (Robot::new(), Robot::new());
    let service = ReportPublisher::create(&robot.node(), &SENSOR.parse().unwrap()).unwrap();
    let (near, far) = (start_near(&network, &robot), start_far(&network, &other));
    near.await_err(&format!("kinds: another machine reads {SENSOR}"));
    network.cut();
    service.send(&KindReport::default()).unwrap();
    let start = Instant::now();
    near.stop(Signal::TERM);
    far.stop(Signal::TERM);
    // Printed, not asserted: no test judges time. The library alone would take ten seconds.
    eprintln!("both ends ended {} ms after they were told to", start.elapsed().as_millis());
}

#[test]
fn a_doctor_on_another_machine_finds_nothing_wrong() {
    let (other, endpoint) = (Robot::new(), free_endpoint());
    let far = other.start(&["bridge", "--sensor", SENSOR, "--connect", &endpoint]);
    far.await_out("passing on");
    let told = other.succeed(&["doctor", "--sensor", SENSOR]);
    let frames =
        told.lines().find(|line| line.starts_with("well   frames ")).unwrap_or_else(|| panic!("{told}"));
    assert!(frames.contains("those of crunch/ring stay on the machine that kinds-bridge (pid "), "{frames}");
    far.stop(Signal::TERM);
}

#[test]
fn what_cannot_be_bridged_is_a_sentence() {
    let (robot, endpoint) = (Robot::new(), free_endpoint());
    let bridge = ["bridge", "--sensor", SENSOR];
    let refuse = |arguments: &[&str], code, sentence: &str| {
        robot.refuse(&[&bridge[..], arguments].concat(), code, sentence);
    };
    let listener = robot.start(&["bridge", "--sensor", SENSOR, "--listen", &endpoint]);
    listener.await_out("sending");
    refuse(
        &["--listen", &endpoint],
        1,
        &format!("cannot listen at {endpoint}: Address already in use (os error 98)"),
    );
    let service = ReportPublisher::create(&robot.node(), &SENSOR.parse().unwrap()).unwrap();
    refuse(
        &["--connect", &endpoint],
        1,
        "sensor crunch/ring is already served by another service; stop that one first, or serve another sensor name",
    );
    drop(service);
    for (text, sentence) in [
        (
            "Bridge(sensor: \"crunch/ring\")",
            "say which end of the bridge this is: with listen on the robot, or connect on another machine",
        ),
        (
            "Bridge(sensor: \"crunch/ring\", listen: \"tcp/0.0.0.0:1\", connect: \"tcp/robot:1\")",
            "listen is tcp/0.0.0.0:1 and connect is tcp/robot:1: an end of a bridge does one of the two; leave out connect on the \
             robot, and listen on another machine",
        ),
    ] {
        robot.write("bridge.ron", text);
        robot.refuse(&["bridge", "--config", "bridge.ron"], 2, sentence);
    }
    robot.refuse_with(
        &[&bridge[..], &["--listen", "robot:7447"]].concat(),
        2,
        &["is no place for the ends of a bridge to meet"],
    );
}

/// The commands that a page gives for one of two machines.
fn commands(page: &str, prompt: &str) -> Vec<String> {
    let page = std::fs::read_to_string(Path::new(env!("CARGO_MANIFEST_DIR")).join(page)).unwrap();
    page.lines().filter_map(|line| line.strip_prefix(prompt)).map(str::to_string).collect()
}

#[test]
fn the_pages_commands_do_what_it_says() {
    let Some(network) = Network::make() else { return };
    let (robot, other) = (Robot::trained(), Robot::new());
    let service = robot.serve();
    let shim = robot.publish(SECOND, "1");
    let start = |host, on: &Robot, command: &str| {
        let command = command.replace("crunch.local", &ROBOT.to_string());
        let words: Vec<&str> =
            command.strip_prefix("kinds ").unwrap().split(' ').filter(|word| *word != "&").collect();
        network.start(host, on, &words)
    };
    let [near] = &commands("docs/another-machine.md", "robot$ ")[..] else {
        panic!("one command on the robot")
    };
    let [far, watch] = &commands("docs/another-machine.md", "laptop$ ")[..] else {
        panic!("two commands elsewhere")
    };
    let (near, far) = (start(Host::Robot, &robot, near), start(Host::Other, &other, far));
    let outcome = start(Host::Other, &other, watch).end();
    assert_eq!((outcome.code, outcome.stdout.lines().count()), (Some(0), 5), "{outcome:?}");
    assert!(outcome.stdout.lines().all(|line| line.starts_with("frame ")), "{outcome:?}");
    // Elsewhere `top` knows what the bridge passes on, and that it does; on the robot all that the service says.
    let line: Value = serde_json::from_str(&other.succeed(&["top", "--once", "--json"])).unwrap();
    let seen = &line["sensors"][0];
    let (passed_on, rate_hz) = (&seen["elsewhere"], seen["elsewhere"]["rate_hz"].as_f64().unwrap());
    assert!(seen["health"].is_null() && rate_hz > 0.0 && passed_on["kind"].is_u64(), "{line}");
    let text = other.succeed(&["top", "--once"]);
    assert!(text.contains(" %         –         –       –       –\n"), "{text}");
    assert!(
        text.contains("  served on another machine: a bridge passes on its kinds; its health stays there\n")
    );
    let line: Value = serde_json::from_str(&robot.succeed(&["top", "--once", "--json"])).unwrap();
    let seen = &line["sensors"][0];
    assert!(seen["elsewhere"].is_null() && seen["health"]["rate_hz"].is_f64(), "{line}");
    assert_eq!(seen["health"]["model"], passed_on["model"]);
    near.stop(Signal::TERM);
    far.stop(Signal::TERM);
    drop(shim);
    service.stop(Signal::TERM);
}
