//! How long a frame takes to be classified, by the number of reference frames, beside measuring every frame in the same run.
//!
//! `cargo bench --bench classify`, on frames of the simulated robots: Crunch's ring of 16 readings and Chew's camera of 19840.
//! Reference frames are of some trips, and what is classified is of another. One thread; minutes, of which most is driving.
//! `KINDS_BENCH_FRAMES_MAX=4000` leaves out larger numbers.
#![allow(clippy::print_stdout, reason = "a bench is there to print")]

use std::hint::black_box;
use std::sync::Arc;
use std::time::Instant;

use kinds_driver_shim::simulated::{Chew, Crunch, Floor, Robot};
use kinds_model::metric::{Euclidean, Metric};
use kinds_model::{
    Classifier, EmPlan, FitPlan, KindsBy, LandmarkChoice, Method, MetricPlan, Origin, ResponsePlan, Scale,
    SensorLayout, fit,
};

/// Trip of the frames that are classified; the reference frames are of those before it.
const TRIP_CLASSIFIED: u32 = 100;

/// A simulated robot, and the rows of its plan.
struct Setting {
    name: &'static str,
    robot: fn(trip: u32) -> Box<dyn Robot>,
    range_m_max: f64,
    n_frames: &'static [usize],
    n_dims: usize,
}

fn main() {
    let settings = [
        Setting {
            name: "ring of 16 readings",
            robot: |trip| Box::new(Crunch::new(Floor::Fourth, trip, 0)),
            range_m_max: 7.0,
            n_frames: &[500, 2000, 4000],
            n_dims: 8,
        },
        Setting {
            name: "camera of 19840 readings",
            robot: |trip| Box::new(Chew::new(trip, 0)),
            range_m_max: 7.5,
            n_frames: &[500, 2000, 4000, 20_000],
            n_dims: 15,
        },
    ];
    let n_frames_max = std::env::var("KINDS_BENCH_FRAMES_MAX").ok().and_then(|text| text.parse().ok());
    for setting in &settings {
        println!("{}, 10 neighbours, 500 landmarks, {} dimensions, 8 kinds", setting.name, setting.n_dims);
        println!("  reference frames   p50 µs  p99.9 µs   every frame measured, p50 µs   ratio");
        for &n_frames in setting.n_frames.iter().filter(|n| **n <= n_frames_max.unwrap_or(usize::MAX)) {
            measure(setting, n_frames);
        }
    }
}

/// Prints a line of the table.
fn measure(setting: &Setting, n_frames: usize) {
    let layout = (setting.robot)(0).layout();
    let n_readings = (layout.rows * layout.columns) as usize;
    let mut counts = Vec::with_capacity(n_frames * n_readings);
    let mut frame = vec![0; n_readings];
    for mut robot in (0..TRIP_CLASSIFIED).map(setting.robot) {
        while counts.len() < n_frames * n_readings && robot.step(&mut frame).is_some() {
            counts.extend_from_slice(&frame);
        }
    }
    let plan = FitPlan {
        sensor: SensorLayout {
            rows: layout.rows,
            columns: layout.columns,
            metres_per_count: layout.metres_per_count,
        },
        response: ResponsePlan::new(Scale::Inverse, setting.range_m_max),
        metric: MetricPlan::Euclidean,
        n_frames_max: n_frames,
        method: Method::Isomap,
        n_neighbors: Some(10),
        consecutive_edges: false,
        n_landmarks: 500,
        landmark_choice: LandmarkChoice::Random,
        n_dims: Some(setting.n_dims),
        n_kinds: Some(8),
        kinds_by: KindsBy::BicNeff,
        em: EmPlan { n_starts: 1, ..EmPlan::new(0) },
        seed: 0,
    };
    let model = fit(counts, &plan, Origin::default(), &mut |_, _, _| ());
    let model = Arc::new(model.expect("a simulated trip makes a model"));

    let mut robot = (setting.robot)(TRIP_CLASSIFIED);
    let mut queries = Vec::new();
    while queries.len() < 1000 && robot.step(&mut frame).is_some() {
        queries.push(frame.clone());
    }
    let mut classifier = Classifier::new(model.clone());
    let mut pruned = Vec::new();
    for round in 0..11 {
        for query in &queries {
            let began = Instant::now();
            black_box(classifier.classify(query));
            let took = began.elapsed();
            // The first round warms up.
            if round > 0 {
                pruned.push(took.as_secs_f64() * 1e6);
            }
        }
    }
    let mut plain = Vec::new();
    for query in queries.iter().take(20) {
        let began = Instant::now();
        let squared = |index: usize| Euclidean.squared_distance(query, model.frames().row(index));
        let least = (0..n_frames).map(squared).min();
        black_box(least);
        plain.push(began.elapsed().as_secs_f64() * 1e6);
    }
    let (p50, p999, plain) =
        (quantile(&mut pruned, 0.5), quantile(&mut pruned, 0.999), quantile(&mut plain, 0.5));
    println!("  {n_frames:16} {p50:8.1} {p999:9.1} {plain:30.1} {:7.0}", plain / p50);
}

fn quantile(values: &mut [f64], share: f64) -> f64 {
    values.sort_by(f64::total_cmp);
    values[((values.len() - 1) as f64 * share).round() as usize]
}
