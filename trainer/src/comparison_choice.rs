//! By what frames are compared, and how the trip decides it.
//!
//! What frames of one place have in common, and those of others do not, makes kinds that last: so of models of as many kinds, the one
//! whose kinds change most seldom is taken. No pose and no label is asked for. How seldom is the persistence s of a hidden Markov
//! model ([`kinds_model::Filter`]), learnt from frames that kinds were fitted to and, since slow directions are made to change
//! little on just these, from as many that they were not: the trip is cut into blocks, a model is learnt from every second one and
//! judged on the others as well, and the other way round. What counts is the geometric mean of all four.
//!
//! Of recorded trips this took the usual way, by which their kinds were the most consistent on a second trip or near it; of simulated
//! Chew slow directions, by which they were so by far; of simulated Crunch slow directions, which made no difference
//! (benches/RESULTS.md). Principal components are not among what is tried: their kinds last because one is large.

use std::ops::Range;
use std::str::FromStr;
use std::sync::Arc;

use kinds_model::{
    Classifier, ComparisonTrial, FitPlan, FrameSource, Method, MetricPlan, Origin, ResponsePlan, Scale,
    WhiteningPlan, fit, learn_persistence,
};
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
    /// That of these by which kinds change most seldom.
    #[serde(alias = "auto")]
    Auto,
}

/// Whether frames are compared by slow directions of their readings.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Deserialize)]
#[serde(deny_unknown_fields)]
pub enum WhiteningChoice {
    /// By the readings themselves.
    #[serde(alias = "off")]
    Off,
    /// By that of the two by which kinds change most seldom.
    #[serde(alias = "auto")]
    Auto,
    /// By so many, of so many principal components: see [`WhiteningPlan`].
    #[serde(alias = "slow")]
    Slow {
        /// Principal components.
        n_components: usize,
        /// Slow directions, at most as many.
        n_directions: usize,
    },
}

/// Not slow directions that a flag can ask for.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("whitening is {0}; it must be off, auto, or a number of slow directions such as 6")]
pub struct WhiteningChoiceError(String);

/// From a flag.
impl FromStr for WhiteningChoice {
    type Err = WhiteningChoiceError;

    fn from_str(text: &str) -> Result<Self, WhiteningChoiceError> {
        match text {
            "off" => Ok(Self::Off),
            "auto" => Ok(Self::Auto),
            _ => match text.parse() {
                Ok(n_directions) => {
                    let n_components = WhiteningPlan::default().n_components;
                    Ok(Self::Slow { n_components, n_directions })
                }
                Err(_) => Err(WhiteningChoiceError(text.to_string())),
            },
        }
    }
}

/// By what frames may be compared.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Compared {
    pub(crate) scale: Scale,
    pub(crate) whitening: Option<WhiteningPlan>,
}

/// Scales that are tried, the usual one first.
const SCALES: [Scale; 3] = [Scale::Inverse, Scale::Log, Scale::Range];

/// How much more often than the most lasting kinds the usual ones may change before they give way: by this factor, and by so many
/// standard deviations of the difference, changes being as independent as a Poisson process has them. Of a trip in which kinds
/// change ten times, nothing is better than anything else.
const MARGIN: f64 = 1.1;
const N_DEVIATIONS: f64 = 2.0;

/// Frames and readings that are tried on, at most, and the blocks that they are of, from end to end of a trip: persistence is of
/// frames that follow each other.
const N_FRAMES_MAX: usize = 2000;
const N_READINGS_MAX: usize = 20_000_000;
const N_BLOCKS: usize = 10;

/// What a trial spares: models are only compared with each other.
const N_NEIGHBORS: usize = 10;
const N_LANDMARKS: usize = 250;

/// What is to be tried, the usual way first; one thing where there is nothing to choose.
///
/// A person who asks for a scale and says nothing of directions means the readings.
pub(crate) fn candidates(
    scale: Option<ScaleChoice>,
    whitening: Option<WhiteningChoice>,
    plan: &FitPlan,
) -> Vec<Compared> {
    let is_left = scale.is_none_or(|scale| scale == ScaleChoice::Auto);
    let scales = if is_left { SCALES.to_vec() } else { vec![plan.response.scale] };
    let usual = WhiteningPlan::default();
    let can_be_whitened = plan.method != Method::Native
        && plan.metric == MetricPlan::Euclidean
        && plan.sensor.n_readings() > usual.n_directions
        && plan.n_dims.is_none_or(|n_dims| n_dims <= usual.n_directions);
    let whitenings = match whitening {
        Some(WhiteningChoice::Slow { .. }) => vec![plan.whitening],
        Some(WhiteningChoice::Auto) if can_be_whitened => vec![None, Some(usual)],
        None if is_left && can_be_whitened => vec![None, Some(usual)],
        _ => vec![None],
    };
    let by = |whitening| scales.iter().map(move |&scale| Compared { scale, whitening });
    whitenings.into_iter().flat_map(by).collect()
}

