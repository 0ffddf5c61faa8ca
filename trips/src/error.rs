//! What can go wrong with a trip, in sentences.

use std::fmt::{self, Write as _};
use std::io;
use std::path::PathBuf;

use thiserror::Error;

use crate::{FrameLayout, Role, Topic};

/// Why a trip could not be opened, or not read further.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum TripError {
    /// There is nothing at the path.
    #[error("no trip at {}: there is no such file", path.display())]
    NotFound {
        /// The path asked for.
        path: PathBuf,
    },
    /// The path is a directory.
    #[error("{} is a directory; a trip is one .mcap file, name the one in it", path.display())]
    IsDirectory {
        /// The path asked for.
        path: PathBuf,
    },
    /// The system refused to open or read the file.
    #[error("could not read {}: {source}", path.display())]
    Io {
        /// The trip's file.
        path: PathBuf,
        /// The system's reason.
        source: io::Error,
    },
    /// The file has no bytes.
    #[error("{} is empty (0 bytes): nothing was recorded", path.display())]
    Empty {
        /// The trip's file.
        path: PathBuf,
    },
    /// The file is of another format.
    #[error("{} is neither an MCAP file nor a ROS 1 bag but {looks_like}; `ros2 bag convert` or `rosbags-convert` makes one of other bags", path.display())]
    NotMcap {
        /// The trip's file.
        path: PathBuf,
        /// What its first bytes say that it is.
        looks_like: &'static str,
    },
    /// Nothing is saved from files of another format.
    #[error("{} is {looks_like}; only MCAP files and ROS 1 bags of format 2.0 can be saved from", path.display())]
    UnsavedFormat {
        /// The recording.
        path: PathBuf,
        /// What its first bytes say that it is.
        looks_like: &'static str,
    },
    /// The unit asked for is none.
    #[error(
        "a unit of {metres_per_count} metres per count was asked for; it must be a finite number above 0"
    )]
    Unit {
        /// The unit asked for.
        metres_per_count: f64,
    },
    /// The recording ends before its first frame does.
    #[error("{} is cut off at byte {at_byte} of {n_bytes}, before its first frame", path.display())]
    CutOffBeforeFirstFrame {
        /// The trip's file.
        path: PathBuf,
        /// Where the first record begins that is not whole.
        at_byte: u64,
        /// Bytes in the file.
        n_bytes: u64,
    },
    /// No topic carries frames.
    #[error("{} has no frames: {}", path.display(), no_frames(topics))]
    NoFrames {
        /// The trip's file.
        path: PathBuf,
        /// The topics there are.
        topics: Vec<Topic>,
    },
    /// Several topics fit and none was chosen.
    #[error("{} has {} topics with {role}: {}; choose one with --{role}-topic NAME{}", path.display(), candidates.len(), list(candidates), or_join(*role))]
    SeveralTopics {
        /// The trip's file.
        path: PathBuf,
        /// What the topic is wanted for.
        role: Role,
        /// The topics that fit.
        candidates: Vec<Topic>,
    },
    /// The topic asked for is not in the trip.
    #[error("{} has no topic {name}, asked for with --{role}-topic; it has {}", path.display(), list(topics))]
    NoSuchTopic {
        /// The trip's file.
        path: PathBuf,
        /// What the topic is wanted for.
        role: Role,
        /// The name asked for.
        name: String,
        /// The topics there are.
        topics: Vec<Topic>,
    },
    /// The topic asked for carries something else, or nothing.
    #[error("{topic} in {} cannot give {role}, asked for with --{role}-topic: that takes messages of type {}", path.display(), role.types())]
    UnfitTopic {
        /// The trip's file.
        path: PathBuf,
        /// What the topic is wanted for.
        role: Role,
        /// The topic asked for.
        topic: Box<Topic>,
    },
    /// A topic would be joined with itself.
    #[error("--frames-topic has {name} twice; name each topic once")]
    TopicTwice {
        /// The topic.
        name: String,
    },
    /// A message could not be read.
    #[error("message {number} on {topic} in {}: {fault}", path.display())]
    Message {
        /// The trip's file.
        path: PathBuf,
        /// The message's topic.
        topic: String,
        /// Which message on its topic, from 1.
        number: u64,
        /// What is wrong with it.
        fault: MessageFault,
    },
    /// A frame is of another size than those before.
    #[error("frame {number} on {topic} in {} has {to}, but the trip began with {from}; a trip has frames of one size", path.display())]
    FrameSizeChanged {
        /// The trip's file.
        path: PathBuf,
        /// The frames' topic.
        topic: String,
        /// Which frame, from 1.
        number: u64,
        /// The layout of the frames before.
        from: FrameLayout,
        /// The layout of this frame.
        to: FrameLayout,
    },
    /// The recording is damaged, and not just at its end.
    #[error("{} is damaged at byte {at_byte}: {what}", path.display())]
    Damaged {
        /// The trip's file.
        path: PathBuf,
        /// Where the damaged record or chunk begins.
        at_byte: u64,
        /// What is wrong there.
        what: String,
    },
    /// A record or chunk is larger than what is held in memory.
    #[error("{} has a chunk or record of {n_bytes} bytes at byte {at_byte}, more than the {limit} that are read at once; record it with smaller chunks", path.display())]
    TooLarge {
        /// The trip's file.
        path: PathBuf,
        /// Where it begins.
        at_byte: u64,
        /// Its bytes.
        n_bytes: u64,
        /// The limit.
        limit: u64,
    },
    /// A chunk is compressed in a way that is not supported.
    #[error("{} has a chunk compressed with '{name}' at byte {at_byte}; {supported} are read", path.display())]
    UnsupportedCompression {
        /// The trip's file.
        path: PathBuf,
        /// Where the chunk begins.
        at_byte: u64,
        /// The compression's name in the file.
        name: String,
        /// What can be read.
        supported: &'static str,
    },
}

