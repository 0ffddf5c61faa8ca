//! Fits a model to the frames of a trip: response, neighbours, graph, geodesics, scaling, mixture, in this order.

use rayon::prelude::*;

use crate::array::Array;
use crate::autocorrelation::n_frames_effective;
use crate::command::{CommandScale, Commands, mean_squared_distance, with_metric};
use crate::em::{EmError, EmFit, fit_mixture};
use crate::evidence::{N_FITS, best_by_bic_neff, try_kinds};
use crate::frames::Frames;
use crate::geodesics::Geodesics;
use crate::graph::Graph;
use crate::intrinsic_dims::{IntrinsicDims, N_NEIGHBORS_USED};
use crate::landmarks;
use crate::lengths::Lengths;
use crate::mds::{Embedding, MdsError};
use crate::metric::{Metric, MetricError, MetricPlan};
use crate::mixture::{Mixture, most_probable};
use crate::model::{Manifest, Model, ModelId, N_DIMS_MAX, N_KINDS_MAX, Origin, Provenance};
use crate::neighborhood::{N_NEIGHBORS_TRIED_MAX, N_NEIGHBORS_USUAL, chosen, try_neighbors};
use crate::neighbors::{NeighborLists, nearest_of_each};
use crate::plan::{FitPlan, LandmarkChoice, Method};
use crate::residual_variance::{
    N_DIMS_BEYOND_ELBOW, N_DIMS_REPORTED, elbow, fewest_within_tolerance, residual_variance,
};
use crate::response::{Response, ResponseError};

/// Most readings that can be coordinates as they are.
const N_READINGS_NATIVE_MAX: usize = N_DIMS_MAX;

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
    /// As many kinds as the model has, neighbours as its plan asked for, and dimensions by evidence.
    SameKinds,
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
    /// Landmarks by means where there are none.
    #[error(
        "landmarks by k-means need means of frames, and frames that are compared at their nearest turn have none; choose \
         random landmarks or the farthest"
    )]
    NoMeans,
    /// Too many readings for a mixture over them.
    #[error(
        "native space is for sensors of at most {limit} readings and this one has {n_readings}: the full covariance of one kind \
         would have {n_readings}·{}/2 = {} parameters, and there are {n_frames} frames; use isomap",
        n_readings + 1,
        n_readings * (n_readings + 1) / 2
    )]
    NativeReadings {
        /// D.
        n_readings: usize,
        /// How many at most.
        limit: usize,
        /// Frames.
        n_frames: usize,
    },
    /// Another number of dimensions than readings.
    #[error(
        "native space has a dimension for each of the {n_readings} readings and {n_dims} were asked for; ask for no number, or use \
         isomap"
    )]
    NativeDims {
        /// D.
        n_readings: usize,
        /// Dimensions asked for.
        n_dims: usize,
    },
    /// A metric that would not be asked.
    #[error(
        "native space has no distances, so that kinds would not follow the metric: {metric}; use isomap or the euclidean metric"
    )]
    NativeMetric {
        /// The metric in words.
        metric: String,
    },
    /// Commands where there are no distances to weigh them by.
    #[error(
        "native space has no distances, so that kinds would not follow commands of weight {weight}; use isomap or pca, or a \
         commands weight of 0"
    )]
    NativeCommands {
        /// What was asked for.
        weight: f64,
    },
    /// No distances.
    #[error(transparent)]
    Metric(#[from] MetricError),
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
    fit_frames(frames, response, None, plan, origin, progress)
}

/// Fits a model to raw frames and what the robot had been told when it took each.
///
/// See [`fit`] for all else.
///
/// # Errors
/// As [`fit`].
///
/// # Panics
/// If there are more or fewer commands than frames: a bug of the caller.
pub fn fit_with_commands(
    mut counts: Vec<u16>,
    commands: &Commands,
    plan: &FitPlan,
    origin: Origin,
    progress: &mut Progress,
) -> Result<Model, FitError> {
    if plan.method == Method::Native {
        return Err(FitError::NativeCommands { weight: commands.weight });
    }
    let n_readings = plan.sensor.n_readings();
    assert_eq!(commands.of_frames.len() * n_readings, counts.len(), "a command for each frame");
    let response = Response::new(&plan.response, plan.sensor.metres_per_count)?;
    response.map_in_place(&mut counts);
    let metric = plan.metric.compile(plan.sensor)?;
    let of_readings =
        with_metric!(&metric, None, |metric| mean_squared_distance(&counts, n_readings, metric));
    let scale = CommandScale::new(commands, of_readings);
    let frames = scale.append(counts, n_readings, &commands.of_frames);
    fit_frames(frames, response, Some(scale), plan, origin, progress)
}

