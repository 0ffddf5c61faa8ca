//! Channels of messages of one fixed size, without events: who reads them looks when it has a moment.
//!
//! The kinds channel is of such messages too, but its sender lends ahead and wakes its readers; it shares [`open`].

use std::fmt::Debug;

use iceoryx2::port::publisher::Publisher;
use iceoryx2::port::subscriber::Subscriber;
use iceoryx2::port::update_connections::UpdateConnections;
use iceoryx2::prelude::{PortFactory as _, ZeroCopySend, ipc};
use iceoryx2::service::port_factory::publish_subscribe::PortFactory;

use crate::channel::{Channel, patiently};
use crate::error::Obstacle;
use crate::memory::{check_free, fixed_memory_bytes};
use crate::{ChannelError, Node};

/// What such a channel carries.
pub(crate) trait Message: Copy + Debug + ZeroCopySend + 'static {
    /// The layout that this program was built with.
    const VERSION: u32;

    /// The layout that the writer says it has.
    fn version(&self) -> u32;
}

/// The publisher's end: the only one at a time.
#[derive(Debug)]
pub(crate) struct Outlet<T: Message> {
    publisher: Publisher<ipc::Service, T, ()>,
    channel: Channel,
}

/// A reader's end.
#[derive(Debug)]
pub(crate) struct Inlet<T: Message> {
    subscriber: Subscriber<ipc::Service, T, ()>,
    messages: PortFactory<ipc::Service, T, ()>,
    channel: Channel,
}

impl<T: Message> Outlet<T> {
    pub(crate) fn create(node: &Node, channel: Channel) -> Result<Self, ChannelError> {
        check_free(&channel, fixed_memory_bytes::<T>(channel.limits()))?;
        let publisher = patiently(node, || {
            let messages = open::<T>(node, &channel)?;
            let publisher = messages.publisher_builder().max_loaned_samples(channel.limits().loans).create();
            publisher.map_err(|error| Obstacle::publisher(error, &channel))
        })?;
        Ok(Self { publisher, channel })
    }

    /// Sends a message. Never waits for a reader. The transport allocates 48 bytes and frees them.
    pub(crate) fn send(&self, message: &T) -> Result<(), ChannelError> {
        let sent = self.publisher.send_copy(*message);
        sent.map(drop).map_err(|error| ChannelError::transport("send on", &self.channel, error))
    }

    /// Connects readers that came since the last message.
    pub(crate) fn update(&self) -> Result<(), ChannelError> {
        let updated = self.publisher.update_connections();
        updated.map_err(|error| ChannelError::transport("connect readers of", &self.channel, error))
    }
}

impl<T: Message> Inlet<T> {
    pub(crate) fn open(node: &Node, channel: Channel) -> Result<Self, ChannelError> {
        let (messages, subscriber) = patiently(node, || {
            let messages = open::<T>(node, &channel)?;
            let subscriber = messages.subscriber_builder().create();
            Ok((messages, subscriber.map_err(|error| Obstacle::subscriber(error, &channel))?))
        })?;
        Ok(Self { subscriber, messages, channel })
    }

    /// The oldest message that waits, if any.
    pub(crate) fn receive(&self) -> Result<Option<T>, ChannelError> {
        let received = self.subscriber.receive();
        let slot = received.map_err(|error| ChannelError::transport("receive on", &self.channel, error))?;
        let Some(message) = slot.map(|slot| *slot.payload()) else { return Ok(None) };
        if message.version() != T::VERSION {
            return Err(ChannelError::OtherVersion {
                channel: self.channel.name(),
                found: message.version(),
                expected: T::VERSION,
            });
        }
        Ok(Some(message))
    }

    /// Whether a publisher is there, or was killed and not yet cleaned up.
    pub(crate) fn is_published(&self) -> bool {
        self.messages.dynamic_config().number_of_publishers() > 0
    }
}

/// Opens or makes a channel of messages of fixed size.
pub(crate) fn open<T>(node: &Node, channel: &Channel) -> Result<PortFactory<ipc::Service, T, ()>, Obstacle>
where
    T: Debug + ZeroCopySend + 'static,
{
    let builder = node.inner.service_builder(&channel.service_name());
    let messages = builder.publish_subscribe::<T>();
    channel.limited(messages).open_or_create().map_err(|error| Obstacle::messages(error, channel))
}
