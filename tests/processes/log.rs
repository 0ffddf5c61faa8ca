//! What programs tell on standard error, for machines: every line is JSON, and a condition is told twice.

use rustix::process::Signal;
use serde_json::Value;

use crate::robot::{MODEL, Robot, SECOND, SENSOR};
use crate::running::await_that;

/// Every line, each of which must be a JSON object with the fields that all have.
fn parsed(lines: &[String]) -> Vec<Value> {
    let parse = |line: &String| -> Value {
        let value: Value = serde_json::from_str(line).unwrap_or_else(|error| panic!("{error}: {line}"));
        for field in ["timestamp", "level", "message"] {
            assert!(value[field].is_string(), "no {field} in {line}");
        }
        value
    };
    lines.iter().map(parse).collect()
}

#[test]
fn a_condition_is_one_line_of_json_when_it_begins_and_one_when_it_ends() {
    let robot = Robot::trained();
    robot.write("invalid.ron", "(invalid: 1)");
    let service = robot.serve_with(&["--log-format", "json"]);
    let told = |condition: &str, level: &str| {
        let lines = parsed(&service.err());
        let is_so = |line: &&Value| line["condition"] == condition && line["level"] == level;
        lines.iter().filter(is_so).count()
    };
    let publish = |more: &[&str]| {
        robot.start(
            &[&["publish", "--trip", SECOND, "--sensor", SENSOR, "--log-format", "json"], more].concat(),
        )
    };
    let spoilt = publish(&["--faults", "invalid.ron"]);
    await_that(|| told("invalid", "WARN") == 1);
    parsed(
        spoilt
            .stop(Signal::TERM)
            .lines()
            .filter(|line| line.starts_with('{'))
            .map(String::from)
            .collect::<Vec<_>>()
            .as_slice(),
    );
    let good = publish(&[]);
    await_that(|| told("invalid", "INFO") == 1);
    good.stop(Signal::TERM);
    assert_eq!((told("invalid", "WARN"), told("invalid", "INFO")), (1, 1), "{:?}", service.err());
    let first = &parsed(&service.err())[0];
    assert_eq!(first["sensor"], SENSOR);
    assert_eq!(first["message"], "waiting for a driver shim to publish this sensor");

    // What a program says of itself, and why it ends, too.
    let second = robot.run(&["serve", "--model", MODEL, "--sensor", SENSOR, "--log-format", "json"]);
    assert_eq!(second.code, Some(1));
    let [why] = &parsed(&second.stderr.lines().map(String::from).collect::<Vec<_>>())[..] else {
        panic!("{second:?}")
    };
    assert_eq!(why["level"], "ERROR");
    assert!(why["message"].as_str().unwrap().starts_with("sensor crunch/ring is already served"), "{why}");
    service.stop(Signal::TERM);
    let watch = robot.start(&["watch", "--sensor", SENSOR, "--log-format", "json"]);
    await_that(|| !watch.err().is_empty());
    assert!(parsed(&watch.err())[0]["message"].as_str().unwrap().starts_with("waiting for a service"));
    watch.stop(Signal::TERM);
}
