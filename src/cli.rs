//! What can be asked of the program.

use std::path::PathBuf;
use std::sync::Arc;
use std::sync::atomic::AtomicBool;

use clap::{Args, Parser, Subcommand, ValueEnum};
use kinds_driver_shim::Pace;
use kinds_driver_shim::simulated::Floor;
use kinds_messages::{Domain, SensorName};
use kinds_model::{Covariance, KindsBy, LandmarkChoice, Scale, StartsOn};
use kinds_trainer::{CommandsConfig, Config, LandmarkNumber, MethodChoice, MetricChoice};
use kinds_trips::Selection;

use crate::owner::Joined;

/// Tells a robot, in microseconds and without labels, what kind of place its raw sensors are in.
#[derive(Debug, Parser)]
#[command(
    name = "kinds",
    version,
    max_term_width = 110,
    subcommand_required = true,
    arg_required_else_help = true
)]
pub(crate) struct Cli {
    #[command(subcommand)]
    pub(crate) verb: Verb,
}

/// Where the robot's programs meet.
#[derive(Args, Debug)]
pub(crate) struct DomainArguments {
    /// Folder in which the robot's programs meet: all that name the same one share their channels. Default: that of
    /// iceoryx2, for all programs of a user
    #[arg(long, env = "KINDS_DOMAIN", value_name = "DIR")]
    domain: Option<PathBuf>,
}

impl DomainArguments {
    pub(crate) fn domain(&self) -> Domain {
        self.domain.as_deref().map_or_else(Domain::default, Domain::in_folder)
    }
}

/// Where the robot's programs meet, for a program that another one may start for itself.
#[derive(Args, Debug)]
pub(crate) struct OwnableDomainArguments {
    #[command(flatten)]
    arguments: DomainArguments,
    /// End when standard input does: then whoever started this program has ended, and its domain with it
    #[arg(long, hide = true, requires = "domain")]
    owned: bool,
}

impl OwnableDomainArguments {
    pub(crate) fn join(&self, stop: &Arc<AtomicBool>) -> Joined {
        Joined::new(self.arguments.domain(), self.owned, stop)
    }
}

#[derive(Debug, Subcommand)]
pub(crate) enum Verb {
    /// Show the whole way once: drive or take two trips, train on one, serve and publish the other, watch, evaluate, report
    Demo(DemoArguments),
    /// Learn the kinds of recorded trips
    Train(Box<TrainArguments>),
    /// Measure whether a place seen again gets the same kind
    Evaluate(EvaluateArguments),
    /// Say what is in a model
    Inspect(InspectArguments),
    /// Publish the frames of a sensor into shared memory
    Publish(PublishArguments),
    /// Classify every frame of a sensor and publish its kind
    Serve(ServeArguments),
    /// Print the kinds of a sensor as they come
    Watch(WatchArguments),
    /// Record a sensor's frames, poses, commands and kinds into a trip
    Record(RecordArguments),
    /// Push a trip through shim, shared memory and service in lockstep, and say whether anything has changed
    Replay(ReplayArguments),
}

#[derive(Args, Debug)]
pub(crate) struct DemoArguments {
    /// Simulated robot to show it on, crunch or chew; or two recorded trips, one to learn from and one to recognise
    #[arg(num_args = 0..=2, default_value = "crunch", value_name = "ROBOT | TRIP1 TRIP2")]
    pub(crate) subject: Vec<PathBuf>,
    /// Folder for trips, model and results; made if it is not there
    #[arg(long, default_value = "kinds-demo", value_name = "DIR")]
    pub(crate) output: PathBuf,
}

