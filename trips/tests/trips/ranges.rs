//! Frames of several topics with a single range each.

use kinds_trips::{Selection, TripReader};

use crate::bag::{
    Bag, Cdr, Folder, LASER_SCAN, ODOMETRY, RANGE, odometry, read, read_whole, read_with, refusal, scan,
};

/// A range of a sensor that measures from 0.1 m to 4 m.
fn range(stamp: (u32, u32), metres: f32) -> Vec<u8> {
    Cdr::new(false).header(stamp).u8(0).f32s(&[0.5, 0.1, 4.0, metres]).done()
}

/// The same of another sensor.
fn other_range((sec, nanosec): (u32, u32), metres: f32) -> Vec<u8> {
    let message = Cdr::new(false).u32(sec).u32(nanosec).bytes(b"other\0");
    message.u8(0).f32s(&[0.5, 0.1, 4.0, metres]).done()
}

const MS: u32 = 1_000_000;

/// A bag with messages on `/left` and `/right`, by milliseconds and metres, logged in the order of `order`.
fn bag(
    folder: &Folder,
    left: &[(u32, f32)],
    right: &[(u32, f32)],
    order: impl Fn(bool, u32) -> u32,
) -> std::path::PathBuf {
    let path = folder.join("trip.mcap");
    let mut bag = Bag::create(&path);
    let ids = ["/left", "/right"].map(|name| bag.topic(name, RANGE));
    let mut all: Vec<_> =
        left.iter().map(|of| (false, of)).chain(right.iter().map(|of| (true, of))).collect();
    all.sort_by_key(|(is_right, (ms, _))| order(*is_right, *ms));
    for (is_right, (ms, metres)) in all {
        bag.message(ids[usize::from(is_right)], (*ms).into(), &range((1000, ms * MS), *metres));
    }
    bag.finish();
    path
}

#[test]
fn readings_are_paired_by_their_stamps_whatever_the_order_they_were_logged_in() {
    let folder = Folder::new();
    let left = [(0, 1.0), (100, 1.1), (200, 1.2), (300, 1.3)];
    let right = [(30, 2.0), (130, 2.1), (230, 2.2), (330, 2.3)];
    // What comes later is not waited for, however near: 100 ms is nearer to 130 than to 30.
    let expected = [[1000, 0], [1100, 2000], [1200, 2100], [1300, 2200]];
    for order in [
        |_, ms| ms,
        |is_right, ms| ms + if is_right { 500 } else { 0 },
        |is_right, ms| ms + if is_right { 0 } else { 500 },
    ] {
        let trip = read_whole(&bag(&folder, &left, &right, order));
        assert_eq!(trip.counts(), expected);
        assert_eq!((trip.layout.rows, trip.layout.columns), (1, 2));
    }
}

#[test]
fn a_reading_that_is_missing_is_invalid_and_that_is_said() {
    let folder = Folder::new();
    let left: Vec<_> = (0..10).map(|index| (100 * index, 1.0)).collect();
    // From 200 ms to 900 ms there is none.
    let right: Vec<_> = left.iter().copied().filter(|(ms, _)| !(300..900).contains(ms)).collect();
    let path = bag(&folder, &left, &right, |_, ms| ms);
    let mut trip = TripReader::open(&path, &Selection::default()).unwrap();
    assert_eq!(trip.frames_topic(), "/left,/right");
    let mut counts = [7; 2];
    let mut right = Vec::new();
    while trip.next_frame(&mut counts).unwrap().is_some() {
        assert_eq!(counts[0], 1000);
        right.push(counts[1]);
    }
    // Of 300 ms and 400 ms, 200 ms is within a quarter of a second.
    assert_eq!(right, [1000, 1000, 1000, 1000, 1000, 0, 0, 0, 0, 1000]);
    assert_eq!(trip.missing_partners(), [("/right", 4)]);
    assert_eq!(
        trip.remarks(),
        [
            "has no frame of /right at the time of 4 of its 10 frames, or at most 250 ms before; there its reading is taken as invalid"
        ]
    );
}

#[test]
fn a_sensor_that_stops_keeps_no_frame_back_for_good_and_memory_is_bounded() {
    let folder = Folder::new();
    let left: Vec<_> = (0..600).map(|index| (index, 1.0)).collect();
    let path = bag(&folder, &left, &[(0, 2.0)], |_, ms| ms);
    let trip = read_whole(&path);
    assert_eq!(trip.frames.len(), 600);
    let n_right = trip.counts().iter().filter(|counts| counts[1] == 2000).count();
    // Within 250 ms, and the first of 600 ms was taken when 256 frames waited.
    assert_eq!(n_right, 251);
}

#[test]
fn single_ranges_are_a_frame_only_where_nothing_better_is_or_they_are_named() {
    let folder = Folder::new();
    let path = folder.join("trip.mcap");
    let mut bag = Bag::create(&path);
    for name in ["/sonar_10", "/sonar_9"] {
        let id = bag.topic(name, RANGE);
        bag.message(id, 1, &range((1000, 0), if name == "/sonar_9" { 0.9 } else { 1.0 }));
    }
    let (scans, poses) = (bag.topic("/scan", LASER_SCAN), bag.topic("/odom", ODOMETRY));
    bag.message(scans, 2, &scan((1000, 0), &[2.0, 3.0]));
    bag.message(poses, 3, &odometry((1000, 0), 1.0));
    bag.finish();
    let named = |names: &str| Selection { frames_topic: Some(names.to_owned()), ..Selection::default() };
    assert_eq!(read(&path).unwrap().counts(), [[2000, 3000]]);
    let counts = |names: &str| read_with(&path, &named(names)).unwrap().counts();
    assert_eq!(counts("/sonar_9,/sonar_10"), [[900, 1000]]);
    assert_eq!(counts("/sonar_10, /sonar_9"), [[1000, 900]]);
    assert_eq!(counts("/sonar_10"), [[1000]]);
    assert_eq!(
        refusal(&path, &named("/sonar_9,/scan, /sonar_9")),
        "--frames-topic has /sonar_9 twice; name each topic once"
    );
    let sentence = refusal(&path, &named("/sonar_9,/sonar_11"));
    assert!(
        sentence.contains(" has no topic /sonar_11, asked for with --frames-topic; it has /odom ("),
        "{sentence}"
    );
}

#[test]
fn sensors_that_share_a_topic_are_refused() {
    let folder = Folder::new();
    let path = folder.join("trip.mcap");
    for shared in ["/left", "/right"] {
        let mut bag = Bag::create(&path);
        for name in ["/left", "/right"] {
            let id = bag.topic(name, RANGE);
            bag.message(id, 1, &range((1000, 0), 1.0));
            if name == shared {
                bag.message(id, 2, &other_range((1000, MS), 1.0));
            }
        }
        bag.finish();
        let sentence = read(&path).map_or_else(|error| error, |trip| trip.failure.unwrap()).to_string();
        let expected = format!(
            "message 2 on {shared} in {}: it is a range of 'other' by its frame_id, and those before are of 'sensor'; sensors \
             that share a topic are not told apart",
            path.display()
        );
        assert_eq!(sentence, expected);
    }
}