/// Tries what frames may be compared by, and returns that by which kinds last, with what was seen. None where there are too few
/// frames for a model by any: whoever trains in the usual way will say so.
///
/// * `candidates` — the usual one first
/// * `trips` — frames of each trip
///
/// # Errors
/// If frames cannot be read.
pub(crate) fn choose(
    frames: &mut TripFrames,
    candidates: &[Compared],
    trips: &[usize],
    plan: &FitPlan,
    progress: &mut Progress,
) -> Result<Option<(Compared, Vec<ComparisonTrial>)>, LoadError> {
    let n_readings = plan.sensor.n_readings();
    let blocks = blocks(frames.n_frames(), (N_READINGS_MAX / n_readings).min(N_FRAMES_MAX));
    let halves = Halves::read(frames, &blocks, trips, n_readings)?;
    let attempt = |&compared: &Compared| halves.attempt(&tried(plan, compared), progress);
    let trials: Vec<ComparisonTrial> = candidates.iter().filter_map(attempt).collect();
    Ok(most_lasting(&trials, halves.n_frames()).map(|best| {
        let ComparisonTrial { scale, whitening, .. } = *best;
        (Compared { scale, whitening }, trials.clone())
    }))
}

/// A model as it is tried.
fn tried(plan: &FitPlan, compared: Compared) -> FitPlan {
    FitPlan {
        response: ResponsePlan { scale: compared.scale, ..plan.response },
        whitening: compared.whitening,
        n_neighbors: match plan.method {
            Method::Isomap => plan.n_neighbors.or(Some(N_NEIGHBORS)),
            Method::Pca | Method::Native => plan.n_neighbors,
        },
        n_landmarks: plan.n_landmarks.min(N_LANDMARKS),
        n_kinds: Some(n_kinds(plan)),
        ..plan.clone()
    }
}

/// Kinds of every trial: the more there are, the more often they change.
fn n_kinds(plan: &FitPlan) -> usize {
    plan.n_kinds.unwrap_or(plan.n_kinds_min).max(2)
}

/// The usual trial, the first one, unless kinds clearly outlast its: then the most lasting.
///
/// * `n_frames` — that were tried on
fn most_lasting(trials: &[ComparisonTrial], n_frames: usize) -> Option<&ComparisonTrial> {
    let n_changes = |trial: &ComparisonTrial| n_frames as f64 / trial.n_frames_lasting();
    let usual = trials.first()?;
    let best = trials.iter().min_by(|a, b| n_changes(a).total_cmp(&n_changes(b)))?;
    let (of_usual, least) = (n_changes(usual), n_changes(best));
    let outlasts = of_usual > MARGIN * least && of_usual - least > N_DEVIATIONS * (of_usual + least).sqrt();
    Some(if outlasts { best } else { usual })
}

/// What speaks for each that was tried: `kinds last 4.0 frames by inverse, 10.0 by log; along 4 slow directions 12.0 by inverse`.
pub fn kept_by_each(trials: &[ComparisonTrial]) -> String {
    let of_trial = |(index, trial): (usize, &ComparisonTrial)| {
        let frames = if index == 0 { " frames" } else { "" };
        format!("{:.1}{frames} by {}", trial.n_frames_lasting(), name(trial.scale))
    };
    let of_some = |trials: &[ComparisonTrial]| {
        let along = match trials[0].whitening {
            None => String::new(),
            Some(WhiteningPlan { n_directions, .. }) => format!("along {n_directions} slow directions "),
        };
        along + &trials.iter().enumerate().map(of_trial).collect::<Vec<_>>().join(", ")
    };
    let parts = trials.chunk_by(|a, b| a.whitening == b.whitening).map(of_some);
    format!("kinds last {}", parts.collect::<Vec<_>>().join("; "))
}

fn name(scale: Scale) -> &'static str {
    match scale {
        Scale::Range => "range",
        Scale::Log => "log",
        Scale::Inverse => "inverse",
    }
}

/// Blocks of frames that begin at equal distances, from end to end.
fn blocks(n_frames: usize, n_frames_max: usize) -> Vec<Range<usize>> {
    let length = n_frames.min(n_frames_max) / N_BLOCKS;
    let begin = |block: usize| block * (n_frames - length) / (N_BLOCKS - 1);
    (0..N_BLOCKS).map(|block| begin(block)..begin(block) + length).collect()
}

/// Every second block, and the others.
#[derive(Default)]
struct Halves([Half; 2]);

/// Frames of some blocks.
#[derive(Default)]
struct Half {
    /// Raw counts, shape `(n_frames, n_readings)`.
    counts: Vec<u16>,
    /// Frames that follow each other, of each block; of each trip, where one begins within a block.
    n_frames: Vec<usize>,
}

