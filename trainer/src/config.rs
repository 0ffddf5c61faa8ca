//! What a person says about training (RON or flags), and the checked plan that it becomes for a sensor.

use std::time::Duration;

use kinds_model::evidence::N_KINDS_TRIED_MAX;
use kinds_model::{
    Covariance, EmPlan, FitPlan, KindsBy, LandmarkChoice, MedianPlan, Method, N_DIMS_MAX, N_KINDS_MAX,
    ResponsePlan, Scale, SensorLayout, StartsOn, WhiteningPlan,
};
use kinds_trips::Selection;
use serde::Deserialize;

use crate::comparison_choice::{ScaleChoice, WhiteningChoice};
use crate::counts_seen::CountsSeen;
use crate::landmark_number::LandmarkNumber;
use crate::metric_choice::{MetricChoice, PartsError};

/// Training as a RON file says it. Every field may be left out; then the sensor and the trips decide.
#[derive(Clone, Debug, Default, PartialEq, Deserialize)]
#[serde(default, deny_unknown_fields, rename = "Train")]
pub struct Config {
    /// Scale on which frames are compared: range, log, inverse, or auto: that of these by which kinds change most seldom on the
    /// trips. Default: auto.
    pub response: Option<ScaleChoice>,
    /// Largest useful range, metres, above 0. Default: the 99th percentile of the trips' valid readings.
    pub range_m_max: Option<f64>,
    /// Range that invalid readings are taken for, metres, 0 to `range_m_max`. Default: `range_m_max`.
    pub invalid_range_m: Option<f64>,
    /// Offset of the log and inverse scales, metres, above 0. Default: 0.3.
    pub offset_m: Option<f64>,
    /// Frames over which each reading's median is taken: 1, none; 3 or 5. Against drop-outs, at the price of one frame's delay, or
    /// two. Default: 3 where at least 3 % of the readings are missing or far off for one frame alone.
    pub median: Option<usize>,
    /// Whether frames are compared by slow directions of their readings: off; auto, if kinds change more seldom by four of them; or
    /// `slow(n_components: 40, n_directions: 4)`, at most as many as principal components, which are at most 1000. Default: auto
    /// where the scale is left to the trips too, else off.
    pub whitening: Option<WhiteningChoice>,
    /// How far apart frames are on that scale: `euclidean`; `Weighted([1, 1, 0.5])`, a weight of at least 0 for each reading;
    /// `ring`, at the nearest turn, each row of the sensor being a ring; `rings(2)`, where the readings are so many rings; or
    /// `parts([16, 19840])`, where those of so many readings each count alike. Default: euclidean.
    pub metric: Option<MetricChoice>,
    /// Most frames that the model keeps, at least 1. Of longer trips it keeps as many that cover them, and learns kinds from
    /// all. Default: 4000.
    pub frames: Option<usize>,
    /// Isomap, PCA, both of them side by side, or native space. Default: Isomap.
    pub method: Option<MethodChoice>,
    /// Neighbours in the graph, at least 1. Default: the fewest of 10 to 30 that leave few frames beyond bridges and
    /// a residual variance within 0.01 of the least; fewer than 10 where so many make a short circuit.
    pub neighbors: Option<usize>,
    /// Whether frames that follow each other in a trip are neighbours however unlike. Default: false.
    pub consecutive_edges: Option<bool>,
    /// Landmarks: all, a count of at least 1, or a share such as "25%". Default: 1000, or all frames if there are fewer.
    pub landmarks: Option<LandmarkNumber>,
    /// How landmarks are chosen: random, farthest or k_means. Default: random.
    pub landmark_choice: Option<LandmarkChoice>,
    /// Dimensions, 1 to 32. Default: two more than where the residual variance bends.
    pub dims: Option<usize>,
    /// Kinds, 1 to 64. Default: as many as the evidence speaks for.
    pub kinds: Option<usize>,
    /// Fewest kinds, 1 to 20, where none are given and no Dirichlet process chooses. Default: 4, since fewer tell a program little.
    pub kinds_min: Option<usize>,
    /// What the number of kinds is chosen by where none is given: bic_neff, the least BIC of 1 to 20 for as many frames as
    /// are independent; held_out, the likeliest of 1 to 20 for stretches of the trip that were held out; or dirichlet, what a
    /// Dirichlet process keeps of 20. Default: bic_neff.
    pub kinds_by: Option<KindsBy>,
    /// Shape of the kinds: full, tied, diagonal or spherical covariances. Default: full.
    pub covariance: Option<Covariance>,
    /// Starts of the mixture, at least 1. Default: 10.
    pub starts: Option<usize>,
    /// Coordinates that starts cluster: plain, whitened, or both in turn. Default: plain.
    pub starts_on: Option<StartsOn>,
    /// Least variance of a kind in any direction, share of the mean variance, above 0 and below 1. Default: 0.001.
    pub covariance_floor: Option<f64>,
    /// Whether kinds are fitted with the knowledge that frames which follow each other are mostly of one kind. Default: false.
    pub over_time: Option<bool>,
    /// Seed of landmarks and mixture. Default: 0.
    pub seed: Option<u64>,
    /// Metres per count that readings are stored in, above 0. Default: 0.001.
    pub metres_per_count: Option<f64>,
    /// Topic of the frames, or several whose frames are joined, with commas between them: the first leads. Default: the only one
    /// that fits, or all single ranges.
    pub frames_topic: Option<String>,
    /// Of several topics, how much older than the first one's frames those of the others may be, whole milliseconds.
    /// Default: 250.
    pub tolerance_ms: Option<u32>,
    /// Topic of the poses. Default: the only one that fits.
    pub poses_topic: Option<String>,
    /// Topic of the commands. Default: the only one that fits, and none of several.
    pub commands_topic: Option<String>,
    /// What the robot was told to do, as a part of each frame. Default: frames are compared by readings alone.
    pub commands: CommandsConfig,
}

