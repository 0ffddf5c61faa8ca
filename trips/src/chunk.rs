//! Opens a chunk: decompresses the records in it and holds them against their checksum, before any of them is used.
//!
//! Not left to the `mcap` crate, whose 0.26 subtracts a record's length from what is left of an uncompressed chunk
//! without looking whether it fits, and so panics (or reads on past the chunk) where that length is damaged.

use std::io::{self, Read};

use crate::record::ChunkBody;

/// Bytes of records that a chunk may hold. Recorders make chunks of 1 to 4 MiB.
pub(crate) const MAX_CHUNK_BYTES: u64 = 256 << 20;

/// Why a chunk could not be opened.
#[derive(Debug)]
pub(crate) enum ChunkFault {
    TooLarge { n_bytes: u64 },
    UnsupportedCompression { name: String },
    Damaged { what: String },
}

/// Puts the records of a chunk into `records`, which is cleared first and keeps its allocation.
///
/// Memory follows what is really there: a chunk that claims more than it has allocates no more than it has.
pub(crate) fn open(chunk_body: &[u8], records: &mut Vec<u8>) -> Result<(), ChunkFault> {
    records.clear();
    let Some(chunk) = ChunkBody::parse(chunk_body) else {
        return Err(damaged("a chunk is shorter than what it says it holds"));
    };
    if chunk.uncompressed_bytes > MAX_CHUNK_BYTES {
        return Err(ChunkFault::TooLarge { n_bytes: chunk.uncompressed_bytes });
    }
    decompress(&chunk, records)?;
    if records.len() as u64 != chunk.uncompressed_bytes {
        let (expected, found) = (chunk.uncompressed_bytes, records.len());
        return Err(damaged(format!("a chunk should hold {expected} bytes and holds {found} or more")));
    }
    let found = crc32fast::hash(records);
    if chunk.uncompressed_crc != 0 && chunk.uncompressed_crc != found {
        let expected = chunk.uncompressed_crc;
        return Err(damaged(format!("a chunk's checksum should be {expected:08x} and is {found:08x}")));
    }
    Ok(())
}

fn decompress(chunk: &ChunkBody<'_>, records: &mut Vec<u8>) -> Result<(), ChunkFault> {
    // One byte more than there should be, so that a chunk that holds too much is noticed.
    let at_most = chunk.uncompressed_bytes + 1;
    let mut read_all = |mut source: Box<dyn Read + '_>| source.read_to_end(records);
    let result = match chunk.compression {
        b"" => read_all(Box::new(chunk.compressed.take(at_most))),
        b"zstd" => zstd::Decoder::with_buffer(chunk.compressed)
            .and_then(|decoder| read_all(Box::new(decoder.take(at_most)))),
        b"lz4" => {
            lz4::Decoder::new(chunk.compressed).and_then(|decoder| read_all(Box::new(decoder.take(at_most))))
        }
        other => {
            let name = String::from_utf8_lossy(other).chars().take(32).collect();
            return Err(ChunkFault::UnsupportedCompression { name });
        }
    };
    match result {
        Ok(_) => Ok(()),
        Err(error) => Err(undecompressable(chunk.compression, &error)),
    }
}

fn undecompressable(compression: &[u8], error: &io::Error) -> ChunkFault {
    damaged(format!("a chunk could not be decompressed ({}: {error})", String::from_utf8_lossy(compression)))
}

fn damaged(what: impl Into<String>) -> ChunkFault {
    ChunkFault::Damaged { what: what.into() }
}
