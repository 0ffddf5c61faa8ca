//! What can be asked of `kinds bridge`.

use std::path::PathBuf;

use clap::Args;
use kinds_bridge::Endpoint;
use kinds_messages::SensorName;
use serde::Deserialize;

use super::{DomainArguments, configured, not_said};
use crate::failure::Failure;
use crate::ron_file::as_flag;

#[derive(Args, Debug)]
pub(crate) struct BridgeArguments {
    /// RON file with the same fields as the flags below; a flag overrides a field
    #[arg(long, value_name = "FILE.ron")]
    config: Option<PathBuf>,
    #[command(flatten)]
    flags: BridgeConfig,
    #[command(flatten)]
    pub(crate) domain: DomainArguments,
}

/// An end of a bridge as flags or a file say it.
#[derive(Args, Clone, Debug, Default, Deserialize)]
#[serde(default, deny_unknown_fields, rename = "Bridge")]
pub(crate) struct BridgeConfig {
    /// Sensor whose kinds go over the network, such as crunch/ring
    #[arg(long, required_unless_present = "config", value_name = "NAME")]
    #[serde(deserialize_with = "as_flag")]
    sensor: Option<SensorName>,
    /// On the robot: address and port at which other machines find it, such as tcp/0.0.0.0:7447. Whoever reaches it can read
    #[arg(long, required_unless_present_any = ["config", "connect"], conflicts_with = "connect", value_name = "ENDPOINT")]
    #[serde(deserialize_with = "as_flag")]
    listen: Option<Endpoint>,
    /// On another machine: where the robot listens, such as tcp/crunch.local:7447
    #[arg(long, value_name = "ENDPOINT")]
    #[serde(deserialize_with = "as_flag")]
    connect: Option<Endpoint>,
}

/// Which end of a bridge there is to be.
pub(crate) struct BridgePlan {
    pub(crate) sensor: SensorName,
    pub(crate) end: End,
}

/// An end of a bridge.
pub(crate) enum End {
    /// The robot's.
    Near(Endpoint),
    /// Another machine's.
    Far(Endpoint),
}

impl BridgeArguments {
    pub(crate) fn plan(&self) -> Result<BridgePlan, Failure> {
        configured(self.config.as_deref(), self.flags.clone(), BridgeConfig::overridden_by)?.plan()
    }
}

impl BridgeConfig {
    /// An end that is asked for by flag is the one that is meant.
    fn overridden_by(self, over: Self) -> Self {
        let (listen, connect) = match (&over.listen, &over.connect) {
            (None, None) => (self.listen, self.connect),
            _ => (over.listen, over.connect),
        };
        Self { sensor: over.sensor.or(self.sensor), listen, connect }
    }

    pub(crate) fn plan(self) -> Result<BridgePlan, Failure> {
        let sensor = self
            .sensor
            .ok_or_else(|| not_said("which sensor's kinds are to go over the network", "sensor"))?;
        let end = match (self.listen, self.connect) {
            (Some(endpoint), None) => End::Near(endpoint),
            (None, Some(endpoint)) => End::Far(endpoint),
            (None, None) => {
                return Err(Failure::AskedWrongly(
                    "say which end of the bridge this is: with listen on the robot, or connect on another machine".into(),
                ));
            }
            (Some(listen), Some(connect)) => {
                return Err(Failure::AskedWrongly(format!(
                    "listen is {listen} and connect is {connect}: an end of a bridge does one of the two; leave out connect on the \
                     robot, and listen on another machine"
                )));
            }
        };
        Ok(BridgePlan { sensor, end })
    }
}
