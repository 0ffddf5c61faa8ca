//! What training depends on, and what `kinds inspect` says of its result.

use rustix::process::Signal;
use serde_json::Value;

use crate::robot::{FIRST, MODEL, Robot, SECOND, SIZE};
use crate::world::{Trip, assert_reports_equal_classifying_here};

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
        "// Everything that there is.\n(response: log, range_m_max: 5.0, invalid_range_m: 4.5, offset_m: 0.2, metric: rings(2), method: \
         pca, frames: 80, neighbors: 7, consecutive_edges: true, landmarks: \"75%\", landmark_choice: farthest, dims: 3, kinds: 4, covariance: \
         tied, starts: 2, starts_on: both, covariance_floor: 0.01, over_time: true, seed: 3, \
         metres_per_count: 0.002, frames_topic: \"/ring\", poses_topic: \"/odom\")",
    );
    robot.succeed(&["train", FIRST, "--output", "file.kinds", "--config", "config.ron"]);
    #[rustfmt::skip]
    let flags = [
        "--response", "log", "--range-m-max", "5", "--invalid-range-m", "4.5", "--offset-m", "0.2", "--metric", "rings:2", "--method", "pca",
        "--frames", "80", "--neighbors", "7", "--consecutive-edges", "--landmarks", "75%", "--landmark-choice", "farthest", "--dims", "3", "--kinds", "4",
        "--covariance", "tied", "--starts", "2", "--starts-on", "both",
        "--covariance-floor", "0.01", "--over-time", "--seed", "3", "--metres-per-count", "0.002", "--frames-topic", "/ring",
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
        ("n_frames_max", 80.into()),
        ("n_neighbors", 7.into()),
        ("consecutive_edges", true.into()),
        ("n_landmarks", 60.into()),
        ("landmark_choice", "Farthest".into()),
        ("n_dims", 3.into()),
        ("seed", Value::from(3)),
    ] {
        assert_eq!((&file[name], &over[name]), (&value, &value), "{name}");
    }
    assert_eq!(over["response"], file["response"]);
    assert_eq!(file["metric"], serde_json::json!({"Ring": {"n_rings": 2}}));
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
    let [learnt, compared, wrote] = told.lines().collect::<Vec<_>>()[..] else { panic!("{told}") };
    assert!(compared.starts_with("compared by: inverse ranges; kinds last "), "{compared}");
    let beginning = "learnt 5 kinds from 290 frames of 16 readings: Isomap of inverse ranges in 8 \
                     dimensions, residual variance 0.";
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
fn a_trip_longer_than_the_model_may_hold_is_thinned_and_both_train_and_inspect_say_so() {
    let robot = Robot::trained();
    let thin = ["train", FIRST, SECOND, "--output", "thin.kinds", "--frames", "100", "--consecutive-edges"];
    let told = robot.succeed(&[&thin[..], &SIZE].concat());
    assert!(told.starts_with("learnt 5 kinds from 290 frames of 16 readings: "), "{told}");
    let inspection = inspect(&robot, "thin.kinds");
    assert_eq!((&inspection["n_trained"], &inspection["n_frames"]), (&290.into(), &100.into()));
    let radius = inspection["provenance"]["covering_radius"].as_f64().unwrap();
    assert!(radius > 0.0);
    let line = format!(
        "reference frames: kept 100 of 290 frames, each of which is within {radius:.0} counts of one; kinds are learnt from all"
    );
    assert!(told.lines().any(|found| found == line), "no {line:?} in {told}");
    let text = robot.succeed(&["inspect", "thin.kinds"]);
    for line in [
        format!(
            "frames       100 reference frames of 290 that it was learnt from, each within {radius:.0} counts of one; 0 \
             without any valid reading left out"
        ),
        "method       Isomap: 10 neighbours and those before and after in time, 100 landmarks".to_string(),
    ] {
        assert!(text.lines().any(|found| found == line), "no {line:?} in {text}");
    }
    let scores: Value =
        serde_json::from_str(&robot.succeed(&["evaluate", "thin.kinds", FIRST, SECOND, "--json"])).unwrap();
    let methods = &scores["methods"];
    assert_eq!(methods["isomap"]["n_kinds"], methods["pca"]["n_kinds"]);
}

