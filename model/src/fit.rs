//! Fits a model to the frames of a trip: response, neighbours, graph, geodesics, scaling, mixture, in this order.

mod error;
mod kinds;
mod update;

use std::convert::Infallible;
use std::sync::Arc;

use rayon::prelude::*;

pub use self::error::FitError;
use self::kinds::{Kinds, Known, find_kinds, posteriors};
pub use self::update::{KindChange, Updated, update};

use crate::command::{
    CommandScale, Commands, N_COMMAND_COLUMNS, compared, mean_squared_distance, with_metric,
};
use crate::comparison::Comparison;
use crate::em::EmError;
use crate::evidence::N_KINDS_TRIED_MAX;
use crate::features::{Extractor, ManyFeatures};
use crate::frames::Frames;
use crate::learnt::Source;
use crate::locate::Located;
use crate::metric::MetricPlan;
use crate::model::{Manifest, Model, ModelId, N_DIMS_MAX, N_KINDS_MAX, NoveltyManifest, Origin, Provenance};
use crate::novelty::{FALSE_ALARM_RATE, Usual};
use crate::out_of_sample::Manifold;
use crate::plan::{FitPlan, LandmarkChoice, Method};
use crate::reference::n_held;
use crate::register::Register;
use crate::response::{INVALID, Response};
use crate::stream::{FrameSource, InMemory, Stream, StreamError};
use crate::whitening::{Pairs, Whitening};

/// Most readings that can be coordinates as they are.
const N_READINGS_NATIVE_MAX: usize = N_DIMS_MAX;

/// A part of the work, for whoever shows progress.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Step {
    /// Reading frames, and keeping those that cover them.
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

/// Fits a model to raw frames.
///
/// Of more frames than the plan's `n_frames_max` the model keeps as many that cover them
/// ([`ReferenceSet`](crate::ReferenceSet)); the others are embedded out of sample, as those that it will be served. Kinds
/// are fitted to all of them.
///
/// * `counts` — raw counts, shape `(n_trained, n_readings)`; frames without a valid reading should not be among them
/// * `origin` — where the frames came from, for the record
///
/// Deterministic for a plan on one machine. Holds the frames, up to four times those that are kept if not all are, their
/// geodesics (n_frames × n_landmarks) and one n_landmarks² matrix.
///
/// # Errors
/// If the frames are too few or too much alike for the plan, or the plan asks for what there cannot be.
pub fn fit(
    counts: Vec<u16>,
    plan: &FitPlan,
    origin: Origin,
    progress: &mut Progress,
) -> Result<Model, FitError> {
    fit_in_memory(counts, None, plan, origin, progress)
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
    counts: Vec<u16>,
    commands: &Commands,
    plan: &FitPlan,
    origin: Origin,
    progress: &mut Progress,
) -> Result<Model, FitError> {
    fit_in_memory(counts, Some(commands), plan, origin, progress)
}

fn fit_in_memory(
    counts: Vec<u16>,
    commands: Option<&Commands>,
    plan: &FitPlan,
    origin: Origin,
    progress: &mut Progress,
) -> Result<Model, FitError> {
    let n_readings = plan.sensor.n_readings();
    let fitted = if counts.len() / n_readings > plan.n_frames_max {
        fit_stream(&mut InMemory::new(n_readings, counts), commands, plan, origin, progress)
    } else {
        fit_all(counts, commands, plan, origin, progress)
    };
    fitted.map_err(StreamError::of_fitting)
}

