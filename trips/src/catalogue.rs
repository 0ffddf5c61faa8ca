//! Which topics a trip has, and which of them give frames, poses and commands.

use std::borrow::Cow;
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

/// How messages are encoded on a topic.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Encoding {
    Cdr,
    Ros1,
}

/// How frames are encoded on a topic.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum FrameType {
    LaserScan,
    Image,
    PointCloud2,
    CompressedImage,
    Range,
    Float32MultiArray,
}

impl FrameType {
    /// Of several topics those are taken that come first here: a scan is made to be one frame, a cloud is often made of an
    /// image that is there too, single ranges are bumpers beside either, and numbers can be anything.
    fn precedence(self) -> u8 {
        match self {
            Self::LaserScan | Self::Image => 0,
            Self::PointCloud2 | Self::CompressedImage => 1,
            Self::Range => 2,
            Self::Float32MultiArray => 3,
        }
    }
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
pub(crate) const DIAGNOSTIC_ARRAY: &str = "diagnostic_msgs/msg/DiagnosticArray";
pub(crate) const FLOAT64_MULTI_ARRAY: &str = "std_msgs/msg/Float64MultiArray";

pub(crate) const POINT_CLOUD2: &str = "sensor_msgs/msg/PointCloud2";
pub(crate) const COMPRESSED_IMAGE: &str = "sensor_msgs/msg/CompressedImage";
pub(crate) const RANGE: &str = "sensor_msgs/msg/Range";
pub(crate) const FLOAT32_MULTI_ARRAY: &str = "std_msgs/msg/Float32MultiArray";

/// What `compressed_depth_image_transport` adds to the name of an image's topic.
const COMPRESSED_DEPTH: &str = "/compressedDepth";

impl Role {
    /// The types of message that give these, in a sentence.
    pub fn types(self) -> String {
        match self {
            Role::Frames => format!(
                "{LASER_SCAN}, {IMAGE}, {POINT_CLOUD2}, {COMPRESSED_IMAGE} (compressedDepth), {RANGE} or {FLOAT32_MULTI_ARRAY}"
            ),
            Role::Poses => format!("{ODOMETRY} or {POSE_STAMPED}"),
            Role::Commands => format!("{TWIST} or {TWIST_STAMPED}"),
        }
    }

    fn is_given_by(self, topic: &Topic) -> bool {
        let key = topic.key();
        let fits = match self {
            Role::Frames => key.frame_type().is_some(),
            Role::Poses => key.pose_type().is_some(),
            Role::Commands => key.command_type().is_some(),
        };
        // A recorder lists topics that it subscribed to even if nothing came.
        fits && key.encoding().is_some() && topic.n_messages > 0
    }
}

/// What a topic is: channels with the same are one topic.
#[derive(Debug, Clone, PartialEq, Eq, PartialOrd, Ord)]
pub(crate) struct TopicKey {
    pub(crate) name: String,
    pub(crate) type_name: String,
    pub(crate) message_encoding: String,
}

impl TopicKey {
    pub(crate) fn encoding(&self) -> Option<Encoding> {
        encoding_named(&self.message_encoding)
    }

    pub(crate) fn frame_type(&self) -> Option<FrameType> {
        match &*self.ros2_type_name() {
            LASER_SCAN => Some(FrameType::LaserScan),
            IMAGE => Some(FrameType::Image),
            POINT_CLOUD2 => Some(FrameType::PointCloud2),
            COMPRESSED_IMAGE => Some(FrameType::CompressedImage),
            RANGE => Some(FrameType::Range),
            FLOAT32_MULTI_ARRAY => Some(FrameType::Float32MultiArray),
            _ => None,
        }
    }

    pub(crate) fn pose_type(&self) -> Option<PoseType> {
        match &*self.ros2_type_name() {
            ODOMETRY => Some(PoseType::Odometry),
            POSE_STAMPED => Some(PoseType::PoseStamped),
            _ => None,
        }
    }

    pub(crate) fn command_type(&self) -> Option<CommandType> {
        match &*self.ros2_type_name() {
            TWIST => Some(CommandType::Twist),
            TWIST_STAMPED => Some(CommandType::TwistStamped),
            _ => None,
        }
    }

