//! What is whole of a ROS 1 bag.
//!
//! Nothing in it has a checksum. A record is whole if its header has the fields that it should, and another record follows it,
//! or the end of the file. Records in a chunk that is not compressed are taken one by one, as if they stood outside of it: the
//! chunk's own lengths, which a recorder fills in when it is done, need not be right. Of a compressed chunk whose end is missing
//! the messages before that are kept. Where there is no record, the file is searched, byte by byte, for the next.
//!
//! Memory holds one record, compressed and not.

use std::collections::BTreeMap;
use std::fs::File;
use std::os::unix::fs::FileExt;
use std::path::Path;

use crate::TripError;
use crate::bag_file::Channel;
use crate::chunk::{self, ChunkFault};
use crate::record::{Fields, Record};
use crate::recording::{MAX_RECORD_BYTES, NO_RECORD, io_error};
use crate::ros1_bag::{MAGIC, MAX_INDEX_BYTES};
use crate::ros1_record::{
    BagHeader, MAX_HEADER_BYTES, field, first_record, op, parse, parse_index, u32_field,
};
use crate::salvage::{BEYOND_FILE, Loss, SHORT_RECORD, SalvageError, Salvor, search, text};

/// What is wrong where something else follows a record.
const NOT_FOLLOWED: &str = "a record there does not end where it says";

/// Bytes by which a record is told from others: the lengths of its header and of the first field in it, and what that begins with.
const CANDIDATE_BYTES: usize = 4 + 4 + 1;

/// The recording that is saved from.
pub(super) struct Ros1Wreck<'a> {
    path: &'a Path,
    file: File,
    n_bytes: u64,
    /// The connections and chunks that a whole index names: the bag was closed.
    index: Option<Vec<u8>>,
    /// Where the records end: at the index, if that is whole.
    end: u64,
}

/// What stands at a byte.
enum Stands {
    Record(Head),
    /// The file ends before a header does.
    Cut,
    /// No record.
    Nothing,
}

/// What stands before a record's data.
struct Head {
    op: u8,
    header: Vec<u8>,
    data_at_byte: u64,
    data_bytes: u64,
}

impl Head {
    /// Where the next record begins.
    fn end(&self) -> u64 {
        self.data_at_byte + self.data_bytes
    }

    fn is_compressed_chunk(&self) -> bool {
        self.op == op::CHUNK && field(&self.header, b"compression") != Some(b"none")
    }
}

/// What became of a record.
enum Saved {
    /// The next one begins there.
    Whole(u64),
    /// It is a chunk as it was written, and in it something is not whole: what. What is before that was saved.
    Partly(&'static str),
    /// Why it is not whole. Nothing of it was saved.
    Not(String),
}

impl<'a> Ros1Wreck<'a> {
    pub(super) fn open(path: &'a Path, file: File, n_bytes: u64) -> Result<Self, TripError> {
        let mut wreck = Self { path, file, n_bytes, index: None, end: n_bytes };
        if let Stands::Record(Head { op: op::BAG_HEADER, header, .. }) = wreck.stands(MAGIC.len() as u64)?
            && let Some(BagHeader { index_pos, n_connections, n_chunks }) = BagHeader::parse(&header)
            && (MAGIC.len() as u64..n_bytes).contains(&index_pos)
            && n_bytes - index_pos <= MAX_INDEX_BYTES
        {
            let index = wreck.read(n_bytes - index_pos, index_pos)?;
            if parse_index(&index, n_connections, n_chunks).is_some() {
                (wreck.index, wreck.end) = (Some(index), index_pos);
            }
        }
        Ok(wreck)
    }

    /// Goes through the file once, and gives what is whole to the salvor.
    pub(super) fn walk(&self, salvor: &mut Salvor) -> Result<(), SalvageError> {
        if let Some(index) = &self.index {
            salvor.salvage.n_messages_recorded = Some(learn_index(salvor, index));
        }
        let mut at_byte = MAGIC.len() as u64;
        while at_byte < self.end {
            let n_saved_before = salvor.salvage.n_messages;
            let stands = self.stands(at_byte)?;
            let what = match &stands {
                Stands::Record(head) => match self.save(head, salvor)? {
                    Saved::Whole(next) => {
                        at_byte = next;
                        continue;
                    }
                    Saved::Partly(what) => {
                        self.lose(salvor, (at_byte, head.end()), n_saved_before, what.to_owned());
                        at_byte = head.end();
                        continue;
                    }
                    Saved::Not(what) => what,
                },
                Stands::Cut => BEYOND_FILE.to_owned(),
                Stands::Nothing => NO_RECORD.to_owned(),
            };
            let next = self.search(at_byte + 1)?;
            if let Stands::Record(head) = &stands
                && head.is_compressed_chunk()
            {
                self.save_beginning(head, next, salvor)?;
            }
            self.lose(salvor, (at_byte, next), n_saved_before, what);
            at_byte = next;
        }
        salvor.salvage.was_closed = self.index.is_some();
        Ok(())
    }

