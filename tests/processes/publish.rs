//! Driver shims that wait, meet others of their kind, are killed, and replay trips that are not as they should be.

use rustix::process::Signal;

use crate::robot::{MODEL, Robot, SECOND, SENSOR};
use crate::world::{Trip, assert_reports_equal_classifying_here};

#[test]
fn a_shim_waits_for_whom_it_needs_and_says_so() {
    let robot = Robot::trained();
    for (speed, wait) in [
        ("1", "kinds: waiting for a program that reads the frames of crunch/ring"),
        ("max", "kinds: waiting for a service for crunch/ring"),
    ] {
        let shim = robot.publish(SECOND, speed);
        shim.await_err(wait);
        assert_eq!(shim.stop(Signal::TERM), format!("published 0 frames of {SENSOR} in 0.0 s\n"));
        assert_eq!(robot.shared_memory(), [""; 0]);
    }
    let shim = robot.publish(SECOND, "max");
    shim.await_err("kinds: waiting for a service for crunch/ring");
    let service = robot.serve();
    let outcome = shim.end();
    assert_eq!(
        outcome.stderr,
        "kinds: waiting for a service for crunch/ring\nkinds: publishing crunch/ring\n"
    );
    assert!(outcome.stdout.starts_with("published 130 frames "), "{outcome:?}");
    service.stop(Signal::TERM);
}

#[test]
fn a_shim_that_nobody_listens_to_publishes_all_the_same() {
    let robot = Robot::trained();
    let service = robot.serve();
    let (shim, out) = robot.start_into(&["publish", "--trip", SECOND, "--sensor", SENSOR, "--speed", "max"]);
    drop(out);
    let outcome = shim.end();
    assert_eq!((outcome.code, outcome.stderr.as_str()), (Some(0), ""));
    assert!(service.stop(Signal::TERM).contains("served 130 frames: 130 classified"));
}

#[test]
fn a_second_shim_for_a_sensor_is_refused_and_the_first_goes_on() {
    let robot = Robot::trained();
    let shim = robot.publish(SECOND, "max");
    shim.await_err("kinds: waiting for a service for crunch/ring");
    robot.refuse(
        &["publish", "--trip", SECOND, "--sensor", SENSOR],
        1,
        "sensor crunch/ring is already published by another driver shim; stop that one first, or publish under \
         another sensor name",
    );
    let service = robot.serve();
    assert!(shim.end().stdout.starts_with("published 130 frames "));
    assert!(service.stop(Signal::TERM).contains("served 130 frames: 130 classified"));
}

#[test]
fn a_killed_shim_leaves_its_place_to_the_next_at_once_and_the_service_goes_on() {
    let robot = Robot::trained();
    let service = robot.serve();
    let mut consumer = robot.join();
    for killed in 1..=3 {
        let shim = robot.publish(SECOND, "1");
        // The frames of those before may still be coming in.
        let n_before = consumer.await_reports(killed).len();
        consumer.await_reports(n_before + 2);
        shim.kill();
    }
    drop(consumer);
    let consumer = robot.join();
    let mut shim = robot.publish(SECOND, "max");
    let reports = consumer.await_end_of(&mut shim);
    let run = reports.last().unwrap().run;
    // A late joiner gets the last report of those before.
    let reports: Vec<_> = reports.into_iter().filter(|report| report.run == run).collect();
    assert_reports_equal_classifying_here(&reports, &robot.path(MODEL), &robot.path(SECOND));
    service.stop(Signal::TERM);
}

#[test]
fn a_shim_says_how_many_frames_a_service_that_went_left_unreported() {
    let robot = Robot::trained();
    let service = robot.serve();
    // It hangs: there, but silent.
    service.signal(Signal::STOP);
    let shim = robot.publish(SECOND, "max");
    shim.await_err("kinds: the service for crunch/ring has not reported on frame 0; waiting");
    service.kill();
    shim.await_err("kinds: the service for crunch/ring is gone and left 8 frames unreported");
    shim.await_err("kinds: waiting for a service for crunch/ring");
    let service = robot.serve();
    let outcome = shim.end();
    assert_eq!(outcome.code, Some(1));
    assert_eq!(
        outcome.stderr.lines().last(),
        Some("kinds: the service left 8 of 130 frames of crunch/ring unreported")
    );
    assert!(service.stop(Signal::TERM).contains("served 122 frames: 122 classified"));
}

#[test]
fn a_trip_that_was_cut_off_is_published_up_to_there() {
    let robot = Robot::trained();
    let n_frames = crate::bad_trips::write_cut_off(&robot, "cut.mcap");
    let consumer = robot.join();
    let service = robot.serve();
    let mut shim = robot.publish("cut.mcap", "max");
    let reports = consumer.await_end_of(&mut shim);
    assert_reports_equal_classifying_here(&reports, &robot.path(MODEL), &robot.path("cut.mcap"));
    let outcome = shim.end();
    assert_eq!(outcome.code, Some(0));
    assert_eq!(outcome.stderr, format!("kinds: {}\n", crate::bad_trips::cut_off(&robot, "cut.mcap")));
    assert!(outcome.stdout.starts_with(&format!("published {n_frames} frames ")), "{outcome:?}");
    service.stop(Signal::TERM);
}

#[test]
fn frames_before_the_one_that_cannot_be_used_are_published() {
    let robot = Robot::trained();
    Trip { halved_from: 50, ..Trip::SECOND }.write(&robot.path("changing.mcap"));
    let consumer = robot.join();
    let service = robot.serve();
    let mut shim = robot.publish("changing.mcap", "max");
    let reports = consumer.await_end_of(&mut shim);
    let outcome = shim.end();
    assert_eq!(outcome.code, Some(1));
    assert_eq!(outcome.stderr, format!("kinds: {}\n", crate::bad_trips::CHANGING));
    let sequences: Vec<u64> = reports.iter().map(|report| report.sequence).collect();
    assert_eq!(sequences, (0..50).collect::<Vec<_>>());
    service.stop(Signal::TERM);
}
