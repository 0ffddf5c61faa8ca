//! Evaluates a model on two trips: Isomap, principal components and random kinds, at the same number of dimensions and
//! kinds.

use std::path::PathBuf;
use std::sync::Arc;

use kinds_model::{Classifier, FitError, FitPlan, Method, Model, SensorLayout, refit};
use rand::RngExt;
use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::SeedableRng;
use serde::Serialize;

use crate::agreement::adjusted_mutual_information;
use crate::consistency::{Places, Revisits, kappa};
use crate::load::LoadedTrip;
use crate::progress::{Progress, Stage, fitting};

/// How consistency is measured.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct EvaluationPlan {
    /// R: frames no farther apart saw the same place, metres.
    pub radius_m: f64,
    /// Z: strictly more than this share of the frames near a frame must have its kind, 0…1.
    pub share: f64,
    /// Seed of the random kinds.
    pub seed: u64,
}

/// The evaluation, as scripts read it.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Evaluation {
    /// R, metres.
    pub radius_m: f64,
    /// Z.
    pub share: f64,
    /// Share of the first trip's frames with at least one frame of the second within R.
    pub revisited: f64,
    /// By method.
    pub methods: Methods,
}

/// The three methods.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Methods {
    /// Geodesics.
    pub isomap: MethodScores,
    /// Euclidean distances.
    pub pca: MethodScores,
    /// Every frame's kind drawn at random.
    pub random: MethodScores,
}

/// How consistent one method's kinds are.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct MethodScores {
    /// d; 0 for random kinds.
    pub n_dims: usize,
    /// J.
    pub n_kinds: usize,
    /// C: share of the revisited frames that are consistent.
    pub consistency: f64,
    /// C₀: the same by chance.
    pub chance: f64,
    /// κ = (C − C₀) / (1 − C₀).
    pub kappa: f64,
    /// Adjusted mutual information between a frame's kind and its nearest frame's.
    pub ami: f64,
    /// Share of the most frequent kind among the frames of both trips: one giant kind is consistent and useless.
    pub largest_kind_share: f64,
}

/// Why two trips cannot be compared.
#[derive(Debug, thiserror::Error)]
pub enum EvaluateError {
    /// Frames of another sensor.
    #[error("trip {path} has frames of {found}; the model understands frames of {expected}")]
    OtherSensor {
        /// The trip.
        path: PathBuf,
        /// Its frames.
        found: SensorLayout,
        /// The model's.
        expected: SensorLayout,
    },
    /// Nobody knows where the robot was.
    #[error(
        "trip {path} has no poses: consistency compares the kinds of one place, so evaluation needs \
         nav_msgs/msg/Odometry in both trips (training does not)"
    )]
    NoPoses {
        /// The trip.
        path: PathBuf,
    },
    /// Different places.
    #[error(
        "no frame of {first} has a frame of {second} within {radius_m} m: the trips do not meet, or their poses have different origins; try a larger radius"
    )]
    NeverMeet {
        /// One trip.
        first: PathBuf,
        /// The other.
        second: PathBuf,
        /// R, metres.
        radius_m: f64,
    },
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
    #[error("cannot fit {method} to the model's reference frames for comparison: {error}")]
    Refit {
        /// Which method, in words.
        method: &'static str,
        /// Why.
        error: FitError,
    },
}

