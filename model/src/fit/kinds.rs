//! The last step of fitting: how many kinds there are, and the mixture of so many.

use super::{FitError, Progress, Step};
use crate::autocorrelation::n_frames_effective;
use crate::em::dirichlet::{CONCENTRATION, DirichletFit, fit_dirichlet, likeliest};
use crate::em::fit_mixture;
use crate::evidence::{
    N_FITS, N_KINDS_TRIED_MAX, best_by_bic_neff, best_by_held_out, of_at_least, try_kinds,
};
use crate::hierarchy::{self, Merge};
use crate::mixture::{Mixture, most_probable};
use crate::model::{DirichletProvenance, DirichletTrial, Provenance};
use crate::persistence;
use crate::plan::{FitPlan, KindsBy};

/// The kinds, and what of them is learnt from the trained frames.
pub(super) struct Kinds {
    pub(super) mixture: Mixture,
    pub(super) persistence: f64,
    pub(super) merges: Vec<Merge>,
}

/// Fits the mixture, of as many kinds as the plan asks for or the evidence speaks for, and learns how persistent they are and
/// which are most alike.
pub(super) fn find_kinds(
    coordinates: &[f64],
    n_dims: usize,
    plan: &FitPlan,
    provenance: &mut Provenance,
    progress: &mut Progress,
) -> Result<Kinds, FitError> {
    let n_trained = coordinates.len() / n_dims;
    let trips = provenance.origin.trips(n_trained);
    provenance.n_frames_effective = n_frames_effective(coordinates, n_dims, &trips);
    let mixture = match (plan.n_kinds, plan.kinds_by) {
        (None, KindsBy::Dirichlet) => find_by_dirichlet(coordinates, n_dims, plan, provenance, progress)?,
        _ => find_by_em(coordinates, n_dims, plan, provenance, progress)?,
    };
    let n_parameters = plan.em.covariance.n_parameters(mixture.n_kinds(), n_dims) as f64;
    provenance.bic = -2.0 * provenance.log_likelihood + n_parameters * (n_trained as f64).ln();
    let posteriors = posteriors(&mixture, coordinates);
    provenance.largest_kind_share = largest_kind_share(&posteriors, mixture.n_kinds());
    let persistence = persistence::learn(&posteriors, mixture.weights(), &trips);
    let merges = hierarchy::learn(&posteriors, mixture.n_kinds());
    Ok(Kinds { mixture, persistence, merges })
}

fn find_by_em(
    coordinates: &[f64],
    n_dims: usize,
    plan: &FitPlan,
    provenance: &mut Provenance,
    progress: &mut Progress,
) -> Result<Mixture, FitError> {
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
    let em = fit_mixture(coordinates, n_dims, n_kinds, &plan.em, &mut done)?;
    provenance.log_likelihood = em.log_likelihood();
    provenance.n_iterations = em.log_likelihoods.len() - 1;
    provenance.converged = em.converged;
    provenance.n_starts_collapsed = em.n_starts_collapsed;
    Ok(em.mixture)
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
    let mut probabilities = vec![0.0; fit.mixture.n_kinds()];
    let places = coordinates.chunks_exact(n_dims);
    provenance.log_likelihood = places.map(|place| fit.mixture.posterior(place, &mut probabilities)).sum();
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
