//! A ROS 1 bag's records (format 2.0), from the first to the last whole one, in the order of the file.
//!
//! A record is a header of named fields and data, each after its length. Messages stand in chunks, which have no
//! checksums; connections, which say what topic and type messages are of, stand before their first message, and once more
//! at the end of a bag that was closed, with what is in each chunk. Memory holds one chunk, compressed and not; lengths are
//! believed only as far as the file goes. Layout: <https://wiki.ros.org/Bags/Format/2.0>.

use std::fs::File;
use std::io::{self, BufReader, Read, Seek, SeekFrom};
use std::path::Path;

use crate::TripError;
use crate::catalogue::Catalogue;
use crate::chunk;
use crate::position::{Position, short_record};
use crate::record::Record;
use crate::recording::{End, MAX_RECORD_BYTES, NO_RECORD, TOO_LONG, io_error};
use crate::ros1_record::{
    BagHeader, MAX_HEADER_BYTES, field, first_record, op, parse, parse_index, u32_field,
};

/// How these files begin.
pub(crate) const MAGIC: &[u8] = b"#ROSBAG V2.0\n";

/// Bytes of the index at the end that are read into memory.
pub(crate) const MAX_INDEX_BYTES: u64 = 64 << 20;

/// A ROS 1 bag being read.
pub(crate) struct Ros1Bag {
    position: Position,
    file: BufReader<File>,
    /// Where the index begins, by the bag's own word; the end of the file if that cannot be.
    index_at_byte: u64,
    /// The channels and numbers of messages that a whole index names: the bag was closed.
    index: Option<Catalogue>,
    header: Vec<u8>,
    data: Vec<u8>,
    /// Whether of the next connection the type was told, and its topic was not.
    type_is_told: bool,
}

impl Ros1Bag {
    /// Takes a file and looks at its two ends.
    pub(crate) fn new(path: &Path, file: File, n_bytes: u64) -> Result<Ros1Bag, TripError> {
        let mut bag = Ros1Bag {
            position: Position::new(path, n_bytes),
            file: BufReader::with_capacity(256 << 10, file),
            index_at_byte: n_bytes,
            index: None,
            header: Vec::new(),
            data: Vec::new(),
            type_is_told: false,
        };
        bag.rewind()?;
        if bag.read_header()?.is_ok()
            && let Some(BagHeader { index_pos, n_connections, n_chunks }) = BagHeader::parse(&bag.header)
            && (MAGIC.len() as u64..n_bytes).contains(&index_pos)
        {
            bag.index_at_byte = index_pos;
            if n_bytes - index_pos <= MAX_INDEX_BYTES {
                let mut bytes = Vec::new();
                bag.file.seek(SeekFrom::Start(index_pos)).map_err(io_error(path))?;
                (&mut bag.file).take(MAX_INDEX_BYTES).read_to_end(&mut bytes).map_err(io_error(path))?;
                bag.index = parse_index(&bytes, n_connections, n_chunks);
            }
        }
        bag.rewind()?;
        Ok(bag)
    }

    pub(crate) fn rewind(&mut self) -> Result<(), TripError> {
        let at_byte = MAGIC.len() as u64;
        self.file.seek(SeekFrom::Start(at_byte)).map_err(io_error(&self.position.path))?;
        self.position.begin(at_byte);
        self.type_is_told = false;
        Ok(())
    }

