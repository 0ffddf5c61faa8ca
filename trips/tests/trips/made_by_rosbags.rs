//! Bags that `rosbags` wrote, the independent implementation in Python, where Python has it: the same trip as a ROS 2 bag
//! in MCAP, and as ROS 1 bags of each compression, with every type of message that is read.

use std::path::{Path, PathBuf};
use std::process::Command;

use kinds_trips::{Gives, Role, Selection, TripInfo, salvage};

use crate::bag::{Folder, Read, read_with};
use crate::made_elsewhere::skipped;
use crate::read_elsewhere::rosbags_is_here;

const N_FRAMES: usize = 3;

/// The bags; none where Python has no rosbags.
fn bags() -> Option<(Folder, Vec<PathBuf>)> {
    if !rosbags_is_here() {
        return None;
    }
    let folder = Folder::new();
    let script = concat!(env!("CARGO_MANIFEST_DIR"), "/tests/trips/write_bags.py");
    let output = Command::new("python3").arg(script).arg(folder.join("")).output().unwrap();
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let bags = ["ros2/ros2.mcap", "none.bag", "bz2.bag", "lz4.bag"].map(|name| folder.join(name)).to_vec();
    Some((folder, bags))
}

/// Reads frames from a topic, or several, with poses and commands of others.
fn read(bag: &Path, frames: &str, poses: &str, commands: &str) -> Read {
    let some = |name: &str| Some(name.to_owned());
    let selection = Selection {
        frames_topic: some(frames),
        poses_topic: some(poses),
        commands_topic: some(commands),
        ..Selection::default()
    };
    let read = read_with(bag, &selection).unwrap();
    assert!(read.failure.is_none() && read.truncation.is_none(), "{read:?}");
    read
}

#[test]
fn every_type_of_frame_is_read_from_ros_2_and_ros_1() {
    let Some((_folder, bags)) = bags() else { return };
    for bag in &bags {
        let check = |frames: &str, (rows, columns): (u32, u32), expected: [&[u16]; N_FRAMES]| {
            let read = read(bag, frames, "/odom", "/cmd_vel");
            assert_eq!(read.counts(), expected, "{frames} in {}", bag.display());
            assert_eq!((read.layout.rows, read.layout.columns), (rows, columns));
            for (index, (info, _)) in read.frames.iter().enumerate() {
                let tenths = info.captured.0 / 100_000_000;
                assert_eq!(tenths, 10_000 + index as i64, "{frames}");
            }
        };
        let thrice = |counts: &'static [u16]| [counts; N_FRAMES];
        check("/scan", (1, 3), thrice(&[0, 1250, 4000]));
        check("/depth", (2, 2), [&[1, 2, 3, 4], &[1, 2, 3, 5], &[1, 2, 3, 6]]);
        // 0.02 s after the first frame, and 0.02 s after the third.
        check("/sonar_2,/sonar_10", (1, 2), [&[1000, 0], &[2000, 500], &[3000, 500]]);
        check("/sonar_2", (1, 1), [&[1000], &[2000], &[3000]]);
        check("/numbers", (2, 2), thrice(&[1000, 2000, 3000, 4000]));
        check("/row", (1, 2), thrice(&[500, 65535]));
        // By the distance from the origin, respectively by z: no measurement, no return, and at the origin.
        check("/lidar", (2, 3), thrice(&[5000, 0, 0, 1000, 65535, 2236]));
        check("/points", (2, 3), thrice(&[0, 0, 0, 0, 0, 2000]));
        check("/raw/compressedDepth", (2, 2), thrice(&[0, 1000, 258, 65535]));
        check("/metric/compressedDepth", (2, 2), thrice(&[0, 2000, 500, 500]));
    }
}

#[test]
fn every_type_of_pose_and_command_is_read_from_ros_2_and_ros_1() {
    let Some((_folder, bags)) = bags() else { return };
    for bag in &bags {
        for poses in ["/odom", "/truth"] {
            assert_eq!(read(bag, "/scan", poses, "/cmd_vel").x_m(), [Some(1.5); N_FRAMES]);
        }
        for (commands, told) in [("/cmd_vel", (0.25, -1.5)), ("/cmd_vel_stamped", (0.5, 1.5))] {
            assert_eq!(read(bag, "/scan", "/odom", commands).commands(), [Some(told); N_FRAMES]);
        }
    }
}

#[test]
fn what_is_in_a_bag_is_the_same_whatever_sort_of_file_it_is() {
    let Some((_folder, bags)) = bags() else { return };
    for bag in &bags {
        let info = TripInfo::read(bag).unwrap();
        assert!(info.failure.is_none() && info.cut_off.is_none(), "{info:?}");
        let expected = if bag.extension().unwrap() == "bag" { "ROS 1 bag" } else { "MCAP" };
        assert_eq!(info.format.to_string(), expected);
        assert_eq!(info.topics.len(), 14);
        for topic in &info.topics {
            let n_messages = if topic.topic.name == "/sonar_10" { 2 } else { 3 };
            assert_eq!((topic.topic.n_messages, topic.n_backwards), (n_messages, 0));
            let period_s = if topic.topic.name == "/sonar_10" { 0.2 } else { 0.1 };
            assert!((topic.period_s.unwrap() - period_s).abs() < 1e-9);
            assert!(!matches!(topic.gives, Gives::Nothing | Gives::Unfit(..)), "{topic:?}");
        }
        let names: Vec<String> = info.frames().into_iter().map(|choice| choice.name).collect();
        let expected = [
            "/depth",
            "/lidar",
            "/metric/compressedDepth",
            "/numbers",
            "/points",
            "/raw/compressedDepth",
            "/row",
            "/scan",
            "/sonar_2,/sonar_10",
        ];
        assert_eq!(names, expected);
        let default = |choices: Vec<kinds_trips::Choice>| {
            let default = choices.into_iter().filter(|choice| choice.is_default);
            default.map(|choice| choice.name).collect::<Vec<_>>()
        };
        assert_eq!(default(info.frames()), [""; 0], "a scan and an image");
        assert_eq!(default(info.beside_frames(Role::Poses)), ["/odom"]);
        assert_eq!(default(info.beside_frames(Role::Commands)), [""; 0]);
    }
}

