//! The two steps, expectation and maximisation, over all frames.
//!
//! Frames are taken eight at a time, dimension by dimension, so that what is done to one is done to eight in the same
//! instructions. Each frame's sums are those of [`Mixture::posterior`], in the same order and so with the same bits, but that
//! what is negligible is nothing. They are compiled for the widest instructions of the processor, each of which rounds as
//! the narrow one does.

use nalgebra::DMatrix;

use super::Points;
use super::covariance::Constraint;
use crate::mixture::{LANES, Lanes, Mixture};

/// A kind that is this much less likely for a frame than the likeliest, nats, has no part in it: e⁻⁷⁰ is 4e-31. To the sum
/// over kinds, which is 1 or more, that adds no bit; and even a frame √N spreads away from a kind of a single frame would
/// move it by less than rounding does. Where kinds are many, they have no part in most frames.
const NEGLIGIBLE: f64 = -70.0;

/// Fills the responsibilities, shape `(n_kinds, n_frames)`, and returns the log-likelihood of all frames.
pub(super) fn expect(points: Points, mixture: &Mixture, responsibilities: &mut [f64]) -> f64 {
    pulp::Arch::new().dispatch(|| expect_plainly(points, mixture, responsibilities))
}

/// Inlined, as all that it calls often, so that it is compiled for the instructions of whoever calls.
#[inline(always)]
fn expect_plainly(points: Points, mixture: &Mixture, responsibilities: &mut [f64]) -> f64 {
    let (n_frames, n_kinds) = (points.n(), mixture.n_kinds());
    let mut places = vec![[0.0; LANES]; points.n_dims];
    let mut offsets = places.clone();
    let mut log_joints = vec![[0.0; LANES]; n_kinds];
    let mut log_likelihood = 0.0;
    for first in (0..n_frames).step_by(LANES) {
        let n_here = LANES.min(n_frames - first);
        load(points, first, n_here, &mut places);
        for (kind, log_joint) in log_joints.iter_mut().enumerate() {
            *log_joint = mixture.log_joints(kind, &places, &mut offsets);
        }
        for lane in 0..n_here {
            let highest = log_joints.iter().map(|joint| joint[lane]).fold(f64::NEG_INFINITY, f64::max);
            let mut sum = 0.0;
            for log_joint in &mut log_joints {
                let below = log_joint[lane] - highest;
                log_joint[lane] = if below < NEGLIGIBLE { 0.0 } else { libm::exp(below) };
                sum += log_joint[lane];
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
    points: Points,
    n_kinds: usize,
    responsibilities: &[f64],
    constraint: Constraint,
) -> Option<Mixture> {
    let n_dims = points.n_dims;
    let mut weights = Vec::with_capacity(n_kinds);
    let mut means = Vec::with_capacity(n_kinds * n_dims);
    let mut scatters = Vec::with_capacity(n_kinds);
    for of_kind in responsibilities.chunks_exact(points.n()) {
        let share: f64 = of_kind.iter().sum();
        if share < 1.0 {
            return None;
        }
        let (mean, scatter) = scatter(points, of_kind, share);
        weights.push(share / points.n() as f64);
        means.extend_from_slice(&mean);
        scatters.push(scatter);
    }
    let sum: f64 = weights.iter().sum();
    weights.iter_mut().for_each(|weight| *weight /= sum);
    let covariances = constraint.likeliest(&weights, scatters);
    let covariances = covariances.iter().flat_map(|covariance| covariance.as_slice()).copied().collect();
    Mixture::new(n_dims, weights, means, covariances).ok()
}

/// Mean variance of all frames over the dimensions, counts².
pub(super) fn mean_variance(points: Points) -> f64 {
    let (_, scatter) = scatter(points, &vec![1.0; points.n()], points.n() as f64);
    scatter.trace() / points.n_dims as f64
}

/// Weighted mean and scatter of one kind, whose responsibilities add up to `share`.
pub(super) fn scatter(points: Points, responsibilities: &[f64], share: f64) -> (Vec<f64>, DMatrix<f64>) {
    pulp::Arch::new().dispatch(|| scatter_plainly(points, responsibilities, share))
}

#[inline(always)]
fn scatter_plainly(points: Points, responsibilities: &[f64], share: f64) -> (Vec<f64>, DMatrix<f64>) {
    let n_dims = points.n_dims;
    let mut mean = vec![0.0; n_dims];
    for (point, responsibility) in points.rows().zip(responsibilities) {
        mean.iter_mut().zip(point).for_each(|(mean, place)| *mean += responsibility * place);
    }
    mean.iter_mut().for_each(|mean| *mean /= share);

    let mut offsets = vec![[0.0; LANES]; n_dims];
    // The lower triangle by rows, each entry as eight sums.
    let mut sums = vec![[0.0; LANES]; n_dims * (n_dims + 1) / 2];
    for (block, responsibilities) in responsibilities.chunks(LANES).enumerate() {
        if responsibilities.iter().all(|responsibility| *responsibility == 0.0) {
            continue;
        }
        load(points, block * LANES, responsibilities.len(), &mut offsets);
        for (offset, mean) in offsets.iter_mut().zip(&mean) {
            offset.iter_mut().for_each(|place| *place -= mean);
        }
        let mut weights = [0.0; LANES];
        weights[..responsibilities.len()].copy_from_slice(responsibilities);
        let mut sums = sums.iter_mut();
        for (row, along_row) in offsets.iter().enumerate() {
            let weighted: Lanes = std::array::from_fn(|lane| weights[lane] * along_row[lane]);
            for (along_column, sum) in offsets[..=row].iter().zip(&mut sums) {
                for lane in 0..LANES {
                    sum[lane] += weighted[lane] * along_column[lane];
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

/// Takes some frames side by side; lanes without a frame keep what they had, which nobody asks for.
#[inline(always)]
fn load(points: Points, first: usize, n_here: usize, places: &mut [Lanes]) {
    for lane in 0..n_here {
        for (place, coordinate) in places.iter_mut().zip(points.row(first + lane)) {
            place[lane] = *coordinate;
        }
    }
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
        let halves: Vec<f64> =
            (0..22).map(|index| f64::from(u8::from((index < 11) == (index % 2 == 0)))).collect();
        let mixture = maximise(points, 2, &halves, FULL).unwrap();
        let mut responsibilities = vec![0.0; 22];
        let log_likelihood = expect(points, &mixture, &mut responsibilities);
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
        let points = Points { n_dims: 3, coordinates: &coordinates };
        let weights: Vec<f64> = (0..22).map(|index| 0.1 + f64::from(index % 7) / 10.0).collect();
        let of_one = &weights[..11];
        assert_eq!(scatter(points, of_one, 5.0), scatter_plainly(points, of_one, 5.0));
        let mixture = maximise(points, 2, &weights, FULL).unwrap();
        let (mut wide, mut plain) = ([0.0; 22], [0.0; 22]);
        assert_eq!(expect(points, &mixture, &mut wide), expect_plainly(points, &mixture, &mut plain));
        assert_eq!(wide, plain);
    }

    #[test]
    fn the_scatter_is_that_of_the_printed_formula() {
        let coordinates = places();
        let points = Points { n_dims: 3, coordinates: &coordinates };
        let weights: Vec<f64> = (0..11).map(|index| f64::from(index % 4) / 4.0).collect();
        let share: f64 = weights.iter().sum();
        let (mean, found) = scatter(points, &weights, share);
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
