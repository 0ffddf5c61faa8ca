//! Commands come to frames: the last one holds, whatever the order in which they were logged.

use kinds_trips::{Command, Scan, Stamp, TripWriter, WriterOptions};

use crate::bag::{
    Bag, Folder, LASER_SCAN, ODOMETRY, TWIST, TWIST_STAMPED, odometry, read, read_whole, scan, twist_in,
    twist_stamped_in,
};

/// What stands in a bag: a frame, a command or a pose, with its stamp in ms.
#[derive(Clone, Copy)]
enum Entry {
    Frame(u32),
    Told(u32),
    Pose(u32),
}

use Entry::{Frame, Pose, Told};

fn stamp(ms: u32) -> (u32, u32) {
    (1000 + ms / 1000, ms % 1000 * 1_000_000)
}

/// Reads a bag with these in this order; of each frame, when its command was given.
fn told_ms(entries: &[Entry]) -> Vec<Option<u32>> {
    let folder = Folder::new();
    let path = folder.join("trip.mcap");
    let mut bag = Bag::create(&path);
    let frames = bag.topic("/scan", LASER_SCAN);
    let [mut commands, mut poses] = [None; 2];
    for (log_time, &entry) in (1_000_000_000u64..).step_by(1000).zip(entries) {
        match entry {
            Frame(ms) => bag.message(frames, log_time, &scan(stamp(ms), &[1.0])),
            Told(ms) => {
                let id = *commands.get_or_insert_with(|| bag.topic("/cmd_vel", TWIST_STAMPED));
                bag.message(id, log_time, &twist_stamped_in(false, stamp(ms), f64::from(ms), -f64::from(ms)));
            }
            Pose(ms) => {
                let id = *poses.get_or_insert_with(|| bag.topic("/odom", ODOMETRY));
                bag.message(id, log_time, &odometry(stamp(ms), 0.0));
            }
        }
    }
    bag.finish();
    let told = |(forward_m_s, turn_rad_s): (f64, f64)| {
        assert_eq!(turn_rad_s, -forward_m_s);
        forward_m_s as u32
    };
    read_whole(&path).commands().into_iter().map(|command| command.map(told)).collect()
}

#[test]
fn a_frame_takes_the_last_command_at_or_before_it() {
    let check = |entries: &[Entry], expected: &[Option<u32>]| assert_eq!(told_ms(entries), expected);
    check(&[Frame(0), Frame(100)], &[None, None]);
    check(&[Told(0), Frame(0)], &[Some(0)]);
    check(
        &[Frame(50), Told(60), Frame(70), Frame(80), Told(90), Frame(90)],
        &[None, Some(60), Some(60), Some(90)],
    );
    // However long ago.
    check(&[Told(10), Frame(1_000_000), Told(2_000_000)], &[Some(10)]);
    // Of two at one moment, the one that was logged later.
    check(&[Told(10), Told(20), Frame(20)], &[Some(20)]);
}

#[test]
fn commands_that_are_logged_late_or_out_of_order_are_waited_for() {
    assert_eq!(told_ms(&[Told(0), Frame(50), Frame(60), Told(40), Told(70)]), [Some(40), Some(40)]);
    assert_eq!(told_ms(&[Told(90), Told(30), Frame(50), Frame(95)]), [Some(30), Some(90)]);
}

#[test]
fn all_frames_come_when_commands_stop_and_when_poses_do() {
    // A minute at 10 Hz. In its first second there are commands, in its last there are poses.
    let mut entries = Vec::new();
    for index in 0..600 {
        entries.push(Frame(100 * index));
        match index {
            0..10 => entries.push(Told(100 * index)),
            590.. => entries.push(Pose(100 * index)),
            _ => {}
        }
    }
    let expected: Vec<Option<u32>> = (0..600).map(|index| Some(100 * index.min(9))).collect();
    assert_eq!(told_ms(&entries), expected);
}

#[test]
fn a_command_without_a_stamp_was_given_when_it_was_logged() {
    let folder = Folder::new();
    let path = folder.join("trip.mcap");
    for (type_name, told) in [
        (TWIST, twist_in as fn(bool, f64, f64) -> Vec<u8>),
        (TWIST_STAMPED, |big, forward, turn| twist_stamped_in(big, (0, 0), forward, turn)),
    ] {
        let mut bag = Bag::create(&path);
        let (frames, commands) = (bag.topic("/scan", LASER_SCAN), bag.topic("/cmd_vel", type_name));
        bag.message(commands, 1_000_000_000_000, &told(false, 1.0, 0.5));
        bag.message(commands, 1_000_200_000_000, &told(false, 2.0, 0.25));
        for ms in [100, 200, 300] {
            bag.message(frames, 1_000_250_000_000, &scan(stamp(ms), &[1.0]));
        }
        bag.finish();
        assert_eq!(read_whole(&path).commands(), [Some((1.0, 0.5)), Some((2.0, 0.25)), Some((2.0, 0.25))]);
    }
}

#[test]
fn a_command_that_is_no_velocity_changes_nothing() {
    let folder = Folder::new();
    let path = folder.join("trip.mcap");
    let mut bag = Bag::create(&path);
    let (frames, commands) = (bag.topic("/scan", LASER_SCAN), bag.topic("/cmd_vel", TWIST_STAMPED));
    for (ms, forward_m_s) in [(0, f64::NAN), (20, 1.0), (30, f64::INFINITY)] {
        bag.message(commands, 1, &twist_stamped_in(false, stamp(ms), forward_m_s, 0.5));
    }
    for ms in [10, 40] {
        bag.message(frames, 2, &scan(stamp(ms), &[1.0]));
    }
    bag.finish();
    assert_eq!(read_whole(&path).commands(), [None, Some((1.0, 0.5))]);
}

#[test]
fn commands_come_back_from_a_trip_that_was_cut_off() {
    let folder = Folder::new();
    let options = WriterOptions { indexed: false, ..WriterOptions::default() };
    let mut writer = TripWriter::create(&folder.join("trip.mcap"), &options).unwrap();
    let command = |index: i64| Command { forward_m_s: index as f64, turn_rad_s: 0.5 };
    for index in 0..4 {
        let at = Stamp(1_000_000_000 * (index + 1));
        writer.write_command("/cmd_vel", at, &command(index)).unwrap();
        let scan = Scan {
            counts: &[1000],
            metres_per_count: 0.001,
            bearing_rad_min: 0.0,
            bearing_step_rad: 0.0,
            range_m_min: 0.0,
            range_m_max: 4.0,
        };
        writer.write_scan("/scan", at, &scan).unwrap();
        if index == 2 {
            writer.flush().unwrap();
        }
    }
    let [partial] = folder.names().try_into().unwrap();
    let trip = read(&folder.join(&partial)).unwrap();
    assert!(trip.truncation.is_some());
    assert_eq!(trip.commands(), [0.0, 1.0, 2.0].map(|forward_m_s| Some((forward_m_s, 0.5))));
}
