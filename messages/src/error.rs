//! The transport's errors, turned into sentences with channel, limit and cure.

use std::path::PathBuf;

use iceoryx2::node::NodeCreationFailure;
use iceoryx2::port::listener::ListenerCreateError;
use iceoryx2::port::notifier::NotifierCreateError;
use iceoryx2::port::publisher::PublisherCreateError;
use iceoryx2::port::subscriber::SubscriberCreateError;
use iceoryx2::service::builder::event::{EventCreateError, EventOpenError, EventOpenOrCreateError};
use iceoryx2::service::builder::publish_subscribe::{
    PublishSubscribeCreateError, PublishSubscribeOpenError, PublishSubscribeOpenOrCreateError,
};

use crate::channel::{Channel, Purpose};
use crate::{Domain, DomainError};

/// Why a channel cannot be opened, or used.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum ChannelError {
    /// The domain is no place for channels.
    #[error(transparent)]
    Domain(#[from] DomainError),
    /// The name of this process.
    #[error("process name \"{name}\" cannot be used; give at most {limit} ASCII characters")]
    ProcessName {
        /// The name as given.
        name: String,
        /// Most characters.
        limit: usize,
    },
    /// The domain is another user's, who keeps it to itself.
    #[error(
        "cannot join the channels under {}: they are those of user {owner}, and this program runs as {own}; run it as \
         {owner} (sudo -u {owner} …; User={owner} in a systemd unit), or choose another domain", root.display()
    )]
    OtherUser {
        /// The domain's root.
        root: PathBuf,
        /// Whose it is.
        owner: String,
        /// The user of this process.
        own: String,
    },
    /// This process cannot become a member of the domain.
    #[error(
        "cannot join the channels under {}: {reason}; run all programs of a robot as one user, who may write there, \
         or choose another root", root.display()
    )]
    Node {
        /// The domain's root.
        root: PathBuf,
        /// What the transport said.
        reason: String,
    },
    /// A second driver shim.
    #[error(
        "sensor {sensor} is already published by another driver shim; stop that one first, or publish under \
         another sensor name"
    )]
    AlreadyPublished {
        /// The sensor.
        sensor: String,
    },
    /// A second service.
    #[error(
        "sensor {sensor} is already served by another service; stop that one first, or serve another sensor name"
    )]
    AlreadyServed {
        /// The sensor.
        sensor: String,
    },
    /// A second program that asks for another model.
    #[error(
        "another program is just giving the service for sensor {sensor} a model; try again when it is done"
    )]
    AlreadyReloading {
        /// The sensor.
        sensor: String,
    },
    /// All places of readers are taken.
    #[error("channel {channel} already has {limit} readers, the most it has room for; stop one of them")]
    TooManyReaders {
        /// Name of the channel.
        channel: String,
        /// Most readers.
        limit: usize,
    },
    /// All places of programs are taken.
    #[error(
        "channel {channel} is already open in {limit} programs, the most it has room for; stop one of them"
    )]
    TooManyPrograms {
        /// Name of the channel.
        channel: String,
        /// Most programs.
        limit: usize,
    },
    /// Something else was there first.
    #[error(
        "channel {channel} exists with another message layout or other limits than this program's; stop the \
         programs that use it, and start all of them in the same version"
    )]
    OtherLayout {
        /// Name of the channel.
        channel: String,
    },
    /// A message says that it has another layout.
    #[error(
        "channel {channel} carries messages of layout version {found}, this program reads version {expected}; \
         run all programs in the same version"
    )]
    OtherVersion {
        /// Name of the channel.
        channel: String,
        /// The message's version.
        found: u32,
        /// Ours.
        expected: u32,
    },
    /// Files of another user.
    #[error(
        "channel {channel} cannot be opened: permission denied under {} or in /dev/shm; run all programs of a robot \
         as one user", root.display()
    )]
    Permission {
        /// Name of the channel.
        channel: String,
        /// The domain's root.
        root: PathBuf,
    },
    /// Touching memory that is not there would kill the process later, so this is asked before.
    #[error(
        "channel {channel} needs {needed_kb} kB of shared memory and {} has {free_kb} kB free; delete files there \
         or enlarge it", path.display()
    )]
    SharedMemory {
        /// Name of the channel.
        channel: String,
        /// Where shared memory is mounted.
        path: PathBuf,
        /// What the channel may come to use, kB.
        needed_kb: u64,
        /// What is left, kB.
        free_kb: u64,
    },
    /// The system does not tell how much shared memory there is.
    #[error("cannot tell how much shared memory is free in {}: {source}; is it mounted?", path.display())]
    SharedMemoryUnknown {
        /// Where shared memory should be mounted.
        path: PathBuf,
        /// What the system said.
        source: std::io::Error,
    },
    /// Too many messages in hand.
    #[error(
        "channel {channel}: this program already holds {limit} messages, the most it may; drop one before taking \
         the next"
    )]
    TooManyHeld {
        /// Name of the channel.
        channel: String,
        /// Most messages held.
        limit: usize,
    },
    /// Everything that should not happen, with the transport's own word for it.
    #[error(
        "could not {attempt} channel {channel} ({reason}); if it happens again, stop all programs that use it; its log \
         at level debug says more"
    )]
    Transport {
        /// What was attempted, as a verb.
        attempt: &'static str,
        /// Name of the channel.
        channel: String,
        /// The transport's word.
        reason: String,
    },
}

