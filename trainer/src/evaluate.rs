//! Evaluates models on two trips: Isomap, principal components and random kinds, at the same number of dimensions and
//! kinds; beside them native space, where that is what is evaluated.
//!
//! Find where trips meet ([`Meeting`]), fit the other method once ([`Rivals`]), then [`evaluate`], for as many pairs of
//! trips as there are.

use std::path::PathBuf;
use std::sync::Arc;

use kinds_model::{Classifier, Command, FitError, Method, Model, SensorLayout, Size, refit};
use rand::RngExt;
use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::SeedableRng;
use serde::Serialize;

use crate::agreement::adjusted_mutual_information;
use crate::consistency::{Places, Revisits, kappa};
use crate::load::{LoadedTrip, of_model};
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
    /// Isomap's kind of every frame whose place is known, of either trip, in order of time. Scripts do not read it.
    #[serde(skip)]
    pub isomap_kinds: [Vec<usize>; 2],
}

/// The methods, all with as many kinds.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Methods {
    /// Geodesics.
    pub isomap: MethodScores,
    /// Straight distances, in as many dimensions as Isomap.
    pub pca: MethodScores,
    /// The readings as they are, if that is the model's method.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub native: Option<MethodScores>,
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
         nav_msgs/msg/Odometry or geometry_msgs/msg/PoseStamped in both trips (training does not)"
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

/// Two trips that meet, and what is compared where they do. Found without any model, so that trips which never meet
/// need not wait for one to be fitted.
#[derive(Debug)]
pub struct Meeting<'a> {
    plan: EvaluationPlan,
    layout: SensorLayout,
    trips: [Placed<'a>; 2],
    revisits: Revisits,
}

impl<'a> Meeting<'a> {
    /// Finds where two trips meet.
    ///
    /// * `layout` — of the sensor whose kinds are to be compared
    ///
    /// # Errors
    /// If a trip is of another sensor or has no poses, or the trips never meet.
    pub fn find(
        layout: SensorLayout,
        first: &'a LoadedTrip,
        second: &'a LoadedTrip,
        plan: &EvaluationPlan,
    ) -> Result<Self, EvaluateError> {
        check(plan)?;
        for trip in [first, second] {
            if trip.layout != layout {
                let (path, found) = (trip.path.clone(), trip.layout);
                return Err(EvaluateError::OtherSensor { path, found, expected: layout });
            }
        }
        let trips = [Placed::of(first)?, Placed::of(second)?];
        let revisits = Revisits::find(&trips[0].places, &trips[1].places, plan.radius_m);
        if revisits.share_revisited() == 0.0 {
            let (first, second) = (first.path.clone(), second.path.clone());
            return Err(EvaluateError::NeverMeet { first, second, radius_m: plan.radius_m });
        }
        Ok(Self { plan: *plan, layout, trips, revisits })
    }

    /// Kinds of both trips' frames by a model.
    fn classify(&self, model: &Model, classified: &mut dyn FnMut()) -> [Vec<usize>; 2] {
        let mut classifier = Classifier::new(Arc::new(model.clone()));
        [0, 1].map(|trip| {
            let kind = |&(counts, command): &(&[u16], Option<Command>)| {
                let kind = classifier.classify_commanded(counts, command).kind;
                classified();
                kind
            };
            self.trips[trip].frames.iter().map(kind).collect()
        })
    }

    fn random(&self, n_kinds: usize) -> [Vec<usize>; 2] {
        let mut random = ChaCha8Rng::seed_from_u64(self.plan.seed);
        [0, 1].map(|trip| {
            let n_frames = self.trips[trip].frames.len();
            (0..n_frames).map(|_| random.random_range(0..n_kinds)).collect()
        })
    }

    fn score(&self, n_dims: usize, n_kinds: usize, kinds: &[Vec<usize>; 2]) -> MethodScores {
        let [first, second] = kinds;
        let measured = self.revisits.consistency(first, second, self.plan.share).expect("the trips meet");
        let pairs: Vec<_> = self.revisits.pairs(first, second).collect();
        MethodScores {
            n_dims,
            n_kinds,
            consistency: measured.consistency,
            chance: measured.chance,
            kappa: kappa(measured),
            ami: adjusted_mutual_information(&pairs),
            largest_kind_share: largest_kind_share(kinds.iter().flatten().copied(), n_kinds),
        }
    }
}

