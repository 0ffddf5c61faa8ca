//! What is in a recording: its topics, how regularly their messages came, and what each could be read as.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use crate::catalogue::{Catalogue, FrameTopics, FrameType, Role, Topic, TopicKey, choose, choose_frames};
use crate::counts::Unit;
use crate::frame_message::read_frame;
use crate::message::{header_stamp, read_command, read_pose};
use crate::record::Record;
use crate::recording::{End, Format, Recording};
use crate::rhythm::Rhythm;
use crate::{FrameLayout, Gap, MessageFault, Stamp, TripError};

/// The unit in which frames are looked at: metres per count.
const MILLIMETRE: f64 = 0.001;

/// What is in a recording.
#[derive(Debug)]
pub struct TripInfo {
    /// The file.
    pub path: PathBuf,
    /// What sort of file it is, in words.
    pub format: Format,
    /// Bytes in the file.
    pub n_bytes: u64,
    /// Its topics, by name.
    pub topics: Vec<TopicInfo>,
    /// Where the recording was cut off, if it was: `is cut off at …`.
    pub cut_off: Option<String>,
    /// What stopped the reading. Everything else is of the recording before that.
    pub failure: Option<TripError>,
}

/// One topic of a recording.
#[derive(Debug)]
pub struct TopicInfo {
    /// Name, type and number of messages.
    pub topic: Topic,
    /// The moments of its first message and its latest: by the messages' own stamps where they are read as something, and
    /// else by when they were logged.
    pub span: Option<(Stamp, Stamp)>,
    /// The usual time from one message to the next.
    pub period_s: Option<f64>,
    /// How often at least three times as much passed, and the longest.
    pub gaps: Option<(u64, Gap)>,
    /// Messages whose moment was before that of the one before.
    pub n_backwards: u64,
    /// What the topic can be read as.
    pub gives: Gives,
}

/// What a topic can be read as, by its type and its first message.
#[derive(Debug, Clone, PartialEq)]
pub enum Gives {
    /// Frames that look like this, in counts of a millimetre.
    Frames(FrameLayout),
    /// Where the robot was.
    Poses,
    /// What it was told to do.
    Commands,
    /// By its type it would be read, but not this.
    Unfit(Role, MessageFault),
    /// Nothing that is read.
    Nothing,
}

/// A way to read a trip.
#[derive(Debug, Clone, PartialEq)]
pub struct Choice {
    /// What to give to `--frames-topic`, `--poses-topic` or `--commands-topic`.
    pub name: String,
    /// Whether it is what is read without that flag.
    pub is_default: bool,
    /// Of frames: what they look like.
    pub layout: Option<FrameLayout>,
}

impl TripInfo {
    /// Reads a recording through.
    ///
    /// Holds one chunk of it and some kilobytes for each topic.
    ///
    /// # Errors
    ///
    /// No such file, or of another format. What is wrong further in is [`failure`](Self::failure).
    pub fn read(path: &Path) -> Result<TripInfo, TripError> {
        let mut recording = Recording::open(path)?;
        let mut reading = Reading::default();
        let failure = loop {
            match recording.next_record() {
                Ok(Some(record)) => reading.add(&record),
                Ok(None) => break None,
                Err(failure) => break Some(failure),
            }
        };
        let (at_byte, n_bytes) = (recording.at_byte(), recording.n_bytes());
        let cut_off = match recording.end() {
            Some(End::CutOff) => Some(format!("is cut off at byte {at_byte} of {n_bytes}")),
            Some(End::Closed) if !recording.is_closed() => Some(format!(
                "is not properly closed after byte {at_byte} of {n_bytes}; all its messages were read"
            )),
            _ => None,
        };
        let format = recording.format();
        Ok(TripInfo { path: path.to_owned(), format, n_bytes, topics: reading.topics(), cut_off, failure })
    }

    /// The moments of the first message and the latest.
    pub fn span(&self) -> Option<(Stamp, Stamp)> {
        let spans = self.topics.iter().filter_map(|topic| topic.span);
        spans.reduce(|(first, latest), (other_first, other_latest)| {
            (first.min(other_first), latest.max(other_latest))
        })
    }

