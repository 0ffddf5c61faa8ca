//! `kinds join`: the driver shim of a sensor that is several sensors together.

use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

use kinds_driver_shim::joined::{Gathering, JoinError};
use kinds_driver_shim::{Flow, Sensor as _};
use kinds_messages::{Node, SensorName};

use crate::cli::{JoinArguments, Joint};
use crate::commands::publish::publish_until_stopped;
use crate::failure::Failure;
use crate::notify::Supervisor;
use crate::say::mention;
use crate::{log, stop};

/// How often what killed programs left is looked for, and a supervisor told that we wait.
const TURN: Duration = Duration::from_secs(1);

pub(crate) fn run(arguments: &JoinArguments) -> Result<(), Failure> {
    let stop = stop::on_signals()?;
    let Joint { sensors, name, plan } = arguments.joint()?;
    let supervisor = Supervisor::from_environment();
    let node = Node::open(&arguments.domain.domain(), "kinds-join")?;
    let mut gathering = Gathering::open(&node, sensors.iter()).map_err(failure)?;
    supervisor.ready(format_args!("waiting for frames of {sensors}"));
    if !gather(&mut gathering, &node, &stop, &supervisor)? {
        return Ok(());
    }
    let joined = gathering.begin(plan).map_err(failure)?;
    let layout = joined.layout();
    mention(format!("joining {sensors} as {name}: {layout} of {} m a count", layout.metres_per_count))?;
    publish_until_stopped(&node, &name, joined, Flow::Live, &stop, &supervisor, |joined| joined.remarks())?;
    Ok(())
}

/// Waits for a frame of each sensor. Returns whether to go on.
fn gather(
    gathering: &mut Gathering,
    node: &Node,
    stop: &AtomicBool,
    supervisor: &Supervisor,
) -> Result<bool, Failure> {
    let mut told = String::new();
    let mut last_turn = Instant::now();
    loop {
        gathering.look().map_err(failure)?;
        let missing: Vec<&str> = gathering.missing().map(SensorName::as_str).collect();
        if missing.is_empty() || stop.load(Ordering::Relaxed) {
            return Ok(missing.is_empty());
        }
        let waits = format!("waiting for the first frame of {}", missing.join(", "));
        if last_turn.elapsed() >= TURN {
            node.clean_up_dead_nodes();
            supervisor.alive(&waits);
            last_turn = Instant::now();
        }
        if waits != told {
            log::notice(&waits);
            told = waits;
        }
    }
}

fn failure(error: JoinError) -> Failure {
    match error {
        JoinError::Channel(error) => error.into(),
        other => Failure::CouldNot(other.to_string()),
    }
}