#[derive(Args, Debug)]
#[command(allow_negative_numbers = true)]
pub(crate) struct TrainArguments {
    /// ROS 2 bags (MCAP) of one sensor
    #[arg(required = true, value_name = "TRIP")]
    pub(crate) trips: Vec<PathBuf>,
    /// File to write the model to
    #[arg(long, short, value_name = "M.kinds")]
    pub(crate) output: PathBuf,
    /// Folder to write a report to, made if it is not there: report.html, and each figure as SVG with its numbers as CSV
    #[arg(long, value_name = "DIR")]
    pub(crate) report: Option<PathBuf>,
    /// RON file with the same fields as the flags below; a flag overrides a field
    #[arg(long, value_name = "FILE.ron")]
    pub(crate) config: Option<PathBuf>,
    /// Scale on which frames are compared [default: inverse]
    #[arg(long, value_enum)]
    response: Option<ScaleName>,
    /// Largest useful range, metres [default: the 99th percentile of the valid readings]
    #[arg(long, value_name = "M")]
    range_m_max: Option<f64>,
    /// Range that invalid readings are taken for, metres [default: the largest useful range]
    #[arg(long, value_name = "M")]
    invalid_range_m: Option<f64>,
    /// Offset of the log and inverse scales, metres [default: 0.3]
    #[arg(long, value_name = "M")]
    offset_m: Option<f64>,
    /// How far apart frames are: euclidean; ring: at the nearest turn, each row of the sensor being a ring; rings:N: the same
    /// with N rings. Weights are given in the configuration file [default: euclidean]
    #[arg(long, value_name = "euclidean|ring|rings:N")]
    metric: Option<MetricChoice>,
    /// Most frames that the model keeps: of longer trips as many that cover them; kinds are learnt from all [default: 4000]
    #[arg(long, value_name = "N")]
    frames: Option<usize>,
    /// How distances between frames become coordinates; both: M.kinds is Isomap's, M.pca.kinds and M.pca-matched.kinds
    /// are PCA's, of its own and of Isomap's size [default: isomap]
    #[arg(long, value_enum)]
    method: Option<MethodName>,
    /// Neighbours of each frame in the graph [default: chosen by evidence up to 30; `kinds inspect` shows it]
    #[arg(long, value_name = "N")]
    neighbors: Option<usize>,
    /// Make frames that follow each other in a trip neighbours, however unlike they are
    #[arg(long)]
    consecutive_edges: bool,
    /// Landmarks that geodesics are measured from: all, a count, or a share of the frames such as 25% [default: 1000, or all
    /// frames if there are fewer]
    #[arg(long, value_name = "all|N|SHARE%")]
    landmarks: Option<LandmarkNumber>,
    /// How landmarks are chosen [default: random]
    #[arg(long, value_enum, value_name = "HOW")]
    landmark_choice: Option<LandmarkChoiceName>,
    /// Dimensions to embed in, 1 to 32 [default: chosen by residual variance: two more than where it bends]
    #[arg(long, value_name = "N")]
    dims: Option<usize>,
    /// Kinds to find, 1 to 64 [default: chosen by evidence from 1 to 20; `kinds inspect` shows it]
    #[arg(long, value_name = "N")]
    kinds: Option<usize>,
    /// What the number of kinds is chosen by [default: bic-neff]
    #[arg(long, value_enum, value_name = "HOW")]
    kinds_by: Option<KindsByName>,
    /// Shape of the kinds [default: full]
    #[arg(long, value_enum)]
    covariance: Option<CovarianceName>,
    /// Starts of the mixture [default: 10]
    #[arg(long, value_name = "N")]
    starts: Option<usize>,
    /// Coordinates that starts cluster [default: plain]
    #[arg(long, value_enum, value_name = "WHICH")]
    starts_on: Option<StartsOnName>,
    /// Least variance of a kind in any direction, as a share of the mean variance [default: 0.001]
    #[arg(long, value_name = "SHARE")]
    covariance_floor: Option<f64>,
    /// Seed of everything random [default: 0]
    #[arg(long, value_name = "N")]
    seed: Option<u64>,
    /// Compare frames by what the robot was told to do, too: the commands' part in the mean squared distance between frames,
    /// as a multiple of the readings' part [default: 0, by readings alone]
    #[arg(long, value_name = "W")]
    commands_weight: Option<f64>,
    #[command(flatten)]
    reading: ReadingArguments,
}