impl Halves {
    /// * `trips` — frames of each trip
    fn read<E: Send>(
        frames: &mut dyn FrameSource<Error = E>,
        blocks: &[Range<usize>],
        trips: &[usize],
        n_readings: usize,
    ) -> Result<Self, E> {
        let next_begins = |end: &mut usize, n_frames: &usize| {
            *end += n_frames;
            Some(*end)
        };
        let begins: Vec<usize> = trips.iter().scan(0, next_begins).collect();
        let mut halves = Self::default();
        let mut frame = vec![0; n_readings];
        frames.rewind()?;
        let mut index = 0;
        for (block, range) in blocks.iter().enumerate() {
            let Half { counts, n_frames } = &mut halves.0[block % 2];
            while index < range.end {
                frames.read(&mut frame)?;
                if range.contains(&index) {
                    if index == range.start || begins.contains(&index) {
                        n_frames.push(0);
                    }
                    counts.extend_from_slice(&frame);
                    *n_frames.last_mut().expect("a block has begun") += 1;
                }
                index += 1;
            }
        }
        Ok(halves)
    }

    fn n_frames(&self) -> usize {
        self.0.iter().flat_map(|half| &half.n_frames).sum()
    }

    /// How long kinds last, of models of this plan. None if the frames make none.
    fn attempt(&self, plan: &FitPlan, progress: &mut Progress) -> Option<ComparisonTrial> {
        let [even, odd] = &self.0;
        let [from_even, from_odd] = [even.learn(odd, plan, progress)?, odd.learn(even, plan, progress)?];
        let mean = |a: f64, b: f64| 1.0 - ((1.0 - a) * (1.0 - b)).sqrt();
        Some(ComparisonTrial {
            scale: plan.response.scale,
            whitening: plan.whitening,
            persistence: mean(from_even.0, from_odd.0),
            persistence_held_out: mean(from_even.1, from_odd.1),
        })
    }
}

impl Half {
    /// Learns a model, and returns the persistence of its kinds on these frames and on the others.
    fn learn(&self, others: &Self, plan: &FitPlan, progress: &mut Progress) -> Option<(f64, f64)> {
        let origin = Origin { n_frames: self.n_frames.clone(), ..Origin::default() };
        let model = Arc::new(fit(self.counts.clone(), plan, origin, &mut fitting(progress)).ok()?);
        let mut classifier = Classifier::new(Arc::clone(&model));
        let mut posteriors = Vec::new();
        for frame in others.counts.chunks_exact(plan.sensor.n_readings()) {
            posteriors.extend_from_slice(&classifier.classify(frame).probabilities);
        }
        let held_out = learn_persistence(&posteriors, model.mixture().weights(), &others.n_frames);
        Some((model.manifest().persistence, held_out))
    }
}

#[cfg(test)]
mod tests {
    use kinds_model::SensorLayout;

    use super::*;

    fn ring(columns: u32) -> SensorLayout {
        SensorLayout { rows: 1, columns, metres_per_count: 0.001 }
    }

    fn trials(n_changes: &[f64]) -> Vec<ComparisonTrial> {
        let plan = FitPlan::new(ring(16), ResponsePlan::new(Scale::Inverse, 4.0), 0);
        let trial = |(compared, &changes): (Compared, &f64)| ComparisonTrial {
            scale: compared.scale,
            whitening: compared.whitening,
            persistence: 1.0 - changes,
            persistence_held_out: 1.0 - changes,
        };
        candidates(None, None, &plan).into_iter().zip(n_changes).map(trial).collect()
    }

    fn place(n_changes: &[f64], n_frames: usize) -> usize {
        let trials = trials(n_changes);
        let best = most_lasting(&trials, n_frames).unwrap();
        trials.iter().position(|trial| trial == best).unwrap()
    }

    #[test]
    fn the_usual_way_stays_unless_kinds_clearly_outlast_its() {
        assert_eq!(place(&[0.010, 0.0095, 0.0092], 100_000), 0);
        assert_eq!(place(&[0.23, 0.16, 0.12, 0.13], 1000), 2);
        assert_eq!(place(&[0.227, 0.153, 0.1524, 0.1, 0.09, 0.2], 1000), 4);
        // Thirteen changes and eight may be chance, a hundred times as many are not.
        assert_eq!(place(&[0.013, 0.008, 0.009], 1000), 0);
        assert_eq!(place(&[0.013, 0.008, 0.009], 100_000), 1);
        assert_eq!(most_lasting(&[], 10), None);
        assert_eq!(
            kept_by_each(&trials(&[0.25, 0.1, 0.1, 0.05])),
            "kinds last 4.0 frames by inverse, 10.0 by log, 10.0 by range; along 4 slow directions 20.0 frames by inverse"
        );
    }

