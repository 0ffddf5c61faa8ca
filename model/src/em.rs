//! Fits a mixture to embedded frames by expectation and maximisation.
//!
//! McLachlan & Basford 1988, *Mixture models*. Several starts by k-means from k-means++ seeds (Arthur & Vassilvitskii
//! 2007); short runs, and the likeliest of them to convergence.
//!
//! Starts cluster the coordinates as they are. Whitened first, the last dimensions, which are mostly noise, have as much
//! to say as the first: on recorded trips of 16 readings (8 dimensions, 8 kinds) each of five seeds then ended between
//! 700 and 2200 nats lower.
//!
//! Covariances of whatever shape are kept from collapsing by a floor on their eigenvalues, as a constraint under which
//! the likelihood is maximised, so that it never decreases ([`Covariance`]).

mod covariance;
mod steps;

use rand::RngExt;
use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::SeedableRng;
use rayon::prelude::*;
use serde::{Deserialize, Serialize};

use self::covariance::Constraint;
pub use self::covariance::Covariance;
use self::steps::{expect, maximise, mean_variance};
use crate::mixture::{Mixture, MixtureError};
use crate::tally::Tally;

/// How a mixture is fitted.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct EmPlan {
    /// What shape the kinds may have.
    pub covariance: Covariance,
    /// Starts to choose from.
    pub n_starts: usize,
    /// Iterations of each start before the best is chosen.
    pub n_short_iterations: usize,
    /// Iterations at most, in all.
    pub n_iterations_max: usize,
    /// Converged when an iteration gains less than this, nats per frame.
    pub tolerance: f64,
    /// Least variance of a kind in any direction, as a share of the mean variance of all frames. The units of an
    /// embedding are whatever the sensor's are, so an absolute floor would mean nothing.
    pub covariance_floor: f64,
    /// Seed of the starts.
    pub seed: u64,
}

impl EmPlan {
    /// The usual plan.
    pub fn new(seed: u64) -> Self {
        Self {
            covariance: Covariance::Full,
            n_starts: 10,
            n_short_iterations: 20,
            n_iterations_max: 1000,
            tolerance: 1e-7,
            covariance_floor: 1e-3,
            seed,
        }
    }
}

/// A fitted mixture and how it came about.
#[derive(Clone, Debug)]
pub struct EmFit {
    /// The mixture.
    pub mixture: Mixture,
    /// ln likelihood of all frames before each iteration, and at the end.
    pub log_likelihoods: Vec<f64>,
    /// Whether it converged within the allowed iterations.
    pub converged: bool,
    /// Starts that were given up because a kind lost its frames.
    pub n_starts_collapsed: usize,
}

/// Why no mixture could be fitted.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum EmError {
    /// Fewer frames than kinds.
    #[error("{n_frames} frames cannot make {n_kinds} kinds; ask for fewer kinds or record a longer trip")]
    TooFewFrames {
        /// Frames.
        n_frames: usize,
        /// Kinds asked for.
        n_kinds: usize,
    },
    /// The frames do not vary, or are not finite.
    #[error("the embedded frames do not vary: all {n_frames} are at one place, which has no kinds")]
    NoVariance {
        /// Frames.
        n_frames: usize,
    },
    /// No start kept all its kinds.
    #[error(
        "in each of {n_starts} starts one of {n_kinds} kinds lost its frames ({n_frames} in all); ask for fewer kinds"
    )]
    Collapsed {
        /// Starts.
        n_starts: usize,
        /// Kinds asked for.
        n_kinds: usize,
        /// Frames.
        n_frames: usize,
    },
    /// The numbers made no mixture.
    #[error(transparent)]
    Mixture(#[from] MixtureError),
}

/// Embedded frames, shape `(n_frames, n_dims)`.
#[derive(Clone, Copy)]
pub(crate) struct Points<'a> {
    pub(crate) n_dims: usize,
    pub(crate) coordinates: &'a [f64],
}

impl<'a> Points<'a> {
    pub(crate) fn n(&self) -> usize {
        self.coordinates.len() / self.n_dims
    }

