//! Census: who is in a domain, and which channels are there and how they are laid out.
//!
//! For whoever wants to know why nothing arrives. It changes nothing: it makes no channel, reads none, and cleans up after
//! nobody, so that what is wrong is still there to be seen.

use std::fmt::Debug;

use iceoryx2::config::Config;
use iceoryx2::identifiers::UniqueNodeId;
use iceoryx2::node::NodeView as _;
use iceoryx2::prelude::{
    CallbackProgression, NodeState, PortFactory as _, Service as _, ServiceName, ZeroCopySend, ipc,
};
use iceoryx2::service::ServiceListError;
use iceoryx2::service::port_factory::publish_subscribe::PortFactory;
use iceoryx2::service::static_config::message_type_details::{TypeDetail, TypeVariant};
use iceoryx2::service::static_config::messaging_pattern::MessagingPattern;
use iceoryx2::service::static_config::publish_subscribe::StaticConfig;

use crate::channel::Purpose;
use crate::{
    ChannelError, Domain, FrameHeader, HealthReport, KindReport, Node, ReloadAnswer, ReloadRequest,
    SensorName,
};

/// What was found in a domain.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Census {
    /// Members, in no order.
    pub programs: Vec<Program>,
    /// By sensor, frames first.
    pub channels: Vec<FoundChannel>,
    /// Channels that cannot be read: of another version of the transport, or another user's.
    pub n_unreadable: usize,
}

/// A member of a domain.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Program {
    /// Which it said that it is; none where that cannot be read.
    pub name: Option<String>,
    /// Its process; none where that cannot be read.
    pub pid: Option<u32>,
    /// Whether it lives.
    pub life: Life,
}

impl std::fmt::Display for Program {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(self.name.as_deref().unwrap_or("a program"))?;
        self.pid.map_or(Ok(()), |pid| write!(f, " (pid {pid})"))
    }
}

/// Whether a program lives.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Life {
    /// It does.
    Alive,
    /// It was killed, and what it left has not been removed.
    Dead,
    /// Nobody may say: it is another user's.
    Hidden,
    /// Nobody can say: part of what it should have is missing.
    Unclear,
}

/// A channel of a sensor.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct FoundChannel {
    /// Its sensor.
    pub sensor: SensorName,
    /// What it carries.
    pub purpose: Purpose,
    /// How it is laid out otherwise than in this program, field by field. Where it is, it cannot be opened.
    pub differences: Vec<Difference>,
    /// Programs that have it open.
    pub programs: Vec<Program>,
    /// Which of them publishes.
    pub publisher: Option<Publisher>,
    /// Which of them read.
    pub readers: Vec<Program>,
}

/// Who publishes on a channel.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Publisher {
    /// The program.
    pub program: Program,
    /// Most readings that its frames have; none where it publishes something else.
    pub n_readings: Option<usize>,
}

/// A field that is not as this program has it.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Difference {
    /// What, in words.
    pub field: &'static str,
    /// What it is on the channel.
    pub found: String,
    /// What it is in this program.
    pub expected: String,
}

impl Census {
    /// The channels of a sensor.
    pub fn channels_of(&self, sensor: &SensorName) -> impl Iterator<Item = &FoundChannel> {
        self.channels.iter().filter(move |channel| channel.sensor == *sensor)
    }

    /// One of them, if it is there.
    pub fn channel(&self, sensor: &SensorName, purpose: Purpose) -> Option<&FoundChannel> {
        self.channels_of(sensor).find(|channel| channel.purpose == purpose)
    }
}

impl Domain {
    /// Counts who is there.
    ///
    /// * `visitor` — the name under which this program joins for as long as it looks
    ///
    /// # Errors
    /// If the domain is no place for channels, or another user's.
    pub fn census(&self, visitor: &str) -> Result<Census, ChannelError> {
        let (mut census, members) = self.count()?;
        // Who has which end is told to members only.
        let has_channels = !census.channels.is_empty();
        if let Some(node) = has_channels.then(|| Node::visit(self, visitor).ok()).flatten() {
            for channel in census.channels.iter_mut().filter(|channel| channel.differences.is_empty()) {
                channel.find_roles(&node, &members);
            }
        }
        Ok(census)
    }