/// Fits a model to raw frames that are read, wherever they are.
///
/// Of frames that may all be kept, this is [`fit`] once they are read. Otherwise the reference frames are chosen in one pass
/// and the others embedded in another. One more comes first where there are commands, for what they weigh, and one between
/// where edges are asked for between frames that follow each other.
///
/// * `commands` — shape `(n_trained,)`, if frames are to be compared by them
///
/// Holds four times as many frames as are kept, some hundreds that were read and two thousand for the intrinsic dimension.
///
/// # Errors
/// If frames cannot be read, and as [`fit`].
///
/// # Panics
/// If there are more or fewer commands than frames: a bug of the caller.
pub fn fit_stream<E: Send>(
    source: &mut dyn FrameSource<Error = E>,
    commands: Option<&Commands>,
    plan: &FitPlan,
    origin: Origin,
    progress: &mut Progress,
) -> Result<Model, StreamError<E>> {
    let (n_trained, n_readings) = (source.n_frames(), plan.sensor.n_readings());
    check_counts(plan, n_trained)?;
    check_room(plan, n_trained, n_readings + commands.map_or(0, |_| N_COMMAND_COLUMNS))?;
    if n_trained <= plan.n_frames_max {
        let mut counts = vec![INVALID; n_trained * n_readings];
        source.rewind().map_err(StreamError::Read)?;
        for (index, frame) in counts.chunks_exact_mut(n_readings).enumerate() {
            source.read(frame).map_err(StreamError::Read)?;
            progress(Step::References, index + 1, n_trained);
        }
        return fit_all(counts, commands, plan, origin, progress);
    }
    check_commands(commands, n_trained, plan)?;
    let mut comparison = Comparison { response: response_of(plan)?, whitening: None };
    let mut stream = Stream {
        before: None,
        source,
        n_readings,
        comparison: comparison.clone(),
        extractor: extractor_of(plan)?,
        features: ManyFeatures::default(),
        commands: None,
    };
    let mut done = |n_done| progress(Step::References, n_done, n_trained);
    let whitening = whitening_of(plan, &origin.trips(n_trained), |indices| stream.pick(indices, &mut done))?;
    comparison.whitening = whitening;
    stream.comparison = comparison.clone();
    let mut scale = None;
    if let Some(commands) = commands {
        let mut done = |n_done| progress(Step::References, n_done, n_trained);
        let rows = stream.pick(&compared(n_trained), &mut done).map_err(StreamError::Read)?;
        let scale = scale.insert(command_scale(commands, &rows, &comparison, plan)?);
        stream.commands = Some((*scale, &commands.of_frames));
    }
    let provenance = Provenance { origin, ..made_here() };
    fit_source(Source::Stream(stream), comparison, scale, plan, provenance, None, progress)
}

/// Fits a model that keeps all frames.
fn fit_all<E: Send>(
    mut counts: Vec<u16>,
    commands: Option<&Commands>,
    plan: &FitPlan,
    origin: Origin,
    progress: &mut Progress,
) -> Result<Model, StreamError<E>> {
    let n_readings = plan.sensor.n_readings();
    let n_trained = counts.len() / n_readings;
    check_commands(commands, n_trained, plan)?;
    let response = response_of(plan)?;
    response.map_in_place(&mut counts);
    let features = extractor_of(plan)?.extract_all(counts.par_chunks_exact(n_readings));
    let whitening =
        whitening_of(plan, &origin.trips(n_trained), |indices| Ok(rows_of(&counts, n_readings, indices)))?;
    if let Some(whitening) = &whitening {
        counts = whitened(&counts, whitening);
    }
    let comparison = Comparison { response, whitening };
    let n_compared = comparison.layout(plan.sensor).n_readings();
    let (trained, scale) = match commands {
        Some(commands) => {
            let rows = rows_of(&counts, n_compared, &compared(n_trained));
            let scale = command_scale(commands, &rows, &comparison, plan)?;
            (scale.append(counts, n_compared, &commands.of_frames), Some(scale))
        }
        None => (Frames::new(n_compared, counts), None),
    };
    let provenance = Provenance { origin, ..made_here() };
    fit_source(Source::All(trained, features), comparison, scale, plan, provenance, None, progress)
}

fn response_of(plan: &FitPlan) -> Result<Response, FitError> {
    Ok(Response::new(&plan.response, plan.sensor.metres_per_count)?)
}

fn extractor_of(plan: &FitPlan) -> Result<Extractor, FitError> {
    Ok(Extractor::new(plan.sensor, &plan.metric.compile(plan.sensor)?))
}

