//! The health channel of a sensor: its service says once a second how it fares, up to
//! [`MAX_HEALTH_READERS`](crate::MAX_HEALTH_READERS) programs look.
//!
//! Whoever comes gets the last message within 50 ms, and only the newest ever waits. Nobody is woken.

use crate::channel::{Channel, Purpose};
use crate::fixed::{Inlet, Outlet};
use crate::{ChannelError, HealthReport, Node, SensorName};

/// The service's end: the only one at a time.
#[derive(Debug)]
pub struct HealthPublisher(Outlet<HealthReport>);

/// A reader's end.
#[derive(Debug)]
pub struct HealthReader(Inlet<HealthReport>);

impl HealthPublisher {
    /// Opens the channel. Fails when another program serves this sensor.
    pub fn create(node: &Node, sensor: &SensorName) -> Result<Self, ChannelError> {
        Outlet::create(node, Channel::new(node, sensor, Purpose::Health)).map(Self)
    }

    /// Sends a report. Never waits for a reader. The transport allocates 48 bytes and frees them.
    pub fn send(&self, report: &HealthReport) -> Result<(), ChannelError> {
        self.0.send(report)
    }

    /// Gives readers that came since the last report that report. Call it once per tick.
    pub fn update(&self) -> Result<(), ChannelError> {
        self.0.update()
    }
}

impl HealthReader {
    /// Opens the channel, whether or not a service is there.
    pub fn open(node: &Node, sensor: &SensorName) -> Result<Self, ChannelError> {
        Inlet::open(node, Channel::new(node, sensor, Purpose::Health)).map(Self)
    }

    /// The report that waits, if any.
    pub fn receive(&self) -> Result<Option<HealthReport>, ChannelError> {
        self.0.receive()
    }

    /// Whether a service is there, or was killed and not yet cleaned up.
    pub fn is_published(&self) -> bool {
        self.0.is_published()
    }
}