/// What to read of a trip.
#[derive(Args, Debug)]
pub(crate) struct ReadingArguments {
    /// Topic of the frames [default: the only one that fits]
    #[arg(long, value_name = "NAME")]
    frames_topic: Option<String>,
    /// Topic of the poses [default: the only one that fits]
    #[arg(long, value_name = "NAME")]
    poses_topic: Option<String>,
    /// Topic of the commands, what the robot was told to do [default: the only one that fits; of several, none]
    #[arg(long, value_name = "NAME")]
    commands_topic: Option<String>,
    /// Metres that one count stands for [default: 0.001]
    #[arg(long, value_name = "M")]
    metres_per_count: Option<f64>,
}

#[derive(Args, Debug)]
#[command(allow_negative_numbers = true)]
pub(crate) struct EvaluateArguments {
    /// The model
    #[arg(value_name = "M.kinds")]
    pub(crate) model: PathBuf,
    /// The trip that the model was learnt from
    pub(crate) trip1: PathBuf,
    /// Another trip through the same places
    pub(crate) trip2: PathBuf,
    /// Frames no farther apart than this saw the same place, metres
    #[arg(long, default_value_t = 0.3, value_name = "R")]
    pub(crate) radius_m: f64,
    /// Strictly more than this share of the frames near a frame must have its kind
    #[arg(long, default_value_t = 0.5, value_name = "Z")]
    pub(crate) share: f64,
    /// Seed of the random kinds
    #[arg(long, default_value_t = 0, value_name = "N")]
    pub(crate) seed: u64,
    /// Print one JSON object
    #[arg(long)]
    pub(crate) json: bool,
    #[command(flatten)]
    reading: ReadingArguments,
}

#[derive(Args, Debug)]
pub(crate) struct InspectArguments {
    /// The model
    #[arg(value_name = "M.kinds")]
    pub(crate) model: PathBuf,
    /// Print one JSON object
    #[arg(long)]
    pub(crate) json: bool,
}

#[derive(Args, Debug)]
pub(crate) struct PublishArguments {
    /// Recorded trip to replay; with --simulate, which of the robot's trips to drive: a number
    #[arg(long, required_unless_present = "simulate")]
    pub(crate) trip: Option<PathBuf>,
    /// Drive a simulated robot instead
    #[arg(long, value_enum, value_name = "ROBOT")]
    pub(crate) simulate: Option<RobotName>,
    /// Where Crunch drives: fourth-floor or fifth-floor [default: fourth-floor]
    #[arg(long, requires = "simulate")]
    pub(crate) world: Option<Floor>,
    /// Seed of everything random about the simulated robot and its world
    #[arg(long, requires = "simulate", default_value_t = 0, value_name = "N")]
    pub(crate) seed: u64,
    /// Sensor to publish it as, such as crunch/ring
    #[arg(long, value_name = "NAME")]
    pub(crate) sensor: SensorName,
    /// Multiple of the recorded or real pace, or max: as fast as the service follows
    #[arg(long, default_value = "1", value_name = "X|max")]
    pub(crate) speed: Pace,
    /// Lose nothing: wait for a service, and go no faster than it reports (as --speed max always does)
    #[arg(long)]
    pub(crate) follow: bool,
    #[command(flatten)]
    reading: ReadingArguments,
    #[command(flatten)]
    pub(crate) domain: OwnableDomainArguments,
}

#[derive(Args, Debug)]
pub(crate) struct ServeArguments {
    /// The model
    #[arg(long, value_name = "M.kinds")]
    pub(crate) model: PathBuf,
    /// Sensor to serve, such as crunch/ring
    #[arg(long, value_name = "NAME")]
    pub(crate) sensor: SensorName,
    #[command(flatten)]
    pub(crate) domain: OwnableDomainArguments,
}

