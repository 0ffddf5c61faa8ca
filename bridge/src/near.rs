//! The robot's end: reads the kinds channel, and sends what the link takes.

use std::fmt;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

use kinds_messages::{KindReport, Node, ReportReader, SensorName, Spell, monotonic_ns};
use zenoh::Wait;
use zenoh::liveliness::LivelinessToken;
use zenoh::pubsub::Publisher;
use zenoh::qos::CongestionControl;

use crate::held::Held;
use crate::link::{Link, key};
use crate::outbox::Outbox;
use crate::{BridgeError, Endpoint, TICK, TURN_PERIOD};

/// How long what waits is still sent after somebody has said that it is enough.
const LINGER: Duration = Duration::from_millis(50);

/// The robot's end of a bridge.
pub struct NearEnd {
    sensor: SensorName,
    node: Node,
    reports: ReportReader,
    /// The last of all, which is in the outbox or was sent.
    last: Option<KindReport>,
    outbox: Outbox,
    n_sent: u64,
    left_out: Spell,
    /// Whether a far end is there.
    is_read: bool,
    wire: Held<Wire>,
}

/// What it has in the network.
#[derive(Debug)]
struct Wire {
    publisher: Publisher<'static>,
    /// Tells far ends that this one is there.
    _sign_of_life: LivelinessToken,
    link: Link,
}

/// What became of the reports.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Sent {
    /// Reports that the link took.
    pub n_sent: u64,
    /// Reports that it would not take in time while somebody was there to read them.
    pub n_left_out: u64,
}

impl NearEnd {
    /// Opens the kinds channel of a sensor, and waits for far ends at an address.
    pub fn listen(node: &Node, sensor: &SensorName, endpoint: &Endpoint) -> Result<Self, BridgeError> {
        let reports = ReportReader::open(node, sensor)?;
        let link = Link::listen(endpoint)?;
        let publisher = link.session().declare_publisher(key(sensor));
        // Whoever sends waits for the link, and meanwhile the oldest of what waits is left out here: where the library waits for
        // nobody, it leaves out the newest.
        let publisher = publisher.congestion_control(CongestionControl::Block).wait();
        let publisher = publisher.map_err(link.error("publish"))?;
        let sign_of_life = link.session().liveliness().declare_token(key(sensor)).wait();
        let sign_of_life = sign_of_life.map_err(link.error("publish"))?;
        Ok(Self {
            sensor: sensor.clone(),
            node: node.clone(),
            reports,
            last: None,
            outbox: Outbox::default(),
            n_sent: 0,
            left_out: Spell::default(),
            is_read: false,
            wire: Held::new(Wire { publisher, _sign_of_life: sign_of_life, link }),
        })
    }

    /// Sends reports until `stop` is set.
    ///
    /// * `tell` — is told what a person should know, when it comes to be
    /// * `turned` — is told about once a second that the loop turns, which it does unless the link takes nothing for seconds
    pub fn run(
        &mut self,
        stop: &AtomicBool,
        tell: &mut dyn FnMut(String),
        turned: &mut dyn FnMut(&Sent),
    ) -> Result<Sent, BridgeError> {
        let (mut last_turn, mut n_sent_before) = (Instant::now(), 0);
        let mut stopped: Option<Instant> = None;
        loop {
            // Read before the channel is: what was reported before the flag was set is sent.
            if stop.load(Ordering::Relaxed) {
                stopped.get_or_insert_with(Instant::now);
            }
            self.look_for_readers(tell)?;
            self.collect(tell)?;
            // One at a time: it may take long, and then others are too old.
            let next = if self.is_read { self.outbox.pop() } else { None };
            match (next, stopped) {
                (Some(report), stopped) if stopped.is_none_or(|stopped| stopped.elapsed() < LINGER) => {
                    self.send(&report, tell)?;
                }
                (_, Some(_)) => return Ok(self.sent()),
                _ => drop(self.reports.wait(TICK)?),
            }
            if last_turn.elapsed() >= TURN_PERIOD {
                last_turn = Instant::now();
                self.node.clean_up_dead_nodes();
                if std::mem::replace(&mut n_sent_before, self.n_sent) == self.n_sent {
                    self.repeat_last()?;
                }
                turned(&self.sent());
            }
        }
    }

    /// Sends the last report again, for far ends that came after it; the others leave it alone.
    fn repeat_last(&self) -> Result<(), BridgeError> {
        match &self.last {
            Some(last) if self.is_read => self.wire.put(last),
            _ => Ok(()),
        }
    }

    fn sent(&self) -> Sent {
        Sent { n_sent: self.n_sent, n_left_out: self.left_out.n() }
    }

    fn look_for_readers(&mut self, tell: &mut dyn FnMut(String)) -> Result<(), BridgeError> {
        let matching =
            self.wire.publisher.matching_status().wait().map_err(self.wire.link.error("look for readers"))?;
        let sensor = &self.sensor;
        match (self.is_read, matching.matching()) {
            (false, true) => tell(format!("another machine reads {sensor}")),
            (true, false) => tell(format!("no other machine reads {sensor} any more")),
            _ => {}
        }
        self.is_read = matching.matching();
        Ok(())
    }

    /// Takes what the channel has, and leaves out what is too old.
    fn collect(&mut self, tell: &mut dyn FnMut(String)) -> Result<(), BridgeError> {
        let mut n_left_out = 0;
        while let Some(report) = self.reports.receive()? {
            n_left_out += self.last.replace(report).map_or(0, |last| report.n_missed_since(&last));
            n_left_out += u64::from(self.outbox.push(report));
        }
        n_left_out += self.outbox.leave_out_old(monotonic_ns());
        // What nobody reads is not left out.
        if self.is_read && n_left_out > 0 && self.left_out.count(n_left_out) {
            tell(format!(
                "the link takes fewer reports of {} than there are; the oldest are left out",
                self.sensor
            ));
        }
        Ok(())
    }

    fn send(&mut self, report: &KindReport, tell: &mut dyn FnMut(String)) -> Result<(), BridgeError> {
        self.wire.put(report)?;
        self.n_sent += 1;
        // While others wait the link is not yet quick enough: what it takes, it takes by fits and starts.
        if self.outbox.is_empty()
            && let Some(n) = self.left_out.calm()
        {
            tell(format!("the link takes all reports of {} again; {n} were left out", self.sensor));
        }
        Ok(())
    }
}

impl Wire {
    /// Sends a report, which takes as long as the link does.
    fn put(&self, report: &KindReport) -> Result<(), BridgeError> {
        self.publisher.put(report.as_bytes()).wait().map_err(self.link.error("send"))
    }
}

impl fmt::Debug for NearEnd {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("NearEnd")
            .field("sensor", &self.sensor)
            .field("wire", &self.wire)
            .finish_non_exhaustive()
    }
}
