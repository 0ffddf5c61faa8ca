//! `kinds record`: what went through shared memory is a trip again.

#![allow(clippy::print_stderr, reason = "a test that is skipped says so")]

use std::fs::File;
use std::os::unix::net::UnixDatagram;
use std::path::{Path, PathBuf};
use std::process::Command;

use kinds_driver_shim::simulated::{Crunch, Floor, Robot as _};
use kinds_messages::HealthReader;
use kinds_trips::{FrameInfo, Selection, salvage};
use rustix::fs::{FallocateFlags, fallocate, statvfs};
use rustix::process::Signal;

use crate::novelty::send_with_novel;
use crate::robot::{MODEL, Robot, SECOND, SENSOR};
use crate::running::{DEADLINE, Running, await_that};
use crate::world::{Trip, read_trip, read_trip_by, read_trip_with, told_along_the_loop};

const RECORDED: &str = "recorded.mcap";

/// Starts a recorder, and waits until it would take a frame.
fn record(robot: &Robot, more: &[&str]) -> Running {
    let recorder = robot.start(&[&["record", "--sensor", SENSOR, "--output", RECORDED], more].concat());
    recorder.await_err("kinds: waiting for a driver shim to publish crunch/ring");
    recorder
}

#[test]
fn a_recorded_replay_has_the_frames_poses_and_commands_of_its_trip_and_a_report_on_each() {
    let robot = Robot::trained();
    let n_frames = 40;
    Trip { n_frames, command: told_along_the_loop, ..Trip::SECOND }.write(&robot.path("short.mcap"));
    let service = robot.serve();
    let recorder = record(&robot, &["--count", "40"]);
    // Paced replay waits for nobody: slow enough for a recorder that has to share its processor with other tests.
    let shim = robot.publish("short.mcap", "5");
    let outcome = recorder.end();
    assert_eq!(
        outcome.stdout, "recorded 40 frames and 40 reports into recorded.mcap; 0 frames lost\n",
        "{outcome:?}"
    );
    assert_eq!(shim.end().code, Some(0));
    service.stop(Signal::TERM);
    let (expected, found) = (read_trip(&robot.path("short.mcap")), read_trip(&robot.path(RECORDED)));
    assert_eq!(found.len(), n_frames);
    let n_told = found.iter().filter(|(frame, _)| frame.command.is_some()).count();
    // Of the 40 frames twice around, the first two come before the first command.
    assert_eq!(n_told, n_frames - 2);
    for ((expected, expected_counts), (found, found_counts)) in expected.iter().zip(&found) {
        assert_eq!(found_counts, expected_counts);
        assert_eq!(found.captured, expected.captured);
        assert_eq!(found.command, expected.command);
        let (expected, found) = (expected.pose.unwrap(), found.pose.unwrap());
        // Through a quaternion and back.
        let error = (expected.x_m - found.x_m).abs().max((expected.yaw_rad - found.yaw_rad).abs());
        assert!(error < 1e-12, "{found:?} instead of {expected:?}");
    }
}

#[test]
fn a_signal_completes_the_trip_that_is_being_recorded() {
    let robot = Robot::new();
    let recorder = record(&robot, &[]);
    let shim = robot.start(&["publish", "--simulate", "crunch", "--sensor", SENSOR, "--speed", "5"]);
    let frames = robot.join_frames();
    await_that(|| frames.receive().unwrap().is_some_and(|frame| frame.header().sequence >= 5));
    drop(frames);
    let said = recorder.stop(Signal::TERM);
    assert!(said.ends_with(" into recorded.mcap; 0 frames lost\n"), "{said}");
    shim.stop(Signal::TERM);
    let mut crunch = Crunch::new(Floor::Fourth, 1, 0);
    let mut expected = vec![0; crunch.layout().n_readings()];
    let [believed, true_poses] =
        [None, Some("/ground_truth")].map(|topic| read_trip_by(&robot.path(RECORDED), topic));
    assert!(believed.len() > 5);
    for ((by_odometry, counts), (by_truth, _)) in believed.into_iter().zip(true_poses) {
        let moment = crunch.step(&mut expected).unwrap();
        assert_eq!((by_odometry.captured, counts), (moment.captured, expected.clone()));
        let command = by_odometry.command.map(|command| (command.forward_m_s, command.turn_rad_s));
        assert_eq!(command, Some((moment.command.forward_m_s, moment.command.turn_rad_s)));
        for (found, expected) in [(by_odometry, moment.odometry), (by_truth, moment.true_pose)] {
            let found = found.pose.unwrap();
            assert_eq!((found.x_m, found.y_m), (expected.x_m, expected.y_m));
        }
    }
}