#[test]
fn what_is_left_to_the_evidence_is_chosen_and_both_train_and_inspect_say_why() {
    let robot = Robot::trained();
    let outcome = robot.run(&["train", FIRST, "--output", "chosen.kinds", "--report", "report"]);
    assert_eq!(outcome.code, Some(0), "{outcome:?}");
    let inspection = inspect(&robot, "chosen.kinds");
    for asked in ["n_neighbors", "n_dims", "n_kinds"] {
        assert_eq!(inspection["plan"][asked], Value::Null, "{asked}");
    }
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
    let within = &provenance["n_dims_within_tolerance"];
    let estimate = |name: &str| provenance["intrinsic_dims"][name].as_f64().unwrap();
    let intrinsic = format!(
        "{:.1} by two nearest neighbours, {:.1} by maximum likelihood",
        estimate("two_nn"),
        estimate("maximum_likelihood")
    );
    for line in [
        format!(
            "dimensions: {n_dims}, the elbow of the residual variance at {elbow} and 2 more; within 0.01 of the least from \
             {within} on"
        ),
        format!("intrinsic dimension: {intrinsic}"),
        format!(
            "kinds: {n_kinds}, the least BIC_neff of 4 to {}: {best:.1} nats, {:.1} less than {runner_up} kinds; \
             160 frames count as {n_effective:.0} independent ones",
            tried.len(),
            second - best
        ),
    ] {
        assert!(outcome.stdout.lines().any(|found| found == line), "no {line:?} in {}", outcome.stdout);
        assert!(report.contains(&format!("<li>{line}</li>")), "no {line:?} in the report");
    }

    let text = robot.succeed(&["inspect", "chosen.kinds"]);
    let beginning = format!(
        "dimensions   {n_dims}, by evidence: elbow at {elbow}, within the tolerance from {within}; residual variance of 1, 2, …: "
    );
    assert!(text.lines().any(|line| line.starts_with(&beginning)), "{text}");
    assert!(text.lines().any(|line| line == format!("intrinsic    {intrinsic}")), "{text}");
    let beginning = format!("kinds        {n_kinds}, by evidence; log-likelihood ");
    assert!(text.lines().any(|line| line.starts_with(&beginning)), "{text}");
    let (_, curve) = text
        .split_once("\nkinds tried        BIC         CAIC     BIC_neff   held out   starts given up\n")
        .unwrap();
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
            number("n_starts_collapsed", 0),
        ];
        assert_eq!(numbers, expected);
        assert_eq!(line.ends_with(" ←"), trial["n_kinds"] == *n_kinds, "{line}");
    }
}

/// What decides between numbers of kinds, of a trial: higher is better.
type Merit = fn(&Value) -> f64;

