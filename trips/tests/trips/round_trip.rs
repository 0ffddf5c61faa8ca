//! What the writer writes, the reader reads: every message type, layout of the file, and unit.

use kinds_trips::{
    Command, Compression, FrameLayout, Image, ImageEncoding, Pose, Scan, Selection, Stamp, TripWriteError,
    TripWriter, WriterOptions,
};
use proptest::prelude::*;

use crate::bag::{Folder, read, read_whole, read_with};

fn options() -> impl Strategy<Value = WriterOptions> {
    let compression = prop::sample::select(vec![Compression::None, Compression::Lz4, Compression::Zstd]);
    let chunk_bytes = prop::sample::select(vec![None, Some(100), Some(5000), Some(1 << 20)]);
    (compression, chunk_bytes, any::<bool>()).prop_map(|(compression, chunk_bytes, indexed)| WriterOptions {
        compression,
        chunk_bytes,
        indexed,
    })
}

fn at_ms(ms: i64) -> Stamp {
    Stamp(1_700_000_000_000_000_000 + ms * 1_000_000)
}

fn scan_of(counts: &[u16]) -> Scan<'_> {
    Scan {
        counts,
        metres_per_count: 0.001,
        bearing_rad_min: -1.0,
        bearing_step_rad: 0.1,
        range_m_min: 0.0,
        range_m_max: 4.0,
    }
}

#[test]
fn the_truth_beside_odometry_comes_back_where_it_is_asked_for() {
    let folder = Folder::new();
    let path = folder.join("trip.mcap");
    let mut writer = TripWriter::create(&path, &WriterOptions::default()).unwrap();
    let believed = |index: i64| Pose { x_m: index as f64, y_m: 0.0, yaw_rad: 0.0 };
    let truly = |index: i64| Pose { x_m: 1.05 * index as f64, y_m: -0.25, yaw_rad: 0.5 };
    for index in 0..3 {
        let at = at_ms(100 * index);
        writer.write_odometry("/odom", at, &believed(index)).unwrap();
        writer.write_pose("/ground_truth", at, &truly(index)).unwrap();
        writer.write_scan("/scan", at, &scan_of(&[1000])).unwrap();
    }
    writer.finish().unwrap();
    let poses_topic = Some("/ground_truth".to_owned());
    for (selection, expected) in [
        (Selection::default(), believed as fn(i64) -> Pose),
        (Selection { poses_topic, ..Selection::default() }, truly),
    ] {
        let trip = read_with(&path, &selection).unwrap();
        assert_eq!(trip.frames.len(), 3);
        for (index, (info, _)) in (0..).zip(&trip.frames) {
            let (found, expected) = (info.pose.unwrap(), expected(index));
            assert_eq!((found.x_m, found.y_m), (expected.x_m, expected.y_m));
            assert!((found.yaw_rad - expected.yaw_rad).abs() < 1e-14);
        }
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(48))]

    #[test]
    fn scans_with_poses_and_commands_come_back(
        options in options(),
        n_readings in 1usize..20,
        seed in prop::collection::vec(prop_oneof![Just(0u16), 1u16..4000, 4000u16..=u16::MAX], 1..400),
    ) {
        let folder = Folder::new();
        let path = folder.join("trip.mcap");
        let frames: Vec<Vec<u16>> =
            seed.chunks(n_readings).filter(|frame| frame.len() == n_readings).map(<[u16]>::to_vec).collect();
        prop_assume!(!frames.is_empty());
        let pose = |index: usize| Pose { x_m: index as f64, y_m: -0.5, yaw_rad: 3.0 };
        let command = |index: usize| Command { forward_m_s: 0.1 * index as f64, turn_rad_s: -0.3 };

        let mut writer = TripWriter::create(&path, &options).unwrap();
        for (index, counts) in frames.iter().enumerate() {
            writer.write_scan("/scan", at_ms(100 * index as i64), &scan_of(counts)).unwrap();
            writer.write_odometry("/odom", at_ms(100 * index as i64), &pose(index)).unwrap();
            writer.write_command("/cmd_vel", at_ms(100 * index as i64), &command(index)).unwrap();
        }
        writer.finish().unwrap();

        let trip = read_whole(&path);
        prop_assert_eq!(trip.layout, FrameLayout { rows: 1, columns: n_readings as u32, metres_per_count: 0.001 });
        // From the largest range on there is no return, and no return is the largest range.
        let expected: Vec<Vec<u16>> =
            frames.iter().map(|frame| frame.iter().map(|&count| count.min(4000)).collect()).collect();
        prop_assert_eq!(trip.counts(), expected);
        for (index, (info, _)) in trip.frames.iter().enumerate() {
            prop_assert_eq!(info.captured, at_ms(100 * index as i64));
            let (found, expected) = (info.pose.unwrap(), pose(index));
            prop_assert_eq!((found.x_m, found.y_m), (expected.x_m, expected.y_m));
            prop_assert!((found.yaw_rad - expected.yaw_rad).abs() < 1e-14);
            prop_assert_eq!(info.command, Some(command(index)));
        }
    }

    #[test]
    fn images_come_back(
        options in options(),
        rows in 1u32..6,
        columns in 1u32..8,
        row_padding_bytes in 0u32..6,
        metres in any::<bool>(),
        big_endian in any::<bool>(),
        millimetres_per_count in prop::sample::select(vec![1u32, 2, 10]),
        seed in prop::collection::vec(prop_oneof![Just(0u16), Just(u16::MAX), any::<u16>()], 42..300),
    ) {
        let folder = Folder::new();
        let path = folder.join("trip.mcap");
        let metres_per_count = f64::from(millimetres_per_count) * 0.001;
        let layout = FrameLayout { rows, columns, metres_per_count };
        let frames: Vec<Vec<u16>> = seed.chunks_exact(layout.n_readings()).map(<[u16]>::to_vec).collect();
        let encoding = if metres { ImageEncoding::Metres } else { ImageEncoding::Millimetres };

        let mut writer = TripWriter::create(&path, &options).unwrap();
        for (index, counts) in frames.iter().enumerate() {
            let image = Image { counts, layout, encoding, big_endian, row_padding_bytes };
            writer.write_image("/depth", at_ms(33 * index as i64), &image).unwrap();
        }
        writer.finish().unwrap();

        let trip = read_with(&path, &Selection { metres_per_count, ..Selection::default() }).unwrap();
        prop_assert!(trip.failure.is_none() && trip.truncation.is_none());
        prop_assert_eq!(trip.layout, layout);
        // 16UC1 holds 65.535 m; what is further is lost.
        let fits = |count: u16| metres || u32::from(count) * millimetres_per_count <= u32::from(u16::MAX);
        let kept = |&count: &u16| if fits(count) { count } else { 0 };
        let expected: Vec<Vec<u16>> = frames.iter().map(|frame| frame.iter().map(kept).collect()).collect();
        prop_assert_eq!(trip.counts(), expected);
        prop_assert!(trip.frames.iter().all(|(info, _)| info.pose.is_none() && info.command.is_none()));
    }
}