#[test]
fn a_service_that_does_not_report_does_not_keep_a_recording_from_its_end() {
    let robot = Robot::trained();
    Trip { n_readings: 8, n_frames: 20, ..Trip::SECOND }.write(&robot.path("eight.mcap"));
    // It understands 16 readings, and refuses these.
    let service = robot.serve();
    let recorder = record(&robot, &["--count", "20"]);
    let shim = robot.publish("eight.mcap", "5");
    let outcome = recorder.end();
    assert_eq!(
        outcome.stdout, "recorded 20 frames and 0 reports into recorded.mcap; 0 frames lost\n",
        "{outcome:?}"
    );
    shim.stop(Signal::TERM);
    service.stop(Signal::TERM);
}

#[test]
fn what_cannot_be_recorded_is_a_sentence_and_leaves_no_file() {
    let robot = Robot::trained();
    let record = ["record", "--sensor", SENSOR, "--output"];
    robot.refuse(
        &[&record[..], &[SECOND]].concat(),
        1,
        "cannot record into second.mcap: it is there already; choose another name",
    );
    robot.refuse_with(&[&record[..], &["nowhere/trip.mcap"]].concat(), 1, &["nowhere/trip.mcap"]);
    let before = robot.files();
    let recorder = self::record(&robot, &[]);
    recorder.signal(Signal::INT);
    let outcome = recorder.end();
    assert_eq!(outcome.code, Some(1));
    assert!(
        outcome.stderr.ends_with("kinds: no frame came, so recorded.mcap was not written\n"),
        "{outcome:?}"
    );
    assert!(robot.files() == before);
}

#[test]
fn novel_frames_alone_are_recorded_where_that_is_asked_for_and_an_update_takes_them() {
    let robot = Robot::trained();
    let service = robot.serve();
    let mut consumer = robot.join();
    let recorder = record(&robot, &["--novel"]);
    let novel = send_with_novel(&robot, &mut consumer);
    recorder.signal(Signal::TERM);
    let outcome = recorder.end();
    let n_novel = novel.len();
    let said = format!("recorded {n_novel} frames and {n_novel} reports into {RECORDED}; 0 frames lost\n");
    assert_eq!(outcome.stdout, said, "{outcome:?}");
    let kept = read_trip(&robot.path(RECORDED)).into_iter().map(|(frame, counts)| (frame.captured, counts));
    assert_eq!(kept.collect::<Vec<_>>(), novel);
    service.stop(Signal::TERM);
    let table = robot.succeed(&["update", MODEL, RECORDED, "--output", "m2.kinds"]);
    assert!(table.contains("kind  became"), "{table}");

    std::fs::remove_file(robot.path(RECORDED)).unwrap();
    let recorder = record(&robot, &["--novel"]);
    robot.publish(SECOND, "20").end();
    recorder.signal(Signal::TERM);
    let told = recorder.end();
    assert_eq!(told.code, Some(1), "{told:?}");
    let words = "kinds: no frame came that was called novel, so recorded.mcap was not written\n";
    assert!(told.stderr.ends_with(words), "{told:?}");
}

