//! What training depends on, and what `kinds inspect` says of its result.

use serde_json::Value;

use crate::robot::{FIRST, MODEL, Robot, SECOND, SIZE};

fn inspect(robot: &Robot, model: &str) -> Value {
    serde_json::from_str(&robot.succeed(&["inspect", model, "--json"])).unwrap()
}

#[test]
fn the_same_trip_and_seed_give_the_same_bytes_and_another_seed_another_model() {
    let robot = Robot::trained();
    let train = |output, seed| {
        robot.succeed(&[&["train", FIRST, "--output", output, "--seed", seed][..], &SIZE].concat());
    };
    train("again.kinds", "0");
    assert!(robot.read("again.kinds") == robot.read(MODEL), "0 is the default seed");
    train("other.kinds", "1");
    assert_ne!(inspect(&robot, "other.kinds")["model_id"], inspect(&robot, MODEL)["model_id"]);
}

#[test]
fn configuration_and_flags_give_the_same_model_and_a_flag_overrides_a_field() {
    let robot = Robot::trained();
    robot.write(
        "config.ron",
        "// Everything that there is.\n(response: log, range_m_max: 5.0, invalid_range_m: 4.5, offset_m: 0.2, method: \
         pca, neighbors: 7, landmarks: 90, dims: 3, kinds: 4, covariance: \
         tied, starts: 2, covariance_floor: 0.01, seed: 3, \
         metres_per_count: 0.002, frames_topic: \"/ring\", poses_topic: \"/odom\")",
    );
    robot.succeed(&["train", FIRST, "--output", "file.kinds", "--config", "config.ron"]);
    #[rustfmt::skip]
    let flags = [
        "--response", "log", "--range-m-max", "5", "--invalid-range-m", "4.5", "--offset-m", "0.2", "--method", "pca",
        "--neighbors", "7", "--landmarks", "90", "--dims", "3", "--kinds", "4", "--covariance", "tied", "--starts", "2",
        "--covariance-floor", "0.01", "--seed", "3", "--metres-per-count", "0.002", "--frames-topic", "/ring",
        "--poses-topic", "/odom",
    ];
    robot.succeed(&[&["train", FIRST, "--output", "flags.kinds"][..], &flags].concat());
    assert!(robot.read("file.kinds") == robot.read("flags.kinds"));

    robot.succeed(&["train", FIRST, "--output", "over.kinds", "--config", "config.ron", "--kinds", "2"]);
    let plans =
        [inspect(&robot, "file.kinds"), inspect(&robot, "over.kinds")].map(|model| model["plan"].clone());
    let [file, over] = plans;
    assert_eq!((&file["n_kinds"], &over["n_kinds"]), (&4.into(), &2.into()));
    for (name, value) in [
        ("method", "Pca".into()),
        ("n_neighbors", 7.into()),
        ("n_landmarks", 90.into()),
        ("n_dims", 3.into()),
        ("seed", Value::from(3)),
    ] {
        assert_eq!((&file[name], &over[name]), (&value, &value), "{name}");
    }
    assert_eq!(over["response"], file["response"]);
    assert_eq!(
        file["response"],
        serde_json::json!({"scale": "Log", "range_m_max": 5.0, "invalid_range_m": 4.5, "offset_m": 0.2})
    );
    assert_eq!(file["sensor"], serde_json::json!({"rows": 1, "columns": 16, "metres_per_count": 0.002}));
}

#[test]
fn training_says_what_was_learnt_and_where_it_is() {
    let robot = Robot::trained();
    let told = robot.succeed(&[&["train", FIRST, SECOND, "--output", "both.kinds"][..], &SIZE].concat());
    let (learnt, wrote) = told.trim_end().split_once('\n').unwrap();
    let beginning = "learnt 5 kinds from 290 frames of 16 readings: Isomap of inverse ranges in 8 dimensions, residual \
                     variance 0.";
    assert!(learnt.starts_with(beginning), "{learnt}");
    let model = crate::world::open_model(&robot.path("both.kinds"));
    let n_mb = robot.read("both.kinds").len() as f64 / 1e6;
    assert_eq!(wrote, format!("wrote both.kinds ({n_mb:.1} MB, model {})", model.id()));
    assert_eq!(
        inspect(&robot, "both.kinds")["provenance"]["origin"]["n_frames"],
        serde_json::json!([160, 130])
    );
}

