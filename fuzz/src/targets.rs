//! What becomes of bytes that come from outside: one function for each sort of them. The fuzz targets call these, and so does
//! an ordinary test (`tests/bytes`), with the committed corpus and with bytes made by chance.
//!
//! Each returns why it refuses the bytes, in words. None may panic, or hold much more memory than the bytes warrant.

#![allow(dead_code, reason = "each fuzz target calls one of them")]

use std::path::Path;

use bytes::Bytes;
use kinds_driver_shim::Faults;
use kinds_messages::{FrameHeader, HealthReport};
use kinds_model::{SensorLayout, file};
use kinds_trainer::{Config, CountsSeen, SegmentFormat, Segmentation};
use kinds_trips::{Choice, Selection, TripInfo, TripReader, salvage};

/// A model file. What is not refused is written again as the same bytes.
pub(crate) fn model(bytes: &[u8]) -> Result<(), String> {
    let model = file::from_bytes(&Bytes::copy_from_slice(bytes)).map_err(|error| error.to_string())?;
    // Not shown side by side: they are long.
    assert!(file::to_bytes(&model) == bytes, "a model that is read is a model that was written");
    Ok(())
}

/// A recorded trip, looked through and read to its end. What its first bytes say decides whether it is of MCAP or ROS 1.
pub(crate) fn bag(bytes: &[u8]) -> Result<(), String> {
    let file = tempfile::NamedTempFile::new().expect("a temporary file can be made");
    std::fs::write(file.path(), bytes).expect("a temporary file can be written");
    let info = TripInfo::read(file.path()).map_err(|error| error.to_string())?;
    // Each way to read it that is offered is taken, and must not end the process.
    for Choice { name, .. } in info.frames().into_iter().take(8) {
        let selection = Selection { frames_topic: Some(name), ..Selection::default() };
        let _ = read_bag(file.path(), &selection);
    }
    read_bag(file.path(), &Selection::default()).map_err(|error| error.to_string())
}

/// A damaged recording, what is whole of which is saved. What was saved is whole.
pub(crate) fn wreck(bytes: &[u8]) -> Result<(), String> {
    let folder = tempfile::tempdir().expect("a temporary folder can be made");
    let (from, to) = (folder.path().join("wreck.mcap"), folder.path().join("saved.mcap"));
    std::fs::write(&from, bytes).expect("a temporary file can be written");
    let saved = salvage(&from, &to).map_err(|error| error.to_string());
    assert_eq!(to.exists(), saved.is_ok(), "it is whole or not there");
    let n_messages = saved?.n_messages;
    let info = TripInfo::read(&to).expect("what was saved can be read");
    assert!(info.failure.is_none() && info.cut_off.is_none(), "{info:?}");
    let counts = info.topics.iter().map(|topic| topic.topic.n_messages);
    assert_eq!(counts.sum::<u64>(), n_messages, "and has what is said");
    Ok(())
}

fn read_bag(path: &Path, selection: &Selection) -> Result<(), kinds_trips::TripError> {
    let mut trip = TripReader::open(path, selection)?;
    let mut counts = vec![0; trip.layout().n_readings()];
    while trip.next_frame(&mut counts)?.is_some() {}
    Ok(())
}

/// Everything that is written in RON by hand: what to train, which faults to inject, where which place is. Refused if all of them
/// refuse it.
pub(crate) fn ron(bytes: &[u8]) -> Result<(), String> {
    let text = std::str::from_utf8(bytes).map_err(|error| error.to_string())?;
    let refusals = [training(text), faults(text), places(text)];
    let words: Option<Vec<String>> = refusals.into_iter().map(Result::err).collect();
    words.map_or(Ok(()), |words| Err(words.join("; ")))
}

fn training(text: &str) -> Result<(), String> {
    let config = Config::from_ron(text).map_err(|error| error.to_string())?;
    config.check().map_err(|error| error.to_string())?;
    let mut seen = CountsSeen::default();
    seen.add(&[0, 1000, 4000, u16::MAX]);
    let sensor = SensorLayout { rows: 1, columns: 4, metres_per_count: 0.001 };
    config.plan(sensor, &seen).map(drop).map_err(|error| error.to_string())
}

fn faults(text: &str) -> Result<(), String> {
    Faults::from_ron(text).map(drop).map_err(|error| error.to_string())
}

fn places(text: &str) -> Result<(), String> {
    let as_ron = Segmentation::parse(text, SegmentFormat::Ron, &[]).map(drop);
    let as_csv = Segmentation::parse(text, SegmentFormat::Csv, &[]).map(drop);
    as_ron.or(as_csv).map_err(|error| error.to_string())
}

/// A frame's header and a health report as a faulty writer may leave them in shared memory: what is read of them is bounded by
/// what there is.
pub(crate) fn message(bytes: &[u8]) -> Result<(), String> {
    let mut words = bytes.chunks_exact(8).map(|word| u64::from_le_bytes(word.try_into().expect("8 bytes")));
    let mut next = || words.next().unwrap_or_default();
    let header = FrameHeader {
        version: next() as u32,
        flags: next() as u32,
        run: next(),
        sequence: next(),
        captured_ns: next() as i64,
        sent_monotonic_ns: next(),
        metres_per_count: f64::from_bits(next()),
        rows: next() as u32,
        columns: next() as u32,
        ..FrameHeader::default()
    };
    let has = |flag: u32| header.flags & flag != 0;
    assert_eq!(header.known_pose().is_some(), has(FrameHeader::HAS_POSE));
    assert_eq!(header.known_command().is_some(), has(FrameHeader::HAS_COMMAND));
    assert_eq!(header.known_true_pose().is_some(), has(FrameHeader::HAS_TRUE_POSE));
    let mut health = HealthReport {
        flags: next() as u32,
        interval_ns: next(),
        last_status: next() as u32,
        ..HealthReport::default()
    };
    health.last_interval.sent_to_reported.n_frames = next();
    assert!(health.rate_hz().is_finite() && health.rate_hz() >= 0.0);
    assert_eq!(health.last_status().is_some(), health.flags & HealthReport::HAS_LAST_FRAME != 0);
    let is_ours = header.version == FrameHeader::VERSION;
    if is_ours { Ok(()) } else { Err(format!("layout version {}", header.version)) }
}
