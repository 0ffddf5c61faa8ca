//! The last step of fitting: how many kinds there are, and the mixture of so many.

use super::{FitError, Progress, Step};
use crate::autocorrelation::n_frames_effective;
use crate::em::dirichlet::{CONCENTRATION, DirichletFit, fit_dirichlet, likeliest};
use crate::em::{EmError, EmFit, Points, fit_from_known, fit_mixture, fit_over_time};
use crate::evidence::{
    N_FITS, N_KINDS_TRIED_MAX, best_by_bic_neff, best_by_held_out, bic_neff, of_at_least, try_kinds,
};
use crate::hierarchy::{self, Merge};
use crate::mixture::{Mixture, most_probable};
use crate::model::{DirichletProvenance, DirichletTrial, N_KINDS_MAX, Provenance};
use crate::persistence;
use crate::plan::{FitPlan, KindsBy};

/// The kinds, and what of them is learnt from the trained frames.
pub(super) struct Kinds {
    pub(super) mixture: Mixture,
    pub(super) persistence: f64,
    pub(super) merges: Vec<Merge>,
}

/// What is known of the kinds of frames before any are looked for.
pub(super) struct Known {
    pub(super) n_kinds: usize,
    /// Shape `(n_trained, n_kinds)`; zeros of frames that are of none of these.
    pub(super) probabilities: Vec<f64>,
}

/// Most kinds that are added to known ones at once.
const N_NEW_MAX: usize = 4;

/// Fits the mixture, of as many kinds as the plan asks for or the evidence speaks for, and learns how persistent they are and
/// which are most alike.
///
/// Known kinds stay, unless they lose their frames or the plan asks for another number; where it leaves that to the evidence, frames
/// that are of none of them may make some more.
pub(super) fn find_kinds(
    coordinates: &[f64],
    n_dims: usize,
    plan: &FitPlan,
    known: Option<&Known>,
    provenance: &mut Provenance,
    progress: &mut Progress,
) -> Result<Kinds, FitError> {
    let n_trained = coordinates.len() / n_dims;
    let trips = provenance.origin.trips(n_trained);
    provenance.n_frames_effective = n_frames_effective(coordinates, n_dims, &trips);
    let points = Points { n_dims, coordinates };
    let kept = known.map(|known| keep(points, known, plan, provenance)).transpose()?.flatten();
    let mixture = match (kept, plan.n_kinds, plan.kinds_by) {
        (Some(kept), ..) => settle(kept, points, plan, provenance)?,
        (None, None, KindsBy::Dirichlet) => {
            find_by_dirichlet(coordinates, n_dims, plan, provenance, progress)?
        }
        _ => {
            let found = find_by_em(coordinates, n_dims, plan, provenance, progress)?;
            settle(found, points, plan, provenance)?
        }
    };
    let n_parameters = plan.em.covariance.n_parameters(mixture.n_kinds(), n_dims) as f64;
    provenance.bic = -2.0 * provenance.log_likelihood + n_parameters * (n_trained as f64).ln();
    let posteriors = posteriors(&mixture, coordinates);
    provenance.largest_kind_share = largest_kind_share(&posteriors, mixture.n_kinds());
    let persistence = persistence::learn(&posteriors, mixture.weights(), &trips);
    let merges = hierarchy::learn(&posteriors, mixture.n_kinds());
    Ok(Kinds { mixture, persistence, merges })
}

/// Known kinds fitted to the frames, and as many new ones beside them as the evidence speaks for. None if the plan asks for another
/// number, or a kind loses its frames.
fn keep(
    points: Points,
    known: &Known,
    plan: &FitPlan,
    provenance: &Provenance,
) -> Result<Option<EmFit>, EmError> {
    let n_new_max = match plan.n_kinds {
        None => N_NEW_MAX.min(N_KINDS_MAX.saturating_sub(known.n_kinds)),
        Some(n_kinds) if n_kinds == known.n_kinds => 0,
        Some(_) => return Ok(None),
    };
    let evidence = |fit: &EmFit| {
        let n_parameters = plan.em.covariance.n_parameters(fit.mixture.n_kinds(), points.n_dims) as f64;
        bic_neff(fit.log_likelihood(), n_parameters, points.n() as f64, provenance.n_frames_effective)
    };
    let fit = |n_new| fit_from_known(points, &known.probabilities, known.n_kinds, n_new, &plan.em);
    let fits: Vec<EmFit> =
        (0..=n_new_max).filter_map(|n_new| fit(n_new).transpose()).collect::<Result<_, _>>()?;
    Ok(fits.into_iter().min_by(|a, b| evidence(a).total_cmp(&evidence(b))))
}

