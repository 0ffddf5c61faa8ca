//! What can be asked of `kinds publish`.

use std::path::{Path, PathBuf};

use clap::{Args, ValueEnum};
use kinds_driver_shim::simulated::Floor;
use kinds_driver_shim::{DeviceAddress, Faults, Pace, Speed};
use kinds_messages::SensorName;
use kinds_trips::{FrameLayout, Selection};
use serde::Deserialize;

use super::{OwnableDomainArguments, ReadingArguments, configured, not_said};
use crate::failure::Failure;
use crate::ron_file::{self, Given, as_flag};

#[derive(Args, Debug)]
pub(crate) struct PublishArguments {
    /// RON file with the same fields as the flags below; a flag overrides a field
    #[arg(long, value_name = "FILE.ron")]
    config: Option<PathBuf>,
    #[command(flatten)]
    flags: PublishConfig,
    #[command(flatten)]
    pub(crate) domain: OwnableDomainArguments,
}

/// Publishing as flags or a file say it.
#[derive(Args, Clone, Debug, Default, Deserialize)]
#[serde(default, deny_unknown_fields, rename = "Publish")]
pub(crate) struct PublishConfig {
    /// Recorded trip to replay; with --simulate, which of the robot's trips to drive: a number
    #[arg(long, required_unless_present_any = ["simulate", "device", "config"])]
    #[serde(deserialize_with = "as_flag")]
    trip: Option<PathBuf>,
    /// Drive a simulated robot instead
    #[arg(long, value_enum, value_name = "ROBOT")]
    simulate: Option<RobotName>,
    /// Read frames from a device instead: udp://ADDRESS:PORT, stdin, serial:///dev/NAME?baud=115200, or of a depth camera
    /// v4l2:///dev/NAME?rate_hz=30
    #[arg(long, value_name = "DEVICE", conflicts_with_all = ["trip", "simulate"])]
    #[serde(deserialize_with = "as_flag")]
    device: Option<DeviceAddress>,
    /// Rows of the device's frames [default: 1]
    #[arg(long, value_name = "N")]
    rows: Option<u32>,
    /// Readings in a row of the device's frames
    #[arg(long, value_name = "N")]
    columns: Option<u32>,
    /// Where Crunch drives: fourth-floor or fifth-floor [default: fourth-floor]
    #[arg(long)]
    #[serde(deserialize_with = "as_flag")]
    world: Option<Floor>,
    /// Seed of everything random about the simulated robot and its world [default: 0]
    #[arg(long, value_name = "N")]
    seed: Option<u64>,
    /// Sensor to publish it as, such as crunch/ring
    #[arg(long, required_unless_present = "config", value_name = "NAME")]
    #[serde(deserialize_with = "as_flag")]
    sensor: Option<SensorName>,
    /// Multiple of the recorded or real pace, or max: as fast as the service follows [default: 1]
    #[arg(long, value_name = "X|max")]
    #[serde(deserialize_with = "as_flag")]
    speed: Option<Pace>,
    /// Lose nothing: wait for a service, and go no faster than it reports (as --speed max always does)
    #[arg(long)]
    follow: bool,
    /// Spoil some frames, to see what the others make of it: how often each fault befalls one is in this file, such as
    /// (seed: 7, drop: 0.01, repeat: 0.01, reorder: 0.01, delay: 0.01, delay_ms: 300, flip_bit: 0.01, invalid: 0.01,
    /// wrong_length: 0.01)
    #[arg(long, value_name = "FAULTS.ron")]
    faults: Option<Given<Faults>>,
    #[command(flatten)]
    reading: ReadingArguments,
}

/// What is to be published, and how.
pub(crate) struct PublishPlan {
    pub(crate) source: SourcePlan,
    pub(crate) sensor: SensorName,
    pub(crate) pace: Pace,
    pub(crate) follow: bool,
    pub(crate) faults: Option<Faults>,
}

pub(crate) enum SourcePlan {
    Device {
        address: DeviceAddress,
        layout: FrameLayout,
    },
    Trip {
        path: PathBuf,
        selection: Selection,
    },
    Robot {
        name: RobotName,
        /// Of those who have a choice.
        floor: Floor,
        trip: u32,
        seed: u64,
    },
}

impl PublishArguments {
    pub(crate) fn plan(&self) -> Result<PublishPlan, Failure> {
        configured(self.config.as_deref(), self.flags.clone(), PublishConfig::overridden_by)?.plan()
    }
}

