//! Saves what is whole of a damaged recording.
//!
//! A record is whole if it is where the one before it ends and another follows it, or if it is a chunk that agrees with
//! its checksum. Where one is not, the file is searched, byte by byte, for the next that is; of a chunk whose end is
//! missing, the messages before that are kept. Of a chunk that is all there but disagrees with its checksum nothing is
//! kept: nobody can tell which of its messages is the wrong one.
//!
//! Memory holds one record, compressed and not.

use std::collections::BTreeMap;
use std::fmt;
use std::fs::File;
use std::io;
use std::os::unix::fs::FileExt;
use std::path::{Path, PathBuf};

use mcap::records::{MessageHeader, Metadata, op};
use mcap::{Attachment, MAGIC};

use crate::bag_file::{BagFile, Channel, ROS2, ROSBAG2, Schema, WriterOptions};
use crate::chunk::{self, ChunkFault};
use crate::record::{ChunkBody, Fields, RECORD_HEAD_BYTES, Record, first_record};
use crate::recording::{MAX_RECORD_BYTES, io_error, open_damaged};
use crate::{TripError, TripWriteError, summary};

/// Losses that are remembered one by one.
const MAX_LOSSES: usize = 100;

/// What is wrong where a record's fields need more than its length.
const SHORT_RECORD: &str = "a record there is shorter than what it says it holds";

/// Bytes of the file that are searched first for the next whole record, and then at once: it is near, or far away.
const SEARCHED_FIRST_BYTES: u64 = 16 << 10;
const SEARCHED_BYTES: u64 = 1 << 20;

/// Bytes of a chunk's record that show it for one: its head, its sizes, and the name of its compression.
const CHUNK_HEAD_BYTES: usize = RECORD_HEAD_BYTES + 8 + 8 + 8 + 4 + 4 + 4 + 8;

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
/// Keeps messages of every type, attachments and metadata, bit for bit; `from` is only read.
///
/// # Errors
///
/// No such file, or one of another format; no whole message in it; the other file cannot be written.
pub fn salvage(from: &Path, to: &Path) -> Result<Salvage, SalvageError> {
    let mut wreck = Wreck::open(from)?;
    let profile = wreck.profile()?;
    let mut salvor = Salvor::new(BagFile::create(to, &profile, &WriterOptions::default())?);
    for_each_record(&wreck.summary, |record| salvor.learn(record));
    wreck.walk(&mut salvor)?;
    if salvor.salvage.n_messages == 0 {
        return Err(SalvageError::Nothing { path: from.to_owned(), n_bytes: wreck.n_bytes });
    }
    salvor.finish()
}

/// The recording that is saved from.
struct Wreck<'a> {
    path: &'a Path,
    file: File,
    n_bytes: u64,
    /// The records of its summary, where there is one.
    summary: Vec<u8>,
    /// Whether messages stand in chunks, as far as is known.
    is_chunked: bool,
    body: Vec<u8>,
    records: Vec<u8>,
}

/// What stands before a record's body.
#[derive(Debug, Clone, Copy)]
struct Head {
    opcode: u8,
    body_bytes: u64,
}

impl Head {
    fn n_bytes(self) -> u64 {
        self.body_bytes.saturating_add(RECORD_HEAD_BYTES as u64)
    }

    /// Whether there are records like this.
    fn is_plausible(self) -> bool {
        (op::HEADER..=op::DATA_END).contains(&self.opcode) && self.body_bytes <= MAX_RECORD_BYTES
    }
}

impl<'a> Wreck<'a> {
    fn open(path: &'a Path) -> Result<Self, TripError> {
        let (mut file, n_bytes) = open_damaged(path)?;
        let summary = summary::records(&mut file, n_bytes).map_err(io_error(path))?.unwrap_or_default();
        let (body, records) = (Vec::new(), Vec::new());
        Ok(Self { path, file, n_bytes, summary, is_chunked: false, body, records })
    }

    /// Whose messages these are, by the header; those of ROS 2 if that is lost.
    fn profile(&mut self) -> Result<String, TripError> {
        let at_byte = MAGIC.len() as u64;
        let is_header = |head: &Head| head.opcode == op::HEADER;
        let Some(head) = self.head(at_byte)?.filter(is_header) else { return Ok(ROS2.to_owned()) };
        let is_whole = self.load(at_byte, head)?;
        let profile = Fields(&self.body).prefixed().filter(|_| is_whole);
        Ok(profile.map_or_else(|| ROS2.to_owned(), text))
    }

