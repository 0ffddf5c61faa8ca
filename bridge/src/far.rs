//! The other machine's end: passes on what comes, into the kinds channel of that machine.

use std::fmt;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Instant;

use kinds_messages::{Node, REPORT_BUFFER, ReportPublisher, SensorName};
use zenoh::Wait;
use zenoh::handlers::{RingChannel, RingChannelHandler};
use zenoh::pubsub::Subscriber;
use zenoh::sample::{Sample, SampleKind};

use crate::arrivals::Arrivals;
use crate::held::Held;
use crate::link::{Link, key};
use crate::{Arrived, BridgeError, Endpoint, TICK, TURN_PERIOD};

/// The other machine's end of a bridge.
pub struct FarEnd {
    sensor: SensorName,
    node: Node,
    reports: ReportPublisher,
    arrivals: Arrivals,
    near_end: Other,
    wire: Held<Wire>,
}

/// What it has in the network.
#[derive(Debug)]
struct Wire {
    /// What came, the newest: reports are lost here only if this process stands still.
    inbox: Subscriber<RingChannelHandler<Sample>>,
    /// Whether the near end is there, as [`Self::_life`] hears.
    is_linked: Arc<AtomicBool>,
    _life: Subscriber<()>,
    link: Link,
}

/// What is known of the other end.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Other {
    Unknown,
    /// It has not come yet.
    Awaited,
    There,
    Lost,
}

impl FarEnd {
    /// Opens the kinds channel of a sensor in place of a service, and looks for the near end at an address until it is there.
    ///
    /// Fails where a service, or another far end, has that place.
    pub fn connect(node: &Node, sensor: &SensorName, endpoint: &Endpoint) -> Result<Self, BridgeError> {
        let reports = ReportPublisher::create(node, sensor)?;
        let link = Link::connect(endpoint)?;
        let inbox =
            link.session().declare_subscriber(key(sensor)).with(RingChannel::new(REPORT_BUFFER)).wait();
        let is_linked = Arc::new(AtomicBool::new(false));
        let hears = Arc::clone(&is_linked);
        let life = link.session().liveliness().declare_subscriber(key(sensor)).history(true);
        let life = life.callback(move |sign| hears.store(sign.kind() == SampleKind::Put, Ordering::Relaxed));
        let wire = Wire {
            inbox: inbox.map_err(link.error("subscribe"))?,
            is_linked,
            _life: life.wait().map_err(link.error("subscribe"))?,
            link,
        };
        Ok(Self {
            sensor: sensor.clone(),
            node: node.clone(),
            reports,
            arrivals: Arrivals::default(),
            near_end: Other::Unknown,
            wire: Held::new(wire),
        })
    }

    /// Passes reports on until `stop` is set.
    ///
    /// * `tell` — is told what a person should know, when it comes to be
    /// * `turned` — is told about once a second that the loop turns
    pub fn run(
        &mut self,
        stop: &AtomicBool,
        tell: &mut dyn FnMut(String),
        turned: &mut dyn FnMut(&Arrived),
    ) -> Result<Arrived, BridgeError> {
        let mut last_turn = Instant::now();
        while !stop.load(Ordering::Relaxed) {
            self.look_for_near_end(tell);
            self.pass_on_next(tell)?;
            if last_turn.elapsed() >= TURN_PERIOD {
                last_turn = Instant::now();
                self.node.clean_up_dead_nodes();
                turned(&self.arrivals.arrived());
            }
        }
        Ok(self.arrivals.arrived())
    }

    fn look_for_near_end(&mut self, tell: &mut dyn FnMut(String)) {
        let (sensor, endpoint) = (&self.sensor, self.wire.link.endpoint());
        let (state, words) = match (self.near_end, self.wire.is_linked.load(Ordering::Relaxed)) {
            (Other::Unknown, false) => (
                Other::Awaited,
                format!(
                    "waiting for the robot's end at {endpoint} (kinds bridge --sensor {sensor} --listen …)"
                ),
            ),
            (Other::Unknown | Other::Awaited, true) => {
                (Other::There, format!("the robot's end at {endpoint} is there"))
            }
            (Other::There, false) => {
                (Other::Lost, format!("the link to the robot's end at {endpoint} is lost; waiting for it"))
            }
            (Other::Lost, true) => {
                (Other::There, format!("the link to the robot's end at {endpoint} is back"))
            }
            (Other::Awaited | Other::Lost, false) | (Other::There, true) => return,
        };
        self.near_end = state;
        tell(words);
    }

    /// Waits a tick for a report, and passes it on.
    fn pass_on_next(&mut self, tell: &mut dyn FnMut(String)) -> Result<(), BridgeError> {
        match self.wire.inbox.recv_timeout(TICK).map_err(self.wire.link.error("receive"))? {
            Some(sample) => {
                if let Some(report) = self.arrivals.take(&sample.payload().to_bytes()) {
                    self.reports.pass_on(&report)?;
                }
            }
            // Whoever came since the last report gets it all the same.
            None => self.reports.update()?,
        }
        while let Some(news) = self.arrivals.news() {
            tell(format!("{}: {news}", self.sensor));
        }
        Ok(())
    }
}

impl fmt::Debug for FarEnd {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("FarEnd")
            .field("sensor", &self.sensor)
            .field("wire", &self.wire)
            .finish_non_exhaustive()
    }
}