#[test]
fn frames_that_contradict_themselves_are_left_out_of_a_recording_and_end_it_not() {
    let robot = Robot::trained();
    robot.write("faults.ron", "(seed: 3, wrong_length: 0.1)");
    let recorder = record(&robot, &[]);
    let publish =
        ["publish", "--trip", SECOND, "--sensor", SENSOR, "--speed", "20", "--faults", "faults.ron"];
    let shim = robot.start(&publish).end();
    let told = shim.stderr.lines().last().unwrap();
    let n_short: usize = told.rsplit(", ").next().unwrap().split(' ').next().unwrap().parse().unwrap();
    assert!(told.ends_with(" of the wrong length") && n_short > 0, "{told}");
    let n_whole = Trip::SECOND.n_frames - n_short;
    recorder.signal(Signal::TERM);
    let outcome = recorder.end();
    assert_eq!(outcome.code, Some(0), "{outcome:?}");
    assert!(outcome.stdout.starts_with(&format!("recorded {n_whole} frames ")), "{told}; {outcome:?}");
    let said = "kinds: frames that have 15 readings but say 1 × 16";
    assert_eq!(outcome.stderr.matches(said).count(), 1, "{outcome:?}");
    assert_eq!(read_trip(&robot.path(RECORDED)).len(), n_whole);
}

/// What rosbags says of a recording: topics, types, counts; and that kinds are probabilities, and images whole. Nothing
/// where Python has no rosbags.
fn told_by_rosbags(robot: &Robot) -> Option<String> {
    let has_rosbags = Command::new("python3").args(["-c", "import rosbags.highlevel"]).output();
    if !has_rosbags.is_ok_and(|probe| probe.status.success()) {
        eprintln!("skipped: python3 has no package rosbags");
        return None;
    }
    let script = "
import sys
from pathlib import Path
from rosbags.highlevel import AnyReader
from rosbags.typesys import Stores, get_typestore
with AnyReader([Path(sys.argv[1])], default_typestore=get_typestore(Stores.ROS2_HUMBLE)) as bag:
    for connection in sorted(bag.connections, key=lambda connection: connection.topic):
        print(connection.topic, connection.msgtype, connection.msgcount)
    for connection, _, raw in bag.messages():
        message = bag.deserialize(raw, connection.msgtype)
        if connection.topic.endswith('/kinds'):
            assert abs(sum(message.data) - 1) < 1e-9 and message.layout.dim[0].size == len(message.data)
        if connection.topic.endswith('/frames'):
            assert message.encoding == '16UC1' and len(message.data) == 2 * message.height * message.width
        if connection.topic.endswith('/health'):
            status, = message.status
            told = {value.key: value.value for value in status.values}
            assert status.name == 'kinds-serve' and int(told['n_classified']) <= int(told['n_frames']), told
";
    let output = Command::new("python3").args(["-c", script]).arg(robot.path(RECORDED)).output().unwrap();
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    Some(String::from_utf8(output.stdout).unwrap())
}

#[test]
fn rosbags_reads_what_was_recorded() {
    let robot = Robot::trained();
    let service = robot.serve();
    let recorder = record(&robot, &["--count", "20"]);
    let shim = robot.publish(SECOND, "5");
    assert_eq!(recorder.end().code, Some(0));
    shim.stop(Signal::TERM);
    service.stop(Signal::TERM);
    let Some(told) = told_by_rosbags(&robot) else { return };
    // A second of health may have passed, or not.
    let told: Vec<&str> = told.lines().filter(|line| !line.starts_with("/health ")).collect();
    assert_eq!(
        told,
        [
            "/frames sensor_msgs/msg/Image 20",
            "/kinds std_msgs/msg/Float64MultiArray 20",
            "/odom nav_msgs/msg/Odometry 20"
        ]
    );
}