    #[test]
    fn kinds_must_last_on_frames_that_they_were_not_learnt_from() {
        let mut trials = trials(&[0.2, 0.2, 0.2, 0.08]);
        trials[3].persistence_held_out = 0.0;
        assert_eq!(most_lasting(&trials, 1000).unwrap().whitening, None);
        trials[3].persistence_held_out = 0.9;
        assert_eq!(most_lasting(&trials, 1000).unwrap().whitening, Some(WhiteningPlan::default()));
    }

    #[test]
    fn what_a_person_asks_for_is_not_tried() {
        let plan = FitPlan::new(ring(16), ResponsePlan::new(Scale::Log, 4.0), 0);
        let n_tried = |scale, whitening| candidates(scale, whitening, &plan).len();
        let slow = WhiteningChoice::Slow { n_components: 10, n_directions: 3 };
        assert_eq!(n_tried(None, None), 6);
        assert_eq!(n_tried(Some(ScaleChoice::Auto), None), 6);
        assert_eq!(n_tried(Some(ScaleChoice::Auto), Some(WhiteningChoice::Off)), 3);
        assert_eq!(n_tried(None, Some(slow)), 3);
        assert_eq!(n_tried(Some(ScaleChoice::Log), Some(WhiteningChoice::Auto)), 2);
        assert_eq!(
            candidates(Some(ScaleChoice::Log), None, &plan),
            [Compared { scale: Scale::Log, whitening: None }]
        );
        // Four readings have no four directions that are slower than others, five dimensions want more than four, and a ring's turn
        // has none at all.
        let few = FitPlan { sensor: ring(4), ..plan.clone() };
        let many_dims = FitPlan { n_dims: Some(5), ..plan.clone() };
        let turned = FitPlan { metric: MetricPlan::Ring { n_rings: 1 }, ..plan };
        assert_eq!(candidates(None, None, &few).len(), 3);
        assert_eq!(candidates(None, None, &many_dims).len(), 3);
        assert_eq!(candidates(None, Some(WhiteningChoice::Auto), &turned).len(), 3);
    }

    #[test]
    fn a_flag_says_off_auto_or_how_many() {
        assert_eq!("off".parse(), Ok(WhiteningChoice::Off));
        assert_eq!("auto".parse(), Ok(WhiteningChoice::Auto));
        assert_eq!("6".parse(), Ok(WhiteningChoice::Slow { n_components: 40, n_directions: 6 }));
        assert_eq!(
            "six".parse::<WhiteningChoice>().unwrap_err().to_string(),
            "whitening is six; it must be off, auto, or a number of slow directions such as 6"
        );
    }

    #[test]
    fn every_second_block_is_of_each_half_and_none_spans_two_trips() {
        let (blocks, mut frames) = (blocks(100, 40), Counted { n_frames: 100, at: 0 });
        let Halves([even, odd]) = Halves::read(&mut frames, &blocks, &[12, 88], 1).unwrap();
        // Blocks of four from 0, 10, 21, 32, …; the second trip begins within the second one.
        assert_eq!(even.n_frames, [4, 4, 4, 4, 4]);
        assert_eq!(odd.n_frames, [2, 2, 4, 4, 4, 4]);
        assert_eq!(even.counts[..8], [0, 1, 2, 3, 21, 22, 23, 24]);
        assert_eq!(odd.counts[..8], [10, 11, 12, 13, 32, 33, 34, 35]);
        assert_eq!(odd.counts[16..], [96, 97, 98, 99]);
    }

    /// Frames of one reading: their number.
    struct Counted {
        n_frames: usize,
        at: u16,
    }

    impl FrameSource for Counted {
        type Error = std::convert::Infallible;

        fn n_frames(&self) -> usize {
            self.n_frames
        }

        fn rewind(&mut self) -> Result<(), Self::Error> {
            self.at = 0;
            Ok(())
        }

        fn read(&mut self, counts: &mut [u16]) -> Result<(), Self::Error> {
            counts.fill(self.at);
            self.at += 1;
            Ok(())
        }
    }

    #[test]
    fn blocks_lie_from_end_to_end_and_do_not_meet() {
        for n_frames in [10, 99, 1000, 1001, 100_000] {
            let blocks = blocks(n_frames, 1000);
            let n_tried: usize = blocks.iter().map(Range::len).sum();
            assert_eq!(n_tried, n_frames.min(1000) / N_BLOCKS * N_BLOCKS);
            assert_eq!((blocks[0].start, blocks[N_BLOCKS - 1].end), (0, n_frames));
            assert!(blocks.windows(2).all(|pair| pair[0].end <= pair[1].start));
        }
        assert!(blocks(9, 1000).iter().all(Range::is_empty));
    }
}
