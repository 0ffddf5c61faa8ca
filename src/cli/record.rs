//! What can be asked of `kinds record`.

use std::fmt;
use std::path::PathBuf;
use std::str::FromStr;
use std::time::Duration;

use clap::Args;
use kinds_messages::{SensorName, SensorNameError};
use serde::Deserialize;

use super::{DomainArguments, configured, not_said};
use crate::failure::Failure;
use crate::ron_file::as_flag;

/// Room that is left to the robot's other programs unless something else is asked for. What a recorder writes between two
/// looks at it is a small part.
const FREE_MB_MIN: u64 = 500;

#[derive(Args, Debug)]
pub(crate) struct RecordArguments {
    /// RON file with the same fields as the flags below; a flag overrides a field
    #[arg(long, value_name = "FILE.ron")]
    config: Option<PathBuf>,
    #[command(flatten)]
    flags: RecordConfig,
    #[command(flatten)]
    pub(crate) domain: DomainArguments,
}

/// Recording as flags or a file say it.
#[derive(Args, Clone, Debug, Default, Deserialize)]
#[serde(default, deny_unknown_fields, rename = "Record")]
pub(crate) struct RecordConfig {
    /// Sensor to record, such as crunch/ring; or several into one trip, with commas between them
    #[arg(long, required_unless_present = "config", value_name = "NAME,…")]
    #[serde(deserialize_with = "as_flag")]
    sensor: Option<SensorNames>,
    /// ROS 2 bag (MCAP) to write, which must not be there yet; or a folder: then one in it, named by sensor and time
    #[arg(long, short, required_unless_present = "config", value_name = "TRIP.mcap|DIR")]
    output: Option<PathBuf>,
    /// End after this many frames, of all sensors together [default: at SIGINT or SIGTERM]
    #[arg(long, value_name = "N")]
    count: Option<u64>,
    /// Record only frames that the model in use calls novel, and their kinds: a trip that `kinds update` can learn from
    #[arg(long)]
    novel: bool,
    /// Begin another trip when one has so many megabytes (10⁶ bytes); needs a folder [default: never]
    #[arg(long, value_name = "MB")]
    trip_mb_max: Option<u64>,
    /// Begin another trip when one has so many seconds; needs a folder [default: never]
    #[arg(long, value_name = "S")]
    trip_s_max: Option<u64>,
    /// Keep the last N trips of this sensor in the folder, what was left of killed recordings among them, and remove those
    /// before [default: all]
    #[arg(long, value_name = "N")]
    keep: Option<usize>,
    /// Pause while fewer megabytes are free where the trip goes, and go on when there is room [default: 500]
    #[arg(long, value_name = "MB")]
    free_mb_min: Option<u64>,
}

/// Some sensors, each another, at least one: names with commas between them.
#[derive(Clone, Debug)]
pub(crate) struct SensorNames(Vec<SensorName>);

impl SensorNames {
    pub(crate) fn iter(&self) -> impl ExactSizeIterator<Item = &SensorName> {
        self.0.iter()
    }
}

impl FromStr for SensorNames {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let names = text
            .split(',')
            .map(|name| name.trim().parse().map_err(|error: SensorNameError| error.to_string()));
        let names: Vec<SensorName> = names.collect::<Result<_, _>>()?;
        match names.iter().enumerate().find(|(index, name)| names[..*index].contains(name)) {
            Some((_, name)) => Err(format!("{name} is there twice; name each sensor once")),
            None => Ok(Self(names)),
        }
    }
}

impl fmt::Display for SensorNames {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&self.0.iter().map(SensorName::as_str).collect::<Vec<_>>().join(","))
    }
}

/// What is to be recorded, and where.
pub(crate) struct RecordPlan {
    pub(crate) sensors: SensorNames,
    pub(crate) output: PathBuf,
    pub(crate) count: Option<u64>,
    /// Only frames that are called novel.
    pub(crate) novel: bool,
    pub(crate) limits: Limits,
}

/// How much a recorder may take up.
pub(crate) struct Limits {
    pub(crate) trip_bytes_max: Option<u64>,
    pub(crate) trip_duration_max: Option<Duration>,
    pub(crate) n_kept: Option<usize>,
    pub(crate) free_bytes_min: u64,
}

impl Limits {
    /// Whether only a folder will do, since there is more than one trip to be.
    pub(crate) fn need_folder(&self) -> bool {
        self.trip_bytes_max.is_some() || self.trip_duration_max.is_some() || self.n_kept.is_some()
    }
}

impl RecordArguments {
    pub(crate) fn plan(&self) -> Result<RecordPlan, Failure> {
        configured(self.config.as_deref(), self.flags.clone(), RecordConfig::overridden_by)?.plan()
    }
}

impl RecordConfig {
    fn overridden_by(self, over: Self) -> Self {
        Self {
            sensor: over.sensor.or(self.sensor),
            output: over.output.or(self.output),
            count: over.count.or(self.count),
            novel: over.novel || self.novel,
            trip_mb_max: over.trip_mb_max.or(self.trip_mb_max),
            trip_s_max: over.trip_s_max.or(self.trip_s_max),
            keep: over.keep.or(self.keep),
            free_mb_min: over.free_mb_min.or(self.free_mb_min),
        }
    }

    pub(crate) fn plan(self) -> Result<RecordPlan, Failure> {
        const MB: u64 = 1_000_000;
        let keep = self.keep.map(|keep| keep as u64);
        for (field, value) in
            [("trip_mb_max", self.trip_mb_max), ("trip_s_max", self.trip_s_max), ("keep", keep)]
        {
            if value == Some(0) {
                return Err(Failure::AskedWrongly(format!(
                    "{field} is 0; it must be at least 1, or left out"
                )));
            }
        }
        Ok(RecordPlan {
            sensors: self.sensor.ok_or_else(|| not_said("which sensor to record", "sensor"))?,
            output: self.output.ok_or_else(|| not_said("where to record to", "output"))?,
            count: self.count,
            novel: self.novel,
            limits: Limits {
                trip_bytes_max: self.trip_mb_max.map(|mb| mb.saturating_mul(MB)),
                trip_duration_max: self.trip_s_max.map(Duration::from_secs),
                n_kept: self.keep,
                free_bytes_min: self.free_mb_min.unwrap_or(FREE_MB_MIN).saturating_mul(MB),
            },
        })
    }
}