#[test]
fn several_sensors_go_into_one_trip_each_by_its_name_and_with_the_health_of_its_service() {
    let robot = Robot::trained();
    Trip { n_frames: 40, ..Trip::SECOND }.write(&robot.path("short.mcap"));
    Trip { n_readings: 8, n_frames: 20, ..Trip::SECOND }.write(&robot.path("eight.mcap"));
    let service = robot.serve();
    let health = HealthReader::open(&robot.node(), &SENSOR.parse().unwrap()).unwrap();
    let other = "crunch/far-side";
    let recorder = robot.start(&["record", "--sensor", &format!("{SENSOR},{other}"), "--output", RECORDED]);
    recorder.await_err(&format!("kinds: waiting for a driver shim to publish {other}"));
    let shims = [
        robot.publish("short.mcap", "5"),
        robot.start(&["publish", "--trip", "eight.mcap", "--sensor", other, "--speed", "5"]),
    ];
    shims.into_iter().for_each(|shim| assert_eq!(shim.end().code, Some(0)));
    await_that(|| health.receive().unwrap().is_some_and(|health| health.n_frames == 40));
    let said = recorder.stop(Signal::TERM);
    assert_eq!(said, "recorded 60 frames and 40 reports into recorded.mcap; 0 frames lost\n");
    service.stop(Signal::TERM);
    // ROS has no dashes in topics.
    for (namespace, trip) in [("/crunch/ring", "short.mcap"), ("/crunch/far_side", "eight.mcap")] {
        let topic = |name: &str| Some(format!("{namespace}/{name}"));
        let selection =
            Selection { frames_topic: topic("frames"), poses_topic: topic("odom"), ..Selection::default() };
        let (found, expected) =
            (read_trip_with(&robot.path(RECORDED), &selection), read_trip(&robot.path(trip)));
        let frames = |trip: Vec<(FrameInfo, Vec<u16>)>| -> Vec<_> {
            trip.into_iter().map(|(info, counts)| (info.captured, counts)).collect()
        };
        assert_eq!(frames(found), frames(expected));
    }
    let Some(told) = told_by_rosbags(&robot) else { return };
    for line in [
        "/crunch/far_side/frames sensor_msgs/msg/Image 20",
        "/crunch/ring/frames sensor_msgs/msg/Image 40",
        "/crunch/ring/kinds std_msgs/msg/Float64MultiArray 40",
        "/crunch/ring/health diagnostic_msgs/msg/DiagnosticArray ",
    ] {
        assert!(told.lines().any(|told| told.starts_with(line)), "no {line:?} in {told}");
    }
}

#[test]
fn sensors_that_one_trip_cannot_tell_apart_are_refused_in_words() {
    let robot = Robot::new();
    for (sensors, said) in [
        ("a/ring,a/ring", "a/ring is there twice; name each sensor once"),
        ("a/ring,", "has an empty part"),
        (
            "a/ring-1,a/ring_1",
            "a/ring-1 and a/ring_1 would both be /a/ring_1/frames in one trip, where topics have no dots and dashes; \
             record them by themselves",
        ),
    ] {
        robot.refuse_with(&["record", "--sensor", sensors, "--output", RECORDED], 2, &[said]);
    }
    assert!(robot.files().is_empty());
}

#[test]
fn rosbags_reads_the_trips_of_simulated_robots_with_the_truth_beside_odometry() {
    for simulated in ["crunch", "chew"] {
        let robot = Robot::new();
        let recorder = record(&robot, &["--count", "15"]);
        let shim = robot.start(&["publish", "--simulate", simulated, "--sensor", SENSOR, "--speed", "2"]);
        let outcome = recorder.end();
        assert_eq!(
            outcome.stdout, "recorded 15 frames and 0 reports into recorded.mcap; 0 frames lost\n",
            "{outcome:?}"
        );
        shim.stop(Signal::TERM);
        let Some(told) = told_by_rosbags(&robot) else { return };
        assert_eq!(
            told,
            "/cmd_vel geometry_msgs/msg/TwistStamped 15\n/frames sensor_msgs/msg/Image 15\n\
             /ground_truth geometry_msgs/msg/PoseStamped 15\n/odom nav_msgs/msg/Odometry 15\n"
        );
    }
}

