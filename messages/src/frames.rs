//! The frames channel of a sensor: one driver shim publishes, up to
//! [`MAX_FRAME_READERS`](crate::MAX_FRAME_READERS) programs read.
//!
//! Frames are for those who are there: nobody gets frames sent before it came. A slow reader finds at most the last
//! [`FRAME_BUFFER`](crate::FRAME_BUFFER), and gaps in their sequence.
//!
//! A publisher that goes leaves its undelivered frames to every reader that has connected to it, which a reader does
//! whenever it looks for frames. So that readers look at once, a publisher wakes them when it comes; a run that is
//! over sooner than a waiting reader takes to wake up is nevertheless lost, so linger for a moment after the last frame.

use std::time::Duration;

use iceoryx2::port::listener::Listener;
use iceoryx2::port::notifier::Notifier;
use iceoryx2::port::publisher::Publisher;
use iceoryx2::port::subscriber::Subscriber;
use iceoryx2::port::update_connections::UpdateConnections;
use iceoryx2::port::{LoanError, ReceiveError};
use iceoryx2::prelude::{PortFactory as _, ipc};
use iceoryx2::sample::Sample;
use iceoryx2::sample_mut::SampleMut;
use iceoryx2::service::port_factory::publish_subscribe::PortFactory;

use crate::channel::{Channel, Purpose, Waiting, WakeUp, notify, patiently, wait};
use crate::error::Obstacle;
use crate::memory::{check_free, frames_memory_bytes};
use crate::{ChannelError, FrameHeader, Node, SensorName, monotonic_ns};

type Frames = PortFactory<ipc::Service, [u16], FrameHeader>;

/// The driver shim's end: the only one at a time.
#[derive(Debug)]
pub struct FramePublisher {
    // Dropped in this order: the place of the publisher is the last to become free.
    notifier: Notifier<ipc::Service>,
    publisher: Publisher<ipc::Service, [u16], FrameHeader>,
    frames: Frames,
    channel: Channel,
    n_readings: usize,
}

impl FramePublisher {
    /// Opens the channel for frames of up to `n_readings` readings.
    ///
    /// Fails when another program publishes this sensor, and when [`frames_memory_bytes`] of shared memory are not
    /// free. Takes the place of a program that has been killed.
    pub fn create(node: &Node, sensor: &SensorName, n_readings: usize) -> Result<Self, ChannelError> {
        let channel = Channel::new(node, sensor, Purpose::Frames);
        check_free(&channel, frames_memory_bytes(n_readings))?;
        patiently(node, || Self::try_create(node, &channel, n_readings))
    }

    fn try_create(node: &Node, channel: &Channel, n_readings: usize) -> Result<Self, Obstacle> {
        let frames = open_frames(node, channel)?;
        // The transport would refuse as well, but only after making its slots.
        if frames.dynamic_config().number_of_publishers() > 0 {
            return Err(Obstacle::occupied(channel));
        }
        let publisher = frames
            .publisher_builder()
            .initial_max_slice_len(n_readings)
            .max_loaned_samples(channel.limits().loans)
            .create()
            .map_err(|error| Obstacle::publisher(error, channel))?;
        let notifier = channel.notifier(node)?;
        Ok(Self { notifier, publisher, frames, channel: channel.clone(), n_readings })
    }

    /// Lends a slot in shared memory, all counts 0, to be filled and sent, or dropped. One at a time.
    pub fn loan(&self) -> Result<FrameLoan<'_>, ChannelError> {
        self.lend(self.n_readings)
    }

    fn lend(&self, n_readings: usize) -> Result<FrameLoan<'_>, ChannelError> {
        let slot = self.publisher.loan_slice(n_readings).map_err(|error| match error {
            LoanError::ExceedsMaxLoans => {
                ChannelError::TooManyHeld { channel: self.channel.name(), limit: self.channel.limits().loans }
            }
            other => ChannelError::transport("lend a frame of", &self.channel, other),
        })?;
        Ok(FrameLoan { slot, publisher: self })
    }

    /// Connects readers that came since the last frame. Call it once per tick, for when no frames are sent.
    pub fn update(&self) -> Result<(), ChannelError> {
        self.publisher
            .update_connections()
            .map_err(|error| ChannelError::transport("connect readers of", &self.channel, error))
    }

    /// How many readers there are, counting those that were killed and not yet cleaned up.
    pub fn n_readers(&self) -> usize {
        self.frames.dynamic_config().number_of_subscribers()
    }
}

/// A slot in shared memory lent to the driver shim.
#[derive(Debug)]
pub struct FrameLoan<'publisher> {
    slot: SampleMut<ipc::Service, [u16], FrameHeader>,
    publisher: &'publisher FramePublisher,
}