#[test]
fn what_the_number_of_kinds_is_chosen_by_can_be_asked_for_by_flag_and_by_file() {
    let robot = Robot::trained();
    let held_out: Merit = |trial| trial["held_out"].as_f64().unwrap();
    let lower_bound: Merit = |trial| trial["lower_bound"].as_f64().unwrap();
    for (flag, field, plan, trials, merit) in [
        ("held-out", "held_out", "HeldOut", "/provenance/kinds_tried", held_out),
        ("dirichlet", "dirichlet", "Dirichlet", "/provenance/dirichlet/trials", lower_bound),
    ] {
        let size = ["--neighbors", "10", "--dims", "3"];
        let train = ["train", FIRST, "--output", "flag.kinds", "--kinds-by", flag, "--report", "report"];
        let told = robot.succeed(&[&train[..], &size].concat());
        robot.write("by.ron", format!("(kinds_by: {field})"));
        let train = ["train", FIRST, "--output", "file.kinds", "--config", "by.ron"];
        robot.succeed(&[&train[..], &size].concat());
        assert!(robot.read("flag.kinds") == robot.read("file.kinds"), "{flag}");

        let inspection = inspect(&robot, "flag.kinds");
        assert_eq!(inspection["plan"]["kinds_by"], plan);
        let mut ranked: Vec<&Value> =
            inspection.pointer(trials).unwrap().as_array().unwrap().iter().collect();
        let n_tried = ranked.len();
        ranked.sort_by(|a, b| merit(b).total_cmp(&merit(a)));
        let (best, n_kinds) = (ranked[0], &inspection["n_kinds"]);
        assert_eq!(best["n_kinds"], *n_kinds, "{flag}");
        let second = ranked.iter().find(|trial| trial["n_kinds"] != *n_kinds).unwrap();
        let more = merit(best) - merit(second);
        let kinds = if second["n_kinds"] == 1 {
            "1 kind".to_string()
        } else {
            format!("{} kinds", second["n_kinds"])
        };
        let reason = match flag {
            "held-out" => format!(
                "of 4 to {n_tried} the likeliest for blocks that were held out: {:.3} nats per frame, {more:.3} more than \
                 {kinds}",
                merit(best)
            ),
            _ => format!(
                "kept by a Dirichlet process of concentration 1: lower bound of ln evidence {:.1} nats, {more:.1} more than \
                 {kinds}",
                merit(best)
            ),
        };
        let n_effective = inspection["provenance"]["n_frames_effective"].as_f64().unwrap();
        let line =
            format!("kinds: {n_kinds}, {reason}; 160 frames count as {n_effective:.0} independent ones");
        assert!(told.lines().any(|found| found == line), "no {line:?} in {told}");
        let report = String::from_utf8(robot.read("report/report.html")).unwrap();
        assert!(report.contains(&format!("<li>{line}</li>")), "no {line:?} in the report");
        assert_eq!(
            report.contains("A Dirichlet process of concentration 1 kept as many kinds"),
            flag == "dirichlet"
        );
    }

    let inspection = inspect(&robot, "flag.kinds");
    let text = robot.succeed(&["inspect", "flag.kinds"]);
    let share = inspection["provenance"]["largest_kind_share"].as_f64().unwrap();
    let line = format!("largest kind has {:.1} % of the frames, by most probable kind", 100.0 * share);
    assert!(text.lines().any(|found| found == line), "no {line:?} in {text}");
    let (_, table) = text.split_once("\nkinds begun with   kinds kept   lower bound\n").unwrap();
    let process = &inspection["provenance"]["dirichlet"];
    let trials = process["trials"].as_array().unwrap();
    let mut lines = table.lines();
    for (line, trial) in lines.by_ref().zip(trials) {
        let words: Vec<&str> = line.trim_end_matches(" ←").split_whitespace().collect();
        let bound = format!("{:.1}", lower_bound(trial));
        assert_eq!(
            words,
            [&trial["n_kinds_begun"].to_string(), &trial["n_kinds"].to_string(), &bound],
            "{line}"
        );
        assert!(!line.ends_with(" ←") || trial["n_kinds"] == inspection["n_kinds"], "{line}");
    }
    assert_eq!(table.matches('←').count(), 1, "{table}");
    let n_frames: Vec<String> = process["n_frames_of_kinds"]
        .as_array()
        .unwrap()
        .iter()
        .map(|n_frames| format!("{:.1}", n_frames.as_f64().unwrap()))
        .collect();
    assert_eq!(
        table.lines().last().unwrap(),
        format!("independent frames of each kind: {}", n_frames.join(" "))
    );
}

#[test]
fn starts_that_were_given_up_and_numbers_that_could_not_be_tried_are_told() {
    let robot = Robot::new();
    Trip { n_frames: 40, ..Trip::FIRST }.write(&robot.path(FIRST));
    let size = ["--neighbors", "8", "--dims", "3", "--response", "inverse"];
    let train = |more: &[&str]| {
        let train = ["train", FIRST, "--output", MODEL, "--report", "report"];
        let outcome = robot.run(&[&train[..], &size, more].concat());
        assert_eq!(outcome.code, Some(0), "{outcome:?}");
        (outcome.stderr, String::from_utf8(robot.read("report/report.html")).unwrap())
    };
    let (told, report) = train(&["--kinds", "20"]);
    let n_given_up = &inspect(&robot, MODEL)["provenance"]["n_starts_collapsed"];
    assert!(n_given_up.as_u64().unwrap() > 1, "{n_given_up}");
    let sentence = format!(
        "{n_given_up} of 10 starts of the mixture were given up because a kind lost its frames; fewer kinds avoid it"
    );
    assert!(told.lines().any(|line| line == format!("kinds: {sentence}")), "{told}");
    assert_eq!(report.matches(&format!("<li>{sentence}</li>")).count(), 1);

    let (told, report) = train(&[]);
    let n_tried = inspect(&robot, MODEL)["provenance"]["kinds_tried"].as_array().unwrap().len();
    assert!(n_tried < 20, "{n_tried}");
    let sentence = format!(
        "no more than {n_tried} kinds were tried: 40 frames kept no more apart from any start; record a longer trip to try \
         more"
    );
    assert!(told.lines().any(|line| line == format!("kinds: {sentence}")), "{told}");
    assert!(report.contains(&format!("<li>{sentence}</li>")));
}

