//! Evaluates models on trips: do places seen again get the same kind? By Isomap, principal components and random kinds, at the
//! same number of dimensions and kinds; beside them native space, where that is what is evaluated.
//!
//! Find where trips meet ([`Meetings`]), fit the other method once ([`Rivals`]), then [`evaluate`].

use std::sync::Arc;

use kinds_model::{Classification, Classifier, Method, Model, Status};
use rand::RngExt;
use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::SeedableRng;
use rayon::prelude::*;
use serde::Serialize;

use crate::drift::{Counted, Drift};
use crate::load::{LoadedTrip, of_model};
use crate::meeting::{MeetingError, Meetings, Pair, Placed};
use crate::places::SamePlace;
use crate::progress::{Progress, Stage, Told};
use crate::registration::{self, RegistrationScores};
use crate::rivals::{RivalError, Rivals};
use crate::scores::{Comparison, DirectedScores, MethodKinds, Scores};
use crate::surface::Grid;
use crate::track::Track;
use crate::trip_kinds::TripKinds;

/// Frames that one thread classifies before it asks for more.
const N_FRAMES_AT_A_TIME: usize = 64;

/// How consistency is measured.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct EvaluationPlan {
    /// R: frames no farther apart saw the same place, metres.
    pub radius_m: f64,
    /// How far headings at the same place may differ, radians; None where a place is the same from every side.
    pub heading_tolerance_rad: Option<f64>,
    /// Z: strictly more than this share of the frames near a frame must have its kind, 0…1.
    pub share: f64,
    /// Radii of the surface, evenly spread up to the greatest.
    pub n_radii: usize,
    /// The greatest, metres; None for twice R.
    pub radius_m_max: Option<f64>,
    /// Shares of the surface, evenly spread from 0 to below 1.
    pub n_shares: usize,
    /// Resamples of the path that confidence is from.
    pub n_resamples: usize,
    /// Seed of the random kinds, the resamples and the errors of registration.
    pub seed: u64,
}

impl Default for EvaluationPlan {
    fn default() -> Self {
        Self {
            radius_m: 0.3,
            heading_tolerance_rad: None,
            share: 0.5,
            n_radii: 20,
            radius_m_max: None,
            n_shares: 20,
            n_resamples: 1000,
            seed: 0,
        }
    }
}

/// The evaluation, as scripts read it.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Evaluation {
    /// Of the first pair of trips, the second trip revisiting the first; none of a single trip.
    #[serde(flatten)]
    pub scores: Option<Scores>,
    /// The method of the evaluated model, whose kinds are those of the trips.
    pub method: &'static str,
    /// Radii and shares of the surfaces.
    pub grid: Grid,
    /// Any two trips through the same space that meet.
    pub pairs: Vec<PairScores>,
    /// Why other pairs through the same space were not compared.
    pub not_compared: Vec<String>,
    /// Sentences about the comparison: which method there is none with, and why.
    pub remarks: Vec<String>,
    /// The trips, space by space. Scripts read what was made of them instead.
    #[serde(skip)]
    pub trips: Vec<ClassifiedTrip>,
}

/// How well kinds repeat on two trips through the same space.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct PairScores {
    /// Which space, from 0.
    pub space: usize,
    /// The trips' names.
    pub trips: [String; 2],
    /// The second revisits the first.
    pub forward: DirectedScores,
    /// The first revisits the second.
    pub backward: DirectedScores,
    /// With errors in the second trip's poses, by the model's own method.
    pub registration: Vec<RegistrationScores>,
}

/// A trip with the kind of each of its frames by the evaluated model.
#[derive(Clone, Debug, PartialEq)]
pub struct ClassifiedTrip {
    /// Which space it leads through, from 0.
    pub space: usize,
    /// When and where its frames were taken: all that have a valid reading.
    pub track: Track,
    /// The most probable kind, shape `(n_frames,)`.
    pub kinds: Vec<usize>,
    /// How far it is from the trips that the model was learnt from; none where no frame was classified.
    pub drift: Option<Drift>,
}

impl ClassifiedTrip {
    /// As figures, maps and policies take it.
    pub fn trip_kinds(&self) -> TripKinds<'_> {
        self.track.with_kinds(&self.kinds)
    }
}

