//! What may go wrong on a robot, made to happen: programs killed, stopped and slow, a clock that steps, frames that are
//! spoilt on their way.

#![allow(clippy::print_stderr, reason = "a test says how long it took, and does not judge it")]

use std::path::Path;

use kinds_messages::{Command, FRAME_BUFFER, FrameHeader, FramePublisher, KindReport, Pose};
use kinds_model::SensorLayout;
use rand::RngExt;
use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::SeedableRng;
use rustix::process::Signal;

use crate::ordeal::{Ordeal, PROGRAMS, Program, RECORDED, recordings};
use crate::robot::{MODEL, Robot, SECOND, SENSOR};
use crate::running::await_that;
use crate::world::{Trip, open_model, read_trip};

#[test]
fn a_hundred_kills_in_any_order_lose_nothing_once_all_are_up_again_and_leave_nothing() {
    let robot = Robot::crunch();
    let mut ordeal = Ordeal::begin(&robot, "5", 7);
    let before = ordeal.remains();
    let check = |ordeal: &mut Ordeal| {
        ordeal.check_all_is_well();
        // A recorder that is killed before it has a file leaves none.
        let n_killed = ordeal.kills_ns[Program::Recorder as usize].len();
        await_that(|| recordings(&robot).len() == n_killed + 1);
    };
    for round in 0..25 {
        let order = ordeal.shuffled();
        // One after the other, each back before the next goes; or all at once, back in another order.
        if round % 2 == 0 {
            for program in order {
                ordeal.pause(20);
                ordeal.kill(program);
                ordeal.pause(20);
                ordeal.start(program);
                check(&mut ordeal);
            }
        } else {
            for program in order {
                ordeal.pause(10);
                ordeal.kill(program);
            }
            for program in ordeal.shuffled() {
                ordeal.pause(10);
                ordeal.start(program);
            }
            check(&mut ordeal);
        }
    }
    assert_eq!(ordeal.kills_ns.each_ref().map(Vec::len), [25; PROGRAMS.len()]);
    eprintln!("all were well again within {:?} of the last start, at the slowest", ordeal.longest_return);
    // Who was killed last is cleaned up after by those who live, every few seconds.
    let has_not_grown = || {
        let after = ordeal.remains();
        after.0 <= before.0 && after.1 <= before.1 && after.2 <= before.2
    };
    await_that(has_not_grown);
    let ledger = ordeal.ledger();
    assert_eq!(ledger.reported_twice(), []);
    let [served, recorded] = ordeal.end();
    assert!(served.contains(" 0 invalid, 0 repeated, 0 refused; 0 lost"), "{served}");
    // The last recorder's trip is whole. Of each that was killed there is what it had written.
    assert!(recorded.contains(" into recorded.mcap; 0 frames lost"), "{recorded}");
    assert!(!read_trip(&robot.path(RECORDED)).is_empty());
    assert_eq!(recordings(&robot).len(), 25);
    assert_eq!(robot.shared_memory(), [""; 0]);
}

#[test]
fn what_is_left_of_a_program_whose_remover_was_killed_at_it_is_removed_by_the_next() {
    let robot = Robot::new();
    let members = robot.domain().root.join("nodes");
    let watch = || {
        let watch = robot.start(&["watch", "--sensor", SENSOR]);
        watch.await_err("kinds: waiting for a service for crunch/ring");
        watch
    };
    watch().kill();
    // The first thing that a remover removes.
    let mut n_details = 0;
    for member in std::fs::read_dir(&members).unwrap().map(|entry| entry.unwrap().path()) {
        let files = std::fs::read_dir(member).into_iter().flatten().map(|entry| entry.unwrap().path());
        for details in files.filter(|file| file.to_string_lossy().ends_with("node.details")) {
            std::fs::remove_file(details).unwrap();
            n_details += 1;
        }
    }
    assert_eq!(n_details, 1);
    watch().stop(Signal::TERM);
    assert_eq!(std::fs::read_dir(&members).unwrap().count(), 0, "nobody is a member, or seems to be");
    assert_eq!(robot.shared_memory(), [""; 0]);
}

#[test]
fn a_service_that_stands_still_loses_the_oldest_frames_and_says_how_many() {
    let robot = Robot::trained();
    Trip { n_frames: 300, ..Trip::SECOND }.write(&robot.path("long.mcap"));
    let mut consumer = robot.join();
    let service = robot.serve();
    let shim = robot.publish("long.mcap", "20");
    consumer.await_reports(5);
    service.freeze();
    // The extreme of a sensor that is too fast: frames come, none is taken. It waits for nobody.
    assert_eq!(shim.end().code, Some(0));
    service.signal(Signal::CONT);
    let reports = consumer.await_frame(299).to_vec();
    assert!(reports.is_sorted_by(|a, b| a.sequence < b.sequence));
    let n_lost: u64 = reports.iter().map(|report| report.n_lost).sum();
    assert_eq!(n_lost + reports.len() as u64, 300);
    // The newest are those that are left.
    let newest = &reports[reports.len() - FRAME_BUFFER..];
    assert_eq!(newest[0].sequence, 300 - FRAME_BUFFER as u64);
    assert!(newest[0].n_lost > 0 && newest[1..].iter().all(|report| report.n_lost == 0));
    let told = service.stop(Signal::TERM);
    assert!(told.ends_with(&format!("; {n_lost} lost\n")), "{told}");
}

