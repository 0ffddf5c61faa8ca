//! `kinds replay`: what changes is noticed, and nothing changes by itself.

use std::path::PathBuf;

use rustix::thread::{CpuSet, sched_getaffinity, sched_setaffinity};

use crate::robot::{FIRST, MODEL, Robot, SECOND};
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
    assert_eq!(
        lines[0],
        "sequence,status,kind,novelty,log_likelihood,p0,p1,p2,p3,p4,filtered_kind,f0,f1,f2,f3,f4"
    );
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
fn a_change_fails_even_if_nobody_reads_what_is_said_of_it() {
    let robot = blessed();
    robot.write(BLESSED, "sequence,status,kind,novelty,log_likelihood,p0,p1,p2,p3,p4\n");
    let (replay, out) = robot.start_into(&["replay", SECOND, "--model", MODEL, "--expect", BLESSED]);
    drop(out);
    let outcome = replay.end();
    assert_eq!(outcome.code, Some(1), "{outcome:?}");
    assert!(outcome.stderr.contains(" frames differ from what was expected, "), "{outcome:?}");
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

/// Recorded trips and models that the repository carries, `tests/replay/README.md`: 16 readings and 19840.
#[test]
fn nothing_has_changed_on_the_trips_that_the_repository_carries() {
    let file = |name: String| -> String {
        let path: PathBuf = [env!("CARGO_MANIFEST_DIR"), "tests/replay", &name].iter().collect();
        path.into_os_string().into_string().unwrap()
    };
    for n_processors in [1, 2] {
        for sensor in ["ring", "camera"] {
            let [trip, model, expected] =
                ["2.mcap", ".kinds", ".csv"].map(|ending| file(format!("{sensor}{ending}")));
            let robot = Robot::new();
            let arguments = ["replay", &trip, "--model", &model, "--expect", &expected];
            let outcome = on_processors(n_processors, || robot.run(&arguments));
            assert_eq!(outcome.code, Some(0), "{sensor}, {n_processors} processors: {outcome:?}");
        }
    }
}

#[test]
fn one_processor_and_two_train_the_same_model_and_replay_the_same_digits() {
    let outcomes = [1, 2].map(|n_processors| {
        let robot = Robot::new();
        Trip::FIRST.write(&robot.path(FIRST));
        Trip::SECOND.write(&robot.path(SECOND));
        on_processors(n_processors, || {
            robot.succeed(&["train", FIRST, "--output", MODEL]);
            robot.succeed(&["replay", SECOND, "--model", MODEL, "--bless", BLESSED]);
        });
        (robot.read(MODEL), String::from_utf8(robot.read(BLESSED)).unwrap())
    });
    assert!(outcomes[0].0 == outcomes[1].0, "the models differ");
    assert_eq!(outcomes[0].1, outcomes[1].1);
}

/// Does something on so many processors, as far as there are; programs that it starts stay on these.
fn on_processors<T: Send>(n_processors: usize, does: impl FnOnce() -> T + Send) -> T {
    // In a thread of its own: the next test of this one shall have them all again.
    std::thread::scope(|scope| {
        let there = scope.spawn(|| {
            let all = sched_getaffinity(None).unwrap();
            let mut some = CpuSet::new();
            let free = (0..CpuSet::MAX_CPU).filter(|&processor| all.is_set(processor));
            free.take(n_processors).for_each(|processor| some.set(processor));
            sched_setaffinity(None, &some).unwrap();
            does()
        });
        there.join().unwrap()
    })
}