const TRIPS: &str = "trips";

/// Starts a recorder into a folder, and waits until it would take a frame.
fn record_into_folder(robot: &Robot, more: &[&str]) -> Running {
    std::fs::create_dir_all(robot.path(TRIPS)).unwrap();
    let recorder = robot.start(&[&["record", "--sensor", SENSOR, "--output", TRIPS], more].concat());
    recorder.await_err("kinds: waiting for a driver shim to publish crunch/ring");
    recorder
}

/// Trips of the sensor in the folder, in the order of their names, and so of their beginnings.
fn trips(robot: &Robot) -> Vec<PathBuf> {
    let entries = std::fs::read_dir(robot.path(TRIPS)).unwrap().map(|entry| entry.unwrap().path());
    let mut trips: Vec<_> =
        entries.filter(|path| path.extension().is_some_and(|end| end == "mcap")).collect();
    // Of two that began in one second the second has a number behind the time.
    trips.sort_by_key(|path| path.with_extension(""));
    trips
}

/// Frames without what of them comes from other topics, whose messages may be in the trip before.
fn frames_of(trips: &[PathBuf]) -> Vec<(i64, Vec<u16>)> {
    let frames = trips.iter().flat_map(|path| read_trip(path));
    frames.map(|(FrameInfo { captured, .. }, counts)| (captured.0, counts)).collect()
}

#[test]
fn trips_follow_each_other_by_time_without_a_gap() {
    let robot = Robot::trained();
    let recorder = record_into_folder(&robot, &["--trip-s-max", "1", "--count", "130"]);
    // Six seconds and a half.
    let shim = robot.publish(SECOND, "2");
    let outcome = recorder.end();
    assert_eq!(outcome.code, Some(0), "{outcome:?}");
    shim.stop(Signal::TERM);
    let trips = trips(&robot);
    assert!(trips.len() >= 2, "{outcome:?}");
    assert_eq!(outcome.stdout.lines().count(), trips.len(), "{outcome:?}");
    for line in outcome.stdout.lines() {
        assert!(line.ends_with(".mcap; 0 frames lost"), "{outcome:?}");
    }
    assert!(frames_of(&trips) == frames_of(&[robot.path(SECOND)]));
}

#[test]
fn trips_follow_each_other_by_size() {
    let robot = Robot::new();
    let recorder = record_into_folder(&robot, &["--trip-mb-max", "1", "--count", "150"]);
    let shim = robot.start(&["publish", "--simulate", "chew", "--sensor", SENSOR, "--speed", "2"]);
    let outcome = recorder.end();
    assert_eq!(outcome.code, Some(0), "{outcome:?}");
    shim.stop(Signal::TERM);
    let trips = trips(&robot);
    let [full @ .., _] = &trips[..] else { panic!("{outcome:?}") };
    assert!(!full.is_empty(), "{outcome:?}");
    for trip in full {
        assert!(trip.metadata().unwrap().len() >= 1_000_000, "{outcome:?}");
    }
    let frames = frames_of(&trips);
    assert_eq!(frames.len(), 150);
    assert!(frames.is_sorted_by(|(before, _), (after, _)| before < after));
}

