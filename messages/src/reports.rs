//! The kinds channel of a sensor: one service publishes, up to
//! [`MAX_REPORT_READERS`](crate::MAX_REPORT_READERS) programs read.
//!
//! A late joiner gets the last report. A slow reader finds at most the last [`REPORT_BUFFER`](crate::REPORT_BUFFER),
//! and gaps in their sequence.

use std::cell::{Cell, RefCell};
use std::fmt;
use std::mem::MaybeUninit;
use std::ops::Deref;
use std::time::Duration;

use iceoryx2::identifiers::UniquePublisherId;
use iceoryx2::port::ReceiveError;
use iceoryx2::port::listener::Listener;
use iceoryx2::port::notifier::Notifier;
use iceoryx2::port::publisher::Publisher;
use iceoryx2::port::subscriber::Subscriber;
use iceoryx2::port::update_connections::UpdateConnections;
use iceoryx2::prelude::{CallbackProgression, PortFactory as _, ipc};
use iceoryx2::sample::Sample;
use iceoryx2::sample_mut_uninit::SampleMutUninit;
use iceoryx2::service::port_factory::publish_subscribe::PortFactory;

use crate::channel::{Channel, Purpose, Waiting, WakeUp, notify, patiently, wait};
use crate::error::Obstacle;
use crate::fixed::open;
use crate::memory::{check_free, reports_memory_bytes};
use crate::{ChannelError, KindReport, Node, SensorName, monotonic_ns};

type Reports = PortFactory<ipc::Service, KindReport, ()>;
type Slot = SampleMutUninit<ipc::Service, MaybeUninit<KindReport>, ()>;

/// The service's end: the only one at a time.
pub struct ReportPublisher {
    // Dropped in this order: the place of the publisher is the last to become free.
    notifier: Notifier<ipc::Service>,
    /// Lent for the next report when the last one is on its way, since the transport allocates for a loan.
    next: RefCell<Option<Slot>>,
    publisher: Publisher<ipc::Service, KindReport, ()>,
    reports: Reports,
    channel: Channel,
    /// The readers at the last tick.
    readers: Cell<ReaderSet>,
}

impl ReportPublisher {
    /// Opens the channel.
    ///
    /// Fails when another program serves this sensor, and when [`reports_memory_bytes`] of shared memory are not
    /// free. Takes the place of a program that has been killed.
    pub fn create(node: &Node, sensor: &SensorName) -> Result<Self, ChannelError> {
        let channel = Channel::new(node, sensor, Purpose::Kinds);
        check_free(&channel, reports_memory_bytes())?;
        patiently(node, || Self::try_create(node, &channel))
    }

    fn try_create(node: &Node, channel: &Channel) -> Result<Self, Obstacle> {
        let reports = open::<KindReport>(node, channel)?;
        // The transport would refuse as well, but only after making its slots.
        if reports.dynamic_config().number_of_publishers() > 0 {
            return Err(Obstacle::occupied(channel));
        }
        let publisher = reports
            .publisher_builder()
            .max_loaned_samples(channel.limits().loans)
            .create()
            .map_err(|error| Obstacle::publisher(error, channel))?;
        let notifier = channel.notifier(node)?;
        let next = RefCell::new(publisher.loan_uninit().ok());
        Ok(Self { notifier, next, publisher, reports, channel: channel.clone(), readers: Cell::default() })
    }

    /// Sends a report, with the time of sending, which it returns, and wakes the readers. Never waits for one.
    ///
    /// Allocates nothing before the report is sent. Then the transport takes 48 bytes for the loan of the next one, as many
    /// as it has freed.
    pub fn send(&self, report: &KindReport) -> Result<u64, ChannelError> {
        let mut sent = *report;
        sent.reported_monotonic_ns = monotonic_ns();
        self.pass_on(&sent)?;
        Ok(sent.reported_monotonic_ns)
    }

    /// The same for a report that another service sent elsewhere: its times stay as they are.
    pub fn pass_on(&self, report: &KindReport) -> Result<(), ChannelError> {
        // None where lending failed the last time.
        let slot = match self.next.take() {
            Some(slot) => slot,
            None => self
                .publisher
                .loan_uninit()
                .map_err(|error| ChannelError::transport("lend a report of", &self.channel, error))?,
        };
        slot.write_payload(*report)
            .send()
            .map_err(|error| ChannelError::transport("send a report on", &self.channel, error))?;
        let notified = notify(&self.notifier, &self.channel);
        self.next.replace(self.publisher.loan_uninit().ok());
        notified
    }

