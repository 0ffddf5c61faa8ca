//! Saves what is whole of a damaged recording: what that is, each sort of file has its own way to tell.

mod mcap_wreck;
mod ros1_wreck;

use std::collections::BTreeMap;
use std::fmt;
use std::fs::File;
use std::os::unix::fs::FileExt;
use std::path::{Path, PathBuf};

use mcap::records::MessageHeader;

use crate::bag_file::{BagFile, Channel, Schema, WriterOptions};
use crate::record::{Fields, Record};
use crate::recording::{Format, io_error, open_damaged};
use crate::salvage::mcap_wreck::McapWreck;
use crate::salvage::ros1_wreck::Ros1Wreck;
use crate::{TripError, TripWriteError};

/// The profile of ROS 1.
const ROS1: &str = "ros1";

/// Losses that are remembered one by one.
const MAX_LOSSES: usize = 100;

/// What is wrong where a record's fields need more than its length.
const SHORT_RECORD: &str = "a record there is shorter than what it says it holds";

/// What is wrong where the file ends before a record does.
const BEYOND_FILE: &str = "the record there ends beyond the file";

/// Bytes of the file that are searched first for the next whole record, and then at once: it is near, or far away.
const SEARCHED_FIRST_BYTES: u64 = 16 << 10;
const SEARCHED_BYTES: u64 = 1 << 20;

/// What was saved of a recording, and what was not.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct Salvage {
    /// Messages saved.
    pub n_messages: u64,
    /// Topics that these are on.
    pub n_topics: usize,
    /// Messages that the recording says it had; `None`: it does not say.
    pub n_messages_recorded: Option<u64>,
    /// Messages that were whole, but whose topic or type was lost. They are not saved.
    pub n_messages_unknown: u64,
    /// What was lost, in the order of the file: the first hundred.
    pub losses: Vec<Loss>,
    /// How many losses there were.
    pub n_losses: u64,
    /// Bytes of the file that were lost.
    pub n_bytes_lost: u64,
    /// Whether its data came to their end.
    pub was_closed: bool,
    /// Whether its messages, which are in no chunks with checksums of their own, disagree with the checksum of all of them.
    pub may_be_wrong: bool,
}

/// A stretch of a recording that was not whole.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Loss {
    /// Where it begins.
    pub at_byte: u64,
    /// How long it is.
    pub n_bytes: u64,
    /// Messages at its beginning that were saved all the same.
    pub n_messages_saved: u64,
    /// What is wrong there.
    pub what: String,
}

/// `bytes 4096 to 5120: …`
impl fmt::Display for Loss {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Loss { at_byte, n_bytes, n_messages_saved, what } = self;
        write!(f, "bytes {at_byte} to {}: {what}", at_byte + n_bytes)?;
        match n_messages_saved {
            0 => Ok(()),
            1 => f.write_str("; 1 message before that was saved"),
            n => write!(f, "; {n} messages before that were saved"),
        }
    }
}