    pub(crate) fn rows(&self) -> impl Iterator<Item = &'a [f64]> + use<'a> {
        self.coordinates.chunks_exact(self.n_dims)
    }

    fn row(&self, index: usize) -> &'a [f64] {
        &self.coordinates[index * self.n_dims..][..self.n_dims]
    }
}

/// Fits a mixture of J kinds from several starts.
///
/// * `coordinates` — of all frames, shape `(n_frames, n_dims)`, counts
/// * `done` — told the number of starts finished
///
/// Starts run side by side on the threads of whoever calls. The same on every run for a seed, and on any number of
/// threads. O(n_starts · n_short_iterations · n_frames · n_kinds · n_dims²) and the same again for the iterations to
/// convergence.
///
/// # Errors
/// If there are fewer frames than kinds, the frames do not vary, or every start lost a kind.
pub fn fit_mixture(
    coordinates: &[f64],
    n_dims: usize,
    n_kinds: usize,
    plan: &EmPlan,
    done: &mut (dyn FnMut(usize) + Send),
) -> Result<EmFit, EmError> {
    let points = Points { n_dims, coordinates };
    let n_frames = points.n();
    if n_kinds == 0 || n_frames < n_kinds {
        return Err(EmError::TooFewFrames { n_frames, n_kinds });
    }
    fit_points(points, n_kinds, plan, floor_variance(points, plan)?, &Tally::new(done))
}

/// As [`fit_mixture`], with the least variance of a kind in any direction already known, counts².
pub(crate) fn fit_points(
    points: Points,
    n_kinds: usize,
    plan: &EmPlan,
    floor: f64,
    tally: &Tally,
) -> Result<EmFit, EmError> {
    let n_frames = points.n();
    if n_frames < n_kinds {
        return Err(EmError::TooFewFrames { n_frames, n_kinds });
    }
    let short = EmPlan { n_iterations_max: plan.n_short_iterations, ..plan.clone() };
    let run = |start: u64| {
        let begun = begin(points, n_kinds, plan, floor, start);
        let fit = begun.and_then(|mixture| iterate(points, mixture, &short, floor));
        tally.add();
        fit
    };
    let fits: Vec<Option<EmFit>> = (0..plan.n_starts as u64).into_par_iter().map(run).collect();
    let n_starts_collapsed = fits.iter().filter(|fit| fit.is_none()).count();
    // The first of equals, so that it does not matter which thread was faster.
    let likelier = |best: EmFit, fit: EmFit| match fit.log_likelihoods.last() > best.log_likelihoods.last() {
        true => fit,
        false => best,
    };
    let collapsed = EmError::Collapsed { n_starts: plan.n_starts, n_kinds, n_frames };
    let best = fits.into_iter().flatten().reduce(likelier).ok_or(collapsed.clone())?;
    if best.converged {
        return Ok(EmFit { n_starts_collapsed, ..best });
    }
    let mut fit = iterate(points, best.mixture, plan, floor).ok_or(collapsed)?;
    // The last of the short run is the first of the long one.
    fit.log_likelihoods =
        [&best.log_likelihoods[..best.log_likelihoods.len() - 1], &fit.log_likelihoods[..]].concat();
    Ok(EmFit { n_starts_collapsed, ..fit })
}

/// Runs expectation and maximisation from a given mixture.
///
/// * `coordinates` — of all frames, shape `(n_frames, n_dims)`, counts
///
/// # Errors
/// If the frames do not vary or a kind loses its frames.
pub fn fit_mixture_from(coordinates: &[f64], start: Mixture, plan: &EmPlan) -> Result<EmFit, EmError> {
    let points = Points { n_dims: start.n_dims(), coordinates };
    let floor = floor_variance(points, plan)?;
    let collapsed = EmError::Collapsed { n_starts: 1, n_kinds: start.n_kinds(), n_frames: points.n() };
    iterate(points, start, plan, floor).ok_or(collapsed)
}

/// Variance below which no kind may fall in any direction, counts².
pub(crate) fn floor_variance(points: Points, plan: &EmPlan) -> Result<f64, EmError> {
    let mean_variance = mean_variance(points);
    match mean_variance.is_finite() && mean_variance > 0.0 {
        true => Ok(plan.covariance_floor * mean_variance),
        false => Err(EmError::NoVariance { n_frames: points.n() }),
    }
}