    fn lose(&self, salvor: &mut Salvor, (at_byte, end): (u64, u64), n_saved_before: u64, what: String) {
        let n_messages_saved = salvor.salvage.n_messages - n_saved_before;
        salvor.lose(Loss { at_byte, n_bytes: end - at_byte, n_messages_saved, what });
    }

    /// Saves a record if it is whole.
    fn save(&self, head: &Head, salvor: &mut Salvor) -> Result<Saved, SalvageError> {
        if head.op == op::CHUNK && !head.is_compressed_chunk() {
            return Ok(Saved::Whole(head.data_at_byte));
        }
        if head.end() > self.n_bytes {
            return Ok(Saved::Not(BEYOND_FILE.to_owned()));
        }
        if !self.is_followed(head.end())? {
            return Ok(Saved::Not(NOT_FOLLOWED.to_owned()));
        }
        if head.data_bytes > MAX_RECORD_BYTES {
            return Ok(Saved::Not(format!("a record there claims {} bytes", head.data_bytes)));
        }
        match head.op {
            op::CHUNK => {
                let (Some(compression), Some(size)) =
                    (field(&head.header, b"compression"), u32_field(&head.header, b"size"))
                else {
                    return Ok(Saved::Not(NO_RECORD.to_owned()));
                };
                let (data, mut records) = (self.read(head.data_bytes, head.data_at_byte)?, Vec::new());
                match chunk::open_ros1(compression, size.into(), &data, &mut records) {
                    Ok(()) => match add_all(salvor, &records)? {
                        true => {}
                        false => return Ok(Saved::Partly(SHORT_RECORD)),
                    },
                    Err(ChunkFault::Damaged { what }) => return Ok(Saved::Not(what)),
                    Err(ChunkFault::TooLarge { n_bytes }) => {
                        return Ok(Saved::Not(format!("a chunk claims to hold {n_bytes} bytes")));
                    }
                    Err(ChunkFault::UnsupportedCompression { name }) => {
                        let what = format!("a chunk is compressed with '{name}'; bz2, lz4 and none are read");
                        return Ok(Saved::Not(what));
                    }
                }
            }
            op::CONNECTION | op::MESSAGE => {
                let data = self.read(head.data_bytes, head.data_at_byte)?;
                if !add(salvor, &head.header, &data)? {
                    return Ok(Saved::Not(SHORT_RECORD.to_owned()));
                }
            }
            _ => {}
        }
        Ok(Saved::Whole(head.end()))
    }

    /// Saves the messages at the beginning of a compressed chunk that is not whole and ends before `end`.
    fn save_beginning(&self, head: &Head, end: u64, salvor: &mut Salvor) -> Result<(), SalvageError> {
        let (Some(compression), Some(size)) =
            (field(&head.header, b"compression"), u32_field(&head.header, b"size"))
        else {
            return Ok(());
        };
        // A recorder that was killed had filled in neither length.
        let (size, data_bytes) = match (size, head.data_bytes) {
            (0, 0) => (u64::MAX, u64::MAX),
            (size, data_bytes) => (size.into(), data_bytes),
        };
        let n_there = end.saturating_sub(head.data_at_byte).min(data_bytes).min(MAX_RECORD_BYTES);
        let (data, mut records) = (self.read(n_there, head.data_at_byte.min(end))?, Vec::new());
        chunk::open_ros1_beginning(compression, size, data_bytes, &data, &mut records);
        add_all(salvor, &records)?;
        Ok(())
    }

    /// Whether what stands where a record ends is another, or an end: of the file, or of what a file system wrote of it.
    fn is_followed(&self, at_byte: u64) -> Result<bool, TripError> {
        if !matches!(self.stands(at_byte)?, Stands::Nothing) {
            return Ok(true);
        }
        let mut bytes = [0; 8];
        Ok(self.read_some(&mut bytes, at_byte)? == bytes.len() && bytes == [0; 8])
    }

    fn stands(&self, at_byte: u64) -> Result<Stands, TripError> {
        let Some(header_bytes) = self.length(at_byte)? else { return Ok(Stands::Cut) };
        // A header has at least the field `op=`, and a byte in it.
        if !(8..=MAX_HEADER_BYTES).contains(&header_bytes) {
            return Ok(Stands::Nothing);
        }
        let header_at_byte = at_byte + 4;
        let data_at_byte = header_at_byte + u64::from(header_bytes) + 4;
        let n_there = u64::from(header_bytes).min(self.n_bytes - header_at_byte);
        let header = self.read(n_there, header_at_byte)?;
        if n_there < u64::from(header_bytes) {
            return Ok(if may_begin_header(&header) { Stands::Cut } else { Stands::Nothing });
        }
        let Some(op) = op_of(&header) else { return Ok(Stands::Nothing) };
        Ok(match self.length(data_at_byte - 4)? {
            Some(data_bytes) => {
                Stands::Record(Head { op, header, data_at_byte, data_bytes: data_bytes.into() })
            }
            None => Stands::Cut,
        })
    }

    /// The length that stands at a byte; none where the file ends before.
    fn length(&self, at_byte: u64) -> Result<Option<u32>, TripError> {
        let mut bytes = [0; 4];
        Ok((self.read_some(&mut bytes, at_byte)? == 4).then(|| u32::from_le_bytes(bytes)))
    }

