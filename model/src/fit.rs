//! Fits a model to the frames of a trip: response, neighbours, graph, geodesics, scaling, mixture, in this order.

use rayon::prelude::*;

use crate::array::Array;
use crate::autocorrelation::n_frames_effective;
use crate::em::{EmError, EmFit, fit_mixture};
use crate::evidence::{N_FITS, best_by_bic_neff, try_kinds};
use crate::frames::Frames;
use crate::geodesics::Geodesics;
use crate::graph::Graph;
use crate::intrinsic_dims::{IntrinsicDims, N_NEIGHBORS_USED};
use crate::landmarks;
use crate::lengths::Lengths;
use crate::mds::{Embedding, MdsError};
use crate::model::{Manifest, Model, ModelId, N_DIMS_MAX, N_KINDS_MAX, Origin, Provenance};
use crate::neighborhood::{N_NEIGHBORS_TRIED_MAX, N_NEIGHBORS_USUAL, chosen, try_neighbors};
use crate::neighbors::{NeighborLists, nearest_of_each, squared_distance};
use crate::plan::{FitPlan, Method};
use crate::residual_variance::{
    N_DIMS_BEYOND_ELBOW, N_DIMS_REPORTED, elbow, fewest_within_tolerance, residual_variance,
};
use crate::response::{Response, ResponseError};

/// A part of the work, for whoever shows progress.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Step {
    /// Nearest neighbours of every frame.
    Neighbors,
    /// Graphs of more and more neighbours, for their number.
    Neighborhood,
    /// Geodesics from every landmark.
    Geodesics,
    /// Eigenvalues of the landmarks' products, coordinates of all frames.
    Embedding,
    /// Expectation and maximisation.
    Kinds,
}

/// Told of a step, how much of it is done, and of how much.
///
/// One thread at a time, but not always the same one.
pub type Progress<'a> = dyn FnMut(Step, usize, usize) + Send + 'a;

/// How many neighbours, dimensions and kinds a model is refitted with.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Size {
    /// As many as the model has: for a fair comparison.
    Matched,
    /// As many as the model's plan asked for, or where it left that to the evidence, as this speaks for.
    Own,
}

