//! The records of a ROS 1 bag, picked apart where they lie: headers of named fields, and data. Layout:
//! <https://wiki.ros.org/Bags/Format/2.0>.

use crate::catalogue::Catalogue;
use crate::record::{Fields, Record};

/// Bytes of a record's header. Those of connections, the longest, have a topic's name in them.
pub(crate) const MAX_HEADER_BYTES: u32 = 1 << 20;

/// What records are, by their field `op`.
pub(crate) mod op {
    pub(crate) const MESSAGE: u8 = 2;
    pub(crate) const BAG_HEADER: u8 = 3;
    pub(crate) const INDEX: u8 = 4;
    pub(crate) const CHUNK: u8 = 5;
    pub(crate) const CHUNK_INFO: u8 = 6;
    pub(crate) const CONNECTION: u8 = 7;
}

/// What the first record of a bag says.
pub(crate) struct BagHeader {
    /// 0: the bag was not closed.
    pub(crate) index_pos: u64,
    pub(crate) n_connections: u32,
    pub(crate) n_chunks: u32,
}

impl BagHeader {
    pub(crate) fn parse(header: &[u8]) -> Option<BagHeader> {
        let index_pos = u64::from_le_bytes(field(header, b"index_pos")?.try_into().ok()?);
        let (n_connections, n_chunks) =
            (u32_field(header, b"conn_count")?, u32_field(header, b"chunk_count")?);
        Some(BagHeader { index_pos, n_connections, n_chunks })
    }
}

/// The connections of an index, and how many messages each has in all chunks; `None` if it does not have what the bag's
/// header says, to the end of the file.
pub(crate) fn parse_index(mut bytes: &[u8], n_connections: u32, n_chunks: u32) -> Option<Catalogue> {
    let mut catalogue = Catalogue::default();
    let (mut n_connections_found, mut n_chunks_found) = (0, 0);
    while !bytes.is_empty() {
        let (header, data, n_bytes) = first_record(bytes)?;
        match *field(header, b"op")? {
            [op::CONNECTION] => {
                parse(header, data)?.iter().flatten().for_each(|record| catalogue.add(record));
                n_connections_found += 1;
            }
            [op::CHUNK_INFO] => {
                let mut counts = Fields(data);
                while !counts.0.is_empty() {
                    catalogue.add_n_messages(counts.u32()?, counts.u32()?.into());
                }
                n_chunks_found += 1;
            }
            _ => return None,
        }
        bytes = &bytes[n_bytes..];
    }
    ((n_connections_found, n_chunks_found) == (n_connections, n_chunks)).then_some(catalogue)
}

/// The record at the beginning of `bytes`: header, data, and how many bytes it takes in all; `None` where it is not whole.
pub(crate) fn first_record(bytes: &[u8]) -> Option<(&[u8], &[u8], usize)> {
    let mut fields = Fields(bytes);
    let (header, data) = (fields.prefixed()?, fields.prefixed()?);
    Some((header, data, 4 + header.len() + 4 + data.len()))
}

/// What a record says, of a connection in two parts; `None` if something in it is missing.
pub(crate) fn parse<'a>(header: &'a [u8], data: &'a [u8]) -> Option<[Option<Record<'a>>; 2]> {
    Some(match *field(header, b"op")? {
        [op::CONNECTION] => {
            let id = u32_field(header, b"conn")?;
            let definition = field(data, b"message_definition").unwrap_or_default();
            let (name, encoding) = (field(data, b"type")?, &b"ros1msg"[..]);
            let channel = Record::Channel {
                id,
                schema_id: id,
                topic: field(header, b"topic")?,
                message_encoding: b"ros1",
                metadata: b"",
            };
            [Some(Record::Schema { id, name, encoding, definition }), Some(channel)]
        }
        [op::MESSAGE] => {
            let mut time = Fields(field(header, b"time")?);
            let log_time = u64::from(time.u32()?) * 1_000_000_000 + u64::from(time.u32()?);
            let channel_id = u32_field(header, b"conn")?;
            let message = Record::Message { channel_id, sequence: 0, log_time, publish_time: log_time, data };
            [None, Some(message)]
        }
        _ => [None, None],
    })
}

/// The value of a field, of fields `name=value` that each stand after their length.
pub(crate) fn field<'a>(fields: &'a [u8], name: &[u8]) -> Option<&'a [u8]> {
    let mut fields = Fields(fields);
    loop {
        let value = fields.prefixed()?.strip_prefix(name).and_then(|rest| rest.strip_prefix(b"="));
        if value.is_some() {
            return value;
        }
    }
}

pub(crate) fn u32_field(fields: &[u8], name: &[u8]) -> Option<u32> {
    Some(u32::from_le_bytes(field(fields, name)?.try_into().ok()?))
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    proptest! {
        #[test]
        fn any_bytes_are_parsed_or_refused(bytes in prop::collection::vec(any::<u8>(), 0..200)) {
            let _ = parse(&bytes, &bytes);
            let _ = parse_index(&bytes, 1, 1);
            if let Some((header, data, n_bytes)) = first_record(&bytes) {
                prop_assert_eq!(header.len() + data.len() + 8, n_bytes);
            }
        }
    }

    #[test]
    fn a_field_is_found_by_its_whole_name() {
        let fields =
            [&[6, 0, 0, 0][..], b"conn=1", &[7, 0, 0, 0], b"connx=2", &[3, 0, 0, 0], b"a==", &[255; 4]];
        let fields = fields.concat();
        assert_eq!(field(&fields, b"conn"), Some(&b"1"[..]));
        assert_eq!(field(&fields, b"connx"), Some(&b"2"[..]));
        assert_eq!(field(&fields, b"a"), Some(&b"="[..]));
        assert_eq!(field(&fields, b"op"), None, "the last length lies");
    }
}
