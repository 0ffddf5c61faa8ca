//! All of a shim's program but its device.

use std::sync::atomic::AtomicBool;

use kinds_messages::{Domain, Node};

use crate::{Flow, Sensor, Shim, ShimError, Summary};

/// As which such a program joins the domain.
const NAME: &str = "driver-shim";

/// Publishes a device under a sensor's name, such as `crunch/ring`, until it ends: in the domain that `KINDS_DOMAIN` names, or
/// the default one.
///
/// A robot's sensor: waits for nobody. Ends with the device, or with the program, which may be killed at any time. For a device
/// that has [`news`](Sensor::news), or to be told to stop, run a [`Shim`].
pub fn publish(sensor: &str, device: impl Sensor) -> Result<Summary, ShimError> {
    let node = Node::open(&Domain::of_environment(), NAME)?;
    Shim::new(&node, &sensor.parse()?, device, Flow::Live)?.run(&AtomicBool::new(false), &mut |_| ())
}
