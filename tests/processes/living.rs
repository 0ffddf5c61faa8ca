//! Living with kinds: what people call them, levels of fewer kinds, and further trips.

use kinds_messages::Purpose;
use kinds_model::Classifier;
use kinds_trips::Command;
use rustix::process::Signal;
use serde_json::Value;

use crate::consumers::await_reader;
use crate::robot::{FIRST, MODEL, Robot, SECOND, SENSOR, SIZE};
use crate::running::await_that;
use crate::world::{Trip, open_model, read_trip};

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

#[test]
fn further_trips_refine_a_model_whose_kinds_keep_numbers_and_names() {
    let robot = Robot::trained();
    robot.succeed(&["name", MODEL, "3", "doorway"]);
    let told = robot.succeed(&["update", MODEL, SECOND, "--output", "m2.kinds"]);
    let table: Vec<&str> = told.lines().skip_while(|line| !line.starts_with("kind  became ")).collect();
    assert!(table.len() > 6, "{told}");
    let updated = open_model(&robot.path("m2.kinds"));
    assert_eq!(updated.manifest().n_trained, 290);
    assert_eq!(updated.manifest().provenance.origin.trips, [FIRST, SECOND]);
    assert_eq!(
        table.last(),
        Some(&&*format!(
            "wrote m2.kinds ({:.1} MB, model {})",
            robot.read("m2.kinds").len() as f64 / 1e6,
            updated.id()
        ))
    );
    let records = updated.register().kinds().iter().chain(updated.register().retired());
    assert_eq!(records.filter(|record| record.name == "doorway").count(), 1);

    // The same again, for a script, onto the model itself.
    let json: Value =
        serde_json::from_str(&robot.succeed(&["update", MODEL, SECOND, "--output", MODEL, "--json"]))
            .unwrap();
    assert_eq!(robot.read(MODEL), robot.read("m2.kinds"), "the same model and trip make the same model");
    assert_eq!(json["after"], updated.id().to_string());
    let kinds = json["kinds"].as_array().unwrap();
    assert_eq!(kinds.iter().filter(|kind| kind["became"] != "retired").count(), 5);
    for kind in kinds.iter().filter(|kind| kind["became"] == "kept") {
        assert!(
            kind["number"].as_u64().unwrap() < 5 && kind["agreement"].as_f64().unwrap() >= 0.25,
            "{kind}"
        );
    }
    for kind in kinds.iter().filter(|kind| kind["became"] == "new") {
        assert!(kind["number"].as_u64().unwrap() >= 5, "{kind}");
    }
    // Served like any other.
    let service = robot.serve();
    let consumer = robot.join();
    let reports = consumer.await_end_of(&mut robot.publish(SECOND, "max"));
    let numbers: Vec<u32> = updated.register().kinds().iter().map(|record| record.number).collect();
    assert!(reports.iter().all(|report| report.numbers() == numbers && report.model_id == updated.id().0));
    service.stop(Signal::TERM);
}

#[test]
fn an_update_with_a_trip_that_is_known_says_so_and_keeps_all_numbers() {
    let robot = Robot::trained();
    let outcome = robot.run(&["update", MODEL, FIRST, "--output", "m2.kinds"]);
    assert_eq!(outcome.code, Some(0), "{outcome:?}");
    let told = "kinds: the model was learnt from a trip called first.mcap already; frames that are learnt twice count twice, and \
                others are sooner called novel";
    assert!(outcome.stderr.lines().any(|line| line == told), "{outcome:?}");
    let updated = open_model(&robot.path("m2.kinds"));
    let numbers: Vec<u32> = updated.register().kinds().iter().map(|record| record.number).collect();
    assert_eq!((&numbers[..], updated.register().retired().len()), (&[0, 1, 2, 3, 4][..], 0));
}

