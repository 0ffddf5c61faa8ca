//! Services that start, stop, are killed, meet others of their kind, and get frames that are not for them.

use rustix::process::Signal;
use rustix::thread::{CapabilitySet, capabilities};

use crate::robot::{MODEL, Robot, SECOND, SENSOR};
use crate::running::Running;
use crate::world::{Trip, assert_reports_equal_classifying_here};

#[test]
fn a_signal_ends_a_service_well_and_leaves_nothing_in_shared_memory() {
    for signal in [Signal::TERM, Signal::INT] {
        let robot = Robot::trained();
        let service = robot.serve();
        service.await_err("INFO waiting for a driver shim to publish this sensor");
        let mut consumer = robot.join();
        let shim = robot.publish(SECOND, "1");
        consumer.await_reports(3);
        drop(consumer);
        let told = service.stop(signal);
        let (first, last) = told.trim_end().split_once('\n').unwrap();
        let model = crate::world::open_model(&robot.path(MODEL)).id();
        assert_eq!(
            first,
            format!("serving {SENSOR}: 5 kinds of 16 readings (1 × 16) of 0.001 m a count, model {model}")
        );
        let counts: Vec<u64> = numbers(last);
        let [n_frames, n_classified, ..] = counts[..] else { panic!("{last}") };
        assert!(n_frames >= 3 && n_classified == n_frames, "{last}");
        assert_eq!(
            last,
            format!(
                "served {n_frames} frames: {n_frames} classified, 0 invalid, 0 repeated, 0 refused; 0 lost"
            )
        );
        assert!(shim.stop(signal).starts_with("published "));
        assert_eq!(robot.shared_memory(), [""; 0]);
    }
}

fn numbers(line: &str) -> Vec<u64> {
    line.split(|c: char| !c.is_ascii_digit()).filter_map(|digits| digits.parse().ok()).collect()
}

#[test]
fn a_killed_service_leaves_its_place_to_the_next_at_once() {
    let robot = Robot::trained();
    for _ in 0..3 {
        let service = robot.serve();
        let mut consumer = robot.join();
        let shim = robot.publish(SECOND, "1");
        consumer.await_reports(2);
        service.kill();
        shim.kill();
    }
    let service = robot.serve();
    let consumer = robot.join();
    let mut shim = robot.publish(SECOND, "max");
    let reports = consumer.await_end_of(&mut shim);
    assert_reports_equal_classifying_here(&reports, &robot.path(MODEL), &robot.path(SECOND));
    service.stop(Signal::TERM);
    assert_eq!(shim.end().code, Some(0));
    assert_eq!(robot.shared_memory(), [""; 0]);
}

#[test]
fn a_second_service_for_a_sensor_is_refused_and_the_first_goes_on() {
    let robot = Robot::trained();
    let service = robot.serve();
    robot.refuse(
        &["serve", "--model", MODEL, "--sensor", SENSOR],
        1,
        "sensor crunch/ring is already served by another service; stop that one first, or serve another sensor name",
    );
    let other = robot.start(&["serve", "--model", MODEL, "--sensor", "crunch/other"]);
    other.await_out("serving crunch/other: ");
    let consumer = robot.join();
    let mut shim = robot.publish(SECOND, "max");
    assert_eq!(consumer.await_end_of(&mut shim).len(), 130);
    let told = other.stop(Signal::TERM);
    assert!(
        told.ends_with("served 0 frames: 0 classified, 0 invalid, 0 repeated, 0 refused; 0 lost\n"),
        "{told}"
    );
    assert!(service.stop(Signal::TERM).contains("served 130 frames: 130 classified"));
}

