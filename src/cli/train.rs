//! What can be asked of `kinds train`.

use std::path::PathBuf;

use clap::{Args, ValueEnum};
use kinds_model::{Covariance, KindsBy, LandmarkChoice, StartsOn};
use kinds_trainer::{
    CommandsConfig, Config, LandmarkNumber, MethodChoice, MetricChoice, ScaleChoice, WhiteningChoice,
};

use super::ReadingArguments;

#[derive(Args, Debug)]
#[command(allow_negative_numbers = true)]
pub(crate) struct TrainArguments {
    /// ROS 2 bags (MCAP) or ROS 1 bags of one sensor
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
    /// Scale on which frames are compared [default: auto]
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
    /// Take each reading as the median of so many frames, 1, 3 or 5, against drop-outs; a change is then seen one frame later, or two
    /// [default: 3 where drop-outs are many, else 1]
    #[arg(long, value_name = "N")]
    median: Option<usize>,
    /// Compare frames by so many slow directions of their readings: what changes little from one frame to the next, each direction
    /// as much as any other; auto: by four of them if kinds change more seldom then [default: auto where the scale is left to the
    /// trip too, else off]
    #[arg(long, value_name = "off|auto|N")]
    whitening: Option<WhiteningChoice>,
    /// How far apart frames are: euclidean; ring: at the nearest turn, each row of the sensor being a ring; rings:N: the same
    /// with N rings; parts:N,N: of joined sensors, each as much as any other, however many readings it has: else many drown few.
    /// Weights are given in the configuration file [default: euclidean]
    #[arg(long, value_name = "euclidean|ring|rings:N|parts:N,…")]
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
    /// Kinds to find, 1 to 64 [default: chosen by evidence, at most 20; `kinds inspect` shows it]
    #[arg(long, value_name = "N")]
    kinds: Option<usize>,
    /// Fewest kinds, 1 to 20, where their number is chosen by evidence [default: 4]
    #[arg(long, value_name = "N")]
    kinds_min: Option<usize>,
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
    /// Fit the kinds with the knowledge that frames which follow each other are mostly of one kind
    #[arg(long)]
    over_time: bool,
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

impl TrainArguments {
    /// The flags as a configuration.
    pub(crate) fn config(&self) -> Config {
        Config {
            response: self.response.map(|name| match name {
                ScaleName::Range => ScaleChoice::Range,
                ScaleName::Log => ScaleChoice::Log,
                ScaleName::Inverse => ScaleChoice::Inverse,
                ScaleName::Auto => ScaleChoice::Auto,
            }),
            range_m_max: self.range_m_max,
            invalid_range_m: self.invalid_range_m,
            offset_m: self.offset_m,
            median: self.median,
            whitening: self.whitening,
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
            kinds_min: self.kinds_min,
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
            over_time: self.over_time.then_some(true),
            seed: self.seed,
            metres_per_count: self.reading.metres_per_count,
            frames_topic: self.reading.frames_topic.clone(),
            tolerance_ms: self.reading.tolerance_ms,
            poses_topic: self.reading.poses_topic.clone(),
            commands_topic: self.reading.commands_topic.clone(),
            commands: CommandsConfig { weight: self.commands_weight },
        }
    }
}

#[derive(Clone, Copy, Debug, ValueEnum)]
enum ScaleName {
    /// The range itself
    Range,
    /// ln(1 + range / offset)
    Log,
    /// 1 / (range + offset)
    Inverse,
    /// That of these by which kinds change most seldom on this trip
    Auto,
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