fn find_by_em(
    coordinates: &[f64],
    n_dims: usize,
    plan: &FitPlan,
    provenance: &mut Provenance,
    progress: &mut Progress,
) -> Result<EmFit, FitError> {
    let n_tried = if plan.n_kinds.is_none() { N_FITS } else { 0 };
    let n_fits = n_tried + plan.em.n_starts;
    progress(Step::Kinds, 0, n_fits);
    let n_kinds = match plan.n_kinds {
        Some(n_kinds) => n_kinds,
        None => {
            let mut done = |n_done| progress(Step::Kinds, n_done, n_fits);
            let trials = try_kinds(coordinates, n_dims, provenance.n_frames_effective, &plan.em, &mut done)?;
            provenance.kinds_tried = trials;
            let enough = of_at_least(&provenance.kinds_tried, plan.n_kinds_min);
            let best = match plan.kinds_by {
                KindsBy::HeldOut => best_by_held_out(enough),
                _ => best_by_bic_neff(enough),
            };
            best.expect("one kind is tried at least").n_kinds
        }
    };
    let mut done = |n_done| progress(Step::Kinds, n_tried + n_done, n_fits);
    Ok(fit_mixture(coordinates, n_dims, n_kinds, &plan.em, &mut done)?)
}

/// The mixture of a fit, over time if the plan asks for that, and how it came about.
fn settle(
    em: EmFit,
    points: Points,
    plan: &FitPlan,
    provenance: &mut Provenance,
) -> Result<Mixture, FitError> {
    provenance.log_likelihood = em.log_likelihood();
    provenance.n_iterations = em.log_likelihoods.len() - 1;
    provenance.converged = em.converged;
    provenance.n_starts_collapsed = em.n_starts_collapsed;
    if !plan.em.over_time {
        return Ok(em.mixture);
    }
    let trips = provenance.origin.trips(points.n());
    let over_time = fit_over_time(points.coordinates, em.mixture, &trips, &plan.em)?;
    provenance.log_likelihood = log_likelihood(&over_time.mixture, points.coordinates);
    provenance.n_iterations += over_time.log_likelihoods.len() - 1;
    provenance.converged = over_time.converged;
    Ok(over_time.mixture)
}

/// Of all frames, whatever their order.
fn log_likelihood(mixture: &Mixture, coordinates: &[f64]) -> f64 {
    let mut probabilities = vec![0.0; mixture.n_kinds()];
    coordinates.chunks_exact(mixture.n_dims()).map(|place| mixture.posterior(place, &mut probabilities)).sum()
}

fn find_by_dirichlet(
    coordinates: &[f64],
    n_dims: usize,
    plan: &FitPlan,
    provenance: &mut Provenance,
    progress: &mut Progress,
) -> Result<Mixture, FitError> {
    let n_starts = N_KINDS_TRIED_MAX.min(coordinates.len() / n_dims);
    progress(Step::Kinds, 0, n_starts);
    let mut done = |n_done| progress(Step::Kinds, n_done, n_starts);
    let fits = fit_dirichlet(coordinates, n_dims, provenance.n_frames_effective, &plan.em, &mut done)?;
    let trial = |(index, fit): (usize, &DirichletFit)| DirichletTrial {
        n_kinds_begun: index + 1,
        n_kinds: fit.mixture.n_kinds(),
        lower_bound: fit.lower_bound(),
    };
    let trials = fits.iter().enumerate().map(trial).collect();
    let fit = likeliest(fits).expect("one kind is tried at least");
    provenance.n_iterations = fit.lower_bounds.len() - 1;
    provenance.converged = fit.converged;
    provenance.log_likelihood = log_likelihood(&fit.mixture, coordinates);
    let n_frames_of_kinds = fit.n_frames_of_kinds;
    provenance.dirichlet =
        Some(DirichletProvenance { concentration: CONCENTRATION, n_frames_of_kinds, trials });
    Ok(fit.mixture)
}

/// Of every frame, shape `(n_frames, n_kinds)`.
pub(super) fn posteriors(mixture: &Mixture, coordinates: &[f64]) -> Vec<f64> {
    let n_kinds = mixture.n_kinds();
    let places = coordinates.chunks_exact(mixture.n_dims());
    let mut posteriors = vec![0.0; places.len() * n_kinds];
    for (place, posterior) in places.zip(posteriors.chunks_exact_mut(n_kinds)) {
        mixture.posterior(place, posterior);
    }
    posteriors
}

/// Share of the frames that are most probably of the kind which most are of.
fn largest_kind_share(posteriors: &[f64], n_kinds: usize) -> f64 {
    let frames = posteriors.chunks_exact(n_kinds);
    let (n_frames, mut n_frames_of) = (frames.len(), vec![0_usize; n_kinds]);
    frames.for_each(|posterior| n_frames_of[most_probable(posterior)] += 1);
    n_frames_of.into_iter().max().unwrap_or(0) as f64 / n_frames as f64
}