#[test]
fn nothing_stands_under_the_name_before_the_trip_is_finished() {
    let folder = Folder::new();
    let path = folder.join("trip.mcap");
    let mut writer = TripWriter::create(&path, &WriterOptions::default()).unwrap();
    writer.write_scan("/scan", at_ms(0), &scan_of(&[1, 2, 3])).unwrap();
    let [name] = folder.names().try_into().unwrap();
    assert!(name.starts_with("trip.mcap.") && name.ends_with(".partial"), "{name}");
    writer.finish().unwrap();
    assert_eq!(folder.names(), ["trip.mcap"]);
}

#[test]
fn a_trip_that_is_dropped_unfinished_leaves_nothing_and_spares_the_old_one() {
    let folder = Folder::new();
    let path = folder.join("trip.mcap");
    for counts in [[1, 2, 3], [4, 5, 6]] {
        let mut writer = TripWriter::create(&path, &WriterOptions::default()).unwrap();
        writer.write_scan("/scan", at_ms(0), &scan_of(&counts)).unwrap();
        if counts == [1, 2, 3] {
            writer.finish().unwrap();
        }
    }
    assert_eq!(folder.names(), ["trip.mcap"]);
    assert_eq!(read_whole(&path).counts(), [[1, 2, 3]]);
}

#[test]
fn what_was_flushed_can_be_read_from_the_partial_file() {
    let folder = Folder::new();
    let mut writer = TripWriter::create(&folder.join("trip.mcap"), &WriterOptions::default()).unwrap();
    writer.write_scan("/scan", at_ms(0), &scan_of(&[1, 2, 3])).unwrap();
    writer.flush().unwrap();
    writer.write_scan("/scan", at_ms(100), &scan_of(&[4, 5, 6])).unwrap();

    let [name] = folder.names().try_into().unwrap();
    let trip = read(&folder.join(&name)).unwrap();
    assert_eq!(trip.counts(), [[1, 2, 3]]);
    assert!(!trip.truncation.unwrap().data_is_whole);
}

#[cfg(unix)]
#[test]
fn a_finished_trip_has_the_permissions_of_any_other_file() {
    use std::os::unix::fs::PermissionsExt as _;
    let folder = Folder::new();
    let path = folder.join("trip.mcap");
    let mut writer = TripWriter::create(&path, &WriterOptions::default()).unwrap();
    writer.write_scan("/scan", at_ms(0), &scan_of(&[1])).unwrap();
    writer.finish().unwrap();
    std::fs::write(folder.join("other"), b"").unwrap();
    let mode = |name| std::fs::metadata(folder.join(name)).unwrap().permissions().mode();
    assert_eq!(mode("trip.mcap"), mode("other"));
}

#[test]
fn what_cannot_be_written_is_said_in_a_sentence() {
    let folder = Folder::new();
    let refusal = |path: &std::path::Path| {
        TripWriter::create(path, &WriterOptions::default()).map(|_| ()).unwrap_err().to_string()
    };
    let directory = folder.join("");
    assert_eq!(
        refusal(&directory),
        format!("could not write {}: it is a directory; name a file in it", directory.display())
    );
    let nowhere = folder.join("nowhere/trip.mcap");
    let sentence = refusal(&nowhere);
    assert!(
        sentence.starts_with(&format!("could not write {}: No such file or directory", nowhere.display())),
        "{sentence}"
    );

    let mut writer = TripWriter::create(&folder.join("trip.mcap"), &WriterOptions::default()).unwrap();
    let scan = Scan { metres_per_count: 0.0, ..scan_of(&[1]) };
    let error = writer.write_scan("/scan", at_ms(0), &scan).unwrap_err();
    assert!(matches!(error, TripWriteError::Unit { .. }));
    assert_eq!(
        error.to_string(),
        "a unit of 0 metres per count was given; it must be a finite number above 0"
    );
}
