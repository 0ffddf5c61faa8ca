//! An MCAP file's records, from the first to the last whole one, in the order of the file.
//!
//! The `mcap` crate finds where records begin and end and holds the data section against its checksum; chunks are
//! opened in [`crate::chunk`]. Memory holds one chunk, compressed and not. Lengths are believed only as far as the
//! file goes.

use std::fs::File;
use std::io::{self, Read, Seek};
use std::path::{Path, PathBuf};

use mcap::McapError;
use mcap::records::op;
use mcap::sans_io::{LinearReadEvent, LinearReader, LinearReaderOptions};

use crate::catalogue::Catalogue;
use crate::chunk::{self, ChunkFault};
use crate::record::{RECORD_HEAD_BYTES, Record, first_record};
use crate::recording::{End, MAX_RECORD_BYTES, NO_RECORD, TOO_LONG, io_error};
use crate::{TripError, summary};

/// Bytes read from the file at once.
const READ_BYTES: usize = 256 << 10;

/// An MCAP file being read.
pub(crate) struct McapFile {
    path: PathBuf,
    file: File,
    n_bytes: u64,
    n_bytes_read: u64,
    framing: LinearReader,
    /// Where in the file the next record begins.
    at_byte: u64,
    /// The records of the chunk being read, or one record that stands outside of chunks.
    records: Vec<u8>,
    next_in_records: usize,
    records_at_byte: u64,
    /// Whether the file ends as a recording that was closed does. What is not whole in such a file is damage.
    closed: bool,
    end: Option<End>,
}

impl McapFile {
    /// Takes a file and looks at its end.
    pub(crate) fn new(path: &Path, mut file: File, n_bytes: u64) -> Result<McapFile, TripError> {
        let closed = summary::footer(&mut file, n_bytes).map_err(io_error(path))?.is_some();
        let mut recording = McapFile {
            path: path.to_owned(),
            file,
            n_bytes,
            n_bytes_read: 0,
            framing: LinearReader::new(),
            at_byte: 0,
            records: Vec::new(),
            next_in_records: 0,
            records_at_byte: 0,
            closed,
            end: None,
        };
        recording.rewind()?;
        Ok(recording)
    }

    /// Goes back to the first record.
    pub(crate) fn rewind(&mut self) -> Result<(), TripError> {
        self.file.rewind().map_err(io_error(&self.path))?;
        self.framing = LinearReader::new_with_options(
            LinearReaderOptions::default()
                .with_emit_chunks(true)
                .with_validate_data_section_crc(true)
                .with_record_length_limit(MAX_RECORD_BYTES as usize),
        );
        self.n_bytes_read = 0;
        self.at_byte = mcap::MAGIC.len() as u64;
        self.records.clear();
        self.next_in_records = 0;
        self.end = None;
        Ok(())
    }

