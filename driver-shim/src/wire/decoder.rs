//! Parts among bytes that may be anything.

use std::ops::Range;

use kinds_trips::FrameLayout;

use super::part::{HEADER_BYTES, MAGIC, Part, READINGS_MAX, counts_are_sound, n_bytes};

/// Longest datagram: what room there always is after [`Decoder::clear`].
const DATAGRAM_BYTES: usize = 65_536;

/// Finds parts in bytes as they come. Holds about two of them, never more.
pub(crate) struct Decoder {
    layout: FrameLayout,
    buffer: Vec<u8>,
    /// Bytes that came and are not yet looked at.
    waiting: Range<usize>,
    /// Counts of the part that was found last.
    counts: Range<usize>,
    /// Bytes to come of a part that is not for us.
    n_to_skip: usize,
}

#[derive(Debug, PartialEq, Eq)]
pub(crate) enum Found {
    /// A part of our layout, whole: its counts are [`Decoder::counts`].
    Part(Part),
    /// A part of another layout.
    Foreign(Part),
    /// So many bytes of no part.
    Noise(usize),
}

impl Decoder {
    pub(crate) fn new(layout: FrameLayout) -> Self {
        let part_bytes = n_bytes(layout.n_readings().min(READINGS_MAX));
        let buffer = vec![0; DATAGRAM_BYTES + part_bytes];
        Self { layout, buffer, waiting: 0..0, counts: 0..0, n_to_skip: 0 }
    }

    /// Room for the next bytes, never none once [`Self::next`] has found no more. Forgets the last part's counts.
    pub(crate) fn room(&mut self) -> &mut [u8] {
        self.buffer.copy_within(self.waiting.clone(), 0);
        self.waiting = 0..self.waiting.len();
        self.counts = 0..0;
        &mut self.buffer[self.waiting.end..]
    }

    /// So many bytes have come into the room.
    pub(crate) fn came(&mut self, n_bytes: usize) {
        self.waiting.end += n_bytes;
    }

    /// Forgets what has begun and will not go on; returns how many bytes those were.
    pub(crate) fn clear(&mut self) -> usize {
        self.n_to_skip = 0;
        std::mem::take(&mut self.waiting).len()
    }

    /// Counts of the part that was found last, as they were sent.
    pub(crate) fn counts(&self) -> &[u8] {
        &self.buffer[self.counts.clone()]
    }

    /// The next that is found; `None` when more bytes are needed.
    pub(crate) fn next(&mut self) -> Option<Found> {
        let n_skipped = self.n_to_skip.min(self.waiting.len());
        self.waiting.start += n_skipped;
        self.n_to_skip -= n_skipped;
        let waiting = &self.buffer[self.waiting.clone()];
        let n_noise = bytes_before_magic(waiting);
        if n_noise > 0 {
            return Some(self.pass_noise(n_noise));
        }
        let header = waiting.first_chunk::<HEADER_BYTES>()?;
        let Some(part) = Part::decode(header) else { return Some(self.pass_noise(1)) };
        if !part.is_of(self.layout) {
            self.n_to_skip = part.n_bytes();
            return Some(Found::Foreign(part));
        }
        if !part.fits() {
            return Some(self.pass_noise(HEADER_BYTES));
        }
        let whole = waiting.get(..part.n_bytes())?;
        let n_counts_bytes = 2 * usize::from(part.n_readings);
        let (counts, check) = whole[HEADER_BYTES..].split_at(n_counts_bytes);
        if !counts_are_sound(counts, check) {
            // The next part may have begun where bytes of this one are missing: only the header is known to be none.
            return Some(self.pass_noise(HEADER_BYTES));
        }
        let start = self.waiting.start + HEADER_BYTES;
        self.counts = start..start + n_counts_bytes;
        self.waiting.start += part.n_bytes();
        Some(Found::Part(part))
    }

    fn pass_noise(&mut self, n_bytes: usize) -> Found {
        self.waiting.start += n_bytes;
        Found::Noise(n_bytes)
    }
}

/// How many bytes come before the magic, or before what may be its beginning at the end.
fn bytes_before_magic(bytes: &[u8]) -> usize {
    let begins_at = |at: usize| {
        let here = &bytes[at..bytes.len().min(at + MAGIC.len())];
        MAGIC.starts_with(here)
    };
    (0..bytes.len()).find(|&at| begins_at(at)).unwrap_or(bytes.len())
}
