//! What `kinds watch` prints, what it waits for, and how it ends.

use std::io::{BufRead, BufReader};

use rustix::process::Signal;
use serde_json::Value;

use crate::robot::{Robot, SECOND, SENSOR};

const WAITING: &str =
    "kinds: waiting for a service for crunch/ring (kinds serve --sensor crunch/ring --model …)";
const THERE: &str = "kinds: a service for crunch/ring is there";

#[test]
fn watch_waits_for_a_service_and_prints_as_many_json_lines_as_asked_for() {
    let robot = Robot::trained();
    let watch = robot.start(&["watch", "--sensor", SENSOR, "--json", "--count", "130"]);
    watch.await_err(WAITING);
    let service = robot.serve();
    watch.await_err(THERE);
    let shim = robot.publish(SECOND, "max");
    let outcome = watch.end();
    assert_eq!((outcome.code, outcome.stderr.as_str()), (Some(0), &*format!("{WAITING}\n{THERE}\n")));
    assert_eq!(outcome.stdout.lines().count(), 130);
    for (sequence, line) in outcome.stdout.lines().enumerate() {
        check_line(sequence, line);
    }
    assert_eq!(shim.end().code, Some(0));
    service.stop(Signal::TERM);
}

fn check_line(sequence: usize, line: &str) {
    let report: Value = serde_json::from_str(line).unwrap();
    let fields: Vec<&String> = report.as_object().unwrap().keys().collect();
    assert_eq!(
        fields,
        [
            "filtered",
            "filtered_kind",
            "kind",
            "latency_ns",
            "log_likelihood",
            "numbers",
            "probabilities",
            "sequence",
            "status"
        ]
    );
    for (kind, probabilities) in [("kind", "probabilities"), ("filtered_kind", "filtered")] {
        let probabilities = report[probabilities].as_array().unwrap().iter();
        let probabilities: Vec<f64> =
            probabilities.map(|probability| probability.as_f64().unwrap()).collect();
        assert_eq!(probabilities.len(), 5, "{line}");
        assert!((probabilities.iter().sum::<f64>() - 1.0).abs() < 1e-12, "{line}");
        let kind = report[kind].as_u64().unwrap() as usize;
        assert!(probabilities.iter().all(|probability| *probability <= probabilities[kind]), "{line}");
    }
    assert_eq!(report["sequence"].as_u64(), Some(sequence as u64));
    assert_eq!(report["status"], "classified");
    assert!(report["log_likelihood"].is_f64() && report["latency_ns"].as_u64().unwrap() > 0, "{line}");
}

#[test]
fn watch_prints_a_line_per_report_for_a_person() {
    let robot = Robot::trained();
    let watch = robot.start(&["watch", "--sensor", SENSOR, "--count", "130"]);
    watch.await_err(WAITING);
    let service = robot.serve();
    watch.await_err(THERE);
    let shim = robot.publish(SECOND, "max");
    let outcome = watch.end();
    assert_eq!(outcome.stdout.lines().count(), 130);
    for (sequence, line) in outcome.stdout.lines().enumerate() {
        assert!(line.starts_with(&format!("frame {sequence:6}  kind  ")), "{line}");
        assert!(line.contains(" %  ") && line.ends_with(" µs"), "{line}");
    }
    assert_eq!(shim.end().code, Some(0));
    service.stop(Signal::TERM);
}

#[test]
fn a_signal_ends_watch_well_with_and_without_a_service() {
    let robot = Robot::trained();
    for signal in [Signal::TERM, Signal::INT] {
        let watch = robot.start(&["watch", "--sensor", SENSOR]);
        watch.await_err(WAITING);
        assert_eq!(watch.stop(signal), "");

        let service = robot.serve();
        let watch = robot.start(&["watch", "--sensor", SENSOR]);
        let shim = robot.publish(SECOND, "1");
        watch.await_out("frame ");
        watch.stop(signal);
        shim.stop(signal);
        service.stop(signal);
    }
    assert_eq!(robot.shared_memory(), [""; 0]);
}

#[test]
fn watch_says_that_the_service_is_gone_and_goes_on_with_the_next() {
    let robot = Robot::trained();
    let watch = robot.start(&["watch", "--sensor", SENSOR, "--count", "130"]);
    watch.await_err(WAITING);
    let service = robot.serve();
    watch.await_err(THERE);
    // Killed, not stopped: somebody has to clean up before it counts as gone.
    service.kill();
    watch.await_err("kinds: the service for crunch/ring is gone; waiting for another");
    let service = robot.serve();
    assert_eq!(robot.publish(SECOND, "max").end().code, Some(0));
    assert_eq!(watch.end().stdout.lines().count(), 130);
    service.stop(Signal::TERM);
}

#[test]
fn an_output_that_is_closed_ends_watch_without_a_complaint() {
    let robot = Robot::trained();
    let service = robot.serve();
    let (watch, stdout) = robot.start_into(&["watch", "--sensor", SENSOR]);
    let shim = robot.publish(SECOND, "1");
    let mut first = String::new();
    // Dropped after a line, like the pipe to `head -1`.
    BufReader::new(stdout).read_line(&mut first).unwrap();
    assert!(first.starts_with("frame "), "{first}");
    let outcome = watch.end();
    assert_eq!((outcome.code, outcome.stderr.as_str()), (Some(0), ""));
    shim.stop(Signal::TERM);
    service.stop(Signal::TERM);
}

#[test]
fn a_watcher_that_comes_late_is_shown_the_last_report() {
    let robot = Robot::trained();
    let service = robot.serve();
    assert_eq!(robot.publish(SECOND, "max").end().code, Some(0));
    let shown = robot.succeed(&["watch", "--sensor", SENSOR, "--json", "--count", "1"]);
    check_line(129, shown.trim_end());
    service.stop(Signal::TERM);
}
