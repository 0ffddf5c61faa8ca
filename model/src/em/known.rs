//! A mixture of kinds that are known already, and of new ones for frames that are of none of these.

use super::covariance::Constraint;
use super::over_time::transposed;
use super::starts::Starts;
use super::steps::{Blocks, maximise};
use super::{EmError, EmFit, EmPlan, Points, floor_variance, iterate};

/// Runs expectation and maximisation from what is known of frames.
///
/// * `coordinates` — of all frames, shape `(n_frames, n_dims)`, counts
/// * `known` — probabilities of known kinds, shape `(n_frames, n_known)`; zeros of a frame that is of none of them
/// * `n_new` — kinds that begin as clusters of such frames
///
/// A known kind that has less than one of the frames is left out. None if a kind loses its frames, or there are too few for the new ones.
///
/// # Errors
/// If the frames do not vary.
pub(crate) fn fit_from_known(
    points: Points,
    known: &[f64],
    n_known: usize,
    n_new: usize,
    plan: &EmPlan,
) -> Result<Option<EmFit>, EmError> {
    let n_frames = points.n();
    let of_none = |frame: &usize| known[frame * n_known..][..n_known].iter().sum::<f64>() == 0.0;
    let unknown: Vec<usize> = (0..n_frames).filter(of_none).collect();
    if unknown.len() < n_new {
        return Ok(None);
    }
    let mut by_kind: Vec<f64> = transposed(known, n_known)
        .chunks_exact(n_frames)
        .filter(|of_kind| of_kind.iter().sum::<f64>() >= 1.0)
        .flatten()
        .copied()
        .collect();
    if n_new > 0 {
        let places: Vec<f64> = unknown.iter().flat_map(|&frame| points.row(frame)).copied().collect();
        let clusters =
            Starts::new(Points { coordinates: &places, ..points }, plan).responsibilities(n_new, 0);
        for cluster in clusters.chunks_exact(unknown.len()) {
            let mut of_kind = vec![0.0; n_frames];
            unknown.iter().zip(cluster).for_each(|(&frame, share)| of_kind[frame] = *share);
            by_kind.extend(of_kind);
        }
    }
    let floor = floor_variance(points, plan)?;
    let blocks = Blocks::new(points);
    let constraint = Constraint { covariance: plan.covariance, floor };
    let begun = maximise(&blocks, by_kind.len() / n_frames, &by_kind, constraint);
    Ok(begun.and_then(|mixture| iterate(&blocks, mixture, plan, floor)))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::em::{fit_mixture, fit_mixture_from};

    /// Three clouds of 60 frames each on a line.
    fn clouds() -> Vec<f64> {
        (0..180).map(|index| 100.0 * f64::from(index / 60) + f64::from(index * 37 % 60) / 10.0).collect()
    }

    #[test]
    fn from_what_a_mixture_says_of_frames_it_is_found_again_with_its_kinds_in_their_order() {
        let coordinates = clouds();
        let points = Points { n_dims: 1, coordinates: &coordinates };
        let plan = EmPlan::new(3);
        let fit = fit_mixture(&coordinates, 1, 3, &plan, &mut |_| ()).unwrap();
        let mut known = vec![0.0; 3 * 180];
        for (place, known) in coordinates.iter().zip(known.chunks_exact_mut(3)) {
            fit.mixture.posterior(&[*place], known);
        }
        let again = fit_from_known(points, &known, 3, 0, &plan).unwrap().unwrap();
        let expected = fit_mixture_from(&coordinates, fit.mixture, &plan).unwrap();
        for (found, expected) in again.mixture.means().iter().zip(expected.mixture.means()) {
            assert!((found - expected).abs() < 1e-9, "{found} and {expected}");
        }
    }

    #[test]
    fn frames_that_are_of_no_known_kind_make_new_ones_after_the_known_and_kinds_without_frames_go() {
        let coordinates = clouds();
        let points = Points { n_dims: 1, coordinates: &coordinates };
        // The first cloud is of the second kind, none is of the first, and the others are of neither.
        let known: Vec<f64> = (0..180).flat_map(|index| [0.0, f64::from(u8::from(index < 60))]).collect();
        let means = |n_new| {
            let fit = fit_from_known(points, &known, 2, n_new, &EmPlan::new(0)).unwrap()?;
            Some(fit.mixture.means().iter().map(|mean| (mean / 100.0).floor()).collect::<Vec<_>>())
        };
        assert_eq!(means(0), Some(vec![1.0]));
        let mut two = means(2).unwrap();
        assert_eq!(two.remove(0), 0.0);
        two.sort_by(f64::total_cmp);
        assert_eq!(two, [1.0, 2.0]);
        assert_eq!(means(121), None);
    }
}