#[test]
fn only_the_last_trips_are_kept_and_they_are_the_end_of_the_drive() {
    let robot = Robot::trained();
    std::fs::create_dir(robot.path(TRIPS)).unwrap();
    let of_others = ["trips/crunch-rear-2020-01-01T00-00-00Z.mcap", "trips/notes.txt"];
    let of_ours = [
        "trips/crunch-ring-2020-01-01T00-00-00Z.mcap",
        "trips/crunch-ring-2020-01-01T00-00-01Z.mcap.x.partial",
    ];
    of_others.iter().chain(&of_ours).for_each(|name| robot.write(name, "old"));
    let recorder = record_into_folder(&robot, &["--trip-s-max", "1", "--keep", "2", "--count", "130"]);
    let shim = robot.publish(SECOND, "2");
    let outcome = recorder.end();
    assert_eq!(outcome.code, Some(0), "{outcome:?}");
    shim.stop(Signal::TERM);
    assert!(outcome.stdout.lines().count() > 2, "{outcome:?}");
    let ours: Vec<_> = trips(&robot).into_iter().filter(|path| *path != robot.path(of_others[0])).collect();
    assert_eq!(ours.len(), 2);
    let (kept, all) = (frames_of(&ours), frames_of(&[robot.path(SECOND)]));
    assert!(all.ends_with(&kept));
    assert!(of_others.iter().all(|name| robot.path(name).exists()));
    assert!(of_ours.iter().all(|name| !robot.path(name).exists()));
    let n_files = std::fs::read_dir(robot.path(TRIPS)).unwrap().count();
    assert_eq!(n_files, 2 + of_others.len());
}

#[test]
fn limits_that_cannot_be_kept_are_sentences() {
    let robot = Robot::new();
    let record = ["record", "--sensor", SENSOR, "--output", RECORDED];
    for (more, code, sentence) in [
        (
            ["--keep", "2"],
            1,
            "cannot record several trips into recorded.mcap: trip_mb_max, trip_s_max and keep need a folder that is there",
        ),
        (["--keep", "0"], 2, "keep is 0; it must be at least 1, or left out"),
        (["--trip-s-max", "0"], 2, "trip_s_max is 0; it must be at least 1, or left out"),
        (["--trip-mb-max", "0"], 2, "trip_mb_max is 0; it must be at least 1, or left out"),
    ] {
        robot.refuse(&[&record[..], &more].concat(), code, sentence);
    }
}

#[test]
fn a_recorder_without_room_writes_nothing_and_says_so() {
    let robot = Robot::trained();
    let before = robot.files();
    let recorder = record(&robot, &["--free-mb-min", "1000000000000"]);
    let said = recorder.await_err("kinds: recording into recorded.mcap pauses: ");
    assert!(
        said.ends_with(" MB are free there, and 1000000000000 MB are to stay so (free_mb_min)"),
        "{said}"
    );
    robot.publish(SECOND, "20").end();
    recorder.signal(Signal::TERM);
    let outcome = recorder.end();
    assert_eq!(outcome.code, Some(1), "{outcome:?}");
    let last = "kinds: recorded.mcap was not written: 130 frames came, and there was no room for them\n";
    assert!(outcome.stderr.ends_with(last), "{outcome:?}");
    assert!(robot.files() == before);
}