    /// Goes through the file once, and gives what is whole to the salvor.
    fn walk(&mut self, salvor: &mut Salvor) -> Result<(), SalvageError> {
        let mut at_byte = MAGIC.len() as u64;
        while at_byte < self.n_bytes {
            let head = self.head(at_byte)?;
            let n_saved_before = salvor.salvage.n_messages;
            let what = match head {
                Some(head) if head.is_plausible() && self.load(at_byte, head)? => {
                    self.is_chunked |= head.opcode == op::CHUNK;
                    match self.save(at_byte, head, salvor)? {
                        Saved::Last => {
                            salvor.salvage.was_closed = true;
                            let is_checkable = head.opcode == op::DATA_END
                                && !self.is_chunked
                                && salvor.salvage.n_losses == 0;
                            salvor.salvage.may_be_wrong = is_checkable && self.disagrees(at_byte)?;
                            return Ok(());
                        }
                        Saved::Whole => {
                            at_byte += head.n_bytes();
                            continue;
                        }
                        Saved::Partly(what) => {
                            let n_messages_saved = salvor.salvage.n_messages - n_saved_before;
                            let n_bytes = head.n_bytes();
                            salvor.lose(Loss { at_byte, n_bytes, n_messages_saved, what });
                            at_byte += n_bytes;
                            continue;
                        }
                        Saved::Not(what) => what,
                    }
                }
                Some(head) if head.is_plausible() => {
                    self.is_chunked |= head.opcode == op::CHUNK;
                    "the record there ends beyond the file".to_owned()
                }
                None => "the record there ends beyond the file".to_owned(),
                Some(_) => "what stands there is no record".to_owned(),
            };
            let next = self.search(at_byte + 1)?;
            if head.is_some_and(|head| head.opcode == op::CHUNK) {
                self.save_beginning(at_byte, next, salvor)?;
            }
            let n_messages_saved = salvor.salvage.n_messages - n_saved_before;
            salvor.lose(Loss { at_byte, n_bytes: next - at_byte, n_messages_saved, what });
            at_byte = next;
        }
        Ok(())
    }

    /// Saves a record whose bytes are all there, if it is whole.
    fn save(&mut self, at_byte: u64, head: Head, salvor: &mut Salvor) -> Result<Saved, SalvageError> {
        if head.opcode == op::CHUNK {
            return match chunk::open(&self.body, &mut self.records) {
                Ok(()) => salvor.add_all(&self.records),
                Err(ChunkFault::Damaged { what }) => Ok(Saved::Not(what)),
                Err(ChunkFault::TooLarge { n_bytes }) => {
                    Ok(Saved::Not(format!("a chunk claims to hold {n_bytes} bytes")))
                }
                Err(ChunkFault::UnsupportedCompression { name }) => Ok(Saved::Not(format!(
                    "a chunk is compressed with '{name}'; zstd, lz4 and none are read"
                ))),
            };
        }
        let is_index = head.opcode == op::MESSAGE_INDEX && index_agrees(&self.body, head);
        if !is_index && !self.is_followed(at_byte + head.n_bytes())? {
            return Ok(Saved::Not("a record there does not end where it says".to_owned()));
        }
        if head.opcode == op::DATA_END || head.opcode == op::FOOTER {
            return Ok(Saved::Last);
        }
        salvor.add(head.opcode, &self.body)
    }

    /// Whether all data up to the record that ends them, which is loaded, disagree with the checksum there.
    fn disagrees(&mut self, end: u64) -> Result<bool, TripError> {
        let Some(expected) = Fields(&self.body).u32().filter(|crc| *crc != 0) else { return Ok(false) };
        let mut hasher = crc32fast::Hasher::new();
        let mut at_byte = 0;
        while at_byte < end {
            let n_bytes = SEARCHED_BYTES.min(end - at_byte);
            self.read(n_bytes, at_byte)?;
            hasher.update(&self.body);
            at_byte += n_bytes;
        }
        Ok(hasher.finalize() != expected)
    }

    /// Saves the messages at the beginning of a chunk that is not whole and ends before `end`.
    fn save_beginning(&mut self, at_byte: u64, end: u64, salvor: &mut Salvor) -> Result<(), SalvageError> {
        let body_at_byte = (at_byte + RECORD_HEAD_BYTES as u64).min(end);
        self.read((end - body_at_byte).min(MAX_RECORD_BYTES), body_at_byte)?;
        chunk::open_beginning(&self.body, &mut self.records);
        salvor.add_all(&self.records)?;
        Ok(())
    }

