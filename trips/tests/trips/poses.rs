//! Poses come to frames, whatever the order in which they were logged, and in bounded memory.

use kinds_trips::Stamp;

use crate::bag::{Bag, Folder, LASER_SCAN, ODOMETRY, odometry, odometry_in, read_whole, scan};

const MS: u32 = 1_000_000;

/// Reads a bag of scans and poses (with x the seconds of their stamp), in this order: `('f' or 'p', stamp in ms)`.
fn x_m_of_frames(messages: &[(char, u32)]) -> Vec<Option<f64>> {
    let folder = Folder::new();
    let path = folder.join("trip.mcap");
    let mut bag = Bag::create(&path);
    let (frames, poses) = (bag.topic("/scan", LASER_SCAN), bag.topic("/odom", ODOMETRY));
    for (log_time, &(kind, ms)) in (1_000_000_000u64..).step_by(1000).zip(messages) {
        let stamp = (1000 + ms / 1000, ms % 1000 * MS);
        match kind {
            'f' => bag.message(frames, log_time, &scan(stamp, &[1.0])),
            _ => bag.message(poses, log_time, &odometry(stamp, f64::from(ms) * 1e-3)),
        }
    }
    bag.finish();
    read_whole(&path).x_m()
}

fn check(messages: &[(char, u32)], expected_x_m: &[Option<f64>]) {
    let found = x_m_of_frames(messages);
    let same = |(a, b): (&Option<f64>, &Option<f64>)| match (a, b) {
        (Some(a), Some(b)) => (a - b).abs() < 1e-9,
        _ => a == b,
    };
    assert_eq!(found.len(), expected_x_m.len());
    assert!(found.iter().zip(expected_x_m).all(same), "{found:?} is not {expected_x_m:?}");
}

#[test]
fn a_frame_takes_the_pose_between_the_two_around_it() {
    check(&[('p', 0), ('f', 25), ('p', 100), ('f', 150), ('p', 200)], &[Some(0.025), Some(0.15)]);
}

#[test]
fn odometry_that_is_logged_late_is_waited_for() {
    check(&[('f', 25), ('f', 50), ('f', 75), ('p', 0), ('p', 100)], &[Some(0.025), Some(0.05), Some(0.075)]);
}

#[test]
fn frames_that_are_logged_late_find_the_poses_of_their_time() {
    check(&[('p', 0), ('p', 100), ('p', 200), ('p', 300), ('f', 50), ('f', 150)], &[Some(0.05), Some(0.15)]);
}

#[test]
fn frames_outside_the_poses_take_the_nearest_within_reach() {
    check(
        &[('f', 0), ('f', 900), ('p', 1000), ('p', 1100), ('f', 1300), ('f', 1301)],
        &[None, Some(1.0), Some(1.1), None],
    );
}

#[test]
fn all_frames_come_when_odometry_stops_and_when_there_is_none() {
    // A minute at 10 Hz, of which the first second has poses.
    let mut messages: Vec<(char, u32)> = (0..600).map(|index| ('f', 100 * index)).collect();
    assert_eq!(x_m_of_frames(&messages), vec![None; 600]);
    for index in 0..11 {
        messages.insert(2 * index, ('p', 100 * index as u32));
    }
    let expected: Vec<Option<f64>> =
        (0..600).map(|index| (index <= 12).then(|| f64::from(index.min(10)) * 0.1)).collect();
    check(&messages, &expected);
}

#[test]
fn odometry_that_is_lost_is_a_gap() {
    let folder = Folder::new();
    let path = folder.join("trip.mcap");
    let mut bag = Bag::create(&path);
    let (frames, poses) = (bag.topic("/scan", LASER_SCAN), bag.topic("/odom", ODOMETRY));
    bag.message(poses, 1, &odometry_in(false, (1000, 0), [f64::NAN; 3], [0.0, 0.0, 0.0, 1.0]));
    bag.message(frames, 2, &scan((1000, 0), &[1.0]));
    bag.message(poses, 3, &odometry_in(false, (1000, 0), [0.0; 3], [0.0; 4]));
    bag.finish();
    assert_eq!(read_whole(&path).x_m(), [None]);
}

#[test]
fn a_message_without_a_stamp_was_captured_when_it_was_logged() {
    let folder = Folder::new();
    let path = folder.join("trip.mcap");
    let mut bag = Bag::create(&path);
    let (frames, poses) = (bag.topic("/scan", LASER_SCAN), bag.topic("/odom", ODOMETRY));
    bag.message(poses, 5_000_000_000, &odometry((0, 0), 5.0));
    bag.message(frames, 5_250_000_000, &scan((0, 0), &[1.0]));
    bag.message(poses, 5_500_000_000, &odometry((0, 0), 5.5));
    bag.finish();
    let trip = read_whole(&path);
    assert_eq!(trip.frames[0].0.captured, Stamp(5_250_000_000));
    assert_eq!(trip.x_m(), [Some(5.25)]);
}
