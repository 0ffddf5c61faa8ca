//! How many kinds there are, by evidence: mixtures of 1, 2, … kinds, and what speaks for each.
//!
//! Frames of a trip are not independent, and Schwarz' criterion takes them to be: on trips it asks for ever more kinds. So
//! the sum over N frames is taken for that over the N_eff of them that are as good as independent
//! ([`crate::autocorrelation`]): `BIC_neff = −2 (N_eff / N) ln L + κ ln N_eff`. The number with the least is taken.
//! The other way to one is a Dirichlet process ([`crate::em::dirichlet`]), which needs no trials.
//!
//! Beside it stands the likelihood of contiguous blocks that a mixture was not fitted to, as a second opinion and not as the
//! judge, unless a plan makes it that: what a trip saw once is in few blocks, so that it moves with where these begin. Random frames would not do at all: each has the
//! next one, nearly itself, among those that the mixture was fitted to.

use rayon::prelude::*;

use crate::em::{EmError, EmFit, EmPlan, Points, fit_points, floor_variance};
use crate::model::{DirichletTrial, KindsTrial};
use crate::tally::Tally;

/// Most kinds that are tried.
pub const N_KINDS_TRIED_MAX: usize = 20;

/// Parts of the frames that are held out, each in turn.
const N_FOLDS: usize = 4;

/// Contiguous blocks of the frames, dealt to the folds in turn: a fold holds some of every stretch of a trip, in pieces
/// that are long against what consecutive frames have in common.
const N_BLOCKS: usize = 20;

/// Fits that a scan consists of: for each number of kinds one to all frames, and one without each fold.
pub const N_FITS: usize = N_KINDS_TRIED_MAX * (1 + N_FOLDS);

/// Tries 1, 2, … kinds, up to [`N_KINDS_TRIED_MAX`] or to the first number that the frames cannot make.
///
/// Fits to all frames are those that [`crate::em::fit_mixture`] makes: with fewer starts they end in optima that differ by
/// more than numbers of kinds do. Fits without a fold are quicker. All run side by side on the threads of whoever calls;
/// what comes out does not depend on how many those are.
///
/// * `coordinates` — of all frames in order of time, shape `(n_frames, n_dims)`, counts
/// * `n_frames_effective` — N_eff
/// * `done` — told the number of fits finished, of [`N_FITS`]
///
/// # Errors
/// If the frames make not even one kind.
pub fn try_kinds(
    coordinates: &[f64],
    n_dims: usize,
    n_frames_effective: f64,
    plan: &EmPlan,
    done: &mut (dyn FnMut(usize) + Send),
) -> Result<Vec<KindsTrial>, EmError> {
    let points = Points { n_dims, coordinates };
    let floor = floor_variance(points, plan)?;
    let scan = Scan { points, n_frames_effective, floor, plan, quick: quick(plan) };
    let tally = Tally::new(done);
    // The longest first, so that no thread is left with one when the others have nothing more to do.
    let numbers: Vec<usize> = (1..=N_KINDS_TRIED_MAX).rev().collect();
    let mut trials: Vec<_> =
        numbers.par_iter().with_max_len(1).map(|&n_kinds| scan.try_one(n_kinds, &tally)).collect();
    let first = trials.pop().expect("one kind is tried")?;
    let more = trials.into_iter().rev().map_while(Result::ok);
    Ok(std::iter::once(first).chain(more).collect())
}

/// Those of trials of 1, 2, … kinds that are of enough kinds; the last, if none are.
pub fn of_at_least(trials: &[KindsTrial], n_kinds_min: usize) -> &[KindsTrial] {
    &trials[n_kinds_min.min(trials.len()).saturating_sub(1)..]
}

/// The trial with the least BIC_neff, of equals that with the fewest kinds.
pub fn best_by_bic_neff(trials: &[KindsTrial]) -> Option<&KindsTrial> {
    trials.iter().reduce(|best, trial| if trial.bic_neff < best.bic_neff { trial } else { best })
}

/// The trial under which frames that were held out are likeliest, of equals that with the fewest kinds.
pub fn best_by_held_out(trials: &[KindsTrial]) -> Option<&KindsTrial> {
    trials.iter().reduce(|best, trial| if trial.held_out > best.held_out { trial } else { best })
}

/// The start of a Dirichlet process that ended with the highest bound, of equals that which began with the fewest kinds.
pub fn best_by_bound(trials: &[DirichletTrial]) -> Option<&DirichletTrial> {
    highest_bound(trials.iter())
}

