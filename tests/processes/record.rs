//! `kinds record`: what went through shared memory is a trip again.

#![allow(clippy::print_stderr, reason = "a test that is skipped says so")]

use std::process::Command;

use kinds_driver_shim::simulated::{Crunch, Floor, Robot as _};
use rustix::process::Signal;

use crate::robot::{Robot, SECOND, SENSOR};
use crate::running::Running;
use crate::world::{Trip, read_trip, read_trip_by, told_along_the_loop};

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
    crate::running::await_that(|| {
        frames.receive().unwrap().is_some_and(|frame| frame.header().sequence >= 5)
    });
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
        if connection.topic == '/kinds':
            assert abs(sum(message.data) - 1) < 1e-9 and message.layout.dim[0].size == len(message.data)
        if connection.topic == '/frames':
            assert message.encoding == '16UC1' and len(message.data) == 2 * message.height * message.width
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
    assert_eq!(
        told,
        "/frames sensor_msgs/msg/Image 20\n/kinds std_msgs/msg/Float64MultiArray 20\n/odom nav_msgs/msg/Odometry 20\n"
    );
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