    /// The same without asking who publishes and who reads, which are none here: for whoever looks again and again. Joins
    /// nothing and opens no channel.
    ///
    /// # Errors
    /// If the domain is no place for channels, or another user's.
    pub fn roll_call(&self) -> Result<Census, ChannelError> {
        self.count().map(|(census, _)| census)
    }

    /// All but who has which end.
    fn count(&self) -> Result<(Census, Vec<Member>), ChannelError> {
        let config = self.config()?;
        let unlisted = |reason: &dyn Debug| ChannelError::Node {
            root: self.root.clone(),
            reason: format!("its members cannot be listed ({reason:?})"),
        };
        let mut members = Vec::new();
        let listed = iceoryx2::node::Node::<ipc::Service>::list(&config, |state| {
            members.push(Member::of(&state));
            CallbackProgression::Continue
        });
        listed.map_err(|error| unlisted(&error))?;
        let (channels, n_services) = channels(&config).map_err(|error| unlisted(&error))?;
        let programs = members.iter().map(|member| member.program.clone()).collect();
        let n_unreadable = self.service_files().len().saturating_sub(n_services);
        Ok((Census { programs, channels, n_unreadable }, members))
    }
}

/// Channels of sensors, and how many services there are in all.
fn channels(config: &Config) -> Result<(Vec<FoundChannel>, usize), ServiceListError> {
    let (mut found, mut n_services) = (Vec::new(), 0);
    let listed = ipc::Service::list(config, |service| {
        n_services += 1;
        let details = &service.static_details;
        if let MessagingPattern::PublishSubscribe(layout) = details.messaging_pattern()
            && let Some((sensor, purpose)) = Purpose::parse(details.name().as_str())
        {
            let nodes = service.dynamic_details.map_or(Vec::new(), |details| details.nodes);
            found.push(FoundChannel {
                sensor,
                purpose,
                differences: differences(layout, purpose),
                programs: nodes.iter().map(|state| Member::of(state).program).collect(),
                publisher: None,
                readers: Vec::new(),
            });
        }
        CallbackProgression::Continue
    });
    listed?;
    found.sort_by(|a, b| (&a.sensor, a.purpose).cmp(&(&b.sensor, b.purpose)));
    Ok((found, n_services))
}

/// A program, and the number that the transport gave it.
struct Member {
    id: UniqueNodeId,
    program: Program,
}

impl Member {
    fn of(state: &NodeState<ipc::Service>) -> Self {
        let id = *state.node_id();
        let (life, details) = match state {
            NodeState::Alive(node) => (Life::Alive, node.details().as_ref()),
            NodeState::Dead(node) => (Life::Dead, node.details().as_ref()),
            NodeState::Inaccessible(_) => (Life::Hidden, None),
            NodeState::Undefined(_) => (Life::Unclear, None),
        };
        let name = details.map(|details| details.name().as_str().to_owned());
        let pid = id.pid::<ipc::Service>().ok().and_then(|pid| u32::try_from(pid.value()).ok());
        Self { id, program: Program { name, pid, life } }
    }
}

impl FoundChannel {
    /// The channel's name.
    pub fn name(&self) -> String {
        self.purpose.of(&self.sensor)
    }

    fn find_roles(&mut self, node: &Node, members: &[Member]) {
        let Ok(name) = ServiceName::new(&self.name()) else { return };
        let builder = node.inner.service_builder(&name);
        let ends = match self.purpose {
            Purpose::Frames => ends(builder.publish_subscribe::<[u16]>().user_header::<FrameHeader>().open()),
            Purpose::Kinds => ends(builder.publish_subscribe::<KindReport>().open()),
            Purpose::Health => ends(builder.publish_subscribe::<HealthReport>().open()),
            Purpose::ReloadRequests => ends(builder.publish_subscribe::<ReloadRequest>().open()),
            Purpose::ReloadAnswers => ends(builder.publish_subscribe::<ReloadAnswer>().open()),
        };
        let program = |id: &UniqueNodeId| {
            members.iter().find(|member| member.id == *id).map(|member| member.program.clone())
        };
        let has_frames = self.purpose == Purpose::Frames;
        self.publisher = ends.publisher.and_then(|(id, n)| {
            Some(Publisher { program: program(&id)?, n_readings: has_frames.then_some(n) })
        });
        self.readers = ends.readers.iter().filter_map(program).collect();
    }
}

