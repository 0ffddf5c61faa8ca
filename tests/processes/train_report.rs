//! The report that training leaves, and what is learnt by both methods side by side.

use std::path::PathBuf;
use std::sync::Arc;

use kinds_model::{Classifier, Model};
use serde_json::Value;

use crate::robot::{FIRST, MODEL, Robot, SECOND, SIZE};
use crate::world::{Trip, open_model, read_trip};

/// A robot with two trips and no model.
fn recorded(first: Trip) -> Robot {
    let robot = Robot::new();
    first.write(&robot.path(FIRST));
    Trip::SECOND.write(&robot.path(SECOND));
    robot
}

/// The report's files, by their names.
fn names(robot: &Robot) -> Vec<String> {
    let files = robot.files().into_keys();
    files.filter_map(|path| Some(path.strip_prefix("report").ok()?.to_str()?.to_string())).collect()
}

fn text(robot: &Robot, name: &str) -> String {
    String::from_utf8(robot.read(name)).unwrap()
}

/// The kinds of a trip's frames, classified here.
fn classified(model: &Model, trip: PathBuf) -> Vec<usize> {
    let mut classifier = Classifier::new(Arc::new(model.clone()));
    read_trip(&trip).iter().map(|(_, counts)| classifier.classify(counts).kind).collect()
}

#[test]
fn a_report_is_a_page_with_every_figure_and_the_kinds_of_every_trip_on_the_path() {
    let robot = recorded(Trip::FIRST);
    // Whether or not the model keeps every frame.
    for n_frames in ["4000", "100"] {
        check_report(&robot, n_frames);
    }
}

fn check_report(robot: &Robot, n_frames: &str) {
    let train = ["train", FIRST, SECOND, "--output", MODEL, "--report", "new/report", "--frames", n_frames];
    let told = robot.succeed(&[&train[..], &SIZE].concat());
    assert_eq!(told.lines().last(), Some("wrote new/report/report.html"));
    let figures =
        ["canonical-views", "embedding", "kinds-merged", "path", "residual-variance", "spectrum", "time"];
    let expected = figures.iter().flat_map(|name| [format!("{name}.csv"), format!("{name}.svg")]);
    let mut expected: Vec<String> = expected.chain(["report.html".to_string()]).collect();
    expected.sort();
    let mut found: Vec<String> = std::fs::read_dir(robot.path("new/report"))
        .unwrap()
        .map(|entry| entry.unwrap().file_name().into_string().unwrap())
        .collect();
    found.sort();
    assert_eq!(found, expected);

    let page = text(robot, "new/report/report.html");
    assert!(page.contains("<h1>Natural kinds: first, second</h1>"));
    let model = open_model(&robot.path(MODEL));
    let kinds = [FIRST, SECOND].map(|trip| classified(&model, robot.path(trip)));
    let rows: Vec<(String, String)> = text(robot, "new/report/path.csv")
        .lines()
        .skip(1)
        .map(|line| line.split(',').collect::<Vec<_>>())
        .map(|cells| (cells[0].to_string(), cells[4].to_string()))
        .collect();
    let of = |title: &str, kinds: &[usize]| -> Vec<(String, String)> {
        kinds.iter().map(|kind| (title.to_string(), kind.to_string())).collect()
    };
    assert_eq!(rows, [of("first", &kinds[0]), of("second", &kinds[1])].concat());
}

#[test]
fn a_report_on_a_trip_without_poses_says_so_instead_of_a_map() {
    let robot = recorded(Trip { poses_topics: &[], ..Trip::FIRST });
    robot.succeed(&[&["train", FIRST, "--output", MODEL, "--report", "report"][..], &SIZE].concat());
    assert!(!names(&robot).contains(&"path.svg".to_string()));
    assert!(
        text(&robot, "report/report.html")
            .contains("Nobody knows where the robot was: there is no map without nav_msgs/msg/Odometry or geometry_msgs/msg/PoseStamped.")
    );
}

