//! Where in a file of records a reader is, and the records that it holds.

use std::path::{Path, PathBuf};

use crate::TripError;
use crate::chunk::{ChunkFault, MAX_CHUNK_BYTES};
use crate::recording::End;

/// A place in a file, and what was loaded there: the records of a chunk, or one that stands outside of chunks.
pub(crate) struct Position {
    pub(crate) path: PathBuf,
    /// Bytes in the file.
    pub(crate) n_bytes: u64,
    /// Where the next record begins that was not loaded, or the one that is not whole.
    pub(crate) at_byte: u64,
    pub(crate) records: Vec<u8>,
    pub(crate) next_in_records: usize,
    /// Where in the file these were.
    pub(crate) records_at_byte: u64,
    /// How the data ended, once they have.
    pub(crate) end: Option<End>,
}

impl Position {
    pub(crate) fn new(path: &Path, n_bytes: u64) -> Self {
        Self {
            path: path.to_owned(),
            n_bytes,
            at_byte: 0,
            records: Vec::new(),
            next_in_records: 0,
            records_at_byte: 0,
            end: None,
        }
    }

    /// Goes to where the first record begins.
    pub(crate) fn begin(&mut self, at_byte: u64) {
        // A file may end within what its sort begins with.
        self.at_byte = at_byte.min(self.n_bytes);
        self.empty();
        self.end = None;
    }

    fn empty(&mut self) {
        self.records.clear();
        self.next_in_records = 0;
    }

    /// Whether all records that were loaded have been read.
    pub(crate) fn is_at_end_of_records(&self) -> bool {
        self.next_in_records == self.records.len()
    }

    /// Takes note that `records` are those at this place.
    pub(crate) fn loaded(&mut self, next_at_byte: u64) -> bool {
        self.records_at_byte = self.at_byte;
        self.at_byte = next_at_byte;
        self.next_in_records = 0;
        true
    }

    /// The record at `at_byte` is not whole: the end of a recording that was cut off, damage in any other.
    pub(crate) fn stop_short(&mut self, what: &str, is_closed: bool) -> Result<bool, TripError> {
        self.empty();
        if is_closed {
            return Err(self.damaged(what.to_owned()));
        }
        self.end = Some(End::CutOff);
        Ok(false)
    }

    /// The chunk at `at_byte` could not be opened.
    ///
    /// * `supported` — compressions that files of this sort may have
    pub(crate) fn chunk_failed(
        &mut self,
        next_at_byte: u64,
        fault: ChunkFault,
        is_closed: bool,
        supported: &'static str,
    ) -> Result<bool, TripError> {
        self.empty();
        match fault {
            // The last thing in a file that was not closed: its length reached the disk and its bytes did not.
            ChunkFault::Damaged { what } if next_at_byte == self.n_bytes => self.stop_short(&what, is_closed),
            ChunkFault::Damaged { what } => Err(self.damaged(what)),
            ChunkFault::TooLarge { n_bytes } => Err(self.too_large(n_bytes, MAX_CHUNK_BYTES)),
            ChunkFault::UnsupportedCompression { name } => Err(TripError::UnsupportedCompression {
                path: self.path.clone(),
                at_byte: self.at_byte,
                name,
                supported,
            }),
        }
    }

    pub(crate) fn damaged(&self, what: String) -> TripError {
        TripError::Damaged { path: self.path.clone(), at_byte: self.at_byte, what }
    }

    pub(crate) fn too_large(&self, n_bytes: u64, limit: u64) -> TripError {
        TripError::TooLarge { path: self.path.clone(), at_byte: self.at_byte, n_bytes, limit }
    }
}

/// A record among those that were loaded is not whole.
pub(crate) fn short_record(path: &Path, records_at_byte: u64) -> TripError {
    TripError::Damaged {
        path: path.to_owned(),
        at_byte: records_at_byte,
        what: "a record there is shorter than what it says it holds".to_owned(),
    }
}