/// How frames are compared by commands.
#[derive(Clone, Debug, Default, PartialEq, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct CommandsConfig {
    /// The commands' part in the mean squared distance between frames, as a multiple of the readings' part: half of it by
    /// speed forward and half by turn. At least 0. Default: 0, by readings alone.
    pub weight: Option<f64>,
}

/// Which models are to be learnt from the frames.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Deserialize)]
pub enum MethodChoice {
    /// One, by geodesics.
    #[serde(alias = "isomap")]
    Isomap,
    /// One, by principal components.
    #[serde(alias = "pca")]
    Pca,
    /// One, of the readings as they are.
    #[serde(alias = "native")]
    Native,
    /// One by geodesics, and two by principal components to compare it with: one of their own size and one of its.
    #[serde(alias = "both")]
    Both,
}

/// Why a configuration is no plan.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum ConfigError {
    /// Not RON, or not these fields.
    #[error("line {line}, column {column}: {reason}")]
    Ron {
        /// Line, from 1.
        line: usize,
        /// Column, from 1.
        column: usize,
        /// What is wrong there.
        reason: String,
    },
    /// A number of kinds, and what to choose it by.
    #[error(
        "kinds is {n_kinds} and kinds_by is {by}: a number of kinds is either given or chosen; leave out one of them"
    )]
    GivenAndChosen {
        /// The number.
        n_kinds: usize,
        /// What to choose it by, in a configuration's word.
        by: &'static str,
    },
    /// A Dirichlet process of kinds of another shape.
    #[error(
        "kinds_by is dirichlet and covariance is {covariance}: a Dirichlet process has kinds with full covariances; leave \
         out covariance, or choose by bic_neff or held_out"
    )]
    NotFull {
        /// The shape asked for.
        covariance: Covariance,
    },
    /// Parts that are not what the sensor consists of.
    #[error(transparent)]
    Parts(#[from] PartsError),
    /// A number outside its limits.
    #[error("{field} is {value}; it must be {limit}")]
    Limit {
        /// Which field or flag.
        field: &'static str,
        /// What was given.
        value: f64,
        /// What is allowed, in words.
        limit: String,
    },
}

/// Reference frames that keep a trip of hours within minutes: the cost of their neighbours grows with their square.
const USUAL_FRAMES_MAX: usize = 4000;
const USUAL_KINDS_MIN: usize = 4;

/// Principal components of a thousand frames at most.
const N_COMPONENTS_MAX: usize = 1000;

