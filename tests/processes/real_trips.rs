//! Real recordings, where they are: beside the project, or where the environment variable `KINDS_TRIPS_DIR` says.

#![allow(clippy::print_stderr, reason = "a test that is skipped says so")]

use std::path::PathBuf;

use rustix::process::Signal;

use crate::robot::{MODEL, Robot};
use crate::world::assert_reports_equal_classifying_here;

/// Path of a recording, if it is there.
pub(crate) fn trip(name: &str) -> Option<PathBuf> {
    let beside = concat!(env!("CARGO_MANIFEST_DIR"), "/../shared/trips");
    let folder = std::env::var_os("KINDS_TRIPS_DIR").unwrap_or_else(|| beside.into());
    let path = PathBuf::from(folder).join(name);
    match path.exists() {
        true => Some(path),
        false => {
            eprintln!("skipped: no {}; set KINDS_TRIPS_DIR to where it is", path.display());
            None
        }
    }
}

#[test]
fn every_one_of_500_depth_images_gets_a_report_equal_to_classifying_it_here() {
    let (Some(first), Some(second)) =
        (trip("chess-depth19840-trip1.mcap"), trip("chess-depth19840-trip2.mcap"))
    else {
        return;
    };
    let robot = Robot::new();
    let first = first.to_str().unwrap();
    let told = robot.succeed(&["train", first, "--output", MODEL, "--dims", "15", "--kinds", "8"]);
    assert!(told.starts_with("learnt 8 kinds from 500 frames of 19840 readings"), "{told}");
    let consumer = robot.join();
    let service = robot.serve();
    let mut shim = robot.publish(second.to_str().unwrap(), "max");
    let reports = consumer.await_end_of(&mut shim);
    assert_eq!(reports.len(), 500);
    assert_reports_equal_classifying_here(&reports, &robot.path(MODEL), &second);
    assert!(service.stop(Signal::TERM).contains("served 500 frames: 500 classified, 0 invalid"));
    assert_eq!(shim.end().code, Some(0));
}
