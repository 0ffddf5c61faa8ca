//! How many kinds there are, by a Dirichlet process: a mixture of kinds without end, of which frames ask for a few.
//!
//! Weights are what is broken off a stick, `α_j = v_j Π_{i<j} (1 − v_i)` with `v_j ~ Beta(1, c)`, and each kind's mean and
//! precision are drawn from a normal-Wishart distribution. What is believed of all these after the frames is taken for one
//! distribution of each, for the first T kinds, such that a lower bound of ln evidence rises with every iteration: Blei &
//! Jordan 2006, *Variational inference for Dirichlet process mixtures*, with the updates of Bishop 2006, *Pattern recognition
//! and machine learning*, ch. 10.2. No frame is of a kind beyond the T-th, but the stick does not end there (Kurihara,
//! Welling & Vlassis 2007, *Accelerated variational Dirichlet process mixtures*).
//!
//! 1. **Frames of a trip are not independent**, and this evidence takes them to be, as Schwarz' criterion does: a robot that
//!    moves slowly is given ever more kinds. So each frame counts as N_eff / N of one, in the kinds' frames n_j and in the
//!    bound. That is a power posterior (Miller & Dunson 2019, *Robust Bayesian inference via coarsening*). A frame's
//!    responsibilities stay what they are, and the bound still never falls.
//! 2. **Starts are of 1, 2, … T kinds**, the others being empty, and the highest bound is taken. From T kinds alone the bound
//!    seldom finds its way down: on a recorded trip of 1379 frames in 8 dimensions ten starts of 20 kinds ended with 16 to 18
//!    and a bound 100 nats below that of 3.
//! 3. **Kinds are in falling order of frames.** The bound depends on their order by `Π_j 1 / (c + n_j + n_{j+1} + …)` alone,
//!    which is then greatest.
//! 4. **Kinds that stay** have at least one independent frame. The others are left out, and the weights of those that stay
//!    made to sum to 1. With less, a kind's mean is more the prior's than its frames'.
//! 5. **Expected means and covariances are served**, and not what expectation and maximisation would make of them. They are
//!    wider, as the few independent frames of a kind warrant. Frames in contiguous blocks that were held out are 1 to 18 nats
//!    likelier each on a recorded trip of 16 readings, 2 on one of a camera, and as likely on a simulated one; those that were
//!    learnt from are 0.4 to 3 less likely. Kinds were as consistent on a second trip: κ .99, 1.00, .48, .20 against .99,
//!    .89, .52, .18 (16 readings; camera in 4 and in 8 dimensions; simulated).
//!
//! The concentration c is 1: between 0.1 and 10 it moved the number of kinds by none or 2, starts being the same.

mod kind;

use std::f64::consts::TAU;

use nalgebra::DMatrix;
use rayon::prelude::*;

use self::kind::{Kind, break_stick, log_normaliser};
use super::covariance::{Covariance, raise_to_floor};
use super::starts::Starts;
use super::steps::{Blocks, expect, mean_and_covariance, scatter};
use super::{EmError, EmPlan, Points, floor_variance};
use crate::evidence::N_KINDS_TRIED_MAX;
use crate::mixture::Mixture;
use crate::tally::Tally;

/// c of the Dirichlet process: N independent frames are expected to be of some c ln N kinds.
pub const CONCENTRATION: f64 = 1.0;

/// β₀: frames that the prior mean of a kind is worth.
const N_FRAMES_OF_MEAN: f64 = 1.0;

/// Least prior variance in any direction, as a share of the mean variance: however low a plan's floor, matrices that frames
/// are added to keep a Cholesky factor in floating-point numbers.
const PRIOR_VARIANCE_SHARE_MIN: f64 = 1e-9;

/// Independent frames that a kind must have to stay.
pub const N_FRAMES_OF_KIND_MIN: f64 = N_FRAMES_OF_MEAN;

/// A mixture by a Dirichlet process, and how it came about.
#[derive(Clone, Debug)]
pub struct DirichletFit {
    /// The kinds that stay, in falling order of frames, with expected weights, means and covariances.
    pub mixture: Mixture,
    /// n_j: independent frames of all kinds, of those that do not stay too.
    pub n_frames_of_kinds: Vec<f64>,
    /// Lower bound of ln evidence after each iteration, nats.
    pub lower_bounds: Vec<f64>,
    /// Whether it converged within the allowed iterations.
    pub converged: bool,
}