/// Iterates to convergence; `None` if a kind loses its frames.
fn iterate(points: Points, mut mixture: Mixture, plan: &EmPlan, floor: f64) -> Option<EmFit> {
    let constraint = Constraint { covariance: plan.covariance, floor };
    let mut responsibilities = vec![0.0; points.n() * mixture.n_kinds()];
    let mut log_likelihoods = vec![expect(points, &mixture, &mut responsibilities)];
    let mut converged = false;
    for _ in 0..plan.n_iterations_max {
        mixture = maximise(points, mixture.n_kinds(), &responsibilities, constraint)?;
        let log_likelihood = expect(points, &mixture, &mut responsibilities);
        let gain = log_likelihood - log_likelihoods[log_likelihoods.len() - 1];
        log_likelihoods.push(log_likelihood);
        if gain < plan.tolerance * points.n() as f64 {
            converged = true;
            break;
        }
    }
    Some(EmFit { mixture, log_likelihoods, converged, n_starts_collapsed: 0 })
}

/// Rounds of Lloyd's algorithm at most, before expectation and maximisation take over.
const N_LLOYD_ROUNDS_MAX: usize = 100;

/// A start: k-means, each frame wholly its nearest centre's.
fn begin(points: Points, n_kinds: usize, plan: &EmPlan, floor: f64, start: u64) -> Option<Mixture> {
    let mut random = ChaCha8Rng::seed_from_u64(plan.seed);
    random.set_stream(start);
    let mut centres = k_means_plus_plus(points, n_kinds, &mut random);
    for _ in 0..N_LLOYD_ROUNDS_MAX {
        let moved = move_to_means(points, &centres);
        if std::mem::replace(&mut centres, moved.clone()) == moved {
            break;
        }
    }
    let mut responsibilities = vec![0.0; n_kinds * points.n()];
    for (index, point) in points.rows().enumerate() {
        responsibilities[nearest_centre(point, &centres).0 * points.n() + index] = 1.0;
    }
    let constraint = Constraint { covariance: plan.covariance, floor };
    maximise(points, n_kinds, &responsibilities, constraint)
}

fn k_means_plus_plus(points: Points, n_centres: usize, random: &mut ChaCha8Rng) -> Vec<Vec<f64>> {
    let mut centres = vec![points.row(random.random_range(0..points.n())).to_vec()];
    let mut squared: Vec<f64> = vec![f64::INFINITY; points.n()];
    while centres.len() < n_centres {
        let newest = &centres[centres.len() - 1];
        squared
            .iter_mut()
            .zip(points.rows())
            .for_each(|(least, point)| *least = least.min(squared_distance(point, newest)));
        let mut left = random.random::<f64>() * squared.iter().sum::<f64>();
        let drawn = squared.iter().position(|squared| {
            left -= squared;
            left < 0.0
        });
        // Where all frames coincide with a centre, any will do: the kind will lose its frames, and that is reported.
        centres.push(points.row(drawn.unwrap_or(points.n() - 1)).to_vec());
    }
    centres
}

/// One round of Lloyd's algorithm; a centre without frames stays where it is.
fn move_to_means(points: Points, centres: &[Vec<f64>]) -> Vec<Vec<f64>> {
    let mut sums = vec![vec![0.0; points.n_dims]; centres.len()];
    let mut counts = vec![0_usize; centres.len()];
    for point in points.rows() {
        let (nearest, _) = nearest_centre(point, centres);
        counts[nearest] += 1;
        sums[nearest].iter_mut().zip(point).for_each(|(sum, place)| *sum += place);
    }
    for ((sum, &count), centre) in sums.iter_mut().zip(&counts).zip(centres) {
        match count {
            0 => sum.clone_from(centre),
            _ => sum.iter_mut().for_each(|sum| *sum /= count as f64),
        }
    }
    sums
}

fn nearest_centre(point: &[f64], centres: &[Vec<f64>]) -> (usize, f64) {
    let distances = centres.iter().map(|centre| squared_distance(point, centre)).enumerate();
    distances.fold((0, f64::INFINITY), |best, next| if next.1 < best.1 { next } else { best })
}

