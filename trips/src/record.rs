//! The few kinds of MCAP record that matter to a trip, picked apart where they lie.
//!
//! The `mcap` crate parses these too, but reserves as many bytes as a string claims to have before it looks whether
//! they are there. Here a length is checked first, and nothing is copied. Layouts: <https://mcap.dev/spec>.

use std::collections::BTreeMap;

use mcap::records::op;

/// Bytes before the body of a record: one of opcode, eight of length.
pub(crate) const RECORD_HEAD_BYTES: usize = 9;

/// One record.
#[derive(Debug, PartialEq)]
pub(crate) enum Record<'a> {
    Schema {
        id: u32,
        name: &'a [u8],
        encoding: &'a [u8],
        definition: &'a [u8],
    },
    Channel {
        id: u32,
        /// 0: none.
        schema_id: u32,
        topic: &'a [u8],
        message_encoding: &'a [u8],
        /// Names and values.
        metadata: &'a [u8],
    },
    Message {
        channel_id: u32,
        sequence: u32,
        log_time: u64,
        publish_time: u64,
        data: &'a [u8],
    },
    Statistics {
        n_channels: u32,
        /// Messages of all channels together.
        n_messages_total: u64,
        /// Messages of each channel.
        n_messages: BTreeMap<u32, u64>,
    },
    /// A record that does not matter.
    Other,
}

impl<'a> Record<'a> {
    /// `None` where the body is too short for what it says.
    pub(crate) fn parse(opcode: u8, body: &'a [u8]) -> Option<Record<'a>> {
        let mut fields = Fields(body);
        Some(match opcode {
            op::SCHEMA => Record::Schema {
                id: fields.u16()?.into(),
                name: fields.prefixed()?,
                encoding: fields.prefixed()?,
                definition: fields.prefixed()?,
            },
            op::CHANNEL => Record::Channel {
                id: fields.u16()?.into(),
                schema_id: fields.u16()?.into(),
                topic: fields.prefixed()?,
                message_encoding: fields.prefixed()?,
                metadata: fields.prefixed()?,
            },
            op::MESSAGE => Record::Message {
                channel_id: fields.u16()?.into(),
                sequence: fields.u32()?,
                log_time: fields.u64()?,
                publish_time: fields.u64()?,
                data: fields.0,
            },
            op::STATISTICS => parse_statistics(fields)?,
            _ => Record::Other,
        })
    }
}

fn parse_statistics(mut fields: Fields<'_>) -> Option<Record<'_>> {
    let n_messages_total = fields.u64()?;
    let _schema_count = fields.u16()?;
    let n_channels = fields.u32()?;
    // Counts of attachments, metadata and chunks; the first and the last time.
    fields.take(3 * 4 + 2 * 8)?;
    let mut counts = Fields(fields.prefixed()?);
    let mut n_messages = BTreeMap::new();
    while !counts.0.is_empty() {
        n_messages.insert(counts.u16()?.into(), counts.u64()?);
    }
    Some(Record::Statistics { n_channels, n_messages_total, n_messages })
}

/// The body of a chunk record.
pub(crate) struct ChunkBody<'a> {
    pub(crate) uncompressed_bytes: u64,
    /// 0: not recorded.
    pub(crate) uncompressed_crc: u32,
    pub(crate) compression: &'a [u8],
    pub(crate) compressed: &'a [u8],
}

impl<'a> ChunkBody<'a> {
    pub(crate) fn parse(body: &'a [u8]) -> Option<ChunkBody<'a>> {
        let (mut chunk, compressed_bytes) = Self::parse_beginning(body)?;
        chunk.compressed = chunk.compressed.get(..usize::try_from(compressed_bytes).ok()?)?;
        Some(chunk)
    }

    /// Of a body whose end may not be there, with as many compressed bytes as are; and how many there should be.
    pub(crate) fn parse_beginning(body: &'a [u8]) -> Option<(ChunkBody<'a>, u64)> {
        let mut fields = Fields(body);
        // The first and the last time in it.
        fields.take(2 * 8)?;
        let uncompressed_bytes = fields.u64()?;
        let uncompressed_crc = fields.u32()?;
        let compression = fields.prefixed()?;
        let compressed_bytes = fields.u64()?;
        let compressed =
            &fields.0[..fields.0.len().min(usize::try_from(compressed_bytes).unwrap_or(usize::MAX))];
        Some((ChunkBody { uncompressed_bytes, uncompressed_crc, compression, compressed }, compressed_bytes))
    }
}

/// The record at the beginning of `bytes`: opcode, body, and how many bytes it takes in all.
///
/// `None` where it is not whole.
pub(crate) fn first_record(bytes: &[u8]) -> Option<(u8, &[u8], usize)> {
    let mut fields = Fields(bytes);
    let &[opcode] = fields.take(1)? else { return None };
    let n_bytes = usize::try_from(fields.u64()?).ok()?;
    let body = fields.take(n_bytes)?;
    Some((opcode, body, RECORD_HEAD_BYTES + n_bytes))
}

/// Little-endian fields, taken from the front.
pub(crate) struct Fields<'a>(pub(crate) &'a [u8]);

impl<'a> Fields<'a> {
    pub(crate) fn take(&mut self, n_bytes: usize) -> Option<&'a [u8]> {
        let (taken, rest) = self.0.split_at_checked(n_bytes)?;
        self.0 = rest;
        Some(taken)
    }

    pub(crate) fn u64(&mut self) -> Option<u64> {
        Some(u64::from_le_bytes(self.array()?))
    }

    pub(crate) fn u32(&mut self) -> Option<u32> {
        Some(u32::from_le_bytes(self.array()?))
    }

    pub(crate) fn u16(&mut self) -> Option<u16> {
        Some(u16::from_le_bytes(self.array()?))
    }

    /// Bytes after their number, as strings and maps are stored.
    pub(crate) fn prefixed(&mut self) -> Option<&'a [u8]> {
        let n_bytes = usize::try_from(self.u32()?).ok()?;
        self.take(n_bytes)
    }

    pub(crate) fn array<const N: usize>(&mut self) -> Option<[u8; N]> {
        self.take(N)?.try_into().ok()
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    #[test]
    fn a_length_beyond_the_end_is_refused_without_reserving_it() {
        let mut schema = vec![7, 0];
        schema.extend(u32::MAX.to_le_bytes());
        schema.extend(b"name");
        assert_eq!(Record::parse(op::SCHEMA, &schema), None);

        let mut record = vec![op::MESSAGE];
        record.extend(u64::MAX.to_le_bytes());
        assert_eq!(first_record(&record), None);
    }

    proptest! {
        #[test]
        fn any_bytes_are_parsed_or_refused(opcode: u8, bytes in prop::collection::vec(any::<u8>(), 0..200)) {
            let _ = Record::parse(opcode, &bytes);
            let _ = ChunkBody::parse(&bytes);
            if let Some((first, body, n_bytes)) = first_record(&bytes) {
                prop_assert_eq!(first, bytes[0]);
                prop_assert_eq!(body, &bytes[RECORD_HEAD_BYTES..n_bytes]);
            }
        }
    }
}
