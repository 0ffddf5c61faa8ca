//! `kinds check`, and the commented configurations that come with the package.

use std::collections::BTreeSet;
use std::path::Path;

use crate::robot::{MODEL, Robot, SENSOR};

const DEPLOY: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/deploy");

/// The configurations that come with the package: path, and the groups of fields in it, with how to ask for them.
const CONFIGURATIONS: [(&str, &[&str]); 9] = [
    ("etc/serve.ron", &["", "realtime: ("]),
    ("etc/publish.ron", &["", "faults: (", "reading: ("]),
    ("etc/record.ron", &[""]),
    ("etc/bridge.ron", &[""]),
    ("examples/join.ron", &[""]),
    ("examples/train.ron", &["", "commands: ("]),
    ("examples/faults.ron", &[""]),
    // Of a configuration of which etc/publish.ron has all fields.
    ("examples/realsense.ron", &[]),
    ("examples/realtime.ron", &[""]),
];

fn shipped(path: &str) -> String {
    std::fs::read_to_string(Path::new(DEPLOY).join(path)).unwrap()
}

/// A line without the marks that make it a comment, if it is a field or an end of a group behind them.
fn uncommented(line: &str) -> Option<&str> {
    let behind = line.trim_start().strip_prefix("// ")?;
    let is_code = field(behind).is_some() || behind.trim() == ")," || behind.starts_with("    //");
    is_code.then_some(behind)
}

/// The field that a line gives a value to.
fn field(line: &str) -> Option<&str> {
    let (name, value) = line.trim_start().split_once(": ")?;
    let is_name = name.chars().all(|c| c.is_ascii_lowercase() || c == '_') && name != "true";
    (is_name && value.ends_with([',', '('])).then_some(name)
}

/// The text, and the text with each field behind comment marks as one of its fields.
fn with_each_field(text: &str) -> Vec<String> {
    let lines: Vec<&str> = text.lines().collect();
    let mut texts = vec![text.to_string()];
    let mut index = 0;
    while index < lines.len() {
        let n_lines = lines[index..].iter().take_while(|line| uncommented(line).is_some()).count();
        if n_lines > 0 {
            let within = index..index + n_lines;
            let changed = lines.iter().enumerate().map(|(at, line)| match within.contains(&at) {
                true => uncommented(line).unwrap(),
                false => line,
            });
            texts.push(changed.collect::<Vec<_>>().join("\n"));
        }
        index += n_lines.max(1);
    }
    texts
}

/// The text, but with a device alone where it has one of a device's fields, and with one end of a bridge alone: there is one of
/// two.
fn with_one_of_two(text: &str) -> String {
    let has = |field: &str| text.lines().any(|line| line.trim_start().starts_with(field));
    if has("connect: ") {
        return text.replace("listen: \"tcp/0.0.0.0:7447\",", "");
    }
    if !["device: ", "rows: ", "columns: "].iter().any(|field| has(field)) {
        return text.to_string();
    }
    let lacking = [("device: ", "device: \"stdin\","), ("columns: ", "columns: 4,")];
    let lacking = lacking.iter().filter(|(field, _)| !has(field)).map(|(_, line)| *line);
    text.replace("simulate: crunch,", &lacking.collect::<String>())
}

#[test]
fn every_configuration_that_is_shipped_is_right_with_each_of_its_fields() {
    let robot = Robot::new();
    for (path, _) in CONFIGURATIONS {
        let texts = with_each_field(&shipped(path));
        for text in &texts {
            robot.write("shipped.ron", with_one_of_two(text));
            let said = robot.succeed(&["check", "shipped.ron"]);
            assert!(said.starts_with("shipped.ron is right, for kinds "), "{path}: {said}");
        }
        assert!(
            texts.len() > 1 || !path.starts_with("etc/"),
            "{path}: no field behind comment marks is found"
        );
    }
}

#[test]
fn every_field_stands_in_the_configuration_that_is_shipped_and_has_its_comment() {
    let robot = Robot::new();
    for (path, groups) in CONFIGURATIONS {
        let text = shipped(path);
        let lines: Vec<&str> = text.lines().map(|line| uncommented(line).unwrap_or(line)).collect();
        let inner = |line: &str| uncommented(line).map_or_else(|| line.to_string(), str::to_string);
        let lines: Vec<String> = lines.into_iter().map(inner).collect();
        let mut found = BTreeSet::new();
        for (index, line) in lines.iter().enumerate() {
            let Some(name) = field(line) else { continue };
            found.insert(name.to_string());
            // Groups on one line.
            let (_, value) = line.split_once(": ").unwrap();
            found.extend(
                value
                    .trim_start_matches('(')
                    .split(", ")
                    .filter_map(|part| Some(part.split_once(": ")?.0.to_string())),
            );
            assert!(lines[index - 1].trim_start().starts_with("//"), "{path}: no comment before {line:?}");
        }
        let word = text.lines().find_map(|line| line.strip_suffix('(')).unwrap();
        for group in groups {
            let close = if group.is_empty() { ")" } else { "))" };
            robot.write("unknown.ron", format!("{word}({group}unheard_of_by_anybody: 1{close}"));
            let refused = robot.run(&["check", "unknown.ron"]);
            let (_, fields) =
                refused.stderr.split_once("; the fields are ").unwrap_or_else(|| panic!("{refused:?}"));
            for name in fields.trim().split(", ") {
                assert!(found.contains(name), "{path} does not speak of {group}{name}; it has {found:?}");
            }
        }
    }
}