    /// Whether what stands where a record ends is another, or an end: of the file, or of what a file system wrote of it.
    fn is_followed(&self, at_byte: u64) -> Result<bool, TripError> {
        let Some(next) = self.head(at_byte)? else { return Ok(true) };
        Ok(next.is_plausible() || (next.opcode == 0 && next.body_bytes == 0) || self.has_magic(at_byte)?)
    }

    fn has_magic(&self, at_byte: u64) -> Result<bool, TripError> {
        let mut bytes = [0; MAGIC.len()];
        let n_read = self.file.read_at(&mut bytes, at_byte).map_err(io_error(self.path))?;
        Ok(bytes[..n_read] == *MAGIC)
    }

    /// The head at a byte; none where the file ends before that does.
    fn head(&self, at_byte: u64) -> Result<Option<Head>, TripError> {
        let mut bytes = [0; RECORD_HEAD_BYTES];
        match self.file.read_exact_at(&mut bytes, at_byte) {
            Ok(()) => Ok(parse_head(&bytes)),
            Err(error) if error.kind() == io::ErrorKind::UnexpectedEof => Ok(None),
            Err(error) => Err(io_error(self.path)(error)),
        }
    }

    /// Reads a record's body; false where it ends beyond the file.
    fn load(&mut self, at_byte: u64, head: Head) -> Result<bool, TripError> {
        if head.n_bytes() > self.n_bytes - at_byte || head.body_bytes > MAX_RECORD_BYTES {
            return Ok(false);
        }
        self.read(head.body_bytes, at_byte + RECORD_HEAD_BYTES as u64)?;
        Ok(true)
    }

    /// Reads so many bytes, which the file has.
    fn read(&mut self, n_bytes: u64, at_byte: u64) -> Result<(), TripError> {
        self.body.resize(n_bytes as usize, 0);
        self.file.read_exact_at(&mut self.body, at_byte).map_err(io_error(self.path))
    }

    /// Where the next record begins that shows itself as one, from a byte on; the end of the file if none does.
    fn search(&mut self, from: u64) -> Result<u64, TripError> {
        let (mut at_byte, mut at_most) = (from, SEARCHED_FIRST_BYTES);
        while at_byte + (RECORD_HEAD_BYTES as u64) < self.n_bytes {
            let n_bytes = at_most.min(self.n_bytes - at_byte);
            at_most = SEARCHED_BYTES;
            self.read(n_bytes, at_byte)?;
            for (index, candidate) in self.body.windows(RECORD_HEAD_BYTES).enumerate() {
                let found = at_byte + index as u64;
                if let Some(head) = parse_head(candidate)
                    && head.is_plausible()
                    && head.n_bytes() <= self.n_bytes - found
                    && self.shows_itself(found, head)?
                {
                    return Ok(found);
                }
            }
            // What begins in the last bytes is looked at again, with those that follow.
            at_byte += n_bytes - (RECORD_HEAD_BYTES as u64 - 1);
        }
        Ok(self.n_bytes)
    }

    /// Whether a record that was come upon is one, and not by chance some bytes of another: its inner lengths agree with
    /// the outer one, or a plausible record follows it.
    fn shows_itself(&self, at_byte: u64, head: Head) -> Result<bool, TripError> {
        let mut bytes = [0; CHUNK_HEAD_BYTES];
        let n_read = self.file.read_at(&mut bytes, at_byte).map_err(io_error(self.path))?;
        let inner = bytes[..n_read].get(RECORD_HEAD_BYTES..).unwrap_or_default();
        let inner_agrees = match head.opcode {
            op::CHUNK => ChunkBody::parse_beginning(inner).is_some_and(|(chunk, compressed_bytes)| {
                let fixed = (8 + 8 + 8 + 4 + 4 + chunk.compression.len() + 8) as u64;
                compressed_bytes.checked_add(fixed) == Some(head.body_bytes)
            }),
            op::MESSAGE_INDEX => index_agrees(inner, head),
            op::DATA_END => head.body_bytes == 4,
            op::FOOTER => head.body_bytes == 8 + 8 + 4,
            // In a chunk these lie too, and there they are as damaged as the chunk is.
            op::SCHEMA | op::CHANNEL | op::MESSAGE => !self.is_chunked,
            _ => false,
        };
        let end = at_byte + head.n_bytes();
        Ok(inner_agrees && (head.opcode == op::CHUNK || self.is_followed(end)?))
    }
}