#[test]
fn a_recorder_pauses_while_there_is_no_room_and_goes_on_when_there_is() {
    /// Far more than other programs are likely to write meanwhile.
    const MARGIN_MB: u64 = 1000;
    let robot = Robot::new();
    let space = statvfs(robot.path("")).unwrap();
    let free_mb = space.f_bavail * space.f_frsize / 1_000_000;
    if free_mb < 8 * MARGIN_MB {
        eprintln!("skipped: only {free_mb} MB are free");
        return;
    }
    // To go on, a tenth more than the limit must be free.
    let limit_mb = (free_mb - MARGIN_MB) * 10 / 11;
    let recorder = record(&robot, &["--free-mb-min", &limit_mb.to_string()]);
    let shim = robot.start(&["publish", "--simulate", "crunch", "--sensor", SENSOR, "--speed", "5"]);
    let frames = robot.join_frames();
    let await_frames = |n_frames: usize| {
        let mut n_seen = 0;
        await_that(|| {
            n_seen += usize::from(frames.receive().unwrap().is_some());
            n_seen >= n_frames
        });
    };
    await_frames(10);
    let filler = File::create(robot.path("filler")).unwrap();
    let n_bytes = (free_mb - limit_mb + MARGIN_MB) * 1_000_000;
    fallocate(&filler, FallocateFlags::empty(), 0, n_bytes).unwrap();
    recorder.await_err("kinds: recording into recorded.mcap pauses: ");
    await_frames(40);
    drop(filler);
    std::fs::remove_file(robot.path("filler")).unwrap();
    let said = recorder.await_err("kinds: recording into recorded.mcap goes on: ");
    let n_left_out: usize = said.rsplit("; ").next().unwrap().split(' ').next().unwrap().parse().unwrap();
    assert!(n_left_out > 0, "{said}");
    await_frames(40);
    drop(frames);
    let said = recorder.stop(Signal::TERM);
    assert!(said.contains(&format!("; 0 frames lost, {n_left_out} left out for want of room")), "{said}");
    shim.stop(Signal::TERM);
    // The simulated robot's steps, without those that were left out, in one row.
    let recorded = frames_of(&[robot.path(RECORDED)]);
    let (mut crunch, mut n_skipped) = (Crunch::new(Floor::Fourth, 1, 0), Vec::new());
    let mut expected = vec![0; crunch.layout().n_readings()];
    for (captured, counts) in &recorded {
        let mut n_steps = 0;
        while crunch.step(&mut expected).unwrap().captured.0 != *captured {
            n_steps += 1;
        }
        assert_eq!(*counts, expected);
        n_skipped.extend((n_steps > 0).then_some(n_steps));
    }
    assert_eq!(n_skipped, [n_left_out]);
    assert_eq!(losses_by_rosbags(&robot).unwrap_or(vec![[0, n_left_out]]).last(), Some(&[0, n_left_out]));
}

/// What rosbags reads of the losses in a recording: on the way, and for want of room.
fn losses_by_rosbags(robot: &Robot) -> Option<Vec<[usize; 2]>> {
    told_by_rosbags(robot)?;
    let script = "
import sys
from pathlib import Path
from rosbags.highlevel import AnyReader
from rosbags.typesys import Stores, get_typestore
with AnyReader([Path(sys.argv[1])], default_typestore=get_typestore(Stores.ROS2_HUMBLE)) as bag:
    for connection, _, raw in bag.messages(connections=[c for c in bag.connections if c.topic == '/lost']):
        message = bag.deserialize(raw, connection.msgtype)
        assert message.layout.dim[0].label == 'lost, left out for want of room'
        print(*(int(number) for number in message.data))
";
    let output = Command::new("python3").args(["-c", script]).arg(robot.path(RECORDED)).output().unwrap();
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let numbers = |line: &str| line.split(' ').map(|number| number.parse().unwrap()).collect::<Vec<_>>();
    let text = String::from_utf8(output.stdout).unwrap();
    Some(text.lines().map(|line| numbers(line).try_into().unwrap()).collect())
}

#[test]
fn frames_lost_on_the_way_are_counted_in_the_trip() {
    let robot = Robot::trained();
    robot.write("faults.ron", "(seed: 3, wrong_length: 0.1)");
    let recorder = record(&robot, &[]);
    robot
        .start(&["publish", "--trip", SECOND, "--sensor", SENSOR, "--speed", "20", "--faults", "faults.ron"])
        .end();
    let said = recorder.stop(Signal::TERM);
    let n_lost: usize = said.rsplit("; ").next().unwrap().split(' ').next().unwrap().parse().unwrap();
    assert!(n_lost > 0, "{said}");
    let info = robot.succeed(&["trips", "info", RECORDED]);
    assert!(info.contains("/lost"), "{info}");
    let Some(losses) = losses_by_rosbags(&robot) else { return };
    assert_eq!(losses.last(), Some(&[n_lost, 0]));
}

