//! How far a shim waits for others: for the first reader, for the service's reports, and at its end for both.

use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

use kinds_messages::{ChannelError, FramePublisher, Node, ReportReader, SensorName, ServiceId};

use crate::Notice;

/// Most frames on their way to the service and back when it is followed: enough to keep it busy, and half of what the
/// frames channel holds for a reader, so that none is ever lost.
pub const FOLLOW_WINDOW: u64 = kinds_messages::FRAME_BUFFER as u64 / 2;

/// Longest time between two looks at the stop flag and at who came and went.
pub(crate) const TICK: Duration = Duration::from_millis(50);
/// How often what killed programs left is looked for, and how often it is told that the loop turns.
const CLEAN_UP_PERIOD: Duration = Duration::from_secs(1);
/// Silence of a service that is worth a notice, and that ends the wait for its last reports.
const SILENCE: Duration = Duration::from_secs(2);
/// How long readers that do not report have to look at the last frames: twice the longest tick of a reader.
const LINGER: Duration = Duration::from_millis(100);

/// How far a shim waits for others.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Flow {
    /// Not at all: a robot's sensor.
    Live,
    /// The first frame waits until somebody reads frames.
    FromFirstReader,
    /// Frames wait until a service is there and has reported all but [`FOLLOW_WINDOW`] of those before.
    Followed,
}

/// Waits as a flow asks, and removes what killed programs left meanwhile.
pub(crate) struct Traffic {
    sensor: SensorName,
    flow: Flow,
    follower: Option<Follower>,
    node: Node,
    last_clean_up: Instant,
    /// Told about once a second that the loop turns.
    listener: Option<Box<dyn FnMut()>>,
    /// Said already, and still so.
    told_waiting: bool,
    told_silent: bool,
}

impl Traffic {
    pub(crate) fn open(node: &Node, sensor: &SensorName, flow: Flow, run: u64) -> Result<Self, ChannelError> {
        let follower = match flow {
            Flow::Live => None,
            Flow::FromFirstReader | Flow::Followed => Some(Follower::open(node, sensor, run)?),
        };
        Ok(Self {
            sensor: sensor.clone(),
            flow,
            follower,
            node: node.clone(),
            last_clean_up: Instant::now(),
            listener: None,
            told_waiting: false,
            told_silent: false,
        })
    }

    pub(crate) fn listen_to_turns(&mut self, listener: Box<dyn FnMut()>) {
        self.listener = Some(listener);
    }

    /// Whose traffic it is.
    pub(crate) fn sensor(&self) -> &SensorName {
        &self.sensor
    }

    /// Frames left unreported by services that went or fell silent, if services are followed.
    pub(crate) fn n_unreported(&self) -> u64 {
        match (&self.follower, self.flow) {
            (Some(follower), Flow::Followed) => follower.n_unreported,
            _ => 0,
        }
    }

    /// Waits for whom the first frame waits for. Returns whether to go on.
    pub(crate) fn await_reader(
        &mut self,
        frames: &FramePublisher,
        stop: &AtomicBool,
        notice: &mut dyn FnMut(Notice),
    ) -> Result<bool, ChannelError> {
        loop {
            self.clean_up();
            let Some(follower) = &mut self.follower else { return Ok(true) };
            follower.look(0)?;
            let waits_for_service = self.flow == Flow::Followed && follower.service.is_none();
            let sensor = || self.sensor.clone();
            if frames.n_readers() > 0 && !waits_for_service {
                if std::mem::take(&mut self.told_waiting) {
                    notice(Notice::Publishing { sensor: sensor() });
                }
                return Ok(true);
            }
            if stop.load(Ordering::Relaxed) {
                return Ok(false);
            }
            if !std::mem::replace(&mut self.told_waiting, true) {
                notice(if waits_for_service {
                    Notice::WaitingForService { sensor: sensor() }
                } else {
                    Notice::WaitingForReader { sensor: sensor() }
                });
            }
            // A service that comes is an event. A reader is none, and is seen at the next tick.
            follower.reports.wait(TICK)?;
        }
    }