#[test]
fn frames_of_another_sensor_are_refused_once_in_words_and_the_service_stays_up() {
    let robot = Robot::trained();
    Trip { n_readings: 8, n_frames: 20, ..Trip::SECOND }.write(&robot.path("other.mcap"));
    let service = robot.serve();
    let outcome = robot.publish("other.mcap", "50").end();
    assert_eq!(outcome.code, Some(0), "{outcome:?}");
    let told = "WARN frames have 8 readings (1 × 8) of 0.001 m a count, the model is for 16 readings (1 × 16) of \
                0.001 m a count; serve a model that was trained on this sensor, or publish the right sensor under this name";
    service.await_err(told);

    let consumer = robot.join();
    let mut shim = robot.publish(SECOND, "max");
    let reports = consumer.await_end_of(&mut shim);
    assert_reports_equal_classifying_here(&reports, &robot.path(MODEL), &robot.path(SECOND));
    assert_eq!(service.err().iter().filter(|line| line.contains("WARN")).count(), 1, "{:?}", service.err());
    let told = service.stop(Signal::TERM);
    let counts = numbers(told.lines().last().unwrap());
    let [n_frames, n_classified, n_invalid, n_repeated, n_refused, n_lost] = counts[..] else {
        panic!("{told}")
    };
    assert_eq!((n_classified, n_invalid, n_repeated, n_lost), (130, 0, 0, 0));
    assert!(n_refused > 0 && n_frames == n_classified + n_refused, "{told}");
}

#[test]
fn a_shim_that_follows_a_service_of_another_sensor_says_what_it_waits_for() {
    let robot = Robot::trained();
    Trip { n_readings: 8, n_frames: 20, ..Trip::SECOND }.write(&robot.path("other.mcap"));
    let service = robot.serve();
    let shim = robot.publish("other.mcap", "max");
    shim.await_err(
        "kinds: the service for crunch/ring has not reported on frame 0; waiting (does it have a model of this \
         sensor?)",
    );
    assert!(shim.stop(Signal::INT).starts_with("published 8 frames of crunch/ring in "));
    service.stop(Signal::INT);
}

fn n_locked_kb(service: &Running) -> usize {
    service.status("VmLck:").strip_suffix(" kB").unwrap().parse().unwrap()
}

#[test]
fn a_service_that_may_lock_its_memory_keeps_the_model_there() {
    let robot = Robot::trained();
    let service = robot.start(&["serve", "--model", MODEL, "--sensor", SENSOR, "--lock-memory"]);
    let told = service.await_out(&format!("serving {SENSOR}: "));
    let (n_locked_kb, n_model_kb) = (n_locked_kb(&service), robot.read(MODEL).len() / 1024);
    // Whoever runs this test without the right, or a limit that is high enough, sees that the service does not claim it.
    let is_locked = told.ends_with("; memory is locked");
    assert_eq!(is_locked, n_locked_kb >= n_model_kb, "{told}: {n_locked_kb} kB of {n_model_kb} kB");
    let has_right = capabilities(None).unwrap().effective.contains(CapabilitySet::IPC_LOCK);
    assert!(is_locked || !has_right, "{told}; {:?}", service.err());
    let consumer = robot.join();
    let mut shim = robot.publish(SECOND, "max");
    let reports = consumer.await_end_of(&mut shim);
    assert_reports_equal_classifying_here(&reports, &robot.path(MODEL), &robot.path(SECOND));
    service.stop(Signal::TERM);
}

#[test]
fn a_service_that_may_not_lock_its_memory_says_what_to_change_and_serves() {
    let robot = Robot::trained();
    let service = robot.start_limited(
        "-l 64",
        CapabilitySet::IPC_LOCK,
        &["serve", "--model", MODEL, "--sensor", SENSOR, "--lock-memory"],
    );
    let told = service.await_out(&format!("serving {SENSOR}: "));
    assert!(told.ends_with("; memory is not locked"), "{told}");
    assert_eq!(n_locked_kb(&service), 0);
    let warned = service.await_err("WARN cannot lock memory: ");
    let (_, warned) = warned.split_once("memory: ").unwrap();
    let (n_mapped_kb, rest) = warned.split_once(' ').unwrap();
    assert!(n_mapped_kb.parse::<usize>().unwrap() > 64, "{warned}");
    assert_eq!(
        rest,
        "kB are mapped, the limit is 64 kB (Cannot allocate memory (os error 12)); raise it, with ulimit -l in a shell or \
         LimitMEMLOCK=infinity in a systemd unit; serving on, though the system may page the model out"
    );
    let consumer = robot.join();
    let mut shim = robot.publish(SECOND, "max");
    assert_eq!(consumer.await_end_of(&mut shim).len(), 130);
    service.stop(Signal::TERM);
}