#[test]
fn frames_of_another_layout_begin_another_trip_where_there_may_be_one_and_end_the_only_one() {
    let robot = Robot::trained();
    Trip { n_readings: 8, n_frames: 20, ..Trip::SECOND }.write(&robot.path("eight.mcap"));
    let recorder = record_into_folder(&robot, &["--count", "150"]);
    robot.publish(SECOND, "20").end();
    robot.publish("eight.mcap", "5").end();
    assert_eq!(recorder.end().code, Some(0));
    let both = trips(&robot);
    assert_eq!(both.len(), 2);
    assert!(frames_of(&both) == frames_of(&[robot.path(SECOND), robot.path("eight.mcap")]));

    let recorder = record(&robot, &[]);
    robot.publish(SECOND, "20").end();
    let shim = robot.publish("eight.mcap", "5");
    let outcome = recorder.end();
    shim.stop(Signal::TERM);
    assert_eq!(outcome.code, Some(1), "{outcome:?}");
    let last = outcome.stderr.lines().last().unwrap();
    assert!(
        last.starts_with("kinds: cannot record frames of 8 readings ")
            && last.ends_with("one trip is of one sensor"),
        "{last}"
    );
    assert!(frames_of(&[robot.path(RECORDED)]) == frames_of(&[robot.path(SECOND)]));
}

/// The frames that are saved from a recording; none where there is no whole message.
fn saved_from(robot: &Robot, from: &Path) -> Vec<(i64, Vec<u16>)> {
    let saved = robot.path("saved.mcap");
    let _ = std::fs::remove_file(&saved);
    match salvage(from, &saved) {
        Ok(_) => frames_of(&[saved]),
        Err(error) => {
            assert!(error.to_string().contains("has no whole message to save"), "{error}");
            Vec::new()
        }
    }
}

#[test]
fn a_killed_recorder_leaves_what_it_has_flushed_wherever_its_file_is_cut() {
    let robot = Robot::trained();
    let path = robot.path("notify");
    let supervisor = UnixDatagram::bind(&path).unwrap();
    supervisor.set_read_timeout(Some(DEADLINE)).unwrap();
    let arguments = ["record", "--sensor", SENSOR, "--output", RECORDED];
    let recorder = Running::start(robot.command(&arguments).env("NOTIFY_SOCKET", &path));
    recorder.await_err("kinds: waiting for a driver shim to publish crunch/ring");
    let shim = robot.publish(SECOND, "2");
    // Told once a second, of what has just been flushed.
    let n_told = std::iter::repeat_with(|| {
        let mut bytes = [0; 1024];
        let n_bytes = supervisor.recv(&mut bytes).unwrap();
        let told = String::from_utf8(bytes[..n_bytes].to_vec()).unwrap();
        let n_frames =
            told.split_once("recorded.mcap: ").map_or("0", |(_, rest)| rest.split(' ').next().unwrap());
        n_frames.parse::<usize>().unwrap()
    })
    .find(|n_frames| *n_frames >= 60)
    .unwrap();
    recorder.kill();
    shim.stop(Signal::TERM);
    std::fs::remove_file(path).unwrap();
    let files = robot.files().into_keys().map(|name| name.to_str().unwrap().to_string());
    let partial = files.into_iter().find(|name| name.ends_with(".partial")).unwrap();
    let said = robot.succeed(&["trips", "recover", &partial, "recovered.mcap"]);
    assert!(said.starts_with("saved "), "{said}");
    let (all, recovered) = (frames_of(&[robot.path(SECOND)]), frames_of(&[robot.path("recovered.mcap")]));
    assert!(recovered.len() >= n_told && all.starts_with(&recovered), "{} of {n_told}", recovered.len());

    // Cut off at one byte after another, in steps that have no factor in common with anything in the file.
    let bytes = robot.read(&partial);
    let mut n_before = recovered.len();
    for n_left in (0..bytes.len()).rev().step_by(37) {
        robot.write("cut.mcap", &bytes[..n_left]);
        let saved = saved_from(&robot, &robot.path("cut.mcap"));
        assert!(saved.len() <= n_before && all.starts_with(&saved), "{n_left} bytes");
        n_before = saved.len();
    }
    assert_eq!(n_before, 0);
}
