//! What fitting holds, beyond the frames: the geodesics and a few matrices of landmarks. Alone in its program, since the
//! allocator counts for all tests of one.

use kinds_model::{EmPlan, FitPlan, Method, Origin, ResponsePlan, Scale, SensorLayout, fit};
use peak_alloc::PeakAlloc;
use rand::RngExt;
use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::SeedableRng;

#[global_allocator]
static ALLOCATOR: PeakAlloc = PeakAlloc;

const N_READINGS: usize = 16;

/// A closed walk with noise.
fn trip(n_frames: usize) -> Vec<u16> {
    let mut random = ChaCha8Rng::seed_from_u64(6);
    let mut counts = Vec::with_capacity(n_frames * N_READINGS);
    for index in 0..n_frames {
        let phase = std::f64::consts::TAU * index as f64 / n_frames as f64;
        for reading in 0..N_READINGS {
            let bearing = reading as f64 / 3.0;
            let range = 5000.0 + 3000.0 * (phase + bearing).cos() + 1000.0 * (3.0 * phase - bearing).sin();
            counts.push((range + random.random_range(-200.0..200.0)) as u16);
        }
    }
    counts
}

/// Most bytes held at once while everything but neighbours and kinds is chosen by evidence, beyond those held before.
fn held(n_frames: usize, n_landmarks: usize, method: Method) -> usize {
    let plan = FitPlan {
        method,
        n_landmarks,
        n_kinds: Some(4),
        em: EmPlan { n_starts: 2, ..EmPlan::new(0) },
        ..FitPlan::new(
            SensorLayout { rows: 1, columns: N_READINGS as u32, metres_per_count: 0.001 },
            ResponsePlan::new(Scale::Range, 20.0),
            0,
        )
    };
    let counts = trip(n_frames);
    let before = ALLOCATOR.current_usage();
    ALLOCATOR.reset_peak_usage();
    fit(counts, &plan, Origin::default(), &mut |_, _, _| ()).expect("a walk makes a model");
    ALLOCATOR.peak_usage() - before
}

#[test]
fn fitting_holds_the_geodesics_and_few_matrices_of_landmarks() {
    let matrix = |rows: usize, columns: usize, n_bytes: usize| rows * columns * n_bytes;
    // Lists of neighbours, graphs, coordinates and eigenvectors: so much for each frame.
    let of_frames = |n_frames| n_frames * 12_000;
    let (n_frames, n_landmarks) = (2000, 2000);
    let full = held(n_frames, n_landmarks, Method::Isomap);
    let bound =
        matrix(n_frames, n_landmarks, 4) + 2 * matrix(n_landmarks, n_landmarks, 8) + of_frames(n_frames);
    assert!(
        full <= bound,
        "{full} bytes for {n_frames} frames that are all landmarks, at most {bound} expected"
    );

    let (n_frames, n_landmarks) = (6000, 500);
    let landmarks = held(n_frames, n_landmarks, Method::Isomap);
    let bound =
        matrix(n_frames, n_landmarks, 4) + 4 * matrix(n_landmarks, n_landmarks, 8) + of_frames(n_frames);
    assert!(landmarks <= bound && landmarks <= 100_000_000, "{landmarks} bytes, at most {bound} expected");
}
