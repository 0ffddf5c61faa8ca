//! What can be asked of the program.

#[cfg(feature = "bridge")]
mod bridge;
mod check;
mod evaluate;
mod join;
mod publish;
mod record;
mod serve;
mod train;
mod trips;

use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::AtomicBool;
use std::time::Duration;

use clap::{Args, Parser, Subcommand};
use kinds_messages::{Domain, SensorName};
use kinds_trips::Selection;
use serde::Deserialize;
use serde::de::DeserializeOwned;

#[cfg(feature = "bridge")]
pub(crate) use self::bridge::{BridgeArguments, BridgeConfig, BridgePlan, End};
pub(crate) use self::check::{CheckArguments, Sort};
pub(crate) use self::evaluate::EvaluateArguments;
pub(crate) use self::join::{JoinArguments, JoinConfig, Joint};
pub(crate) use self::publish::{PublishArguments, PublishConfig, PublishPlan, RobotName, SourcePlan};
pub(crate) use self::record::{Limits, RecordArguments, RecordConfig, RecordPlan, SensorNames};
pub(crate) use self::serve::{ServeArguments, ServeConfig, ServePlan};
pub(crate) use self::train::TrainArguments;
pub(crate) use self::trips::{ConvertArguments, InfoArguments, RecoverArguments, TripsArguments, TripsVerb};
use crate::failure::Failure;
use crate::log::Format;
use crate::owner::Joined;
use crate::ron_file;

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
    /// The domain.
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
    /// Call a kind by a name, in the model's file
    Name(NameArguments),
    /// Learn a model further from more trips: kinds that it knows keep their numbers and names
    Update(UpdateArguments),
    /// Publish the frames of a sensor into shared memory
    Publish(Box<PublishArguments>),
    /// Publish several sensors of a robot as one, whose frames have the readings of all
    Join(JoinArguments),
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
    /// Bring a sensor's kinds to another machine: one end runs there, one on the robot
    #[cfg(feature = "bridge")]
    Bridge(BridgeArguments),
    /// Push a trip through shim, shared memory and service in lockstep, and say whether anything has changed
    Replay(ReplayArguments),
    /// Say why nothing arrives: who is there, whether they agree, and what to do about it
    Doctor(DoctorArguments),
    /// Look into recorded trips, convert them, and save what is whole of damaged ones
    Trips(TripsArguments),
    /// Say whether configuration files are right, and where they are not
    Check(CheckArguments),
    /// Write the pages of the manual and what shells complete into a folder, for whoever makes a package
    #[command(hide = true)]
    Pages(PagesArguments),
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
#[derive(Args, Clone, Debug, Default, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub(crate) struct ReadingArguments {
    /// Topic of the frames, or several whose frames are joined, with commas between them: each frame of the first with the newest
    /// of each of the others that was captured with it or before [default: the only one that fits, or all single ranges
    /// (sensor_msgs/Range); `kinds trips info` shows what there is]
    #[arg(long, value_name = "NAME,…")]
    frames_topic: Option<String>,
    /// Of several topics, milliseconds by which frames of the others may be older than the first one's; where there is none, the
    /// frame is invalid [default: 250]
    #[arg(long, value_name = "MS")]
    tolerance_ms: Option<u32>,
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
pub(crate) struct NameArguments {
    /// The model; its file is written anew. Its id stays, so that a service that has it in use need not read it again
    #[arg(value_name = "M.kinds")]
    pub(crate) model: PathBuf,
    /// The kind's number, as `kinds inspect` and `kinds watch` print it
    #[arg(value_name = "KIND")]
    pub(crate) number: u32,
    /// A word or two, at most 40 characters
    #[arg(required_unless_present_any = ["note", "clear"])]
    pub(crate) name: Option<String>,
    /// What else there is to say of it, at most 400 characters
    #[arg(long, value_name = "TEXT")]
    pub(crate) note: Option<String>,
    /// Take name and note away
    #[arg(long, conflicts_with_all = ["name", "note"])]
    pub(crate) clear: bool,
}

#[derive(Args, Debug)]
pub(crate) struct UpdateArguments {
    /// The model
    #[arg(value_name = "M.kinds")]
    pub(crate) model: PathBuf,
    /// Further trips of its sensor: ROS 2 bags (MCAP) or ROS 1 bags
    #[arg(required = true, value_name = "TRIP")]
    pub(crate) trips: Vec<PathBuf>,
    /// File to write the new model to
    #[arg(long, short, value_name = "M2.kinds")]
    pub(crate) output: PathBuf,
    /// Print what became of the kinds as one JSON object
    #[arg(long)]
    pub(crate) json: bool,
    #[command(flatten)]
    reading: ReadingArguments,
}