    /// Whether messages begin with a header.
    pub(crate) fn has_header(&self) -> bool {
        let is_bare = matches!(self.frame_type(), Some(FrameType::Float32MultiArray))
            || matches!(self.command_type(), Some(CommandType::Twist));
        let is_read =
            self.frame_type().is_some() || self.pose_type().is_some() || self.command_type().is_some();
        is_read && !is_bare
    }

    /// ROS 1 leaves out the folder: `sensor_msgs/LaserScan`.
    fn ros2_type_name(&self) -> Cow<'_, str> {
        match self.type_name.split_once('/') {
            Some((package, name)) if !name.contains('/') => Cow::Owned(format!("{package}/msg/{name}")),
            _ => Cow::Borrowed(&self.type_name),
        }
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
    pub(crate) channel_ids: Vec<u32>,
}

fn encoding_named(name: &str) -> Option<Encoding> {
    match name {
        "cdr" => Some(Encoding::Cdr),
        "ros1" => Some(Encoding::Ros1),
        _ => None,
    }
}

impl Topic {
    pub(crate) fn encoding(&self) -> Option<Encoding> {
        encoding_named(&self.message_encoding)
    }

    pub(crate) fn key(&self) -> TopicKey {
        let Topic { name, type_name, message_encoding, .. } = self.clone();
        TopicKey { name, type_name, message_encoding }
    }
}

/// `/scan (sensor_msgs/msg/LaserScan, 1379 messages)`
impl fmt::Display for Topic {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let type_name = if self.type_name.is_empty() { "type unknown" } else { &self.type_name };
        write!(f, "{} ({type_name}", self.name)?;
        if self.encoding().is_none() {
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
#[derive(Debug, Clone, Default)]
pub(crate) struct Catalogue {
    schema_names: BTreeMap<u32, String>,
    channels: BTreeMap<u32, Channel>,
    n_messages: BTreeMap<u32, u64>,
}

#[derive(Debug, Clone)]
struct Channel {
    schema_id: u32,
    topic: String,
    message_encoding: String,
}

impl Catalogue {
    /// Takes note of a schema or channel, and counts a message.
    pub(crate) fn add(&mut self, record: &Record<'_>) {
        let text = |bytes| String::from_utf8_lossy(bytes).into_owned();
        match *record {
            Record::Schema { id, name, .. } => {
                self.schema_names.insert(id, text(name));
            }
            Record::Channel { id, schema_id, topic, message_encoding, .. } => {
                let (topic, message_encoding) = (text(topic), text(message_encoding));
                self.channels.insert(id, Channel { schema_id, topic, message_encoding });
            }
            Record::Message { channel_id, .. } => *self.n_messages.entry(channel_id).or_default() += 1,
            Record::Statistics { .. } | Record::Other => {}
        }
    }

    pub(crate) fn add_n_messages(&mut self, channel_id: u32, n_messages: u64) {
        let counted = self.n_messages.entry(channel_id).or_default();
        *counted = counted.saturating_add(n_messages);
    }

    pub(crate) fn set_n_messages(&mut self, n_messages: BTreeMap<u32, u64>) {
        self.n_messages = n_messages;
    }

    pub(crate) fn n_channels(&self) -> usize {
        self.channels.len()
    }

    /// What a channel's topic is.
    pub(crate) fn key(&self, channel_id: u32) -> Option<TopicKey> {
        let Channel { schema_id, topic, message_encoding } = self.channels.get(&channel_id)?;
        let type_name = self.schema_names.get(schema_id).cloned().unwrap_or_default();
        Some(TopicKey { name: topic.clone(), type_name, message_encoding: message_encoding.clone() })
    }

    /// The topics, by name. Channels of one topic, type and encoding (several publishers) are one.
    pub(crate) fn topics(&self) -> Vec<Topic> {
        let mut topics: BTreeMap<TopicKey, (u64, Vec<u32>)> = BTreeMap::new();
        for (id, key) in self.channels.keys().filter_map(|id| Some((*id, self.key(*id)?))) {
            let (n_messages, channel_ids) = topics.entry(key).or_default();
            *n_messages = n_messages.saturating_add(self.n_messages.get(&id).copied().unwrap_or(0));
            channel_ids.push(id);
        }
        let topic = |(key, (n_messages, channel_ids)): (TopicKey, _)| {
            let TopicKey { name, type_name, message_encoding } = key;
            Topic { name, type_name, n_messages, message_encoding, channel_ids }
        };
        topics.into_iter().map(topic).collect()
    }
}

/// The topics that frames are read from, and how they are encoded on each: one, or several that are joined, of which the
/// first leads.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct FrameTopics(pub(crate) Vec<(Topic, FrameType)>);

impl FrameTopics {
    /// What they are called where one name is asked for.
    pub(crate) fn name(&self) -> String {
        let names: Vec<&str> = self.0.iter().map(|(topic, _)| topic.name.as_str()).collect();
        names.join(",")
    }

    /// Topics with single ranges, in the order of their names: `/sonar_2` before `/sonar_10`.
    pub(crate) fn ranges(mut topics: Vec<Topic>) -> Self {
        topics.sort_by_cached_key(|topic| natural(&topic.name));
        Self(topics.into_iter().map(|topic| (topic, FrameType::Range)).collect())
    }
}

/// A name that is ordered by the numbers in it: text, and the number after it.
fn natural(name: &str) -> Vec<(String, u64)> {
    let mut parts = Vec::new();
    let mut rest = name;
    while !rest.is_empty() {
        let digits_at = rest.find(|letter: char| letter.is_ascii_digit()).unwrap_or(rest.len());
        let (text, after) = rest.split_at(digits_at);
        let digits_end = after.find(|letter: char| !letter.is_ascii_digit()).unwrap_or(after.len());
        let (digits, others) = after.split_at(digits_end);
        parts.push((text.to_owned(), digits.parse().unwrap_or(0)));
        rest = others;
    }
    parts
}

/// The topics for frames: those named, with commas between them, each once; or the only one that fits, or all with single
/// ranges if there is nothing better.
///
/// `None` if none was named and none fits.
pub(crate) fn choose_frames(
    path: &Path,
    topics: &[Topic],
    named: Option<&str>,
) -> Result<Option<FrameTopics>, TripError> {
    let role = Role::Frames;
    if let Some(name) = named {
        let mut chosen: Vec<(Topic, FrameType)> = Vec::new();
        for name in name.split(',').map(str::trim) {
            if chosen.iter().any(|(topic, _)| topic.name == name) {
                return Err(TripError::TopicTwice { name: name.to_owned() });
            }
            let topic = choose(path, topics, role, Some(name))?;
            chosen.extend(topic.and_then(|topic| topic.key().frame_type().map(|of| (topic, of))));
        }
        return Ok(Some(FrameTopics(chosen)));
    }
    let precedence = |topic: &&Topic| topic.key().frame_type().map(FrameType::precedence);
    let is_meant = |topic: &&Topic| {
        let is_image = topic.key().frame_type() == Some(FrameType::CompressedImage);
        role.is_given_by(topic) && (!is_image || topic.name.ends_with(COMPRESSED_DEPTH))
    };
    let candidates: Vec<&Topic> = topics.iter().filter(is_meant).collect();
    let first = candidates.iter().filter_map(precedence).min();
    let candidates: Vec<&Topic> = candidates.into_iter().filter(|topic| precedence(topic) == first).collect();
    let frame_type = candidates.first().and_then(|topic| topic.key().frame_type());
    match (candidates.as_slice(), frame_type) {
        (_, None) => Ok(None),
        (ranges, Some(FrameType::Range)) => {
            Ok(Some(FrameTopics::ranges(ranges.iter().copied().cloned().collect())))
        }
        ([topic], Some(frame_type)) => Ok(Some(FrameTopics(vec![((*topic).clone(), frame_type)]))),
        (several, _) => Err(TripError::SeveralTopics {
            path: path.to_owned(),
            role,
            candidates: several.iter().copied().cloned().collect(),
        }),
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
    let is_odometry = |topic: &&Topic| topic.key().pose_type() == Some(PoseType::Odometry);
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
