//! Expectation and maximisation with the knowledge that trips are slow: frames that follow each other are mostly of one kind.
//!
//! Baum, Petrie, Soules & Weiss 1970, for the hidden Markov model of [`crate::persistence`]: what is expected of a frame's kind is
//! so given all frames of its trip, and weights are those by which kinds are drawn when they change.

use super::covariance::Constraint;
use super::steps::{Blocks, expect, maximise};
use super::{EmError, EmFit, EmPlan, Points, floor_variance};
use crate::mixture::Mixture;
use crate::persistence::{learn, smooth};

/// Runs expectation and maximisation over time from a mixture that was fitted without.
///
/// * `coordinates` — of all frames in order of time, shape `(n_frames, n_dims)`, counts
/// * `trips` — frames of each trip, in order
///
/// The likelihoods are of frames in their order.
///
/// # Errors
/// If the frames do not vary or a kind loses its frames.
pub(crate) fn fit_over_time(
    coordinates: &[f64],
    start: Mixture,
    trips: &[usize],
    plan: &EmPlan,
) -> Result<EmFit, EmError> {
    let points = Points { n_dims: start.n_dims(), coordinates };
    let constraint = Constraint { covariance: plan.covariance, floor: floor_variance(points, plan)? };
    let (blocks, n_frames, n_kinds) = (Blocks::new(points), points.n(), start.n_kinds());
    let collapsed = EmError::Collapsed { n_starts: 1, n_kinds, n_frames };
    let mut by_kind = vec![0.0; n_frames * n_kinds];
    expect(&blocks, &start, &mut by_kind);
    let mut persistence = learn(&transposed(&by_kind, n_frames), start.weights(), trips);
    let mut fit =
        EmFit { mixture: start, log_likelihoods: Vec::new(), converged: false, n_starts_collapsed: 0 };
    for _ in 0..=plan.n_iterations_max {
        let without_time = expect(&blocks, &fit.mixture, &mut by_kind);
        let mut by_frame = transposed(&by_kind, n_frames);
        let expected = smooth(persistence, fit.mixture.weights(), &mut by_frame, trips);
        let log_likelihood = without_time + expected.log_gain;
        let before = fit.log_likelihoods.last().copied().unwrap_or(f64::NEG_INFINITY);
        fit.log_likelihoods.push(log_likelihood);
        if log_likelihood - before < plan.tolerance * n_frames as f64 {
            fit.converged = true;
            break;
        }
        by_kind = transposed(&by_frame, n_kinds);
        let likeliest = maximise(&blocks, n_kinds, &by_kind, constraint).ok_or(collapsed.clone())?;
        let (means, covariances) = (likeliest.means().to_vec(), likeliest.covariances().to_vec());
        fit.mixture = Mixture::new(points.n_dims, expected.weights(), means, covariances)?;
        persistence = expected.persistence();
    }
    Ok(fit)
}

/// Columns as rows.
///
/// * `n_columns` — of what is given
pub(super) fn transposed(rows: &[f64], n_columns: usize) -> Vec<f64> {
    (0..n_columns).flat_map(|column| rows.iter().skip(column).step_by(n_columns).copied()).collect()
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;
    use rand::RngExt;
    use rand_chacha::ChaCha8Rng;
    use rand_chacha::rand_core::SeedableRng;

    use super::*;
    use crate::em::fit_mixture;

    /// How far apart the kinds of a trip are, in deviations.
    const APART: f64 = 1.5;

    /// Places of two kinds that overlap, each of which lasts for fifty frames at a time.
    fn slow(n_frames: usize, seed: u64) -> Vec<f64> {
        let mut random = ChaCha8Rng::seed_from_u64(seed);
        let mut noise = move || (0..12).map(|_| random.random_range(-0.5..0.5)).sum::<f64>();
        (0..n_frames).map(|index| APART * (index / 50 % 2) as f64 + noise()).collect()
    }

    #[test]
    fn kinds_that_overlap_are_told_apart_by_time() {
        let plan = EmPlan::new(0);
        let error = |mixture: &Mixture| {
            let mut means = mixture.means().to_vec();
            means.sort_by(f64::total_cmp);
            means[0].hypot(means[1] - APART)
        };
        let errors_of = |seed| {
            let coordinates = slow(2000, seed);
            let without = fit_mixture(&coordinates, 1, 2, &plan, &mut |_| ()).unwrap().mixture;
            let over_time = fit_over_time(&coordinates, without.clone(), &[2000], &plan).unwrap();
            assert!(over_time.converged);
            [error(&without), error(&over_time.mixture)]
        };
        let errors: Vec<[f64; 2]> = (0..8).map(errors_of).collect();
        let [without, over_time] = [0, 1].map(|way| errors.iter().map(|pair| pair[way]).sum::<f64>() / 8.0);
        // A mean of 1000 frames with a deviation of 1 is off by 0.03.
        assert!(over_time < 0.08 && over_time < without / 3.0, "{errors:?}");
    }

    #[test]
    fn frames_in_no_order_make_the_mixture_that_they_make_without_time() {
        let mut coordinates = slow(4000, 2);
        // Far apart, so that there is one optimum; and shuffled, so that no kind lasts.
        coordinates.iter_mut().for_each(|place| {
            if *place > 0.8 {
                *place += 6.0;
            }
        });
        let mut random = ChaCha8Rng::seed_from_u64(4);
        for index in (1..coordinates.len()).rev() {
            coordinates.swap(index, random.random_range(0..=index));
        }
        let plan = EmPlan { tolerance: 1e-10, ..EmPlan::new(0) };
        let without = fit_mixture(&coordinates, 1, 2, &plan, &mut |_| ()).unwrap();
        let over_time = fit_over_time(&coordinates, without.mixture.clone(), &[4000], &plan).unwrap();
        for (found, expected) in over_time.mixture.means().iter().zip(without.mixture.means()) {
            assert!((found - expected).abs() < 1e-3, "{found} and {expected}");
        }
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(60))]
        #[test]
        fn log_likelihood_over_time_never_decreases(
            coordinates in prop::collection::vec(-50.0..50.0_f64, 2 * 12..2 * 60),
            n_kinds in 1..4_usize,
            n_in_first in 1..12_usize,
            seed in any::<u64>(),
        ) {
            let coordinates = &coordinates[..coordinates.len() / 2 * 2];
            let n_frames = coordinates.len() / 2;
            let plan = EmPlan { n_starts: 2, n_iterations_max: 20, ..EmPlan::new(seed) };
            let begun = fit_mixture(coordinates, 2, n_kinds, &plan, &mut |_| ());
            let plan = EmPlan { tolerance: f64::NEG_INFINITY, ..plan };
            let over_time = |start| fit_over_time(coordinates, start, &[n_in_first, n_frames - n_in_first], &plan);
            if let Ok(fit) = begun.and_then(|begun| over_time(begun.mixture)) {
                for pair in fit.log_likelihoods.windows(2) {
                    // Rounding of a sum of some 60 terms of some 10 nats.
                    prop_assert!(pair[1] >= pair[0] - 1e-9, "{} then {}", pair[0], pair[1]);
                }
            }
        }
    }
}
