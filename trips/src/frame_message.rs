//! Frames as messages have them, to counts: `LaserScan`, `Range`, `Image`, `Float32MultiArray`; `PointCloud2` and
//! compressed depth have modules of their own.

use crate::catalogue::{Encoding, FrameType};
use crate::compressed_depth::read_compressed_depth;
use crate::counts::{INVALID, RangeLimits, Unit};
use crate::message::{
    Float32MultiArrayMessage, ImageMessage, LaserScanMessage, RangeMessage, decode, stamp, unterminated,
};
use crate::point_cloud::read_point_cloud;
use crate::{FrameLayout, MessageFault, Stamp};

/// What a message says about the frame in it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct FrameHead {
    /// `None`: the message has stamp zero, which means that nobody set it.
    pub(crate) captured: Option<Stamp>,
    pub(crate) rows: u32,
    pub(crate) columns: u32,
}

impl FrameHead {
    /// How the frame's readings lie, in a unit.
    pub(crate) fn layout(&self, unit: Unit) -> FrameLayout {
        FrameLayout { rows: self.rows, columns: self.columns, metres_per_count: unit.metres_per_count() }
    }
}

/// Reads the counts of a frame into `counts`, which is cleared first.
pub(crate) fn read_frame(
    frame_type: FrameType,
    encoding: Encoding,
    data: &[u8],
    unit: Unit,
    counts: &mut Vec<u16>,
) -> Result<FrameHead, MessageFault> {
    match frame_type {
        FrameType::LaserScan => read_laser_scan(encoding, data, unit, counts),
        FrameType::Image => read_image(encoding, data, unit, counts),
        FrameType::PointCloud2 => read_point_cloud(encoding, data, unit, counts),
        FrameType::CompressedImage => read_compressed_depth(encoding, data, unit, counts),
        FrameType::Float32MultiArray => read_array(encoding, data, unit, counts),
        FrameType::Range => {
            let Range { captured, count, .. } = read_range(encoding, data, unit)?;
            counts.clear();
            counts.push(count);
            Ok(FrameHead { captured, rows: 1, columns: 1 })
        }
    }
}

/// One distance, of one sensor.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Range<'a> {
    /// `None`: nobody set it.
    pub(crate) captured: Option<Stamp>,
    pub(crate) count: u16,
    /// The sensor's own frame of reference.
    pub(crate) frame_id: &'a [u8],
}

/// Reads a laser scan's ranges into `counts`, which is cleared first.
fn read_laser_scan(
    encoding: Encoding,
    data: &[u8],
    unit: Unit,
    counts: &mut Vec<u16>,
) -> Result<FrameHead, MessageFault> {
    let scan: LaserScanMessage<&[u8]> = decode(encoding, data)?;
    // A message is read from at most 256 MiB.
    let columns = scan.ranges.len() as u32;
    if columns == 0 {
        return Err(MessageFault::NoReadings { rows: 1, columns });
    }
    let limits = RangeLimits { range_m_min: scan.range_min, range_m_max: scan.range_max };
    let no_return = unit.no_return(scan.range_max);
    counts.clear();
    counts.extend(scan.ranges.iter().map(|&range_m| count_within(limits, range_m, no_return, unit)));
    Ok(FrameHead { captured: stamp(&scan.header), rows: 1, columns })
}

/// Reads a depth image's pixels into `counts`, which is cleared first.
fn read_image(
    encoding: Encoding,
    data: &[u8],
    unit: Unit,
    counts: &mut Vec<u16>,
) -> Result<FrameHead, MessageFault> {
    let image: ImageMessage<'_, &[u8]> = decode(encoding, data)?;
    let encoding = unterminated(image.encoding);
    let no_return = u16::MAX;
    let big = image.is_bigendian != 0;
    match encoding {
        b"16UC1" if big => {
            read_pixels(&image, counts, |pixel| unit.count_of_millimetres(u16::from_be_bytes(pixel)))?;
        }
        b"16UC1" => {
            read_pixels(&image, counts, |pixel| unit.count_of_millimetres(u16::from_le_bytes(pixel)))?;
        }
        b"32FC1" if big => {
            read_pixels(&image, counts, |pixel| unit.count_of_metres(f32::from_be_bytes(pixel), no_return))?;
        }
        b"32FC1" => {
            read_pixels(&image, counts, |pixel| unit.count_of_metres(f32::from_le_bytes(pixel), no_return))?;
        }
        other => {
            return Err(MessageFault::Encoding { encoding: quoted(other) });
        }
    }
    Ok(FrameHead { captured: stamp(&image.header), rows: image.height, columns: image.width })
}

