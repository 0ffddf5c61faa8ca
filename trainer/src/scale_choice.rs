//! The scale on which frames are compared, and how the trip decides it.
//!
//! A scale on which frames of one place look alike, and those of others do not, makes kinds that last: so of models of as many
//! kinds, the one whose kinds change most seldom is taken, by the persistence s that it has learnt ([`kinds_model::Filter`]).
//! No pose and no label is asked for. On ten recorded and simulated trips this found the scale that was most consistent on a second
//! trip, or one within its interval, for all but one of Crunch's.

use std::ops::Range;

use kinds_model::{EmPlan, FitPlan, FrameSource, Method, Origin, ResponsePlan, Scale, ScaleTrial, fit};
use serde::Deserialize;

use crate::load::LoadError;
use crate::progress::{Progress, fitting};
use crate::trip_frames::TripFrames;

/// The scale on which frames are compared.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Deserialize)]
pub enum ScaleChoice {
    /// Metres.
    #[serde(alias = "range")]
    Range,
    /// Logarithms.
    #[serde(alias = "log")]
    Log,
    /// Inverses.
    #[serde(alias = "inverse")]
    Inverse,
    /// That of these whose kinds change most seldom.
    #[serde(alias = "auto")]
    Auto,
}

/// Scales that are tried, the usual one first: another one must be better to be taken.
const TRIED: [Scale; 3] = [Scale::Inverse, Scale::Log, Scale::Range];

/// How much more often than the most lasting kinds those of a scale may change that is more usual: by this factor, or by so many
/// standard deviations of the difference, changes being as independent as a Poisson process has them. Of a trip in which kinds change
/// ten times, no scale is better than another.
const MARGIN: f64 = 1.25;
const N_DEVIATIONS: f64 = 2.0;

/// Frames that scales are tried on, at most, and the stretches that they are of in a longer trip: persistence is of frames that
/// follow each other.
const N_FRAMES_MAX: usize = 1000;
const N_STRETCHES: usize = 10;

/// What a trial spares: scales are only compared with each other.
const N_NEIGHBORS: usize = 10;
const N_LANDMARKS: usize = 250;
const N_STARTS: usize = 3;

impl ScaleChoice {
    /// The scale, unless the trip is to decide.
    pub(crate) fn scale(self) -> Option<Scale> {
        match self {
            Self::Range => Some(Scale::Range),
            Self::Log => Some(Scale::Log),
            Self::Inverse => Some(Scale::Inverse),
            Self::Auto => None,
        }
    }
}

/// Tries scales, and returns the one by which kinds last, with what was seen. None where there are too few frames for a model by any
/// scale: whoever trains with the usual one will say so.
///
/// * `origin` — of which trips the frames are
///
/// # Errors
/// If frames cannot be read.
pub(crate) fn choose(
    frames: &mut TripFrames,
    origin: &Origin,
    plan: &FitPlan,
    progress: &mut Progress,
) -> Result<Option<(Scale, Vec<ScaleTrial>)>, LoadError> {
    let n_frames = frames.n_frames();
    let stretches = stretches(n_frames);
    let n_tried: usize = stretches.iter().map(Range::len).sum();
    let counts = read(frames, &stretches, plan.sensor.n_readings())?;
    let n_in_trips = match stretches.len() {
        1 => origin.trips(n_frames),
        _ => stretches.iter().map(Range::len).collect(),
    };
    let mut persistence_by = |scale| {
        let origin = Origin { n_frames: n_in_trips.clone(), ..Origin::default() };
        let model = fit(counts.clone(), &tried(plan, scale), origin, &mut fitting(progress)).ok()?;
        Some(ScaleTrial { scale, persistence: model.manifest().persistence })
    };
    let trials: Vec<ScaleTrial> = TRIED.into_iter().filter_map(&mut persistence_by).collect();
    Ok(most_lasting(&trials, n_tried).map(|scale| (scale, trials)))
}

/// How a scale is tried.
fn tried(plan: &FitPlan, scale: Scale) -> FitPlan {
    FitPlan {
        response: ResponsePlan { scale, ..plan.response },
        n_neighbors: match plan.method {
            Method::Isomap => plan.n_neighbors.or(Some(N_NEIGHBORS)),
            Method::Pca | Method::Native => plan.n_neighbors,
        },
        n_landmarks: plan.n_landmarks.min(N_LANDMARKS),
        n_kinds: Some(n_kinds(plan)),
        em: EmPlan { n_starts: N_STARTS.min(plan.em.n_starts), ..plan.em.clone() },
        ..plan.clone()
    }
}

/// Kinds of every trial: the more there are, the more often they change.
fn n_kinds(plan: &FitPlan) -> usize {
    plan.n_kinds.unwrap_or(plan.n_kinds_min).max(2)
}

