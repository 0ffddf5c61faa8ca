//! What can be asked of `kinds serve`.

use std::net::SocketAddr;
use std::path::PathBuf;

use clap::Args;
use kinds_messages::SensorName;
use serde::Deserialize;

use super::{OwnableDomainArguments, configured, not_said};
use crate::failure::Failure;
use crate::realtime::Realtime;
use crate::ron_file::{Given, as_flag};

#[derive(Args, Debug)]
pub(crate) struct ServeArguments {
    /// RON file with the same fields as the flags below; a flag overrides a field
    #[arg(long, value_name = "FILE.ron")]
    config: Option<PathBuf>,
    #[command(flatten)]
    flags: ServeConfig,
    #[command(flatten)]
    pub(crate) domain: OwnableDomainArguments,
}

/// Serving as flags or a file say it.
#[derive(Args, Clone, Debug, Default, Deserialize)]
#[serde(default, deny_unknown_fields, rename = "Serve")]
pub(crate) struct ServeConfig {
    /// The model
    #[arg(long, required_unless_present = "config", value_name = "M.kinds")]
    pub(super) model: Option<PathBuf>,
    /// Sensor to serve, such as crunch/ring
    #[arg(long, required_unless_present = "config", value_name = "NAME")]
    #[serde(deserialize_with = "as_flag")]
    pub(super) sensor: Option<SensorName>,
    /// Look for frames all the time instead of sleeping until one comes: reports come sooner, and one processor core is
    /// never free
    #[arg(long)]
    pub(super) busy_poll: bool,
    /// Keep the model and all else that serving touches in memory, where the system allows it: without, what is not used
    /// for long may be paged out, and the next frame waits for it
    #[arg(long)]
    pub(super) lock_memory: bool,
    /// Processors, priority and memory to ask the system for, in a file such as
    /// (cpus: [2, 3], priority: 50, lock_memory: true): what is not allowed is told, and served without
    #[arg(long, value_name = "FILE.ron")]
    pub(super) realtime: Option<Given<Realtime>>,
    /// Serve counters and latencies to Prometheus at http://ADDR/metrics, such as 127.0.0.1:9184
    #[arg(long, value_name = "ADDR")]
    #[serde(deserialize_with = "as_flag")]
    pub(super) metrics: Option<SocketAddr>,
}

/// What a service is to do.
pub(crate) struct ServePlan {
    pub(crate) model: PathBuf,
    pub(crate) sensor: SensorName,
    pub(crate) busy_poll: bool,
    pub(crate) realtime: Realtime,
    pub(crate) metrics: Option<SocketAddr>,
}

impl ServeArguments {
    pub(crate) fn plan(&self) -> Result<ServePlan, Failure> {
        configured(self.config.as_deref(), self.flags.clone(), ServeConfig::overridden_by)?.plan()
    }
}

impl ServeConfig {
    pub(super) fn overridden_by(self, over: Self) -> Self {
        Self {
            model: over.model.or(self.model),
            sensor: over.sensor.or(self.sensor),
            busy_poll: over.busy_poll || self.busy_poll,
            lock_memory: over.lock_memory || self.lock_memory,
            realtime: over.realtime.or(self.realtime),
            metrics: over.metrics.or(self.metrics),
        }
    }

    pub(crate) fn plan(self) -> Result<ServePlan, Failure> {
        let mut realtime: Realtime =
            self.realtime.map(|given| given.read("real-time settings")).transpose()?.unwrap_or_default();
        realtime.lock_memory |= self.lock_memory;
        Ok(ServePlan {
            model: self.model.ok_or_else(|| not_said("which model to serve", "model"))?,
            sensor: self.sensor.ok_or_else(|| not_said("which sensor to serve", "sensor"))?,
            busy_poll: self.busy_poll,
            realtime,
            metrics: self.metrics,
        })
    }
}