/// Landmarks that keep a trip of an hour within seconds: the eigenvalues' cost grows with their cube.
pub(crate) const N_LANDMARKS_USUAL: usize = 1000;

impl Config {
    /// Reads a configuration.
    ///
    /// # Errors
    /// With line and column, if the text is not RON or has a field that there is not.
    pub fn from_ron(text: &str) -> Result<Self, ConfigError> {
        let options =
            ron::Options::default().with_default_extension(ron::extensions::Extensions::IMPLICIT_SOME);
        options.from_str(text).map_err(|error| ConfigError::Ron {
            line: error.span.start.line,
            column: error.span.start.col,
            reason: error.code.to_string(),
        })
    }

    /// What is set in `over` replaces what is set here. A number of kinds replaces what it was to be chosen by, and the other
    /// way round.
    pub fn overridden_by(self, over: Self) -> Self {
        let (kinds, kinds_by) = match (over.kinds, over.kinds_by) {
            (None, None) => (self.kinds, self.kinds_by),
            given => given,
        };
        Self {
            response: over.response.or(self.response),
            range_m_max: over.range_m_max.or(self.range_m_max),
            invalid_range_m: over.invalid_range_m.or(self.invalid_range_m),
            offset_m: over.offset_m.or(self.offset_m),
            median: over.median.or(self.median),
            whitening: over.whitening.or(self.whitening),
            metric: over.metric.or(self.metric),
            frames: over.frames.or(self.frames),
            method: over.method.or(self.method),
            neighbors: over.neighbors.or(self.neighbors),
            consecutive_edges: over.consecutive_edges.or(self.consecutive_edges),
            landmarks: over.landmarks.or(self.landmarks),
            landmark_choice: over.landmark_choice.or(self.landmark_choice),
            dims: over.dims.or(self.dims),
            kinds,
            kinds_min: over.kinds_min.or(self.kinds_min),
            kinds_by,
            covariance: over.covariance.or(self.covariance),
            starts: over.starts.or(self.starts),
            starts_on: over.starts_on.or(self.starts_on),
            covariance_floor: over.covariance_floor.or(self.covariance_floor),
            over_time: over.over_time.or(self.over_time),
            seed: over.seed.or(self.seed),
            metres_per_count: over.metres_per_count.or(self.metres_per_count),
            frames_topic: over.frames_topic.or(self.frames_topic),
            tolerance_ms: over.tolerance_ms.or(self.tolerance_ms),
            poses_topic: over.poses_topic.or(self.poses_topic),
            commands_topic: over.commands_topic.or(self.commands_topic),
            commands: CommandsConfig { weight: over.commands.weight.or(self.commands.weight) },
        }
    }

    /// Checks every number that is given against its limits, and that what is given goes together.
    ///
    /// # Errors
    /// With fields, values and limit.
    pub fn check(&self) -> Result<(), ConfigError> {
        let count = |field, value: Option<usize>, most: usize| match value {
            Some(value) if !(1..=most).contains(&value) => {
                let limit = if most == usize::MAX {
                    "at least 1".to_string()
                } else {
                    format!("between 1 and {most}")
                };
                Err(ConfigError::Limit { field, value: value as f64, limit })
            }
            _ => Ok(()),
        };
        let within = |field, value: Option<f64>, holds: fn(f64) -> bool, limit: &str| match value {
            Some(value) if !holds(value) => {
                Err(ConfigError::Limit { field, value, limit: limit.to_string() })
            }
            _ => Ok(()),
        };
        let positive: fn(f64) -> bool = |value| value.is_finite() && value > 0.0;
        count("frames", self.frames, usize::MAX)?;
        count("neighbors", self.neighbors, usize::MAX)?;
        count("dims", self.dims, N_DIMS_MAX)?;
        count("kinds", self.kinds, N_KINDS_MAX)?;
        count("kinds_min", self.kinds_min, N_KINDS_TRIED_MAX)?;
        count("starts", self.starts, usize::MAX)?;
        if let Some(n_frames) = self.median.filter(|n_frames| !matches!(n_frames, 1 | 3 | 5)) {
            let limit = "1, 3 or 5 frames".to_string();
            return Err(ConfigError::Limit { field: "median", value: n_frames as f64, limit });
        }
        if let Some(WhiteningChoice::Slow { n_components, n_directions }) = self.whitening {
            count("n_components", Some(n_components), N_COMPONENTS_MAX)?;
            count("n_directions", Some(n_directions), n_components)?;
        }
        within("range_m_max", self.range_m_max, positive, "above 0 m")?;
        within(
            "invalid_range_m",
            self.invalid_range_m,
            |value| value.is_finite() && value >= 0.0,
            "at least 0 m",
        )?;
        within("offset_m", self.offset_m, positive, "above 0 m")?;
        let not_negative: fn(f64) -> bool = |value| value.is_finite() && value >= 0.0;
        within("commands_weight", self.commands.weight, not_negative, "at least 0")?;
        within("metres_per_count", self.metres_per_count, positive, "above 0 m")?;
        let share: fn(f64) -> bool = |value| value > 0.0 && value < 1.0;
        within("covariance_floor", self.covariance_floor, share, "above 0 and below 1")?;
        self.check_choice_of_kinds()
    }

