//! `kinds evaluate` on the made-up trips that the repository carries.

use serde_json::Value;

use crate::robot::{FIRST, MODEL, Robot, SECOND, SIZE};
use crate::world::{Trip, told_along_the_loop};

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
    // The first four are of the first pair, as scripts know them from when there were only two trips.
    let expected = [
        "grid",
        "method",
        "methods",
        "not_compared",
        "pairs",
        "radius_m",
        "remarks",
        "revisited",
        "segmentation",
        "share",
        "spaces",
    ];
    assert_eq!(fields(&evaluation), expected);
    let pair = &evaluation["pairs"][0];
    assert_eq!(pair["trips"], serde_json::json!(["ring1", "ring2"]));
    for field in ["methods", "radius_m", "revisited", "share"] {
        assert_eq!(evaluation[field], pair["forward"][field], "{field}");
    }
    let never = pair["forward"]["never_revisited"].as_f64().unwrap();
    assert!((never + evaluation["revisited"].as_f64().unwrap() - 1.0).abs() < 1e-12);
    assert_ne!(pair["backward"]["methods"], pair["forward"]["methods"]);
    let grid = &evaluation["grid"];
    assert_eq!((grid["radii_m"][19].as_f64(), grid["shares"].as_array().unwrap().len()), (Some(0.6), 20));
    // The surface goes through the scores: radius 0.3 m and half, but for the number of shifts by chance.
    let surface = &pair["forward"]["surfaces"]["isomap"];
    assert_eq!(surface["consistency"][9][10], evaluation["methods"]["isomap"]["consistency"]);
    let spaces = &evaluation["spaces"][0];
    assert_eq!(spaces["sequences"][1]["trip"], "ring2");
    assert!(!spaces["map"]["regions"].as_array().unwrap().is_empty());
    assert_eq!(spaces["policy"]["kinds"].as_array().unwrap().len(), 5);
    assert_eq!((&evaluation["radius_m"], &evaluation["share"]), (&0.3.into(), &0.5.into()));
    let revisited = evaluation["revisited"].as_f64().unwrap();
    assert!((0.9..=1.0).contains(&revisited), "{revisited}");
    let methods = &evaluation["methods"];
    assert_eq!(fields(methods), ["isomap", "pca", "random"]);
    for (name, n_dims) in [("isomap", 8), ("pca", 8), ("random", 0)] {
        let scores = &methods[name];
        assert_eq!(
            fields(scores),
            [
                "ami",
                "area",
                "chance",
                "chance_area",
                "confidence",
                "consistency",
                "kappa",
                "largest_kind_share",
                "n_dims",
                "n_kinds"
            ]
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
    let names: Vec<&str> = told.lines().skip(3).take(4).filter_map(|line| line.split(' ').next()).collect();
    assert_eq!(names, ["Isomap", "PCA", "native", "random"], "{told}");
}

#[test]
fn a_model_of_either_method_is_compared_with_the_other() {
    let robot = Robot::new();
    train(&robot, "isomap");
    let isomap = evaluate(&robot, &[]);
    train(&robot, "pca");
    let pca = evaluate(&robot, &[]);
    assert_eq!(isomap["methods"], pca["methods"]);
    assert_eq!((&isomap["method"], &pca["method"]), (&"isomap".into(), &"pca".into()));
}

#[test]
fn a_model_of_more_dimensions_than_there_are_principal_components_is_evaluated_without_them() {
    let robot = Robot::new();
    Trip { n_readings: 2, ..Trip::FIRST }.write(&robot.path(FIRST));
    Trip { n_readings: 2, ..Trip::SECOND }.write(&robot.path(SECOND));
    robot.succeed(&["train", FIRST, "--output", MODEL, "--dims", "4", "--kinds", "3"]);
    let outcome = robot.run(&["evaluate", MODEL, FIRST, SECOND, "--report", "report"]);
    assert_eq!(outcome.code, Some(0), "{outcome:?}");
    let names: Vec<&str> =
        outcome.stdout.lines().skip(3).take(2).filter_map(|line| line.split(' ').next()).collect();
    assert_eq!(names, ["Isomap", "random"], "{outcome:?}");
    let remark = "kinds are not compared with those of principal components: the 160 landmarks span 2 dimensions and 4 were asked \
                  for: their frames are too much alike; ask for fewer dimensions or record a trip that sees more";
    assert!(outcome.stderr.lines().any(|line| line == format!("kinds: {remark}")), "{outcome:?}");
    let page = String::from_utf8(robot.read("report/report.html")).unwrap();
    assert!(page.contains(&format!("<li>{remark}</li>")) && !page.contains("PCA"), "{page}");
    let json = robot.succeed(&["evaluate", MODEL, FIRST, SECOND, "--json"]);
    let evaluation: Value = serde_json::from_str(&json).unwrap();
    assert_eq!(evaluation["remarks"], serde_json::json!([remark]));
    assert_eq!(fields(&evaluation["methods"]), ["isomap", "random"]);
    let forward = &evaluation["pairs"][0]["forward"];
    assert_eq!(
        (fields(&forward["surfaces"]), &forward["kappa_lead"]),
        (vec!["isomap", "random"], &Value::Null)
    );
}

#[test]
fn a_trip_against_itself_is_wholly_consistent_at_radius_0() {
    let robot = Robot::new();
    train(&robot, "isomap");
    let arguments = ["evaluate", MODEL, DEMO[0], DEMO[0], "--radius-m", "0", "--json"];
    let evaluation: Value = serde_json::from_str(&robot.succeed(&arguments)).unwrap();
    assert_eq!(evaluation["revisited"], 1.0);
    // Random kinds are drawn anew for either.
    for method in ["isomap", "pca"] {
        assert_eq!(evaluation["methods"][method]["consistency"], 1.0, "{method}");
    }
    assert_eq!(evaluation["grid"]["radii_m"], serde_json::json!([0.0]));
}

#[test]
fn a_place_seen_from_the_other_side_does_not_count_when_headings_matter() {
    let robot = Robot::trained();
    let revisited = |flags: &[&str]| {
        let arguments = [&["evaluate", MODEL, FIRST, SECOND, "--json"], flags].concat();
        let evaluation: Value = serde_json::from_str(&robot.succeed(&arguments)).unwrap();
        evaluation["revisited"].as_f64().unwrap()
    };
    // The loop is driven in one direction, its heading turning with the place.
    assert_eq!(revisited(&["--heading-deg", "180"]), revisited(&[]));
    assert!(revisited(&["--heading-deg", "1"]) < revisited(&[]));
}

/// A robot with two trips whose driver's commands are known, and their model.
fn commanded() -> Robot {
    let robot = Robot::new();
    Trip { command: told_along_the_loop, ..Trip::FIRST }.write(&robot.path(FIRST));
    Trip { command: told_along_the_loop, ..Trip::SECOND }.write(&robot.path(SECOND));
    robot.succeed(&[&["train", FIRST, "--output", MODEL][..], &SIZE].concat());
    robot
}

#[test]
fn a_report_has_every_figure_with_its_numbers_and_the_map_for_other_programs() {
    let robot = commanded();
    Trip { x_m: 50.0, ..Trip::FIRST }.write(&robot.path("far1.mcap"));
    Trip { x_m: 50.0, ..Trip::SECOND }.write(&robot.path("far2.mcap"));
    robot.write(
        "names.csv",
        "trip,from_s,to_s,name\nfirst,0,8,\"hall, front\"\nsecond,0,6,\"hall, front\"\nsecond,6,13,door\n",
    );
    let elsewhere =
        ["--elsewhere", "far1.mcap", "far2.mcap", "--report", "new/report", "--segments", "names.csv"];
    let told = robot.succeed(&[&["evaluate", MODEL, FIRST, SECOND][..], &elsewhere].concat());
    assert_eq!(told.lines().last(), Some("wrote new/report/report.html"), "{told}");
    assert!(told.contains("\nfar1 revisited by far2\n"), "{told}");
    assert!(told.contains("2 names for 210 frames: "), "{told}");
    let mut found: Vec<String> = std::fs::read_dir(robot.path("new/report"))
        .unwrap()
        .map(|entry| entry.unwrap().file_name().into_string().unwrap())
        .collect();
    found.sort();
    let in_each = [
        "consistency",
        "kinds-met",
        "map",
        "path",
        "registration",
        "run-lengths",
        "surfaces",
        "time",
        "transitions",
    ];
    // Nobody said what the robot was told elsewhere.
    let once = ["canonical-views", "commands", "embedding", "segmentation"].map(str::to_string);
    let both = in_each.iter().flat_map(|name| [name.to_string(), format!("{name}-elsewhere")]);
    let figures = both.chain(once).flat_map(|name| [format!("{name}.csv"), format!("{name}.svg")]);
    let maps = ["map", "map-elsewhere"]
        .into_iter()
        .flat_map(|name| [format!("{name}.dot"), format!("{name}.graphml")]);
    let mut expected: Vec<String> = figures.chain(maps).chain(["report.html".to_string()]).collect();
    expected.sort();
    assert_eq!(found, expected);
    let page = String::from_utf8(robot.read("new/report/report.html")).unwrap();
    assert!(
        !page.contains("<script") && !page.contains("http://")
            || page.matches("http://").count() == page.matches("http://www.w3.org/2000/svg").count()
    );
    let graph = String::from_utf8(robot.read("new/report/map.graphml")).unwrap();
    assert!(graph.contains("<graphml") && graph.contains("first, second"), "{graph}");
    // The same again is the same, byte for byte.
    let before = robot.files();
    robot.succeed(&[&["evaluate", MODEL, FIRST, SECOND][..], &elsewhere].concat());
    assert!(robot.files() == before);
}

#[test]
fn of_a_single_trip_there_are_map_sequence_and_policy_but_no_consistency() {
    let robot = commanded();
    let told = robot.succeed(&["evaluate", MODEL, FIRST, "--policy", "policy.ron"]);
    assert!(told.starts_with("first: the kind changed ") && told.ends_with("wrote policy.ron\n"), "{told}");
    let policy = String::from_utf8(robot.read("policy.ron")).unwrap();
    assert!(policy.contains("forward_m_s: 0.") && policy.contains("trips: [\"first\"]"), "{policy}");
    let single: Value = serde_json::from_str(&robot.succeed(&["evaluate", MODEL, FIRST, "--json"])).unwrap();
    assert_eq!(
        fields(&single),
        ["grid", "method", "not_compared", "pairs", "remarks", "segmentation", "spaces"]
    );
    assert_eq!(single["spaces"][0]["sequences"][0]["n_frames"], 160);
}

#[test]
fn what_cannot_be_made_of_the_trips_is_said_and_nothing_is_written() {
    let robot = Robot::trained();
    robot.refuse(
        &["evaluate", MODEL, FIRST, SECOND, "--policy", "policy.ron", "--report", "report"],
        1,
        "cannot write a policy: none of the trips (first, second) has commands, messages of type geometry_msgs/msg/Twist or \
         geometry_msgs/msg/TwistStamped; record what the robot is told, or name their topic with --commands-topic",
    );
    let segments = |name: &str| ["evaluate", MODEL, FIRST, SECOND, "--segments", name].map(str::to_string);
    let refuse = |name: &str, code, sentence: &str| {
        let arguments = segments(name);
        robot.refuse(&arguments.each_ref().map(String::as_str), code, sentence);
    };
    refuse("none.csv", 1, "cannot read none.csv: there is no such file or folder");
    refuse(
        "names.txt",
        2,
        "segments are names.txt; it must be a table, FILE.csv, or a list in RON, FILE.ron",
    );
    robot.write("names.csv", "trip,from_s,to_s,name\nfirst,0,3,hall\nfirst,2,4,door\n");
    refuse(
        "names.csv",
        1,
        "names.csv: line 3: the interval from 2 s overlaps that of line 2, which ends at 3 s; each time of a trip has one name",
    );
    robot.write("names.ron", "[(trip: \"third\", from_s: 0, to_s: 3, name: \"hall\")]");
    refuse(
        "names.ron",
        1,
        "names.ron: interval 1: there is no trip third; those that are evaluated are first, second",
    );
    robot.refuse(
        &["evaluate", MODEL, FIRST, "--region-m", "-1"],
        2,
        "region_m is -1; it must be at least 0 m",
    );
}
