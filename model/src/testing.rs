//! Frames of every sort that searching must get right, for tests.

use rand::RngExt;
use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::SeedableRng;

use crate::frames::SensorLayout;

/// What frames look like.
#[derive(Clone, Copy, Debug)]
pub(crate) enum Sort {
    /// Any counts.
    Random,
    /// Waves that move a little from frame to frame.
    Smooth,
    /// Waves and noise.
    Noisy,
    /// Of one count each.
    Constant,
    /// Few different frames, each many times.
    Copies,
    /// Waves, and many readings that are as far as can be, or 0.
    Riddled,
    /// As far as can be, all of them.
    Greatest,
}

pub(crate) const SORTS: [Sort; 7] =
    [Sort::Random, Sort::Smooth, Sort::Noisy, Sort::Constant, Sort::Copies, Sort::Riddled, Sort::Greatest];

pub(crate) fn layout(rows: u32, columns: u32) -> SensorLayout {
    SensorLayout { rows, columns, metres_per_count: 0.001 }
}

/// Frames of a sort, one after the other.
pub(crate) fn frames_of(sort: Sort, sensor: SensorLayout, n_frames: usize, seed: u64) -> Vec<u16> {
    let mut random = ChaCha8Rng::seed_from_u64(seed);
    let mut counts = Vec::with_capacity(n_frames * sensor.n_readings());
    for index in 0..n_frames {
        let constant = random.random();
        let phase = match sort {
            Sort::Copies => (index % 3) as f64,
            _ => index as f64 / 20.0,
        };
        for reading in 0..sensor.n_readings() as u32 {
            let (row, column) = (f64::from(reading / sensor.columns), f64::from(reading % sensor.columns));
            let wave = 20_000.0 + 15_000.0 * (phase + row / 17.0).sin() * (column / 23.0 - phase).cos();
            counts.push(match sort {
                Sort::Random => random.random(),
                Sort::Smooth | Sort::Copies => wave as u16,
                Sort::Noisy => (wave + random.random_range(-3000.0..3000.0)) as u16,
                Sort::Constant => constant,
                Sort::Riddled if random.random_bool(0.2) => u16::MAX,
                Sort::Riddled if random.random_bool(0.1) => 0,
                Sort::Riddled => wave as u16,
                Sort::Greatest => u16::MAX,
            });
        }
    }
    counts
}