    fn check_choice_of_kinds(&self) -> Result<(), ConfigError> {
        match (self.kinds, self.kinds_by, self.covariance) {
            (Some(n_kinds), Some(by), _) => {
                let by = match by {
                    KindsBy::BicNeff => "bic_neff",
                    KindsBy::HeldOut => "held_out",
                    KindsBy::Dirichlet => "dirichlet",
                };
                Err(ConfigError::GivenAndChosen { n_kinds, by })
            }
            (_, Some(KindsBy::Dirichlet), Some(covariance)) if covariance != Covariance::Full => {
                Err(ConfigError::NotFull { covariance })
            }
            _ => Ok(()),
        }
    }

    /// The scale that is asked for, or the usual one.
    fn scale(&self) -> Scale {
        match self.response {
            Some(ScaleChoice::Range) => Scale::Range,
            Some(ScaleChoice::Log) => Scale::Log,
            Some(ScaleChoice::Inverse | ScaleChoice::Auto) | None => Scale::Inverse,
        }
    }

    /// How much commands weigh, if frames are to be compared by them.
    pub(crate) fn commands_weight(&self) -> Option<f64> {
        self.commands.weight.filter(|weight| *weight > 0.0)
    }

    /// What to read of a trip.
    pub fn selection(&self) -> Selection {
        let usual = Selection::default();
        Selection {
            frames_topic: self.frames_topic.clone(),
            tolerance: self.tolerance_ms.map_or(usual.tolerance, |ms| Duration::from_millis(ms.into())),
            poses_topic: self.poses_topic.clone(),
            commands_topic: self.commands_topic.clone(),
            metres_per_count: self.metres_per_count.unwrap_or(usual.metres_per_count),
        }
    }