#[test]
fn of_a_sensor_that_is_too_fast_the_newest_frames_win_and_those_lost_are_counted() {
    let robot = Robot::new();
    let replay = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/replay");
    std::fs::copy(replay.join("camera.kinds"), robot.path(MODEL)).unwrap();
    let frames = read_trip(&replay.join("camera2.mcap"));
    let SensorLayout { rows, columns, metres_per_count } = open_model(&robot.path(MODEL)).layout();
    let service = robot.serve();
    let mut consumer = robot.join();
    // A camera that waits for nothing and nobody: to hand over a frame takes a small part of what it takes to classify it.
    let camera = FramePublisher::create(&robot.node(), &SENSOR.parse().unwrap(), frames[0].1.len()).unwrap();
    let (mut n_sent, mut reports) = (0_u64, Vec::new());
    let n_lost = |reports: &[KindReport]| reports.iter().map(|report| report.n_lost).sum::<u64>();
    await_that(|| {
        for (_, counts) in &frames {
            let mut loan = camera.loan().unwrap();
            loan.counts_mut().copy_from_slice(counts);
            let header = FrameHeader { run: 1, sequence: n_sent, rows, columns, ..FrameHeader::default() };
            loan.send(&FrameHeader { metres_per_count, ..header }).unwrap();
            n_sent += 1;
            reports.extend(consumer.take_one());
        }
        n_lost(&reports) >= 1000
    });
    await_that(|| {
        reports.extend(consumer.take_one());
        reports.last().is_some_and(|report| report.sequence + 1 == n_sent)
    });
    assert!(reports.is_sorted_by(|a, b| a.sequence < b.sequence));
    assert_eq!(reports.len() as u64 + n_lost(&reports), n_sent);
    let told = service.stop(Signal::TERM);
    let n_classified = reports.len();
    let expected = format!(
        "served {n_classified} frames: {n_classified} classified, 0 invalid, 0 repeated, 0 refused; {} lost\n",
        n_lost(&reports)
    );
    assert!(told.ends_with(&expected), "{told}, not {expected}");
}

#[test]
fn a_shim_that_stands_still_goes_on_with_the_next_frame() {
    let robot = Robot::trained();
    let mut consumer = robot.join();
    let service = robot.serve();
    let shim = robot.publish(SECOND, "1");
    let n_before = consumer.await_reports(3).len();
    shim.freeze();
    shim.signal(Signal::CONT);
    let reports = consumer.await_reports(n_before + 3);
    let ids: Vec<_> = reports.iter().map(|report| (report.run, report.sequence, report.n_lost)).collect();
    let expected: Vec<_> = (0..ids.len() as u64).map(|sequence| (ids[0].0, sequence, 0)).collect();
    assert_eq!(ids, expected);
    shim.stop(Signal::TERM);
    service.stop(Signal::TERM);
}

#[test]
fn a_consumer_that_stands_still_is_noticed_by_nobody_and_says_how_many_reports_it_lost() {
    let robot = Robot::trained();
    let n_frames = 600;
    Trip { n_frames, ..Trip::SECOND }.write(&robot.path("long.mcap"));
    let watch = robot.start(&["watch", "--sensor", SENSOR, "--json"]);
    // Of a service that is there already it would say nothing.
    watch.await_err("kinds: waiting for a service");
    let service = robot.serve();
    watch.await_err("kinds: a service for crunch/ring is there");
    let publish = ["publish", "--trip", "long.mcap", "--sensor", SENSOR, "--speed", "20", "--follow"];
    let shim = robot.start(&publish);
    watch.await_out("{\"sequence\":0,");
    watch.freeze();
    // Followed: had the service waited for the consumer, the shim would not have come to its end.
    assert_eq!(shim.end().code, Some(0));
    watch.signal(Signal::CONT);
    watch.await_out("{\"sequence\":599,");
    // Said before that line, but on another stream.
    let lost = || watch.err().into_iter().find(|line| line.contains(" reports lost: "));
    await_that(|| lost().is_some());
    let lost = lost().unwrap();
    let n_lost: usize = lost.split(' ').nth(1).unwrap().parse().unwrap();
    assert_eq!(watch.stop(Signal::TERM).lines().count() + n_lost, n_frames);
    assert!(service.stop(Signal::TERM).contains("served 600 frames: 600 classified"));
}

