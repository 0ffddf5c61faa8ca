//! How far a score could have come out otherwise: confidence intervals by a bootstrap over blocks of the path.
//!
//! Neighbouring frames are alike, so that a trip of thousands of frames is a few dozen independent stretches at best. The path
//! is cut into blocks of equal length, and scores are computed anew of as many blocks, drawn with replacement: Künsch 1989,
//! *The jackknife and the bootstrap for general stationary observations*, with blocks that do not overlap (Carlstein 1986).

use std::ops::Range;

use rand::RngExt;
use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::SeedableRng;
use rayon::prelude::*;

/// Of fewer blocks than this nothing is said: their resamples are too few to differ.
const N_BLOCKS_MIN: usize = 5;

/// Frames of each block of a path, in order of time.
///
/// * `travelled_m` — metres travelled when each frame was taken, ascending, shape `(n_frames,)`
/// * `block_m` — length of a block, above 0; somewhat less, so that blocks are of equal length
pub(crate) fn blocks(travelled_m: &[f64], block_m: f64) -> Vec<Range<usize>> {
    let length_m = travelled_m.last().copied().unwrap_or(0.0);
    let n_blocks = (length_m / block_m).ceil().max(1.0);
    let ends = (1..n_blocks as usize).map(|block| {
        let end_m = length_m * block as f64 / n_blocks;
        travelled_m.partition_point(|travelled_m| *travelled_m < end_m)
    });
    let mut start = 0;
    let ranges = ends.chain([travelled_m.len()]).map(|end| {
        let range = start..end;
        start = end;
        range
    });
    // A block is empty where a robot's places jump over it.
    ranges.filter(|range| !range.is_empty()).collect()
}

/// Which blocks each resample is made of.
#[derive(Clone, Debug)]
pub(crate) struct Resamples {
    /// Shape `(n_resamples, n_blocks)`.
    draws: Vec<Vec<usize>>,
}

impl Resamples {
    /// None where there are too few blocks to say anything.
    pub(crate) fn draw(n_blocks: usize, n_resamples: usize, seed: u64) -> Option<Self> {
        let mut random = ChaCha8Rng::seed_from_u64(seed);
        let mut resample = || (0..n_blocks).map(|_| random.random_range(0..n_blocks)).collect();
        (n_blocks >= N_BLOCKS_MIN && n_resamples > 0)
            .then(|| Self { draws: (0..n_resamples).map(|_| resample()).collect() })
    }

    /// The range that holds the middle 95 of a hundred resamples' scores, those that have one. None if none has.
    ///
    /// * `score` — of the blocks drawn; asked for on the threads of whoever calls
    pub(crate) fn interval(&self, score: impl Fn(&[usize]) -> Option<f64> + Sync) -> Option<[f64; 2]> {
        let mut scores: Vec<f64> = self.draws.par_iter().filter_map(|draw| score(draw)).collect();
        scores.sort_by(f64::total_cmp);
        let at = |share: f64| scores[((scores.len() - 1) as f64 * share).round() as usize];
        (!scores.is_empty()).then(|| [at(0.025), at(0.975)])
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn blocks_are_of_equal_length_however_long_the_robot_stood_and_leave_no_frame_out() {
        // 10 m, of which the robot stands for 90 frames at 2 m.
        let travelled_m: Vec<f64> = (0..100)
            .map(|frame| if frame < 95 { (frame as f64).min(2.0) } else { frame as f64 - 89.0 })
            .collect();
        // Of four blocks the second, from 2.5 m to 5 m, has no frame: the robot's next place is at 6 m.
        assert_eq!(blocks(&travelled_m, 2.5), [0..95, 95..97, 97..100]);
        assert_eq!(blocks(&[0.0; 7], 1.0), vec![0..7]);
        // A jump of 100 m leaves no empty blocks.
        assert_eq!(blocks(&[0.0, 1.0, 101.0, 102.0], 10.0), [0..2, 2..4]);
    }

    #[test]
    fn the_interval_of_a_mean_is_that_of_the_central_limit() {
        // The mean of 400 coin tosses deviates by 0.025.
        let mut random = ChaCha8Rng::seed_from_u64(7);
        let tosses: Vec<f64> = (0..400).map(|_| f64::from(u8::from(random.random_bool(0.5)))).collect();
        let mean = |draw: &[usize]| Some(draw.iter().map(|&block| tosses[block]).sum::<f64>() / 400.0);
        let [low, high] = Resamples::draw(400, 4000, 1).unwrap().interval(mean).unwrap();
        let centre = tosses.iter().sum::<f64>() / 400.0;
        // 4000 resamples tell the ends to about 0.001.
        assert!((low - (centre - 1.96 * 0.025)).abs() < 0.005, "{low}");
        assert!((high - (centre + 1.96 * 0.025)).abs() < 0.005, "{high}");
    }

    #[test]
    fn of_a_few_blocks_nothing_is_said() {
        assert!(Resamples::draw(4, 100, 0).is_none());
        assert!(Resamples::draw(5, 100, 0).unwrap().interval(|_| None).is_none());
    }
}
