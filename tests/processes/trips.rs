//! `kinds trips`: recordings looked into, converted, and saved from.

use std::path::{Path, PathBuf};

use serde_json::Value;

use crate::bad_trips::write_cut_off;
use crate::robot::{FIRST, MODEL, Robot, SECOND, SIZE};
use crate::world::{Trip, read_trip};

const INFO: &str = "\
first.mcap: MCAP, N bytes, 15.9 s from 1750000000.000000000

topic   type                       messages       rate   can be
/front  sensor_msgs/msg/LaserScan       160   10.00 Hz   frames of 16 readings (1 × 16)
/odom   nav_msgs/msg/Odometry           160   10.00 Hz   poses
/rear   sensor_msgs/msg/LaserScan       160   10.00 Hz   frames of 16 readings (1 × 16)

frames of 16 readings (1 × 16) from /front, by --frames-topic /front
frames of 16 readings (1 × 16) from /rear, by --frames-topic /rear
poses from /odom
commands: none

kinds train first.mcap --output M.kinds --frames-topic /front
";

#[test]
fn info_says_what_is_in_a_trip_and_how_to_train_on_it() {
    let robot = Robot::new();
    Trip { frames_topics: &["/front", "/rear"], ..Trip::FIRST }.write(&robot.path(FIRST));
    let n_bytes = robot.read(FIRST).len();
    let said = robot.succeed(&["trips", "info", FIRST]);
    assert_eq!(said, INFO.replace(" N bytes", &format!(" {n_bytes} bytes")));
    let report: Value = serde_json::from_str(&robot.succeed(&["trips", "info", FIRST, "--json"])).unwrap();
    assert_eq!((&report["format"], &report["n_bytes"]), (&"MCAP".into(), &n_bytes.into()));
    let rear = &report["topics"][2];
    assert_eq!(
        (&rear["name"], &rear["type"], &rear["n_messages"], &rear["can_be"]),
        (&"/rear".into(), &"sensor_msgs/msg/LaserScan".into(), &160.into(), &"frames".into())
    );
    assert!((rear["rate_hz"].as_f64().unwrap() - 10.0).abs() < 1e-9);
    assert_eq!((&rear["n_gaps"], &rear["longest_gap_s"]), (&0.into(), &Value::Null));
    assert_eq!(report["frames"][1]["columns"], 16);
    assert_eq!(report["poses"][0]["is_default"], true);
    // What it says to do can be done.
    let words: Vec<&str> =
        report["train"].as_array().unwrap().iter().map(|word| word.as_str().unwrap()).collect();
    assert_eq!(words.join(" "), INFO.lines().last().unwrap());
    robot.succeed(&[&words[1..], &SIZE].concat());
}

#[test]
fn info_tells_what_was_cut_off_and_what_is_damaged() {
    let robot = Robot::new();
    write_cut_off(&robot, "cut.mcap");
    let outcome = robot.run(&["trips", "info", "cut.mcap"]);
    assert_eq!(outcome.code, Some(0));
    assert!(outcome.stderr.starts_with("kinds: trip cut.mcap is cut off at byte "), "{outcome:?}");
    assert!(outcome.stdout.ends_with("\nkinds train cut.mcap --output M.kinds\n"), "{outcome:?}");

    let mut bytes = robot.read("cut.mcap");
    let middle = bytes.len() / 2;
    bytes[middle] ^= 1;
    robot.write("damaged.mcap", bytes);
    let outcome = robot.run(&["trips", "info", "damaged.mcap"]);
    assert_eq!(outcome.code, Some(1));
    assert!(outcome.stdout.contains("/ring  sensor_msgs/msg/LaserScan"), "{outcome:?}");
    let said = outcome.stderr.trim_end();
    assert!(said.starts_with("kinds: damaged.mcap is damaged at byte "), "{said}");
    assert!(said.ends_with("; `kinds trips recover` saves what is whole of it"), "{said}");
    robot.refuse(&["trips", "info", "nowhere.mcap"], 1, "no trip at nowhere.mcap: there is no such file");
}

#[test]
fn a_converted_trip_has_the_same_frames_and_poses_and_converts_to_itself() {
    let robot = Robot::new();
    Trip::FIRST.write(&robot.path(FIRST));
    let said = robot.succeed(&["trips", "convert", FIRST, "converted.mcap"]);
    assert_eq!(
        said,
        "converted 160 frames of 16 readings (1 × 16) into converted.mcap, 160 with a pose and 0 with a command\n"
    );
    assert_same_frames(&robot.path("converted.mcap"), &robot.path(FIRST));
    robot.succeed(&["trips", "convert", "converted.mcap", "again.mcap"]);
    assert_same_frames(&robot.path("again.mcap"), &robot.path(FIRST));
    let info: Value =
        serde_json::from_str(&robot.succeed(&["trips", "info", "converted.mcap", "--json"])).unwrap();
    let names: Vec<&str> =
        info["topics"].as_array().unwrap().iter().map(|topic| topic["name"].as_str().unwrap()).collect();
    assert_eq!(names, ["/frames", "/odom"], "as the recorder names them");
}

