//! What training depends on, and what `kinds inspect` says of its result.

use serde_json::Value;

use crate::robot::{FIRST, MODEL, Robot, SECOND};

fn inspect(robot: &Robot, model: &str) -> Value {
    serde_json::from_str(&robot.succeed(&["inspect", model, "--json"])).unwrap()
}

#[test]
fn the_same_trip_and_seed_give_the_same_bytes_and_another_seed_another_model() {
    let robot = Robot::trained();
    robot.succeed(&["train", FIRST, "--output", "again.kinds", "--seed", "0"]);
    assert!(robot.read("again.kinds") == robot.read(MODEL), "0 is the default seed");
    robot.succeed(&["train", FIRST, "--output", "other.kinds", "--seed", "1"]);
    assert_ne!(inspect(&robot, "other.kinds")["model_id"], inspect(&robot, MODEL)["model_id"]);
}

#[test]
fn configuration_and_flags_give_the_same_model_and_a_flag_overrides_a_field() {
    let robot = Robot::trained();
    robot.write(
        "config.ron",
        "// Everything that there is.\n(response: log, range_m_max: 5.0, invalid_range_m: 4.5, offset_m: 0.2, method: \
         pca, neighbors: 7, landmarks: 90, dims: 3, kinds: 4, starts: 2, covariance_floor: 0.01, seed: 3, \
         metres_per_count: 0.002, frames_topic: \"/ring\", poses_topic: \"/odom\")",
    );
    robot.succeed(&["train", FIRST, "--output", "file.kinds", "--config", "config.ron"]);
    #[rustfmt::skip]
    let flags = [
        "--response", "log", "--range-m-max", "5", "--invalid-range-m", "4.5", "--offset-m", "0.2", "--method", "pca",
        "--neighbors", "7", "--landmarks", "90", "--dims", "3", "--kinds", "4", "--starts", "2",
        "--covariance-floor", "0.01", "--seed", "3", "--metres-per-count", "0.002", "--frames-topic", "/ring",
        "--poses-topic", "/odom",
    ];
    robot.succeed(&[&["train", FIRST, "--output", "flags.kinds"][..], &flags].concat());
    assert!(robot.read("file.kinds") == robot.read("flags.kinds"));

    robot.succeed(&["train", FIRST, "--output", "over.kinds", "--config", "config.ron", "--kinds", "2"]);
    let plans =
        [inspect(&robot, "file.kinds"), inspect(&robot, "over.kinds")].map(|model| model["plan"].clone());
    let [file, over] = plans;
    assert_eq!((&file["em"]["n_kinds"], &over["em"]["n_kinds"]), (&4.into(), &2.into()));
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
    let told = robot.succeed(&["train", FIRST, SECOND, "--output", "both.kinds"]);
    let (learnt, wrote) = told.trim_end().split_once('\n').unwrap();
    let beginning = "learnt 5 kinds from 290 frames of 16 readings: Isomap of inverse ranges in 8 dimensions, residual \
                     variance 0.";
    assert!(learnt.starts_with(beginning), "{learnt}");
    let model = crate::world::open_model(&robot.path("both.kinds"));
    let n_mb = robot.read("both.kinds").len() as f64 / 1e6;
    assert_eq!(wrote, format!("wrote both.kinds ({n_mb:.1} MB, model {})", model.id()));
}

#[test]
fn inspect_says_what_is_in_a_model() {
    let robot = Robot::trained();
    let model = crate::world::open_model(&robot.path(MODEL));
    let inspection = inspect(&robot, MODEL);
    assert_eq!(inspection["model_id"], model.id().to_string());
    assert_eq!(inspection["format"], 1);
    assert_eq!(inspection["n_frames"], 160);
    assert_eq!(inspection["plan"]["em"]["n_kinds"], 5);
    assert_eq!(inspection["plan"]["n_dims"], 8);
    assert_eq!(inspection["provenance"]["origin"]["trips"], serde_json::json!([FIRST]));
    assert_eq!(inspection["weights"], serde_json::json!(model.mixture().weights()));

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
}