/// The best of the starts that ended with another number of kinds than the best.
pub fn runner_up_by_bound(trials: &[DirichletTrial]) -> Option<&DirichletTrial> {
    let best = best_by_bound(trials)?.n_kinds;
    highest_bound(trials.iter().filter(|trial| trial.n_kinds != best))
}

fn highest_bound<'a>(trials: impl Iterator<Item = &'a DirichletTrial>) -> Option<&'a DirichletTrial> {
    trials.reduce(|best, trial| if trial.lower_bound > best.lower_bound { trial } else { best })
}

/// For fits without a fold. There are four of them whose mean is taken, so that each may be worse.
fn quick(plan: &EmPlan) -> EmPlan {
    EmPlan {
        n_starts: plan.n_starts.min(3),
        n_short_iterations: plan.n_short_iterations.min(10),
        n_iterations_max: plan.n_iterations_max.min(200),
        tolerance: plan.tolerance.max(1e-4),
        ..plan.clone()
    }
}

/// What all trials have in common.
struct Scan<'a> {
    points: Points<'a>,
    n_frames_effective: f64,
    /// Least variance in any direction, the same with and without held-out frames, counts².
    floor: f64,
    /// For fits to all frames.
    plan: &'a EmPlan,
    /// For fits without a fold.
    quick: EmPlan,
}

impl Scan<'_> {
    fn try_one(&self, n_kinds: usize, tally: &Tally) -> Result<KindsTrial, EmError> {
        let all = self.fit(self.points, n_kinds, self.plan, tally);
        let folds: Vec<Result<HeldOut, EmError>> =
            (0..N_FOLDS).into_par_iter().map(|fold| self.held_out(fold, n_kinds, tally)).collect();
        let folds = folds.into_iter().collect::<Result<Vec<HeldOut>, EmError>>()?;
        let held_out: f64 = folds.iter().map(|fold| fold.log_likelihood).sum();
        let all = all?;
        let log_likelihood = all.log_likelihood();
        let (n, n_effective) = (self.points.n() as f64, self.n_frames_effective);
        let n_parameters = self.plan.covariance.n_parameters(n_kinds, self.points.n_dims) as f64;
        Ok(KindsTrial {
            n_kinds,
            log_likelihood,
            bic: -2.0 * log_likelihood + n_parameters * n.ln(),
            caic: -2.0 * log_likelihood + n_parameters * (n.ln() + 1.0),
            bic_neff: bic_neff(log_likelihood, n_parameters, n, n_effective),
            held_out: held_out / n,
            n_starts_collapsed: all.n_starts_collapsed
                + folds.iter().map(|fold| fold.n_starts_collapsed).sum::<usize>(),
        })
    }

    fn fit(&self, points: Points, n_kinds: usize, plan: &EmPlan, tally: &Tally) -> Result<EmFit, EmError> {
        let fit = fit_points(points, n_kinds, plan, self.floor, &Tally::new(&mut |_| ()));
        tally.add();
        fit
    }

    /// A fold's frames under a mixture fitted to the others.
    fn held_out(&self, fold: usize, n_kinds: usize, tally: &Tally) -> Result<HeldOut, EmError> {
        let Points { n_dims, coordinates } = self.points;
        let n_frames = self.points.n();
        let (mut kept, mut out) = (Vec::with_capacity(coordinates.len()), Vec::new());
        for (index, place) in coordinates.chunks_exact(n_dims).enumerate() {
            let block = index * N_BLOCKS.min(n_frames) / n_frames;
            if block % N_FOLDS == fold { out.extend_from_slice(place) } else { kept.extend_from_slice(place) }
        }
        let fit = self.fit(Points { n_dims, coordinates: &kept }, n_kinds, &self.quick, tally)?;
        let mut probabilities = vec![0.0; n_kinds];
        let log_likelihood =
            out.chunks_exact(n_dims).map(|place| fit.mixture.posterior(place, &mut probabilities)).sum();
        Ok(HeldOut { log_likelihood, n_starts_collapsed: fit.n_starts_collapsed })
    }
}

/// Schwarz' criterion for as many frames as are independent, nats.
///
/// * `log_likelihood` — of all frames
/// * `n` — frames, of which `n_effective` are as good as independent
pub(crate) fn bic_neff(log_likelihood: f64, n_parameters: f64, n: f64, n_effective: f64) -> f64 {
    -2.0 * n_effective / n * log_likelihood + n_parameters * n_effective.ln()
}

/// What came of holding out a fold.
struct HeldOut {
    /// ln likelihood of its frames, nats.
    log_likelihood: f64,
    n_starts_collapsed: usize,
}