impl PublishConfig {
    fn overridden_by(self, over: Self) -> Self {
        Self {
            trip: over.trip.or(self.trip),
            simulate: over.simulate.or(self.simulate),
            device: over.device.or(self.device),
            rows: over.rows.or(self.rows),
            columns: over.columns.or(self.columns),
            world: over.world.or(self.world),
            seed: over.seed.or(self.seed),
            sensor: over.sensor.or(self.sensor),
            speed: over.speed.or(self.speed),
            follow: over.follow || self.follow,
            faults: over.faults.or(self.faults),
            reading: self.reading.overridden_by(over.reading),
        }
    }

    pub(crate) fn plan(self) -> Result<PublishPlan, Failure> {
        let source = self.source()?;
        let faults = self.faults.map(read_faults).transpose()?;
        Ok(PublishPlan {
            source,
            sensor: self.sensor.ok_or_else(|| not_said("which sensor to publish it as", "sensor"))?,
            pace: self.speed.unwrap_or(Pace::Recorded(Speed::AS_RECORDED)),
            follow: self.follow,
            faults,
        })
    }

    fn source(&self) -> Result<SourcePlan, Failure> {
        let refuse = |words: String| Err(Failure::AskedWrongly(words));
        if let Some(address) = &self.device {
            return self.device_source(address);
        }
        if self.rows.is_some() || self.columns.is_some() {
            return refuse(
                "rows and columns are a device's; leave them out, or say which with --device".to_string(),
            );
        }
        match (self.simulate, &self.trip) {
            (None, None) => Err(not_said("what to publish", "trip")),
            (None, Some(_)) if self.world.is_some() || self.seed.is_some() => refuse(
                "world and seed are a simulated robot's; leave them out, or add --simulate".to_string(),
            ),
            (None, Some(path)) => {
                Ok(SourcePlan::Trip { path: path.clone(), selection: self.reading.selection(None) })
            }
            (Some(RobotName::Chew), _) if self.world.is_some() => {
                refuse("chew drives on its campus alone; leave out --world".to_string())
            }
            (Some(name), trip) => {
                let text = trip.as_ref().map_or_else(|| "1".into(), |trip| trip.to_string_lossy());
                let Ok(trip) = text.parse() else {
                    return refuse(format!(
                        "with --simulate, --trip is the number of one of the robot's trips, such as 2; it is \"{text}\""
                    ));
                };
                let floor = self.world.unwrap_or(Floor::Fourth);
                Ok(SourcePlan::Robot { name, floor, trip, seed: self.seed.unwrap_or(0) })
            }
        }
    }

    fn device_source(&self, address: &DeviceAddress) -> Result<SourcePlan, Failure> {
        let others = [
            ("trip", self.trip.is_some()),
            ("simulate", self.simulate.is_some()),
            ("world", self.world.is_some()),
            ("seed", self.seed.is_some()),
            ("speed", self.speed.is_some()),
        ];
        if let Some((other, _)) = others.iter().find(|(_, is_said)| *is_said) {
            let words = format!("a device's frames come as it sends them; leave out {other}");
            return Err(Failure::AskedWrongly(words));
        }
        let layout = FrameLayout {
            rows: self.rows.unwrap_or(1),
            columns: self
                .columns
                .ok_or_else(|| not_said("how many readings a row of the device's frames has", "columns"))?,
            metres_per_count: self.reading.selection(None).metres_per_count,
        };
        Ok(SourcePlan::Device { address: address.clone(), layout })
    }
}

fn read_faults(given: Given<Faults>) -> Result<Faults, Failure> {
    let path = given.path().map(Path::to_path_buf);
    let faults = given.read("faults")?;
    match faults.check() {
        Ok(()) => Ok(faults),
        Err(error) => Err(match path {
            Some(path) => ron_file::wrong("faults", &path, error),
            None => Failure::AskedWrongly(format!("faults: {error}")),
        }),
    }
}

/// A simulated robot.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum, Deserialize)]
#[serde(rename_all = "lowercase")]
pub(crate) enum RobotName {
    /// Small and round, with eight sonars and eight infrared sensors, in an office building
    Crunch,
    /// Large, with six wheels and a time-of-flight camera, outdoors on a campus
    Chew,
}
