//! What can be asked of `kinds join`.

use std::path::PathBuf;
use std::time::Duration;

use clap::Args;
use kinds_driver_shim::joined::JoinPlan;
use kinds_messages::SensorName;
use serde::Deserialize;

use super::{DomainArguments, SensorNames, configured, not_said};
use crate::failure::Failure;
use crate::ron_file::as_flag;

/// Longest wait for frames on their way: a leader at 6 Hz has as many waiting as there is room for.
const WAIT_MS_MAX: u32 = 10_000;

#[derive(Args, Debug)]
pub(crate) struct JoinArguments {
    /// RON file with the same fields as the flags below; a flag overrides a field
    #[arg(long, value_name = "FILE.ron")]
    config: Option<PathBuf>,
    #[command(flatten)]
    flags: JoinConfig,
    #[command(flatten)]
    pub(crate) domain: DomainArguments,
}

/// Joining as flags or a file say it.
#[derive(Args, Clone, Debug, Default, Deserialize)]
#[serde(default, deny_unknown_fields, rename = "Join")]
pub(crate) struct JoinConfig {
    /// Sensors to join, such as crunch/sonar,crunch/infrared, in the order of a joint frame's readings. The first leads: each of its
    /// frames makes a joint one, with the newest of each of the others that was captured with it or before. Readings count alike,
    /// whichever sensor they are of: many drown few, unless `kinds train --metric parts:N,…` weighs them
    #[arg(long, required_unless_present = "config", value_name = "NAME,NAME,…")]
    #[serde(deserialize_with = "as_flag")]
    sensor: Option<SensorNames>,
    /// Sensor to publish joint frames as, such as crunch/joint
    #[arg(long = "as", required_unless_present = "config", value_name = "NAME")]
    #[serde(deserialize_with = "as_flag")]
    r#as: Option<SensorName>,
    /// Milliseconds by which the others' frames may be older than the first sensor's; where there is none, joint frames are invalid
    /// [default: 250]
    #[arg(long, value_name = "MS")]
    tolerance_ms: Option<u32>,
    /// Milliseconds that a joint frame may wait for frames of the others that are on their way, at most 10000 [default: 0, whatever
    /// comes too late is counted]
    #[arg(long, value_name = "MS")]
    wait_ms: Option<u32>,
}

/// What is to be joined, and how.
pub(crate) struct Joint {
    pub(crate) sensors: SensorNames,
    pub(crate) name: SensorName,
    pub(crate) plan: JoinPlan,
}

impl JoinArguments {
    pub(crate) fn joint(&self) -> Result<Joint, Failure> {
        configured(self.config.as_deref(), self.flags.clone(), JoinConfig::overridden_by)?.joint()
    }
}

impl JoinConfig {
    fn overridden_by(self, over: Self) -> Self {
        Self {
            sensor: over.sensor.or(self.sensor),
            r#as: over.r#as.or(self.r#as),
            tolerance_ms: over.tolerance_ms.or(self.tolerance_ms),
            wait_ms: over.wait_ms.or(self.wait_ms),
        }
    }

    pub(crate) fn joint(self) -> Result<Joint, Failure> {
        let refuse = |words: String| Err(Failure::AskedWrongly(words));
        let sensors = self.sensor.ok_or_else(|| not_said("which sensors to join", "sensor"))?;
        let name = self.r#as.ok_or_else(|| not_said("which sensor to publish joint frames as", "as"))?;
        if sensors.iter().len() < 2 {
            return refuse(format!(
                "sensor is {sensors}; it takes two or more to join, with commas between them"
            ));
        }
        if sensors.iter().any(|sensor| *sensor == name) {
            return refuse(format!(
                "as is {name}, which is one of the sensors to join; give joint frames a name of their own"
            ));
        }
        let usual = JoinPlan::default();
        let duration = |ms: u32| Duration::from_millis(ms.into());
        if let Some(wait_ms) = self.wait_ms.filter(|wait_ms| *wait_ms > WAIT_MS_MAX) {
            return refuse(format!("wait_ms is {wait_ms}; it must be at most {WAIT_MS_MAX}"));
        }
        let plan = JoinPlan {
            tolerance: self.tolerance_ms.map_or(usual.tolerance, duration),
            wait: self.wait_ms.map_or(usual.wait, duration),
        };
        Ok(Joint { sensors, name, plan })
    }
}