#[derive(Args, Debug)]
pub(crate) struct ReloadArguments {
    /// Configuration of the service: its sensor is meant, and its model is taken into use; a flag overrides a field
    #[arg(long, value_name = "FILE.ron")]
    config: Option<PathBuf>,
    /// Sensor whose service is meant, such as crunch/ring
    #[arg(long, required_unless_present = "config", value_name = "NAME")]
    sensor: Option<SensorName>,
    /// The model to take into use [default: the file in use, read again, as SIGHUP asks for too]
    #[arg(long, value_name = "M.kinds")]
    model: Option<PathBuf>,
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
    /// Models by whose names kinds are called, where a service has one of them in use
    #[arg(long, num_args = 1.., value_name = "M.kinds")]
    pub(crate) model: Vec<PathBuf>,
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
    /// Take the kinds that are most alike together, until so many are left
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..))]
    pub(crate) kinds: Option<u32>,
    /// The model by whose names kinds are called, as long as the service has it in use
    #[arg(long, value_name = "M.kinds")]
    pub(crate) model: Option<PathBuf>,
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

#[derive(Args, Debug)]
pub(crate) struct PagesArguments {
    /// Folder to write to; made if it is not there
    #[arg(value_name = "DIR")]
    pub(crate) output: PathBuf,
}

/// A time that somebody may wait.
fn seconds(text: &str) -> Result<f64, String> {
    let seconds: f64 = text.parse().map_err(|_| "it is not a number".to_owned())?;
    match (0.0..=3600.0).contains(&seconds) {
        true => Ok(seconds),
        false => Err("it must be between 0 and 3600 seconds".to_owned()),
    }
}

/// What flags and a configuration say together.
fn configured<C: DeserializeOwned>(
    config: Option<&Path>,
    flags: C,
    overridden_by: fn(C, C) -> C,
) -> Result<C, Failure> {
    match config {
        Some(path) => Ok(overridden_by(ron_file::read("configuration", path)?, flags)),
        None => Ok(flags),
    }
}

/// Something that neither flags nor configuration say, and without which nothing can be done.
fn not_said(what: &str, field: &str) -> Failure {
    Failure::AskedWrongly(format!("say {what}: with {field} in the configuration, or --{field}"))
}

impl ReloadArguments {
    /// The sensor whose service is meant, and the model if one is named.
    pub(crate) fn asked(&self) -> Result<(SensorName, Option<PathBuf>), Failure> {
        let flags =
            ServeConfig { model: self.model.clone(), sensor: self.sensor.clone(), ..ServeConfig::default() };
        let config = configured(self.config.as_deref(), flags, ServeConfig::overridden_by)?;
        let sensor = config.sensor.ok_or_else(|| not_said("which service is meant", "sensor"))?;
        Ok((sensor, config.model))
    }
}

impl ReadingArguments {
    fn overridden_by(self, over: Self) -> Self {
        Self {
            frames_topic: over.frames_topic.or(self.frames_topic),
            tolerance_ms: over.tolerance_ms.or(self.tolerance_ms),
            poses_topic: over.poses_topic.or(self.poses_topic),
            commands_topic: over.commands_topic.or(self.commands_topic),
            metres_per_count: over.metres_per_count.or(self.metres_per_count),
        }
    }

    /// What to read of a trip, in the unit of a model's sensor if none is given.
    fn selection(&self, metres_per_count: Option<f64>) -> Selection {
        let usual = Selection::default();
        Selection {
            frames_topic: self.frames_topic.clone(),
            tolerance: self.tolerance_ms.map_or(usual.tolerance, |ms| Duration::from_millis(ms.into())),
            poses_topic: self.poses_topic.clone(),
            commands_topic: self.commands_topic.clone(),
            metres_per_count: self.metres_per_count.or(metres_per_count).unwrap_or(usual.metres_per_count),
        }
    }
}

impl UpdateArguments {
    pub(crate) fn selection(&self, metres_per_count: f64) -> Selection {
        self.reading.selection(Some(metres_per_count))
    }
}

impl ReplayArguments {
    pub(crate) fn selection(&self, metres_per_count: f64) -> Selection {
        self.reading.selection(Some(metres_per_count))
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
