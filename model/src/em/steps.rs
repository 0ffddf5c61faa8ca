//! The two steps, expectation and maximisation, over all frames.
//!
//! Plainly: [`Mixture::posterior`] of every frame, then each kind's weighted mean and scatter. Departures from the plain way:
//!
//! 1. **Frames eight side by side**, dimension by dimension ([`Blocks`]), so that what is done to one is done to eight in the
//!    same instructions, and these are the widest of the processor. Each rounds as the narrow one does.
//! 2. **What is negligible is nothing**, and a kind is given up as soon as it is seen to be negligible for all eight: terms of
//!    a Mahalanobis distance only add to it. Each frame's other responsibilities have the bits of its posterior.
//! 3. **Scatters are summed over blocks in which the kind has a part**, eight blocks at a time, so that a sum stays in its
//!    register for as long.

use nalgebra::DMatrix;

use super::Points;
use super::covariance::Constraint;
use crate::mixture::{LANES, Lanes, Mixture};
use crate::simd::Instructions;

/// A kind that is this much less likely for a frame than the likeliest, nats, has no part in it: e⁻⁷⁰ is 4e-31. To the sum
/// over kinds, which is 1 or more, that adds no bit; and even a frame √N spreads away from a kind of a single frame would
/// move it by less than rounding does. Where kinds are many, they have no part in most frames.
const NEGLIGIBLE: f64 = -70.0;

/// Blocks whose scatter is summed at a time: with fifteen dimensions they fill half a core's first cache.
const N_BLOCKS: usize = 8;

/// All frames, eight side by side.
pub(super) struct Blocks {
    n_dims: usize,
    n_frames: usize,
    /// Shape `(n_blocks, n_dims)`; zeros where there is no frame.
    places: Vec<Lanes>,
}

impl Blocks {
    pub(super) fn new(points: Points) -> Self {
        let n_dims = points.n_dims;
        let mut places = vec![[0.0; LANES]; points.n().div_ceil(LANES) * n_dims];
        for (index, row) in points.rows().enumerate() {
            let block = &mut places[index / LANES * n_dims..][..n_dims];
            block.iter_mut().zip(row).for_each(|(lanes, place)| lanes[index % LANES] = *place);
        }
        Self { n_dims, n_frames: points.n(), places }
    }

    pub(super) fn n_frames(&self) -> usize {
        self.n_frames
    }

    /// Each of shape `(n_dims,)`.
    pub(super) fn iter(&self) -> impl Iterator<Item = &[Lanes]> {
        self.places.chunks_exact(self.n_dims)
    }
}

/// Fills the responsibilities, shape `(n_kinds, n_frames)`, and returns the log-likelihood of all frames.
pub(super) fn expect(blocks: &Blocks, mixture: &Mixture, responsibilities: &mut [f64]) -> f64 {
    Instructions::widest().run(
        #[inline(always)]
        || expect_plainly(blocks, mixture, responsibilities),
    )
}

/// Inlined, as all that it calls often, so that it is compiled for the instructions of whoever calls.
#[inline(always)]
fn expect_plainly(blocks: &Blocks, mixture: &Mixture, responsibilities: &mut [f64]) -> f64 {
    let (n_frames, n_kinds) = (blocks.n_frames, mixture.n_kinds());
    let mut offsets = vec![[0.0; LANES]; blocks.n_dims];
    let mut log_joints = vec![[0.0; LANES]; n_kinds];
    let mut log_likelihood = 0.0;
    // A likely kind first shows soonest which others are negligible, and frames are often of the kind of the last one.
    let mut likely = 0;
    for (block, places) in blocks.iter().enumerate() {
        let mut highest = [f64::NEG_INFINITY; LANES];
        for kind in std::iter::once(likely).chain((0..n_kinds).filter(|kind| *kind != likely)) {
            let least = highest.map(|highest| highest + NEGLIGIBLE);
            let log_joint = mixture.log_joints(kind, places, &mut offsets, &least);
            for lane in 0..LANES {
                highest[lane] = if log_joint[lane] > highest[lane] { log_joint[lane] } else { highest[lane] };
            }
            log_joints[kind] = log_joint;
        }
        let first = block * LANES;
        for lane in 0..LANES.min(n_frames - first) {
            let highest = highest[lane];
            let mut sum = 0.0;
            for (kind, log_joint) in log_joints.iter_mut().enumerate() {
                let joint = &mut log_joint[lane];
                if *joint == highest {
                    likely = kind;
                }
                *joint = if *joint < highest + NEGLIGIBLE { 0.0 } else { libm::exp(*joint - highest) };
                sum += *joint;
            }
            for (kind, joint) in log_joints.iter().enumerate() {
                responsibilities[kind * n_frames + first + lane] = joint[lane] / sum;
            }
            log_likelihood += highest + libm::log(sum);
        }
    }
    log_likelihood
}

