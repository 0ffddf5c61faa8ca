//! What frames and kinds channels have in common: names, limits, opening with patience, and waiting.

use std::fmt::Debug;
use std::path::PathBuf;
use std::sync::Arc;
use std::time::{Duration, Instant};

use iceoryx2::port::listener::{Listener, ListenerWaitError};
use iceoryx2::port::notifier::{Notifier, NotifierNotifyError};
use iceoryx2::prelude::{IceoryxSend, ServiceName, ZeroCopySend, ipc};
use iceoryx2::service::builder::publish_subscribe::Builder;
use iceoryx2::service::port_factory::event::PortFactory as Events;

use crate::error::Obstacle;
use crate::sweeper::Sweeper;
use crate::{ChannelError, Node, SensorName, half_made};

/// Most programs that read a sensor's frames at one time.
pub const MAX_FRAME_READERS: usize = 8;
/// Frames that wait for a reader; when one more comes, the oldest is gone.
pub const FRAME_BUFFER: usize = 16;
/// Most programs that read a sensor's kind reports at one time.
pub const MAX_REPORT_READERS: usize = 16;
/// Reports that wait for a reader; when one more comes, the oldest is gone.
pub const REPORT_BUFFER: usize = 256;
/// Most programs that read a service's health at one time.
pub const MAX_HEALTH_READERS: usize = 8;

/// What the names of all our channels begin with.
const PREFIX: &str = "natural-kinds/";

/// How long, and how often at least, opening is tried: long enough for what a killed program left to be cleaned up
/// by somebody else, short enough that a refusal does not look like a hang.
const PATIENCE: Duration = Duration::from_millis(500);
const N_ATTEMPTS_MIN: u32 = 3;
const PAUSE: Duration = Duration::from_millis(10);

/// Why a wait ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum WakeUp {
    /// Something was sent since the last wait, or a publisher came. Events coalesce: take all messages there are.
    Event,
    /// Nothing came.
    Timeout,
    /// A signal came: look at the stop flag.
    Interrupted,
}

/// How a reader comes to look for messages.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Waiting {
    /// Asleep until the publisher wakes it.
    #[default]
    ByEvent,
    /// Awake, looking again and again: spares the wake-up on one end and the call for it on the other, and costs one processor
    /// core, all the time.
    Polling,
}

/// A request for a channel of messages.
type Messages<P, H> = Builder<P, H, ipc::Service>;

/// What a channel carries.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Purpose {
    /// Frames, from a driver shim.
    Frames,
    /// A report on each frame, from a service.
    Kinds,
    /// How a service fares.
    Health,
    /// Requests that a service take another model.
    ReloadRequests,
    /// What a service says to them.
    ReloadAnswers,
}

impl Purpose {
    const ALL: [Self; 5] =
        [Self::Frames, Self::Kinds, Self::Health, Self::ReloadRequests, Self::ReloadAnswers];

    /// The end of the name of a channel that carries this.
    pub fn name(self) -> &'static str {
        match self {
            Self::Frames => "frames",
            Self::Kinds => "kinds",
            Self::Health => "health",
            Self::ReloadRequests => "reload",
            Self::ReloadAnswers => "reloaded",
        }
    }

    /// Most programs that read such a channel at one time.
    pub fn max_readers(self) -> usize {
        self.limits().readers
    }

    pub(crate) fn limits(self) -> Limits {
        match self {
            Self::Frames => Limits::FRAMES,
            Self::Kinds => Limits::KINDS,
            Self::Health => Limits::HEALTH,
            Self::ReloadRequests | Self::ReloadAnswers => Limits::RELOADS,
        }
    }

    /// The name of a sensor's channel.
    pub(crate) fn of(self, sensor: &SensorName) -> String {
        format!("{PREFIX}{sensor}/{}", self.name())
    }

    /// Which channel of which sensor has this name, if it is one of ours.
    pub(crate) fn parse(name: &str) -> Option<(SensorName, Self)> {
        let (sensor, end) = name.strip_prefix(PREFIX)?.rsplit_once('/')?;
        let purpose = Self::ALL.into_iter().find(|purpose| purpose.name() == end)?;
        Some((sensor.parse().ok()?, purpose))
    }
}

/// Room on a channel. Part of what processes must agree on.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Limits {
    pub(crate) readers: usize,
    /// Messages waiting for each reader.
    pub(crate) buffer: usize,
    /// Messages that a reader may hold at once.
    pub(crate) held: usize,
    /// Messages that a late joiner gets.
    pub(crate) history: usize,
    /// Messages being filled at once.
    pub(crate) loans: usize,
}

impl Limits {
    pub(crate) const FRAMES: Self =
        Self { readers: MAX_FRAME_READERS, buffer: FRAME_BUFFER, held: 2, history: 0, loans: 1 };
    pub(crate) const KINDS: Self =
        Self { readers: MAX_REPORT_READERS, buffer: REPORT_BUFFER, held: 2, history: 1, loans: 1 };
    pub(crate) const HEALTH: Self =
        Self { readers: MAX_HEALTH_READERS, buffer: 1, held: 1, history: 1, loans: 1 };
    pub(crate) const RELOADS: Self = Self { readers: 2, buffer: 4, held: 1, history: 0, loans: 1 };

    /// Programs that may have a channel open: its readers, its publisher, and room for tools and programs that are
    /// just starting.
    pub(crate) const fn programs(self) -> usize {
        self.readers + 8
    }