#[test]
fn a_consumer_ten_times_too_slow_loses_the_oldest_reports_and_can_tell_how_many() {
    let robot = Robot::trained();
    let n_frames = 1500;
    Trip { n_frames, ..Trip::SECOND }.write(&robot.path("long.mcap"));
    let service = robot.serve();
    let (mut consumer, frames) = (robot.join(), robot.join_frames());
    let mut shim = robot.publish("long.mcap", "max");
    let mut reports = Vec::new();
    let mut n_sent = 0;
    await_that(|| {
        let has_ended = shim.has_ended();
        while let Some(frame) = frames.receive().unwrap() {
            n_sent = frame.header().sequence + 1;
        }
        while (reports.len() as u64) < n_sent / 10 {
            reports.extend(consumer.take_one());
        }
        has_ended
    });
    reports.extend(std::iter::from_fn(|| consumer.take_one()));
    let gaps = reports.windows(2).map(|pair| pair[1].sequence - pair[0].sequence - 1);
    let n_lost: u64 = gaps.sum::<u64>() + reports[0].sequence;
    assert_eq!(reports.len() as u64 + n_lost, n_frames as u64);
    assert!(n_lost > 1000, "{n_lost} lost");
    // Nobody else noticed.
    assert!(service.stop(Signal::TERM).contains("served 1500 frames: 1500 classified"));
}

#[test]
fn a_clock_that_steps_changes_no_order() {
    let robot = Robot::trained();
    let service = robot.serve();
    let mut consumer = robot.join();
    let (node, sensor) = (robot.node(), SENSOR.parse().unwrap());
    let noon_ns = 1_750_000_000_000_000_000;
    const HOUR_NS: i64 = 3_600_000_000_000;
    // Set back an hour in the middle of a run, and ahead again; then a run that began before the last one did.
    let frames = [
        (noon_ns, [noon_ns, noon_ns + 1, noon_ns - HOUR_NS, noon_ns - HOUR_NS + 1, noon_ns + HOUR_NS]),
        (noon_ns - HOUR_NS, [0, -HOUR_NS, HOUR_NS, i64::MIN, i64::MAX]),
    ];
    let mut expected = Vec::new();
    for (run, captured) in frames {
        let shim = FramePublisher::create(&node, &sensor, 16).unwrap();
        for (captured_ns, sequence) in captured.into_iter().zip(0..) {
            let (run, metres_per_count) = (run as u64, 0.001);
            let header =
                FrameHeader { run, sequence, captured_ns, metres_per_count, ..FrameHeader::default() };
            let mut loan = shim.loan().unwrap();
            loan.counts_mut().fill(1500);
            loan.send(&FrameHeader { rows: 1, columns: 16, ..header }).unwrap();
            expected.push((run, sequence, captured_ns, 0));
            consumer.await_reports(expected.len());
        }
    }
    let reports = consumer.await_reports(expected.len());
    let found: Vec<_> = reports
        .iter()
        .map(|report| (report.run, report.sequence, report.captured_ns, report.n_lost))
        .collect();
    assert_eq!(found, expected);
    assert!(reports.is_sorted_by_key(|report| report.reported_monotonic_ns));
    let told = service.stop(Signal::TERM);
    assert!(
        told.ends_with("served 10 frames: 10 classified, 0 invalid, 0 repeated, 0 refused; 0 lost\n"),
        "{told}"
    );
}

#[test]
fn frames_whose_headers_are_made_by_chance_end_no_service() {
    let robot = Robot::trained();
    let service = robot.serve();
    let mut consumer = robot.join();
    let shim = FramePublisher::create(&robot.node(), &SENSOR.parse().unwrap(), 16).unwrap();
    let whole =
        FrameHeader { run: 1, rows: 1, columns: 16, metres_per_count: 0.001, ..FrameHeader::default() };
    let mut random = ChaCha8Rng::seed_from_u64(5);
    for round in 0..300_u64 {
        // Any value at all, or one that is nearly right.
        let mut number = |right: u64| match random.random_range(0..4) {
            0 => random.random::<u64>(),
            1 => u64::MAX,
            _ => right,
        };
        let flags = number(0) as u32;
        let [x_m, forward_m_s] = [0, 0].map(|right| f64::from_bits(number(right)));
        let header = FrameHeader {
            version: number(1) as u32,
            flags,
            run: number(1000 + round),
            sequence: number(0),
            captured_ns: number(round) as i64,
            metres_per_count: f64::from_bits(number(0.001_f64.to_bits())),
            rows: number(1) as u32,
            columns: number(16) as u32,
            pose: Pose { x_m, ..Pose::default() },
            command: Command { forward_m_s, ..Command::default() },
            ..whole
        };
        let n_readings = 16 - (number(0) % 16) as usize;
        shim.loan().unwrap().send_first(n_readings, &header).unwrap();
        // One that is right, and is reported: so nothing that was sent is left out for want of time.
        shim.loan().unwrap().send(&FrameHeader { sequence: 0, run: u64::MAX - 1 - round, ..whole }).unwrap();
        let is_right = |report: &KindReport| report.run == u64::MAX - 1 - round;
        await_that(|| consumer.take_one().is_some_and(|report| is_right(&report)));
    }
    let told = service.stop(Signal::TERM);
    let [n_frames, .., n_refused, _] = numbers(told.lines().last().unwrap())[..] else { panic!("{told}") };
    assert!(n_frames == 600 && n_refused > 0, "{told}");
}