    /// What frames could be: topics whose first message is one, and all with single ranges together.
    pub fn frames(&self) -> Vec<Choice> {
        let default = choose_frames(&self.path, &self.plain_topics(), None).ok().flatten();
        let default = default.map(|chosen| chosen.name()).unwrap_or_default();
        let mut ranges: Vec<Topic> = Vec::new();
        let mut choices = Vec::new();
        for TopicInfo { topic, gives, .. } in &self.topics {
            match *gives {
                Gives::Frames(_) if topic.key().frame_type() == Some(FrameType::Range) => {
                    ranges.push(topic.clone());
                }
                Gives::Frames(layout) => choices.push((topic.name.clone(), layout)),
                _ => {}
            }
        }
        if !ranges.is_empty() {
            let columns = ranges.len() as u32;
            let layout = FrameLayout { rows: 1, columns, metres_per_count: MILLIMETRE };
            choices.push((FrameTopics::ranges(ranges).name(), layout));
        }
        let choice = |(name, layout)| Choice { is_default: name == default, name, layout: Some(layout) };
        choices.into_iter().map(choice).collect()
    }

    /// What could be poses, or commands.
    pub fn beside_frames(&self, role: Role) -> Vec<Choice> {
        let gives = if role == Role::Poses { Gives::Poses } else { Gives::Commands };
        let default = choose(&self.path, &self.plain_topics(), role, None).ok().flatten();
        let is_default = |topic: &TopicInfo| default.as_ref().is_some_and(|default| *default == topic.topic);
        let choice = |topic: &TopicInfo| Choice {
            name: topic.topic.name.clone(),
            is_default: is_default(topic),
            layout: None,
        };
        self.topics.iter().filter(|topic| topic.gives == gives).map(choice).collect()
    }

    fn plain_topics(&self) -> Vec<Topic> {
        self.topics.iter().map(|topic| topic.topic.clone()).collect()
    }
}

/// A recording being read through.
#[derive(Default)]
struct Reading {
    catalogue: Catalogue,
    /// What is known of each topic, and where in that a channel's topic is.
    seen: BTreeMap<TopicKey, Seen>,
    keys: BTreeMap<u32, TopicKey>,
}

#[derive(Default)]
struct Seen {
    rhythm: Rhythm,
    gives: Option<Gives>,
}

impl Reading {
    fn add(&mut self, record: &Record<'_>) {
        self.catalogue.add(record);
        match *record {
            // What a channel was taken for may have changed.
            Record::Schema { .. } | Record::Channel { .. } => self.keys.clear(),
            Record::Message { channel_id, log_time, data, .. } => {
                self.add_message(channel_id, log_time, data);
            }
            Record::Statistics { .. } | Record::Other => {}
        }
    }

    fn add_message(&mut self, channel_id: u32, log_time: u64, data: &[u8]) {
        if !self.keys.contains_key(&channel_id) {
            let Some(key) = self.catalogue.key(channel_id) else { return };
            self.keys.insert(channel_id, key);
        }
        let key = &self.keys[&channel_id];
        if !self.seen.contains_key(key) {
            self.seen.insert(key.clone(), Seen::default());
        }
        let Some(seen) = self.seen.get_mut(key) else { return };
        let gives = seen.gives.get_or_insert_with(|| gives(key, data));
        let encoding = key.encoding().filter(|_| *gives != Gives::Nothing && key.has_header());
        let own = encoding.and_then(|encoding| header_stamp(encoding, data));
        seen.rhythm.add(own.unwrap_or(Stamp(i64::try_from(log_time).unwrap_or(i64::MAX))));
    }

    fn topics(mut self) -> Vec<TopicInfo> {
        let info = |topic: Topic| {
            let seen = self.seen.remove(&topic.key()).unwrap_or_default();
            TopicInfo {
                span: seen.rhythm.span(),
                period_s: seen.rhythm.period_s(),
                gaps: seen.rhythm.gaps(),
                n_backwards: seen.rhythm.n_backwards(),
                gives: seen.gives.unwrap_or(Gives::Nothing),
                topic,
            }
        };
        self.catalogue.topics().into_iter().map(info).collect()
    }
}

/// What a topic can be read as, by its first message.
fn gives(key: &TopicKey, data: &[u8]) -> Gives {
    let unit = Unit::new(MILLIMETRE).expect("a millimetre is a unit");
    let Some(encoding) = key.encoding() else { return Gives::Nothing };
    let (role, outcome) = if let Some(frame_type) = key.frame_type() {
        let head = read_frame(frame_type, encoding, data, unit, &mut Vec::new());
        let layout = |rows, columns| FrameLayout { rows, columns, metres_per_count: MILLIMETRE };
        (Role::Frames, head.map(|head| Gives::Frames(layout(head.rows, head.columns))))
    } else if let Some(pose_type) = key.pose_type() {
        (Role::Poses, read_pose(pose_type, encoding, data).map(|_| Gives::Poses))
    } else if let Some(command_type) = key.command_type() {
        (Role::Commands, read_command(command_type, encoding, data).map(|_| Gives::Commands))
    } else {
        return Gives::Nothing;
    };
    outcome.unwrap_or_else(|fault| Gives::Unfit(role, fault))
}