    /// The next record that matters, or `None` at the end, which [`end`](Self::end) tells about.
    pub(crate) fn next_record(&mut self) -> Result<Option<Record<'_>>, TripError> {
        while self.next_in_records == self.records.len() {
            if self.end.is_some() || !self.load()? {
                return Ok(None);
            }
        }
        let damaged = || TripError::Damaged {
            path: self.path.clone(),
            at_byte: self.records_at_byte,
            what: "a record there is shorter than what it says it holds".to_owned(),
        };
        let (opcode, body, n_bytes) =
            first_record(&self.records[self.next_in_records..]).ok_or_else(damaged)?;
        self.next_in_records += n_bytes;
        Record::parse(opcode, body).map(Some).ok_or_else(damaged)
    }

    /// How the data ended, once they have.
    pub(crate) fn end(&self) -> Option<End> {
        self.end
    }

    /// Whether the file ends as one does that was closed.
    pub(crate) fn is_closed(&self) -> bool {
        self.closed
    }

    pub(crate) fn path(&self) -> &Path {
        &self.path
    }

    /// The channels that the summary names, if there is one to believe. What was read before must be begun anew.
    pub(crate) fn catalogue(&mut self) -> Result<Option<Catalogue>, TripError> {
        summary::catalogue(&mut self.file, self.n_bytes).map_err(io_error(&self.path))
    }

    /// Where the next record begins, or the one that is not whole.
    pub(crate) fn at_byte(&self) -> u64 {
        self.at_byte
    }

    pub(crate) fn n_bytes(&self) -> u64 {
        self.n_bytes
    }

    pub(crate) fn n_bytes_read(&self) -> u64 {
        self.n_bytes_read
    }

    /// Fills `records` with what comes next; false at the end.
    fn load(&mut self) -> Result<bool, TripError> {
        loop {
            let at_byte = self.at_byte;
            match self.framing.next_event() {
                Some(Ok(LinearReadEvent::ReadRequest(wanted))) => {
                    if wanted as u64 > self.n_bytes - self.n_bytes_read || self.read_some(wanted)? == 0 {
                        return self.stop_short(TOO_LONG);
                    }
                }
                Some(Ok(LinearReadEvent::Record { opcode, data })) => {
                    let next_at_byte = at_byte + (RECORD_HEAD_BYTES + data.len()) as u64;
                    match opcode {
                        op::DATA_END | op::FOOTER => {
                            self.at_byte = next_at_byte;
                            self.end = Some(End::Closed);
                            return Ok(false);
                        }
                        // No record has this opcode; a file system that lost the end of a file fills it with zeroes.
                        0 => return self.stop_short(NO_RECORD),
                        op::CHUNK => match chunk::open(data, &mut self.records) {
                            Ok(()) => return Ok(self.loaded(next_at_byte)),
                            Err(fault) => return self.chunk_failed(next_at_byte, fault),
                        },
                        op::SCHEMA | op::CHANNEL | op::MESSAGE => {
                            self.records.clear();
                            self.records.push(opcode);
                            self.records.extend((data.len() as u64).to_le_bytes());
                            self.records.extend(data);
                            return Ok(self.loaded(next_at_byte));
                        }
                        _ => self.at_byte = next_at_byte,
                    }
                }
                Some(Err(McapError::RecordTooLarge { len, .. })) => {
                    return if len > self.n_bytes - at_byte {
                        self.stop_short(TOO_LONG)
                    } else {
                        Err(self.too_large(len, MAX_RECORD_BYTES))
                    };
                }
                Some(Err(McapError::BadDataCrc { saved, calculated })) => {
                    let what = format!(
                        "the checksum of all data before it should be {saved:08x} and is {calculated:08x}"
                    );
                    return Err(self.damaged(what));
                }
                Some(Err(_)) => return Err(self.damaged(NO_RECORD.to_owned())),
                None => return self.stop_short(NO_RECORD),
            }
        }
    }

    /// Reads at least one byte where there are any, at most [`READ_BYTES`].
    fn read_some(&mut self, wanted: usize) -> Result<usize, TripError> {
        let left = usize::try_from(self.n_bytes - self.n_bytes_read).unwrap_or(usize::MAX);
        let n_bytes = wanted.clamp(READ_BYTES / 4, READ_BYTES).min(left);
        let buffer = self.framing.insert(n_bytes);
        let n_read = loop {
            match self.file.read(buffer) {
                Err(error) if error.kind() == io::ErrorKind::Interrupted => {}
                result => break result.map_err(io_error(&self.path))?,
            }
        };
        self.framing.notify_read(n_read);
        self.n_bytes_read += n_read as u64;
        Ok(n_read)
    }

    fn loaded(&mut self, next_at_byte: u64) -> bool {
        self.records_at_byte = self.at_byte;
        self.at_byte = next_at_byte;
        self.next_in_records = 0;
        true
    }

    /// The record at `at_byte` is not whole: the end of a recording that was cut off, damage in any other.
    fn stop_short(&mut self, what: &str) -> Result<bool, TripError> {
        if self.closed {
            return Err(self.damaged(what.to_owned()));
        }
        self.end = Some(End::CutOff);
        Ok(false)
    }

    fn chunk_failed(&mut self, next_at_byte: u64, fault: ChunkFault) -> Result<bool, TripError> {
        self.records.clear();
        self.next_in_records = 0;
        match fault {
            // The last thing in a file that was not closed: its length reached the disk and its bytes did not.
            ChunkFault::Damaged { what } if next_at_byte == self.n_bytes => self.stop_short(&what),
            ChunkFault::Damaged { what } => Err(self.damaged(what)),
            ChunkFault::TooLarge { n_bytes } => Err(self.too_large(n_bytes, chunk::MAX_CHUNK_BYTES)),
            ChunkFault::UnsupportedCompression { name } => Err(TripError::UnsupportedCompression {
                path: self.path.clone(),
                at_byte: self.at_byte,
                name,
                supported: "zstd, lz4 and none",
            }),
        }
    }

    fn damaged(&self, what: String) -> TripError {
        TripError::Damaged { path: self.path.clone(), at_byte: self.at_byte, what }
    }

    fn too_large(&self, n_bytes: u64, limit: u64) -> TripError {
        TripError::TooLarge { path: self.path.clone(), at_byte: self.at_byte, n_bytes, limit }
    }
}