    /// Waits until the frame numbered `n_sent` may be sent. Returns whether to go on.
    pub(crate) fn await_room(
        &mut self,
        n_sent: u64,
        stop: &AtomicBool,
        notice: &mut dyn FnMut(Notice),
    ) -> Result<bool, ChannelError> {
        let mut silent_since = Instant::now();
        loop {
            self.clean_up();
            if stop.load(Ordering::Relaxed) {
                return Ok(false);
            }
            let follower = match &mut self.follower {
                Some(follower) if self.flow == Flow::Followed => follower,
                _ => return Ok(true),
            };
            let seen = follower.look(n_sent)?;
            let sensor = || self.sensor.clone();
            if seen.n_left > 0 {
                notice(Notice::ServiceGone { sensor: sensor(), n_unreported: seen.n_left });
            }
            if seen.n_reported > 0 {
                silent_since = Instant::now();
                self.told_silent = false;
            }
            if follower.service.is_none() {
                if !std::mem::replace(&mut self.told_waiting, true) {
                    notice(Notice::WaitingForService { sensor: sensor() });
                }
            } else {
                if std::mem::take(&mut self.told_waiting) {
                    notice(Notice::Publishing { sensor: sensor() });
                }
                if n_sent - follower.n_done < FOLLOW_WINDOW {
                    return Ok(true);
                }
                if silent_since.elapsed() >= SILENCE && !std::mem::replace(&mut self.told_silent, true) {
                    notice(Notice::ServiceSilent { sensor: sensor(), sequence: follower.n_done });
                }
            }
            follower.reports.wait(TICK)?;
        }
    }

    /// Waits until the last frames have been taken: reported, or the service silent, and a moment for everybody else.
    pub(crate) fn linger(&mut self, n_sent: u64, stop: &AtomicBool) -> Result<(), ChannelError> {
        let mut silent_since = Instant::now();
        while let Some(follower) = &mut self.follower
            && !stop.load(Ordering::Relaxed)
        {
            if follower.look(n_sent)?.n_reported > 0 {
                silent_since = Instant::now();
            }
            let is_over = follower.n_done == n_sent || silent_since.elapsed() >= SILENCE;
            if is_over || follower.service.is_none() {
                follower.write_off(n_sent);
                break;
            }
            follower.reports.wait(TICK)?;
            self.clean_up();
        }
        if !stop.load(Ordering::Relaxed) {
            std::thread::sleep(LINGER);
        }
        Ok(())
    }

    /// Called in every turn of every loop; does something about once a second.
    pub(crate) fn clean_up(&mut self) {
        if self.last_clean_up.elapsed() >= CLEAN_UP_PERIOD {
            self.node.clean_up_dead_nodes();
            self.last_clean_up = Instant::now();
            if let Some(listener) = &mut self.listener {
                listener();
            }
        }
    }
}

/// What the service has reported of this shim's frames.
struct Follower {
    reports: ReportReader,
    run: u64,
    /// The service of the last look.
    service: Option<ServiceId>,
    /// Frames before this one are reported or written off.
    n_done: u64,
    n_unreported: u64,
}

/// What a look found.
struct Seen {
    /// Frames reported since the last look.
    n_reported: u64,
    /// Frames written off, since the service that they were sent to is gone.
    n_left: u64,
}

impl Follower {
    fn open(node: &Node, sensor: &SensorName, run: u64) -> Result<Self, ChannelError> {
        let reports = ReportReader::open(node, sensor)?;
        Ok(Self { reports, run, service: None, n_done: 0, n_unreported: 0 })
    }

    /// Takes the reports that are there, and looks whether the service still is.
    fn look(&mut self, n_sent: u64) -> Result<Seen, ChannelError> {
        // In this order: all that a service will ever have said is there once it is seen to be gone.
        let service = self.reports.service();
        let n_done_before = self.n_done;
        while let Some(report) = self.reports.receive()? {
            if report.run == self.run {
                self.n_done = self.n_done.max(report.sequence.saturating_add(1)).min(n_sent);
            }
        }
        let n_reported = self.n_done - n_done_before;
        let before = std::mem::replace(&mut self.service, service);
        let n_left = if before.is_some() && before != service { self.write_off(n_sent) } else { 0 };
        Ok(Seen { n_reported, n_left })
    }

    /// Expects no more reports of the frames sent, and returns how many there were none of.
    fn write_off(&mut self, n_sent: u64) -> u64 {
        let n_left = n_sent - self.n_done;
        self.n_done = n_sent;
        self.n_unreported += n_left;
        n_left
    }
}
