//! What tests need: a view of a domain's and of this process's memory.

use std::ops::Range;

use crate::channel::{Channel, Purpose};
use crate::{Domain, FrameHeader};

/// Asserts that a message's fields lie where the table of all languages says, and that it has no others.
macro_rules! assert_layout {
    ($name:literal, $message:ident, [$($field:ident),*]) => {
        // Names all fields: one that is not in the list does not compile.
        let $message { $($field: _),* } = $message::default();
        let message = $message::default();
        let rows = [
            $(format!(
                "{},{},{},{}\n",
                $name,
                stringify!($field),
                std::mem::offset_of!($message, $field),
                size_of_val(&message.$field)
            ),)*
            format!("{},,0,{}\n", $name, size_of::<$message>()),
        ];
        assert_eq!(rows.concat(), $crate::testing::layout_of($name));
    };
}
pub(crate) use assert_layout;

/// What the table of all languages says of a message.
pub(crate) fn layout_of(name: &str) -> String {
    let table = include_str!("../../consumers/layout.csv").lines();
    let of_it = table.filter(|row| row.split(',').next() == Some(name));
    of_it.map(|row| format!("{row}\n")).collect()
}

/// A channel of frames in a domain.
pub(crate) fn frames_channel(domain: &Domain, sensor: &str) -> Channel {
    Channel {
        sensor: sensor.parse().unwrap(),
        purpose: Purpose::Frames,
        root: domain.root.clone(),
        sweeper: None,
    }
}

/// Size of everything that a domain has in shared memory.
pub(crate) fn shared_memory_bytes(domain: &Domain) -> u64 {
    domain.shared_files().unwrap().iter().map(|path| std::fs::metadata(path).unwrap().len()).sum()
}

/// A header by which a test tells its frames apart.
pub(crate) fn header(sequence: u64) -> FrameHeader {
    FrameHeader { run: 7, sequence, metres_per_count: 0.001, rows: 1, columns: 4, ..FrameHeader::default() }
}

/// Whether a slice lies wholly in memory that this process has mapped from /dev/shm.
pub(crate) fn lies_in_shared_memory(counts: &[u16]) -> bool {
    let slice = counts.as_ptr_range();
    let slice = slice.start as usize..slice.end as usize;
    let maps = std::fs::read_to_string("/proc/self/maps").unwrap();
    maps.lines()
        .filter(|line| line.contains(" /dev/shm/"))
        .map(mapped_range)
        .any(|mapped| mapped.start <= slice.start && slice.end <= mapped.end)
}

fn mapped_range(line: &str) -> Range<usize> {
    let (start, end) = line.split(' ').next().unwrap().split_once('-').unwrap();
    usize::from_str_radix(start, 16).unwrap()..usize::from_str_radix(end, 16).unwrap()
}