/// What is wrong with one message.
#[derive(Debug, Clone, PartialEq, Eq, Error)]
#[non_exhaustive]
pub enum MessageFault {
    /// It ends before its last field.
    #[error("its {n_bytes} bytes end before its last field does")]
    CutShort {
        /// Bytes in the message.
        n_bytes: usize,
    },
    /// It is not encoded in plain CDR.
    #[error(
        "its encoding is 0x{kind:04x}; plain CDR is read, 0x0000 (big-endian) and 0x0001 (little-endian)"
    )]
    Encapsulation {
        /// The representation identifier, its first two bytes.
        kind: u16,
    },
    /// Its image encoding is not one of distances.
    #[error("its image encoding is '{encoding}'; distances are read from 16UC1 and 32FC1")]
    Encoding {
        /// The image encoding.
        encoding: String,
    },
    /// It has no readings.
    #[error("it has no readings ({rows} × {columns})")]
    NoReadings {
        /// Rows of readings.
        rows: u32,
        /// Readings in a row.
        columns: u32,
    },
    /// It is a range of another sensor than those before on its topic.
    #[error(
        "it is a range of '{to}' by its frame_id, and those before are of '{from}'; sensors that share a topic are not told apart"
    )]
    OtherSensor {
        /// The sensor of the messages before.
        from: String,
        /// The sensor of this one.
        to: String,
    },
    /// Its numbers have too many dimensions.
    #[error("its numbers have {n_dimensions} dimensions; a frame has rows and columns")]
    Dimensions {
        /// Dimensions of its layout.
        n_dimensions: usize,
    },
    /// It has fewer numbers than it claims.
    #[error(
        "it has {n_numbers} numbers, but {rows} rows of {columns} need {needed} with what lies before and between them"
    )]
    ArrayTooShort {
        /// Numbers in the message.
        n_numbers: usize,
        /// Rows of readings.
        rows: u32,
        /// Readings in a row.
        columns: u32,
        /// Numbers that all rows need.
        needed: u64,
    },
    /// A cloud's points lie in no rows.
    #[error(
        "its {n_points} points are in one row, not organised in rows and columns; a frame has every reading in its place"
    )]
    NotOrganised {
        /// Points in the message.
        n_points: u32,
    },
    /// A cloud has no coordinates that are read.
    #[error("its points have no x, y and z of FLOAT32 or FLOAT64; they have {}", if fields.is_empty() { "no fields" } else { fields })]
    NoCoordinates {
        /// The fields that they have.
        fields: String,
    },
    /// A cloud's points overlap.
    #[error("its points are {point_step} bytes apart, but x, y and z need {needed}")]
    PointTooShort {
        /// Bytes from one point to the next.
        point_step: u32,
        /// Bytes up to the end of the last coordinate.
        needed: u64,
    },
    /// Its format is none of compressed distances.
    #[error(
        "its format is '{format}'; distances are read from 16UC1 and 32FC1 as compressedDepth in PNG or RVL"
    )]
    CompressedFormat {
        /// The format.
        format: String,
    },
    /// Its PNG cannot be read.
    #[error("its PNG cannot be read: {what}")]
    Png {
        /// What is wrong with it.
        what: String,
    },
    /// Its RVL cannot be read.
    #[error("its RVL cannot be read: {what}")]
    Rvl {
        /// What is wrong with it.
        what: &'static str,
    },
    /// It has more readings than a frame may have.
    #[error("it has {rows} × {columns} readings; a frame has at most {limit}")]
    TooManyReadings {
        /// Rows of readings.
        rows: u32,
        /// Readings in a row.
        columns: u32,
        /// The limit.
        limit: u64,
    },
    /// An image's rows overlap.
    #[error("its rows are {step} bytes apart, but {columns} pixels of {bytes_per_pixel} bytes need {needed}")]
    RowTooShort {
        /// Bytes from one row to the next.
        step: u32,
        /// Pixels in a row.
        columns: u32,
        /// Bytes in a pixel.
        bytes_per_pixel: u32,
        /// Bytes that a row needs.
        needed: u64,
    },
    /// An image has less data than it claims.
    #[error("it has {n_bytes} bytes of pixels, but {rows} rows of {step} bytes need {needed}")]
    DataTooShort {
        /// Bytes of pixels.
        n_bytes: usize,
        /// Rows of pixels.
        rows: u32,
        /// Bytes from one row to the next.
        step: u32,
        /// Bytes that all rows need.
        needed: u64,
    },
}

