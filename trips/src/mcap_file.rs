//! An MCAP file's records, from the first to the last whole one, in the order of the file.
//!
//! The `mcap` crate finds where records begin and end and holds the data section against its checksum; chunks are
//! opened in [`crate::chunk`]. Memory holds one chunk, compressed and not. Lengths are believed only as far as the
//! file goes.

use std::fs::File;
use std::io::{self, Read, Seek};
use std::path::Path;

use mcap::McapError;
use mcap::records::op;
use mcap::sans_io::{LinearReadEvent, LinearReader, LinearReaderOptions};

use crate::catalogue::Catalogue;
use crate::chunk;
use crate::position::{Position, short_record};
use crate::record::{RECORD_HEAD_BYTES, Record, first_record};
use crate::recording::{End, MAX_RECORD_BYTES, NO_RECORD, TOO_LONG, io_error};
use crate::{TripError, summary};

/// Bytes read from the file at once.
const READ_BYTES: usize = 256 << 10;

/// An MCAP file being read.
pub(crate) struct McapFile {
    position: Position,
    file: File,
    n_bytes_read: u64,
    framing: LinearReader,
    /// Whether the file ends as a recording that was closed does. What is not whole in such a file is damage.
    closed: bool,
}

impl McapFile {
    /// Takes a file and looks at its end.
    pub(crate) fn new(path: &Path, mut file: File, n_bytes: u64) -> Result<McapFile, TripError> {
        let closed = summary::footer(&mut file, n_bytes).map_err(io_error(path))?.is_some();
        let mut recording = McapFile {
            position: Position::new(path, n_bytes),
            file,
            n_bytes_read: 0,
            framing: LinearReader::new(),
            closed,
        };
        recording.rewind()?;
        Ok(recording)
    }

    /// Goes back to the first record.
    pub(crate) fn rewind(&mut self) -> Result<(), TripError> {
        self.file.rewind().map_err(io_error(&self.position.path))?;
        self.framing = LinearReader::new_with_options(
            LinearReaderOptions::default()
                .with_emit_chunks(true)
                .with_validate_data_section_crc(true)
                .with_record_length_limit(MAX_RECORD_BYTES as usize),
        );
        self.n_bytes_read = 0;
        self.position.begin(mcap::MAGIC.len() as u64);
        Ok(())
    }

    /// The next record that matters, or `None` at the end, which [`end`](Self::end) tells about.
    pub(crate) fn next_record(&mut self) -> Result<Option<Record<'_>>, TripError> {
        while self.position.is_at_end_of_records() {
            if self.position.end.is_some() || !self.load()? {
                return Ok(None);
            }
        }
        let Position { path, records, next_in_records, records_at_byte, .. } = &mut self.position;
        let damaged = || short_record(path, *records_at_byte);
        let (opcode, body, n_bytes) = first_record(&records[*next_in_records..]).ok_or_else(damaged)?;
        *next_in_records += n_bytes;
        Record::parse(opcode, body).map(Some).ok_or_else(damaged)
    }

    /// How the data ended, once they have.
    pub(crate) fn end(&self) -> Option<End> {
        self.position.end
    }

    /// Whether the file ends as one does that was closed.
    pub(crate) fn is_closed(&self) -> bool {
        self.closed
    }

    pub(crate) fn path(&self) -> &Path {
        &self.position.path
    }

    /// The channels that the summary names, if there is one to believe. What was read before must be begun anew.
    pub(crate) fn catalogue(&mut self) -> Result<Option<Catalogue>, TripError> {
        summary::catalogue(&mut self.file, self.position.n_bytes).map_err(io_error(&self.position.path))
    }

    /// Where the next record begins, or the one that is not whole.
    pub(crate) fn at_byte(&self) -> u64 {
        self.position.at_byte
    }

    pub(crate) fn n_bytes(&self) -> u64 {
        self.position.n_bytes
    }

    pub(crate) fn n_bytes_read(&self) -> u64 {
        self.n_bytes_read
    }

    /// Fills `records` with what comes next; false at the end.
    fn load(&mut self) -> Result<bool, TripError> {
        let is_closed = self.closed;
        loop {
            let at_byte = self.position.at_byte;
            match self.framing.next_event() {
                Some(Ok(LinearReadEvent::ReadRequest(wanted))) => {
                    if wanted as u64 > self.position.n_bytes - self.n_bytes_read
                        || self.read_some(wanted)? == 0
                    {
                        return self.position.stop_short(TOO_LONG, is_closed);
                    }
                }
                Some(Ok(LinearReadEvent::Record { opcode, data })) => {
                    let next_at_byte = at_byte + (RECORD_HEAD_BYTES + data.len()) as u64;
                    match opcode {
                        op::DATA_END | op::FOOTER => {
                            self.position.at_byte = next_at_byte;
                            self.position.end = Some(End::Closed);
                            return Ok(false);
                        }
                        // No record has this opcode; a file system that lost the end of a file fills it with zeroes.
                        0 => return self.position.stop_short(NO_RECORD, is_closed),
                        op::CHUNK => match chunk::open(data, &mut self.position.records) {
                            Ok(()) => return Ok(self.position.loaded(next_at_byte)),
                            Err(fault) => {
                                return self.position.chunk_failed(
                                    next_at_byte,
                                    fault,
                                    is_closed,
                                    "zstd, lz4 and none",
                                );
                            }
                        },
                        op::SCHEMA | op::CHANNEL | op::MESSAGE => {
                            self.position.records.clear();
                            self.position.records.push(opcode);
                            self.position.records.extend((data.len() as u64).to_le_bytes());
                            self.position.records.extend(data);
                            return Ok(self.position.loaded(next_at_byte));
                        }
                        _ => self.position.at_byte = next_at_byte,
                    }
                }
                Some(Err(McapError::RecordTooLarge { len, .. })) => {
                    return if len > self.position.n_bytes - at_byte {
                        self.position.stop_short(TOO_LONG, is_closed)
                    } else {
                        Err(self.position.too_large(len, MAX_RECORD_BYTES))
                    };
                }
                Some(Err(McapError::BadDataCrc { saved, calculated })) => {
                    let what = format!(
                        "the checksum of all data before it should be {saved:08x} and is {calculated:08x}"
                    );
                    return Err(self.position.damaged(what));
                }
                Some(Err(_)) => return Err(self.position.damaged(NO_RECORD.to_owned())),
                None => return self.position.stop_short(NO_RECORD, is_closed),
            }
        }
    }

    /// Reads at least one byte where there are any, at most [`READ_BYTES`].
    fn read_some(&mut self, wanted: usize) -> Result<usize, TripError> {
        let left = usize::try_from(self.position.n_bytes - self.n_bytes_read).unwrap_or(usize::MAX);
        let n_bytes = wanted.clamp(READ_BYTES / 4, READ_BYTES).min(left);
        let buffer = self.framing.insert(n_bytes);
        let n_read = loop {
            match self.file.read(buffer) {
                Err(error) if error.kind() == io::ErrorKind::Interrupted => {}
                result => break result.map_err(io_error(&self.position.path))?,
            }
        };
        self.framing.notify_read(n_read);
        self.n_bytes_read += n_read as u64;
        Ok(n_read)
    }
}