    pub(crate) fn next_record(&mut self) -> Result<Option<Record<'_>>, TripError> {
        while self.position.is_at_end_of_records() {
            if self.position.end.is_some() || !self.load()? {
                return Ok(None);
            }
        }
        let Position { path, records, next_in_records, records_at_byte, .. } = &mut self.position;
        let damaged = || short_record(path, *records_at_byte);
        let (header, data, n_bytes) = first_record(&records[*next_in_records..]).ok_or_else(damaged)?;
        let [schema, record] = parse(header, data).ok_or_else(damaged)?;
        if let (Some(schema), false) = (schema, self.type_is_told) {
            self.type_is_told = true;
            return Ok(Some(schema));
        }
        self.type_is_told = false;
        *next_in_records += n_bytes;
        Ok(Some(record.unwrap_or(Record::Other)))
    }

    pub(crate) fn catalogue(&mut self) -> Result<Option<Catalogue>, TripError> {
        Ok(self.index.clone())
    }

    pub(crate) fn end(&self) -> Option<End> {
        self.position.end
    }

    pub(crate) fn is_closed(&self) -> bool {
        self.index.is_some()
    }

    pub(crate) fn path(&self) -> &Path {
        &self.position.path
    }

    pub(crate) fn at_byte(&self) -> u64 {
        self.position.at_byte
    }

    pub(crate) fn n_bytes(&self) -> u64 {
        self.position.n_bytes
    }

    pub(crate) fn n_bytes_read(&self) -> u64 {
        self.position.at_byte
    }

    /// Fills `records` with what comes next; false at the end.
    fn load(&mut self) -> Result<bool, TripError> {
        let is_closed = self.is_closed();
        loop {
            if self.position.at_byte == self.index_at_byte && self.index_at_byte < self.position.n_bytes {
                self.position.end = Some(End::Closed);
                return Ok(false);
            }
            let data_bytes = match self.read_header()? {
                Ok(data_bytes) => data_bytes,
                Err(what) => return self.position.stop_short(what, is_closed),
            };
            let next_at_byte = self.position.at_byte + (4 + self.header.len() + 4) as u64 + data_bytes;
            if next_at_byte > self.position.n_bytes {
                return self.position.stop_short(TOO_LONG, is_closed);
            }
            if data_bytes > MAX_RECORD_BYTES {
                return Err(self.position.too_large(data_bytes, MAX_RECORD_BYTES));
            }
            match field(&self.header, b"op") {
                Some(&[op::CHUNK]) => {
                    self.read_data(data_bytes)?;
                    let of = (field(&self.header, b"compression"), u32_field(&self.header, b"size"));
                    let (Some(compression), Some(size)) = of else {
                        return self.position.stop_short(NO_RECORD, is_closed);
                    };
                    if size == 0 && data_bytes == 0 {
                        // A recorder was killed before it knew them. What is in the chunk stands after it.
                        self.position.at_byte = next_at_byte;
                        continue;
                    }
                    match chunk::open_ros1(compression, size.into(), &self.data, &mut self.position.records) {
                        Ok(()) => return Ok(self.position.loaded(next_at_byte)),
                        Err(fault) => {
                            return self.position.chunk_failed(
                                next_at_byte,
                                fault,
                                is_closed,
                                "bz2, lz4 and none",
                            );
                        }
                    }
                }
                // Messages outside of chunks are those of a recorder that was killed: it writes a chunk's length at its end.
                Some(&[op::CONNECTION | op::MESSAGE]) => {
                    self.read_data(data_bytes)?;
                    self.position.records.clear();
                    for part in [&self.header, &self.data] {
                        self.position.records.extend((part.len() as u32).to_le_bytes());
                        self.position.records.extend(part);
                    }
                    return Ok(self.position.loaded(next_at_byte));
                }
                Some(&[op::BAG_HEADER | op::INDEX | op::CHUNK_INFO]) => {
                    // At most 4 GiB.
                    self.file.seek_relative(data_bytes as i64).map_err(io_error(&self.position.path))?;
                    self.position.at_byte = next_at_byte;
                }
                _ => return self.position.stop_short(NO_RECORD, is_closed),
            }
        }
    }

    /// Reads the header of the record at `at_byte`, and gives the length of the data after it; or what is wrong there.
    fn read_header(&mut self) -> Result<Result<u64, &'static str>, TripError> {
        let n_left = self.position.n_bytes - self.position.at_byte;
        let Some(header_bytes) = self.read_length(n_left)? else { return Ok(Err(TOO_LONG)) };
        if header_bytes > MAX_HEADER_BYTES {
            return Ok(Err(NO_RECORD));
        }
        if u64::from(header_bytes) + 8 > n_left {
            return Ok(Err(TOO_LONG));
        }
        self.header.resize(header_bytes as usize, 0);
        self.file.read_exact(&mut self.header).map_err(io_error(&self.position.path))?;
        let data_bytes = self.read_length(n_left)?;
        Ok(data_bytes.map(u64::from).ok_or(TOO_LONG))
    }

    fn read_length(&mut self, n_left: u64) -> Result<Option<u32>, TripError> {
        if n_left < 4 {
            return Ok(None);
        }
        let mut bytes = [0; 4];
        match self.file.read_exact(&mut bytes) {
            Ok(()) => Ok(Some(u32::from_le_bytes(bytes))),
            Err(error) if error.kind() == io::ErrorKind::UnexpectedEof => Ok(None),
            Err(error) => Err(io_error(&self.position.path)(error)),
        }
    }

    /// * `n_bytes` — that the file has
    fn read_data(&mut self, n_bytes: u64) -> Result<(), TripError> {
        self.data.resize(n_bytes as usize, 0);
        self.file.read_exact(&mut self.data).map_err(io_error(&self.position.path))
    }
}