impl DirichletFit {
    /// Lower bound of ln evidence at the end, nats.
    pub fn lower_bound(&self) -> f64 {
        self.lower_bounds[self.lower_bounds.len() - 1]
    }
}

/// Fits a mixture from starts of 1, 2, … kinds, up to [`N_KINDS_TRIED_MAX`] or as many as there are frames, and returns all
/// fits in this order: see [`likeliest`].
///
/// Each start is the best of `n_starts` by k-means, judged by the bound. Starts run side by side on the threads of whoever
/// calls; what comes out does not depend on how many those are.
///
/// * `coordinates` — of all frames, shape `(n_frames, n_dims)`, counts
/// * `n_frames_effective` — N_eff; as many as there are frames where these are independent
/// * `done` — told the number of starts finished, of [`N_KINDS_TRIED_MAX`] or as many as there are frames
///
/// O(n_iterations · n_frames · n_dims²) for each of T² kinds, T = [`N_KINDS_TRIED_MAX`].
///
/// # Errors
/// If the frames do not vary, or other covariances than full ones are asked for.
pub fn fit_dirichlet(
    coordinates: &[f64],
    n_dims: usize,
    n_frames_effective: f64,
    plan: &EmPlan,
    done: &mut (dyn FnMut(usize) + Send),
) -> Result<Vec<DirichletFit>, EmError> {
    let process = Process::new(Points { n_dims, coordinates }, n_frames_effective, plan)?;
    let n_frames = process.points.n();
    let n_kinds_max = N_KINDS_TRIED_MAX.min(n_frames);
    let starts = Starts::new(process.points, plan);
    let tally = Tally::new(done);
    let run = |n_kinds: usize| {
        // One kind is the same from every seed.
        let n_starts = if n_kinds == 1 { 1 } else { plan.n_starts as u64 };
        let begun = (0..n_starts).map(|start_index| {
            let mut responsibilities = starts.responsibilities(n_kinds, start_index);
            responsibilities.resize(n_kinds_max * n_frames, 0.0);
            (process.believe(&responsibilities).lower_bound, responsibilities)
        });
        let best = begun.reduce(|best, next| if next.0 > best.0 { next } else { best });
        let fit = process.iterate(best.expect("there is a start at least").1, plan);
        tally.add();
        fit
    };
    // The longest first, so that no thread is left with one when the others have nothing more to do.
    let numbers: Vec<usize> = (1..=n_kinds_max).rev().collect();
    let mut fits: Vec<DirichletFit> =
        numbers.par_iter().with_max_len(1).map(|&n_kinds| run(n_kinds)).collect();
    fits.reverse();
    Ok(fits)
}

/// The fit with the highest bound, of equals that which began with the fewest kinds.
pub fn likeliest(fits: Vec<DirichletFit>) -> Option<DirichletFit> {
    fits.into_iter().reduce(|best, fit| if fit.lower_bound() > best.lower_bound() { fit } else { best })
}

/// Fits a mixture from given responsibilities.
///
/// * `coordinates` — of all frames, shape `(n_frames, n_dims)`, counts
/// * `responsibilities` — shape `(n_kinds, n_frames)`; a kind may be empty
/// * `n_frames_effective` — N_eff
///
/// # Errors
/// As [`fit_dirichlet`].
pub fn fit_dirichlet_from(
    coordinates: &[f64],
    n_dims: usize,
    responsibilities: Vec<f64>,
    n_frames_effective: f64,
    plan: &EmPlan,
) -> Result<DirichletFit, EmError> {
    let process = Process::new(Points { n_dims, coordinates }, n_frames_effective, plan)?;
    Ok(process.iterate(responsibilities, plan))
}

/// The frames, and what is believed of kinds before any of them is seen: of each that it is where all frames are and as wide
/// as all of them together.
struct Process<'a> {
    points: Points<'a>,
    /// The same.
    blocks: Blocks,
    /// N_eff / N: what a frame counts.
    frame_weight: f64,
    /// Least variance in any direction, counts².
    floor: f64,
    /// m₀, shape `(n_dims,)`, counts.
    mean: Vec<f64>,
    /// ν₀.
    degrees_of_freedom: f64,
    /// W₀⁻¹, counts².
    scatter: DMatrix<f64>,
}