    /// The plan for a sensor, given which raw counts are to be fitted. By the usual comparison, where the trips are to decide.
    ///
    /// # Errors
    /// As [`Self::check`].
    pub fn plan(&self, sensor: SensorLayout, seen: &CountsSeen) -> Result<FitPlan, ConfigError> {
        self.check()?;
        let useful_m = || seen.largest_useful() * sensor.metres_per_count;
        let usual = ResponsePlan::new(self.scale(), self.range_m_max.unwrap_or_else(useful_m));
        let seed = self.seed.unwrap_or(0);
        let em = EmPlan::new(seed);
        let n_frames_max = self.frames.unwrap_or(USUAL_FRAMES_MAX);
        let n_frames = n_frames_max.min(seen.n_frames);
        Ok(FitPlan {
            sensor,
            response: ResponsePlan {
                invalid_range_m: self.invalid_range_m.unwrap_or(usual.invalid_range_m),
                offset_m: self.offset_m.unwrap_or(usual.offset_m),
                ..usual
            },
            median: match self.median {
                Some(3) => MedianPlan::Three,
                Some(5) => MedianPlan::Five,
                _ => MedianPlan::Off,
            },
            whitening: match self.whitening {
                Some(WhiteningChoice::Slow { n_components, n_directions }) => {
                    Some(WhiteningPlan { n_components, n_directions })
                }
                None | Some(WhiteningChoice::Off | WhiteningChoice::Auto) => None,
            },
            metric: self.metric.as_ref().map(|choice| choice.plan(sensor)).transpose()?.unwrap_or_default(),
            n_frames_max,
            method: match self.method {
                None | Some(MethodChoice::Isomap | MethodChoice::Both) => Method::Isomap,
                Some(MethodChoice::Pca) => Method::Pca,
                Some(MethodChoice::Native) => Method::Native,
            },
            n_neighbors: self.neighbors,
            consecutive_edges: self.consecutive_edges.unwrap_or(false),
            n_landmarks: self.landmarks.unwrap_or(LandmarkNumber::Count(N_LANDMARKS_USUAL)).of(n_frames),
            landmark_choice: self.landmark_choice.unwrap_or_default(),
            n_dims: self.dims,
            n_kinds: self.kinds,
            n_kinds_min: self.kinds_min.unwrap_or(USUAL_KINDS_MIN),
            kinds_by: self.kinds_by.unwrap_or_default(),
            em: EmPlan {
                covariance: self.covariance.unwrap_or(em.covariance),
                n_starts: self.starts.unwrap_or(em.n_starts),
                starts_on: self.starts_on.unwrap_or(em.starts_on),
                covariance_floor: self.covariance_floor.unwrap_or(em.covariance_floor),
                over_time: self.over_time.unwrap_or(em.over_time),
                ..em
            },
            seed,
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const RING: SensorLayout = SensorLayout { rows: 1, columns: 16, metres_per_count: 0.001 };

    fn seen(counts: &[u16]) -> CountsSeen {
        let mut seen = CountsSeen::default();
        counts.chunks(RING.n_readings()).for_each(|frame| seen.add(frame));
        seen
    }

    #[test]
    fn an_empty_file_leaves_neighbours_dimensions_and_kinds_to_the_evidence() {
        let plan = Config::from_ron("()").unwrap().plan(RING, &seen(&[0, 4000, 3000])).unwrap();
        assert_eq!((plan.n_neighbors, plan.n_dims, plan.n_kinds), (None, None, None));
        assert_eq!((plan.landmark_choice, plan.response.range_m_max), (LandmarkChoice::Random, 4.0));
        assert_eq!((plan.n_frames_max, plan.consecutive_edges), (4000, false));
    }

    #[test]
    fn a_flag_overrides_a_field() {
        let file = Config::from_ron("(kinds: 7, response: log, method: PCA_ELSEWHERE)").unwrap_err();
        assert!(matches!(file, ConfigError::Ron { line: 1, .. }), "{file}");
        let file = Config::from_ron("(kinds: 7, response: log, method: Pca)").unwrap();
        let plan = file
            .overridden_by(Config { kinds: Some(3), ..Config::default() })
            .plan(RING, &seen(&[1]))
            .unwrap();
        assert_eq!((plan.n_kinds, plan.response.scale, plan.method), (Some(3), Scale::Log, Method::Pca));
    }

    #[test]
    fn commands_weigh_what_a_flag_says_or_else_the_file() {
        let file = Config::from_ron("(commands: (weight: 0.3))").unwrap();
        assert_eq!(file.commands_weight(), Some(0.3));
        let flags =
            |weight| Config { commands: CommandsConfig { weight: Some(weight) }, ..Config::default() };
        assert_eq!(file.clone().overridden_by(flags(0.1)).commands_weight(), Some(0.1));
        assert_eq!(file.clone().overridden_by(Config::default()).commands_weight(), Some(0.3));
        // No weight is no commands.
        assert_eq!(file.overridden_by(flags(0.0)).commands_weight(), None);
        assert_eq!(Config::from_ron("()").unwrap().commands_weight(), None);
    }

    #[test]
    fn both_methods_begin_with_isomap() {
        let plan = |text: &str| Config::from_ron(text).unwrap().plan(RING, &seen(&[1])).unwrap();
        assert_eq!(plan("(method: both)"), plan("(method: isomap)"));
        assert_eq!(plan("(method: Both, covariance: Tied)"), plan("(covariance: tied)"));
    }

    #[test]
    fn a_number_of_kinds_and_what_to_choose_it_by_override_each_other_and_do_not_go_together() {
        let config = |text: &str| Config::from_ron(text).unwrap();
        let over = |file: &str, flags: &str| {
            let plan = config(file).overridden_by(config(flags)).plan(RING, &seen(&[1])).unwrap();
            (plan.n_kinds, plan.kinds_by)
        };
        assert_eq!(over("()", "()"), (None, KindsBy::BicNeff));
        assert_eq!(over("(kinds_by: held_out)", "()"), (None, KindsBy::HeldOut));
        assert_eq!(over("(kinds: 5)", "(kinds_by: Dirichlet)"), (None, KindsBy::Dirichlet));
        assert_eq!(over("(kinds_by: dirichlet)", "(kinds: 5)"), (Some(5), KindsBy::BicNeff));
        let refuse = |text: &str| config(text).check().unwrap_err().to_string();
        for (variant, by) in [("BicNeff", "bic_neff"), ("HeldOut", "held_out"), ("Dirichlet", "dirichlet")] {
            assert_eq!(
                refuse(&format!("(kinds: 5, kinds_by: {variant})")),
                format!(
                    "kinds is 5 and kinds_by is {by}: a number of kinds is either given or chosen; leave out one of them"
                )
            );
        }
        assert_eq!(
            refuse("(kinds_by: dirichlet, covariance: tied)"),
            "kinds_by is dirichlet and covariance is tied: a Dirichlet process has kinds with full covariances; leave out \
             covariance, or choose by bic_neff or held_out"
        );
    }

    #[test]
    fn landmarks_are_so_many_of_the_frames_that_there_are() {
        let counts = vec![1; 16 * 40];
        let n_landmarks =
            |text| Config::from_ron(text).unwrap().plan(RING, &seen(&counts)).map(|plan| plan.n_landmarks);
        assert_eq!(n_landmarks("()"), Ok(40));
        assert_eq!(n_landmarks("(landmarks: all)"), Ok(40));
        assert_eq!(n_landmarks("(landmarks: 30)"), Ok(30));
        assert_eq!(n_landmarks("(landmarks: \"25%\")"), Ok(10));
        // Of those that the model keeps.
        assert_eq!(n_landmarks("(landmarks: \"25%\", frames: 20)"), Ok(5));
        assert_eq!(n_landmarks("(frames: 20)"), Ok(20));
        let chosen =
            Config::from_ron("(landmark_choice: k_means)").unwrap().plan(RING, &seen(&counts)).unwrap();
        assert_eq!(chosen.landmark_choice, LandmarkChoice::KMeans);
    }

    #[test]
    fn wrong_fields_and_numbers_are_refused_with_place_value_and_limit() {
        let refuse = |text: &str| match Config::from_ron(text) {
            Ok(config) => config.check().unwrap_err().to_string(),
            Err(error) => error.to_string(),
        };
        assert_eq!(refuse("(\n  kinds: 65,\n)"), "kinds is 65; it must be between 1 and 64");
        assert_eq!(refuse("(frames: 0)"), "frames is 0; it must be at least 1");
        assert_eq!(refuse("(offset_m: 0)"), "offset_m is 0; it must be above 0 m");
        assert_eq!(
            refuse("(covariance_floor: 1.5)"),
            "covariance_floor is 1.5; it must be above 0 and below 1"
        );
        assert_eq!(refuse("(commands: (weight: -0.1))"), "commands_weight is -0.1; it must be at least 0");
        assert!(refuse("(commands: (wait: 0.1))").starts_with("line 1, column "));
        assert_eq!(
            refuse("(landmarks: \"110%\")"),
            "line 1, column 19: landmarks are 110%; they must be all, a count such as 500, or a share above 0% and at most \
             100% such as 25%"
        );
        let unknown = refuse("(\n  kids: 5,\n)");
        assert!(unknown.starts_with("line 2, column ") && unknown.contains("kids"), "{unknown}");
    }

    #[test]
    fn one_wild_reading_in_two_hundred_does_not_stretch_the_scale() {
        let counts: Vec<u16> = (0..199).map(|_| 2500).chain([60_000, 0, 0, 0]).collect();
        assert_eq!(Config::default().plan(RING, &seen(&counts)).unwrap().response.range_m_max, 2.5);
    }
}
