//! How long a frame takes to be classified, by the number of reference frames, beside measuring every frame in the same run.
//!
//! `cargo bench --bench classify`, on frames of the simulated robots: Crunch's ring of 16 readings and Chew's camera of 19840.
//! Reference frames are of some trips, and what is classified is of another. One thread; minutes, of which most is driving,
//! once: frames are kept in `target/tmp`, or in `KINDS_BENCH_FOLDER`. `KINDS_BENCH_FRAMES_MAX=4000` leaves out larger numbers,
//! and `cargo bench --bench classify -- camera 2000` all but one; `benches/peers/classify.py` runs that in turn with others.
#![allow(clippy::print_stdout, reason = "a bench is there to print")]

#[path = "../npy/mod.rs"]
mod npy;
#[path = "../simulated/mod.rs"]
mod simulated;

use std::hint::black_box;
use std::ops::RangeFrom;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::Instant;

use kinds_model::metric::{Euclidean, Metric};
use kinds_model::{Classifier, FitPlan, Model, Origin, Response, WhiteningPlan, fit};

use crate::simulated::{CAMERA, CLASSIFIED, LEARNT, RING, Simulated};

/// Frames that are classified.
const N_CLASSIFIED: usize = 800;

/// Reference frames of the model that compares slow directions.
const N_FRAMES_WHITENED: usize = 2000;

/// The robots, and numbers of reference frames for the rows of each.
const TABLES: [(Simulated, &[usize]); 2] = [(RING, &[500, 2000, 4000]), (CAMERA, &[500, 2000, 4000, 20_000])];

fn main() {
    let arguments: Vec<String> = std::env::args().skip(1).filter(|argument| argument != "--bench").collect();
    let one = arguments.first().map(|name| {
        let n_frames = arguments.get(1).and_then(|text| text.parse().ok());
        (&name[..], n_frames.expect("a sensor's name is followed by a number of reference frames"))
    });
    let n_frames_max = std::env::var("KINDS_BENCH_FRAMES_MAX").ok().and_then(|text| text.parse().ok());
    for (robot, numbers) in TABLES.iter().filter(|(robot, _)| one.is_none_or(|(name, _)| name == robot.name))
    {
        println!("{}", robot.title());
        println!("  reference frames   p50 µs  p99.9 µs  of best, µs   every frame measured, p50 µs   ratio");
        let numbers = one.as_ref().map_or(*numbers, |(_, n_frames)| std::slice::from_ref(n_frames));
        for &n_frames in numbers.iter().filter(|n| **n <= n_frames_max.unwrap_or(usize::MAX)) {
            measure(robot, n_frames);
            if robot.name == CAMERA.name && n_frames == N_FRAMES_WHITENED {
                measure_whitened(robot, n_frames);
            }
        }
    }
}

/// The first frames of some trips: driven once, and kept with the table that maps them to the scale on which they are compared.
fn frames(robot: &Simulated, what: &str, trips: RangeFrom<u32>, n_frames: usize) -> Vec<u16> {
    let folder = std::env::var_os("KINDS_BENCH_FOLDER").map(PathBuf::from);
    let folder = folder.unwrap_or_else(|| Path::new(env!("CARGO_TARGET_TMPDIR")).join("classify"));
    std::fs::create_dir_all(&folder).expect("the data's folder can be made");
    let FitPlan { sensor, response, .. } = robot.plan(n_frames);
    let path = folder.join(format!("{}-{what}-{n_frames}.npy", robot.name));
    if path.exists() {
        return npy::read(&path, n_frames * sensor.n_readings(), u16::from_le_bytes);
    }
    let counts = robot.frames(trips, n_frames);
    let response = Response::new(&response, sensor.metres_per_count).expect("a scale");
    let table = response.table();
    let response_path = folder.join(format!("{}-response.npy", robot.name));
    npy::write_counts(&mut npy::create(&response_path, "<u2", &[table.len()]), table);
    let partial = path.with_extension("partial");
    npy::write_counts(&mut npy::create(&partial, "<u2", &[n_frames, sensor.n_readings()]), &counts);
    std::fs::rename(partial, path).expect("the frames can be named");
    counts
}

/// Prints a line of the table.
fn measure(robot: &Simulated, n_frames: usize) {
    let plan = robot.plan(n_frames);
    let model = fit(frames(robot, "frames", LEARNT, n_frames), &plan, Origin::default(), &mut |_, _, _| ());
    let model = Arc::new(model.expect("a simulated trip makes a model"));
    let queries = frames(robot, "queries", CLASSIFIED, N_CLASSIFIED);
    let queries: Vec<&[u16]> = queries.chunks_exact(plan.sensor.n_readings()).collect();
    let Times { mut all, mut best } = time(&model, &queries);
    let mut plain = Vec::new();
    for query in queries.iter().take(20) {
        let began = Instant::now();
        let squared = |index: usize| Euclidean.squared_distance(query, model.frames().row(index));
        let least = (0..n_frames).map(squared).min();
        black_box(least);
        plain.push(began.elapsed().as_secs_f64() * 1e6);
    }
    let (p50, p999, plain) = (quantile(&mut all, 0.5), quantile(&mut all, 0.999), quantile(&mut plain, 0.5));
    let best = quantile(&mut best, 0.999);
    println!("  {n_frames:16} {p50:8.1} {p999:9.1} {best:12.1} {plain:30.1} {:7.0}", plain / p50);
}

/// Prints a line for frames that are compared along slow directions.
fn measure_whitened(robot: &Simulated, n_frames: usize) {
    let directions = WhiteningPlan { n_components: 40, n_directions: 40 };
    let plan = FitPlan { whitening: Some(directions), ..robot.plan(n_frames) };
    let model = fit(frames(robot, "frames", LEARNT, n_frames), &plan, Origin::default(), &mut |_, _, _| ());
    let model = Arc::new(model.expect("a simulated trip makes a model"));
    let queries = frames(robot, "queries", CLASSIFIED, N_CLASSIFIED);
    let Times { mut all, mut best } =
        time(&model, &queries.chunks_exact(plan.sensor.n_readings()).collect::<Vec<_>>());
    let (p50, p999, best) = (quantile(&mut all, 0.5), quantile(&mut all, 0.999), quantile(&mut best, 0.999));
    println!(
        "  {n_frames:16} {p50:8.1} {p999:9.1} {best:12.1}   along {} slow directions",
        directions.n_directions
    );
}

/// How long frames took, µs.
struct Times {
    /// Each frame in each of ten rounds.
    all: Vec<f64>,
    /// Each frame in its quickest round: what is left of a tail there are frames that take long, not the machine's interruptions.
    best: Vec<f64>,
}

fn time(model: &Arc<Model>, queries: &[&[u16]]) -> Times {
    let mut classifier = Classifier::new(Arc::clone(model));
    let (mut all, mut best) = (Vec::new(), vec![f64::INFINITY; queries.len()]);
    for round in 0..11 {
        for (query, best) in queries.iter().zip(&mut best) {
            let began = Instant::now();
            black_box(classifier.classify(query));
            let took_us = began.elapsed().as_secs_f64() * 1e6;
            // The first round warms up.
            if round > 0 {
                all.push(took_us);
                *best = best.min(took_us);
            }
        }
    }
    Times { all, best }
}

fn quantile(values: &mut [f64], share: f64) -> f64 {
    values.sort_by(f64::total_cmp);
    values[((values.len() - 1) as f64 * share).round() as usize]
}
