//! Frames that several topics make together.

use std::path::{Path, PathBuf};
use std::time::Duration;

use kinds_trips::{
    FrameInfo, FrameLayout, Image, ImageEncoding, Pose, Scan, Selection, Stamp, TripReader, TripWriter,
    WriterOptions, counts_in_unit,
};
use proptest::prelude::*;

use crate::bag::{Folder, read_with, refusal};

const START_MS: i64 = 1_700_000_000_000;

fn at(ms: i64) -> Stamp {
    Stamp((START_MS + ms) * 1_000_000)
}

/// A trip of a ring of three readings and a camera of two by two, with a frame of each at these times, in the order in which
/// they are given. Their counts say when they were captured.
fn write(path: &Path, frames: &[(&str, i64)]) {
    let mut writer = TripWriter::create(path, &WriterOptions::default()).unwrap();
    for &(topic, ms) in frames {
        let count = 1000 + ms as u16;
        match topic {
            "/ring" => {
                let pose = Pose { x_m: ms as f64, y_m: 0.0, yaw_rad: 0.0 };
                writer.write_odometry("/odom", at(ms), &pose).unwrap();
                let scan = Scan {
                    counts: &[count, count + 1, 0],
                    metres_per_count: 0.001,
                    bearing_rad_min: 0.0,
                    bearing_step_rad: 1.0,
                    range_m_min: 0.0,
                    range_m_max: 9.0,
                };
                writer.write_scan(topic, at(ms), &scan).unwrap();
            }
            _ => {
                let image = Image {
                    counts: &[count, count + 1, count + 2, count + 3],
                    layout: FrameLayout { rows: 2, columns: 2, metres_per_count: 0.001 },
                    encoding: ImageEncoding::Millimetres,
                    big_endian: false,
                    row_padding_bytes: 0,
                };
                writer.write_image(topic, at(ms), &image).unwrap();
            }
        }
    }
    writer.finish().unwrap();
}

fn trip(folder: &Folder, frames: &[(&str, i64)]) -> PathBuf {
    let path = folder.join("trip.mcap");
    write(&path, frames);
    path
}

fn joined(topics: &str, tolerance_ms: u64) -> Selection {
    let tolerance = Duration::from_millis(tolerance_ms);
    Selection { frames_topic: Some(topics.to_owned()), tolerance, ..Selection::default() }
}

/// When the frames of the ring, and of the camera with each, were captured; none where it has none, and the frame is invalid.
fn pairs(path: &Path, tolerance_ms: u64) -> Vec<(i64, Option<i64>)> {
    let read = read_with(path, &joined("/ring,/camera", tolerance_ms)).unwrap();
    assert_eq!(read.layout, FrameLayout { rows: 1, columns: 7, metres_per_count: 0.001 });
    let pair = |(info, counts): &(FrameInfo, Vec<u16>)| {
        let ms = info.captured.0 / 1_000_000 - START_MS;
        if counts.iter().all(|&count| count == 0) {
            return (ms, None);
        }
        let (led, own) = (1000 + ms as u16, counts[3]);
        assert_eq!(*counts, [led, led + 1, 0, own, own + 1, own + 2, own + 3]);
        (ms, Some(i64::from(own) - 1000))
    };
    read.frames.iter().map(pair).collect()
}

#[test]
fn the_first_sets_the_pace_and_of_the_other_the_newest_before_it_is_taken() {
    let folder = Folder::new();
    // A ring at 10 Hz, a camera at 7 Hz.
    let mut frames: Vec<(&str, i64)> = (0..8).map(|index| ("/ring", 100 * index)).collect();
    frames.extend((0..5).map(|index| ("/camera", 143 * index)));
    frames.sort_by_key(|(_, ms)| *ms);
    let path = trip(&folder, &frames);
    let expected = [(0, 0), (100, 0), (200, 143), (300, 286), (400, 286), (500, 429), (600, 572), (700, 572)];
    assert_eq!(pairs(&path, 250), expected.map(|(led, own)| (led, Some(own))));
    // A tolerance below the camera's period.
    let near = expected.map(|(led, own)| (led, (led - own <= 60).then_some(own)));
    assert_eq!(pairs(&path, 60), near);
    let remarks = |tolerance_ms| {
        let mut trip = TripReader::open(&path, &joined("/ring,/camera", tolerance_ms)).unwrap();
        while trip.next_frame(&mut [0; 7]).unwrap().is_some() {}
        trip.remarks()
    };
    assert_eq!(remarks(250), [""; 0]);
    let n_missing = near.iter().filter(|(_, own)| own.is_none()).count();
    assert_eq!(
        remarks(60),
        [format!(
            "has no frame of /camera at the time of {n_missing} of its 8 frames, or at most 60 ms before; these are taken as invalid"
        )]
    );
}