impl<'a> Process<'a> {
    fn new(points: Points<'a>, n_frames_effective: f64, plan: &EmPlan) -> Result<Self, EmError> {
        if plan.covariance != Covariance::Full {
            return Err(EmError::NotFull { covariance: plan.covariance });
        }
        let floor = floor_variance(points, plan)?;
        let n_frames = points.n() as f64;
        let blocks = Blocks::new(points);
        let (mean, covariance) = mean_and_covariance(&blocks);
        let least_variance = PRIOR_VARIANCE_SHARE_MIN * covariance.trace() / points.n_dims as f64;
        Ok(Self {
            points,
            blocks,
            frame_weight: n_frames_effective / n_frames,
            floor,
            mean,
            degrees_of_freedom: points.n_dims as f64,
            // Where frames do not vary along some direction there would be no volume.
            scatter: raise_to_floor(covariance, floor.max(least_variance)),
        })
    }

    fn iterate(&self, mut responsibilities: Vec<f64>, plan: &EmPlan) -> DirichletFit {
        let mut lower_bounds = Vec::new();
        let mut believed = self.believe(&responsibilities);
        let mut converged = false;
        for _ in 0..plan.n_iterations_max {
            lower_bounds.push(believed.lower_bound);
            expect(&self.blocks, &believed.as_likely(), &mut responsibilities);
            believed = self.believe(&responsibilities);
            let gain = believed.lower_bound - lower_bounds[lower_bounds.len() - 1];
            if gain < plan.tolerance * self.frame_weight * self.points.n() as f64 {
                converged = true;
                break;
            }
        }
        lower_bounds.push(believed.lower_bound);
        DirichletFit {
            mixture: believed.that_stay(self.floor),
            n_frames_of_kinds: believed.kinds.iter().map(|kind| kind.n_frames).collect(),
            lower_bounds,
            converged,
        }
    }

    /// What is believed after frames with these responsibilities.
    fn believe(&self, responsibilities: &[f64]) -> Believed {
        let of_kinds = responsibilities.chunks_exact(self.points.n());
        let mut kinds: Vec<Kind> = of_kinds.map(|of_kind| self.kind(of_kind)).collect();
        kinds.sort_by(|a, b| b.n_frames.total_cmp(&a.n_frames));
        let of_stick = break_stick(&mut kinds);
        let before = log_normaliser(N_FRAMES_OF_MEAN, self.degrees_of_freedom, &self.scatter);
        let of_kinds: f64 = kinds.iter().map(|kind| kind.log_normaliser() - before).sum();
        let entropy: f64 = -responsibilities
            .iter()
            .filter(|share| **share > 0.0)
            .map(|share| share * libm::log(*share))
            .sum::<f64>();
        let n_coordinates = self.points.coordinates.len() as f64;
        let of_frames = entropy - 0.5 * n_coordinates * libm::log(TAU);
        Believed { kinds, lower_bound: of_stick + of_kinds + self.frame_weight * of_frames }
    }

    /// Bishop 2006, eqs. (10.60) to (10.63).
    fn kind(&self, responsibilities: &[f64]) -> Kind {
        let sum: f64 = responsibilities.iter().sum();
        if sum < NEGLIGIBLE {
            return Kind::new(0.0, self.mean.clone(), self.degrees_of_freedom, self.scatter.clone());
        }
        let (mean, spread) = scatter(&self.blocks, responsibilities, sum);
        let n_frames = self.frame_weight * sum;
        let towards = n_frames / (N_FRAMES_OF_MEAN + n_frames);
        let offset: Vec<f64> = mean.iter().zip(&self.mean).map(|(mean, prior)| mean - prior).collect();
        let mut scatter = &self.scatter + spread * n_frames;
        for (row, along_row) in offset.iter().enumerate() {
            for (column, along_column) in offset.iter().enumerate() {
                scatter[(row, column)] += N_FRAMES_OF_MEAN * towards * along_row * along_column;
            }
        }
        let mean = self.mean.iter().zip(&offset).map(|(prior, offset)| prior + towards * offset).collect();
        Kind::new(n_frames, mean, self.degrees_of_freedom + n_frames, scatter)
    }
}

