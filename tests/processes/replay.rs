//! `kinds replay`: what changes is noticed, and nothing changes by itself.

use std::path::{Path, PathBuf};

use crate::robot::{MODEL, Robot, SECOND};
use crate::world::Trip;

const BLESSED: &str = "kinds.csv";

/// A robot with a model, and with what the replay of its second trip gave.
fn blessed() -> Robot {
    let robot = Robot::trained();
    let said = robot.succeed(&["replay", SECOND, "--model", MODEL, "--bless", BLESSED]);
    assert!(said.ends_with("wrote kinds.csv\n"), "{said}");
    robot
}

fn replay(robot: &Robot, trip: &str, model: &str) -> (Option<i32>, String, String) {
    let outcome = robot.run(&["replay", trip, "--model", model, "--expect", BLESSED]);
    (outcome.code, outcome.stdout, outcome.stderr)
}

#[test]
fn a_replay_gives_the_same_digits_again() {
    let robot = blessed();
    let first = robot.read(BLESSED);
    let text = String::from_utf8(first.clone()).unwrap();
    let lines: Vec<_> = text.lines().collect();
    assert_eq!(lines[0], "sequence,status,kind,novelty,log_likelihood,p0,p1,p2,p3,p4");
    assert_eq!(lines.len() - 1, Trip::SECOND.n_frames);
    let (code, said, _) = replay(&robot, SECOND, MODEL);
    let n_frames = Trip::SECOND.n_frames;
    assert!(said.ends_with(&format!("as expected: {n_frames} frames, every digit\n")), "{said}");
    assert_eq!(code, Some(0));
    robot.succeed(&["replay", SECOND, "--model", MODEL, "--bless", BLESSED]);
    assert_eq!(robot.read(BLESSED), first);
    assert_eq!(robot.shared_memory(), [""; 0]);
}

#[test]
fn a_changed_digit_is_shown_with_its_frame_and_fails() {
    let robot = blessed();
    let mut lines: Vec<String> =
        String::from_utf8(robot.read(BLESSED)).unwrap().lines().map(str::to_owned).collect();
    let found = lines[8].clone();
    // Frame 7 was of another kind, frame 20 is not expected at all.
    let mut fields: Vec<&str> = found.split(',').collect();
    let kind = fields[2].to_owned();
    fields[2] = "9";
    lines[8] = fields.join(",");
    let unexpected = lines.remove(21);
    robot.write(BLESSED, lines.join("\n") + "\n");
    let (code, said, complaint) = replay(&robot, SECOND, MODEL);
    for line in [
        format!("- {}", lines[8]),
        format!("+ {found}"),
        "- no such frame".to_owned(),
        format!("+ {unexpected}"),
        format!("kind 9 → {kind}: 1 frames"),
    ] {
        assert!(said.lines().any(|said| said == line), "no {line:?} in {said}");
    }
    let n_frames = Trip::SECOND.n_frames;
    assert_eq!(
        complaint,
        format!("kinds: 2 of {n_frames} frames differ from what was expected, 2 of them in kind\n")
    );
    assert_eq!(code, Some(1));
}

#[test]
fn another_trip_fails() {
    let robot = blessed();
    Trip { invalid_frames: &[5], ..Trip::SECOND }.write(&robot.path("other.mcap"));
    let (code, said, _) = replay(&robot, "other.mcap", MODEL);
    assert!(said.contains("\n+ 5,invalid,"), "{said}");
    assert_eq!(code, Some(1));
}

#[test]
fn what_cannot_be_compared_is_a_sentence() {
    let robot = blessed();
    let replay = ["replay", SECOND, "--model", MODEL, "--expect"];
    robot.refuse(
        &[&replay[..], &["nowhere.csv"]].concat(),
        1,
        "cannot read nowhere.csv: there is no such file or folder",
    );
    robot.write("other.csv", "time,kind\n0,1\n");
    robot.refuse(
        &[&replay[..], &["other.csv"]].concat(),
        1,
        "other.csv holds no replay: line 1 is not one of its lines; write it with --bless",
    );
    let text = String::from_utf8(robot.read(BLESSED)).unwrap();
    robot.write("cut.csv", text.lines().take(3).collect::<Vec<_>>().join("\n") + "\n2");
    robot.refuse(
        &[&replay[..], &["cut.csv"]].concat(),
        1,
        "cut.csv holds no replay: line 4 is not one of its lines; write it with --bless",
    );
}

/// The trip of the demo with a model that the repository carries: `tests/replay/README.md`.
#[test]
fn nothing_has_changed_on_the_trip_that_the_repository_carries() {
    let file = |name: &str| -> String {
        let path: PathBuf = Path::new(env!("CARGO_MANIFEST_DIR")).join(name);
        path.into_os_string().into_string().unwrap()
    };
    let robot = Robot::new();
    let (trip, model, expected) =
        (file("demo/trip2.mcap"), file("tests/replay/ring.kinds"), file("tests/replay/ring.csv"));
    let outcome = robot.run(&["replay", &trip, "--model", &model, "--expect", &expected]);
    assert_eq!(outcome.code, Some(0), "{outcome:?}");
}
