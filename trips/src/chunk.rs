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
    decompress(&chunk, &[b"", b"zstd", b"lz4"], records)?;
    check_size(&chunk, records)?;
    check(&chunk, records)
}

/// Puts what can be read of a chunk whose end is not there, or not where its record says, into `records`; at best that is
/// all of it. Nothing of a chunk that is all there and not as it was written, since nobody can tell where it is not.
pub(crate) fn open_beginning(chunk_body: &[u8], records: &mut Vec<u8>) {
    records.clear();
    if let Some((chunk, compressed_bytes)) = ChunkBody::parse_beginning(chunk_body) {
        decompress_beginning(&chunk, compressed_bytes, records);
    }
}

/// * `compressed_bytes` — that there should be
fn decompress_beginning(chunk: &ChunkBody<'_>, compressed_bytes: u64, records: &mut Vec<u8>) {
    let is_cut_off = (chunk.compressed.len() as u64) < compressed_bytes;
    let is_good = match decompress_all(chunk, records) {
        Ok(()) if records.len() as u64 == chunk.uncompressed_bytes => check(chunk, records).is_ok(),
        Ok(()) => is_cut_off && (records.len() as u64) < chunk.uncompressed_bytes,
        // What came before the end of the bytes is there.
        Err(error) => is_cut_off && error.kind() == io::ErrorKind::UnexpectedEof,
    };
    if !is_good {
        records.clear();
    }
}

fn check(chunk: &ChunkBody<'_>, records: &[u8]) -> Result<(), ChunkFault> {
    let (expected, found) = (chunk.uncompressed_crc, crc32fast::hash(records));
    if expected != 0 && expected != found {
        return Err(damaged(format!("a chunk's checksum should be {expected:08x} and is {found:08x}")));
    }
    Ok(())
}

/// Puts the records of a ROS 1 bag's chunk into `records`, likewise. It has no checksum.
pub(crate) fn open_ros1(
    compression: &[u8],
    uncompressed_bytes: u64,
    compressed: &[u8],
    records: &mut Vec<u8>,
) -> Result<(), ChunkFault> {
    records.clear();
    let chunk = ros1_body(compression, uncompressed_bytes, compressed);
    decompress(&chunk, &[b"", b"bz2", b"lz4"], records)?;
    check_size(&chunk, records)
}

/// Puts what can be read of such a chunk whose end is not there into `records`.
///
/// * `compressed_bytes` — that there should be
pub(crate) fn open_ros1_beginning(
    compression: &[u8],
    uncompressed_bytes: u64,
    compressed_bytes: u64,
    compressed: &[u8],
    records: &mut Vec<u8>,
) {
    records.clear();
    decompress_beginning(&ros1_body(compression, uncompressed_bytes, compressed), compressed_bytes, records);
}

fn ros1_body<'a>(compression: &'a [u8], uncompressed_bytes: u64, compressed: &'a [u8]) -> ChunkBody<'a> {
    let compression = if compression == b"none" { b"" } else { compression };
    ChunkBody { uncompressed_bytes, uncompressed_crc: 0, compression, compressed }
}

fn check_size(chunk: &ChunkBody<'_>, records: &[u8]) -> Result<(), ChunkFault> {
    let (expected, found) = (chunk.uncompressed_bytes, records.len());
    if found as u64 != expected {
        return Err(damaged(format!("a chunk should hold {expected} bytes and holds {found} or more")));
    }
    Ok(())
}

fn decompress(chunk: &ChunkBody<'_>, supported: &[&[u8]], records: &mut Vec<u8>) -> Result<(), ChunkFault> {
    if chunk.uncompressed_bytes > MAX_CHUNK_BYTES {
        return Err(ChunkFault::TooLarge { n_bytes: chunk.uncompressed_bytes });
    }
    if !supported.contains(&chunk.compression) {
        let name = String::from_utf8_lossy(chunk.compression).chars().take(32).collect();
        return Err(ChunkFault::UnsupportedCompression { name });
    }
    decompress_all(chunk, records).map_err(|error| undecompressable(chunk.compression, &error))
}

/// Of a compression that is not known: nothing.
fn decompress_all(chunk: &ChunkBody<'_>, records: &mut Vec<u8>) -> io::Result<()> {
    // One byte more than there should be, so that a chunk that holds too much is noticed.
    let at_most = chunk.uncompressed_bytes.min(MAX_CHUNK_BYTES) + 1;
    let source: Box<dyn Read + '_> = match chunk.compression {
        b"" => Box::new(chunk.compressed),
        b"zstd" => Box::new(zstd::Decoder::with_buffer(chunk.compressed)?),
        b"lz4" => Box::new(lz4::Decoder::new(chunk.compressed)?),
        b"bz2" => Box::new(bzip2::read::BzDecoder::new(chunk.compressed)),
        _ => Box::new(io::empty()),
    };
    source.take(at_most).read_to_end(records).map(drop)
}

fn undecompressable(compression: &[u8], error: &io::Error) -> ChunkFault {
    damaged(format!("a chunk could not be decompressed ({}: {error})", String::from_utf8_lossy(compression)))
}

fn damaged(what: impl Into<String>) -> ChunkFault {
    ChunkFault::Damaged { what: what.into() }
}
