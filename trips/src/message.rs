//! ROS 2 messages to counts, poses and commands, and back: `LaserScan`, `Image`, `Odometry`, `PoseStamped`, `Twist` and
//! `TwistStamped` in plain CDR.
//!
//! The structures mirror the wire: fields in its order. Strings are read as the bytes they lie in, with their closing
//! zero, so that nothing is copied and a `frame_id` that is not UTF-8 stops nobody; they are written as `&str`.

use byteorder::{BigEndian, LittleEndian};
use serde::{Deserialize, Serialize, Serializer};

use crate::catalogue::{CommandType, PoseType};
use crate::counts::{RangeLimits, Unit};
use crate::{Command, MessageFault, Pose, Stamp};

#[derive(Serialize, Deserialize)]
pub(crate) struct Header<S> {
    pub(crate) sec: i32,
    pub(crate) nanosec: u32,
    pub(crate) frame_id: S,
}

#[derive(Serialize, Deserialize)]
pub(crate) struct LaserScanMessage<S> {
    pub(crate) header: Header<S>,
    pub(crate) angle_min: f32,
    pub(crate) angle_max: f32,
    pub(crate) angle_increment: f32,
    pub(crate) time_increment: f32,
    pub(crate) scan_time: f32,
    pub(crate) range_min: f32,
    pub(crate) range_max: f32,
    pub(crate) ranges: Vec<f32>,
    pub(crate) intensities: Vec<f32>,
}

#[derive(Serialize, Deserialize)]
pub(crate) struct ImageMessage<'a, S> {
    pub(crate) header: Header<S>,
    pub(crate) height: u32,
    pub(crate) width: u32,
    pub(crate) encoding: S,
    pub(crate) is_bigendian: u8,
    pub(crate) step: u32,
    #[serde(borrow, serialize_with = "as_bytes")]
    pub(crate) data: &'a [u8],
}

/// Fixed-size arrays stand on the wire as their elements, so a point is three numbers and a covariance six times six.
#[derive(Serialize, Deserialize)]
pub(crate) struct OdometryMessage<S> {
    pub(crate) header: Header<S>,
    pub(crate) child_frame_id: S,
    pub(crate) position_m: [f64; 3],
    pub(crate) orientation_xyzw: [f64; 4],
    pub(crate) pose_covariance: [[f64; 6]; 6],
    pub(crate) twist: [f64; 6],
    pub(crate) twist_covariance: [[f64; 6]; 6],
}

#[derive(Serialize, Deserialize)]
pub(crate) struct PoseStampedMessage<S> {
    pub(crate) header: Header<S>,
    pub(crate) position_m: [f64; 3],
    pub(crate) orientation_xyzw: [f64; 4],
}

/// Velocities, linear and angular: six numbers on the wire.
#[derive(Serialize, Deserialize)]
pub(crate) struct TwistStampedMessage<S> {
    pub(crate) header: Header<S>,
    pub(crate) twist: [f64; 6],
}

/// The same without a time.
#[derive(Deserialize)]
pub(crate) struct TwistMessage {
    pub(crate) twist: [f64; 6],
}

/// A row of numbers: one dimension.
#[derive(Serialize)]
pub(crate) struct Float64MultiArrayMessage<'a> {
    pub(crate) dimensions: Vec<ArrayDimension<'a>>,
    pub(crate) data_offset: u32,
    pub(crate) data: &'a [f64],
}

#[derive(Serialize)]
pub(crate) struct ArrayDimension<'a> {
    pub(crate) label: &'a str,
    pub(crate) size: u32,
    pub(crate) stride: u32,
}

/// As one run of bytes: serde would write a slice element by element.
fn as_bytes<S: Serializer>(data: &[u8], serializer: S) -> Result<S::Ok, S::Error> {
    serializer.serialize_bytes(data)
}

/// What a message says about the frame in it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct FrameHead {
    /// `None`: the message has stamp zero, which means that nobody set it.
    pub(crate) captured: Option<Stamp>,
    pub(crate) rows: u32,
    pub(crate) columns: u32,
}