impl ChannelError {
    pub(crate) fn node(error: NodeCreationFailure, domain: &Domain) -> Self {
        let reason = match error {
            NodeCreationFailure::InsufficientPermissions => "permission denied".to_owned(),
            // What a folder of another user comes to, among other things: the transport does not tell them apart.
            NodeCreationFailure::InternalError => "files cannot be made there".to_owned(),
            other => format!("{other:?}"),
        };
        Self::Node { root: domain.root.clone(), reason }
    }

    pub(crate) fn transport(attempt: &'static str, channel: &Channel, reason: impl std::fmt::Debug) -> Self {
        Self::Transport { attempt, channel: channel.name(), reason: format!("{reason:?}") }
    }
}

/// Why an attempt to open failed, and whether it may succeed when tried again.
#[derive(Debug)]
pub(crate) struct Obstacle {
    pub(crate) error: ChannelError,
    /// Another program is just starting, ending, or has been killed: clean up, and try again.
    pub(crate) passing: bool,
}

impl Obstacle {
    fn passing(error: ChannelError) -> Self {
        Self { error, passing: true }
    }

    fn lasting(error: ChannelError) -> Self {
        Self { error, passing: false }
    }

    pub(crate) fn occupied(channel: &Channel) -> Self {
        let sensor = channel.sensor.to_string();
        Self::passing(match channel.purpose {
            Purpose::Frames => ChannelError::AlreadyPublished { sensor },
            Purpose::ReloadRequests => ChannelError::AlreadyReloading { sensor },
            Purpose::Kinds | Purpose::Health | Purpose::ReloadAnswers => {
                ChannelError::AlreadyServed { sensor }
            }
        })
    }

    pub(crate) fn messages(error: PublishSubscribeOpenOrCreateError, channel: &Channel) -> Self {
        use PublishSubscribeOpenOrCreateError as Either;
        use {PublishSubscribeCreateError as Create, PublishSubscribeOpenError as Open};
        let transport = || ChannelError::transport("open", channel, error);
        match error {
            Either::SystemInFlux
            | Either::PublishSubscribeOpenError(
                Open::IsMarkedForDestruction
                | Open::ServiceInCorruptedState
                | Open::HangsInCreation
                | Open::Interrupt,
            )
            | Either::PublishSubscribeCreateError(
                Create::ServiceInCorruptedState
                | Create::HangsInCreation
                | Create::IsBeingCreatedByAnotherInstance
                | Create::AlreadyExists
                | Create::Interrupt,
            ) => Self::passing(transport()),
            Either::PublishSubscribeOpenError(Open::ExceedsMaxNumberOfNodes) => {
                Self::too_many_programs(channel)
            }
            Either::PublishSubscribeOpenError(Open::InsufficientPermissions)
            | Either::PublishSubscribeCreateError(Create::InsufficientPermissions) => {
                Self::permission(channel)
            }
            Either::PublishSubscribeOpenError(
                Open::IncompatibleTypes
                | Open::IncompatibleMessagingPattern
                | Open::IncompatibleAttributes
                | Open::IncompatibleOverflowBehavior
                | Open::DoesNotSupportRequestedMinBufferSize
                | Open::DoesNotSupportRequestedMinHistorySize
                | Open::DoesNotSupportRequestedMinSubscriberBorrowedSamples
                | Open::DoesNotSupportRequestedAmountOfPublishers
                | Open::DoesNotSupportRequestedAmountOfSubscribers
                | Open::DoesNotSupportRequestedAmountOfNodes
                | Open::VersionMismatch,
            ) => Self::other_layout(channel),
            _ => Self::lasting(transport()),
        }
    }