    /// Slots that a publisher keeps: what all readers may leave waiting or hold, and what it holds itself.
    pub(crate) const fn slots(self) -> usize {
        self.readers * (self.buffer + self.held) + self.history + self.loans
    }
}

/// One channel of one sensor.
#[derive(Clone, Debug)]
pub(crate) struct Channel {
    pub(crate) sensor: SensorName,
    pub(crate) purpose: Purpose,
    pub(crate) root: PathBuf,
    /// Sweeps until the channel's ends are closed, which may have to wait as well.
    #[expect(dead_code, reason = "held, and never asked")]
    pub(crate) sweeper: Option<Arc<Sweeper>>,
}

impl Channel {
    pub(crate) fn new(node: &Node, sensor: &SensorName, purpose: Purpose) -> Self {
        let (root, sweeper) = (node.domain.root.clone(), node.sweeper.clone());
        Self { sensor: sensor.clone(), purpose, root, sweeper }
    }

    pub(crate) fn name(&self) -> String {
        self.purpose.of(&self.sensor)
    }

    pub(crate) fn service_name(&self) -> ServiceName {
        ServiceName::new(&self.name()).expect("a sensor name is short and of plain characters")
    }

    pub(crate) fn limits(&self) -> Limits {
        self.purpose.limits()
    }

    /// Asks for messages of one kind with the channel's limits, which whoever opens it must agree on.
    pub(crate) fn limited<P, H>(&self, messages: Messages<P, H>) -> Messages<P, H>
    where
        P: Debug + IceoryxSend + ?Sized,
        H: Debug + ZeroCopySend,
    {
        let limits = self.limits();
        messages
            .max_publishers(1)
            .max_subscribers(limits.readers)
            .max_nodes(limits.programs())
            .subscriber_max_buffer_size(limits.buffer)
            .subscriber_max_borrowed_samples(limits.held)
            .history_size(limits.history)
            .enable_safe_overflow(true)
    }

    /// Opens the publisher's end of the channel's events, and wakes the readers: they connect when they look.
    pub(crate) fn notifier(&self, node: &Node) -> Result<Notifier<ipc::Service>, Obstacle> {
        let notifier = self.events(node)?.notifier_builder().create();
        let notifier = notifier.map_err(|error| Obstacle::notifier(error, self))?;
        // Nobody may be listening, and then nobody needs to be woken.
        let _ = notifier.notify();
        Ok(notifier)
    }

    /// Opens a reader's end of the channel's events, unless it polls: a publisher need not wake whom it finds awake.
    pub(crate) fn listener(
        &self,
        node: &Node,
        waiting: Waiting,
    ) -> Result<Option<Listener<ipc::Service>>, Obstacle> {
        match waiting {
            Waiting::Polling => Ok(None),
            Waiting::ByEvent => {
                let listener = self.events(node)?.listener_builder().create();
                listener.map(Some).map_err(|error| Obstacle::listener(error, self))
            }
        }
    }

    /// Opens or makes the channel's events, by which readers are woken.
    fn events(&self, node: &Node) -> Result<Events<ipc::Service>, Obstacle> {
        let limits = self.limits();
        node.inner
            .service_builder(&self.service_name())
            .event()
            .max_listeners(limits.readers)
            .max_notifiers(1)
            .max_nodes(limits.programs())
            .open_or_create()
            .map_err(|error| Obstacle::events(error, self))
    }
}

/// Tries until it works, until it cannot work, or until patience ends, cleaning up after killed programs in between.
pub(crate) fn patiently<T>(
    node: &Node,
    mut attempt: impl FnMut() -> Result<T, Obstacle>,
) -> Result<T, ChannelError> {
    let deadline = Instant::now() + PATIENCE;
    let mut n_attempts = 0;
    loop {
        let obstacle = match attempt() {
            Ok(opened) => return Ok(opened),
            Err(obstacle) => obstacle,
        };
        n_attempts += 1;
        if !obstacle.passing || (n_attempts >= N_ATTEMPTS_MIN && Instant::now() >= deadline) {
            return Err(obstacle.error);
        }
        node.clean_up_dead_nodes();
        half_made::remove(&node.domain);
        std::thread::sleep(PAUSE);
    }
}

/// Waits for an event of the channel, or where nobody listens for the time to pass.
pub(crate) fn wait(
    listener: Option<&Listener<ipc::Service>>,
    timeout: Duration,
    channel: &Channel,
) -> Result<WakeUp, ChannelError> {
    let Some(listener) = listener else {
        std::thread::sleep(timeout);
        return Ok(WakeUp::Timeout);
    };
    // A timeout that rounds to 0 µs would be taken for "for ever".
    let woken = if timeout < Duration::from_micros(1) {
        listener.try_wait(|_| {})
    } else {
        listener.timed_wait(|_| {}, timeout)
    };
    match woken {
        Ok(0) => Ok(WakeUp::Timeout),
        Ok(_) => Ok(WakeUp::Event),
        Err(ListenerWaitError::InterruptSignal) => Ok(WakeUp::Interrupted),
        Err(error) => Err(ChannelError::transport("wait on", channel, error)),
    }
}

/// Wakes all readers of the channel.
pub(crate) fn notify(notifier: &Notifier<ipc::Service>, channel: &Channel) -> Result<(), ChannelError> {
    match notifier.notify() {
        // A missed deadline is somebody else's setting; the event was delivered all the same.
        Ok(_) | Err(NotifierNotifyError::MissedDeadline) => Ok(()),
        Err(error) => Err(ChannelError::transport("notify readers of", channel, error)),
    }
}