/// What became of a record.
enum Saved {
    Whole,
    /// It closes the data: what follows repeats what was there before.
    Last,
    /// It is a chunk as it was written, and in it something is not whole: what. What is before that was saved.
    Partly(String),
    /// Why it is not whole. Nothing of it was saved.
    Not(String),
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
                let is_known = self.channels.get(&id).is_some_and(|known| known.channel == channel);
                if !is_known {
                    self.channels.insert(id, Declared { schema_id, channel, new_id: None });
                }
            }
            Record::Statistics { n_messages_total, .. } => {
                self.salvage.n_messages_recorded = Some(n_messages_total);
            }
            Record::Message { .. } | Record::Other => {}
        }
    }

    /// Adds the records of a chunk, up to one that is not whole.
    fn add_all(&mut self, mut records: &[u8]) -> Result<Saved, SalvageError> {
        while !records.is_empty() {
            let Some((opcode, body, n_bytes)) = first_record(records) else {
                return Ok(Saved::Partly(SHORT_RECORD.to_owned()));
            };
            if let Saved::Not(what) = self.add(opcode, body)? {
                return Ok(Saved::Partly(what));
            }
            records = &records[n_bytes..];
        }
        Ok(Saved::Whole)
    }

    fn add(&mut self, opcode: u8, body: &[u8]) -> Result<Saved, SalvageError> {
        let broken = || Ok(Saved::Not(SHORT_RECORD.to_owned()));
        match opcode {
            op::ATTACHMENT => match parse_attachment(body) {
                Some(attachment) => self.bag.attach(&attachment)?,
                None => return Ok(Saved::Not("an attachment is not as it was written".to_owned())),
            },
            op::METADATA => match parse_metadata(body) {
                // That of the new recording is made anew.
                Some(metadata) if metadata.name == ROSBAG2 => {}
                Some(metadata) => self.bag.add_metadata(&metadata)?,
                None => return broken(),
            },
            _ => match Record::parse(opcode, body) {
                Some(Record::Message { channel_id, sequence, log_time, publish_time, data }) => {
                    match self.new_id(channel_id)? {
                        Some(channel_id) => {
                            let header = MessageHeader { channel_id, sequence, log_time, publish_time };
                            self.bag.write(&header, data)?;
                            self.salvage.n_messages += 1;
                        }
                        None => self.salvage.n_messages_unknown += 1,
                    }
                }
                Some(record) => self.learn(&record),
                None => return broken(),
            },
        }
        Ok(Saved::Whole)
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

fn for_each_record(mut records: &[u8], mut take: impl FnMut(&Record<'_>)) {
    while let Some((opcode, body, n_bytes)) = first_record(records) {
        if let Some(record) = Record::parse(opcode, body) {
            take(&record);
        }
        records = &records[n_bytes..];
    }
}

fn parse_head(bytes: &[u8]) -> Option<Head> {
    let mut fields = Fields(bytes);
    let &[opcode] = fields.take(1)? else { return None };
    Some(Head { opcode, body_bytes: fields.u64()? })
}

/// Whether the length in an index is that of its record: a channel's number, the length, and as many bytes.
fn index_agrees(body: &[u8], head: Head) -> bool {
    let mut fields = Fields(body);
    let _channel_id = fields.u16();
    fields.u32().is_some_and(|n_bytes| u64::from(n_bytes) + 2 + 4 == head.body_bytes)
}

fn parse_attachment(body: &[u8]) -> Option<Attachment<'_>> {
    let mut fields = Fields(body);
    let (log_time, create_time) = (fields.u64()?, fields.u64()?);
    let (name, media_type) = (text(fields.prefixed()?), text(fields.prefixed()?));
    let n_bytes = usize::try_from(fields.u64()?).ok()?;
    let data = fields.take(n_bytes)?.into();
    let crc = fields.u32()?;
    let is_as_written = crc == 0 || crc == crc32fast::hash(&body[..body.len() - 4]);
    is_as_written.then_some(Attachment { log_time, create_time, name, media_type, data })
}

fn parse_metadata(body: &[u8]) -> Option<Metadata> {
    let mut fields = Fields(body);
    Some(Metadata { name: text(fields.prefixed()?), metadata: parse_map(fields.prefixed()?)? })
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