#[derive(Args, Debug)]
pub(crate) struct WatchArguments {
    /// Sensor to watch, such as crunch/ring
    #[arg(long, value_name = "NAME")]
    pub(crate) sensor: SensorName,
    /// Print one JSON object a line
    #[arg(long)]
    pub(crate) json: bool,
    /// End after this many reports
    #[arg(long, value_name = "N")]
    pub(crate) count: Option<u64>,
    #[command(flatten)]
    pub(crate) domain: DomainArguments,
}

#[derive(Args, Debug)]
pub(crate) struct RecordArguments {
    /// Sensor to record, such as crunch/ring
    #[arg(long, value_name = "NAME")]
    pub(crate) sensor: SensorName,
    /// ROS 2 bag (MCAP) to write: it must not be there yet
    #[arg(long, short, value_name = "TRIP.mcap")]
    pub(crate) output: PathBuf,
    /// End after this many frames [default: at SIGINT or SIGTERM]
    #[arg(long, value_name = "N")]
    pub(crate) count: Option<u64>,
    #[command(flatten)]
    pub(crate) domain: DomainArguments,
}

#[derive(Args, Debug)]
pub(crate) struct ReplayArguments {
    /// Recorded trip
    pub(crate) trip: PathBuf,
    /// The model
    #[arg(long, value_name = "M.kinds")]
    pub(crate) model: PathBuf,
    /// Write what comes out to this file
    #[arg(long, value_name = "FILE.csv", conflicts_with = "expect")]
    pub(crate) bless: Option<PathBuf>,
    /// Compare what comes out with this file, written before with --bless; exit code 1 where they differ
    #[arg(long, value_name = "FILE.csv")]
    pub(crate) expect: Option<PathBuf>,
    #[command(flatten)]
    reading: ReadingArguments,
}

/// A simulated robot.
#[derive(Clone, Copy, Debug, ValueEnum)]
pub(crate) enum RobotName {
    /// Small and round, with eight sonars and eight infrared sensors, in an office building
    Crunch,
    /// Large, with six wheels and a time-of-flight camera, outdoors on a campus
    Chew,
}

#[derive(Clone, Copy, Debug, ValueEnum)]
enum ScaleName {
    /// The range itself
    Range,
    /// ln(1 + range / offset)
    Log,
    /// 1 / (range + offset)
    Inverse,
}

#[derive(Clone, Copy, Debug, ValueEnum)]
enum MethodName {
    /// Geodesics in the neighbour graph
    Isomap,
    /// Euclidean distances: principal component analysis
    Pca,
    /// No embedding: kinds of the readings as they are, of sensors with up to 32
    Native,
    /// One after the other, to compare
    Both,
}

#[derive(Clone, Copy, Debug, ValueEnum)]
enum CovarianceName {
    /// Each kind any ellipsoid
    Full,
    /// All kinds one ellipsoid
    Tied,
    /// Each kind an ellipsoid along the dimensions
    Diagonal,
    /// Each kind a ball
    Spherical,
}

#[derive(Clone, Copy, Debug, ValueEnum)]
enum KindsByName {
    /// The least BIC, for as many frames as are independent
    BicNeff,
    /// The likeliest for stretches of the trip that were held out
    HeldOut,
    /// How many a Dirichlet process keeps, for as many frames as are independent
    Dirichlet,
}

#[derive(Clone, Copy, Debug, ValueEnum)]
enum StartsOnName {
    /// Those that there are
    Plain,
    /// Scaled to unit variance in every direction
    Whitened,
    /// The one and the other in turn: worth a try for cameras
    Both,
}

