//! What is whole of an MCAP file.
//!
//! A record is whole if it is where the one before it ends and another follows it, or if it is a chunk that agrees with
//! its checksum. Where one is not, the file is searched, byte by byte, for the next that is; of a chunk whose end is
//! missing, the messages before that are kept. Of a chunk that is all there but disagrees with its checksum nothing is
//! kept: nobody can tell which of its messages is the wrong one.
//!
//! Memory holds one record, compressed and not.

use std::fs::File;
use std::io;
use std::os::unix::fs::FileExt;
use std::path::Path;

use mcap::records::{Metadata, op};
use mcap::{Attachment, MAGIC};

use crate::TripError;
use crate::bag_file::{ROS2, ROSBAG2};
use crate::chunk::{self, ChunkFault};
use crate::record::{ChunkBody, Fields, RECORD_HEAD_BYTES, Record, first_record};
use crate::recording::{MAX_RECORD_BYTES, NO_RECORD, io_error};
use crate::salvage::{
    BEYOND_FILE, Loss, SEARCHED_BYTES, SHORT_RECORD, SalvageError, Salvor, parse_map, search, text,
};
use crate::summary;

/// Bytes of a chunk's record that show it for one: its head, its sizes, and the name of its compression.
const CHUNK_HEAD_BYTES: usize = RECORD_HEAD_BYTES + 8 + 8 + 8 + 4 + 4 + 4 + 8;

/// The recording that is saved from.
pub(super) struct McapWreck<'a> {
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

impl<'a> McapWreck<'a> {
    pub(super) fn open(path: &'a Path, mut file: File, n_bytes: u64) -> Result<Self, TripError> {
        let summary = summary::records(&mut file, n_bytes).map_err(io_error(path))?.unwrap_or_default();
        let (body, records) = (Vec::new(), Vec::new());
        Ok(Self { path, file, n_bytes, summary, is_chunked: false, body, records })
    }

    /// Whose messages these are, by the header; those of ROS 2 if that is lost.
    pub(super) fn profile(&mut self) -> Result<String, TripError> {
        let at_byte = MAGIC.len() as u64;
        let is_header = |head: &Head| head.opcode == op::HEADER;
        let Some(head) = self.head(at_byte)?.filter(is_header) else { return Ok(ROS2.to_owned()) };
        let is_whole = self.load(at_byte, head)?;
        let profile = Fields(&self.body).prefixed().filter(|_| is_whole);
        Ok(profile.map_or_else(|| ROS2.to_owned(), text))
    }

    /// Goes through the file once, and gives what is whole to the salvor.
    pub(super) fn walk(&mut self, salvor: &mut Salvor) -> Result<(), SalvageError> {
        for_each_record(&self.summary, |record| salvor.learn(record));
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
                    BEYOND_FILE.to_owned()
                }
                None => BEYOND_FILE.to_owned(),
                Some(_) => NO_RECORD.to_owned(),
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

    /// Where the next record begins that shows itself as one.
    fn search(&self, from: u64) -> Result<u64, TripError> {
        search((self.path, &self.file, self.n_bytes), from, RECORD_HEAD_BYTES, |found, candidate| {
            match parse_head(candidate) {
                Some(head) if head.is_plausible() && head.n_bytes() <= self.n_bytes - found => {
                    self.shows_itself(found, head)
                }
                _ => Ok(false),
            }
        })
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

impl Salvor {
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
                Some(record) => self.take(&record)?,
                None => return broken(),
            },
        }
        Ok(Saved::Whole)
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