#[test]
fn what_is_left_to_the_evidence_is_chosen_and_both_train_and_inspect_say_why() {
    let robot = Robot::trained();
    let outcome = robot.run(&["train", FIRST, "--output", "chosen.kinds", "--report", "report"]);
    assert_eq!(outcome.code, Some(0), "{outcome:?}");
    let inspection = inspect(&robot, "chosen.kinds");
    assert_eq!((&inspection["plan"]["n_dims"], &inspection["plan"]["n_kinds"]), (&Value::Null, &Value::Null));
    let provenance = &inspection["provenance"];
    let (n_dims, n_kinds, elbow) = (&inspection["n_dims"], &inspection["n_kinds"], &provenance["elbow"]);
    assert_eq!(n_dims.as_u64().unwrap(), elbow.as_u64().unwrap() + 2);
    let tried = provenance["kinds_tried"].as_array().unwrap();
    let mut by_bic_neff: Vec<(f64, &Value)> =
        tried.iter().map(|trial| (trial["bic_neff"].as_f64().unwrap(), &trial["n_kinds"])).collect();
    by_bic_neff.sort_by(|a, b| a.0.total_cmp(&b.0));
    let [(best, number), (second, runner_up), ..] = by_bic_neff[..] else { panic!("{tried:?}") };
    assert_eq!(number, n_kinds);
    let n_effective = provenance["n_frames_effective"].as_f64().unwrap();
    let report = String::from_utf8(robot.read("report/report.html")).unwrap();
    for line in [
        format!("dimensions: {n_dims}, the elbow of the residual variance at {elbow} and 2 more"),
        format!(
            "kinds: {n_kinds}, the least BIC_neff of 1 to {}: {best:.1} nats, {:.1} less than {runner_up} kinds; \
             160 frames count as {n_effective:.0} independent ones",
            tried.len(),
            second - best
        ),
    ] {
        assert!(outcome.stdout.lines().any(|found| found == line), "no {line:?} in {}", outcome.stdout);
        assert!(report.contains(&format!("<li>{line}</li>")), "no {line:?} in the report");
    }

    let text = robot.succeed(&["inspect", "chosen.kinds"]);
    let beginning =
        format!("dimensions   {n_dims}, by evidence: elbow at {elbow}; residual variance of 1, 2, …: ");
    assert!(text.lines().any(|line| line.starts_with(&beginning)), "{text}");
    let beginning = format!("kinds        {n_kinds}, by evidence; log-likelihood ");
    assert!(text.lines().any(|line| line.starts_with(&beginning)), "{text}");
    let (_, curve) =
        text.split_once("\nkinds tried        BIC         CAIC     BIC_neff   held out\n").unwrap();
    assert_eq!(curve.lines().count(), tried.len());
    for (line, trial) in curve.lines().zip(tried) {
        let numbers: Vec<&str> =
            line.split(|c: char| " *←".contains(c)).filter(|word| !word.is_empty()).collect();
        let number = |field: &str, n_digits: usize| format!("{:.n_digits$}", trial[field].as_f64().unwrap());
        let expected = [
            number("n_kinds", 0),
            number("bic", 1),
            number("caic", 1),
            number("bic_neff", 1),
            number("held_out", 3),
        ];
        assert_eq!(numbers, expected);
        assert_eq!(line.ends_with(" ←"), trial["n_kinds"] == *n_kinds, "{line}");
    }
}

#[test]
fn inspect_says_what_is_in_a_model() {
    let robot = Robot::trained();
    let model = crate::world::open_model(&robot.path(MODEL));
    let inspection = inspect(&robot, MODEL);
    assert_eq!(inspection["model_id"], model.id().to_string());
    assert_eq!(inspection["format"], 1);
    assert_eq!(inspection["n_frames"], 160);
    assert_eq!((&inspection["n_dims"], &inspection["n_kinds"]), (&8.into(), &5.into()));
    assert_eq!((&inspection["plan"]["n_dims"], &inspection["plan"]["n_kinds"]), (&8.into(), &5.into()));
    assert_eq!(inspection["provenance"]["kinds_tried"], serde_json::json!([]));
    assert_eq!(inspection["provenance"]["origin"]["trips"], serde_json::json!([FIRST]));
    // Numbers are printed with all their digits; what reads them here may miss the last one.
    let weights = inspection["weights"].as_array().unwrap();
    assert_eq!(weights.len(), 5);
    for (found, weight) in weights.iter().zip(model.mixture().weights()) {
        assert!((found.as_f64().unwrap() - weight).abs() < 1e-15, "{found} {weight}");
    }

    let text = robot.succeed(&["inspect", MODEL]);
    for line in [
        &format!("model        {}", model.id()),
        "learnt from  first.mcap",
        "sensor       16 readings (1 × 16) of 0.001 m a count",
        "frames       160 reference frames; 0 without any valid reading left out",
        "method       Isomap: 10 neighbours, 160 landmarks",
        "kind  weight",
    ] {
        assert!(text.lines().any(|found| found == line), "no {line:?} in {text}");
    }
    assert!(
        text.lines().any(|line| line.starts_with("kinds        5, as asked for; log-likelihood ")),
        "{text}"
    );
    assert!(!text.contains("kinds tried"), "{text}");
}
