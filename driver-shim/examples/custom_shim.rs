//! A shim of one's own: what reads a device, here a counter that stands for one, is all that there is to write.

use std::{error::Error, sync::atomic::AtomicBool, time::Duration};

use kinds_driver_shim::{Capture, Flow, Reading, Sensor, SensorError, Shim};
use kinds_messages::{Domain, Node, ns_since_epoch};
use kinds_trips::{FrameLayout, Stamp};

struct Ring(u16);

impl Sensor for Ring {
    fn layout(&self) -> FrameLayout {
        FrameLayout { rows: 1, columns: 16, metres_per_count: 0.001 }
    }
    fn read(&mut self, counts: &mut [u16], timeout: Duration) -> Result<Reading, SensorError> {
        std::thread::sleep(timeout); // until the device has a frame; Reading::NotYet if it has none in time
        self.0 += 1;
        counts.fill(self.0); // in shared memory
        let captured = Stamp(ns_since_epoch());
        Ok(Reading::Frame(Capture { captured, pose: None, command: None, true_pose: None }))
    }
}

pub(crate) fn publish(domain: &Domain, sensor: &str, stop: &AtomicBool) -> Result<(), Box<dyn Error>> {
    let node = Node::open(domain, "ring-shim")?;
    Shim::new(&node, &sensor.parse()?, Ring(0), Flow::Live)?.run(stop, &mut |_notice| ())?;
    Ok(())
}

fn main() -> Result<(), Box<dyn Error>> {
    publish(&Domain::default(), "crunch/ring", &AtomicBool::new(false))
}
