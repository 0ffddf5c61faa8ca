//! The scale on which frames are compared, and how it is chosen where the trip is to decide.
//!
//! A scale on which frames of one place look alike, and those of others do not, makes kinds that last: so of models of as many
//! kinds, the one whose kinds change most seldom is taken, by the persistence s that it has learnt ([`kinds_model::Filter`]).
//! No pose and no label is asked for. On ten recorded and simulated trips this found the scale that was most consistent on a second
//! trip, or one within its interval, for all but one of Crunch's.

use std::ops::Range;

use kinds_model::{EmPlan, FitPlan, FrameSource, Origin, ResponsePlan, Scale, fit};
use serde::Deserialize;

use crate::load::LoadError;
use crate::progress::{Progress, fitting};
use crate::train::TrainError;
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

/// How much more often than the most lasting kinds those of a scale may change that is more usual.
const MARGIN: f64 = 1.25;

/// Frames that scales are tried on, at most, and the stretches that they are of in a longer trip: persistence is of frames that
/// follow each other.
const N_FRAMES_MAX: usize = 2000;
const N_STRETCHES: usize = 10;

/// Starts of each trial's mixture.
const N_STARTS: usize = 3;

/// A scale, and how often kinds change by it: 1 − s.
type Trial = (Scale, f64);

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

/// The plan with the scale by which kinds last, and a sentence on how it was found.
///
/// * `origin` — of which trips the frames are
///
/// # Errors
/// If frames cannot be read, or make no model by any scale: then that of the first.
pub(crate) fn choose(
    frames: &mut TripFrames,
    origin: &Origin,
    plan: FitPlan,
    progress: &mut Progress,
) -> Result<(FitPlan, String), TrainError> {
    let n_frames = frames.n_frames();
    let stretches = stretches(n_frames);
    let counts = read(frames, &stretches, plan.sensor.n_readings())?;
    let n_in_trips = match stretches.len() {
        1 => origin.trips(n_frames),
        _ => stretches.iter().map(Range::len).collect(),
    };
    let n_kinds = plan.n_kinds.unwrap_or(plan.n_kinds_min).max(2);
    let mut fit_by = |scale| {
        let tried = FitPlan {
            response: ResponsePlan { scale, ..plan.response },
            n_kinds: Some(n_kinds),
            em: EmPlan { n_starts: N_STARTS.min(plan.em.n_starts), ..plan.em.clone() },
            ..plan.clone()
        };
        let origin = Origin { n_frames: n_in_trips.clone(), ..Origin::default() };
        let model = fit(counts.clone(), &tried, origin, &mut fitting(progress))?;
        Ok((scale, 1.0 - model.manifest().persistence))
    };
    let fitted = TRIED.map(&mut fit_by);
    let trials: Vec<Trial> = fitted.iter().flatten().copied().collect();
    match (most_lasting(&trials), fitted) {
        (Some(scale), _) => {
            let response = ResponsePlan { scale, ..plan.response };
            Ok((FitPlan { response, ..plan }, told(scale, n_kinds, &trials)))
        }
        (None, [first, ..]) => Err(TrainError::Fit(first.expect_err("no scale made a model"))),
    }
}

/// The first scale whose kinds change hardly more often than those of any other.
fn most_lasting(trials: &[Trial]) -> Option<Scale> {
    let least = trials.iter().map(|(_, change)| *change).fold(f64::INFINITY, f64::min);
    trials.iter().find(|(_, change)| *change <= MARGIN * least).map(|(scale, _)| *scale)
}

fn told(scale: Scale, n_kinds: usize, trials: &[Trial]) -> String {
    let of_each: Vec<String> = trials
        .iter()
        .map(|(scale, change)| format!("{:.1} frames by {}", 1.0 / change, name(*scale)))
        .collect();
    format!(
        "scale: {}, by which {n_kinds} kinds are kept longest or nearly so: {}",
        name(scale),
        of_each.join(", ")
    )
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
        let of = |changes: [f64; 3]| most_lasting(&TRIED.into_iter().zip(changes).collect::<Vec<_>>());
        assert_eq!(of([0.010, 0.009, 0.0081]), Some(Scale::Inverse));
        assert_eq!(of([0.23, 0.16, 0.12]), Some(Scale::Range));
        assert_eq!(of([0.227, 0.153, 0.1524]), Some(Scale::Log));
        assert_eq!(most_lasting(&[(Scale::Range, 0.5)]), Some(Scale::Range));
        assert_eq!(most_lasting(&[]), None);
        assert_eq!(
            told(Scale::Log, 4, &[(Scale::Inverse, 0.25), (Scale::Log, 0.1)]),
            "scale: log, by which 4 kinds are kept longest or nearly so: 4.0 frames by inverse, 10.0 frames by log"
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
