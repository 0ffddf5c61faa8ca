//! Who is in a domain: its sensors, and the programs that have their channels open.

use iceoryx2::node::NodeView as _;
use iceoryx2::prelude::{CallbackProgression, NodeState, Service as _, ipc};

use crate::channel::Channel;
use crate::{Domain, SensorName};

/// A sensor of which at least one channel is open.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct SensorPresence {
    /// The sensor.
    pub sensor: SensorName,
    /// Who has a channel of it open, by name and process.
    pub programs: Vec<ProgramPresence>,
}

/// A program that lives, and has a channel open.
#[derive(Clone, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub struct ProgramPresence {
    /// The name under which it joined the domain.
    pub name: String,
    /// Its process.
    pub pid: u32,
}

impl Domain {
    /// The sensors of the domain by name, and who is connected to each. For a person to look at: reads files.
    pub fn sensors(&self) -> std::io::Result<Vec<SensorPresence>> {
        let config = self.config().map_err(std::io::Error::other)?;
        let mut sensors: Vec<SensorPresence> = Vec::new();
        let listed = ipc::Service::list(&config, |service| {
            if let Some(sensor) = Channel::sensor_of(service.static_details.name().as_str()) {
                let index = sensors.iter().position(|known| known.sensor == sensor).unwrap_or_else(|| {
                    sensors.push(SensorPresence { sensor, programs: Vec::new() });
                    sensors.len() - 1
                });
                let nodes = service.dynamic_details.map_or(Vec::new(), |details| details.nodes);
                sensors[index].programs.extend(nodes.iter().filter_map(program));
            }
            CallbackProgression::Continue
        });
        listed.map_err(|error| std::io::Error::other(format!("channels cannot be listed: {error:?}")))?;
        for sensor in &mut sensors {
            sensor.programs.sort_unstable();
            sensor.programs.dedup();
        }
        sensors.sort_unstable_by(|a, b| a.sensor.cmp(&b.sensor));
        Ok(sensors)
    }
}

fn program(node: &NodeState<ipc::Service>) -> Option<ProgramPresence> {
    let NodeState::Alive(node) = node else { return None };
    let details = node.details().as_ref()?;
    Some(ProgramPresence { name: details.name().to_string(), pid: details.process_id().value() as u32 })
}
