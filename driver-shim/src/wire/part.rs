//! One part of a frame, as bytes.

use kinds_trips::FrameLayout;

/// Most readings in one part: with them it still fits a UDP datagram.
pub const READINGS_MAX: usize = 32_000;

pub(crate) const MAGIC: [u8; 4] = *b"KIND";
pub(crate) const VERSION: u16 = 1;
/// Of the header, its check included.
pub(crate) const HEADER_BYTES: usize = 40;
const CHECK_BYTES: usize = 4;
const CHECKED_HEADER_BYTES: usize = HEADER_BYTES - CHECK_BYTES;

/// What a part says of itself: the fields of the table above, between magic and counts.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Part {
    /// Readings in this part.
    pub n_readings: u16,
    /// Rows of the frame.
    pub rows: u32,
    /// Readings in a row of the frame.
    pub columns: u32,
    /// What one count stands for.
    pub nanometres_per_count: u32,
    /// The device's number of the frame.
    pub sequence: u32,
    /// When it was captured, nanoseconds since 1970; 0 if the device does not know.
    pub captured_ns: i64,
    /// Where the part begins in the frame.
    pub first_reading: u32,
}

impl Part {
    /// Calls a function with the bytes of each part of a frame, of at most `n_readings_most` readings each.
    ///
    /// * `counts` — `(n_readings,)`, the whole frame
    ///
    /// ```
    /// use kinds_driver_shim::wire::Part;
    ///
    /// let layout = kinds_trips::FrameLayout { rows: 1, columns: 5, metres_per_count: 0.001 };
    /// let mut lengths = Vec::new();
    /// Part::each_of_frame(layout, 7, 0, &[10, 20, 30, 40, 50], 3, |bytes| lengths.push(bytes.len()));
    /// assert_eq!(lengths, [40 + 2 * 3 + 4, 40 + 2 * 2 + 4]);
    /// ```
    pub fn each_of_frame(
        layout: FrameLayout,
        sequence: u32,
        captured_ns: i64,
        counts: &[u16],
        n_readings_most: usize,
        mut send: impl FnMut(&[u8]),
    ) {
        let most = n_readings_most.clamp(1, READINGS_MAX);
        let mut bytes = Vec::new();
        for (index, counts) in counts.chunks(most).enumerate() {
            let part = Self {
                n_readings: counts.len() as u16,
                rows: layout.rows,
                columns: layout.columns,
                nanometres_per_count: nanometres(layout.metres_per_count),
                sequence,
                captured_ns,
                first_reading: (index * most) as u32,
            };
            bytes.clear();
            part.encode(counts, &mut bytes);
            send(&bytes);
        }
    }

    /// Appends the part's bytes.
    ///
    /// * `counts` — `(n_readings,)`, those of this part
    pub fn encode(&self, counts: &[u16], bytes: &mut Vec<u8>) {
        let start = bytes.len();
        bytes.extend(MAGIC);
        bytes.extend(VERSION.to_le_bytes());
        bytes.extend(self.n_readings.to_le_bytes());
        bytes.extend(self.rows.to_le_bytes());
        bytes.extend(self.columns.to_le_bytes());
        bytes.extend(self.nanometres_per_count.to_le_bytes());
        bytes.extend(self.sequence.to_le_bytes());
        bytes.extend(self.captured_ns.to_le_bytes());
        bytes.extend(self.first_reading.to_le_bytes());
        let check = crc32fast::hash(&bytes[start..]);
        bytes.extend(check.to_le_bytes());
        let counts_start = bytes.len();
        bytes.extend(counts.iter().flat_map(|count| count.to_le_bytes()));
        let check = crc32fast::hash(&bytes[counts_start..]);
        bytes.extend(check.to_le_bytes());
    }

    /// What a header says; `None` if it is none, or not as it was sent.
    pub(crate) fn decode(header: &[u8; HEADER_BYTES]) -> Option<Self> {
        let (checked, check) = header.split_at(CHECKED_HEADER_BYTES);
        let is_sound = checked.starts_with(&MAGIC) && u16_at(header, 4) == VERSION;
        if !is_sound || crc32fast::hash(checked).to_le_bytes() != check {
            return None;
        }
        let captured = header[24..32].try_into().expect("eight bytes");
        Some(Self {
            n_readings: u16_at(header, 6),
            rows: u32_at(header, 8),
            columns: u32_at(header, 12),
            nanometres_per_count: u32_at(header, 16),
            sequence: u32_at(header, 20),
            captured_ns: i64::from_le_bytes(captured),
            first_reading: u32_at(header, 32),
        })
    }

    /// Bytes of header, counts and checks.
    pub(crate) fn n_bytes(&self) -> usize {
        n_bytes(usize::from(self.n_readings))
    }

    pub(crate) fn is_of(&self, layout: FrameLayout) -> bool {
        self.rows == layout.rows
            && self.columns == layout.columns
            && self.nanometres_per_count == nanometres(layout.metres_per_count)
    }

    /// Whether it lies within its frame.
    pub(crate) fn fits(&self) -> bool {
        let n_readings = u64::from(self.rows) * u64::from(self.columns);
        self.n_readings > 0
            && usize::from(self.n_readings) <= READINGS_MAX
            && u64::from(self.first_reading) + u64::from(self.n_readings) <= n_readings
    }
}

/// Bytes of a part of so many readings.
pub(crate) fn n_bytes(n_readings: usize) -> usize {
    HEADER_BYTES + 2 * n_readings + CHECK_BYTES
}

/// The unit as it is sent. A float would ask boards for arithmetic that small ones do not have.
pub(crate) fn nanometres(metres_per_count: f64) -> u32 {
    (metres_per_count * 1e9).round() as u32
}

/// Whether counts as they were sent are as their check says.
pub(crate) fn counts_are_sound(counts: &[u8], check: &[u8]) -> bool {
    crc32fast::hash(counts).to_le_bytes() == check
}

fn u16_at(bytes: &[u8], at: usize) -> u16 {
    u16::from_le_bytes([bytes[at], bytes[at + 1]])
}

fn u32_at(bytes: &[u8], at: usize) -> u32 {
    u32::from_le_bytes(bytes[at..at + 4].try_into().expect("four bytes"))
}
