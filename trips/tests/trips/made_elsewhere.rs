//! Trips that others recorded and wrote, where this machine has them: in the folder that the environment variable
//! KINDS_TRIPS_DIR names, or beside the workspace.

use std::path::{Path, PathBuf};

use crate::bag::{Read, read, read_whole};

fn recorded(name: &str) -> Option<PathBuf> {
    let folder = std::env::var_os("KINDS_TRIPS_DIR")
        .map_or_else(|| Path::new(env!("CARGO_MANIFEST_DIR")).join("../../shared/trips"), PathBuf::from);
    let path = folder.join(name);
    if !path.is_file() {
        skipped(&format!("{} is not there", path.display()));
        return None;
    }
    Some(path)
}

#[expect(clippy::print_stderr, reason = "a test that was skipped should say so")]
pub(crate) fn skipped(why: &str) {
    eprintln!("skipped: {why}");
}

/// Checks a whole trip: frames, poses and times.
fn check(name: &str, n_frames: usize, (rows, columns): (u32, u32), period_s: f64) -> Option<Read> {
    let trip = read_whole(&recorded(name)?);
    assert_eq!(trip.frames.len(), n_frames);
    assert_eq!((trip.layout.rows, trip.layout.columns, trip.layout.metres_per_count), (rows, columns, 0.001));
    assert!(trip.frames.iter().all(|(info, _)| info.pose.is_some()), "every frame has a pose");
    for pair in trip.frames.windows(2) {
        let step_s = pair[1].0.captured.seconds_since(pair[0].0.captured);
        assert!((step_s - period_s).abs() < 1e-6, "{step_s}");
    }
    Some(trip)
}

#[test]
fn the_time_of_flight_trips_are_read_whole() {
    for (name, n_frames) in [("maze-tof16-trip1.mcap", 1379), ("maze-tof16-trip2.mcap", 621)] {
        let Some(trip) = check(name, n_frames, (1, 16), 0.1) else { return };
        let counts = trip.counts().concat();
        // Zones measure up to 4 m, which also stands for no return; both occur.
        assert!(counts.iter().all(|&count| count <= 4000));
        assert!(counts.contains(&4000) && counts.iter().any(|count| (1..4000).contains(count)));
    }
}

#[test]
fn the_depth_trips_are_read_whole() {
    for name in ["chess-depth19840-trip1.mcap", "chess-depth19840-trip2.mcap"] {
        let Some(trip) = check(name, 500, (124, 160), 1.0 / 30.0) else { return };
        let counts = trip.counts().concat();
        let share_invalid = counts.iter().filter(|&&count| count == 0).count() as f64 / counts.len() as f64;
        assert!((0.05..0.2).contains(&share_invalid), "{share_invalid}");
    }
}

#[test]
fn a_trip_without_its_second_half_gives_the_first() {
    let Some(path) = recorded("chess-depth19840-trip1.mcap") else { return };
    let whole = read_whole(&path);
    let bytes = std::fs::read(&path).unwrap();
    let folder = crate::bag::Folder::new();
    let half = folder.join("half.mcap");
    std::fs::write(&half, &bytes[..bytes.len() / 2]).unwrap();
    let trip = read(&half).unwrap();
    assert!((200..300).contains(&trip.frames.len()), "{}", trip.frames.len());
    assert_eq!(trip.counts(), whole.counts()[..trip.frames.len()]);
    assert_eq!(trip.truncation.unwrap().n_frames, trip.frames.len() as u64);
}