#[test]
fn a_place_where_no_report_can_be_is_found_out_before_the_work() {
    let robot = recorded(Trip::FIRST);
    for (place, sentence) in [
        (FIRST, "cannot write report into first.mcap: it is not a folder"),
        (
            "first.mcap/deep/report",
            "cannot write report into first.mcap/deep/report: first.mcap is not a folder",
        ),
    ] {
        robot.refuse(&["train", SECOND, "--output", MODEL, "--report", place], 1, sentence);
    }
}

#[test]
fn a_report_that_cannot_be_written_leaves_the_model_and_the_report_that_was_there() {
    let robot = recorded(Trip::FIRST);
    std::fs::create_dir_all(robot.path("report/time.csv")).unwrap();
    robot.write("report/report.html", "an older report");
    robot.write("report/time.csv/of", "somebody else's");
    let train = ["train", FIRST, "--output", MODEL, "--report", "report"];
    let outcome = robot.run(&[&train[..], &SIZE].concat());
    assert_eq!(
        (outcome.code, outcome.stderr.as_str()),
        (Some(1), "kinds: cannot write report/time.csv: it is a folder\n")
    );
    let model = open_model(&robot.path(MODEL));
    let wrote = outcome.stdout.lines().last().unwrap();
    assert!(wrote.ends_with(&format!("model {})", model.id())), "{wrote}");
    assert_eq!(names(&robot), ["report.html", "time.csv/of"]);
    assert_eq!(text(&robot, "report/report.html"), "an older report");
}

fn inspect(robot: &Robot, model: &str) -> Value {
    serde_json::from_str(&robot.succeed(&["inspect", model, "--json"])).unwrap()
}

#[test]
fn both_methods_make_a_model_each_of_their_own_size_and_one_of_the_same() {
    let robot = recorded(Trip::FIRST);
    // The scale is given: each method might choose its own.
    let train = |flags: &[&str]| {
        robot.succeed(&[&["train", FIRST, "--neighbors", "8", "--response", "inverse"], flags].concat())
    };
    robot.write("both.ron", "(method: both)");
    let told = train(&["--config", "both.ron", "--output", "new.v2.kinds", "--report", "report"]);
    // Each is what a training of its own makes.
    train(&["--output", "isomap.kinds"]);
    train(&["--method", "pca", "--output", "pca.kinds"]);
    assert!(robot.read("new.v2.kinds") == robot.read("isomap.kinds"));
    assert!(robot.read("new.v2.pca.kinds") == robot.read("pca.kinds"));
    let models = ["new.v2.kinds", "new.v2.pca.kinds", "new.v2.pca-matched.kinds"]
        .map(|name| open_model(&robot.path(name)));
    let size = |model: &Model| (model.manifest().n_dims, model.mixture().n_kinds());
    let (n_dims, n_kinds) = (size(&models[0]).0.to_string(), size(&models[0]).1.to_string());
    let matched = ["--method", "pca", "--dims", &n_dims, "--kinds", &n_kinds];
    train(&[&matched[..], &["--output", "matched.kinds"]].concat());
    assert!(robot.read("new.v2.pca-matched.kinds") == robot.read("matched.kinds"));
    assert_eq!(inspect(&robot, "new.v2.pca-matched.kinds")["plan"]["method"], "Pca");

    let learnt: Vec<&str> = told.lines().filter(|line| line.starts_with("learnt ")).collect();
    assert_eq!(learnt.len(), 3, "{told}");
    for (line, name) in learnt.iter().zip(["Isomap", "principal components", "principal components"]) {
        assert!(line.contains(&format!(" readings: {name} of ")), "{line}");
    }
    for name in ["new.v2.kinds", "new.v2.pca.kinds", "new.v2.pca-matched.kinds"] {
        assert!(told.lines().any(|line| line.starts_with(&format!("wrote {name} ("))), "no {name} in {told}");
    }
    let page = text(&robot, "report/report.html").replace('\u{a0}', " ");
    for (name, model) in ["Isomap", "PCA", "PCA of Isomap's size"].iter().zip(&models) {
        let (n_dims, n_kinds) = size(model);
        let row = format!(
            "<tr><td>{name}</td><td class=\"number\">16</td><td class=\"number\">{n_dims}</td><td class=\"number\">{n_kinds}</td>"
        );
        assert!(page.replace("&#39;", "'").contains(&row), "no {row} in the report");
    }
    assert!(text(&robot, "report/residual-variance.csv").contains("\nPCA,1,"));
    assert!(text(&robot, "report/residual-variance.csv").contains("\nIsomap,1,"));
}

