//! How long a trip of hours takes to become a model, and how much memory: from the recording, everything chosen by the trainer.
//!
//! `cargo bench --bench long_trip`, on 100,000 frames of the simulated Chew's camera of 19840 readings, one trip after the
//! other in one recording: five and a half hours. Driving them takes minutes and is not counted; the recording is made in the
//! folder for temporary files, 2 GB, and removed.
//!
//! | to | set |
//! |---|---|
//! | record another number of frames | `KINDS_BENCH_FRAMES=10000` |
//! | keep another number of reference frames than 4000 | `KINDS_BENCH_REFERENCES=500` |
//! | use a recording that there is, or make one that stays | `KINDS_BENCH_TRIP=trip.mcap` |
#![allow(clippy::print_stdout, reason = "a bench is there to print")]

#[path = "../steps/mod.rs"]
mod steps;

use std::path::{Path, PathBuf};

use kinds_driver_shim::simulated::{Chew, Robot};
use kinds_trainer::Config;
use kinds_trips::{Image, ImageEncoding, Stamp, TripWriter, WriterOptions};

use crate::steps::{Clock, told, training};

/// Between two frames of Chew's, ns.
const FRAME_NS: i64 = 200_000_000;

fn main() {
    let number = |name: &str, usual: usize| {
        std::env::var(name).ok().map_or(usual, |text| text.parse().expect("a number of frames"))
    };
    let n_frames = number("KINDS_BENCH_FRAMES", 100_000);
    let n_references = number("KINDS_BENCH_REFERENCES", 4000);
    let folder = tempfile::tempdir().expect("there is a folder for temporary files");
    let usual = || folder.path().join("trip.mcap");
    let path = std::env::var_os("KINDS_BENCH_TRIP").map_or_else(usual, PathBuf::from);
    if !path.exists() {
        let clock = Clock::start();
        record(&path, n_frames);
        told("driving and recording", clock.taken());
    }
    let n_bytes = path.metadata().expect("the recording is there").len();
    println!("{n_bytes} bytes of recording, at most {n_references} reference frames");
    let model = training(&path, &Config { frames: Some(n_references), ..Config::default() });
    let manifest = model.manifest();
    println!(
        "  {} of {} frames kept, covering radius {:.0} counts, {} dimensions, {} kinds",
        manifest.n_frames,
        manifest.n_trained,
        manifest.provenance.covering_radius,
        manifest.n_dims,
        manifest.n_kinds
    );
}

/// Records trips one after the other, as one.
fn record(path: &Path, n_frames: usize) {
    let mut writer = TripWriter::create(path, &WriterOptions::default()).expect("there is room for a trip");
    let mut robots = (0..).map(|trip| Chew::new(trip, 0));
    let mut robot = robots.next().expect("trips go on");
    let layout = robot.layout();
    let mut counts = vec![0; layout.n_readings()];
    for index in 0..n_frames {
        while robot.step(&mut counts).is_none() {
            robot = robots.next().expect("trips go on");
        }
        // Trips begin a day apart; here each goes on where the last ended.
        let at = Stamp(1_750_000_000_000_000_000 + index as i64 * FRAME_NS);
        let image = Image {
            counts: &counts,
            layout,
            encoding: ImageEncoding::Millimetres,
            big_endian: false,
            row_padding_bytes: 0,
        };
        let wrote = writer.write_image("/depth", at, &image);
        wrote.expect("there is room for a trip");
    }
    writer.finish().expect("there is room for a trip");
}