/// Frames are equal to the bit. Poses go through quaternions, which costs a rounding or two of angles up to π.
fn assert_same_frames(a: &Path, b: &Path) {
    let (a, b) = (read_trip(a), read_trip(b));
    assert_eq!(a.len(), b.len());
    for ((a_info, a_counts), (b_info, b_counts)) in a.iter().zip(&b) {
        assert_eq!((a_info.captured, a_info.command, a_counts), (b_info.captured, b_info.command, b_counts));
        let (a, b) = (a_info.pose.unwrap(), b_info.pose.unwrap());
        assert_eq!((a.x_m, a.y_m), (b.x_m, b.y_m));
        assert!((a.yaw_rad - b.yaw_rad).abs() < 1e-14, "{a:?} {b:?}");
    }
}

#[test]
fn what_cannot_be_converted_is_a_sentence_and_leaves_nothing() {
    let robot = Robot::new();
    Trip { halved_from: 50, ..Trip::SECOND }.write(&robot.path("changing.mcap"));
    let convert = ["trips", "convert", "changing.mcap", "converted.mcap"];
    robot.refuse(&convert, 1, crate::bad_trips::CHANGING);
    let onto_itself = ["trips", "convert", "changing.mcap", "changing.mcap"];
    robot.refuse(&onto_itself, 1, "cannot write changing.mcap: it is there already; choose another name");
    let files: Vec<_> = robot.files().into_keys().collect();
    assert_eq!(files, [PathBuf::from("changing.mcap")]);
}

#[test]
fn what_is_whole_of_a_damaged_trip_is_saved_and_the_rest_is_told() {
    let robot = Robot::trained();
    Trip { in_small_chunks: true, ..Trip::SECOND }.write(&robot.path("wreck.mcap"));
    let whole = read_trip(&robot.path("wreck.mcap"));
    let said = robot.succeed(&["trips", "recover", "wreck.mcap", "whole.mcap"]);
    assert_eq!(said, "saved 260 messages on 2 topics into whole.mcap\nnothing was lost\n");
    assert_eq!(read_trip(&robot.path("whole.mcap")), whole);

    let mut bytes = robot.read("wreck.mcap");
    let middle = bytes.len() / 2;
    bytes[middle] ^= 1;
    robot.write("wreck.mcap", &bytes);
    let refused = robot.run(&["evaluate", MODEL, FIRST, "wreck.mcap"]);
    assert_eq!(refused.code, Some(1), "{refused:?}");
    let said = robot.succeed(&["trips", "recover", "wreck.mcap", "saved.mcap"]);
    let lines: Vec<&str> = said.lines().collect();
    let [saved, lost, place, rest] = lines[..] else { panic!("{said}") };
    assert!(
        saved.starts_with("saved 2") && saved.ends_with(" messages on 2 topics into saved.mcap"),
        "{said}"
    );
    assert!(lost.starts_with("lost ") && lost.ends_with(" bytes in 1 place:"), "{said}");
    assert!(place.starts_with("  bytes ") && place.contains(": a chunk's checksum should be "), "{said}");
    assert_eq!(rest, "the recording was closed: everything else is there");
    assert_eq!(robot.read("wreck.mcap"), bytes);
    robot.succeed(&["evaluate", MODEL, FIRST, "saved.mcap"]);

    robot.write("cut.mcap", &bytes[..middle - 100]);
    let said = robot.succeed(&["trips", "recover", "cut.mcap", "cut-saved.mcap"]);
    let last = "the recording was not closed: whether anything came after this, nobody can tell";
    assert_eq!(said.lines().last(), Some(last), "{said}");
    assert!(read_trip(&robot.path("cut-saved.mcap")).len() > 40);
}

#[test]
fn what_cannot_be_saved_from_is_a_sentence_and_leaves_nothing() {
    let robot = Robot::new();
    Trip::SECOND.write(&robot.path(SECOND));
    robot.write("text.mcap", "hello");
    robot.write("none.bag", "#ROSBAG V2.0\n");
    robot.write("old.bag", "#ROSBAG V1.2\n");
    let taken = format!("cannot write {SECOND}: it is there already; choose another name");
    robot.refuse(&["trips", "recover", SECOND, SECOND], 1, &taken);
    let before = robot.files();
    for (from, sentence) in [
        ("nowhere.mcap", "no trip at nowhere.mcap: there is no such file"),
        ("text.mcap", "text.mcap has no whole message to save in its 5 bytes"),
        ("none.bag", "none.bag has no whole message to save in its 13 bytes"),
        (
            "old.bag",
            "old.bag is a ROS 1 bag of another version; only MCAP files and ROS 1 bags of format 2.0 can be saved from",
        ),
    ] {
        robot.refuse(&["trips", "recover", from, "saved.mcap"], 1, sentence);
    }
    robot.refuse_with(&["trips", "recover", SECOND], 2, &["required arguments were not provided"]);
    robot.refuse_with(&["trips"], 2, &["Look into recorded trips"]);
    assert_eq!(robot.files(), before);
}