    pub(crate) fn events(error: EventOpenOrCreateError, channel: &Channel) -> Self {
        use {EventCreateError as Create, EventOpenError as Open, EventOpenOrCreateError as Either};
        let transport = || ChannelError::transport("open events of", channel, error);
        match error {
            Either::SystemInFlux
            | Either::EventOpenError(
                Open::IsMarkedForDestruction
                | Open::ServiceInCorruptedState
                | Open::HangsInCreation
                | Open::Interrupt,
            )
            | Either::EventCreateError(
                Create::ServiceInCorruptedState
                | Create::IsBeingCreatedByAnotherInstance
                | Create::AlreadyExists
                | Create::Interrupt,
            ) => Self::passing(transport()),
            Either::EventOpenError(Open::ExceedsMaxNumberOfNodes) => Self::too_many_programs(channel),
            Either::EventOpenError(Open::InsufficientPermissions)
            | Either::EventCreateError(Create::InsufficientPermissions) => Self::permission(channel),
            Either::EventOpenError(
                Open::IncompatibleMessagingPattern
                | Open::IncompatibleAttributes
                | Open::IncompatibleDeadline
                | Open::IncompatibleNotifierCreatedEvent
                | Open::IncompatibleNotifierDroppedEvent
                | Open::IncompatibleNotifierDeadEvent
                | Open::DoesNotSupportRequestedAmountOfNotifiers
                | Open::DoesNotSupportRequestedAmountOfListeners
                | Open::DoesNotSupportRequestedMaxEventId
                | Open::DoesNotSupportRequestedAmountOfNodes
                | Open::VersionMismatch,
            ) => Self::other_layout(channel),
            _ => Self::lasting(transport()),
        }
    }

    pub(crate) fn publisher(error: PublisherCreateError, channel: &Channel) -> Self {
        match error {
            PublisherCreateError::ExceedsMaxSupportedPublishers => Self::occupied(channel),
            other => Self::lasting(ChannelError::transport("publish on", channel, other)),
        }
    }

    pub(crate) fn notifier(error: NotifierCreateError, channel: &Channel) -> Self {
        match error {
            NotifierCreateError::ExceedsMaxSupportedNotifiers => Self::occupied(channel),
            other => Self::lasting(ChannelError::transport("notify readers of", channel, other)),
        }
    }

    pub(crate) fn subscriber(error: SubscriberCreateError, channel: &Channel) -> Self {
        match error {
            SubscriberCreateError::ExceedsMaxSupportedSubscribers => Self::too_many_readers(channel),
            other => Self::lasting(ChannelError::transport("read", channel, other)),
        }
    }

    pub(crate) fn listener(error: ListenerCreateError, channel: &Channel) -> Self {
        match error {
            ListenerCreateError::ExceedsMaxSupportedListeners => Self::too_many_readers(channel),
            other => Self::lasting(ChannelError::transport("wait on", channel, other)),
        }
    }

    // Full houses pass as well: places of killed programs are freed by cleaning up.
    fn too_many_readers(channel: &Channel) -> Self {
        let limit = channel.limits().readers;
        Self::passing(ChannelError::TooManyReaders { channel: channel.name(), limit })
    }

    fn too_many_programs(channel: &Channel) -> Self {
        let limit = channel.limits().programs();
        Self::passing(ChannelError::TooManyPrograms { channel: channel.name(), limit })
    }

    fn other_layout(channel: &Channel) -> Self {
        Self::lasting(ChannelError::OtherLayout { channel: channel.name() })
    }

    fn permission(channel: &Channel) -> Self {
        Self::lasting(ChannelError::Permission { channel: channel.name(), root: channel.root.clone() })
    }
}
