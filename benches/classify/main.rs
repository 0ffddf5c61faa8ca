//! How long a frame takes to be classified, by the number of reference frames, beside measuring every frame in the same run.
//!
//! `cargo bench --bench classify`, on frames of the simulated robots: Crunch's ring of 16 readings and Chew's camera of 19840.
//! Reference frames are of some trips, and what is classified is of another. One thread; minutes, of which most is driving,
//! once: frames are kept in `target/tmp`, or in `KINDS_BENCH_FOLDER`. `KINDS_BENCH_FRAMES_MAX=4000` leaves out larger numbers,
//! and `cargo bench --bench classify -- camera 2000` all but one; `benches/peers/classify.py` runs that in turn with others.
#![allow(clippy::print_stdout, reason = "a bench is there to print")]

#[path = "../npy/mod.rs"]
mod npy;

use std::hint::black_box;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::Instant;

use kinds_driver_shim::simulated::{Chew, Crunch, Floor, Robot};
use kinds_model::metric::{Euclidean, Metric};
use kinds_model::{
    Classifier, EmPlan, FitPlan, KindsBy, LandmarkChoice, Method, MetricPlan, Origin, Response, ResponsePlan,
    Scale, SensorLayout, fit,
};

/// Trip of the frames that are classified; the reference frames are of those before it.
const TRIP_CLASSIFIED: u32 = 100;
/// Frames that are classified.
const N_CLASSIFIED: usize = 800;

/// A simulated robot, and the rows of its plan.
struct Setting {
    name: &'static str,
    title: &'static str,
    robot: fn(trip: u32) -> Box<dyn Robot>,
    range_m_max: f64,
    n_frames: &'static [usize],
    n_dims: usize,
}

const SETTINGS: [Setting; 2] = [
    Setting {
        name: "ring",
        title: "ring of 16 readings",
        robot: |trip| Box::new(Crunch::new(Floor::Fourth, trip, 0)),
        range_m_max: 7.0,
        n_frames: &[500, 2000, 4000],
        n_dims: 8,
    },
    Setting {
        name: "camera",
        title: "camera of 19840 readings",
        robot: |trip| Box::new(Chew::new(trip, 0)),
        range_m_max: 7.5,
        n_frames: &[500, 2000, 4000, 20_000],
        n_dims: 15,
    },
];

fn main() {
    let arguments: Vec<String> = std::env::args().skip(1).filter(|argument| argument != "--bench").collect();
    let one = arguments.first().map(|name| {
        let n_frames = arguments.get(1).and_then(|text| text.parse().ok());
        (&name[..], n_frames.expect("a sensor's name is followed by a number of reference frames"))
    });
    let n_frames_max = std::env::var("KINDS_BENCH_FRAMES_MAX").ok().and_then(|text| text.parse().ok());
    for setting in SETTINGS.iter().filter(|setting| one.is_none_or(|(name, _)| name == setting.name)) {
        println!("{}, 10 neighbours, 500 landmarks, {} dimensions, 8 kinds", setting.title, setting.n_dims);
        println!("  reference frames   p50 µs  p99.9 µs   every frame measured, p50 µs   ratio");
        let numbers = match &one {
            Some((_, n_frames)) => std::slice::from_ref(n_frames),
            None => setting.n_frames,
        };
        for &n_frames in numbers.iter().filter(|n| **n <= n_frames_max.unwrap_or(usize::MAX)) {
            measure(setting, n_frames);
        }
    }
}

impl Setting {
    fn sensor(&self) -> SensorLayout {
        let layout = (self.robot)(0).layout();
        SensorLayout { rows: layout.rows, columns: layout.columns, metres_per_count: layout.metres_per_count }
    }

    fn response(&self) -> ResponsePlan {
        ResponsePlan::new(Scale::Inverse, self.range_m_max)
    }

    /// The first frames of some trips, shape `(n, n_readings)`: driven once, and kept with the table that maps them.
    fn frames(&self, what: &str, trips: std::ops::Range<u32>, n_frames: usize) -> Vec<u16> {
        let folder = std::env::var_os("KINDS_BENCH_FOLDER").map(PathBuf::from);
        let folder = folder.unwrap_or_else(|| Path::new(env!("CARGO_TARGET_TMPDIR")).join("classify"));
        std::fs::create_dir_all(&folder).expect("the data's folder can be made");
        let sensor = self.sensor();
        let n_counts = n_frames * sensor.n_readings();
        let path = folder.join(format!("{}-{what}-{n_frames}.npy", self.name));
        if path.exists() {
            return npy::read(&path, n_counts, u16::from_le_bytes);
        }
        let mut counts = Vec::with_capacity(n_counts);
        let mut frame = vec![0; sensor.n_readings()];
        for mut robot in trips.map(self.robot) {
            while counts.len() < n_counts && robot.step(&mut frame).is_some() {
                counts.extend_from_slice(&frame);
            }
        }
        assert_eq!(counts.len(), n_counts, "the trips have as many frames");
        let response = Response::new(&self.response(), sensor.metres_per_count).expect("a scale");
        let table = response.table();
        let response_path = folder.join(format!("{}-response.npy", self.name));
        npy::write_counts(&mut npy::create(&response_path, "<u2", &[table.len()]), table);
        let partial = path.with_extension("partial");
        npy::write_counts(&mut npy::create(&partial, "<u2", &[n_frames, sensor.n_readings()]), &counts);
        std::fs::rename(partial, path).expect("the frames can be named");
        counts
    }
}

/// Prints a line of the table.
fn measure(setting: &Setting, n_frames: usize) {
    let plan = FitPlan {
        sensor: setting.sensor(),
        response: setting.response(),
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
    let counts = setting.frames("frames", 0..TRIP_CLASSIFIED, n_frames);
    let model = fit(counts, &plan, Origin::default(), &mut |_, _, _| ());
    let model = Arc::new(model.expect("a simulated trip makes a model"));

    let queries = setting.frames("queries", TRIP_CLASSIFIED..TRIP_CLASSIFIED + 2, N_CLASSIFIED);
    let queries: Vec<&[u16]> = queries.chunks_exact(plan.sensor.n_readings()).collect();
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