fn squared_distance(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(a, b)| (a - b) * (a - b)).sum()
}

#[cfg(test)]
mod tests {
    use nalgebra::DMatrix;
    use proptest::prelude::*;

    use super::*;

    /// Three clouds of 60 frames, in this order, far apart in two dimensions.
    fn clouds() -> Vec<f64> {
        let mut random = ChaCha8Rng::seed_from_u64(1);
        let mut noise = move || (0..6).map(|_| random.random_range(-0.5..0.5)).sum::<f64>();
        let centres = [(0.0, 0.0), (9000.0, 0.0), (0.0, 9000.0)];
        let places = centres.iter().flat_map(|&(x, y)| (0..60).flat_map(move |_| [x, y]));
        places.map(|centre| centre + 700.0 * noise()).collect()
    }

    #[test]
    fn clouds_far_apart_become_one_kind_each() {
        let coordinates = clouds();
        let fit = fit_mixture(&coordinates, 2, 3, &EmPlan::new(5), &mut |_| ()).unwrap();
        assert!(fit.converged);
        let mut probabilities = [0.0; 3];
        let mut kind_of = |index: usize| {
            fit.mixture.posterior(&coordinates[2 * index..][..2], &mut probabilities);
            crate::mixture::most_probable(&probabilities)
        };
        let kinds: Vec<usize> = [0, 60, 120].map(&mut kind_of).to_vec();
        assert!(kinds[0] != kinds[1] && kinds[1] != kinds[2] && kinds[0] != kinds[2]);
        for index in 0..180 {
            assert_eq!(kind_of(index), kinds[index / 60], "frame {index}");
        }
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(80))]
        #[test]
        fn log_likelihood_never_decreases_under_em(
            coordinates in prop::collection::vec(-50.0..50.0_f64, 3 * 12..3 * 60),
            n_kinds in 1..4_usize,
            duplicates in 0..10_usize,
            covariance in prop::sample::select(&covariance::tests::ALL),
            seed in any::<u64>(),
        ) {
            let mut coordinates = coordinates[..coordinates.len() / 3 * 3].to_vec();
            // Copies of one frame pull a kind onto them, down to the floor.
            for _ in 0..duplicates {
                coordinates.extend_from_within(..3);
            }
            let plan = EmPlan { covariance, n_starts: 2, tolerance: -1.0, n_iterations_max: 60, ..EmPlan::new(seed) };
            if let Ok(fit) = fit_mixture(&coordinates, 3, n_kinds, &plan, &mut |_| ()) {
                for pair in fit.log_likelihoods.windows(2) {
                    // Rounding of a sum of some 60 terms of some 10 nats.
                    prop_assert!(pair[1] >= pair[0] - 1e-9, "{} then {}", pair[0], pair[1]);
                }
                let floor = floor_variance(Points { n_dims: 3, coordinates: &coordinates }, &plan).unwrap();
                for covariance in fit.mixture.covariances().chunks_exact(9) {
                    let least = DMatrix::from_row_slice(3, 3, covariance).symmetric_eigenvalues().min();
                    prop_assert!(least >= floor * (1.0 - 1e-9));
                }
            }
        }
    }

    #[test]
    fn what_cannot_be_fitted_is_refused_in_words() {
        let refuse = |coordinates: &[f64], n_kinds| {
            fit_mixture(coordinates, 1, n_kinds, &EmPlan::new(0), &mut |_| ()).unwrap_err().to_string()
        };
        assert_eq!(
            refuse(&[1.0, 2.0], 3),
            "2 frames cannot make 3 kinds; ask for fewer kinds or record a longer trip"
        );
        assert_eq!(
            refuse(&[4.0; 5], 2),
            "the embedded frames do not vary: all 5 are at one place, which has no kinds"
        );
        assert_eq!(
            refuse(&[0.0, 0.0, 0.0, 0.0, 1.0], 4),
            "in each of 10 starts one of 4 kinds lost its frames (5 in all); ask for fewer kinds"
        );
    }
}
