//! What can be asked of the program.

mod evaluate;
mod train;
mod trips;

use std::net::SocketAddr;
use std::path::PathBuf;
use std::sync::Arc;
use std::sync::atomic::AtomicBool;

use clap::{Args, Parser, Subcommand, ValueEnum};
use kinds_driver_shim::Pace;
use kinds_driver_shim::simulated::Floor;
use kinds_messages::{Domain, SensorName};
use kinds_trips::Selection;

pub(crate) use self::evaluate::EvaluateArguments;
pub(crate) use self::train::TrainArguments;
pub(crate) use self::trips::{ConvertArguments, InfoArguments, RecoverArguments, TripsArguments, TripsVerb};
use crate::log::Format;
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
    /// How to write what is told on standard error
    #[arg(long, global = true, value_enum, default_value_t = Format::Text, env = "KINDS_LOG_FORMAT", value_name = "FORMAT")]
    pub(crate) log_format: Format,
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
    /// Measure what kinds are good for: does a place seen again get the same one, which map do they make, which commands
    Evaluate(Box<EvaluateArguments>),
    /// Say what is in a model
    Inspect(InspectArguments),
    /// Publish the frames of a sensor into shared memory
    Publish(PublishArguments),
    /// Classify every frame of a sensor and publish its kind
    Serve(ServeArguments),
    /// Give a running service another model, without a gap: the old one serves until the new one is ready
    Reload(ReloadArguments),
    /// Print the kinds of a sensor as they come
    Watch(WatchArguments),
    /// Show how all services fare: rates, latencies, losses, and who is connected
    Top(TopArguments),
    /// Record a sensor's frames, poses, commands and kinds into a trip
    Record(RecordArguments),
    /// Push a trip through shim, shared memory and service in lockstep, and say whether anything has changed
    Replay(ReplayArguments),
    /// Say why nothing arrives: who is there, whether they agree, and what to do about it
    Doctor(DoctorArguments),
    /// Look into recorded trips, convert them, and save what is whole of damaged ones
    Trips(TripsArguments),
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

/// What to read of a trip.
#[derive(Args, Debug)]
pub(crate) struct ReadingArguments {
    /// Topic of the frames, or several with single ranges (sensor_msgs/Range) and commas between them [default: the only one
    /// that fits, or all single ranges; `kinds trips info` shows what there is]
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
    /// Spoil some frames, to see what the others make of it: how often each fault befalls one is in this file, such as
    /// (seed: 7, drop: 0.01, repeat: 0.01, reorder: 0.01, delay: 0.01, delay_ms: 300, flip_bit: 0.01, invalid: 0.01,
    /// wrong_length: 0.01)
    #[arg(long, value_name = "FAULTS.ron")]
    pub(crate) faults: Option<PathBuf>,
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
    /// Look for frames all the time instead of sleeping until one comes: reports come sooner, and one processor core is
    /// never free
    #[arg(long)]
    pub(crate) busy_poll: bool,
    /// Keep the model and all else that serving touches in memory, where the system allows it: without, what is not used
    /// for long may be paged out, and the next frame waits for it
    #[arg(long)]
    pub(crate) lock_memory: bool,
    /// Processors, priority and memory to ask the system for, in a file such as
    /// (cpus: [2, 3], priority: 50, lock_memory: true): what is not allowed is told, and served without
    #[arg(long, value_name = "FILE.ron")]
    pub(crate) realtime: Option<PathBuf>,
    /// Serve counters and latencies to Prometheus at http://ADDR/metrics, such as 127.0.0.1:9184
    #[arg(long, value_name = "ADDR")]
    pub(crate) metrics: Option<SocketAddr>,
    #[command(flatten)]
    pub(crate) domain: OwnableDomainArguments,
}

#[derive(Args, Debug)]
pub(crate) struct ReloadArguments {
    /// Sensor whose service is meant, such as crunch/ring
    #[arg(long, value_name = "NAME")]
    pub(crate) sensor: SensorName,
    /// The model to take into use [default: the file in use, read again, as SIGHUP asks for too]
    #[arg(long, value_name = "M.kinds")]
    pub(crate) model: Option<PathBuf>,
    #[command(flatten)]
    pub(crate) domain: DomainArguments,
}

#[derive(Args, Debug)]
pub(crate) struct TopArguments {
    /// Print once and end, instead of every second
    #[arg(long)]
    pub(crate) once: bool,
    /// Print one JSON object a line instead of a table
    #[arg(long)]
    pub(crate) json: bool,
    #[command(flatten)]
    pub(crate) domain: DomainArguments,
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

#[derive(Args, Debug)]
pub(crate) struct DoctorArguments {
    /// Sensor to ask about [default: all that there are]
    #[arg(long, value_name = "NAME")]
    pub(crate) sensor: Option<SensorName>,
    /// Model that its frames are for
    #[arg(long, value_name = "M.kinds")]
    pub(crate) model: Option<PathBuf>,
    /// Print one JSON object
    #[arg(long)]
    pub(crate) json: bool,
    /// Seconds to wait for a frame
    #[arg(long, value_name = "S", default_value_t = 2.0, value_parser = seconds)]
    pub(crate) wait_s: f64,
    #[command(flatten)]
    pub(crate) domain: DomainArguments,
}

/// A time that somebody may wait.
fn seconds(text: &str) -> Result<f64, String> {
    let seconds: f64 = text.parse().map_err(|_| "it is not a number".to_owned())?;
    match (0.0..=3600.0).contains(&seconds) {
        true => Ok(seconds),
        false => Err("it must be between 0 and 3600 seconds".to_owned()),
    }
}

/// A simulated robot.
#[derive(Clone, Copy, Debug, ValueEnum)]
pub(crate) enum RobotName {
    /// Small and round, with eight sonars and eight infrared sensors, in an office building
    Crunch,
    /// Large, with six wheels and a time-of-flight camera, outdoors on a campus
    Chew,
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