/// Responsibilities of a kind that add up to less are none: a mean of them would be made of rounding.
const NEGLIGIBLE: f64 = 1e-30;

/// What is believed of all kinds, in falling order of frames.
struct Believed {
    kinds: Vec<Kind>,
    /// Of ln evidence, nats: `Σ ln Z_j / Z₀` of the kinds and pieces of the stick, and the entropy of the responsibilities,
    /// which is all that is left of the bound where these belong together.
    lower_bound: f64,
}

impl Believed {
    /// A mixture under which each frame's posterior is its responsibilities.
    fn as_likely(&self) -> Mixture {
        let weights = self.kinds.iter().map(|kind| libm::exp(kind.log_weight_of_gaussian())).collect();
        mixture(&self.kinds, weights, |covariance| covariance)
    }

    /// The expected mixture of the kinds that stay.
    fn that_stay(&self, floor: f64) -> Mixture {
        let n_stay = self.kinds.iter().filter(|kind| kind.n_frames >= N_FRAMES_OF_KIND_MIN).count();
        // Less than one independent frame for each of two kinds is a trip that stood still.
        let stay = &self.kinds[..n_stay.max(1)];
        let weights = stay.iter().map(|kind| kind.weight).collect();
        mixture(stay, weights, |covariance| raise_to_floor(covariance, floor))
    }
}

/// A mixture of the kinds' expected means and covariances.
///
/// * `constrain` — what is done to a covariance
fn mixture(
    kinds: &[Kind],
    mut weights: Vec<f64>,
    constrain: impl Fn(DMatrix<f64>) -> DMatrix<f64>,
) -> Mixture {
    let sum: f64 = weights.iter().sum();
    weights.iter_mut().for_each(|weight| *weight /= sum);
    let means = kinds.iter().flat_map(|kind| &kind.mean).copied().collect();
    let covariances = kinds
        .iter()
        .flat_map(|kind| constrain(&kind.scatter / kind.degrees_of_freedom).as_slice().to_vec())
        .collect();
    let mixture = Mixture::new(kinds[0].mean.len(), weights, means, covariances);
    mixture.expect("the prior has volume, and frames only add to it")
}

#[cfg(test)]
mod tests {
    use std::f64::consts::PI;

    use proptest::prelude::*;

    use super::*;

    /// ln evidence of one Gaussian kind in one dimension, frame after frame: each is distributed as Student's t, given those
    /// before (Bishop 2006, exercise 10.20 and eq. (B.68)).
    fn log_evidence(places: &[f64], process: &Process) -> f64 {
        let (mut mean, mut n_frames_of_mean) = (process.mean[0], N_FRAMES_OF_MEAN);
        let (mut degrees, mut scatter) = (process.degrees_of_freedom, process.scatter[(0, 0)]);
        let mut sum = 0.0;
        for place in places {
            let squared_scale = scatter * (n_frames_of_mean + 1.0) / (n_frames_of_mean * degrees);
            let squared = (place - mean) * (place - mean) / squared_scale;
            sum += libm::lgamma(0.5 * (degrees + 1.0)) - libm::lgamma(0.5 * degrees);
            sum -=
                0.5 * ((PI * degrees * squared_scale).ln() + (degrees + 1.0) * (squared / degrees).ln_1p());
            scatter += (place - mean) * (place - mean) * n_frames_of_mean / (n_frames_of_mean + 1.0);
            mean += (place - mean) / (n_frames_of_mean + 1.0);
            n_frames_of_mean += 1.0;
            degrees += 1.0;
        }
        sum
    }

    #[test]
    fn with_one_kind_the_bound_is_the_evidence() {
        let places: Vec<f64> = (0..30).map(|index| f64::from(index * index % 17) - 3.0).collect();
        let process =
            Process::new(Points { n_dims: 1, coordinates: &places }, 30.0, &EmPlan::new(0)).unwrap();
        let believed = process.believe(&[1.0; 30]);
        // All frames in the first piece of the stick: ∫ vᴺ dv = 1 / (N + 1).
        let expected = log_evidence(&places, &process) - 31_f64.ln();
        assert!((believed.lower_bound - expected).abs() < 1e-9, "{} {expected}", believed.lower_bound);
    }

