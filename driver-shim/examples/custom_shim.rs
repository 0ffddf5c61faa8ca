//! A shim of one's own: what reads a device, here a counter that stands for one, is all that there is to write.

use std::time::Duration;

use kinds_driver_shim::{Capture, FrameLayout, Reading, Sensor, SensorError, ShimError, publish};

struct Ring(u16);

impl Sensor for Ring {
    fn layout(&self) -> FrameLayout {
        FrameLayout { rows: 1, columns: 16, metres_per_count: 0.001 }
    }

    fn read(&mut self, counts: &mut [u16], timeout: Duration) -> Result<Reading, SensorError> {
        std::thread::sleep(timeout); // until the device has a frame; Reading::NotYet if it has none in time
        self.0 += 1;
        counts.fill(self.0); // in shared memory
        Ok(Reading::Frame(Capture::now()))
    }
}

pub(crate) fn main() -> Result<(), ShimError> {
    publish("crunch/ring", Ring(0)).map(drop)
}