#[test]
fn the_number_of_neighbours_is_chosen_and_both_train_and_inspect_say_why() {
    let robot = Robot::trained();
    let size = ["--dims", "3", "--kinds", "3"];
    let told = robot.succeed(&[&["train", FIRST, "--output", "chosen.kinds"][..], &size].concat());
    let inspection = inspect(&robot, "chosen.kinds");
    let n_neighbors = &inspection["n_neighbors"];
    let tried = inspection["provenance"]["neighbors_tried"].as_array().unwrap();
    let number = |trial: &Value, field: &str| trial[field].as_f64().unwrap();
    // Nothing doubles here, so only the number itself says what is chosen from.
    let candidates: Vec<&Value> = tried.iter().filter(|trial| number(trial, "n_neighbors") >= 10.0).collect();
    let mut ranked = candidates.clone();
    ranked.sort_by(|a, b| number(a, "residual_variance").total_cmp(&number(b, "residual_variance")));
    let least = number(ranked[0], "residual_variance");
    let best = candidates.iter().find(|trial| number(trial, "residual_variance") <= least + 0.01).unwrap();
    assert_eq!(best["n_neighbors"], *n_neighbors);
    let second = ranked.iter().find(|trial| trial["n_neighbors"] != *n_neighbors).unwrap();
    let beginning = format!(
        "neighbours: {n_neighbors}, the fewest of {} to 30 whose residual variance is within 0.01 of the least: {:.4} in 3 \
         dimensions; {:.4} with {}",
        candidates[0]["n_neighbors"],
        number(best, "residual_variance"),
        number(second, "residual_variance"),
        second["n_neighbors"],
    );
    let line = told
        .lines()
        .find(|line| line.starts_with(&beginning))
        .unwrap_or_else(|| panic!("{beginning} in {told}"));

    let text = robot.succeed(&["inspect", "chosen.kinds"]);
    let heading = "\nneighbours tried   islands   longest bridge   residual variance in 3 dimensions   median geodesic\n";
    let (_, table) = text.split_once(heading).unwrap();
    assert_eq!(table.lines().count(), tried.len(), "{table}");
    let mut flagged = Vec::new();
    for (line, trial) in table.lines().zip(tried) {
        let words: Vec<&str> = line.split([' ', '*', '←']).filter(|word| !word.is_empty()).collect();
        let bridge = trial["bridges"].as_array().unwrap().last();
        let expected = [
            trial["n_neighbors"].to_string(),
            trial["n_islands"].to_string(),
            bridge.map_or("-".to_string(), |length| format!("{:.0}", length.as_f64().unwrap())),
            format!("{:.4}", number(trial, "residual_variance")),
            format!("{:.0}", number(trial, "median_geodesic")),
        ];
        assert_eq!(words[..5], expected, "{line}");
        let least_of_all =
            tried.iter().map(|trial| number(trial, "residual_variance")).fold(f64::INFINITY, f64::min);
        assert_eq!(line.contains('*'), number(trial, "residual_variance") == least_of_all, "{line}");
        assert_eq!(line.ends_with(" ←"), trial["n_neighbors"] == *n_neighbors, "{line}");
        if line.contains(" short circuit?") {
            flagged.push(expected[0].clone());
        }
    }
    let circuits = format!("; perhaps short circuits at {}", flagged.join(", "));
    assert_eq!(line.strip_prefix(&beginning), Some(if flagged.is_empty() { "" } else { &circuits }));
}

#[test]
fn train_and_inspect_name_the_metric_and_what_it_makes_of_principal_components() {
    let robot = Robot::trained();
    let weights = vec!["1"; 15].join(", ");
    robot.write("weighted.ron", format!("(metric: Weighted([{weights}, 0.5]))"));
    for (flags, metric, method) in [
        (["--config", "weighted.ron"], "distances with 16 weights", "principal components"),
        (["--metric", "ring"], "least distances over all turns of the ring", "classical scaling"),
        (["--metric", "rings:2"], "least distances over all turns of 2 rings", "classical scaling"),
    ] {
        let train =
            [&["train", FIRST, "--output", "some.kinds", "--method", "pca"][..], &SIZE, &flags].concat();
        let told = robot.succeed(&train);
        let learnt =
            format!("160 frames of 16 readings: {method} of inverse ranges by {metric} in 8 dimensions, ");
        assert!(told.contains(&learnt), "no {learnt:?} in {told}");
        let text = robot.succeed(&["inspect", "some.kinds"]);
        for line in
            [format!("compared by  {metric}"), format!("method       {method}: 10 neighbours, 160 landmarks")]
        {
            assert!(text.lines().any(|found| found == line), "no {line:?} in {text}");
        }
    }
}