/// Why a trip could not be written. Nothing is left under its name.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum TripWriteError {
    /// The system refused to create, write or rename the file.
    #[error("could not write {}: {source}", path.display())]
    Io {
        /// The trip's file.
        path: PathBuf,
        /// The system's reason.
        source: io::Error,
    },
    /// The path is a directory.
    #[error("could not write {}: it is a directory; name a file in it", path.display())]
    IsDirectory {
        /// The path asked for.
        path: PathBuf,
    },
    /// The unit given is none.
    #[error("a unit of {metres_per_count} metres per count was given; it must be a finite number above 0")]
    Unit {
        /// The unit given.
        metres_per_count: f64,
    },
}

fn no_frames(topics: &[Topic]) -> String {
    if topics.is_empty() {
        return "it has no topics at all".to_owned();
    }
    format!("none of its topics has messages of type {}; it has {}", Role::Frames.types(), list(topics))
}

/// Frames can also be of several topics.
fn or_join(role: Role) -> &'static str {
    if role == Role::Frames { ", or join several with --frames-topic NAME,NAME" } else { "" }
}

/// Topics in a sentence: `/a (…), /b (…)`.
fn list(topics: &[Topic]) -> String {
    let mut sentence = String::new();
    for (index, topic) in topics.iter().enumerate() {
        let separator = if index == 0 { "" } else { ", " };
        // Writing to a string cannot fail.
        let _ = write!(sentence, "{separator}{topic}");
    }
    if sentence.is_empty() { "no topics".to_owned() } else { sentence }
}

/// `frames`, `poses` or `commands`, as in the flags that choose their topics.
impl fmt::Display for Role {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Role::Frames => "frames",
            Role::Poses => "poses",
            Role::Commands => "commands",
        })
    }
}