/// Who has which end.
#[derive(Default)]
struct Ends {
    /// And the longest slice that it lends.
    publisher: Option<(UniqueNodeId, usize)>,
    readers: Vec<UniqueNodeId>,
}

/// Of a channel that whoever made it may have closed meanwhile, and then nobody has an end.
fn ends<P, H, E>(channel: Result<PortFactory<ipc::Service, P, H>, E>) -> Ends
where
    P: iceoryx2::prelude::IceoryxSend + Debug + ?Sized,
    H: Debug + ZeroCopySend,
{
    let mut ends = Ends::default();
    let Ok(channel) = channel else { return ends };
    channel.dynamic_config().list_publishers(|publisher| {
        ends.publisher = Some((publisher.node_id, publisher.max_slice_len));
        CallbackProgression::Stop
    });
    channel.dynamic_config().list_subscribers(|reader| {
        ends.readers.push(reader.node_id);
        CallbackProgression::Continue
    });
    ends
}

/// How a channel is laid out otherwise than in this program.
fn differences(found: &StaticConfig, purpose: Purpose) -> Vec<Difference> {
    let fixed = TypeVariant::FixedSize;
    let payload = match purpose {
        Purpose::Frames => TypeDetail::new::<u16>(TypeVariant::Dynamic),
        Purpose::Kinds => TypeDetail::new::<KindReport>(fixed),
        Purpose::Health => TypeDetail::new::<HealthReport>(fixed),
        Purpose::ReloadRequests => TypeDetail::new::<ReloadRequest>(fixed),
        Purpose::ReloadAnswers => TypeDetail::new::<ReloadAnswer>(fixed),
    };
    let header = match purpose {
        Purpose::Frames => TypeDetail::new::<FrameHeader>(fixed),
        _ => TypeDetail::new::<()>(fixed),
    };
    let limits = purpose.limits();
    let types = found.message_type_details();
    let name = |of: &TypeDetail| of.type_name().to_string();
    let number = |field, found: usize, expected: usize| (field, found.to_string(), expected.to_string());
    [
        ("type of a message", name(&types.payload), name(&payload)),
        number("bytes of a message", types.payload.size(), payload.size()),
        number("alignment of a message", types.payload.alignment(), payload.alignment()),
        ("type of a header", name(&types.user_header), name(&header)),
        number("bytes of a header", types.user_header.size(), header.size()),
        number("alignment of a header", types.user_header.alignment(), header.alignment()),
        number("most publishers", found.max_publishers(), 1),
        number("most readers", found.max_subscribers(), limits.readers),
        number("most programs", found.max_nodes(), limits.programs()),
        number("messages that wait for a reader", found.subscriber_max_buffer_size(), limits.buffer),
        number("messages that a reader may hold", found.subscriber_max_borrowed_samples(), limits.held),
        number("messages for late joiners", found.history_size(), limits.history),
        ("oldest messages give way", found.has_safe_overflow().to_string(), true.to_string()),
    ]
    .into_iter()
    .filter(|(_, found, expected)| found != expected)
    .map(|(field, found, expected)| Difference { field, found, expected })
    .collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{FramePublisher, FrameReader, OwnDomain, ReportPublisher};

    fn names(programs: &[Program]) -> Vec<&str> {
        let mut names: Vec<_> = programs.iter().map(|program| program.name.as_deref().unwrap()).collect();
        names.sort_unstable();
        names
    }

    #[test]
    fn an_empty_domain_is_empty_and_stays_so() {
        let domain = OwnDomain::make().unwrap();
        assert_eq!(domain.census("test").unwrap(), Census::default());
        assert_eq!(std::fs::read_dir(&domain.root).unwrap().count(), 0, "nothing was made");
    }

    #[test]
    fn who_publishes_and_who_reads_is_told_and_ours_have_no_differences() {
        let domain = OwnDomain::make().unwrap();
        let sensor: SensorName = "crunch/ring".parse().unwrap();
        let [shim, service] = ["shim", "service"].map(|name| Node::open(&domain, name).unwrap());
        let _frames = FramePublisher::create(&shim, &sensor, 16).unwrap();
        let _reader = FrameReader::open(&service, &sensor).unwrap();
        let _reports = ReportPublisher::create(&service, &sensor).unwrap();
        let census = domain.census("test").unwrap();
        assert_eq!((names(&census.programs), census.n_unreadable), (vec!["service", "shim"], 0));
        let [frames, kinds] = &census.channels[..] else { panic!("{census:?}") };
        assert_eq!(frames.name(), "natural-kinds/crunch/ring/frames");
        assert_eq!(kinds.name(), "natural-kinds/crunch/ring/kinds");
        assert_eq!((&frames.differences[..], &kinds.differences[..]), (&[][..], &[][..]));
        let publisher = frames.publisher.as_ref().unwrap();
        let pid = Some(std::process::id());
        let program = |name: &str| Program { name: Some(name.to_owned()), pid, life: Life::Alive };
        assert_eq!((&publisher.program, publisher.n_readings), (&program("shim"), Some(16)));
        assert_eq!(frames.readers, [program("service")]);
        assert_eq!(kinds.publisher.as_ref().unwrap().program, program("service"));
        assert_eq!(kinds.readers, []);
        assert_eq!(names(&frames.programs), ["service", "shim"]);

        let roll = domain.roll_call().unwrap();
        let mut without_roles = census.clone();
        for channel in &mut without_roles.channels {
            (channel.publisher, channel.readers) = (None, Vec::new());
        }
        assert_eq!((names(&roll.programs), roll.channels), (names(&census.programs), without_roles.channels));
    }

    #[test]
    fn another_layout_is_told_field_by_field() {
        let domain = OwnDomain::make().unwrap();
        let node = Node::open(&domain, "other version").unwrap();
        let name = ServiceName::new("natural-kinds/ring/frames").unwrap();
        let builder = node.inner.service_builder(&name).publish_subscribe::<[u32]>().user_header::<u64>();
        let limits = Purpose::Frames.limits();
        let _other = builder
            .max_publishers(1)
            .max_subscribers(limits.readers)
            .max_nodes(limits.programs())
            .subscriber_max_buffer_size(3)
            .subscriber_max_borrowed_samples(limits.held)
            .history_size(limits.history)
            .create()
            .unwrap();
        let census = domain.census("test").unwrap();
        let [channel] = &census.channels[..] else { panic!("{census:?}") };
        let told = channel.differences.iter();
        let told: Vec<_> =
            told.map(|d| format!("{}: {} instead of {}", d.field, d.found, d.expected)).collect();
        assert_eq!(
            told,
            [
                "type of a message: u32 instead of u16",
                "bytes of a message: 4 instead of 2",
                "alignment of a message: 4 instead of 2",
                "type of a header: u64 instead of natural_kinds::FrameHeader",
                "bytes of a header: 8 instead of 120",
                "messages that wait for a reader: 3 instead of 16",
            ]
        );
        assert_eq!((&channel.publisher, &channel.readers[..]), (&None, &[][..]));
        assert_eq!(names(&channel.programs), ["other version"]);
    }

    #[test]
    fn what_cannot_be_read_is_counted() {
        let domain = OwnDomain::make().unwrap();
        std::fs::create_dir(domain.root.join("services")).unwrap();
        let file = domain.root.join("services").join(format!("{}0123.service", domain.prefix));
        std::fs::write(file, "of another version").unwrap();
        assert_eq!(domain.census("test").unwrap().n_unreadable, 1);
    }
}
