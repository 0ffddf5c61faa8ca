//! Flags and configuration that cannot be: exit code 2, a sentence with value and limit, and nothing touched.

use crate::robot::{FIRST, MODEL, Robot, SECOND, SENSOR};

#[test]
fn training_numbers_beyond_their_limits_are_refused_with_value_and_limit() {
    let robot = Robot::trained();
    let limit = |field: &str| match field {
        "kinds" => "between 1 and 64",
        "dims" => "between 1 and 32",
        "neighbors" | "starts" => "at least 1",
        "invalid-range-m" => "at least 0 m",
        "covariance-floor" => "above 0 and below 1",
        "commands-weight" => "at least 0",
        _ => "above 0 m",
    };
    for (flag, values) in [
        ("kinds", &["0", "65"][..]),
        ("dims", &["0", "33"]),
        ("neighbors", &["0"]),
        ("starts", &["0"]),
        ("range-m-max", &["0", "NaN", "inf"]),
        ("invalid-range-m", &["NaN", "inf"]),
        ("offset-m", &["0", "NaN"]),
        ("metres-per-count", &["0", "NaN", "inf"]),
        ("covariance-floor", &["0", "1", "NaN"]),
        ("commands-weight", &["-0.1", "NaN", "inf"]),
    ] {
        for value in values {
            let field = flag.replace('-', "_");
            let sentence = format!("{field} is {value}; it must be {}", limit(flag));
            let named = format!("--{flag}");
            robot.refuse(&["train", FIRST, "--output", MODEL, &named, value], 2, &sentence);
            if !["NaN", "inf"].contains(value) {
                let (group, close) =
                    if flag == "commands-weight" { ("commands: (weight", ")") } else { (&*field, "") };
                robot.write("limit.ron", format!("({group}: {value}){close}"));
                let config = ["train", FIRST, "--output", MODEL, "--config", "limit.ron"];
                robot.refuse_with(&config, 2, &[&sentence]);
            }
        }
    }
}

#[test]
fn a_number_of_kinds_and_what_to_choose_it_by_are_refused_together() {
    let robot = Robot::trained();
    let train = ["train", FIRST, "--output", MODEL];
    for (flags, fields, sentence) in [
        (
            ["--kinds", "5", "--kinds-by", "held-out"],
            "(kinds: 5, kinds_by: held_out)",
            "kinds is 5 and kinds_by is held_out: a number of kinds is either given or chosen; leave out one of them",
        ),
        (
            ["--kinds-by", "dirichlet", "--covariance", "diagonal"],
            "(kinds_by: dirichlet, covariance: diagonal)",
            "kinds_by is dirichlet and covariance is diagonal: a Dirichlet process has kinds with full covariances; leave \
             out covariance, or choose by bic_neff or held_out",
        ),
    ] {
        robot.refuse(&[&train[..], &flags].concat(), 2, sentence);
        robot.write("both.ron", fields);
        robot.refuse_with(&[&train[..], &["--config", "both.ron"]].concat(), 2, &[sentence]);
    }
    let by = [&train[..], &["--kinds-by", "bic"]].concat();
    robot.refuse(&by, 2, "error: invalid value 'bic' for '--kinds-by <HOW>'");
}

#[test]
fn landmarks_that_cannot_be_are_refused_with_what_can() {
    let robot = Robot::trained();
    let train = ["train", FIRST, "--output", MODEL];
    for number in ["0", "2.5", "-3", "0%", "101%", "some"] {
        let sentence = format!(
            "landmarks are {number}; they must be all, a count such as 500, or a share above 0% and at most 100% such as 25%"
        );
        let flag = [&train[..], &["--landmarks", number]].concat();
        robot.refuse(
            &flag,
            2,
            &format!("error: invalid value '{number}' for '--landmarks <all|N|SHARE%>': {sentence}"),
        );
        robot.write("landmarks.ron", format!("(landmarks: \"{number}\")"));
        let config = [&train[..], &["--config", "landmarks.ron"]].concat();
        robot.refuse_with(&config, 2, &["configuration landmarks.ron: line 1, column ", &sentence]);
    }
    let choice = [&train[..], &["--landmark-choice", "nearest"]].concat();
    robot.refuse(&choice, 2, "error: invalid value 'nearest' for '--landmark-choice <HOW>'");
    robot.write("choice.ron", "(landmark_choice: nearest)");
    let config = [&train[..], &["--config", "choice.ron"]].concat();
    robot.refuse_with(&config, 2, &["configuration choice.ron: line 1, column ", "nearest"]);
}