/// Fits a model by a method to the reference frames of another, with all else but the size as that one's plan has it.
///
/// # Errors
/// As [`fit`].
pub fn refit(model: &Model, method: Method, size: Size, progress: &mut Progress) -> Result<Model, FitError> {
    let Manifest { plan, commands, n_neighbors, n_dims, n_kinds, provenance, .. } = model.manifest();
    let (n_neighbors, n_dims, n_kinds) = match size {
        Size::Matched => (Some(*n_neighbors), Some(*n_dims), Some(*n_kinds)),
        Size::SameKinds => (plan.n_neighbors, None, Some(*n_kinds)),
        Size::Own => (plan.n_neighbors, plan.n_dims, plan.n_kinds),
    };
    let plan = FitPlan { method, n_neighbors, n_dims, n_kinds, ..plan.clone() };
    let origin = provenance.origin.clone();
    fit_frames(model.frames().clone(), model.response().clone(), *commands, &plan, origin, progress)
}

fn fit_frames(
    frames: Frames,
    response: Response,
    commands: Option<CommandScale>,
    plan: &FitPlan,
    origin: Origin,
    progress: &mut Progress,
) -> Result<Model, FitError> {
    let n_frames = frames.n_frames();
    check_counts(plan, n_frames)?;
    let metric = plan.metric.compile(plan.sensor)?;
    let mut provenance = Provenance {
        made_by: format!("natural-kinds {}", env!("CARGO_PKG_VERSION")),
        origin,
        ..Default::default()
    };
    let located = with_metric!(&metric, commands.as_ref(), |metric| {
        Located::by(metric, &frames, plan, &mut provenance, progress)
    });
    let Located { n_neighbors, landmarks, geodesics, embedding, coordinates, squared_radii } = located?;
    let n_dims = coordinates.len() / n_frames;
    let em = find_kinds(&coordinates, n_dims, plan, &mut provenance, progress)?;

    let plan = FitPlan { n_landmarks: plan.n_landmarks.min(n_frames), ..plan.clone() };
    let n_kinds = em.mixture.n_kinds();
    let format = crate::file::FORMAT;
    let manifest = Manifest { format, plan, commands, n_frames, n_neighbors, n_dims, n_kinds, provenance };
    let mut model = Model {
        id: ModelId([0; 16]),
        manifest,
        response,
        metric,
        frames,
        landmarks: landmarks.into(),
        geodesics,
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
    if plan.method == Method::Native {
        return check_native(plan, n_frames);
    }
    match (&plan.metric, plan.landmark_choice) {
        (MetricPlan::Ring { .. }, LandmarkChoice::KMeans) if plan.n_landmarks < n_frames => {
            Err(FitError::NoMeans)
        }
        _ => Ok(()),
    }
}

fn check_native(plan: &FitPlan, n_frames: usize) -> Result<(), FitError> {
    let n_readings = plan.sensor.n_readings();
    if n_readings > N_READINGS_NATIVE_MAX {
        return Err(FitError::NativeReadings { n_readings, limit: N_READINGS_NATIVE_MAX, n_frames });
    }
    if let Some(n_dims) = plan.n_dims.filter(|n_dims| *n_dims != n_readings) {
        return Err(FitError::NativeDims { n_readings, n_dims });
    }
    match plan.metric {
        MetricPlan::Euclidean => Ok(()),
        _ => Err(FitError::NativeMetric { metric: plan.metric.to_string() }),
    }
}

/// All that follows from how far apart frames are.
struct Located {
    n_neighbors: usize,
    /// None in native space.
    landmarks: Vec<u32>,
    /// Only by Isomap.
    geodesics: Option<Geodesics>,
    /// None in native space.
    embedding: Option<Embedding>,
    /// Shape `(n_frames, n_dims)`, counts.
    coordinates: Array<f64>,
    /// Ascending, counts².
    squared_radii: Vec<u64>,
}

impl Located {
    /// By a metric, for which its loops are compiled.
    fn by(
        metric: &impl Metric,
        frames: &Frames,
        plan: &FitPlan,
        provenance: &mut Provenance,
        progress: &mut Progress,
    ) -> Result<Self, FitError> {
        let n_frames = frames.n_frames();
        // As many as anything asks for: those beyond ns cost next to nothing.
        let n_listed =
            plan.n_neighbors.unwrap_or(N_NEIGHBORS_TRIED_MAX).max(N_NEIGHBORS_USED).min(n_frames - 1);
        let mut done = |n_done| progress(Step::Neighbors, n_done, n_frames);
        let lists = nearest_of_each(frames, metric, n_listed, &mut done);
        let landmarks = match plan.method {
            Method::Native => Vec::new(),
            _ => landmarks::choose(frames, metric, plan.n_landmarks, plan.landmark_choice, plan.seed),
        };
        provenance.intrinsic_dims = IntrinsicDims::estimate(&lists);
        let n_neighbors = find_neighbors(frames, metric, &lists, &landmarks, plan, provenance, progress);
        let lengths = match plan.method {
            Method::Isomap => {
                let graph = join(frames, metric, &lists, n_neighbors, provenance);
                let mut done = |n_done| progress(Step::Geodesics, n_done, landmarks.len());
                Some(Lengths::Geodesic(Geodesics::measure(&graph, &landmarks, &mut done)))
            }
            Method::Pca => Some(Lengths::straight(frames, metric, &landmarks)),
            Method::Native => None,
        };
        let (embedding, coordinates) = match &lengths {
            Some(lengths) => {
                progress(Step::Embedding, 0, 1);
                let (embedding, coordinates) = embed(lengths, &landmarks, plan, provenance)?;
                progress(Step::Embedding, 1, 1);
                (Some(embedding), coordinates)
            }
            None => (None, as_they_are(frames)?),
        };
        let geodesics = lengths.and_then(Lengths::into_geodesics);
        let mut squared_radii: Vec<u64> =
            lists.nearest(n_neighbors).map(|list| list[n_neighbors - 1].squared_distance).collect();
        squared_radii.sort_unstable();
        Ok(Self { n_neighbors, landmarks, geodesics, embedding, coordinates, squared_radii })
    }
}

/// The number of neighbours that the plan asks for or the evidence speaks for.
fn find_neighbors(
    frames: &Frames,
    metric: &impl Metric,
    lists: &NeighborLists,
    landmarks: &[u32],
    plan: &FitPlan,
    provenance: &mut Provenance,
    progress: &mut Progress,
) -> usize {
    match (plan.n_neighbors, plan.method) {
        (Some(n_neighbors), _) => n_neighbors,
        // There is no graph; the distance of a new frame to the nearest is judged by that of reference frames to so many.
        (None, Method::Pca | Method::Native) => N_NEIGHBORS_USUAL.min(lists.k()),
        (None, Method::Isomap) => {
            let mut done = |n_done, n_tried| progress(Step::Neighborhood, n_done, n_tried);
            provenance.neighbors_tried =
                try_neighbors(frames, metric, lists, landmarks, plan.n_dims, &mut done);
            chosen(&provenance.neighbors_tried).expect("one number is tried at least").n_neighbors
        }
    }
}

/// The neighbour graph in one piece.
fn join(
    frames: &Frames,
    metric: &impl Metric,
    lists: &NeighborLists,
    n_neighbors: usize,
    provenance: &mut Provenance,
) -> Graph {
    let mut graph = Graph::union(lists, n_neighbors);
    provenance.islands = graph.islands().iter().map(Vec::len).collect();
    let between = |a: u32, b: u32| metric.squared_distance(frames.row(a as usize), frames.row(b as usize));
    provenance.bridges =
        graph.join_islands(between).iter().map(|bridge| (bridge.a, bridge.b, bridge.length)).collect();
    graph
}

/// Scales the landmarks and embeds every frame. Returns the embedding, and coordinates of shape `(n_frames, n_dims)`.
///
/// * `squared` — δ of every frame, shape `(n_frames, n_landmarks)`, counts²
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

/// Coordinates of native space, shape `(n_frames, n_readings)`.
fn as_they_are(frames: &Frames) -> Result<Array<f64>, FitError> {
    let n_frames = frames.n_frames();
    if (1..n_frames).all(|index| frames.row(index) == frames.row(0)) {
        return Err(FitError::AllEqual { n_frames });
    }
    Ok(frames.counts().iter().map(|&count| f64::from(count)).collect::<Vec<f64>>().into())
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
    provenance.largest_kind_share = largest_kind_share(coordinates, &em.mixture);
    Ok(em)
}

fn largest_kind_share(coordinates: &[f64], mixture: &Mixture) -> f64 {
    let mut n_frames_of = vec![0_usize; mixture.n_kinds()];
    let mut probabilities = vec![0.0; mixture.n_kinds()];
    for place in coordinates.chunks_exact(mixture.n_dims()) {
        mixture.posterior(place, &mut probabilities);
        n_frames_of[most_probable(&probabilities)] += 1;
    }
    let n_frames: usize = n_frames_of.iter().sum();
    n_frames_of.into_iter().max().unwrap_or(0) as f64 / n_frames as f64
}