#[test]
fn updates_that_cannot_be_are_refused_in_words() {
    let robot = Robot::trained();
    Trip { n_readings: 8, ..Trip::SECOND }.write(&robot.path("other.mcap"));
    let update = |trip: &'static str, output: &'static str| ["update", MODEL, trip, "--output", output];
    robot.refuse(
        &update("other.mcap", "m2.kinds"),
        1,
        "trip other.mcap has frames of 8 readings (1 × 8) of 0.001 m a count; those of the model are of 16 readings (1 × 16) of \
         0.001 m a count; train one model for each sensor",
    );
    robot.refuse_with(&update("nowhere.mcap", "m2.kinds"), 1, &["nowhere.mcap"]);
    robot.refuse_with(&update(SECOND, "nowhere/m2.kinds"), 1, &["there is no folder nowhere; make it first"]);
    Trip { command: |place| Some(Command { forward_m_s: place, turn_rad_s: 0.1 }), ..Trip::FIRST }
        .write(&robot.path("told.mcap"));
    let train = ["train", "told.mcap", "--commands-weight", "0.1", "--output", "told.kinds"];
    robot.succeed(&[&train[..], &SIZE].concat());
    robot.refuse_with(
        &["update", "told.kinds", SECOND, "--output", "m2.kinds"],
        1,
        &["trip second.mcap has no commands to compare frames by: "],
    );
}

#[test]
fn drift_is_measured_against_training() {
    let robot = Robot::trained();
    robot.succeed(&["name", MODEL, "3", "doorway"]);
    let json: Value =
        serde_json::from_str(&robot.succeed(&["evaluate", MODEL, FIRST, SECOND, "--json"])).unwrap();
    let model = open_model(&robot.path(MODEL));
    let drift = &json["spaces"][0]["drift"];
    let number = |value: &Value| value.as_f64().unwrap();
    let mut classifier = Classifier::new(model.clone().into());
    let (mut sums, mut n_novel, frames) = (vec![0.0; 5], 0, read_trip(&robot.path(SECOND)));
    let mut errors = Vec::new();
    for (_, counts) in &frames {
        let found = classifier.classify(counts);
        sums.iter_mut().zip(&found.probabilities).for_each(|(sum, probability)| *sum += probability);
        n_novel += usize::from(found.novelty >= 0.99);
        errors.push(classifier.half_split_error().unwrap());
    }
    errors.sort_by(f64::total_cmp);
    let (error, usual) = (errors[65], model.manifest().half_split.unwrap().usual);
    let weights = model.mixture().weights();
    let shares: Vec<f64> = sums.iter().map(|sum| sum / 130.0).collect();
    let apart: f64 = shares.iter().zip(weights).map(|(share, weight)| (share - weight).abs()).sum();
    assert_eq!(number(&drift[1]["novel_usual"]), 0.01);
    assert!((number(&drift[1]["novel"]) - n_novel as f64 / 130.0).abs() < 1e-12);
    assert!((number(&drift[1]["total_variation"]) - apart / 2.0).abs() < 1e-12);
    // Of the trip that it was learnt from, but for the last step of learning.
    assert!(number(&drift[0]["total_variation"]) < 0.01, "{drift}");
    assert_eq!((number(&drift[1]["half_split"]), number(&drift[1]["half_split_usual"])), (error, usual));
    // Trained frames have themselves for a neighbour, which no second trip has.
    assert!(number(&drift[0]["half_split"]) < 0.5 * usual, "{drift}");
    let told = format!(
        "second: {:.1} % of the frames are novel, where 1 % is usual; kinds have other shares than in training for {:.1} % of \
         them; halves of a frame's neighbours place it {:.1} % apart, where {:.1} % is usual",
        100.0 * n_novel as f64 / 130.0,
        50.0 * apart,
        100.0 * error,
        100.0 * usual
    );
    let text = robot.succeed(&["evaluate", MODEL, FIRST, SECOND, "--report", "report"]);
    assert!(text.lines().any(|line| line == told), "no {told:?} in {text}");
    let page = String::from_utf8(robot.read("report/report.html")).unwrap();
    assert!(page.contains(">kind 3 (doorway)</text>"));
    let row = format!("<td>second</td><td class=\"number\">{:.1} %</td>", 100.0 * n_novel as f64 / 130.0);
    assert!(page.contains("Drift since training") && page.contains(&row), "no {row}");
}
