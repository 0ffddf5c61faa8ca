//! A bag being written: messages of any type, in an MCAP file that is whole or not there.
//!
//! The file has what `ros2 bag`, Foxglove, PlotJuggler and `rosbags` look for: the profile `ros2` and the metadata record
//! of `rosbag2` (in its version 5, which every distribution since Humble reads). Until it is finished it stands beside its
//! name under another, `NAME.….partial`.

use std::collections::{BTreeMap, BTreeSet};
use std::fmt::Write as _;
use std::fs::File;
use std::io::{self, BufWriter};
use std::path::{Path, PathBuf};
use std::sync::Arc;

use mcap::records::{MessageHeader, Metadata};
use mcap::{Attachment, McapError};
use tempfile::NamedTempFile;

use crate::TripWriteError;

/// The profile of ROS 2.
pub(crate) const ROS2: &str = "ros2";

/// The name of the record with `rosbag2`'s metadata.
pub(crate) const ROSBAG2: &str = "rosbag2";

/// How chunks are compressed.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Compression {
    /// Not at all.
    None,
    /// LZ4. Faster than zstd; of depth images it saves next to nothing.
    Lz4,
    /// Zstandard at level 1, which fits depth images.
    Zstd,
}

/// How a trip is laid out in its file.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct WriterOptions {
    /// How chunks are compressed.
    pub compression: Compression,
    /// Bytes of messages in a chunk, before compression; `None`: no chunks, and no compression either.
    pub chunk_bytes: Option<u64>,
    /// Whether an index and a summary are written, so that readers find topics and times without reading everything.
    pub indexed: bool,
}

/// Chunks of 1 MiB, compressed with zstd and indexed.
impl Default for WriterOptions {
    fn default() -> Self {
        Self { compression: Compression::Zstd, chunk_bytes: Some(1 << 20), indexed: true }
    }
}

/// A definition of messages, as it stands in a bag.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) struct Schema {
    pub(crate) name: String,
    pub(crate) encoding: String,
    pub(crate) definition: Vec<u8>,
}

/// What a channel says of itself.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) struct Channel {
    pub(crate) topic: String,
    pub(crate) message_encoding: String,
    pub(crate) metadata: BTreeMap<String, String>,
}

/// The bag. Messages stand in it in the order of the calls. Dropped without [`finish`](Self::finish), it leaves nothing
/// behind.
pub(crate) struct BagFile {
    target: PathBuf,
    is_of_ros2: bool,
    mcap: mcap::Writer<BufWriter<NamedTempFile>>,
    /// The same open file, to ask for what the writer hides.
    file: Arc<File>,
    channels: BTreeMap<u16, Written>,
    /// Times of the earliest and the latest message, ns.
    logged: Option<(u64, u64)>,
}

/// A channel that was written, and how much of it.
struct Written {
    topic: String,
    type_name: String,
    message_encoding: String,
    n_messages: u64,
}

impl BagFile {
    /// Begins a bag that will replace whatever is at `path`.
    ///
    /// * `profile` — whose messages these are: [`ROS2`], or another's
    ///
    /// # Errors
    ///
    /// The directory does not exist or cannot be written to; `path` is itself a directory.
    pub(crate) fn create(
        path: &Path,
        profile: &str,
        options: &WriterOptions,
    ) -> Result<BagFile, TripWriteError> {
        if path.is_dir() {
            return Err(TripWriteError::IsDirectory { path: path.to_owned() });
        }
        let partial = partial_file(path).map_err(io_error(path))?;
        let file = Arc::new(partial.as_file().try_clone().map_err(io_error(path))?);
        let compression = match options.compression {
            Compression::None => None,
            Compression::Lz4 => Some(mcap::Compression::Lz4),
            Compression::Zstd => Some(mcap::Compression::Zstd),
        };
        let mcap = mcap::WriteOptions::new()
            .profile(profile)
            .library(concat!("kinds-trips ", env!("CARGO_PKG_VERSION")))
            .compression(compression)
            .compression_level(1)
            // In this thread: a robot's other programs need the other cores.
            .compression_threads(0)
            .use_chunks(options.chunk_bytes.is_some())
            .chunk_size(options.chunk_bytes)
            .emit_message_indexes(options.indexed)
            .emit_summary_records(options.indexed)
            .emit_summary_offsets(options.indexed)
            .create(BufWriter::new(partial))
            .map_err(mcap_error(path))?;
        let is_of_ros2 = profile == ROS2;
        let target = path.to_owned();
        Ok(BagFile { target, is_of_ros2, mcap, file, channels: BTreeMap::new(), logged: None })
    }

    /// Adds a channel, and returns its number. One that says the same of itself as another is that other.
    pub(crate) fn add_channel(&mut self, schema: &Schema, channel: &Channel) -> Result<u16, TripWriteError> {
        let Schema { name, encoding, definition } = schema;
        let Channel { topic, message_encoding, metadata } = channel;
        let added = self
            .mcap
            .add_schema(name, encoding, definition)
            .and_then(|schema_id| self.mcap.add_channel(schema_id, topic, message_encoding, metadata));
        let channel_id = added.map_err(mcap_error(&self.target))?;
        self.channels.entry(channel_id).or_insert_with(|| Written {
            topic: topic.clone(),
            type_name: name.clone(),
            message_encoding: message_encoding.clone(),
            n_messages: 0,
        });
        Ok(channel_id)
    }

    /// Adds a message to a channel that was added before.
    pub(crate) fn write(&mut self, header: &MessageHeader, data: &[u8]) -> Result<(), TripWriteError> {
        self.mcap.write_to_known_channel(header, data).map_err(mcap_error(&self.target))?;
        let log_time = header.log_time;
        let (earliest, latest) = self.logged.unwrap_or((log_time, log_time));
        self.logged = Some((earliest.min(log_time), latest.max(log_time)));
        if let Some(channel) = self.channels.get_mut(&header.channel_id) {
            channel.n_messages += 1;
        }
        Ok(())
    }