/// Some rows of many.
fn rows_of(rows: &[u16], n_columns: usize, indices: &[usize]) -> Vec<u16> {
    indices.iter().flat_map(|index| &rows[index * n_columns..][..n_columns]).copied().collect()
}

/// Directions for frames, if the plan asks for them.
///
/// * `pick` — given the indices of frames, ascending, returns them on the response's scale
fn whitening_of<E>(
    plan: &FitPlan,
    trips: &[usize],
    pick: impl FnOnce(&[usize]) -> Result<Vec<u16>, E>,
) -> Result<Option<Arc<Whitening>>, StreamError<E>> {
    let Some(asked) = plan.whitening else { return Ok(None) };
    if plan.method == Method::Native || plan.metric != MetricPlan::Euclidean {
        return Err(FitError::Whitened.into());
    }
    let n_directions = asked.n_directions;
    if n_directions == 0 {
        let limit = asked.n_components;
        return Err(FitError::Count { what: "slow directions", n: n_directions, limit }.into());
    }
    let frames = pick(&Pairs::indices(trips)).map_err(StreamError::Read)?;
    let whitening = Pairs::new(frames, plan.sensor.n_readings(), trips).whiten(asked);
    Ok(Some(Arc::new(whitening.ok_or(FitError::NoDirections { n_directions })?)))
}

/// Frames in memory along directions.
fn whitened(frames: &[u16], whitening: &Whitening) -> Vec<u16> {
    let (n_readings, n_directions) = (whitening.n_readings(), whitening.n_directions());
    let mut directions = vec![0; frames.len() / n_readings * n_directions];
    let each = frames.par_chunks_exact(n_readings).zip(directions.par_chunks_exact_mut(n_directions));
    each.for_each(|(frame, directions)| whitening.map(frame, directions));
    directions
}

fn made_here() -> Provenance {
    Provenance { made_by: format!("natural-kinds {}", env!("CARGO_PKG_VERSION")), ..Default::default() }
}

/// * `rows` — frames by which commands are weighed, as they are compared: see [`mean_squared_distance`]
fn command_scale(
    commands: &Commands,
    rows: &[u16],
    comparison: &Comparison,
    plan: &FitPlan,
) -> Result<CommandScale, FitError> {
    let compared = comparison.layout(plan.sensor);
    let metric = plan.metric.compile(compared)?;
    let of_readings =
        with_metric!(&metric, None, |metric| mean_squared_distance(rows, compared.n_readings(), metric));
    Ok(CommandScale::new(commands, of_readings))
}

fn check_commands(commands: Option<&Commands>, n_frames: usize, plan: &FitPlan) -> Result<(), FitError> {
    let Some(commands) = commands else { return Ok(()) };
    assert_eq!(commands.of_frames.len(), n_frames, "a command for each frame");
    match plan.method {
        Method::Native => Err(FitError::NativeCommands { weight: commands.weight }),
        _ => Ok(()),
    }
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
    let provenance = Provenance { origin: provenance.origin.clone(), ..made_here() };
    let (source, comparison) = (Source::<Infallible>::Model(model), model.comparison.clone());
    fit_source(source, comparison, *commands, &plan, provenance, None, progress)
        .map_err(StreamError::of_fitting)
}

