//! Depth images as `compressed_depth_image_transport` sends them: twelve bytes of its own, then a PNG of 16 bits.
//!
//! Of `16UC1` the PNG has the pixels, millimetres. Of `32FC1` it has `a / depth + b`, rounded, where a and b are in those
//! twelve bytes and 0 stands for no depth. What of a message is read of is bounded: a PNG is decoded row by row.

use std::io::Cursor;

use crate::MessageFault;
use crate::catalogue::Encoding;
use crate::counts::{INVALID, Unit};
use crate::frame_message::{FrameHead, quoted};
use crate::message::{CompressedImageMessage, decode, stamp, unterminated};
use crate::record::Fields;

/// Readings of a frame: a PNG of few bytes can claim, and have, any number.
const MAX_READINGS: u64 = 16 << 20;

/// Memory that the decoder may take: a few rows.
const MAX_DECODER_BYTES: usize = 8 << 20;

/// How a pixel becomes a distance.
#[derive(Clone, Copy)]
enum Depth {
    Millimetres,
    /// a and b of `pixel = a / metres + b`.
    Inverse(f32, f32),
}

/// Reads a compressed depth image into `counts`, which is cleared first.
pub(crate) fn read_compressed_depth(
    encoding: Encoding,
    data: &[u8],
    unit: Unit,
    counts: &mut Vec<u16>,
) -> Result<FrameHead, MessageFault> {
    let image: CompressedImageMessage<'_, &[u8]> = decode(encoding, data)?;
    let cut_short = || MessageFault::CutShort { n_bytes: data.len() };
    let mut fields = Fields(image.data);
    let format = unterminated(image.format);
    let other = || MessageFault::CompressedFormat { format: quoted(format) };
    let is_png = contains(format, b"compressedDepth") && !contains(format, b"rvl");
    let depth = match format {
        _ if !is_png => return Err(other()),
        _ if format.starts_with(b"16UC1") => {
            fields.take(12).ok_or_else(cut_short)?;
            Depth::Millimetres
        }
        _ if format.starts_with(b"32FC1") => {
            fields.take(4).ok_or_else(cut_short)?;
            let mut next = || fields.array().map(f32::from_le_bytes).ok_or_else(cut_short);
            Depth::Inverse(next()?, next()?)
        }
        _ => return Err(other()),
    };
    let (rows, columns) = read_png(fields.0, counts, |pixel| match depth {
        Depth::Millimetres => unit.count_of_millimetres(pixel),
        Depth::Inverse(..) if pixel == 0 => INVALID,
        Depth::Inverse(a, b) => unit.count_of_metres(a / (f32::from(pixel) - b), u16::MAX),
    })?;
    Ok(FrameHead { captured: stamp(&image.header), rows, columns })
}

fn contains(text: &[u8], part: &[u8]) -> bool {
    text.windows(part.len()).any(|window| window == part)
}

fn read_png(
    bytes: &[u8],
    counts: &mut Vec<u16>,
    count: impl Fn(u16) -> u16,
) -> Result<(u32, u32), MessageFault> {
    let fault = |error: png::DecodingError| MessageFault::Png { what: error.to_string() };
    let mut decoder =
        png::Decoder::new_with_limits(Cursor::new(bytes), png::Limits { bytes: MAX_DECODER_BYTES });
    decoder.ignore_checksums(false);
    decoder.set_ignore_text_chunk(true);
    let mut reader = decoder.read_info().map_err(fault)?;
    let (columns, rows) = reader.info().size();
    if u64::from(rows) * u64::from(columns) > MAX_READINGS {
        return Err(MessageFault::TooManyReadings { rows, columns, limit: MAX_READINGS });
    }
    if reader.output_color_type() != (png::ColorType::Grayscale, png::BitDepth::Sixteen) {
        let (color, depth) = reader.output_color_type();
        return Err(MessageFault::Png {
            what: format!("it has {depth:?} bits of {color:?}, not 16 of grey"),
        });
    }
    counts.clear();
    while let Some(row) = reader.next_row().map_err(fault)? {
        let (pixels, _rest) = row.data().as_chunks::<2>();
        counts.extend(pixels.iter().map(|&pixel| count(u16::from_be_bytes(pixel))));
    }
    if counts.len() as u64 != u64::from(rows) * u64::from(columns) {
        return Err(MessageFault::Png {
            what: "it has fewer rows than it says, or is interlaced".to_owned(),
        });
    }
    Ok((rows, columns))
}
