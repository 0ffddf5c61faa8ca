//! `kinds evaluate` on the made-up trips that the repository carries.

use serde_json::Value;

use crate::robot::{MODEL, Robot, SIZE};

const DEMO: [&str; 2] = [
    concat!(env!("CARGO_MANIFEST_DIR"), "/tests/replay/ring1.mcap"),
    concat!(env!("CARGO_MANIFEST_DIR"), "/tests/replay/ring2.mcap"),
];

fn evaluate(robot: &Robot, flags: &[&str]) -> Value {
    let arguments = [&["evaluate", MODEL, DEMO[0], DEMO[1], "--json"], flags].concat();
    serde_json::from_str(&robot.succeed(&arguments)).unwrap()
}

fn train(robot: &Robot, method: &str) {
    robot.succeed(&[&["train", DEMO[0], "--output", MODEL, "--method", method][..], &SIZE].concat());
}

fn fields(value: &Value) -> Vec<&str> {
    value.as_object().unwrap().keys().map(String::as_str).collect()
}

#[test]
fn evaluation_has_the_fields_that_scripts_rely_on_and_kinds_are_better_than_chance() {
    let robot = Robot::new();
    train(&robot, "isomap");
    let evaluation = evaluate(&robot, &[]);
    assert_eq!(fields(&evaluation), ["methods", "radius_m", "revisited", "share"]);
    assert_eq!((&evaluation["radius_m"], &evaluation["share"]), (&0.3.into(), &0.5.into()));
    let revisited = evaluation["revisited"].as_f64().unwrap();
    assert!((0.9..=1.0).contains(&revisited), "{revisited}");
    let methods = &evaluation["methods"];
    assert_eq!(fields(methods), ["isomap", "pca", "random"]);
    for (name, n_dims) in [("isomap", 8), ("pca", 8), ("random", 0)] {
        let scores = &methods[name];
        assert_eq!(
            fields(scores),
            ["ami", "chance", "consistency", "kappa", "largest_kind_share", "n_dims", "n_kinds"]
        );
        assert_eq!((&scores["n_dims"], &scores["n_kinds"]), (&n_dims.into(), &5.into()));
        let share = |field: &str| scores[field].as_f64().unwrap();
        for field in ["chance", "consistency", "largest_kind_share"] {
            assert!((0.0..=1.0).contains(&share(field)), "{name}: {field} is {}", share(field));
        }
        let kappa = (share("consistency") - share("chance")) / (1.0 - share("chance"));
        assert!((share("kappa") - kappa).abs() < 1e-12, "{name}");
        match name {
            "random" => assert!(kappa.abs() < 0.05 && share("ami").abs() < 0.05, "{scores}"),
            _ => assert!(kappa > 0.3 && share("ami") > 0.3, "{name}: {scores}"),
        }
    }

    let flags = ["--radius-m", "0.5", "--share", "0.25", "--seed", "1"];
    let other = evaluate(&robot, &flags);
    assert_eq!((&other["radius_m"], &other["share"]), (&0.5.into(), &0.25.into()));
    assert_ne!(other["methods"]["random"]["consistency"], methods["random"]["consistency"]);
    assert_eq!(evaluate(&robot, &flags), other, "what is random depends on the seed alone");
}

#[test]
fn a_model_of_native_space_is_compared_with_both_methods_of_as_many_kinds() {
    let robot = Robot::new();
    let train = ["train", DEMO[0], "--output", MODEL, "--method", "native", "--kinds", "5"];
    robot.succeed(&train);
    let methods = &evaluate(&robot, &[])["methods"];
    assert_eq!(fields(methods), ["isomap", "native", "pca", "random"]);
    for method in ["isomap", "native", "pca", "random"] {
        assert_eq!(methods[method]["n_kinds"], 5, "{method}");
    }
    assert_eq!(
        (&methods["native"]["n_dims"], &methods["pca"]["n_dims"]),
        (&16.into(), &methods["isomap"]["n_dims"])
    );
    let told = robot.succeed(&["evaluate", MODEL, DEMO[0], DEMO[1]]);
    let names: Vec<&str> = told.lines().skip(3).filter_map(|line| line.split(' ').next()).collect();
    assert_eq!(names, ["Isomap", "PCA", "native", "random"], "{told}");
}

#[test]
fn a_model_of_either_method_is_compared_with_the_other() {
    let robot = Robot::new();
    train(&robot, "isomap");
    let isomap = evaluate(&robot, &[]);
    train(&robot, "pca");
    let pca = evaluate(&robot, &[]);
    assert_eq!(isomap, pca);
}
