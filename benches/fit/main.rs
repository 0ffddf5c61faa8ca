//! How long fitting takes, step by step, and the most memory that it holds.
//!
//! `cargo bench --bench fit` runs all parts, `cargo bench --bench fit -- full landmarks` some; each in a process of its own, so
//! that each has its own peak. What is fitted are frames of the simulated Chew (19840 readings), driven once and kept in
//! `target/tmp`. From the environment: `KINDS_BENCH_FRAMES` for Isomap (6000), `KINDS_BENCH_TRAINED` for a whole training
//! (2000), `KINDS_BENCH_POINTS` for mixtures (20000), `KINDS_BENCH_FOLDER` for where the data is.
//!
//! Beside each time stands what all processors spent. `benches/peers/fit.py` runs the same work through scikit-learn on the same files, in turn with this.
#![allow(clippy::print_stdout, reason = "a bench is there to print")]

mod data;
#[path = "../npy/mod.rs"]
mod npy;
#[path = "../steps/mod.rs"]
mod steps;

use std::hint::black_box;
use std::process::Command;
use std::thread;
use std::time::Instant;

use kinds_model::em::fit_mixture;
use kinds_model::mds::Embedding;
use kinds_model::{EmPlan, FitPlan, Model, Origin, Provenance, fit};
use kinds_trainer::Config;
use rayon::prelude::*;

use self::data::Data;
use self::steps::{Clock, Steps, peak, told, training};

/// Told to a process that runs one part.
const ONE_PART: &str = "--one-part";

/// Its name, and what it measures.
type Part = (&'static str, fn(&Data));

const PARTS: [Part; 5] = [
    ("bandwidth", |_| bandwidth()),
    ("full", |data| isomap(data, data.n_frames, data.n_frames)),
    ("landmarks", |data| isomap(data, data.n_frames, N_LANDMARKS)),
    ("whole", whole),
    ("mixture", mixture),
];

const N_NEIGHBORS: usize = 12;
const N_LANDMARKS: usize = 500;
const N_DIMS: usize = 15;
const N_KINDS_MAX: usize = 20;
const N_STARTS: usize = 5;

fn main() {
    let arguments: Vec<String> = std::env::args().skip(1).filter(|argument| argument != "--bench").collect();
    let data = Data::of_environment();
    if let [first, name] = &arguments[..]
        && first == ONE_PART
    {
        let (_, part) = PARTS.iter().find(|(part, _)| part == name).expect("a part's name");
        return part(&data);
    }
    let clock = Clock::start();
    data.prepare();
    told("driving, unless done before", clock.taken());
    for (name, _) in
        PARTS.iter().filter(|(name, _)| arguments.is_empty() || arguments.iter().any(|a| a == name))
    {
        println!("{name}");
        let program = std::env::current_exe().expect("a program knows its own name");
        let status = Command::new(program).args([ONE_PART, name]).status().expect("it can be run again");
        assert!(status.success(), "{name}: {status}");
    }
}

/// How fast memory is read, by one core and by all.
fn bandwidth() {
    let n_threads = rayon::current_num_threads();
    let numbers = vec![1_u64; 1 << 27];
    for n in [1, n_threads] {
        let times = (0..5).map(|_| {
            let began = Instant::now();
            thread::scope(|scope| {
                for part in numbers.chunks(numbers.len() / n) {
                    scope.spawn(|| {
                        black_box(part.iter().fold(0_u64, |sum, number| sum.wrapping_add(*number)))
                    });
                }
            });
            began.elapsed().as_secs_f64()
        });
        let least = times.fold(f64::INFINITY, f64::min);
        println!(
            "  {:<40} {:9.1} GB/s",
            format!("memory read by {n} threads"),
            (numbers.len() * 8) as f64 / least / 1e9
        );
    }
}

/// Isomap of the first frames, and nothing chosen.
fn isomap(data: &Data, n_frames: usize, n_landmarks: usize) {
    let counts = data.counts(n_frames);
    let mut steps = Steps::new();
    let plan = plan(n_frames, n_landmarks);
    let model = fit(counts, &plan, Origin::default(), &mut |step, _, _| steps.at(format!("{step:?}")));
    let model = model.expect("simulated trips make a model");
    steps.print("Isomap");
    peak();

    let clock = Clock::start();
    let geodesics = model.geodesics().expect("Isomap has geodesics");
    let squared = |i: usize, j: usize| f64::from(geodesics.row(model.landmarks()[i] as usize)[j]).powi(2);
    black_box(Embedding::fit(n_landmarks, squared, 30, N_DIMS)).expect("it was done before");
    told("scaling alone, once more", clock.taken());
    quality(&model);
}

fn plan(n_frames: usize, n_landmarks: usize) -> FitPlan {
    FitPlan {
        n_frames_max: n_frames,
        n_neighbors: Some(N_NEIGHBORS),
        n_landmarks,
        n_dims: Some(N_DIMS),
        n_kinds: Some(1),
        em: EmPlan { n_starts: 1, ..EmPlan::new(0) },
        ..FitPlan::new(Data::sensor(), Data::response(), 0)
    }
}

fn quality(model: &Model) {
    let Provenance { islands, eigenvalues, residual_variance, .. } = &model.manifest().provenance;
    println!("  islands {islands:?}");
    println!("  eigenvalues {:?}", &eigenvalues[..N_DIMS]);
    println!("  residual variance {:?}", &residual_variance[..N_DIMS]);
}

/// A training from a trip to a model, everything chosen by the trainer.
fn whole(data: &Data) {
    let model = training(&data.trip(), &Config::default());
    let manifest = model.manifest();
    println!(
        "  {} neighbours, {} dimensions, {} kinds",
        manifest.n_neighbors, manifest.n_dims, manifest.n_kinds
    );
}

/// Mixtures of one kind to twenty, side by side.
fn mixture(data: &Data) {
    let coordinates = data.coordinates(N_DIMS).unwrap_or_else(|| {
        let mut steps = Steps::new();
        let plan = plan(data.n_points, N_LANDMARKS);
        let counts = data.counts(data.n_points);
        let model = fit(counts, &plan, Origin::default(), &mut |step, _, _| steps.at(format!("{step:?}")));
        let model = model.expect("simulated trips make a model");
        steps.print("an embedding to fit mixtures to");
        data.keep_coordinates(model.coordinates(), N_DIMS);
        model.coordinates().to_vec()
    });
    let plan = EmPlan { n_starts: N_STARTS, ..EmPlan::new(0) };
    let clock = Clock::start();
    let fits: Vec<_> = (1..N_KINDS_MAX + 1)
        .into_par_iter()
        .rev()
        .with_max_len(1)
        .map(|n_kinds| fit_mixture(&coordinates, N_DIMS, n_kinds, &plan, &mut |_| ()))
        .collect();
    told("mixtures", clock.taken());
    peak();
    for (n_kinds, fit) in (1..=N_KINDS_MAX).zip(fits.into_iter().rev()) {
        match fit {
            Ok(fit) => println!(
                "  {n_kinds:2} kinds, log-likelihood {:.3} after {} iterations",
                fit.log_likelihood(),
                fit.log_likelihoods.len() - 1
            ),
            Err(error) => println!("  {n_kinds:2} kinds, {error}"),
        }
    }
}
