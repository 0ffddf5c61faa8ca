//! The whole way: a trip is learnt, a second one is served and published, and every frame gets one report.

use rustix::process::Signal;

use crate::robot::{FIRST, MODEL, Robot, SECOND, SENSOR};
use crate::world::{Trip, assert_reports_equal_classifying_here};

/// Trains on the first trip, and publishes a second one to a consumer that was there before.
fn check(train: &[&str], n_frames: usize, speed: &str) {
    check_served(train, &[], n_frames, speed);
}

/// The same with flags of the service.
fn check_served(train: &[&str], serve: &[&str], n_frames: usize, speed: &str) {
    let robot = Robot::new();
    Trip::FIRST.write(&robot.path(FIRST));
    Trip { n_frames, ..Trip::SECOND }.write(&robot.path(SECOND));
    robot.succeed(&[&["train", FIRST, "--output", MODEL], train].concat());
    let consumer = robot.join();
    let service = robot.serve_with(serve);
    let mut shim = robot.publish(SECOND, speed);
    let reports = consumer.await_end_of(&mut shim);
    assert_reports_equal_classifying_here(&reports, &robot.path(MODEL), &robot.path(SECOND));
    let outcome = shim.end();
    let published = format!("published {n_frames} frames of {SENSOR} in ");
    assert!(outcome.code == Some(0) && outcome.stdout.starts_with(&published), "{outcome:?}");
    let told = service.stop(Signal::TERM);
    let served =
        format!("served {n_frames} frames: {n_frames} classified, 0 invalid, 0 repeated, 0 refused; 0 lost");
    assert_eq!(told.lines().last(), Some(&*served));
}

#[test]
fn as_fast_as_followed_every_frame_gets_one_report_equal_to_classifying_it_here() {
    check(&[], 130, "max");
}

#[test]
fn at_a_multiple_of_the_pace_every_frame_gets_one_report_equal_to_classifying_it_here() {
    // Paced replay waits for nobody: slow enough for a service that has to share its processor with other tests.
    check(&[], 60, "5");
}

#[test]
fn a_service_that_polls_reports_the_same_and_stops_as_well() {
    check_served(&[], &["--busy-poll"], 130, "max");
}

#[test]
fn reports_by_the_ring_metric_equal_classifying_here() {
    check(&["--metric", "rings:2"], 130, "max");
}

#[test]
fn reports_of_parts_that_count_alike_equal_classifying_here() {
    check(&["--metric", "parts:4,12"], 130, "max");
}

#[test]
fn reports_of_native_space_equal_classifying_here() {
    check(&["--method", "native"], 130, "max");
}

#[test]
fn reports_of_principal_components_equal_classifying_here() {
    check(&["--method", "pca", "--response", "range"], 130, "max");
}

#[test]
fn a_frame_without_any_valid_reading_is_reported_as_invalid() {
    for as_images in [false, true] {
        let robot = Robot::trained();
        Trip { invalid_frames: &[0, 60, 61], as_images, ..Trip::SECOND }.write(&robot.path("blind.mcap"));
        let consumer = robot.join();
        let service = robot.serve();
        let mut shim = robot.publish("blind.mcap", "max");
        let reports = consumer.await_end_of(&mut shim);
        assert_reports_equal_classifying_here(&reports, &robot.path(MODEL), &robot.path("blind.mcap"));
        let invalid =
            reports.iter().filter(|report| report.status() == kinds_messages::ReportStatus::Invalid);
        let invalid: Vec<_> = invalid.map(|report| (report.sequence, report.n_invalid)).collect();
        assert_eq!(invalid, [(0, 16), (60, 16), (61, 16)]);
        for report in &reports {
            let sum: f64 = report.probabilities().iter().sum();
            assert!((sum - 1.0).abs() < 1e-12, "frame {}: {sum}", report.sequence);
        }
        let told = service.stop(Signal::TERM);
        assert_eq!(
            told.lines().last(),
            Some("served 130 frames: 127 classified, 3 invalid, 0 repeated, 0 refused; 0 lost")
        );
    }
}