#[derive(Clone, Copy, Debug, ValueEnum)]
enum LandmarkChoiceName {
    /// Any frames, each as likely
    Random,
    /// The frame farthest from those chosen before, again and again: covers all that the trip saw, oddities first
    Farthest,
    /// The frames nearest to the centres of k-means: spread as the trip is
    KMeans,
}

impl TrainArguments {
    /// The flags as a configuration.
    pub(crate) fn config(&self) -> Config {
        Config {
            response: self.response.map(|name| match name {
                ScaleName::Range => Scale::Range,
                ScaleName::Log => Scale::Log,
                ScaleName::Inverse => Scale::Inverse,
            }),
            range_m_max: self.range_m_max,
            invalid_range_m: self.invalid_range_m,
            offset_m: self.offset_m,
            metric: self.metric.clone(),
            frames: self.frames,
            method: self.method.map(|name| match name {
                MethodName::Isomap => MethodChoice::Isomap,
                MethodName::Pca => MethodChoice::Pca,
                MethodName::Native => MethodChoice::Native,
                MethodName::Both => MethodChoice::Both,
            }),
            neighbors: self.neighbors,
            consecutive_edges: self.consecutive_edges.then_some(true),
            landmarks: self.landmarks,
            landmark_choice: self.landmark_choice.map(|name| match name {
                LandmarkChoiceName::Random => LandmarkChoice::Random,
                LandmarkChoiceName::Farthest => LandmarkChoice::Farthest,
                LandmarkChoiceName::KMeans => LandmarkChoice::KMeans,
            }),
            dims: self.dims,
            kinds: self.kinds,
            kinds_by: self.kinds_by.map(|name| match name {
                KindsByName::BicNeff => KindsBy::BicNeff,
                KindsByName::HeldOut => KindsBy::HeldOut,
                KindsByName::Dirichlet => KindsBy::Dirichlet,
            }),
            covariance: self.covariance.map(|name| match name {
                CovarianceName::Full => Covariance::Full,
                CovarianceName::Tied => Covariance::Tied,
                CovarianceName::Diagonal => Covariance::Diagonal,
                CovarianceName::Spherical => Covariance::Spherical,
            }),
            starts: self.starts,
            starts_on: self.starts_on.map(|name| match name {
                StartsOnName::Plain => StartsOn::Plain,
                StartsOnName::Whitened => StartsOn::Whitened,
                StartsOnName::Both => StartsOn::Both,
            }),
            covariance_floor: self.covariance_floor,
            seed: self.seed,
            metres_per_count: self.reading.metres_per_count,
            frames_topic: self.reading.frames_topic.clone(),
            poses_topic: self.reading.poses_topic.clone(),
            commands_topic: self.reading.commands_topic.clone(),
            commands: CommandsConfig { weight: self.commands_weight },
        }
    }
}

impl ReadingArguments {
    /// What to read of a trip, in the unit of a model's sensor if none is given.
    fn selection(&self, metres_per_count: Option<f64>) -> Selection {
        let usual = Selection::default();
        Selection {
            frames_topic: self.frames_topic.clone(),
            poses_topic: self.poses_topic.clone(),
            commands_topic: self.commands_topic.clone(),
            metres_per_count: self.metres_per_count.or(metres_per_count).unwrap_or(usual.metres_per_count),
        }
    }
}

impl EvaluateArguments {
    pub(crate) fn selection(&self, metres_per_count: f64) -> Selection {
        self.reading.selection(Some(metres_per_count))
    }
}

impl ReplayArguments {
    pub(crate) fn selection(&self, metres_per_count: f64) -> Selection {
        self.reading.selection(Some(metres_per_count))
    }
}

impl PublishArguments {
    pub(crate) fn selection(&self) -> Selection {
        self.reading.selection(None)
    }
}

#[cfg(test)]
mod tests {
    use clap::CommandFactory;

    use super::*;

    #[test]
    fn the_command_line_is_free_of_contradictions() {
        Cli::command().debug_assert();
    }
}
