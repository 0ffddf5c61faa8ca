//! Which topics a trip has, and which of them give frames, poses and commands.

use std::collections::BTreeMap;
use std::fmt;
use std::path::Path;

use crate::TripError;
use crate::record::Record;

/// What a topic is wanted for.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Role {
    /// Frames.
    Frames,
    /// Poses.
    Poses,
    /// What the robot was told to do.
    Commands,
}

/// How frames are encoded on a topic.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum FrameType {
    LaserScan,
    Image,
}

/// How poses are encoded on a topic.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum PoseType {
    Odometry,
    PoseStamped,
}

/// How commands are encoded on a topic.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum CommandType {
    Twist,
    TwistStamped,
}

pub(crate) const LASER_SCAN: &str = "sensor_msgs/msg/LaserScan";
pub(crate) const IMAGE: &str = "sensor_msgs/msg/Image";
pub(crate) const ODOMETRY: &str = "nav_msgs/msg/Odometry";
pub(crate) const POSE_STAMPED: &str = "geometry_msgs/msg/PoseStamped";
pub(crate) const TWIST: &str = "geometry_msgs/msg/Twist";
pub(crate) const TWIST_STAMPED: &str = "geometry_msgs/msg/TwistStamped";
pub(crate) const FLOAT64_MULTI_ARRAY: &str = "std_msgs/msg/Float64MultiArray";

impl Role {
    /// The types of message that give these, in a sentence.
    pub fn types(self) -> String {
        match self {
            Role::Frames => format!("{LASER_SCAN} or {IMAGE}"),
            Role::Poses => format!("{ODOMETRY} or {POSE_STAMPED}"),
            Role::Commands => format!("{TWIST} or {TWIST_STAMPED}"),
        }
    }

    fn is_given_by(self, topic: &Topic) -> bool {
        let fits = match self {
            Role::Frames => topic.frame_type().is_some(),
            Role::Poses => topic.pose_type().is_some(),
            Role::Commands => topic.command_type().is_some(),
        };
        // A recorder lists topics that it subscribed to even if nothing came.
        fits && topic.message_encoding == "cdr" && topic.n_messages > 0
    }
}

/// One topic of a trip.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Topic {
    /// Its name, such as `/scan`.
    pub name: String,
    /// The type of its messages, such as `sensor_msgs/msg/LaserScan`; empty if the recording does not say.
    pub type_name: String,
    /// How many messages it has.
    pub n_messages: u64,
    pub(crate) message_encoding: String,
    pub(crate) channel_ids: Vec<u16>,
}

impl Topic {
    pub(crate) fn frame_type(&self) -> Option<FrameType> {
        match self.type_name.as_str() {
            LASER_SCAN => Some(FrameType::LaserScan),
            IMAGE => Some(FrameType::Image),
            _ => None,
        }
    }

    pub(crate) fn pose_type(&self) -> Option<PoseType> {
        match self.type_name.as_str() {
            ODOMETRY => Some(PoseType::Odometry),
            POSE_STAMPED => Some(PoseType::PoseStamped),
            _ => None,
        }
    }

    pub(crate) fn command_type(&self) -> Option<CommandType> {
        match self.type_name.as_str() {
            TWIST => Some(CommandType::Twist),
            TWIST_STAMPED => Some(CommandType::TwistStamped),
            _ => None,
        }
    }
}

/// `/scan (sensor_msgs/msg/LaserScan, 1379 messages)`
impl fmt::Display for Topic {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let type_name = if self.type_name.is_empty() { "type unknown" } else { &self.type_name };
        write!(f, "{} ({type_name}", self.name)?;
        if self.message_encoding != "cdr" {
            write!(f, " encoded as '{}'", self.message_encoding)?;
        }
        match self.n_messages {
            0 => write!(f, ", no messages)"),
            1 => write!(f, ", 1 message)"),
            n => write!(f, ", {n} messages)"),
        }
    }
}