    /// Gives readers that came since the last report that report, and wakes them. Call it once per tick, for when none
    /// are sent.
    pub fn update(&self) -> Result<(), ChannelError> {
        let readers = self.reader_set();
        self.publisher
            .update_connections()
            .map_err(|error| ChannelError::transport("connect readers of", &self.channel, error))?;
        // The transport delivers the last report without a word; a reader that waits would go on waiting.
        if self.readers.replace(readers) != readers {
            notify(&self.notifier, &self.channel)?;
        }
        Ok(())
    }

    fn reader_set(&self) -> ReaderSet {
        let mut readers = ReaderSet::default();
        self.reports.dynamic_config().list_subscribers(|reader| {
            readers.0 ^= reader.subscriber_id.value();
            CallbackProgression::Continue
        });
        readers
    }

    /// How many readers there are, counting those that were killed and not yet cleaned up.
    pub fn n_readers(&self) -> usize {
        self.reports.dynamic_config().number_of_subscribers()
    }
}

impl fmt::Debug for ReportPublisher {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("ReportPublisher").field("channel", &self.channel).finish_non_exhaustive()
    }
}

/// Who reads, as the exclusive or of their identities: enough to notice that it is not the same readers as before.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
struct ReaderSet(u128);

/// A reader's end.
#[derive(Debug)]
pub struct ReportReader {
    subscriber: Subscriber<ipc::Service, KindReport, ()>,
    /// None of a reader that polls.
    listener: Option<Listener<ipc::Service>>,
    reports: Reports,
    channel: Channel,
}

impl ReportReader {
    /// Opens the channel, whether or not a service is there.
    pub fn open(node: &Node, sensor: &SensorName) -> Result<Self, ChannelError> {
        Self::open_with(node, sensor, Waiting::ByEvent)
    }

    /// The same for a reader that may look for messages in another way than by event.
    pub fn open_with(node: &Node, sensor: &SensorName, waiting: Waiting) -> Result<Self, ChannelError> {
        let channel = Channel::new(node, sensor, Purpose::Kinds);
        patiently(node, || Self::try_open(node, &channel, waiting))
    }

    fn try_open(node: &Node, channel: &Channel, waiting: Waiting) -> Result<Self, Obstacle> {
        let reports = open::<KindReport>(node, channel)?;
        // First the listener: whatever the subscriber gets, an event tells of it.
        let listener = channel.listener(node, waiting)?;
        let subscriber =
            reports.subscriber_builder().create().map_err(|error| Obstacle::subscriber(error, channel))?;
        Ok(Self { subscriber, listener, reports, channel: channel.clone() })
    }

    /// The oldest report that waits, if any: a copy, so that a reader holds no slot.
    pub fn receive(&self) -> Result<Option<KindReport>, ChannelError> {
        Ok(self.hold()?.map(|report| *report))
    }

    /// The oldest report that waits, if any, where the service wrote it. Two may be held at a time.
    pub fn hold(&self) -> Result<Option<HeldReport>, ChannelError> {
        let slot = self.subscriber.receive().map_err(|error| match error {
            ReceiveError::ExceedsMaxBorrows => {
                ChannelError::TooManyHeld { channel: self.channel.name(), limit: self.channel.limits().held }
            }
            other => ChannelError::transport("receive a report on", &self.channel, other),
        })?;
        let Some(report) = slot.map(|slot| HeldReport { slot }) else { return Ok(None) };
        if report.version != KindReport::VERSION {
            return Err(ChannelError::OtherVersion {
                channel: self.channel.name(),
                found: report.version,
                expected: KindReport::VERSION,
            });
        }
        Ok(Some(report))
    }

    /// Waits until reports may be there, at most for `timeout`. Take all of them before waiting again. A reader
    /// that polls is woken by nobody: it waits all that time.
    ///
    /// A joiner's last report comes with the service's next tick.
    pub fn wait(&self, timeout: Duration) -> Result<WakeUp, ChannelError> {
        wait(self.listener.as_ref(), timeout, &self.channel)
    }

    /// Which service is there, if any, or was killed and not yet cleaned up. Another one has another identity.
    pub fn service(&self) -> Option<ServiceId> {
        let mut service = None;
        self.reports.dynamic_config().list_publishers(|publisher| {
            service = Some(ServiceId(publisher.publisher_id));
            CallbackProgression::Stop
        });
        service
    }
}

/// A report where the service wrote it. Its slot is free again when this is dropped.
#[derive(Debug)]
pub struct HeldReport {
    slot: Sample<ipc::Service, KindReport, ()>,
}

impl Deref for HeldReport {
    type Target = KindReport;

    fn deref(&self) -> &KindReport {
        self.slot.payload()
    }
}

/// Identity of a service while it lives, to notice that it is another one.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct ServiceId(UniquePublisherId);