    pub(crate) fn attach(&mut self, attachment: &Attachment<'_>) -> Result<(), TripWriteError> {
        self.mcap.attach(attachment).map_err(mcap_error(&self.target))
    }

    pub(crate) fn add_metadata(&mut self, metadata: &Metadata) -> Result<(), TripWriteError> {
        self.mcap.write_metadata(metadata).map_err(mcap_error(&self.target))
    }

    /// Topics that have messages.
    pub(crate) fn n_topics(&self) -> usize {
        let with_messages = self.channels.values().filter(|channel| channel.n_messages > 0);
        with_messages.map(|channel| &channel.topic).collect::<BTreeSet<_>>().len()
    }

    /// Closes the current chunk and hands everything to the system: what a crash from here on cannot take.
    pub(crate) fn flush(&mut self) -> Result<(), TripWriteError> {
        self.mcap.flush().map_err(mcap_error(&self.target))
    }

    /// The file as the system has it: how long it is, and whether the disk has it too.
    pub(crate) fn file(&self) -> &Arc<File> {
        &self.file
    }

    /// Closes the bag, waits until the disk has it, and gives it its name.
    ///
    /// # Errors
    ///
    /// The file cannot be written or renamed; then nothing is left of it.
    pub(crate) fn finish(mut self) -> Result<(), TripWriteError> {
        if self.is_of_ros2 {
            let metadata = self.rosbag2_metadata();
            self.add_metadata(&metadata)?;
        }
        let path = &self.target;
        self.mcap.finish().map_err(mcap_error(path))?;
        let buffered = self.mcap.into_inner();
        let file = buffered.into_inner().map_err(|error| io_error(path)(error.into_error()))?;
        file.as_file().sync_all().map_err(io_error(path))?;
        file.persist(path).map_err(|error| io_error(path)(error.error))?;
        // The new name is on the disk once its directory is.
        File::open(directory_of(path)).and_then(|directory| directory.sync_all()).map_err(io_error(path))
    }

    /// What `ros2 bag info` shows, in YAML, as `metadata.yaml` has it beside a bag of several files.
    fn rosbag2_metadata(&self) -> Metadata {
        let (earliest_ns, latest_ns) = self.logged.unwrap_or((0, 0));
        let duration_ns = latest_ns - earliest_ns;
        let n_messages: u64 = self.channels.values().map(|channel| channel.n_messages).sum();
        let file_name = quoted(&self.target.file_name().unwrap_or_default().to_string_lossy());
        // Several channels of one topic (several publishers) are one.
        let mut counts: BTreeMap<(&str, &str, &str), u64> = BTreeMap::new();
        for channel in self.channels.values() {
            let of = (&*channel.topic, &*channel.type_name, &*channel.message_encoding);
            *counts.entry(of).or_default() += channel.n_messages;
        }
        let mut topics = String::new();
        for ((topic, type_name, message_encoding), n_messages) in counts {
            let (name, type_name) = (quoted(topic), quoted(type_name));
            // Writing to a string cannot fail.
            let _ = write!(
                topics,
                "\n- topic_metadata:\n    name: {name}\n    type: {type_name}\n    serialization_format: \
                 {message_encoding}\n    offered_qos_profiles: ''\n  message_count: {n_messages}"
            );
        }
        if topics.is_empty() {
            topics.push_str(" []");
        }
        let yaml = format!(
            "version: 5\nstorage_identifier: mcap\nduration:\n  nanoseconds: {duration_ns}\nstarting_time:\n  \
             nanoseconds_since_epoch: {earliest_ns}\nmessage_count: {n_messages}\ntopics_with_message_count:{topics}\n\
             compression_format: ''\ncompression_mode: ''\nrelative_file_paths:\n- {file_name}\nfiles:\n- path: \
             {file_name}\n  starting_time:\n    nanoseconds_since_epoch: {earliest_ns}\n  duration:\n    \
             nanoseconds: {duration_ns}\n  message_count: {n_messages}\n"
        );
        Metadata {
            name: ROSBAG2.to_owned(),
            metadata: BTreeMap::from([("serialized_metadata".to_owned(), yaml)]),
        }
    }
}

/// A YAML string, whatever is in it.
fn quoted(text: &str) -> String {
    format!("'{}'", text.replace('\'', "''"))
}

/// A file beside the target, with the permissions of any other new file.
fn partial_file(target: &Path) -> io::Result<NamedTempFile> {
    let mut prefix = target.file_name().unwrap_or_default().to_owned();
    prefix.push(".");
    let mut builder = tempfile::Builder::new();
    builder.prefix(&prefix).suffix(".partial");
    #[cfg(unix)]
    {
        use std::os::unix::fs::PermissionsExt as _;
        // The umask is taken off as the file is made; temporary files are otherwise their owner's alone.
        builder.permissions(std::fs::Permissions::from_mode(0o666));
    }
    builder.tempfile_in(directory_of(target))
}

fn directory_of(path: &Path) -> &Path {
    path.parent().filter(|parent| !parent.as_os_str().is_empty()).unwrap_or(Path::new("."))
}

fn io_error(path: &Path) -> impl FnOnce(io::Error) -> TripWriteError + '_ {
    move |source| TripWriteError::Io { path: path.to_owned(), source }
}

fn mcap_error(path: &Path) -> impl FnOnce(McapError) -> TripWriteError + '_ {
    move |error| {
        let source = match error {
            McapError::Io(source) => source,
            other => io::Error::other(other),
        };
        TripWriteError::Io { path: path.to_owned(), source }
    }
}
