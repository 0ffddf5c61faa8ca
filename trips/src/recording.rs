//! A recording's records, from the first to the last whole one, whatever sort of file it is.

use std::fmt;
use std::fs::File;
use std::io::{self, Read, Seek};
use std::path::Path;

use crate::TripError;
use crate::catalogue::Catalogue;
use crate::mcap_file::McapFile;
use crate::record::Record;
use crate::ros1_bag::{self, Ros1Bag};

/// Bytes of one record in the file: a compressed chunk, or an attachment, which is stepped over in memory.
pub(crate) const MAX_RECORD_BYTES: u64 = 512 << 20;

/// What is wrong where a record's length is.
pub(crate) const TOO_LONG: &str = "the record there claims more bytes than the file has left";

/// What is wrong where there is something else.
pub(crate) const NO_RECORD: &str = "what stands there is no record";

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
    /// A bag of ROS 1.
    Ros1Bag,
}

impl fmt::Display for Format {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Mcap => "MCAP",
            Self::Ros1Bag => "ROS 1 bag",
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
pub(crate) enum Recording {
    Mcap(Box<McapFile>),
    Ros1(Box<Ros1Bag>),
}

macro_rules! either {
    ($self:expr, $file:ident => $value:expr) => {
        match $self {
            Recording::Mcap($file) => $value,
            Recording::Ros1($file) => $value,
        }
    };
}

impl Recording {
    /// Opens a file by what its first bytes say that it is, and looks at its end.
    pub(crate) fn open(path: &Path) -> Result<Recording, TripError> {
        let (mut file, n_bytes, beginning) = open_regular(path)?;
        file.rewind().map_err(io_error(path))?;
        if begins_as(&beginning, mcap::MAGIC) {
            return McapFile::new(path, file, n_bytes).map(|file| Recording::Mcap(Box::new(file)));
        }
        if begins_as(&beginning, ros1_bag::MAGIC) {
            return Ros1Bag::new(path, file, n_bytes).map(|bag| Recording::Ros1(Box::new(bag)));
        }
        let looks_like = known_format(&beginning).unwrap_or("of some other kind");
        Err(TripError::NotMcap { path: path.to_owned(), looks_like })
    }

    /// Goes back to the first record.
    pub(crate) fn rewind(&mut self) -> Result<(), TripError> {
        either!(self, file => file.rewind())
    }

    /// The next record that matters, or `None` at the end, which [`end`](Self::end) tells about.
    pub(crate) fn next_record(&mut self) -> Result<Option<Record<'_>>, TripError> {
        either!(self, file => file.next_record())
    }

    /// The channels that the index names, if there is one to believe. What was read before must be begun anew.
    pub(crate) fn catalogue(&mut self) -> Result<Option<Catalogue>, TripError> {
        either!(self, file => file.catalogue())
    }

    /// How the data ended, once they have.
    pub(crate) fn end(&self) -> Option<End> {
        either!(self, file => file.end())
    }

    /// Whether the file ends as one does that was closed.
    pub(crate) fn is_closed(&self) -> bool {
        either!(self, file => file.is_closed())
    }

    pub(crate) fn format(&self) -> Format {
        match self {
            Recording::Mcap(_) => Format::Mcap,
            Recording::Ros1(_) => Format::Ros1Bag,
        }
    }

    pub(crate) fn path(&self) -> &Path {
        either!(self, file => file.path())
    }

    /// Where the next record begins, or the one that is not whole.
    pub(crate) fn at_byte(&self) -> u64 {
        either!(self, file => file.at_byte())
    }

    pub(crate) fn n_bytes(&self) -> u64 {
        either!(self, file => file.n_bytes())
    }

    pub(crate) fn n_bytes_read(&self) -> u64 {
        either!(self, file => file.n_bytes_read())
    }
}

/// Whether a file begins as this sort does, or is the beginning of one.
fn begins_as(beginning: &[u8], magic: &[u8]) -> bool {
    let compared = beginning.len().min(magic.len());
    beginning[..compared] == magic[..compared]
}

/// Opens a file that is a ROS 1 bag, or may have been an MCAP file, unless it is known for another.
pub(crate) fn open_damaged(path: &Path) -> Result<(File, u64, Format), TripError> {
    let (file, n_bytes, beginning) = open_regular(path)?;
    let looks_like = match known_format(&beginning) {
        _ if begins_as(&beginning, ros1_bag::MAGIC) => return Ok((file, n_bytes, Format::Ros1Bag)),
        Some(looks_like) => looks_like,
        None => return Ok((file, n_bytes, Format::Mcap)),
    };
    Err(TripError::UnsavedFormat { path: path.to_owned(), looks_like })
}

fn known_format(beginning: &[u8]) -> Option<&'static str> {
    match beginning {
        [b'#', b'R', b'O', b'S', b'B', b'A', b'G', ..] => Some("a ROS 1 bag of another version"),
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
