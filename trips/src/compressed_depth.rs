//! Depth images as `compressed_depth_image_transport` sends them: twelve bytes of its own, then 16 bits a pixel as PNG or RVL.
//!
//! Of `16UC1` these are the pixels, millimetres. Of `32FC1` they are `a / depth + b`, rounded, where a and b are in those
//! twelve bytes and 0 stands for no depth. What of a message is read of is bounded: images are decoded straight into counts.

use std::io::Cursor;

use crate::MessageFault;
use crate::catalogue::Encoding;
use crate::counts::{INVALID, Unit};
use crate::frame_message::{FrameHead, quoted};
use crate::message::{CompressedImageMessage, decode, stamp, unterminated};
use crate::record::Fields;
use crate::rvl::Rvl;

/// Readings of a frame: an image of few bytes can claim, and have, any number.
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

/// What the pixels are written as.
#[derive(Clone, Copy)]
enum Coding {
    Png,
    Rvl,
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
    let coding = coding(format).ok_or_else(other)?;
    let depth = match format {
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
    let count = |pixel| match depth {
        Depth::Millimetres => unit.count_of_millimetres(pixel),
        Depth::Inverse(..) if pixel == 0 => INVALID,
        Depth::Inverse(a, b) => unit.count_of_metres(a / (f32::from(pixel) - b), u16::MAX),
    };
    let (rows, columns) = match coding {
        Coding::Png => read_png(fields.0, counts, count)?,
        Coding::Rvl => read_rvl(Rvl::parse(fields.0).ok_or_else(cut_short)?, counts, count)?,
    };
    Ok(FrameHead { captured: stamp(&image.header), rows, columns })
}

/// What a format, such as `16UC1; compressedDepth rvl`, says of the coding: nothing, where it was written when there was but one.
fn coding(format: &[u8]) -> Option<Coding> {
    let name = b"compressedDepth";
    let at = format.windows(name.len()).position(|window| window == name)?;
    match format[at + name.len()..].trim_ascii() {
        b"" | b"png" => Some(Coding::Png),
        b"rvl" => Some(Coding::Rvl),
        _ => None,
    }
}

fn read_rvl(
    image: Rvl<'_>,
    counts: &mut Vec<u16>,
    count: impl Fn(u16) -> u16,
) -> Result<(u32, u32), MessageFault> {
    let Rvl { rows, columns, .. } = image;
    check_size(rows, columns)?;
    counts.clear();
    image.decode(|pixel| counts.push(count(pixel))).map_err(|what| MessageFault::Rvl { what })?;
    Ok((rows, columns))
}

fn check_size(rows: u32, columns: u32) -> Result<(), MessageFault> {
    match u64::from(rows) * u64::from(columns) {
        0 => Err(MessageFault::NoReadings { rows, columns }),
        1..=MAX_READINGS => Ok(()),
        _ => Err(MessageFault::TooManyReadings { rows, columns, limit: MAX_READINGS }),
    }
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
    check_size(rows, columns)?;
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