/// Why no model could be fitted.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum FitError {
    /// Too few frames for the neighbours.
    #[error(
        "{n_frames} frames are too few for {n_neighbors} neighbours each; ask for fewer neighbours or record a longer trip"
    )]
    TooFewFrames {
        /// Frames.
        n_frames: usize,
        /// Neighbours asked for.
        n_neighbors: usize,
    },
    /// Something that must be at least one, or has a limit.
    #[error("{n} {what} were asked for; there must be between 1 and {limit}")]
    Count {
        /// What, in words.
        what: &'static str,
        /// How many.
        n: usize,
        /// How many at most.
        limit: usize,
    },
    /// Nothing to tell frames apart by.
    #[error("all {n_frames} frames are equal on the response's scale; there is nothing to tell kinds by")]
    AllEqual {
        /// Frames.
        n_frames: usize,
    },
    /// No scale.
    #[error(transparent)]
    Response(#[from] ResponseError),
    /// No coordinates.
    #[error(transparent)]
    Mds(#[from] MdsError),
    /// No kinds.
    #[error(transparent)]
    Em(#[from] EmError),
}

/// Fits a model to raw frames.
///
/// * `counts` — raw counts, shape `(n_frames, n_readings)`; frames without a valid reading should not be among them
/// * `origin` — where the frames came from, for the record
///
/// Deterministic for a plan on one machine. Holds the frames, the geodesics (n_frames × n_landmarks) and a few
/// n_landmarks² matrices.
///
/// # Errors
/// If the frames are too few or too much alike for the plan, or the plan asks for what there cannot be.
pub fn fit(
    mut counts: Vec<u16>,
    plan: &FitPlan,
    origin: Origin,
    progress: &mut Progress,
) -> Result<Model, FitError> {
    let response = Response::new(&plan.response, plan.sensor.metres_per_count)?;
    response.map_in_place(&mut counts);
    let frames = Frames::new(plan.sensor.n_readings(), counts);
    fit_frames(frames, response, plan, origin, progress)
}

/// Fits a model by a method to the reference frames of another, with all else but the size as that one's plan has it.
///
/// # Errors
/// As [`fit`].
pub fn refit(model: &Model, method: Method, size: Size, progress: &mut Progress) -> Result<Model, FitError> {
    let Manifest { plan, n_neighbors, n_dims, n_kinds, provenance, .. } = model.manifest();
    let (n_neighbors, n_dims, n_kinds) = match size {
        Size::Matched => (Some(*n_neighbors), Some(*n_dims), Some(*n_kinds)),
        Size::Own => (plan.n_neighbors, plan.n_dims, plan.n_kinds),
    };
    let plan = FitPlan { method, n_neighbors, n_dims, n_kinds, ..plan.clone() };
    let origin = provenance.origin.clone();
    fit_frames(model.frames().clone(), model.response().clone(), &plan, origin, progress)
}

fn fit_frames(
    frames: Frames,
    response: Response,
    plan: &FitPlan,
    origin: Origin,
    progress: &mut Progress,
) -> Result<Model, FitError> {
    let n_frames = frames.n_frames();
    check_counts(plan, n_frames)?;
    // As many as anything asks for: those beyond ns cost next to nothing.
    let n_listed = plan.n_neighbors.unwrap_or(N_NEIGHBORS_TRIED_MAX).max(N_NEIGHBORS_USED).min(n_frames - 1);
    let lists = nearest_of_each(&frames, n_listed, &mut |done| progress(Step::Neighbors, done, n_frames));
    let landmarks = landmarks::choose(&frames, plan.n_landmarks, plan.landmark_choice, plan.seed);
    let mut provenance = Provenance {
        made_by: format!("natural-kinds {}", env!("CARGO_PKG_VERSION")),
        origin,
        intrinsic_dims: IntrinsicDims::estimate(&lists),
        ..Default::default()
    };
    let n_neighbors = find_neighbors(&frames, &lists, &landmarks, plan, &mut provenance, progress);

    let lengths = match plan.method {
        Method::Isomap => Lengths::Geodesic(measure_geodesics(
            &frames,
            &lists,
            n_neighbors,
            &landmarks,
            &mut provenance,
            progress,
        )),
        Method::Pca => Lengths::euclidean(&frames, &landmarks),
    };
    progress(Step::Embedding, 0, 1);
    let (embedding, coordinates) = embed(&lengths, &landmarks, plan, &mut provenance)?;
    progress(Step::Embedding, 1, 1);
    let em = find_kinds(&coordinates, embedding.n_dims(), plan, &mut provenance, progress)?;

    let mut squared_radii: Vec<u64> =
        lists.nearest(n_neighbors).map(|list| list[n_neighbors - 1].squared_distance).collect();
    squared_radii.sort_unstable();
    let plan = FitPlan { n_landmarks: landmarks.len(), ..plan.clone() };
    let (n_dims, n_kinds) = (embedding.n_dims(), em.mixture.n_kinds());
    let format = crate::file::FORMAT;
    let manifest = Manifest { format, plan, n_frames, n_neighbors, n_dims, n_kinds, provenance };
    let mut model = Model {
        id: ModelId([0; 16]),
        manifest,
        response,
        frames,
        landmarks: landmarks.into(),
        geodesics: lengths.into_geodesics(),
        embedding,
        coordinates,
        mixture: em.mixture,
        squared_radii: squared_radii.into(),
    };
    model.id = crate::file::id_of(&model);
    Ok(model)
}

fn check_counts(plan: &FitPlan, n_frames: usize) -> Result<(), FitError> {
    let within = |what, n: usize, limit: usize| match (1..=limit).contains(&n) {
        true => Ok(()),
        false => Err(FitError::Count { what, n, limit }),
    };
    // What is left to the evidence is asked for as little as can be.
    let n_kinds = plan.n_kinds.unwrap_or(1);
    within("kinds", n_kinds, N_KINDS_MAX)?;
    within("dimensions", plan.n_dims.unwrap_or(1), N_DIMS_MAX)?;
    let n_neighbors = plan.n_neighbors.unwrap_or(1);
    within("neighbours", n_neighbors, usize::MAX)?;
    within("landmarks", plan.n_landmarks, usize::MAX)?;
    within("starts of the mixture", plan.em.n_starts, usize::MAX)?;
    if n_frames <= n_neighbors {
        return Err(FitError::TooFewFrames { n_frames, n_neighbors });
    }
    if n_frames < n_kinds {
        return Err(EmError::TooFewFrames { n_frames, n_kinds }.into());
    }
    Ok(())
}

/// The number of neighbours that the plan asks for or the evidence speaks for.
fn find_neighbors(
    frames: &Frames,
    lists: &NeighborLists,
    landmarks: &[u32],
    plan: &FitPlan,
    provenance: &mut Provenance,
    progress: &mut Progress,
) -> usize {
    match (plan.n_neighbors, plan.method) {
        (Some(n_neighbors), _) => n_neighbors,
        // There is no graph; the distance of a new frame to the nearest is judged by that of reference frames to so many.
        (None, Method::Pca) => N_NEIGHBORS_USUAL.min(lists.k()),
        (None, Method::Isomap) => {
            let mut done = |n_done, n_tried| progress(Step::Neighborhood, n_done, n_tried);
            provenance.neighbors_tried = try_neighbors(frames, lists, landmarks, plan.n_dims, &mut done);
            chosen(&provenance.neighbors_tried).expect("one number is tried at least").n_neighbors
        }
    }
}

fn measure_geodesics(
    frames: &Frames,
    lists: &NeighborLists,
    n_neighbors: usize,
    landmarks: &[u32],
    provenance: &mut Provenance,
    progress: &mut Progress,
) -> Geodesics {
    let mut graph = Graph::union(lists, n_neighbors);
    provenance.islands = graph.islands().iter().map(Vec::len).collect();
    let between = |a: u32, b: u32| squared_distance(frames.row(a as usize), frames.row(b as usize));
    provenance.bridges =
        graph.join_islands(between).iter().map(|bridge| (bridge.a, bridge.b, bridge.length)).collect();
    Geodesics::measure(&graph, landmarks, &mut |done| progress(Step::Geodesics, done, landmarks.len()))
}

/// Scales the landmarks and embeds every frame. Returns the embedding, and coordinates of shape `(n_frames, n_dims)`.
fn embed(
    lengths: &Lengths,
    landmarks: &[u32],
    plan: &FitPlan,
    provenance: &mut Provenance,
) -> Result<(Embedding, Array<f64>), FitError> {
    let (n_frames, n_landmarks) = (lengths.n_frames(), landmarks.len());
    let between = |i: usize, j: usize| lengths.squared(landmarks[i] as usize, j);
    // Where all are at the first one's place, all are at one place.
    if (0..n_landmarks).all(|lane| between(0, lane) == 0.0) {
        return Err(FitError::AllEqual { n_frames });
    }
    let n_dims_max = plan.n_dims.unwrap_or(0).max(N_DIMS_REPORTED);
    let (embedding, spectrum) = Embedding::fit(n_landmarks, between, n_dims_max, plan.n_dims.unwrap_or(1))?;
    provenance.negative_share = spectrum.negative_share;
    provenance.eigenvalues = spectrum.eigenvalues.iter().take(n_dims_max).copied().collect();

    let mut coordinates = vec![0.0; n_frames * embedding.n_dims()];
    coordinates.par_chunks_exact_mut(embedding.n_dims()).enumerate().for_each_init(
        || vec![0.0; n_landmarks],
        |delta, (frame_index, place)| {
            lengths.squared_row(frame_index, delta);
            embedding.embed(delta, place);
        },
    );
    let length = |frame_index, lane| lengths.length(frame_index, lane);
    provenance.residual_variance = residual_variance(&coordinates, embedding.n_dims(), landmarks, length);

    let curve = &provenance.residual_variance;
    provenance.elbow = elbow(&curve[..curve.len().min(N_DIMS_REPORTED)]);
    provenance.n_dims_within_tolerance = fewest_within_tolerance(curve);
    let n_dims = plan.n_dims.unwrap_or((provenance.elbow + N_DIMS_BEYOND_ELBOW).min(embedding.n_dims()));
    let kept: Vec<f64> =
        coordinates.chunks_exact(embedding.n_dims()).flat_map(|place| &place[..n_dims]).copied().collect();
    Ok((embedding.truncated(n_dims), kept.into()))
}

/// Fits the mixture, of as many kinds as the plan asks for or the evidence speaks for.
fn find_kinds(
    coordinates: &[f64],
    n_dims: usize,
    plan: &FitPlan,
    provenance: &mut Provenance,
    progress: &mut Progress,
) -> Result<EmFit, FitError> {
    let n_frames = coordinates.len() / n_dims;
    let one = [n_frames];
    let trips = if provenance.origin.n_frames.is_empty() { &one[..] } else { &provenance.origin.n_frames };
    provenance.n_frames_effective = n_frames_effective(coordinates, n_dims, trips);

    let n_tried = if plan.n_kinds.is_none() { N_FITS } else { 0 };
    let n_fits = n_tried + plan.em.n_starts;
    progress(Step::Kinds, 0, n_fits);
    let n_kinds = match plan.n_kinds {
        Some(n_kinds) => n_kinds,
        None => {
            let mut done = |n_done| progress(Step::Kinds, n_done, n_fits);
            let trials = try_kinds(coordinates, n_dims, provenance.n_frames_effective, &plan.em, &mut done)?;
            provenance.kinds_tried = trials;
            best_by_bic_neff(&provenance.kinds_tried).expect("one kind is tried at least").n_kinds
        }
    };
    let mut done = |n_done| progress(Step::Kinds, n_tried + n_done, n_fits);
    let em = fit_mixture(coordinates, n_dims, n_kinds, &plan.em, &mut done)?;
    provenance.log_likelihood = em.log_likelihoods[em.log_likelihoods.len() - 1];
    provenance.bic = -2.0 * provenance.log_likelihood
        + plan.em.covariance.n_parameters(n_kinds, n_dims) as f64 * (n_frames as f64).ln();
    provenance.n_iterations = em.log_likelihoods.len() - 1;
    provenance.converged = em.converged;
    provenance.n_starts_collapsed = em.n_starts_collapsed;
    Ok(em)
}