    /// Reads as many bytes as the file has.
    fn read_some(&self, bytes: &mut [u8], at_byte: u64) -> Result<usize, TripError> {
        let n_there = self.n_bytes.saturating_sub(at_byte).min(bytes.len() as u64) as usize;
        self.file.read_exact_at(&mut bytes[..n_there], at_byte).map_err(io_error(self.path))?;
        Ok(n_there)
    }

    /// Reads so many bytes, which the file has.
    fn read(&self, n_bytes: u64, at_byte: u64) -> Result<Vec<u8>, TripError> {
        let mut bytes = vec![0; n_bytes as usize];
        self.file.read_exact_at(&mut bytes, at_byte).map_err(io_error(self.path))?;
        Ok(bytes)
    }

    /// Where the next record begins: its header is one, and what it holds is followed by another.
    fn search(&self, from: u64) -> Result<u64, TripError> {
        let found = search((self.path, &self.file, self.n_bytes), from, CANDIDATE_BYTES, |found, bytes| {
            let mut fields = Fields(bytes);
            let (Some(header_bytes), Some(field_bytes)) = (fields.u32(), fields.u32()) else {
                return Ok(false);
            };
            let may_be = header_bytes <= MAX_HEADER_BYTES
                && u64::from(field_bytes) + 4 <= header_bytes.into()
                && fields.0[0].is_ascii_lowercase();
            if !may_be {
                return Ok(false);
            }
            let Stands::Record(head) = self.stands(found)? else { return Ok(false) };
            let next = if head.op == op::CHUNK && !head.is_compressed_chunk() {
                head.data_at_byte
            } else {
                head.end()
            };
            Ok(next <= self.n_bytes && self.is_followed(next)?)
        })?;
        // What stands behind the end is the index.
        Ok(found.min(self.end))
    }
}

/// What sort of record a header is of, if it is one: fields to its last byte, and one of the sorts that there are.
fn op_of(header: &[u8]) -> Option<u8> {
    let mut fields = Fields(header);
    while !fields.0.is_empty() {
        fields.prefixed()?.contains(&b'=').then_some(())?;
    }
    match *field(header, b"op")? {
        [op @ op::MESSAGE..=op::CONNECTION] => Some(op),
        _ => None,
    }
}

/// Whether a header that is not all there begins as one.
fn may_begin_header(beginning: &[u8]) -> bool {
    let mut fields = Fields(beginning);
    while !fields.0.is_empty() {
        let Some(n_bytes) = fields.u32() else { return true };
        let Some(field) = fields.take(n_bytes as usize) else {
            return n_bytes <= MAX_HEADER_BYTES && fields.0.first().is_none_or(u8::is_ascii_lowercase);
        };
        if !field.contains(&b'=') {
            return false;
        }
    }
    true
}

/// Takes note of the connections that an index repeats, whose own records may be lost; returns how many messages it counts.
fn learn_index(salvor: &mut Salvor, mut index: &[u8]) -> u64 {
    let mut n_messages = 0;
    while let Some((header, data, n_bytes)) = first_record(index) {
        match op_of(header) {
            Some(op::CONNECTION) => learn_connection(salvor, header, data),
            Some(op::CHUNK_INFO) => {
                let mut counts = Fields(data);
                while let (Some(_), Some(n)) = (counts.u32(), counts.u32()) {
                    n_messages += u64::from(n);
                }
            }
            _ => {}
        }
        index = &index[n_bytes..];
    }
    n_messages
}

/// Adds the records of a chunk; false if one is not whole, up to that.
fn add_all(salvor: &mut Salvor, mut records: &[u8]) -> Result<bool, SalvageError> {
    while !records.is_empty() {
        let Some((header, data, n_bytes)) = first_record(records) else { return Ok(false) };
        if op_of(header).is_none() || !add(salvor, header, data)? {
            return Ok(false);
        }
        records = &records[n_bytes..];
    }
    Ok(true)
}

/// Adds a message or a connection; false if something in it is missing.
fn add(salvor: &mut Salvor, header: &[u8], data: &[u8]) -> Result<bool, SalvageError> {
    match parse(header, data) {
        None => return Ok(false),
        Some([_, Some(record @ Record::Message { .. })]) => salvor.take(&record)?,
        Some(_) => learn_connection(salvor, header, data),
    }
    Ok(true)
}

fn learn_connection(salvor: &mut Salvor, header: &[u8], data: &[u8]) {
    let Some([Some(schema), Some(Record::Channel { id, schema_id, topic, message_encoding, .. })]) =
        parse(header, data)
    else {
        return;
    };
    salvor.learn(&schema);
    // What else it says, by the names that MCAP has for it.
    let mut metadata = BTreeMap::new();
    for name in ["callerid", "latching", "md5sum"] {
        if let Some(value) = field(data, name.as_bytes()) {
            metadata.insert(name.to_owned(), text(value));
        }
    }
    let channel = Channel { topic: text(topic), message_encoding: text(message_encoding), metadata };
    salvor.declare(id, schema_id, channel);
}