#[test]
fn what_is_wrong_is_said_with_file_line_column_and_what_was_perhaps_meant() {
    let robot = Robot::new();
    for (text, words) in [
        ("Serve(\n    sensr: \"a\",\n)", "line 2, column 5: there is no field sensr; did you mean sensor?"),
        (
            "Serve(sensor: \"a b\", model: \"m\")",
            "line 1, column 16: sensor name \"a b\" has the character ' '; only letters A-Z and a-z, digits, '_', '.' and '-' may \
             be used, and '/' between parts",
        ),
        (
            "Publish(sensor: \"a\", simulate: crnch)",
            "line 1, column 32: there is no choice crnch; did you mean crunch?",
        ),
        (
            "Publish(sensor: \"a\", trip: 1, speed: 0)",
            "line 1, column 38: speed \"0\" is neither a number above 0, such as 1 for as recorded or 10 for ten times as fast, \
             nor \"max\"",
        ),
        ("Serve(sensor: \"a\")", "say which model to serve: with model in the configuration, or --model"),
        ("Record(sensor: \"a\")", "say where to record to: with output in the configuration, or --output"),
        ("Publish(sensor: \"a\")", "say what to publish: with trip in the configuration, or --trip"),
        (
            "Train(\n    // kinds: 65,\n    kinds_by: dirichlet,\n    covariance: tied,\n)",
            "line 3, column 5: kinds_by is dirichlet and covariance is tied: a Dirichlet process has kinds with full covariances; \
             leave out covariance, or choose by bic_neff or held_out",
        ),
        ("Train(frames: 50, kinds: 65)", "line 1, column 19: kinds is 65; it must be between 1 and 64"),
        ("Faults(\n  drop: 2)", "line 2, column 3: drop is 2; it must be between 0 and 1"),
        (
            "Serve(realtime: (prioritty: 3))",
            "line 1, column 18: there is no field prioritty; did you mean priority?",
        ),
        (
            "Serv()",
            "it begins with Serv of Serve, Publish, Join, Record, Bridge, Train, Faults, Realtime, so nobody knows what it is for; write one \
             before its first bracket, or say it with --as",
        ),
        ("Serve(", "line 1, column 6: Unexpected end of RON"),
    ] {
        robot.write("wrong.ron", text);
        robot.refuse(&["check", "wrong.ron"], 2, &format!("configuration wrong.ron: {words}"));
    }
    robot.refuse(
        &["check", "none.ron"],
        1,
        "cannot read configuration none.ron: there is no such file or folder",
    );
    robot.write("nameless.ron", "(kinds: 5)");
    robot.succeed(&["check", "--as", "train", "nameless.ron"]);
    robot.refuse_with(&["check", "--as", "serve", "nameless.ron"], 2, &["there is no field kinds; "]);
    let outcome = robot.run(&["check", "none.ron", "nameless.ron", "wrong.ron"]);
    assert_eq!((outcome.code, outcome.stderr.lines().count()), (Some(2), 3), "{outcome:?}");
}

#[test]
fn programs_do_what_their_configuration_says_unless_flags_say_otherwise() {
    let robot = Robot::crunch();
    robot.write("serve.ron", format!("Serve(sensor: \"{SENSOR}\", model: \"{MODEL}\", lock_memory: true)"));
    robot.write("publish.ron", format!("Publish(sensor: \"{SENSOR}\", simulate: crunch, speed: 50)"));
    std::fs::create_dir(robot.path("trips")).unwrap();
    robot.write("record.ron", "Record(sensor: \"other/ring\", output: \"trips\", count: 40)");
    let service = robot.start(&["serve", "--config", "serve.ron"]);
    assert!(service.await_out("serving crunch/ring: ").contains("; memory is "));
    let recorder = robot.start(&["record", "--config", "record.ron", "--sensor", SENSOR]);
    recorder.await_err("kinds: waiting for a driver shim to publish crunch/ring");
    let shim = robot.start(&["publish", "--config", "publish.ron"]);
    let recorded = recorder.end();
    assert_eq!(recorded.code, Some(0), "{recorded:?}");
    assert!(
        recorded.stdout.starts_with("recorded 40 frames and 40 reports into trips/crunch-ring-2"),
        "{recorded:?}"
    );
    // Another model in the configuration is what a reload takes into use.
    std::fs::copy(robot.path(MODEL), robot.path("other.kinds")).unwrap();
    robot.write("serve.ron", format!("Serve(sensor: \"{SENSOR}\", model: \"other.kinds\")"));
    let said = robot.succeed(&["reload", "--config", "serve.ron"]);
    assert!(said.trim_end().ends_with("other.kinds"), "{said}");
    shim.stop(rustix::process::Signal::TERM);
    service.stop(rustix::process::Signal::TERM);
    robot.refuse(
        &["serve", "--config", "serve.ron", "--model", "gone.kinds"],
        1,
        "no model at gone.kinds: there is no such file",
    );
}