    #[test]
    fn a_frame_that_counts_twice_is_as_two_frames() {
        let once: Vec<f64> = (0..40).map(|index| f64::from(index * index % 23)).collect();
        let twice: Vec<f64> = once.chunks_exact(2).flat_map(|place| [place, place].concat()).collect();
        let fitted = |coordinates: &[f64], n_frames_effective| {
            let n_frames = coordinates.len() / 2;
            let kinds = (0..2 * n_frames)
                .map(|index| f64::from(u8::from(index % n_frames * 2 / n_frames == index / n_frames)));
            let plan = EmPlan { n_iterations_max: 20, tolerance: -1.0, ..EmPlan::new(0) };
            fit_dirichlet_from(coordinates, 2, kinds.collect(), n_frames_effective, &plan).unwrap()
        };
        let (one, two) = (fitted(&once, 40.0), fitted(&twice, 40.0));
        for (one, two) in one.lower_bounds.iter().zip(&two.lower_bounds) {
            assert!((one - two).abs() < 1e-9, "{one} {two}");
        }
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(60))]
        #[test]
        fn the_lower_bound_never_decreases_and_what_stays_is_a_mixture_above_the_floor(
            coordinates in prop::collection::vec(-50.0..50.0_f64, 3 * 12..3 * 60),
            n_kinds in 1..6_usize,
            duplicates in 0..10_usize,
            frame_weight in prop::sample::select(&[1.0, 0.3, 0.05]),
            seed in any::<u64>(),
        ) {
            let mut coordinates = coordinates[..coordinates.len() / 3 * 3].to_vec();
            for _ in 0..duplicates {
                coordinates.extend_from_within(..3);
            }
            let points = Points { n_dims: 3, coordinates: &coordinates };
            let plan = EmPlan { tolerance: -1.0, n_iterations_max: 60, ..EmPlan::new(seed) };
            let responsibilities = Starts::new(points, &plan).responsibilities(n_kinds, 0);
            let n_effective = frame_weight * points.n() as f64;
            let fit = fit_dirichlet_from(&coordinates, 3, responsibilities, n_effective, &plan).unwrap();
            for pair in fit.lower_bounds.windows(2) {
                // Rounding of sums of some 60 terms of some 10 nats, and of ln Γ of some 100.
                prop_assert!(pair[1] >= pair[0] - 1e-9, "{} then {}", pair[0], pair[1]);
            }
            prop_assert!(fit.n_frames_of_kinds.is_sorted_by(|a, b| a >= b));
            prop_assert!((fit.n_frames_of_kinds.iter().sum::<f64>() - n_effective).abs() < 1e-9);
            let n_stay = fit.n_frames_of_kinds.iter().filter(|n_frames| **n_frames >= 1.0).count();
            prop_assert_eq!(fit.mixture.n_kinds(), n_stay.max(1));
            let floor = floor_variance(points, &plan).unwrap();
            for covariance in fit.mixture.covariances().chunks_exact(9) {
                let least = DMatrix::from_row_slice(3, 3, covariance).symmetric_eigenvalues().min();
                prop_assert!(least >= floor * (1.0 - 1e-9));
            }
        }
    }

    #[test]
    fn frames_along_a_line_are_fitted_though_the_floor_is_next_to_nothing() {
        let line: Vec<f64> = (0..120)
            .flat_map(|index| [1.0, -2.0, 3.0].map(|along| along * f64::from(index / 40 * 1000 + index % 40)))
            .collect();
        let plan = EmPlan { covariance_floor: 1e-300, n_starts: 2, ..EmPlan::new(0) };
        let fits = fit_dirichlet(&line, 3, 120.0, &plan, &mut |_| ()).unwrap();
        assert!(fits.iter().all(|fit| fit.converged && fit.lower_bound().is_finite()));
    }

    #[test]
    fn kinds_of_another_shape_are_refused_in_words() {
        let plan = EmPlan { covariance: Covariance::Tied, ..EmPlan::new(0) };
        let refused = fit_dirichlet(&[1.0, 2.0, 4.0], 1, 3.0, &plan, &mut |_| ()).unwrap_err();
        assert_eq!(
            refused.to_string(),
            "a Dirichlet process has kinds with full covariances, and tied ones were asked for; ask for full ones, or choose \
             the number of kinds by BIC_neff or held-out blocks"
        );
    }
}