/// Reads a laser scan's ranges into `counts`, which is cleared first.
pub(crate) fn read_laser_scan(
    data: &[u8],
    unit: Unit,
    counts: &mut Vec<u16>,
) -> Result<FrameHead, MessageFault> {
    let scan: LaserScanMessage<&[u8]> = decode(data)?;
    // A message is read from at most 256 MiB.
    let columns = scan.ranges.len() as u32;
    if columns == 0 {
        return Err(MessageFault::NoReadings { rows: 1, columns });
    }
    let limits = RangeLimits { range_m_min: scan.range_min, range_m_max: scan.range_max };
    let no_return = unit.no_return(scan.range_max);
    counts.clear();
    counts.extend(scan.ranges.iter().map(|&range_m| {
        if limits.exclude(range_m) {
            crate::counts::INVALID
        } else {
            unit.count_of_metres(range_m, no_return)
        }
    }));
    Ok(FrameHead { captured: stamp(&scan.header), rows: 1, columns })
}

/// Reads a depth image's pixels into `counts`, which is cleared first.
pub(crate) fn read_image(data: &[u8], unit: Unit, counts: &mut Vec<u16>) -> Result<FrameHead, MessageFault> {
    let image: ImageMessage<'_, &[u8]> = decode(data)?;
    let encoding = image.encoding.strip_suffix(b"\0").unwrap_or(image.encoding);
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
            let encoding = String::from_utf8_lossy(other).chars().take(32).collect();
            return Err(MessageFault::Encoding { encoding });
        }
    }
    Ok(FrameHead { captured: stamp(&image.header), rows: image.height, columns: image.width })
}

/// Reads a pose: when, if the message says so, and where, if it says a place (see
/// [`Pose::from_position_orientation`]).
pub(crate) fn read_pose(
    pose_type: PoseType,
    data: &[u8],
) -> Result<(Option<Stamp>, Option<Pose>), MessageFault> {
    let (header, position_m, orientation_xyzw) = match pose_type {
        PoseType::Odometry => {
            let odometry: OdometryMessage<&[u8]> = decode(data)?;
            (odometry.header, odometry.position_m, odometry.orientation_xyzw)
        }
        PoseType::PoseStamped => {
            let pose: PoseStampedMessage<&[u8]> = decode(data)?;
            (pose.header, pose.position_m, pose.orientation_xyzw)
        }
    };
    Ok((stamp(&header), Pose::from_position_orientation(position_m, orientation_xyzw)))
}

/// Reads a command: when it was given, if the message says so, and what, if it says a velocity (see
/// [`Command::from_twist`]).
pub(crate) fn read_command(
    command_type: CommandType,
    data: &[u8],
) -> Result<(Option<Stamp>, Option<Command>), MessageFault> {
    let (at, twist) = match command_type {
        CommandType::Twist => (None, decode::<TwistMessage>(data)?.twist),
        CommandType::TwistStamped => {
            let command: TwistStampedMessage<&[u8]> = decode(data)?;
            (stamp(&command.header), command.twist)
        }
    };
    Ok((at, Command::from_twist(twist)))
}

/// A message in little-endian CDR.
pub(crate) fn encode(message: &impl Serialize) -> Vec<u8> {
    let mut bytes = vec![0, 1, 0, 0];
    cdr_encoding::to_writer::<_, LittleEndian, _>(&mut bytes, message)
        .expect("memory takes every byte, and every sequence here knows its length");
    bytes
}

fn decode<'a, T: Deserialize<'a>>(data: &'a [u8]) -> Result<T, MessageFault> {
    let cut_short = || MessageFault::CutShort { n_bytes: data.len() };
    let (&[high, low, _, _], body) = data.split_first_chunk::<4>().ok_or_else(cut_short)?;
    let decoded = match u16::from_be_bytes([high, low]) {
        0 => cdr_encoding::from_bytes::<T, BigEndian>(body),
        1 => cdr_encoding::from_bytes::<T, LittleEndian>(body),
        kind => return Err(MessageFault::Encapsulation { kind }),
    };
    // Integers, floats and bytes take every value, so all that can be wrong is that there are too few bytes.
    decoded.map(|(message, _n_bytes)| message).map_err(|_| cut_short())
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

fn stamp<S>(header: &Header<S>) -> Option<Stamp> {
    let is_set = header.sec != 0 || header.nanosec != 0;
    is_set.then(|| Stamp::from_sec_nsec(header.sec, header.nanosec))
}
