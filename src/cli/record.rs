//! What can be asked of `kinds record`.

use std::path::PathBuf;

use clap::Args;
use kinds_messages::SensorName;
use serde::Deserialize;

use super::{DomainArguments, configured, not_said};
use crate::failure::Failure;
use crate::ron_file::as_flag;

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
    /// Sensor to record, such as crunch/ring
    #[arg(long, required_unless_present = "config", value_name = "NAME")]
    #[serde(deserialize_with = "as_flag")]
    sensor: Option<SensorName>,
    /// ROS 2 bag (MCAP) to write, which must not be there yet; or a folder: then one in it, named by sensor and time
    #[arg(long, short, required_unless_present = "config", value_name = "TRIP.mcap|DIR")]
    output: Option<PathBuf>,
    /// End after this many frames [default: at SIGINT or SIGTERM]
    #[arg(long, value_name = "N")]
    count: Option<u64>,
}

/// What is to be recorded, and where.
pub(crate) struct RecordPlan {
    pub(crate) sensor: SensorName,
    pub(crate) output: PathBuf,
    pub(crate) count: Option<u64>,
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
        }
    }

    pub(crate) fn plan(self) -> Result<RecordPlan, Failure> {
        Ok(RecordPlan {
            sensor: self.sensor.ok_or_else(|| not_said("which sensor to record", "sensor"))?,
            output: self.output.ok_or_else(|| not_said("where to record to", "output"))?,
            count: self.count,
        })
    }
}