#[test]
fn native_space_says_how_much_of_the_trip_is_of_one_kind() {
    let robot = Robot::trained();
    let train = ["train", FIRST, "--output", "native.kinds", "--method", "native", "--kinds", "4"];
    let outcome = robot.run(&[&train[..], &["--report", "report"]].concat());
    assert_eq!(outcome.code, Some(0), "{outcome:?}");
    let inspection = inspect(&robot, "native.kinds");
    let share = inspection["provenance"]["largest_kind_share"].as_f64().unwrap();
    assert!((0.25..0.5).contains(&share), "{share}");
    let percent = format!("{:.1} % of the frames", 100.0 * share);
    let remark = format!("in native space the largest of 4 kinds has {percent}");
    assert!(outcome.stderr.lines().any(|line| line == format!("kinds: {remark}")), "{outcome:?}");
    let learnt = "learnt 4 kinds from 160 frames of 16 readings: native space of inverse ranges in 16 \
                  dimensions";
    assert_eq!(outcome.stdout.lines().next(), Some(learnt));
    let report = String::from_utf8(robot.read("report/report.html")).unwrap();
    for words in [
        &*remark,
        "native space: the readings as they are, 16 dimensions",
        "One for each reading: in native space nothing is embedded.",
    ] {
        assert!(report.contains(words), "no {words:?} in the report");
    }

    let text = robot.succeed(&["inspect", "native.kinds"]);
    for line in [
        "method       native space: 10 neighbours, no landmarks",
        "dimensions   16, one for each reading",
        &format!("largest kind has {percent}, by most probable kind"),
    ] {
        assert!(text.lines().any(|found| found == line), "no {line:?} in {text}");
    }
    assert!(!text.contains("\nnegative "), "{text}");
}

#[test]
fn native_space_of_many_readings_is_refused_with_the_reason() {
    let robot = Robot::new();
    Trip { n_readings: 40, n_frames: 50, ..Trip::FIRST }.write(&robot.path(FIRST));
    robot.refuse(
        &["train", FIRST, "--output", MODEL, "--method", "native"],
        1,
        "cannot train: native space is for sensors of at most 32 readings and this one has 40: the full covariance of one kind \
         would have 40·41/2 = 820 parameters, and there are 50 frames; use isomap",
    );
}

#[test]
fn inspect_says_how_landmarks_were_chosen() {
    let robot = Robot::trained();
    for (choice, words) in
        [("random", "at random"), ("farthest", "by farthest point"), ("k-means", "by k-means")]
    {
        let train =
            ["train", FIRST, "--output", "some.kinds", "--landmarks", "25%", "--landmark-choice", choice];
        robot.succeed(&[&train[..], &SIZE].concat());
        let line = format!("method       Isomap: 10 neighbours, 40 landmarks {words}");
        let text = robot.succeed(&["inspect", "some.kinds"]);
        assert!(text.lines().any(|found| found == line), "no {line:?} in {text}");
    }
}

#[test]
fn that_by_which_kinds_last_is_compared_and_told() {
    let robot = Robot::trained();
    let train = |more: &[&str]| {
        let train = ["train", FIRST, "--output", "compared.kinds", "--kinds", "4"];
        let outcome = robot.run(&[&train[..], more].concat());
        assert_eq!(outcome.code, Some(0), "{outcome:?}");
        (outcome, inspect(&robot, "compared.kinds"))
    };
    let (outcome, inspection) = train(&[]);
    let tried = inspection["provenance"]["origin"]["comparisons_tried"].as_array().unwrap();
    assert_eq!(tried.len(), 6, "{tried:?}");
    let named = |scale: &Value, whitening: &Value| {
        (scale.as_str().unwrap().to_lowercase(), whitening["n_directions"].as_u64())
    };
    let lasting: Vec<((String, Option<u64>), f64)> = tried
        .iter()
        .map(|tried| {
            let n_changes = |of: &str| 1.0 - tried[of].as_f64().unwrap();
            let product = n_changes("persistence") * n_changes("persistence_held_out");
            (named(&tried["scale"], &tried["whitening"]), 1.0 / product.sqrt())
        })
        .collect();
    let [a, b, c, d, e, f] =
        lasting.iter().map(|(_, frames)| format!("{frames:.1}")).collect::<Vec<_>>().try_into().unwrap();
    let told = format!(
        "kinds last {a} frames by inverse, {b} by log, {c} by range; along 4 slow directions {d} frames by inverse, {e} by log, \
         {f} by range"
    );
    assert!(outcome.stdout.contains(&told), "no {told:?} in {outcome:?}");
    // The usual one gives way to one that it is outlasted by, by more than a tenth and more than chance.
    let n_changes = |lasting: f64| 160.0 / lasting;
    let best = lasting.iter().max_by(|a, b| a.1.total_cmp(&b.1)).unwrap();
    let (usual, least) = (n_changes(lasting[0].1), n_changes(best.1));
    let gives_way = usual > 1.1 * least && usual - least > 2.0 * (usual + least).sqrt();
    let expected = if gives_way { best } else { &lasting[0] };
    let plan = &inspection["plan"];
    assert_eq!(named(&plan["response"]["scale"], &plan["whitening"]), expected.0);
    // What is asked for is not tried.
    for more in [&["--response", "log"][..], &["--response", "range", "--whitening", "4"]] {
        let (_, inspection) = train(more);
        assert_eq!(inspection["provenance"]["origin"]["comparisons_tried"], serde_json::json!([]));
        assert_eq!(inspection["plan"]["whitening"]["n_directions"].as_u64(), more.get(3).map(|_| 4));
    }
    let (_, inspection) = train(&["--response", "log", "--whitening", "auto"]);
    assert_eq!(inspection["provenance"]["origin"]["comparisons_tried"].as_array().unwrap().len(), 2);
}