fn fit_source<E: Send>(
    source: Source<E>,
    comparison: Comparison,
    commands: Option<CommandScale>,
    plan: &FitPlan,
    mut provenance: Provenance,
    known: Option<&Known>,
    progress: &mut Progress,
) -> Result<Model, StreamError<E>> {
    let n_trained = source.n_trained();
    check_counts(plan, n_trained)?;
    let compared = comparison.layout(plan.sensor);
    let metric = plan.metric.compile(compared).map_err(FitError::from)?;
    let located = with_metric!(&metric, commands.as_ref(), |metric| {
        Located::by(metric, source, compared, plan, &mut provenance, progress)
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
        held_out,
    } = located?;
    let (n_frames, n_dims) = (frames.n_frames(), coordinates.len() / n_trained);
    let Kinds { mixture, persistence, merges } =
        find_kinds(&coordinates, n_dims, plan, known, &mut provenance, progress)?;

    let usual = Usual {
        manifold: Manifold {
            frames: &frames,
            landmarks: &landmarks,
            geodesics: geodesics.as_ref(),
            embedding: embedding.as_ref(),
        },
        mixture: &mixture,
        references: &references,
        coordinates: &coordinates,
        n_neighbors,
    };
    let (row, trips) = (|index| held_out.row(&frames, index), provenance.origin.trips(n_trained));
    let (novelty, half_split) = with_metric!(&metric, commands.as_ref(), |metric| {
        usual.learn(metric, &held_out, row, &trips, provenance.n_frames_effective)
    });

    let plan = FitPlan { n_landmarks: plan.n_landmarks.min(n_frames), ..plan.clone() };
    let n_kinds = mixture.n_kinds();
    let format = crate::file::FORMAT;
    let manifest = Manifest {
        format,
        plan,
        commands,
        n_trained,
        n_frames,
        n_neighbors,
        n_dims,
        n_kinds,
        persistence,
        merges,
        novelty: NoveltyManifest {
            n_held_out: novelty.n_held_out(),
            n_tiles: novelty.n_tiles(),
            false_alarm_rate: FALSE_ALARM_RATE,
        },
        half_split,
        provenance,
    };
    let mut model = Model {
        id: ModelId([0; 16]),
        manifest,
        comparison,
        metric,
        frames,
        references,
        landmarks: landmarks.into(),
        geodesics,
        embedding,
        coordinates: coordinates.into(),
        mixture,
        register: Register::new(n_kinds),
        squared_radii: squared_radii.into(),
        novelty,
    };
    model.id = crate::file::id_of(&model);
    Ok(model)
}

/// Whether memory can be had for what will be held of frames, geodesics and landmarks, before long work.
fn check_room(plan: &FitPlan, n_trained: usize, n_columns: usize) -> Result<(), FitError> {
    let n_bytes = n_bytes_held(plan, n_trained, n_columns);
    Vec::<u8>::new().try_reserve_exact(n_bytes).map_err(|_| no_room(plan, n_trained, n_columns))
}

pub(crate) fn no_room(plan: &FitPlan, n_trained: usize, n_columns: usize) -> FitError {
    let n_frames = plan.n_frames_max.min(n_trained);
    let (n_landmarks, n_bytes) = (plan.n_landmarks.min(n_frames), n_bytes_held(plan, n_trained, n_columns));
    FitError::NoRoom { n_frames, n_columns, n_landmarks, n_bytes }
}

fn n_bytes_held(plan: &FitPlan, n_trained: usize, n_columns: usize) -> usize {
    let n_frames = plan.n_frames_max.min(n_trained);
    let n_landmarks = plan.n_landmarks.min(n_frames);
    let array =
        |rows: usize, columns: usize, n_bytes: usize| rows.saturating_mul(columns).saturating_mul(n_bytes);
    array(n_held(plan.n_frames_max, n_trained), n_columns, size_of::<u16>())
        .saturating_add(array(n_frames, n_landmarks, size_of::<f32>()))
        .saturating_add(array(n_landmarks, n_landmarks, 2 * size_of::<f64>()))
}

fn check_counts(plan: &FitPlan, n_trained: usize) -> Result<(), FitError> {
    let within = |what, n: usize, limit: usize| match (1..=limit).contains(&n) {
        true => Ok(()),
        false => Err(FitError::Count { what, n, limit }),
    };
    // What is left to the evidence is asked for as little as can be.
    let n_kinds = plan.n_kinds.unwrap_or(1);
    within("kinds", n_kinds, N_KINDS_MAX)?;
    within("kinds at least", plan.n_kinds_min, N_KINDS_TRIED_MAX)?;
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