/// The channels of a recording as they come, in a summary or in the data.
#[derive(Debug, Default)]
pub(crate) struct Catalogue {
    schema_names: BTreeMap<u16, String>,
    channels: BTreeMap<u16, Channel>,
    n_messages: BTreeMap<u16, u64>,
}

#[derive(Debug)]
struct Channel {
    schema_id: u16,
    topic: String,
    message_encoding: String,
}

impl Catalogue {
    /// Takes note of a schema or channel, and counts a message.
    pub(crate) fn add(&mut self, record: &Record<'_>) {
        let text = |bytes| String::from_utf8_lossy(bytes).into_owned();
        match *record {
            Record::Schema { id, name } => {
                self.schema_names.insert(id, text(name));
            }
            Record::Channel { id, schema_id, topic, message_encoding } => {
                let (topic, message_encoding) = (text(topic), text(message_encoding));
                self.channels.insert(id, Channel { schema_id, topic, message_encoding });
            }
            Record::Message { channel_id, .. } => *self.n_messages.entry(channel_id).or_default() += 1,
            Record::Statistics { .. } | Record::Other => {}
        }
    }

    pub(crate) fn set_n_messages(&mut self, n_messages: BTreeMap<u16, u64>) {
        self.n_messages = n_messages;
    }

    pub(crate) fn n_channels(&self) -> usize {
        self.channels.len()
    }

    /// The topics, by name. Channels of one topic, type and encoding (several publishers) are one.
    pub(crate) fn topics(&self) -> Vec<Topic> {
        let mut topics: BTreeMap<(&str, &str, &str), (u64, Vec<u16>)> = BTreeMap::new();
        for (id, channel) in &self.channels {
            let type_name = self.schema_names.get(&channel.schema_id).map_or("", String::as_str);
            let (n_messages, channel_ids) =
                topics.entry((&channel.topic, type_name, &channel.message_encoding)).or_default();
            *n_messages = n_messages.saturating_add(self.n_messages.get(id).copied().unwrap_or(0));
            channel_ids.push(*id);
        }
        let topic =
            |((name, type_name, message_encoding), (n_messages, channel_ids)): ((&str, &str, &str), _)| {
                Topic {
                    name: name.to_owned(),
                    type_name: type_name.to_owned(),
                    n_messages,
                    message_encoding: message_encoding.to_owned(),
                    channel_ids,
                }
            };
        topics.into_iter().map(topic).collect()
    }
}

/// The topic for a role: the one named, or the only one that fits. Where there is odometry, a pose on its own must be
/// named: what stands beside odometry is a goal, a marker, or the truth to judge it by.
///
/// `None` if none was named and none fits, or several could give commands.
pub(crate) fn choose(
    path: &Path,
    topics: &[Topic],
    role: Role,
    named: Option<&str>,
) -> Result<Option<Topic>, TripError> {
    let path = path.to_owned();
    let named_topics: Vec<&Topic> =
        topics.iter().filter(|topic| named.is_none_or(|name| topic.name == name)).collect();
    let mut candidates: Vec<&Topic> =
        named_topics.iter().copied().filter(|topic| role.is_given_by(topic)).collect();
    let is_odometry = |topic: &&Topic| topic.pose_type() == Some(PoseType::Odometry);
    if role == Role::Poses && candidates.iter().any(is_odometry) {
        candidates.retain(is_odometry);
    }
    match (candidates.as_slice(), named) {
        ([topic], _) => Ok(Some((*topic).clone())),
        ([], None) => Ok(None),
        ([], Some(name)) => Err(match named_topics.first() {
            Some(topic) => TripError::UnfitTopic { path, role, topic: Box::new((*topic).clone()) },
            None => TripError::NoSuchTopic { path, role, name: name.to_owned(), topics: topics.to_vec() },
        }),
        // Commands before and after whatever limits them: most who read a trip need neither, and nobody can know which is meant.
        (_, None) if role == Role::Commands => Ok(None),
        (several, _) => Err(TripError::SeveralTopics {
            path,
            role,
            candidates: several.iter().copied().cloned().collect(),
        }),
    }
}