#[test]
fn a_ros_1_bag_cut_off_anywhere_gives_the_frames_before_and_a_wrong_byte_stops_nobody() {
    let Some((folder, bags)) = bags() else { return };
    let selection = Selection {
        frames_topic: Some("/depth".to_owned()),
        poses_topic: Some("/odom".to_owned()),
        ..Selection::default()
    };
    for bag in &bags[1..] {
        let bytes = std::fs::read(bag).unwrap();
        let whole = read_with(bag, &selection).unwrap().counts();
        let mut n_before = 0;
        for n_bytes in (1..bytes.len()).step_by(23) {
            if let Ok(trip) = read_with(&folder.write("cut.bag", &bytes[..n_bytes]), &selection) {
                assert!(trip.failure.is_none(), "{n_bytes}: {:?}", trip.failure);
                assert!(whole.starts_with(&trip.counts()));
                assert_eq!(trip.truncation.unwrap().n_frames, trip.frames.len() as u64);
                assert!(trip.frames.len() >= n_before);
                n_before = trip.frames.len();
            }
        }
        assert_eq!(n_before, N_FRAMES);
        for index in (0..bytes.len()).step_by(11) {
            let mut flipped = bytes.clone();
            flipped[index] ^= 0x81;
            let _ = read_with(&folder.write("flipped.bag", &flipped), &selection);
        }
    }
}

#[test]
fn a_ros_1_recorder_that_was_killed_leaves_what_stands_in_its_open_chunk() {
    let Some((folder, bags)) = bags() else { return };
    let bytes = std::fs::read(&bags[1]).unwrap();
    // The bag's header takes 4096 bytes with its lengths; then the first chunk. What a recorder fills in at the end: where the
    // index is, and how long the chunk.
    let chunk = 13 + 4096;
    let header_bytes = u32::from_le_bytes(bytes[chunk..chunk + 4].try_into().unwrap()) as usize;
    let mut open = bytes.clone();
    let index_pos = bytes.windows(10).position(|window| window == b"index_pos=").unwrap() + 10;
    let end = u64::from_le_bytes(bytes[index_pos..index_pos + 8].try_into().unwrap()) as usize;
    open[index_pos..index_pos + 8].fill(0);
    let size = bytes.windows(5).position(|window| window == b"size=").unwrap() + 5;
    open[size..size + 4].fill(0);
    open[chunk + 4 + header_bytes..chunk + 8 + header_bytes].fill(0);
    let selection = Selection { frames_topic: Some("/scan".to_owned()), ..Selection::default() };
    let killed = read_with(&folder.write("killed.bag", &open[..end - 100]), &selection).unwrap();
    assert_eq!(killed.frames.len(), N_FRAMES);
    assert!(killed.truncation.is_some());
}

#[test]
fn what_other_programs_coded_by_rvl_is_the_image_that_they_had() {
    let probe = Command::new("python3").args(["-c", "import rvl, pyrvl, rosbags, numpy"]).output();
    if !probe.is_ok_and(|probe| probe.status.success()) {
        return skipped("there is no python3 that has rvl, pyrvl and rosbags");
    }
    let folder = Folder::new();
    let script = concat!(env!("CARGO_MANIFEST_DIR"), "/tests/trips/write_rvl.py");
    let output = Command::new("python3").arg(script).arg(folder.join("")).output().unwrap();
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let frames = |topic: &str| {
        let selection = Selection { frames_topic: Some(topic.to_owned()), ..Selection::default() };
        let read = read_with(&folder.join("rvl/rvl.mcap"), &selection).unwrap();
        assert!(read.failure.is_none() && read.truncation.is_none(), "{read:?}");
        assert_eq!((read.layout.rows, read.layout.columns, read.frames.len()), (37, 53, 6));
        read.frames
    };
    let images = frames("/depth");
    assert!(images[0].1.contains(&0) && images[0].1.iter().any(|&count| count > 1000));
    for topic in ["/rvl/compressedDepth", "/pyrvl/compressedDepth"] {
        assert_eq!(frames(topic), images, "{topic}");
    }
}

#[test]
fn what_rosbags_wrote_can_be_saved() {
    let Some((folder, bags)) = bags() else { return };
    let to = folder.join("saved.mcap");
    let selection = Selection { frames_topic: Some("/depth".to_owned()), ..Selection::default() };
    let frames = |path| read_with(path, &selection).unwrap().frames;
    for bag in &bags {
        let saved = salvage(bag, &to).unwrap();
        assert_eq!((saved.n_messages, saved.n_losses, saved.n_topics), (41, 0, 14));
        assert_eq!(frames(&to), frames(bag));
    }
}

#[test]
fn the_first_of_several_topics_sets_the_pace() {
    let Some((_folder, bags)) = bags() else { return };
    for bag in &bags {
        let selection =
            Selection { frames_topic: Some("/sonar_10,/sonar_2".to_owned()), ..Selection::default() };
        assert_eq!(read_with(bag, &selection).unwrap().counts(), [[500, 1000], [500, 3000]]);
    }
}