/// Measures how consistent kinds are between the trip that a model was learnt from and another.
///
/// The method that the model does not use is fitted to its reference frames, with the same response, landmarks,
/// dimensions and kinds.
///
/// # Errors
/// If a trip is of another sensor or has no poses, or the trips never meet.
pub fn evaluate(
    model: Model,
    first: &LoadedTrip,
    second: &LoadedTrip,
    plan: &EvaluationPlan,
    progress: &mut Progress,
) -> Result<Evaluation, EvaluateError> {
    check(plan)?;
    for trip in [first, second] {
        if trip.layout != model.layout() {
            let (path, found) = (trip.path.clone(), trip.layout);
            return Err(EvaluateError::OtherSensor { path, found, expected: model.layout() });
        }
    }
    let (first, second) = (Placed::of(first)?, Placed::of(second)?);
    let revisits = Revisits::find(&first.places, &second.places, plan.radius_m);
    let FitPlan { method, n_dims, ref em, .. } = model.manifest().plan;
    let n_kinds = em.n_kinds;
    let score = |n_dims, kinds: &[Vec<usize>; 2]| {
        score(&revisits, n_dims, n_kinds, kinds, plan.share).ok_or_else(|| EvaluateError::NeverMeet {
            first: first.trip.path.clone(),
            second: second.trip.path.clone(),
            radius_m: plan.radius_m,
        })
    };
    // Cheapest first: trips that never meet should not wait for a fit.
    let mut random = ChaCha8Rng::seed_from_u64(plan.seed);
    let mut draw =
        |placed: &Placed| (0..placed.frames.len()).map(|_| random.random_range(0..n_kinds)).collect();
    let random = score(0, &[draw(&first), draw(&second)])?;

    let (other, name) = match method {
        Method::Isomap => (Method::Pca, "principal components"),
        Method::Pca => (Method::Isomap, "Isomap"),
    };
    let other = refit(&model, other, &mut fitting(progress))
        .map_err(|error| EvaluateError::Refit { method: name, error })?;
    let n_frames = 2 * (first.frames.len() + second.frames.len()) as u64;
    let mut n_done = 0;
    let mut classified = || {
        n_done += 1;
        progress(Stage::Classifying, n_done, n_frames);
    };
    let mut by_method = [model, other].map(|model| {
        let mut classifier = Classifier::new(Arc::new(model));
        [&first, &second].map(|placed| placed.kinds(&mut classifier, &mut classified))
    });
    if method == Method::Pca {
        by_method.reverse();
    }
    let [isomap, pca] = by_method;
    Ok(Evaluation {
        radius_m: plan.radius_m,
        share: plan.share,
        revisited: revisits.share_revisited(),
        methods: Methods { isomap: score(n_dims, &isomap)?, pca: score(n_dims, &pca)?, random },
    })
}

fn check(plan: &EvaluationPlan) -> Result<(), EvaluateError> {
    let EvaluationPlan { radius_m, share, .. } = *plan;
    if !(radius_m.is_finite() && radius_m > 0.0) {
        return Err(EvaluateError::Limit { field: "radius_m", value: radius_m, limit: "above 0 m" });
    }
    if !(0.0..1.0).contains(&share) {
        return Err(EvaluateError::Limit { field: "share", value: share, limit: "at least 0 and below 1" });
    }
    Ok(())
}

/// The frames of a trip whose place is known.
struct Placed<'a> {
    trip: &'a LoadedTrip,
    places: Places,
    frames: Vec<&'a [u16]>,
}

impl<'a> Placed<'a> {
    fn of(trip: &'a LoadedTrip) -> Result<Self, EvaluateError> {
        let known =
            trip.poses.iter().zip(trip.frames()).filter_map(|(pose, counts)| Some(((*pose)?, counts)));
        let (poses, frames): (Vec<_>, Vec<_>) = known.unzip();
        match poses.is_empty() {
            true => Err(EvaluateError::NoPoses { path: trip.path.clone() }),
            false => Ok(Self { trip, places: Places { poses }, frames }),
        }
    }

    fn kinds(&self, classifier: &mut Classifier, classified: &mut dyn FnMut()) -> Vec<usize> {
        let kind = |counts: &&[u16]| {
            let kind = classifier.classify(counts).kind;
            classified();
            kind
        };
        self.frames.iter().map(kind).collect()
    }
}

/// `None` if the trips never meet.
fn score(
    revisits: &Revisits,
    n_dims: usize,
    n_kinds: usize,
    kinds: &[Vec<usize>; 2],
    share: f64,
) -> Option<MethodScores> {
    let [first, second] = kinds;
    let measured = revisits.consistency(first, second, share)?;
    let mut n_frames_of = vec![0_usize; n_kinds];
    kinds.iter().flatten().for_each(|&kind| n_frames_of[kind] += 1);
    let largest = n_frames_of.iter().max().copied().unwrap_or(0);
    let pairs: Vec<_> = revisits.pairs(first, second).collect();
    Some(MethodScores {
        n_dims,
        n_kinds,
        consistency: measured.consistency,
        chance: measured.chance,
        kappa: kappa(measured),
        ami: adjusted_mutual_information(&pairs),
        largest_kind_share: largest as f64 / (first.len() + second.len()) as f64,
    })
}