impl FrameLoan<'_> {
    /// The counts, `(n_readings,)`, where readers will read them.
    pub fn counts_mut(&mut self) -> &mut [u16] {
        self.slot.payload_mut()
    }

    /// Sends the frame, with the time of sending, and wakes the readers. Never waits for one.
    pub fn send(mut self, header: &FrameHeader) -> Result<(), ChannelError> {
        let FramePublisher { notifier, channel, .. } = self.publisher;
        *self.slot.user_header_mut() = FrameHeader { sent_monotonic_ns: monotonic_ns(), ..*header };
        self.slot.send().map_err(|error| ChannelError::transport("send a frame on", channel, error))?;
        notify(notifier, channel)
    }

    /// Sends only the first counts, as a device at fault hands them over, for readers to refuse: a frame's length is settled
    /// when its slot is lent, so this takes another one, and copies.
    pub fn send_first(self, n_readings: usize, header: &FrameHeader) -> Result<(), ChannelError> {
        let Self { slot, publisher } = self;
        let counts = slot.payload()[..n_readings].to_vec();
        // One loan at a time.
        drop(slot);
        let mut shorter = publisher.lend(n_readings)?;
        shorter.counts_mut().copy_from_slice(&counts);
        shorter.send(header)
    }
}

/// A reader's end.
#[derive(Debug)]
pub struct FrameReader {
    subscriber: Subscriber<ipc::Service, [u16], FrameHeader>,
    /// None of a reader that polls.
    listener: Option<Listener<ipc::Service>>,
    frames: Frames,
    channel: Channel,
}

impl FrameReader {
    /// Opens the channel, whether or not a driver shim is there.
    pub fn open(node: &Node, sensor: &SensorName) -> Result<Self, ChannelError> {
        Self::open_with(node, sensor, Waiting::ByEvent)
    }

    /// The same for a reader that may look for messages in another way than by event.
    pub fn open_with(node: &Node, sensor: &SensorName, waiting: Waiting) -> Result<Self, ChannelError> {
        let channel = Channel::new(node, sensor, Purpose::Frames);
        patiently(node, || Self::try_open(node, &channel, waiting))
    }

    fn try_open(node: &Node, channel: &Channel, waiting: Waiting) -> Result<Self, Obstacle> {
        let frames = open_frames(node, channel)?;
        // First the listener: whatever the subscriber gets, an event tells of it.
        let listener = channel.listener(node, waiting)?;
        let subscriber =
            frames.subscriber_builder().create().map_err(|error| Obstacle::subscriber(error, channel))?;
        Ok(Self { subscriber, listener, frames, channel: channel.clone() })
    }

    /// The oldest frame that waits, if any. Two may be held at a time.
    pub fn receive(&self) -> Result<Option<Frame>, ChannelError> {
        match self.subscriber.receive() {
            Ok(slot) => Ok(slot.map(|slot| Frame { slot })),
            Err(ReceiveError::ExceedsMaxBorrows) => Err(ChannelError::TooManyHeld {
                channel: self.channel.name(),
                limit: self.channel.limits().held,
            }),
            Err(error) => Err(ChannelError::transport("receive a frame on", &self.channel, error)),
        }
    }

    /// Waits until frames may be there, at most for `timeout`. Take all of them before waiting again. A reader
    /// that polls is woken by nobody: it waits all that time.
    pub fn wait(&self, timeout: Duration) -> Result<WakeUp, ChannelError> {
        wait(self.listener.as_ref(), timeout, &self.channel)
    }

    /// Whether a driver shim is there, or was killed and not yet cleaned up.
    pub fn is_published(&self) -> bool {
        self.frames.dynamic_config().number_of_publishers() > 0
    }
}

/// A frame where the driver shim wrote it. Its slot is free again when this is dropped.
#[derive(Debug)]
pub struct Frame {
    slot: Sample<ipc::Service, [u16], FrameHeader>,
}

impl Frame {
    /// Everything but the counts.
    pub fn header(&self) -> &FrameHeader {
        self.slot.user_header()
    }

    /// The counts, `(n_readings,)`, in shared memory.
    pub fn counts(&self) -> &[u16] {
        self.slot.payload()
    }
}

fn open_frames(node: &Node, channel: &Channel) -> Result<Frames, Obstacle> {
    let builder = node.inner.service_builder(&channel.service_name());
    let messages = builder.publish_subscribe::<[u16]>().user_header::<FrameHeader>();
    channel.limited(messages).open_or_create().map_err(|error| Obstacle::messages(error, channel))
}
