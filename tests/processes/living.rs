//! Living with kinds: what people call them, and levels of fewer kinds.

use kinds_messages::Purpose;
use rustix::process::Signal;
use serde_json::Value;

use crate::consumers::await_reader;
use crate::robot::{MODEL, Robot, SECOND, SENSOR};
use crate::running::await_that;
use crate::world::open_model;

fn inspect(robot: &Robot, model: &str) -> Value {
    serde_json::from_str(&robot.succeed(&["inspect", model, "--json"])).unwrap()
}

#[test]
fn a_name_is_shown_wherever_its_kind_is_and_leaves_the_model_what_it_is() {
    let robot = Robot::trained();
    let id = open_model(&robot.path(MODEL)).id();
    let service = robot.serve();
    let note = ["name", MODEL, "3", "doorway", "--note", "and the lift"];
    assert_eq!(robot.succeed(&note), "kind 3 of m.kinds is doorway: and the lift\n");
    for kind in ["0", "1", "2", "4"] {
        robot.succeed(&["name", MODEL, kind, &format!("place {kind}")]);
    }
    assert_eq!(open_model(&robot.path(MODEL)).id(), id);

    let text = robot.succeed(&["inspect", MODEL]);
    assert!(
        text.lines().any(|line| line.starts_with("   3 ") && line.ends_with("doorway: and the lift")),
        "{text}"
    );
    let inspection = inspect(&robot, MODEL);
    let record = serde_json::json!({ "number": 3, "name": "doorway", "note": "and the lift" });
    assert_eq!((&inspection["kinds"][3], &inspection["retired"]), (&record, &serde_json::json!([])));

    // The service has the model in use since before its kinds had names.
    let watch = robot.start(&["watch", "--sensor", SENSOR, "--count", "130", "--model", MODEL]);
    await_reader(&robot, &watch, Purpose::Kinds);
    let consumer = robot.join();
    let reports = consumer.await_end_of(&mut robot.publish(SECOND, "max"));
    let outcome = watch.end();
    for (line, report) in outcome.stdout.lines().zip(&reports) {
        let name = if report.kind == 3 { "doorway".to_string() } else { format!("place {}", report.kind) };
        assert!(line.ends_with(&format!(" µs  {name}")), "{line}");
    }
    let last = reports.last().unwrap();
    // Told once a second.
    await_that(|| {
        let top = robot.succeed(&["top", "--once", "--json", "--model", MODEL]);
        let top: Value = serde_json::from_str(&top).unwrap();
        let health = &top["sensors"][0]["health"];
        health["kind"] == last.kind && health["kind_name"].is_string()
    });
    let text = robot.succeed(&["top", "--once", "--model", MODEL]);
    assert!(text.contains(&format!("  kind {} is ", last.kind)), "{text}");
    service.stop(Signal::TERM);

    assert_eq!(robot.succeed(&["name", MODEL, "3", "--clear"]), "kind 3 of m.kinds has no name\n");
    assert_eq!(inspect(&robot, MODEL)["kinds"][3]["name"], "");
}

#[test]
fn names_that_cannot_be_are_refused_in_words() {
    let robot = Robot::trained();
    robot.refuse(
        &["name", MODEL, "5", "doorway"],
        2,
        "the model has no kind 5; it has kinds 0, 1, 2, 3 and 4",
    );
    let long = "x".repeat(41);
    robot.refuse(&["name", MODEL, "3", &long], 2, "the name has 41 characters; it may have 40");
    robot.refuse(&["name", MODEL, "3", "a\tb"], 2, "the name has the control character U+0009; leave it out");
    robot.refuse_with(&["name", MODEL, "3"], 2, &["required arguments"]);
    robot.refuse_with(&["name", "nowhere.kinds", "3", "doorway"], 1, &["no model at nowhere.kinds"]);
}

#[test]
fn watch_takes_the_kinds_most_alike_together_until_as_many_are_left_as_asked_for() {
    let robot = Robot::trained();
    let model = open_model(&robot.path(MODEL));
    let service = robot.serve();
    let watches: Vec<_> = ["1", "3", "9"]
        .map(|n| robot.start(&["watch", "--sensor", SENSOR, "--json", "--count", "130", "--kinds", n]))
        .into();
    for watch in &watches {
        await_reader(&robot, watch, Purpose::Kinds);
    }
    let reports = robot.join().await_end_of(&mut robot.publish(SECOND, "max"));
    for (n_groups, watch) in [1, 3, 5].into_iter().zip(watches) {
        let groups = model.merged(n_groups);
        let outcome = watch.end();
        assert_eq!(outcome.stdout.lines().count(), 130);
        for (line, report) in outcome.stdout.lines().zip(&reports) {
            let line: Value = serde_json::from_str(line).unwrap();
            for (field, of_kinds) in
                [("probabilities", report.probabilities()), ("filtered", report.filtered())]
            {
                let mut sums = vec![0.0; n_groups];
                groups.iter().zip(of_kinds).for_each(|(&group, probability)| sums[group] += probability);
                let found: Vec<f64> =
                    line[field].as_array().unwrap().iter().map(|sum| sum.as_f64().unwrap()).collect();
                // Read from text: the last digit may be missed.
                assert!(
                    found.len() == n_groups && found.iter().zip(&sums).all(|(a, b)| (a - b).abs() < 1e-15)
                );
            }
            let numbers: Vec<Vec<u64>> = serde_json::from_value(line["numbers"].clone()).unwrap();
            for (kind, &group) in groups.iter().enumerate() {
                assert!(numbers[group].contains(&(kind as u64)));
            }
        }
    }
    service.stop(Signal::TERM);
    robot.refuse_with(
        &["watch", "--sensor", SENSOR, "--kinds", "0"],
        2,
        &["invalid value '0' for '--kinds <N>'"],
    );
}