/// A model of either method, with the same frames, landmarks, number of dimensions and number of kinds, and perhaps one of
/// the frames as they are, with the same number of kinds.
#[derive(Clone, Debug)]
pub struct Rivals {
    /// Geodesics.
    pub isomap: Model,
    /// Straight distances.
    pub pca: Model,
    /// No embedding.
    pub native: Option<Model>,
}

impl Rivals {
    /// Fits the rivals of a model: the methods that it does not use, to its reference frames, each of which counts for all
    /// frames that it stands for ([`refit`]).
    ///
    /// Native space has no dimensions to match: of a model of it, Isomap's rival has as many as the evidence speaks for, and
    /// that of principal components as many as Isomap's.
    ///
    /// # Errors
    /// If another method cannot be fitted with as many dimensions and kinds.
    pub fn of(model: Model, progress: &mut Progress) -> Result<Self, EvaluateError> {
        let mut isomap_of = |model: &Model, size| {
            refit(model, Method::Isomap, size, &mut fitting(progress))
                .map_err(|error| EvaluateError::Refit { method: "Isomap", error })
        };
        let (isomap, native) = match model.manifest().plan.method {
            Method::Pca => {
                let isomap = isomap_of(&model, Size::Matched)?;
                return Ok(Self { isomap, pca: model, native: None });
            }
            Method::Isomap => (model, None),
            Method::Native => (isomap_of(&model, Size::SameKinds)?, Some(model)),
        };
        let pca = refit(&isomap, Method::Pca, Size::Matched, &mut fitting(progress))
            .map_err(|error| EvaluateError::Refit { method: "principal components", error })?;
        Ok(Self { isomap, pca, native })
    }
}

/// Measures how consistent kinds are where two trips meet, by both methods and at random.
///
/// # Panics
/// If the trips are not of the models' sensor: a bug of the caller, whom [`Meeting::find`] asked for it.
pub fn evaluate(rivals: &Rivals, meeting: &Meeting, progress: &mut Progress) -> Evaluation {
    let Rivals { isomap, pca, native } = rivals;
    assert_eq!(meeting.layout, isomap.layout(), "trips and models are of one sensor");
    let n_methods = 2 + u64::from(native.is_some());
    let n_frames = n_methods * meeting.trips.iter().map(|trip| trip.frames.len() as u64).sum::<u64>();
    let mut n_done = 0;
    let mut classified = || {
        n_done += 1;
        progress(Stage::Classifying, n_done, n_frames);
    };
    let mut score = |model: &Model| {
        let kinds = meeting.classify(model, &mut classified);
        (meeting.score(model.manifest().n_dims, model.mixture().n_kinds(), &kinds), kinds)
    };
    let (isomap, isomap_kinds) = score(isomap);
    Evaluation {
        radius_m: meeting.plan.radius_m,
        share: meeting.plan.share,
        revisited: meeting.revisits.share_revisited(),
        methods: Methods {
            isomap,
            pca: score(pca).0,
            native: native.as_ref().map(|native| score(native).0),
            random: meeting.score(0, isomap.n_kinds, &meeting.random(isomap.n_kinds)),
        },
        isomap_kinds,
    }
}

/// Share of the most frequent kind among frames; 0 without frames.
fn largest_kind_share(kinds: impl Iterator<Item = usize>, n_kinds: usize) -> f64 {
    let mut n_frames_of = vec![0_usize; n_kinds];
    kinds.for_each(|kind| n_frames_of[kind] += 1);
    let n_frames: usize = n_frames_of.iter().sum();
    let largest = n_frames_of.into_iter().max().unwrap_or(0);
    largest as f64 / n_frames.max(1) as f64
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
#[derive(Debug)]
struct Placed<'a> {
    places: Places,
    /// What the sensor saw and the robot had been told.
    frames: Vec<(&'a [u16], Option<Command>)>,
}

impl<'a> Placed<'a> {
    fn of(trip: &'a LoadedTrip) -> Result<Self, EvaluateError> {
        let commands = trip.commands.iter().map(|command| command.map(of_model));
        let known = trip.poses.iter().zip(trip.frames().zip(commands));
        let (poses, frames): (Vec<_>, Vec<_>) =
            known.filter_map(|(pose, frame)| Some(((*pose)?, frame))).unzip();
        match poses.is_empty() {
            true => Err(EvaluateError::NoPoses { path: trip.path.clone() }),
            false => Ok(Self { places: Places { poses }, frames }),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_largest_kind_is_counted_and_a_kind_without_frames_does_no_harm() {
        assert_eq!(largest_kind_share([0, 2, 2, 2].into_iter(), 4), 0.75);
    }
}