/// The mixture that the responsibilities make likeliest; `None` if a kind has less than one frame left, or no volume.
pub(super) fn maximise(
    blocks: &Blocks,
    n_kinds: usize,
    responsibilities: &[f64],
    constraint: Constraint,
) -> Option<Mixture> {
    let n_dims = blocks.n_dims;
    let mut weights = Vec::with_capacity(n_kinds);
    let mut means = Vec::with_capacity(n_kinds * n_dims);
    let mut scatters = Vec::with_capacity(n_kinds);
    for of_kind in responsibilities.chunks_exact(blocks.n_frames) {
        let share: f64 = of_kind.iter().sum();
        if share < 1.0 {
            return None;
        }
        let (mean, scatter) = scatter(blocks, of_kind, share);
        weights.push(share / blocks.n_frames as f64);
        means.extend_from_slice(&mean);
        scatters.push(scatter);
    }
    let sum: f64 = weights.iter().sum();
    weights.iter_mut().for_each(|weight| *weight /= sum);
    let covariances = constraint.likeliest(&weights, scatters);
    let covariances = covariances.iter().flat_map(|covariance| covariance.as_slice()).copied().collect();
    Mixture::new(n_dims, weights, means, covariances).ok()
}

/// Mean and covariance of all frames, counts and counts².
pub(super) fn mean_and_covariance(blocks: &Blocks) -> (Vec<f64>, DMatrix<f64>) {
    scatter(blocks, &vec![1.0; blocks.n_frames], blocks.n_frames as f64)
}

/// Weighted mean and scatter of one kind, whose responsibilities add up to `share`.
pub(super) fn scatter(blocks: &Blocks, responsibilities: &[f64], share: f64) -> (Vec<f64>, DMatrix<f64>) {
    Instructions::widest().run(
        #[inline(always)]
        || scatter_plainly(blocks, responsibilities, share),
    )
}

#[inline(always)]
fn scatter_plainly(blocks: &Blocks, responsibilities: &[f64], share: f64) -> (Vec<f64>, DMatrix<f64>) {
    let n_dims = blocks.n_dims;
    let with_part: Vec<(&[Lanes], Lanes)> = blocks
        .iter()
        .zip(responsibilities.chunks(LANES).map(lanes))
        .filter(|(_, weights)| weights.iter().any(|weight| *weight != 0.0))
        .collect();

    let mut sums = vec![[0.0; LANES]; n_dims];
    for (places, weights) in &with_part {
        for (sum, place) in sums.iter_mut().zip(*places) {
            add_product(sum, weights, place);
        }
    }
    let mean: Vec<f64> = sums.iter().map(|sum| sum.iter().sum::<f64>() / share).collect();

    let mut offsets = vec![[[0.0; LANES]; N_BLOCKS]; n_dims];
    let mut weighted = offsets.clone();
    // The lower triangle by rows, each entry as eight sums.
    let mut sums = vec![[0.0; LANES]; n_dims * (n_dims + 1) / 2];
    for group in with_part.chunks(N_BLOCKS) {
        for dim in 0..n_dims {
            for (block, (places, weights)) in group.iter().enumerate() {
                for lane in 0..LANES {
                    let offset = places[dim][lane] - mean[dim];
                    offsets[dim][block][lane] = offset;
                    weighted[dim][block][lane] = weights[lane] * offset;
                }
            }
            // What the group before left there.
            weighted[dim][group.len()..].fill([0.0; LANES]);
        }
        let mut sums = sums.iter_mut();
        for (row, along_row) in weighted.iter().enumerate() {
            for (along_column, sum) in offsets[..=row].iter().zip(&mut sums) {
                for block in 0..N_BLOCKS {
                    add_product(sum, &along_row[block], &along_column[block]);
                }
            }
        }
    }
    let mut scatter = DMatrix::zeros(n_dims, n_dims);
    let mut sums = sums.iter();
    for row in 0..n_dims {
        for (column, sum) in (0..=row).zip(&mut sums) {
            scatter[(row, column)] = sum.iter().sum::<f64>() / share;
        }
    }
    scatter.fill_upper_triangle_with_lower_triangle();
    (mean, scatter)
}

