//! What tests need: a domain of their own, and a view of this process's memory.

use std::ops::{Deref, Range};
use std::path::PathBuf;

use crate::channel::{Channel, Purpose};
use crate::{Domain, FrameHeader};

/// A domain that no other test knows, removed with all its files at the end.
pub(crate) struct TestDomain {
    domain: Domain,
    _folder: tempfile::TempDir,
}

impl TestDomain {
    pub(crate) fn new() -> Self {
        let folder = tempfile::Builder::new().prefix("k").tempdir_in("/tmp").unwrap();
        Self { domain: Domain::in_folder(folder.path()), _folder: folder }
    }

    pub(crate) fn frames_channel(&self, sensor: &str) -> Channel {
        Channel { sensor: sensor.parse().unwrap(), purpose: Purpose::Frames, root: self.domain.root.clone() }
    }

    /// Size of everything that this domain has in shared memory.
    pub(crate) fn shared_memory_bytes(&self) -> u64 {
        self.shared_files().iter().map(|path| std::fs::metadata(path).unwrap().len()).sum()
    }

    fn shared_files(&self) -> Vec<PathBuf> {
        std::fs::read_dir("/dev/shm")
            .unwrap()
            .map(|entry| entry.unwrap().path())
            .filter(|path| path.file_name().unwrap().to_string_lossy().starts_with(&self.domain.prefix))
            .collect()
    }
}

impl Deref for TestDomain {
    type Target = Domain;

    fn deref(&self) -> &Domain {
        &self.domain
    }
}

impl Drop for TestDomain {
    fn drop(&mut self) {
        self.domain.remove_remains().unwrap();
    }
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