#[test]
fn of_a_sensor_with_drop_outs_each_reading_is_the_median_of_three_frames_in_training_and_in_serving() {
    let robot = Robot::new();
    let spoilt =
        |trip: Trip<'static>| Trip { share_dropped: 0.08, invalid_frames: &[40], as_images: true, ..trip };
    spoilt(Trip::FIRST).write(&robot.path(FIRST));
    spoilt(Trip::SECOND).write(&robot.path(SECOND));
    let outcome = robot.run(&[&["train", FIRST, "--output", MODEL][..], &SIZE].concat());
    assert!(
        outcome.stderr.contains(
            "are missing or far off for one frame alone: each reading is taken as the median of three frames"
        ),
        "{outcome:?}"
    );
    assert_eq!(inspect(&robot, MODEL)["plan"]["median"], "Three");
    let consumer = robot.join();
    let service = robot.serve();
    let mut shim = robot.publish(SECOND, "max");
    let reports = consumer.await_end_of(&mut shim);
    service.stop(Signal::TERM);
    assert_reports_equal_classifying_here(&reports, &robot.path(MODEL), &robot.path(SECOND));
    // With so many readings gone a frame by itself would say so.
    let n_invalid: u32 =
        reports.iter().filter(|report| report.n_invalid < 16).map(|report| report.n_invalid).sum();
    assert!(n_invalid < 16, "{n_invalid} readings were missing in three frames on end");
    for (n_frames, plan) in [("1", "Off"), ("5", "Five")] {
        let train = ["train", FIRST, "--output", "asked.kinds", "--median", n_frames];
        let outcome = robot.run(&[&train[..], &SIZE].concat());
        assert!(!outcome.stderr.contains("median"), "{outcome:?}");
        assert_eq!(inspect(&robot, "asked.kinds")["plan"]["median"], plan);
    }
    robot.refuse_with(
        &["train", FIRST, "--output", "asked.kinds", "--median", "4"],
        2,
        &["median", "4", "1, 3 or 5 frames"],
    );
}

#[test]
fn inspect_says_what_is_in_a_model() {
    let robot = Robot::trained();
    let model = crate::world::open_model(&robot.path(MODEL));
    let inspection = inspect(&robot, MODEL);
    assert_eq!(inspection["model_id"], model.id().to_string());
    assert_eq!(inspection["format"], 5);
    assert_eq!(inspection["n_frames"], 160);
    assert_eq!((&inspection["n_dims"], &inspection["n_kinds"]), (&8.into(), &5.into()));
    assert_eq!((&inspection["plan"]["n_dims"], &inspection["plan"]["n_kinds"]), (&8.into(), &5.into()));
    assert_eq!((&inspection["n_neighbors"], &inspection["plan"]["n_neighbors"]), (&10.into(), &10.into()));
    for tried in ["neighbors_tried", "kinds_tried"] {
        assert_eq!(inspection["provenance"][tried], serde_json::json!([]));
    }
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
        "compared by  euclidean distances",
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
    assert!(!text.contains(" tried"), "{text}");
}