#[test]
fn the_camera_may_lead_and_poses_are_those_of_its_times() {
    let folder = Folder::new();
    let path = trip(&folder, &[("/ring", 0), ("/camera", 40), ("/ring", 80), ("/camera", 90)]);
    let read = read_with(&path, &joined("/camera,/ring", 250)).unwrap();
    assert_eq!(
        read.counts(),
        [[1040, 1041, 1042, 1043, 1000, 1001, 0], [1090, 1091, 1092, 1093, 1080, 1081, 0]]
    );
    assert_eq!(read.x_m(), [Some(40.0), Some(80.0)]);
    assert_eq!(read.frames[0].0.captured, at(40));
}

#[test]
fn a_partner_that_comes_late_in_the_trip_is_missing_until_then() {
    let folder = Folder::new();
    let mut frames: Vec<(&str, i64)> = (0..600).map(|index| ("/ring", 10 * index)).collect();
    frames.push(("/camera", 5990));
    let path = trip(&folder, &frames);
    let found = pairs(&path, 50);
    assert_eq!(found.len(), 600);
    assert_eq!(found.iter().filter(|(_, own)| own.is_some()).collect::<Vec<_>>(), [&(5990, Some(5990))]);
}

#[test]
fn what_cannot_be_joined_is_a_sentence() {
    let folder = Folder::new();
    let path = trip(&folder, &[("/ring", 0), ("/camera", 40)]);
    assert_eq!(
        refusal(&path, &joined("/ring,/camera,/ring", 250)),
        "--frames-topic has /ring twice; name each topic once"
    );
    assert!(
        refusal(&path, &joined("/ring,/lidar", 250))
            .contains("has no topic /lidar, asked for with --frames-topic")
    );
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(64))]

    #[test]
    fn any_order_of_the_messages_gives_the_same_pairs(
        mut ring in prop::collection::btree_set(0_i64..3000, 1..30).prop_map(Vec::from_iter),
        camera in prop::collection::btree_set(0_i64..3000, 1..30).prop_map(Vec::from_iter),
        keys in prop::collection::vec(any::<u32>(), 60),
        tolerance_ms in 0_u64..300,
    ) {
        let folder = Folder::new();
        // Each topic in its order; what of the two comes first is by chance.
        let mut messages: Vec<(&str, i64)> = Vec::new();
        let mut camera_left = camera.clone();
        for key in keys {
            let (topic, left) = if key % 2 == 0 { ("/ring", &mut ring) } else { ("/camera", &mut camera_left) };
            if !left.is_empty() {
                messages.push((topic, left.remove(0)));
            }
        }
        messages.extend(ring.into_iter().map(|ms| ("/ring", ms)));
        messages.extend(camera_left.into_iter().map(|ms| ("/camera", ms)));
        let path = trip(&folder, &messages);
        let led = messages.iter().filter(|(topic, _)| *topic == "/ring");
        let expected: Vec<(i64, Option<i64>)> = led
            .map(|&(_, led)| {
                let near = camera.iter().filter(|own| (led - tolerance_ms as i64..=led).contains(own));
                (led, near.max().copied())
            })
            .collect();
        prop_assert_eq!(pairs(&path, tolerance_ms), expected);
    }

    #[test]
    fn counts_in_another_unit_are_those_of_a_trip_read_in_it(
        counts in prop::collection::vec(any::<u16>(), 1..60),
        from in prop::sample::select(vec![0.001, 0.00025, 0.002, 0.01, 0.0003]),
        to in prop::sample::select(vec![0.001, 0.00025, 0.002, 0.01, 0.0003]),
    ) {
        let folder = Folder::new();
        let path = folder.join("trip.mcap");
        let encoding = if from == 0.001 { ImageEncoding::Millimetres } else { ImageEncoding::Metres };
        let mut writer = TripWriter::create(&path, &WriterOptions::default()).unwrap();
        let layout = FrameLayout { rows: 1, columns: counts.len() as u32, metres_per_count: from };
        let image = Image { counts: &counts, layout, encoding, big_endian: false, row_padding_bytes: 0 };
        writer.write_image("/frames", at(0), &image).unwrap();
        writer.finish().unwrap();
        let read = read_with(&path, &Selection { metres_per_count: to, ..Selection::default() }).unwrap();
        let table = counts_in_unit(from, to);
        let expected: Vec<u16> = counts.iter().map(|&count| table[usize::from(count)]).collect();
        prop_assert_eq!(read.counts(), [expected]);
    }
}
