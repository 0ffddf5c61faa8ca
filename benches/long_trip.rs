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

use std::path::{Path, PathBuf};
use std::time::Instant;

use kinds_driver_shim::simulated::{Chew, Robot};
use kinds_trainer::{Config, Stage, train};
use kinds_trips::{Image, ImageEncoding, Stamp, TripWriter, WriterOptions};
use rustix::time::{ClockId, clock_gettime};

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
        let began = Instant::now();
        record(&path, n_frames);
        println!("drove and recorded {n_frames} frames in {:.0} s", began.elapsed().as_secs_f64());
    }
    let n_bytes = path.metadata().expect("the recording is there").len();
    println!("{n_bytes} bytes of recording, at most {n_references} reference frames");
    measure(&path, n_references);
}

/// Trains, and prints how long each stage took.
fn measure(path: &Path, n_references: usize) {
    println!("  stage                               s   of processors");
    let config = Config { frames: Some(n_references), ..Config::default() };
    let began = Clocks::now();
    let mut stage_before: Option<(String, Clocks)> = None;
    let trained = train(&[path.to_path_buf()], &config, &mut |stage, _, _| {
        let name = match stage {
            Stage::Reading(_) => "reading".to_string(),
            stage => format!("{stage:?}"),
        };
        if stage_before.as_ref().is_none_or(|(before, _)| *before != name) {
            stage_before.iter().for_each(|(before, began)| began.print_since(before));
            stage_before = Some((name, Clocks::now()));
        }
    });
    stage_before.iter().for_each(|(before, began)| began.print_since(before));
    began.print_since("in all");
    let model = trained.expect("a simulated trip makes a model").model;
    let manifest = model.manifest();
    println!(
        "  {} of {} frames kept, covering radius {:.0} counts, {} dimensions, {} kinds; at most {} MB held",
        manifest.n_frames,
        manifest.n_trained,
        manifest.provenance.covering_radius,
        manifest.n_dims,
        manifest.n_kinds,
        most_bytes_held() / 1_000_000
    );
}

/// What time it is, and how long processors have worked for this process, seconds.
struct Clocks {
    time_s: f64,
    processors_s: f64,
}

impl Clocks {
    fn now() -> Self {
        let seconds = |clock| {
            let time = clock_gettime(clock);
            time.tv_sec as f64 + time.tv_nsec as f64 / 1e9
        };
        Self { time_s: seconds(ClockId::Monotonic), processors_s: seconds(ClockId::ProcessCPUTime) }
    }

    fn print_since(&self, what: &str) {
        let Self { time_s, processors_s } = Self::now();
        println!("  {what:26} {:10.1} {:10.1}", time_s - self.time_s, processors_s - self.processors_s);
    }
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

/// Of this process, by Linux.
fn most_bytes_held() -> u64 {
    let status = std::fs::read_to_string("/proc/self/status").unwrap_or_default();
    let line = status.lines().find_map(|line| line.strip_prefix("VmHWM:"));
    let kilobytes = line.and_then(|line| line.trim().strip_suffix(" kB")).and_then(|text| text.parse().ok());
    1024 * kilobytes.unwrap_or(0_u64)
}
