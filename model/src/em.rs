//! Fits a mixture to embedded frames by expectation and maximisation.
//!
//! McLachlan & Basford 1988, *Mixture models*. Several starts by k-means from k-means++ seeds (Arthur & Vassilvitskii
//! 2007); short runs, and the likeliest of them to convergence.
//!
//! Starts cluster the coordinates as they are, unless a plan asks for whitened ones. Whitened first, the last dimensions,
//! which are mostly noise, have as much to say as the first. Ten starts of which every other one was whitened, against ten
//! plain ones, in 8 dimensions with 4 to 10 kinds (log-likelihood, nats):
//!
//! | trip | fits | likelier | less likely | median | mean | all whitened, median |
//! |---|---|---|---|---|---|---|
//! | recorded, 16 readings | 56 | 0 | 29 | −6 | −85 | −824 |
//! | simulated, 16 readings | 28 | 5 | 7 | 0 | −37 | −112 |
//! | recorded, camera | 56 | 24 | 8 | 0 | +17 | +30 |
//!
//! in 1.1 times the time. Hence it is an option, for cameras.
//!
//! Covariances of whatever shape are kept from collapsing by a floor on their eigenvalues, as a constraint under which
//! the likelihood is maximised, so that it never decreases ([`Covariance`]).

mod covariance;
pub mod dirichlet;
mod known;
mod over_time;
mod starts;
mod steps;

use rayon::prelude::*;
use serde::{Deserialize, Serialize};

use self::covariance::Constraint;
pub use self::covariance::Covariance;
pub(crate) use self::known::fit_from_known;
pub(crate) use self::over_time::fit_over_time;
use self::starts::Starts;
pub use self::starts::StartsOn;
use self::steps::{Blocks, expect, maximise, mean_and_covariance};
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
    /// Coordinates that starts cluster.
    pub starts_on: StartsOn,
    /// Iterations of each start before the best is chosen.
    pub n_short_iterations: usize,
    /// Iterations at most, in all.
    pub n_iterations_max: usize,
    /// Converged when an iteration gains less than this, nats per frame.
    pub tolerance: f64,
    /// Least variance of a kind in any direction, as a share of the mean variance of all frames. The units of an
    /// embedding are whatever the sensor's are, so an absolute floor would mean nothing.
    pub covariance_floor: f64,
    /// Whether a frame's kind is then looked for given all frames of its trip, since trips are slow.
    #[serde(default)]
    pub over_time: bool,
    /// Seed of the starts.
    pub seed: u64,
}