/// Reads one distance.
pub(crate) fn read_range(encoding: Encoding, data: &[u8], unit: Unit) -> Result<Range<'_>, MessageFault> {
    let message: RangeMessage<&[u8]> = decode(encoding, data)?;
    let RangeMessage { range_min, range_max, range, .. } = message;
    let limits = RangeLimits { range_m_min: range_min, range_m_max: range_max };
    let count = count_within(limits, range, unit.no_return(range_max), unit);
    let frame_id = unterminated(message.header.frame_id);
    Ok(Range { captured: stamp(&message.header), count, frame_id })
}

/// Reads a row of metres, or rows and columns of them.
fn read_array(
    encoding: Encoding,
    data: &[u8],
    unit: Unit,
    counts: &mut Vec<u16>,
) -> Result<FrameHead, MessageFault> {
    let array: Float32MultiArrayMessage<&[u8]> = decode(encoding, data)?;
    let n_numbers = array.data.len();
    let metres = array.data.get(array.data_offset as usize..).unwrap_or_default();
    // Whoever fills in no dimension, or leaves its size at 0, means a row.
    let row = metres.len() as u32;
    let (rows, columns, step) = match array.dimensions.as_slice() {
        [] => (1, row, row),
        [columns] if columns.size == 0 => (1, row, row),
        [columns] => (1, columns.size, columns.size),
        // From one row to the next it is the stride of what is in a row.
        [rows, columns] => (rows.size, columns.size, columns.stride.max(columns.size)),
        several => return Err(MessageFault::Dimensions { n_dimensions: several.len() }),
    };
    if rows == 0 || columns == 0 {
        return Err(MessageFault::NoReadings { rows, columns });
    }
    let needed = u64::from(rows - 1) * u64::from(step) + u64::from(columns) + u64::from(array.data_offset);
    if (n_numbers as u64) < needed {
        return Err(MessageFault::ArrayTooShort { n_numbers, rows, columns, needed });
    }
    counts.clear();
    for row in metres.chunks(step as usize).take(rows as usize) {
        let readings = &row[..columns as usize];
        counts.extend(readings.iter().map(|&metres| unit.count_of_metres(metres, u16::MAX)));
    }
    Ok(FrameHead { captured: None, rows, columns })
}

fn count_within(limits: RangeLimits, range_m: f32, no_return: u16, unit: Unit) -> u16 {
    if limits.exclude(range_m) { INVALID } else { unit.count_of_metres(range_m, no_return) }
}

/// What a message says, for a sentence.
pub(crate) fn quoted(text: &[u8]) -> String {
    String::from_utf8_lossy(text).chars().take(32).collect()
}

fn read_pixels<const N: usize>(
    image: &ImageMessage<'_, &[u8]>,
    counts: &mut Vec<u16>,
    count: impl Fn([u8; N]) -> u16,
) -> Result<(), MessageFault> {
    let (rows, columns, step) = (image.height, image.width, image.step);
    if rows == 0 || columns == 0 {
        return Err(MessageFault::NoReadings { rows, columns });
    }
    let row_bytes = u64::from(columns) * N as u64;
    if u64::from(step) < row_bytes {
        return Err(MessageFault::RowTooShort {
            step,
            columns,
            bytes_per_pixel: N as u32,
            needed: row_bytes,
        });
    }
    let needed = u64::from(rows) * u64::from(step);
    if (image.data.len() as u64) < needed {
        return Err(MessageFault::DataTooShort { n_bytes: image.data.len(), rows, step, needed });
    }
    counts.clear();
    for row in image.data.chunks_exact(step as usize).take(rows as usize) {
        let (pixels, _rest) = row[..row_bytes as usize].as_chunks::<N>();
        counts.extend(pixels.iter().map(|&pixel| count(pixel)));
    }
    Ok(())
}
