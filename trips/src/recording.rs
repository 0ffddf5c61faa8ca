//! A recording's records, from the first to the last whole one, in the order of the file.
//!
//! The `mcap` crate finds where records begin and end and holds the data section against its checksum; chunks are
//! opened in [`crate::chunk`]. Memory holds one chunk, compressed and not. Lengths are believed only as far as the
//! file goes.

use std::fmt;
use std::fs::File;
use std::io::{self, Read, Seek};
use std::path::{Path, PathBuf};

use mcap::McapError;
use mcap::records::op;
use mcap::sans_io::{LinearReadEvent, LinearReader, LinearReaderOptions};

use crate::chunk::{self, ChunkFault};
use crate::record::{RECORD_HEAD_BYTES, Record, first_record};
use crate::{TripError, summary};

/// Bytes of one record in the file: a compressed chunk, or an attachment, which is stepped over in memory.
pub(crate) const MAX_RECORD_BYTES: u64 = 512 << 20;

/// What is wrong where a record's length is.
const TOO_LONG: &str = "the record there claims more bytes than the file has left";

/// What is wrong where there is something else.
const NO_RECORD: &str = "what stands there is no record";

/// Bytes read from the file at once.
const READ_BYTES: usize = 256 << 10;

/// Where a recording was cut off, and what was read of it.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Truncation {
    /// Where the first record begins that is not whole.
    pub at_byte: u64,
    /// Bytes in the file.
    pub n_bytes: u64,
    /// Frames read before that.
    pub n_frames: u64,
    /// Whether all messages were read, and only the index after them is missing or damaged.
    pub data_is_whole: bool,
}

/// A sentence that begins where the trip's name ends: `TRIP is cut off at …`.
impl fmt::Display for Truncation {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Truncation { at_byte, n_bytes, n_frames, data_is_whole } = self;
        if *data_is_whole {
            write!(
                f,
                "is not properly closed after byte {at_byte} of {n_bytes}; all its {n_frames} frames were read"
            )
        } else {
            write!(
                f,
                "is cut off at byte {at_byte} of {n_bytes}; the {n_frames} frames before that were read"
            )
        }
    }
}

/// What sort of file a recording is.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Format {
    /// MCAP, as ROS 2 records.
    Mcap,
}

impl fmt::Display for Format {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Mcap => "MCAP",
        })
    }
}

/// How the data came to their end.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum End {
    /// At the record that closes them.
    Closed,
    /// At a record that is not whole.
    CutOff,
}

/// A recording being read.
pub(crate) struct Recording {
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

impl Recording {
    /// Opens the file and looks at its two ends.
    pub(crate) fn open(path: &Path) -> Result<Recording, TripError> {
        let (mut file, n_bytes) = open_file(path)?;
        let closed = summary::footer(&mut file, n_bytes).map_err(io_error(path))?.is_some();
        let mut recording = Recording {
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

    pub(crate) fn format(&self) -> Format {
        Format::Mcap
    }

    pub(crate) fn path(&self) -> &Path {
        &self.path
    }

    pub(crate) fn file_mut(&mut self) -> &mut File {
        &mut self.file
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

/// Opens a file that begins as an MCAP file does, or as the beginning of one that was cut off.
fn open_file(path: &Path) -> Result<(File, u64), TripError> {
    let (file, n_bytes, beginning) = open_regular(path)?;
    let compared = beginning.len().min(mcap::MAGIC.len());
    if beginning[..compared] != mcap::MAGIC[..compared] {
        let looks_like = known_format(&beginning).unwrap_or("of some other kind");
        return Err(TripError::NotMcap { path: path.to_owned(), looks_like });
    }
    Ok((file, n_bytes))
}

/// Opens a file that may have been an MCAP file, unless it is known for another.
pub(crate) fn open_damaged(path: &Path) -> Result<(File, u64), TripError> {
    let (file, n_bytes, beginning) = open_regular(path)?;
    match known_format(&beginning) {
        Some(looks_like) => Err(TripError::NotMcap { path: path.to_owned(), looks_like }),
        None => Ok((file, n_bytes)),
    }
}

fn known_format(beginning: &[u8]) -> Option<&'static str> {
    match beginning {
        [b'#', b'R', b'O', b'S', b'B', b'A', b'G', ..] => Some("a ROS 1 bag"),
        [b'S', b'Q', b'L', b'i', b't', b'e', ..] => Some("an SQLite database, perhaps an older ROS 2 bag"),
        _ => None,
    }
}

/// Opens a file: its bytes, and the first of them.
fn open_regular(path: &Path) -> Result<(File, u64, Vec<u8>), TripError> {
    let metadata = std::fs::metadata(path).map_err(|source| match source.kind() {
        io::ErrorKind::NotFound => TripError::NotFound { path: path.to_owned() },
        _ => TripError::Io { path: path.to_owned(), source },
    })?;
    if metadata.is_dir() {
        return Err(TripError::IsDirectory { path: path.to_owned() });
    }
    if !metadata.is_file() {
        // A pipe has no end to look at, and opening one would wait for its writer.
        return Err(io_error(path)(io::Error::other("it is not a regular file")));
    }
    let mut file = File::open(path).map_err(io_error(path))?;
    let mut beginning = Vec::new();
    (&mut file).take(16).read_to_end(&mut beginning).map_err(io_error(path))?;
    match beginning.is_empty() {
        true => Err(TripError::Empty { path: path.to_owned() }),
        false => Ok((file, metadata.len(), beginning)),
    }
}

/// Adds the file's name to the system's reason.
pub(crate) fn io_error(path: &Path) -> impl FnOnce(io::Error) -> TripError + '_ {
    move |source| TripError::Io { path: path.to_owned(), source }
}