/// The first scale whose kinds change hardly more often than those of any other.
///
/// * `n_frames` — that scales were tried on
fn most_lasting(trials: &[ScaleTrial], n_frames: usize) -> Option<Scale> {
    let n_changes = |trial: &ScaleTrial| (1.0 - trial.persistence) * n_frames as f64;
    let least = trials.iter().map(n_changes).fold(f64::INFINITY, f64::min);
    let is_near = |n: f64| n <= MARGIN * least || n - least <= N_DEVIATIONS * (n + least).sqrt();
    trials.iter().find(|trial| is_near(n_changes(trial))).map(|trial| trial.scale)
}

/// What speaks for each scale that was tried: `kinds last 4.0 frames by inverse, 10.0 by log`.
pub fn kept_by_scale(trials: &[ScaleTrial]) -> String {
    let of_each = trials.iter().enumerate().map(|(index, trial)| {
        let frames = if index == 0 { " frames" } else { "" };
        format!("{:.1}{frames} by {}", 1.0 / (1.0 - trial.persistence), name(trial.scale))
    });
    format!("kinds last {}", of_each.collect::<Vec<_>>().join(", "))
}

fn name(scale: Scale) -> &'static str {
    match scale {
        Scale::Range => "range",
        Scale::Log => "log",
        Scale::Inverse => "inverse",
    }
}

/// Which frames are looked at: all, or stretches that begin at equal distances.
fn stretches(n_frames: usize) -> Vec<Range<usize>> {
    if n_frames <= N_FRAMES_MAX {
        return std::iter::once(0..n_frames).collect();
    }
    let length = N_FRAMES_MAX / N_STRETCHES;
    let begin = |stretch: usize| stretch * (n_frames - length) / (N_STRETCHES - 1);
    (0..N_STRETCHES).map(|stretch| begin(stretch)..begin(stretch) + length).collect()
}

fn read(
    frames: &mut TripFrames,
    stretches: &[Range<usize>],
    n_readings: usize,
) -> Result<Vec<u16>, LoadError> {
    let mut counts = Vec::with_capacity(stretches.iter().map(Range::len).sum::<usize>() * n_readings);
    let mut frame = vec![0; n_readings];
    frames.rewind()?;
    for index in 0..stretches.last().map_or(0, |last| last.end) {
        frames.read(&mut frame)?;
        if stretches.iter().any(|stretch| stretch.contains(&index)) {
            counts.extend_from_slice(&frame);
        }
    }
    Ok(counts)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_usual_scale_is_taken_unless_kinds_last_clearly_longer_by_another() {
        let trials = |changes: [f64; 3]| {
            let both = TRIED.into_iter().zip(changes);
            both.map(|(scale, change)| ScaleTrial { scale, persistence: 1.0 - change }).collect::<Vec<_>>()
        };
        let of = |changes, n_frames| most_lasting(&trials(changes), n_frames);
        assert_eq!(of([0.010, 0.009, 0.0081], 100_000), Some(Scale::Inverse));
        assert_eq!(of([0.23, 0.16, 0.12], 1000), Some(Scale::Range));
        assert_eq!(of([0.227, 0.153, 0.1524], 1000), Some(Scale::Log));
        // Thirteen changes and eight may be chance, a hundred times as many are not.
        assert_eq!(of([0.013, 0.008, 0.008], 1000), Some(Scale::Inverse));
        assert_eq!(of([0.013, 0.008, 0.008], 100_000), Some(Scale::Log));
        assert_eq!(most_lasting(&trials([0.5, 0.5, 0.1])[2..], 10), Some(Scale::Range));
        assert_eq!(most_lasting(&[], 10), None);
        assert_eq!(
            kept_by_scale(&trials([0.25, 0.1, 0.1])[..2]),
            "kinds last 4.0 frames by inverse, 10.0 by log"
        );
    }

    #[test]
    fn of_long_trips_some_stretches_from_end_to_end_are_looked_at() {
        assert_eq!(
            stretches(N_FRAMES_MAX).iter().map(|all| (all.start, all.end)).collect::<Vec<_>>(),
            [(0, N_FRAMES_MAX)]
        );
        for n_frames in [N_FRAMES_MAX + 1, 100_000] {
            let stretches = stretches(n_frames);
            assert_eq!(stretches.iter().map(Range::len).sum::<usize>(), N_FRAMES_MAX);
            assert_eq!((stretches[0].start, stretches[N_STRETCHES - 1].end), (0, n_frames));
            assert!(stretches.windows(2).all(|pair| pair[0].end <= pair[1].start));
        }
    }
}
