//! The end of a recording that was closed: a footer, and before it a summary that names all channels.
//!
//! Only a summary that agrees with its checksum and names as many channels, and counts as many messages, as it says is believed; without one the
//! channels are found by reading the recording through.

use std::fs::File;
use std::io::{self, Read, Seek, SeekFrom};

use mcap::records::op;

use crate::catalogue::Catalogue;
use crate::record::{Fields, RECORD_HEAD_BYTES, Record, first_record};

/// Opcode and length, start of the summary, start of its offsets, checksum.
const FOOTER_BYTES: usize = RECORD_HEAD_BYTES + 8 + 8 + 4;

/// Bytes of a summary that are read into memory; a day of recording has about 10 MB.
const MAX_SUMMARY_BYTES: u64 = 64 << 20;

/// The footer record of a file that was closed.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Footer {
    /// 0: there is no summary.
    summary_start: u64,
    /// 0: not recorded.
    summary_crc: u32,
}

/// The footer, or `None` if the file does not end as one does that was closed. Moves the file's position.
pub(crate) fn footer(file: &mut File, n_bytes: u64) -> io::Result<Option<Footer>> {
    let end_bytes = FOOTER_BYTES + mcap::MAGIC.len();
    if n_bytes < (mcap::MAGIC.len() + end_bytes) as u64 {
        return Ok(None);
    }
    let mut end = vec![0; end_bytes];
    file.seek(SeekFrom::Start(n_bytes - end_bytes as u64))?;
    file.read_exact(&mut end)?;
    Ok(parse_footer(&end))
}

fn parse_footer(end: &[u8]) -> Option<Footer> {
    let (opcode, body, n_bytes) = first_record(end)?;
    if opcode != op::FOOTER || n_bytes != FOOTER_BYTES || &end[n_bytes..] != mcap::MAGIC {
        return None;
    }
    let mut fields = Fields(body);
    let summary_start = fields.u64()?;
    let _summary_offset_start = fields.u64()?;
    Some(Footer { summary_start, summary_crc: fields.u32()? })
}

/// The channels that the summary names, or `None` if there is no summary to believe. Moves the file's position.
pub(crate) fn catalogue(file: &mut File, n_bytes: u64) -> io::Result<Option<Catalogue>> {
    Ok(records(file, n_bytes)?.and_then(|records| parse_summary(&records)))
}

/// The records of the summary, or `None` if there is none, or its checksum is another. Moves the file's position.
pub(crate) fn records(file: &mut File, n_bytes: u64) -> io::Result<Option<Vec<u8>>> {
    let Some(footer) = footer(file, n_bytes)? else { return Ok(None) };
    // The checksum covers the footer up to itself.
    let covered_end = n_bytes - (mcap::MAGIC.len() + 4) as u64;
    let covered_bytes = covered_end.saturating_sub(footer.summary_start);
    if footer.summary_start == 0 || covered_bytes > MAX_SUMMARY_BYTES {
        return Ok(None);
    }
    let mut covered = Vec::new();
    file.seek(SeekFrom::Start(footer.summary_start))?;
    file.take(covered_bytes).read_to_end(&mut covered)?;
    let is_as_written = footer.summary_crc == 0 || footer.summary_crc == crc32fast::hash(&covered);
    Ok(is_as_written.then_some(covered))
}

fn parse_summary(mut covered: &[u8]) -> Option<Catalogue> {
    let mut catalogue = Catalogue::default();
    let mut n_channels_counted = None;
    let mut counts_agree = false;
    // The footer is not whole without its checksum, so this ends there.
    while let Some((opcode, body, n_bytes)) = first_record(covered) {
        match Record::parse(opcode, body)? {
            Record::Statistics { n_channels, n_messages_total, n_messages } => {
                n_channels_counted = Some(n_channels as usize);
                // Some recorders count all messages, but not those of each channel.
                counts_agree = n_messages.values().try_fold(0u64, |sum, n| sum.checked_add(*n))
                    == Some(n_messages_total);
                catalogue.set_n_messages(n_messages);
            }
            record => catalogue.add(&record),
        }
        covered = &covered[n_bytes..];
    }
    (counts_agree && n_channels_counted == Some(catalogue.n_channels())).then_some(catalogue)
}
