//! Keeps the frames that are unlike what the model has seen, as a trip to learn from beside the others:
//! `novel_frames SENSOR TRIP.mcap`, until SIGTERM or Ctrl-C.
//!
//! A report comes after its frame and has its number, so the last few frames wait here for theirs.

use std::collections::VecDeque;
use std::error::Error;
use std::path::Path;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;

use kinds_messages::{Domain, FrameHeader, FrameReader, Node, ReportReader};
use kinds_trips::{FrameLayout, Image, ImageEncoding, Stamp, TripWriter, WriterOptions};

/// From here on a frame counts as novel.
const NOVEL: f64 = 0.99;
/// Frames that may be on their way to their report.
const N_WAITING_MAX: usize = 64;

pub(crate) fn keep_novel(
    domain: &Domain,
    sensor: &str,
    trip: &Path,
    stop: &AtomicBool,
) -> Result<usize, Box<dyn Error>> {
    let node = Node::open(domain, "novel-frames")?;
    let sensor = sensor.parse()?;
    let reports = ReportReader::open(&node, &sensor)?;
    let frames = FrameReader::open(&node, &sensor)?;
    let mut writer = TripWriter::create(trip, &WriterOptions::default())?;
    let mut waiting: VecDeque<(FrameHeader, Vec<u16>)> = VecDeque::new();
    let mut n_kept = 0;
    loop {
        // Read before the channels are: what was reported before somebody said that it is enough is kept.
        let stopping = stop.load(Ordering::Relaxed);
        // Reports first: the frame of each that is here has been here before it.
        let mut reported = Vec::new();
        while let Some(report) = reports.receive()? {
            reported.push(report);
        }
        while let Some(frame) = frames.receive()? {
            waiting.push_back((*frame.header(), frame.counts().to_vec()));
            if waiting.len() > N_WAITING_MAX {
                waiting.pop_front();
            }
        }
        for report in reported.iter().filter(|report| report.novelty >= NOVEL) {
            let is_its =
                |header: &FrameHeader| (header.run, header.sequence) == (report.run, report.sequence);
            if let Some((header, counts)) = waiting.iter().find(|(header, _)| is_its(header)) {
                write(&mut writer, header, counts)?;
                n_kept += 1;
            }
        }
        if stopping {
            writer.finish()?;
            return Ok(n_kept);
        }
        reports.wait(Duration::from_millis(50))?;
    }
}

fn write(writer: &mut TripWriter, header: &FrameHeader, counts: &[u16]) -> Result<(), Box<dyn Error>> {
    let FrameHeader { rows, columns, metres_per_count, .. } = *header;
    let layout = FrameLayout { rows, columns, metres_per_count };
    // Millimetres are whole numbers in a message, as counts are; every other unit goes as metres.
    let encoding = if metres_per_count == 0.001 { ImageEncoding::Millimetres } else { ImageEncoding::Metres };
    let image = Image { counts, layout, encoding, big_endian: false, row_padding_bytes: 0 };
    Ok(writer.write_image("/frames", Stamp(header.captured_ns), &image)?)
}

#[allow(clippy::print_stderr, reason = "a program tells whoever started it what it did")]
fn main() -> Result<(), Box<dyn Error>> {
    let [sensor, trip] = std::env::args()
        .skip(1)
        .collect::<Vec<_>>()
        .try_into()
        .map_err(|_| "novel_frames SENSOR TRIP.mcap")?;
    let stop = Arc::new(AtomicBool::new(false));
    for signal in [signal_hook::consts::SIGTERM, signal_hook::consts::SIGINT] {
        signal_hook::flag::register(signal, Arc::clone(&stop))?;
    }
    let n_kept = keep_novel(&Domain::of_environment(), &sensor, Path::new(&trip), &stop)?;
    eprintln!("kept {n_kept} novel frames in {trip}");
    Ok(())
}