/// Why nothing could be saved.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum SalvageError {
    /// The recording cannot be read at all.
    #[error(transparent)]
    Read(#[from] TripError),
    /// What was saved cannot be written.
    #[error(transparent)]
    Write(#[from] TripWriteError),
    /// There is no whole message.
    #[error("{} has no whole message to save in its {n_bytes} bytes", path.display())]
    Nothing {
        /// The recording.
        path: PathBuf,
        /// Bytes in the file.
        n_bytes: u64,
    },
}

/// Writes all that is whole of the recording at `from` into a new one at `to`, which is whole or not there.
///
/// The new one is an MCAP file, of a ROS 1 bag too, with ROS 1's messages as they were. Keeps messages of every type, attachments
/// and metadata, bit for bit; `from` is only read.
///
/// # Errors
///
/// No such file, or one of another format; no whole message in it; the other file cannot be written.
pub fn salvage(from: &Path, to: &Path) -> Result<Salvage, SalvageError> {
    let (file, n_bytes, format) = open_damaged(from)?;
    let begin = |profile: &str| BagFile::create(to, profile, &WriterOptions::default()).map(Salvor::new);
    let salvor = match format {
        Format::Mcap => {
            let mut wreck = McapWreck::open(from, file, n_bytes)?;
            let mut salvor = begin(&wreck.profile()?)?;
            wreck.walk(&mut salvor)?;
            salvor
        }
        Format::Ros1Bag => {
            let mut salvor = begin(ROS1)?;
            Ros1Wreck::open(from, file, n_bytes)?.walk(&mut salvor)?;
            salvor
        }
    };
    if salvor.salvage.n_messages == 0 {
        return Err(SalvageError::Nothing { path: from.to_owned(), n_bytes });
    }
    salvor.finish()
}

/// Where the next record begins that shows itself as one, from a byte on; the end of the file if none does.
///
/// * `head_bytes` — bytes of a record by which it is told, and then asked for
fn search(
    (path, file, n_bytes): (&Path, &File, u64),
    from: u64,
    head_bytes: usize,
    mut shows_itself: impl FnMut(u64, &[u8]) -> Result<bool, TripError>,
) -> Result<u64, TripError> {
    let (mut at_byte, mut at_most) = (from, SEARCHED_FIRST_BYTES);
    let mut bytes = Vec::new();
    while at_byte + (head_bytes as u64) < n_bytes {
        bytes.resize(at_most.min(n_bytes - at_byte) as usize, 0);
        at_most = SEARCHED_BYTES;
        file.read_exact_at(&mut bytes, at_byte).map_err(io_error(path))?;
        for (candidate, found) in bytes.windows(head_bytes).zip(at_byte..) {
            if shows_itself(found, candidate)? {
                return Ok(found);
            }
        }
        // What begins in the last bytes is looked at again, with those that follow.
        at_byte += bytes.len() as u64 - (head_bytes as u64 - 1);
    }
    Ok(n_bytes)
}

/// Writes what is saved.
struct Salvor {
    bag: BagFile,
    schemas: BTreeMap<u32, Schema>,
    channels: BTreeMap<u32, Declared>,
    salvage: Salvage,
}

/// A channel of the recording.
struct Declared {
    schema_id: u32,
    channel: Channel,
    /// Its number in the new one, once it has a message there.
    new_id: Option<u16>,
}

impl Salvor {
    fn new(bag: BagFile) -> Self {
        Self { bag, schemas: BTreeMap::new(), channels: BTreeMap::new(), salvage: Salvage::default() }
    }

    /// Takes note of what the summary repeats: schemas and channels whose own records may be lost.
    fn learn(&mut self, record: &Record<'_>) {
        match *record {
            Record::Schema { id, name, encoding, definition } => {
                let schema =
                    Schema { name: text(name), encoding: text(encoding), definition: definition.to_owned() };
                self.schemas.insert(id, schema);
            }
            Record::Channel { id, schema_id, topic, message_encoding, metadata } => {
                let metadata = parse_map(metadata).unwrap_or_default();
                let channel =
                    Channel { topic: text(topic), message_encoding: text(message_encoding), metadata };
                self.declare(id, schema_id, channel);
            }
            Record::Statistics { n_messages_total, .. } => {
                self.salvage.n_messages_recorded = Some(n_messages_total);
            }
            Record::Message { .. } | Record::Other => {}
        }
    }

    fn declare(&mut self, id: u32, schema_id: u32, channel: Channel) {
        let is_known = self.channels.get(&id).is_some_and(|known| known.channel == channel);
        if !is_known {
            self.channels.insert(id, Declared { schema_id, channel, new_id: None });
        }
    }

    /// Writes a message, or learns what else a record says.
    fn take(&mut self, record: &Record<'_>) -> Result<(), TripWriteError> {
        let Record::Message { channel_id, sequence, log_time, publish_time, data } = *record else {
            self.learn(record);
            return Ok(());
        };
        match self.new_id(channel_id)? {
            Some(channel_id) => {
                let header = MessageHeader { channel_id, sequence, log_time, publish_time };
                self.bag.write(&header, data)?;
                self.salvage.n_messages += 1;
            }
            None => self.salvage.n_messages_unknown += 1,
        }
        Ok(())
    }

    /// The number of a channel in the new recording, if its topic and its type are known.
    fn new_id(&mut self, channel_id: u32) -> Result<Option<u16>, TripWriteError> {
        let Some(declared) = self.channels.get_mut(&channel_id) else { return Ok(None) };
        if declared.new_id.is_none() {
            let Some(schema) = self.schemas.get(&declared.schema_id) else { return Ok(None) };
            declared.new_id = Some(self.bag.add_channel(schema, &declared.channel)?);
        }
        Ok(declared.new_id)
    }

    fn lose(&mut self, loss: Loss) {
        self.salvage.n_losses += 1;
        self.salvage.n_bytes_lost += loss.n_bytes;
        if self.salvage.losses.len() < MAX_LOSSES {
            self.salvage.losses.push(loss);
        }
    }

    fn finish(mut self) -> Result<Salvage, SalvageError> {
        self.salvage.n_topics = self.bag.n_topics();
        self.bag.finish()?;
        Ok(self.salvage)
    }
}

/// Names and values, one after the other.
fn parse_map(bytes: &[u8]) -> Option<BTreeMap<String, String>> {
    let mut fields = Fields(bytes);
    let mut map = BTreeMap::new();
    while !fields.0.is_empty() {
        map.insert(text(fields.prefixed()?), text(fields.prefixed()?));
    }
    Some(map)
}

fn text(bytes: &[u8]) -> String {
    String::from_utf8_lossy(bytes).into_owned()
}
