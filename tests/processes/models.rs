//! Model files that are not as they should be, and places where none can be written.

use crate::robot::{FIRST, MODEL, Robot, SECOND, SENSOR};

/// Whatever opens a model says the same of it.
fn check(robot: &Robot, model: &str, parts: &[&str]) {
    robot.refuse_with(&["inspect", model], 1, parts);
    robot.refuse_with(&["evaluate", model, FIRST, SECOND], 1, parts);
    robot.refuse_with(&["serve", "--model", model, "--sensor", SENSOR], 1, parts);
    assert_eq!(robot.shared_memory(), [""; 0]);
}

#[test]
fn a_model_that_is_not_there_is_a_sentence() {
    let robot = Robot::trained();
    check(&robot, "nowhere.kinds", &["model", "nowhere.kinds: "]);
    check(&robot, ".", &["cannot open model .: it is not a file"]);
}

#[test]
fn a_truncated_model_is_a_sentence_that_says_what_to_do() {
    let robot = Robot::trained();
    let whole = robot.read(MODEL);
    for n_bytes in [0, 7, 1000, whole.len() - 1] {
        robot.write("cut.kinds", &whole[..n_bytes]);
        let beginning = format!(
            "cannot open model cut.kinds: not a whole model file: {n_bytes} bytes do not hold what their header \
             announces ("
        );
        check(&robot, "cut.kinds", &[&beginning, "); copy it again or train anew"]);
    }
}

#[test]
fn a_flipped_bit_is_a_sentence_that_says_what_to_do() {
    let robot = Robot::trained();
    let mut bytes = robot.read(MODEL);
    let middle = bytes.len() / 2;
    bytes[middle] ^= 1;
    robot.write("flipped.kinds", bytes);
    check(
        &robot,
        "flipped.kinds",
        &[
            "cannot open model flipped.kinds: the model file is damaged: its contents have digest ",
            "; copy it again",
        ],
    );
}

#[test]
fn a_file_that_is_no_model_is_a_sentence() {
    let robot = Robot::trained();
    check(&robot, FIRST, &["cannot open model first.mcap: not a whole model file: "]);
}

#[test]
fn a_place_where_no_model_can_be_written_is_a_sentence() {
    let robot = Robot::trained();
    std::fs::create_dir(robot.path("folder")).unwrap();
    robot.refuse(&["train", FIRST, "--output", "folder"], 1, "cannot write model folder: it is a folder");
    robot.refuse_with(
        &["train", FIRST, "--output", "nowhere/m.kinds"],
        1,
        &["cannot write model nowhere/m.kinds: "],
    );
    // Found out before the trip is read, let alone learnt.
    robot.refuse_with(
        &["train", "nowhere.mcap", "--output", "nowhere/m.kinds"],
        1,
        &["cannot write model nowhere/m.kinds: "],
    );
}