const FAULTS: &str = "(\n    seed: 3, drop: 0.05, repeat: 0.06, reorder: 0.07, delay: 0.02, delay_ms: 5,\n    \
                      flip_bit: 0.05, invalid: 0.04, wrong_length: 0.03,\n)";

fn numbers(line: &str) -> Vec<u64> {
    line.split(|c: char| !c.is_ascii_digit()).filter_map(|digits| digits.parse().ok()).collect()
}

#[test]
fn a_service_counts_the_faults_that_were_injected() {
    let robot = Robot::trained();
    Trip { n_frames: 400, ..Trip::SECOND }.write(&robot.path("long.mcap"));
    robot.write("faults.ron", FAULTS);
    let consumer = robot.join();
    let service = robot.serve();
    let publish = ["publish", "--trip", "long.mcap", "--sensor", SENSOR, "--speed", "max"];
    let mut shim = robot.start(&[&publish[..], &["--faults", "faults.ron"]].concat());
    let reports = consumer.await_end_of(&mut shim);
    let outcome = shim.end();
    let told = outcome.stderr.lines().last().unwrap();
    assert!(told.starts_with("kinds: faults were injected into 400 frames: "), "{outcome:?}");
    let [n, n_dropped, n_repeated, n_reordered, n_delayed, n_flipped, n_invalid, n_short] = numbers(told)[..]
    else {
        panic!("{told}")
    };
    assert!(
        [n_dropped, n_repeated, n_reordered, n_delayed, n_flipped, n_invalid, n_short].iter().all(|&n| n > 0)
    );
    let served = service.stop(Signal::TERM);
    let counts = numbers(served.lines().last().unwrap());
    // Frames after the last that was reported: nobody has seen that they are missing.
    let n_after = n - (reports.iter().map(|report| report.sequence).max().unwrap() + 1);
    let n_missed = n_dropped + n_short + n_reordered - n_after;
    let expected = [
        n - n_dropped + n_repeated,
        n - n_after - n_missed - n_invalid,
        n_invalid,
        n_repeated + n_reordered,
        n_short,
        n_missed,
    ];
    assert_eq!(counts, expected, "{told}; {served}");
    assert!(outcome.stdout.starts_with(&format!("published {} frames ", n - n_dropped + n_repeated)));
    let n_lost: u64 = reports.iter().map(|report| report.n_lost).sum();
    assert_eq!((reports.len() as u64, n_lost), (n - n_after - n_missed, n_missed));
}

#[test]
fn faults_befall_a_simulated_robot_too_and_files_of_faults_are_refused_with_their_line() {
    let robot = Robot::new();
    robot.write("faults.ron", "(drop: 0.5)");
    let simulate = ["publish", "--simulate", "crunch", "--sensor", SENSOR, "--speed", "100", "--faults"];
    let frames = robot.join_frames();
    let shim = robot.start(&[&simulate[..], &["faults.ron"]].concat());
    await_that(|| frames.receive().unwrap().is_some_and(|frame| frame.header().sequence > 20));
    shim.signal(Signal::TERM);
    let outcome = shim.end();
    let told = numbers(outcome.stderr.lines().last().unwrap());
    assert!(outcome.code == Some(0) && told[0] > 20 && told[1] > 0, "{outcome:?}");

    robot.write("unknown.ron", "(\n    drop: 0.1,\n    dorp: 0.1,\n)");
    robot.refuse_with(
        &[&simulate[..], &["unknown.ron"]].concat(),
        2,
        &["faults unknown.ron: line 3, column ", "dorp"],
    );
    robot.write("much.ron", "(drop: 2)");
    robot.refuse(
        &[&simulate[..], &["much.ron"]].concat(),
        2,
        "faults much.ron: drop is 2; it must be between 0 and 1",
    );
    robot.refuse(
        &[&simulate[..], &["nowhere.ron"]].concat(),
        1,
        "cannot read faults nowhere.ron: there is no such file or folder",
    );
}