impl EmPlan {
    /// The usual plan.
    pub fn new(seed: u64) -> Self {
        Self {
            covariance: Covariance::Full,
            n_starts: 10,
            starts_on: StartsOn::Plain,
            n_short_iterations: 20,
            n_iterations_max: 1000,
            tolerance: 1e-7,
            covariance_floor: 1e-3,
            over_time: false,
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

impl EmFit {
    /// ln likelihood of all frames at the end.
    pub fn log_likelihood(&self) -> f64 {
        self.log_likelihoods[self.log_likelihoods.len() - 1]
    }
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
    /// A Dirichlet process of kinds of another shape.
    #[error(
        "a Dirichlet process has kinds with full covariances, and {covariance} ones were asked for; ask for full ones, or choose \
         the number of kinds by BIC_neff or held-out blocks"
    )]
    NotFull {
        /// The shape asked for.
        covariance: Covariance,
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
    let starts = Starts::new(points, plan);
    let blocks = Blocks::new(points);
    let run = |start_index: u64| {
        let responsibilities = starts.responsibilities(n_kinds, start_index);
        let constraint = Constraint { covariance: plan.covariance, floor };
        let begun = maximise(&blocks, n_kinds, &responsibilities, constraint);
        let fit = begun.and_then(|mixture| iterate(&blocks, mixture, &short, floor));
        tally.add();
        fit
    };
    let fits: Vec<Option<EmFit>> = (0..plan.n_starts as u64).into_par_iter().map(run).collect();
    let n_collapsed_early = fits.iter().filter(|fit| fit.is_none()).count();
    let mut fits: Vec<EmFit> = fits.into_iter().flatten().collect();
    // A stable order: of equals the first is taken, whichever thread was faster.
    fits.sort_by(|a, b| b.log_likelihood().total_cmp(&a.log_likelihood()));
    // The likeliest, unless it loses a kind later: then the next.
    for (n_collapsed_late, short) in fits.into_iter().enumerate() {
        let n_starts_collapsed = n_collapsed_early + n_collapsed_late;
        if short.converged {
            return Ok(EmFit { n_starts_collapsed, ..short });
        }
        let Some(mut fit) = iterate(&blocks, short.mixture, plan, floor) else { continue };
        // The last of the short run is the first of the long one.
        fit.log_likelihoods =
            [&short.log_likelihoods[..short.log_likelihoods.len() - 1], &fit.log_likelihoods[..]].concat();
        return Ok(EmFit { n_starts_collapsed, ..fit });
    }
    Err(EmError::Collapsed { n_starts: plan.n_starts, n_kinds, n_frames })
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
    iterate(&Blocks::new(points), start, plan, floor).ok_or(collapsed)
}

/// Variance below which no kind may fall in any direction, counts².
pub(crate) fn floor_variance(points: Points, plan: &EmPlan) -> Result<f64, EmError> {
    let mean_variance = mean_and_covariance(&Blocks::new(points)).1.trace() / points.n_dims as f64;
    match mean_variance.is_finite() && mean_variance > 0.0 {
        true => Ok(plan.covariance_floor * mean_variance),
        false => Err(EmError::NoVariance { n_frames: points.n() }),
    }
}

/// Iterates to convergence; `None` if a kind loses its frames.
fn iterate(blocks: &Blocks, mut mixture: Mixture, plan: &EmPlan, floor: f64) -> Option<EmFit> {
    let constraint = Constraint { covariance: plan.covariance, floor };
    let mut responsibilities = vec![0.0; blocks.n_frames() * mixture.n_kinds()];
    let mut log_likelihoods = vec![expect(blocks, &mixture, &mut responsibilities)];
    let mut converged = false;
    for _ in 0..plan.n_iterations_max {
        mixture = maximise(blocks, mixture.n_kinds(), &responsibilities, constraint)?;
        let log_likelihood = expect(blocks, &mixture, &mut responsibilities);
        let gain = log_likelihood - log_likelihoods[log_likelihoods.len() - 1];
        log_likelihoods.push(log_likelihood);
        if gain < plan.tolerance * blocks.n_frames() as f64 {
            converged = true;
            break;
        }
    }
    Some(EmFit { mixture, log_likelihoods, converged, n_starts_collapsed: 0 })
}

#[cfg(test)]
mod tests {
    use nalgebra::DMatrix;
    use proptest::prelude::*;
    use rand::RngExt;
    use rand_chacha::ChaCha8Rng;
    use rand_chacha::rand_core::SeedableRng;

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
    fn where_the_likeliest_start_loses_a_kind_later_the_next_is_taken_and_that_is_counted() {
        let coordinates: [f64; 20] = [
            3.0, 0.0, 5.0, 2.0, 0.0, 3.0, 5.0, 5.0, 0.0, 1.0, 0.0, 3.0, 0.0, 4.0, 0.0, 2.0, 0.0, 0.0, 1.0,
            4.0,
        ];
        let given_up = |n_iterations_max| {
            let plan = EmPlan { n_starts: 3, n_short_iterations: 1, n_iterations_max, ..EmPlan::new(0) };
            let fit = fit_mixture(&coordinates, 2, 3, &plan, &mut |_| ()).unwrap();
            assert_eq!(fit.mixture.n_kinds(), 3);
            fit.n_starts_collapsed
        };
        assert_eq!(given_up(1), 0);
        assert_eq!(given_up(1000), 2);
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