#[test]
fn a_metric_that_cannot_be_is_refused_with_what_can() {
    let robot = Robot::trained();
    let train = ["train", FIRST, "--output", MODEL];
    for metric in ["weighted", "rings:0", "rings:some", "ring:2", "parts:8,0"] {
        robot.refuse(
            &[&train[..], &["--metric", metric]].concat(),
            2,
            &format!(
                "error: invalid value '{metric}' for '--metric <euclidean|ring|rings:N|parts:N,…>': metric is {metric}; it must be \
                 euclidean, ring (each row of the sensor is one), a number of rings such as rings:2, or the readings of each part \
                 such as parts:16,19840; weights are given in a configuration file"
            ),
        );
    }
    robot.refuse(
        &[&train[..], &["--metric", "rings:3"]].concat(),
        1,
        "cannot train: metric: 1 × 16 readings are not 3 rings of equal length, each within a row and of at least 2 readings; ask \
         for another number of rings",
    );
    robot.refuse_with(
        &[&train[..], &["--metric", "parts:8,9"]].concat(),
        2,
        &["metric: parts of 8 and 9 readings are not the sensor's 16; give how many readings each of the joined sensors has"],
    );
    robot.write("weights.ron", "(metric: Weighted([1, 2, 3]))");
    robot.refuse_with(
        &[&train[..], &["--config", "weights.ron"]].concat(),
        1,
        &["cannot train: metric: 3 weights were given and the sensor has 16 readings; give one weight for each"],
    );
    robot.write("metric.ron", "(metric: manhattan)");
    let config = [&train[..], &["--config", "metric.ron"]].concat();
    robot.refuse_with(&config, 2, &["configuration metric.ron: line 1, column ", "manhattan"]);
}

#[test]
fn evaluation_numbers_beyond_their_limits_are_refused_with_value_and_limit() {
    let robot = Robot::trained();
    for (flag, value, parts) in [
        ("--radius-m", "-1", ["radius", " is -1; it must be at least 0 m"]),
        ("--radius-m", "NaN", ["radius", " is NaN; it must be at least 0 m"]),
        ("--radius-m-max", "0", ["radius_m_max", " is 0; it must be above 0 m"]),
        ("--heading-deg", "181", ["heading_deg", " is 181; it must be between 0° and 180°"]),
        ("--radii", "0", ["radii", " is 0; it must be between 1 and 100"]),
        ("--shares", "101", ["shares", " is 101; it must be between 1 and 100"]),
        ("--share", "1", ["share", " is 1; it must be at least 0 and below 1"]),
        ("--share", "1.5", ["share", " is 1.5; it must be at least 0 and below 1"]),
    ] {
        robot.refuse_with(&["evaluate", MODEL, FIRST, SECOND, flag, value], 2, &parts);
    }
}

#[test]
fn configuration_that_cannot_be_read_is_refused_with_file_line_and_column() {
    let robot = Robot::trained();
    let train = ["train", FIRST, "--output", MODEL, "--config", "bad.ron"];
    for (text, place, word) in [
        ("(\n  kids: 5,\n)", "line 2, column 3", "kids"),
        ("(\n  kinds: \"5\",\n)", "line 2, column 9", "integer"),
        ("(\n  kinds: 5,\n  kinds: 6,\n)", "line 3, column 3", "stands there twice"),
        ("(seed: -1)", "line 1, column 9", "out of bounds"),
        ("(response: logarithm)", "line 1, column 12", "logarithm"),
        ("(response: log, kinds: 5", "line 1, column 24", ""),
        ("", "line 1, column 1", "("),
    ] {
        robot.write("bad.ron", text);
        robot.refuse_with(&train, 2, &[&format!("configuration bad.ron: {place}: "), word]);
    }
}

#[test]
fn configuration_that_is_not_there_is_a_sentence() {
    let robot = Robot::trained();
    let train = ["train", FIRST, "--output", MODEL, "--config", "nowhere.ron"];
    robot.refuse_with(&train, 1, &["cannot read configuration nowhere.ron: "]);
}

#[test]
fn a_pace_that_is_none_is_refused_with_what_would_be_one() {
    let robot = Robot::trained();
    for speed in ["0", "nan", "inf", "fast"] {
        robot.refuse(
            &["publish", "--trip", SECOND, "--sensor", SENSOR, "--speed", speed],
            2,
            &format!(
                "error: invalid value '{speed}' for '--speed <X|max>': speed \"{speed}\" is neither a number above 0, \
                 such as 1 for as recorded or 10 for ten times as fast, nor \"max\""
            ),
        );
    }
}

#[test]
fn a_sensor_name_that_is_none_is_refused_with_what_would_be_one() {
    let robot = Robot::trained();
    for verb in [&["publish", "--trip", SECOND][..], &["serve", "--model", MODEL], &["watch"]] {
        robot.refuse(
            &[verb, &["--sensor", "my ring"]].concat(),
            2,
            "error: invalid value 'my ring' for '--sensor <NAME>': sensor name \"my ring\" has the character ' '; only \
             letters A-Z and a-z, digits, '_', '.' and '-' may be used, and '/' between parts",
        );
    }
}

#[test]
fn a_unit_that_is_none_is_refused() {
    let robot = Robot::trained();
    robot.refuse_with(
        &["publish", "--trip", SECOND, "--sensor", SENSOR, "--metres-per-count", "0"],
        2,
        &["a unit of 0 metres per count was asked for; it must be a finite number above 0"],
    );
}

#[test]
fn a_domain_that_is_not_absolute_is_a_sentence() {
    let robot = Robot::trained();
    for verb in [&["publish", "--trip", SECOND][..], &["serve", "--model", MODEL], &["watch"]] {
        robot.refuse(
            &[verb, &["--sensor", SENSOR, "--domain", "here"]].concat(),
            1,
            "channels cannot live under here: programs started in other folders would not find them; give the root as \
             an absolute path",
        );
    }
}

#[test]
fn a_verb_that_there_is_not_is_refused() {
    let robot = Robot::new();
    robot.refuse(&["learn"], 2, "error: unrecognized subcommand 'learn'");
}