/// Why trips cannot be evaluated.
#[derive(Debug, thiserror::Error)]
pub enum EvaluateError {
    /// Trips that cannot be compared.
    #[error(transparent)]
    Meeting(#[from] MeetingError),
    /// A number outside its limits.
    #[error("{field} is {value}; it must be {limit}")]
    Limit {
        /// Which flag.
        field: &'static str,
        /// What was given.
        value: f64,
        /// What is allowed, in words.
        limit: &'static str,
    },
    /// The model for comparison.
    #[error(transparent)]
    Rival(#[from] RivalError),
}

impl EvaluationPlan {
    /// Checks every number against its limits.
    ///
    /// # Errors
    /// If one is outside them.
    pub fn check(&self) -> Result<(), EvaluateError> {
        let limit = |field, value, is_within: bool, limit| match is_within {
            true => Ok(()),
            false => Err(EvaluateError::Limit { field, value, limit }),
        };
        let is_length = |length_m: f64| length_m.is_finite() && length_m >= 0.0;
        limit("radius_m", self.radius_m, is_length(self.radius_m), "at least 0 m")?;
        limit("share", self.share, (0.0..1.0).contains(&self.share), "at least 0 and below 1")?;
        if let Some(radius_m) = self.radius_m_max {
            limit("radius_m_max", radius_m, is_length(radius_m) && radius_m > 0.0, "above 0 m")?;
        }
        if let Some(tolerance_rad) = self.heading_tolerance_rad {
            let degrees = tolerance_rad.to_degrees();
            limit("heading_deg", degrees, (0.0..=180.0).contains(&degrees), "between 0° and 180°")?;
        }
        let between = "between 1 and 100";
        limit("radii", self.n_radii as f64, (1..=100).contains(&self.n_radii), between)?;
        limit("shares", self.n_shares as f64, (1..=100).contains(&self.n_shares), between)
    }

    /// What counts as the same place.
    pub fn same_place(&self) -> SamePlace {
        SamePlace { radius_m: self.radius_m, heading_tolerance_rad: self.heading_tolerance_rad }
    }

    fn grid(&self) -> Grid {
        match self.radius_m_max.unwrap_or(2.0 * self.radius_m) {
            // At radius 0 there is only that.
            0.0 => Grid::new(0.0, 1, self.n_shares),
            radius_m_max => Grid::new(radius_m_max, self.n_radii, self.n_shares),
        }
    }
}

/// Measures how consistent kinds are where trips meet, by both methods and at random.
///
/// # Errors
/// If a number of the plan is outside its limits.
///
/// # Panics
/// If the trips are not of the models' sensor: a bug of the caller, whom [`Meetings::find`] asked for it.
pub fn evaluate(
    rivals: &Rivals,
    meetings: &Meetings,
    plan: &EvaluationPlan,
    progress: &mut Progress,
) -> Result<Evaluation, EvaluateError> {
    plan.check()?;
    assert_eq!(meetings.layout, rivals.isomap.layout(), "trips and models are of one sensor");
    let (models, own) = (rivals.models(), rivals.own_place());
    let found = classify(&models, &meetings.trips, progress);
    // Shape (n_methods, n_trips), each the kinds of a trip's frames.
    let kinds: Vec<Vec<&[usize]>> =
        found.iter().map(|trips| trips.iter().map(|trip| &trip.kinds[..]).collect()).collect();
    let random = random_kinds(&meetings.trips, rivals.isomap.mixture().n_kinds(), plan.seed);
    let (grid, same_place) = (plan.grid(), meetings.same_place);
    let n_frames =
        |pair: &Pair| pair.trips.iter().map(|&trip| meetings.trips[trip].frames.len() as u64).sum::<u64>();
    let n_steps = meetings.pairs.iter().map(|pair| n_frames(pair) + registration::N_STEPS).sum::<u64>();
    let told = Told::new(Stage::Comparing, n_steps, progress);
    let tell = |n| told.add(n);
    let pairs = meetings.pairs.iter().map(|pair| {
        let [first, second] = pair.trips;
        let directed = |direction: usize, [first, second]: [usize; 2]| {
            let placed = [first, second].map(|trip| &meetings.trips[trip]);
            let of_models = models.iter().zip(&kinds).map(|((method, model), kinds)| MethodKinds {
                method: Some(*method),
                n_dims: model.manifest().n_dims,
                n_kinds: model.mixture().n_kinds(),
                kinds: [placed[0].of_placed(kinds[first]), placed[1].of_placed(kinds[second])],
            });
            let at_random = MethodKinds {
                method: None,
                n_dims: 0,
                n_kinds: rivals.isomap.mixture().n_kinds(),
                kinds: [first, second].map(|trip| random[trip].clone()),
            };
            let comparison = Comparison {
                places: placed.map(|placed| &placed.places),
                revisits: &pair.revisits[direction],
                radius_m: plan.radius_m,
                heading_tolerance_rad: plan.heading_tolerance_rad,
                share: plan.share,
                grid: &grid,
                n_resamples: plan.n_resamples,
                seed: plan.seed,
            };
            comparison.score(&of_models.chain([at_random]).collect::<Vec<_>>(), own, &tell)
        };
        let placed = pair.trips.map(|trip| &meetings.trips[trip]);
        let own_kinds = [0, 1].map(|which| placed[which].of_placed(kinds[own][pair.trips[which]]));
        PairScores {
            space: placed[0].space,
            trips: placed.map(|placed| placed.trip.survey.title()),
            forward: directed(0, [first, second]),
            backward: directed(1, [second, first]),
            registration: registration::scores(
                placed.map(|placed| &placed.places),
                [&own_kinds[0], &own_kinds[1]],
                &same_place,
                plan.share,
                plan.seed,
                &|| tell(1),
            ),
        }
    });
    let pairs: Vec<PairScores> = pairs.collect();
    Ok(Evaluation {
        scores: pairs.first().map(|pair| pair.forward.scores.clone()),
        method: name_of(rivals.own),
        grid,
        remarks: rivals.remarks.clone(),
        not_compared: meetings.unmet().iter().map(ToString::to_string).collect(),
        trips: classified(&meetings.trips, &found[own], models[own].1),
        pairs,
    })
}

/// Finds the kinds of trips of which no two are to be compared: no rival is needed for that.
///
/// # Panics
/// If the trips are not of the model's sensor, or there are pairs of them: a bug of the caller.
pub fn evaluate_single(
    model: &Model,
    meetings: &Meetings,
    plan: &EvaluationPlan,
    progress: &mut Progress,
) -> Evaluation {
    assert_eq!(meetings.layout, model.layout(), "trips and model are of one sensor");
    assert!(meetings.is_empty(), "pairs of trips are to be compared");
    let method = model.manifest().plan.method;
    let found = classify(&[(method, model)], &meetings.trips, progress);
    Evaluation {
        scores: None,
        method: name_of(method),
        grid: plan.grid(),
        pairs: Vec::new(),
        not_compared: Vec::new(),
        remarks: Vec::new(),
        trips: classified(&meetings.trips, &found[0], model),
    }
}

/// As scripts read it.
fn name_of(method: Method) -> &'static str {
    match method {
        Method::Isomap => "isomap",
        Method::Pca => "pca",
        Method::Native => "native",
    }
}

/// What a model found in a trip.
struct Found {
    /// The most probable kind of each frame given those before it.
    kinds: Vec<usize>,
    counted: Counted,
}

fn classified(trips: &[Placed], found: &[Found], model: &Model) -> Vec<ClassifiedTrip> {
    let of_trip = |(placed, found): (&Placed, &Found)| ClassifiedTrip {
        space: placed.space,
        track: Track::of(&placed.trip.survey),
        kinds: found.kinds.clone(),
        drift: found.counted.drift(model),
    };
    trips.iter().zip(found).map(of_trip).collect()
}

/// What every model finds in every trip.
fn classify(models: &[(Method, &Model)], trips: &[Placed], progress: &mut Progress) -> Vec<Vec<Found>> {
    let n_frames = models.len() * trips.iter().map(|placed| placed.trip.survey.n_frames()).sum::<usize>();
    let told = Told::new(Stage::Classifying, n_frames as u64, progress);
    let by = |(_, model): &(Method, &Model)| {
        let model = Arc::new((*model).clone());
        trips.iter().map(|placed| found_in(&model, placed.trip, &told)).collect()
    };
    models.iter().map(by).collect()
}

fn found_in(model: &Arc<Model>, trip: &LoadedTrip, told: &Told) -> Found {
    let n_readings = trip.survey.layout.n_readings();
    let passed: Option<Vec<u16>> = model
        .median()
        .map(|mut median| trip.frames().flat_map(|counts| median.take(counts).to_vec()).collect());
    let counts = passed.as_ref().unwrap_or(&trip.counts);
    let frames: Vec<_> = counts.chunks_exact(n_readings).zip(&trip.survey.commands).collect();
    let of_chunk = |classifier: &mut Classifier, frames: &[(&[u16], &Option<kinds_trips::Command>)]| {
        told.add(frames.len() as u64);
        let answer = |(counts, command): &(&[u16], &Option<kinds_trips::Command>)| {
            let Classification { status, probabilities, novelty, .. } =
                classifier.classify_commanded(counts, command.map(of_model)).clone();
            (status, probabilities, novelty, classifier.half_split_error())
        };
        frames.iter().map(answer).collect::<Vec<_>>()
    };
    let chunks = frames.par_chunks(N_FRAMES_AT_A_TIME);
    let answers: Vec<Vec<_>> = chunks.map_init(|| Classifier::new(model.clone()), of_chunk).collect();
    let (mut filter, mut counted) = (model.filter(), Counted::default());
    let kind = |(status, probabilities, novelty, half_split): (Status, Vec<f64>, f64, Option<f64>)| {
        counted.add(status, &probabilities, model.manifest().novelty.is_novel(novelty), half_split);
        filter.take((status == Status::Classified).then_some(&probabilities[..]), 0);
        filter.kind()
    };
    let kinds = answers.into_iter().flatten().map(kind).collect();
    Found { kinds, counted }
}

/// Random kinds of the frames whose place is known, for each trip; drawn anew for each space.
fn random_kinds(trips: &[Placed], n_kinds: usize, seed: u64) -> Vec<Vec<usize>> {
    let (mut random, mut space) = (ChaCha8Rng::seed_from_u64(seed), 0);
    let of_trip = |placed: &Placed| {
        if placed.space != space {
            (random, space) = (ChaCha8Rng::seed_from_u64(seed), placed.space);
        }
        placed.frames.iter().map(|_| random.random_range(0..n_kinds)).collect()
    };
    trips.iter().map(of_trip).collect()
}