#[test]
fn both_methods_say_how_alike_their_kinds_are() {
    let robot = recorded(Trip::FIRST);
    let told = robot.succeed(&[&["train", FIRST, "--method", "both", "--output", MODEL][..], &SIZE].concat());
    let models = [MODEL, "m.pca.kinds", "m.pca-matched.kinds"].map(|name| open_model(&robot.path(name)));
    let [isomap, own, matched] = models.each_ref().map(|model| classified(model, robot.path(FIRST)));
    let agreement = |kinds: &[usize]| {
        let pairs: Vec<(usize, usize)> = isomap.iter().copied().zip(kinds.iter().copied()).collect();
        kinds_trainer::adjusted_mutual_information(&pairs)
    };
    let expected = format!(
        "principal components' kinds of these frames agree with Isomap's (adjusted mutual information): {:.2} at 8 dimensions \
         and 5 kinds, {:.2} at 8 dimensions and 5 kinds",
        agreement(&own),
        agreement(&matched)
    );
    assert_eq!(told.lines().last(), Some(expected.as_str()));
}

#[test]
fn where_there_are_fewer_principal_components_than_isomap_has_dimensions_there_is_a_remark_or_a_sentence() {
    let robot = recorded(Trip { n_readings: 2, ..Trip::FIRST });
    let train = ["train", FIRST, "--method", "both", "--kinds", "2", "--output", MODEL];
    // What is asked for must be.
    let asked = [&train[..], &["--dims", "4"]].concat();
    let parts = ["cannot train by principal components beside Isomap: ", "; ask for one method"];
    robot.refuse_with(&asked, 1, &parts);
    // What comes of the evidence need not.
    let outcome = robot.run(&[&train[..], &["--report", "report"]].concat());
    assert_eq!(outcome.code, Some(0), "{outcome:?}");
    assert!(open_model(&robot.path(MODEL)).manifest().n_dims > 2, "{outcome:?}");
    let beginning = "kinds: principal components: none are of Isomap's size: ";
    assert!(outcome.stderr.lines().any(|line| line.starts_with(beginning)), "{outcome:?}");
    assert_eq!(open_model(&robot.path("m.pca.kinds")).manifest().n_kinds, 2);
    assert!(!robot.path("m.pca-matched.kinds").exists());
    let page = text(&robot, "report/report.html");
    assert!(page.contains("<td>PCA</td>") && !page.contains("PCA of Isomap"));
}

#[test]
fn a_second_model_that_cannot_be_written_is_found_out_before_the_work() {
    let robot = recorded(Trip::FIRST);
    std::fs::create_dir(robot.path("m.pca.kinds")).unwrap();
    robot.refuse(
        &["train", FIRST, "--method", "both", "--output", MODEL],
        1,
        "cannot write model m.pca.kinds: it is a folder",
    );
}

#[test]
fn kinds_of_every_shape_can_be_asked_for_by_flag_and_by_file() {
    let robot = recorded(Trip::FIRST);
    let size = ["--dims", "3", "--kinds", "3"];
    for (name, shape) in
        [("full", "Full"), ("tied", "Tied"), ("diagonal", "Diagonal"), ("spherical", "Spherical")]
    {
        robot.write("shape.ron", format!("(covariance: {name})"));
        robot.succeed(
            &[&["train", FIRST, "--output", "flag.kinds", "--covariance", name][..], &size].concat(),
        );
        let file = ["train", FIRST, "--output", "file.kinds", "--config", "shape.ron", "--report", "report"];
        robot.succeed(&[&file[..], &size].concat());
        assert!(robot.read("flag.kinds") == robot.read("file.kinds"), "{name}");
        assert_eq!(inspect(&robot, "flag.kinds")["plan"]["em"]["covariance"], shape);
        assert!(text(&robot, "report/report.html").contains(&format!("({name} covariances)")), "{name}");
    }
}
