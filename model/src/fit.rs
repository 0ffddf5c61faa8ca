//! Fits a model to the frames of a trip: response, neighbours, graph, geodesics, scaling, mixture, in this order.

mod kinds;

use self::kinds::find_kinds;
use crate::command::{CommandScale, Commands, mean_squared_distance, with_metric};
use crate::em::EmError;
use crate::frames::Frames;
use crate::learnt::Source;
use crate::locate::Located;
use crate::mds::MdsError;
use crate::metric::{MetricError, MetricPlan};
use crate::model::{Manifest, Model, ModelId, N_DIMS_MAX, N_KINDS_MAX, Origin, Provenance};
use crate::plan::{FitPlan, LandmarkChoice, Method};
use crate::response::{Response, ResponseError};

/// Most readings that can be coordinates as they are.
const N_READINGS_NATIVE_MAX: usize = N_DIMS_MAX;

/// A part of the work, for whoever shows progress.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Step {
    /// Reference frames that cover a trip too long to be kept.
    References,
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
    /// Too few reference frames for the neighbours.
    #[error(
        "{n_frames} reference frames are too few for {n_neighbors} neighbours each; ask for fewer neighbours or keep more of \
         the {n_trained} frames"
    )]
    TooFewReferences {
        /// Reference frames asked for.
        n_frames: usize,
        /// Frames that these are chosen of.
        n_trained: usize,
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
/// Of more frames than the plan's `n_frames_max` the model keeps as many that cover them
/// ([`ReferenceSet`](crate::ReferenceSet)); the others are embedded out of sample, as those that it will be served. Kinds
/// are fitted to all of them.
///
/// * `counts` — raw counts, shape `(n_trained, n_readings)`; frames without a valid reading should not be among them
/// * `origin` — where the frames came from, for the record
///
/// Deterministic for a plan on one machine. Holds the frames, once more those that are kept if not all are, their geodesics
/// (n_frames × n_landmarks) and one n_landmarks² matrix.
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
    let trained = Frames::new(plan.sensor.n_readings(), counts);
    fit_source(Source::Trips(trained), response, None, plan, origin, progress)
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
    let trained = scale.append(counts, n_readings, &commands.of_frames);
    fit_source(Source::Trips(trained), response, Some(scale), plan, origin, progress)
}

/// Fits a model by a method to the reference frames of another, with all else but the size as that one's plan has it.
///
/// A model does not hold the frames that it does not keep. So each reference frame's place is taken for that of every frame
/// that it stands for: kinds are fitted to as many frames as the other model's, as dense where that one's are, in the same
/// order of time. Where all frames are kept, this is [`fit`] with another method.
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
    fit_source(Source::Model(model), model.response().clone(), *commands, &plan, origin, progress)
}

fn fit_source(
    source: Source,
    response: Response,
    commands: Option<CommandScale>,
    plan: &FitPlan,
    origin: Origin,
    progress: &mut Progress,
) -> Result<Model, FitError> {
    let n_trained = source.n_trained();
    check_counts(plan, n_trained)?;
    let metric = plan.metric.compile(plan.sensor)?;
    let mut provenance = Provenance {
        made_by: format!("natural-kinds {}", env!("CARGO_PKG_VERSION")),
        origin,
        ..Default::default()
    };
    let located = with_metric!(&metric, commands.as_ref(), |metric| {
        Located::by(metric, source, plan, &mut provenance, progress)
    });
    let Located {
        frames,
        references,
        n_neighbors,
        landmarks,
        geodesics,
        embedding,
        coordinates,
        squared_radii,
    } = located?;
    let (n_frames, n_dims) = (frames.n_frames(), coordinates.len() / n_trained);
    let mixture = find_kinds(&coordinates, n_dims, plan, &mut provenance, progress)?;

    let plan = FitPlan { n_landmarks: plan.n_landmarks.min(n_frames), ..plan.clone() };
    let n_kinds = mixture.n_kinds();
    let format = crate::file::FORMAT;
    let manifest =
        Manifest { format, plan, commands, n_trained, n_frames, n_neighbors, n_dims, n_kinds, provenance };
    let mut model = Model {
        id: ModelId([0; 16]),
        manifest,
        response,
        metric,
        frames,
        references,
        landmarks: landmarks.into(),
        geodesics,
        embedding,
        coordinates: coordinates.into(),
        mixture,
        squared_radii: squared_radii.into(),
    };
    model.id = crate::file::id_of(&model);
    Ok(model)
}

fn check_counts(plan: &FitPlan, n_trained: usize) -> Result<(), FitError> {
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
    within("reference frames", plan.n_frames_max, usize::MAX)?;
    within("landmarks", plan.n_landmarks, usize::MAX)?;
    within("starts of the mixture", plan.em.n_starts, usize::MAX)?;
    if n_trained <= n_neighbors {
        return Err(FitError::TooFewFrames { n_frames: n_trained, n_neighbors });
    }
    if plan.n_frames_max <= n_neighbors {
        return Err(FitError::TooFewReferences { n_frames: plan.n_frames_max, n_trained, n_neighbors });
    }
    if n_trained < n_kinds {
        return Err(EmError::TooFewFrames { n_frames: n_trained, n_kinds }.into());
    }
    let n_frames = n_trained.min(plan.n_frames_max);
    if plan.method == Method::Native {
        return check_native(plan, n_trained);
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