#[inline(always)]
fn add_product(sum: &mut Lanes, a: &Lanes, b: &Lanes) {
    for lane in 0..LANES {
        sum[lane] += a[lane] * b[lane];
    }
}

/// Some numbers side by side, and nothing in lanes after the last.
#[inline(always)]
fn lanes(numbers: &[f64]) -> Lanes {
    let mut lanes = [0.0; LANES];
    lanes[..numbers.len()].copy_from_slice(numbers);
    lanes
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::em::Covariance;

    const FULL: Constraint = Constraint { covariance: Covariance::Full, floor: 0.5 };

    /// Eleven frames, one block and a part, in three dimensions.
    fn places() -> Vec<f64> {
        (0..33).map(|index| f64::from(index * index % 17) - 3.0 + 0.1 * f64::from(index)).collect()
    }

    #[test]
    fn responsibilities_are_the_posteriors_bit_for_bit_where_they_are_not_negligible() {
        let coordinates = places();
        let points = Points { n_dims: 3, coordinates: &coordinates };
        let blocks = Blocks::new(points);
        let halves: Vec<f64> =
            (0..22).map(|index| f64::from(u8::from((index < 11) == (index % 2 == 0)))).collect();
        let mixture = maximise(&blocks, 2, &halves, FULL).unwrap();
        let mut responsibilities = vec![0.0; 22];
        let log_likelihood = expect(&blocks, &mixture, &mut responsibilities);
        let mut posterior = [0.0; 2];
        let mut sum = 0.0;
        for (index, place) in points.rows().enumerate() {
            sum += mixture.posterior(place, &mut posterior);
            let expected = posterior.map(|share| if share < 1e-30 { 0.0 } else { share });
            assert_eq!([responsibilities[index], responsibilities[11 + index]], expected, "frame {index}");
        }
        assert_eq!(log_likelihood, sum);
    }

    #[test]
    fn the_widest_instructions_round_as_the_plain_ones() {
        let coordinates = places();
        let blocks = Blocks::new(Points { n_dims: 3, coordinates: &coordinates });
        let weights: Vec<f64> = (0..22).map(|index| 0.1 + f64::from(index % 7) / 10.0).collect();
        let of_one = &weights[..11];
        assert_eq!(scatter(&blocks, of_one, 5.0), scatter_plainly(&blocks, of_one, 5.0));
        let mixture = maximise(&blocks, 2, &weights, FULL).unwrap();
        let (mut wide, mut plain) = ([0.0; 22], [0.0; 22]);
        assert_eq!(expect(&blocks, &mixture, &mut wide), expect_plainly(&blocks, &mixture, &mut plain));
        assert_eq!(wide, plain);
    }

    #[test]
    fn the_scatter_is_that_of_the_printed_formula() {
        let coordinates = places();
        let points = Points { n_dims: 3, coordinates: &coordinates };
        let blocks = Blocks::new(points);
        let weights: Vec<f64> = (0..11).map(|index| f64::from(index % 4) / 4.0).collect();
        let share: f64 = weights.iter().sum();
        let (mean, found) = scatter(&blocks, &weights, share);
        let mut expected = DMatrix::zeros(3, 3);
        for (place, weight) in points.rows().zip(&weights) {
            for row in 0..3 {
                for column in 0..3 {
                    expected[(row, column)] +=
                        weight / share * (place[row] - mean[row]) * (place[column] - mean[column]);
                }
            }
        }
        assert!((found - expected).abs().max() < 1e-12);
    }
}
