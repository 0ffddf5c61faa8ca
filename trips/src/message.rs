//! Messages as they stand on the wire, in plain CDR or as ROS 1 has them, and those that give poses and commands.
//!
//! The structures mirror the wire: fields in its order. Strings are read as the bytes they lie in, with their closing
//! zero, so that nothing is copied and a `frame_id` that is not UTF-8 stops nobody; they are written as `&str`.

use byteorder::{BigEndian, LittleEndian};
use serde::{Deserialize, Serialize, Serializer};

use crate::catalogue::{CommandType, Encoding, PoseType};
use crate::{Command, MessageFault, Pose, Stamp, ros1};

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

/// How programs fare: one status for each.
#[derive(Serialize)]
pub(crate) struct DiagnosticArrayMessage<'a> {
    pub(crate) header: Header<&'a str>,
    pub(crate) statuses: Vec<DiagnosticStatus<'a>>,
}

/// A program, and what it says of itself.
#[derive(Serialize)]
pub(crate) struct DiagnosticStatus<'a> {
    pub(crate) level: u8,
    pub(crate) name: &'a str,
    pub(crate) message: &'a str,
    pub(crate) hardware_id: &'a str,
    pub(crate) values: Vec<KeyValue<'a>>,
}

/// One thing that a program says of itself.
#[derive(Serialize)]
pub(crate) struct KeyValue<'a> {
    pub(crate) key: &'a str,
    pub(crate) value: &'a str,
}

/// A command without a time.
#[derive(Deserialize)]
pub(crate) struct TwistMessage {
    pub(crate) twist: [f64; 6],
}

/// A row of numbers: one dimension.
#[derive(Serialize)]
pub(crate) struct Float64MultiArrayMessage<'a> {
    pub(crate) dimensions: Vec<ArrayDimension<&'a str>>,
    pub(crate) data_offset: u32,
    pub(crate) data: &'a [f64],
}

/// Numbers in rows and columns, or however many dimensions there are.
#[derive(Deserialize)]
pub(crate) struct Float32MultiArrayMessage<S> {
    pub(crate) dimensions: Vec<ArrayDimension<S>>,
    pub(crate) data_offset: u32,
    pub(crate) data: Vec<f32>,
}

#[derive(Serialize, Deserialize)]
pub(crate) struct ArrayDimension<S> {
    pub(crate) label: S,
    pub(crate) size: u32,
    pub(crate) stride: u32,
}

/// One distance. In newer versions of ROS 2 a variance follows, which is not read.
#[derive(Deserialize)]
pub(crate) struct RangeMessage<S> {
    pub(crate) header: Header<S>,
    pub(crate) _radiation_type: u8,
    pub(crate) _field_of_view: f32,
    pub(crate) range_min: f32,
    pub(crate) range_max: f32,
    pub(crate) range: f32,
}

#[derive(Deserialize)]
pub(crate) struct CompressedImageMessage<'a, S> {
    pub(crate) header: Header<S>,
    pub(crate) format: S,
    #[serde(borrow)]
    pub(crate) data: &'a [u8],
}

#[derive(Deserialize)]
pub(crate) struct PointCloud2Message<'a, S> {
    pub(crate) header: Header<S>,
    pub(crate) height: u32,
    pub(crate) width: u32,
    pub(crate) fields: Vec<PointField<S>>,
    pub(crate) is_bigendian: u8,
    pub(crate) point_step: u32,
    pub(crate) row_step: u32,
    #[serde(borrow)]
    pub(crate) data: &'a [u8],
}

#[derive(Deserialize)]
pub(crate) struct PointField<S> {
    pub(crate) name: S,
    pub(crate) offset: u32,
    pub(crate) datatype: u8,
    pub(crate) _count: u32,
}

/// As one run of bytes: serde would write a slice element by element.
fn as_bytes<S: Serializer>(data: &[u8], serializer: S) -> Result<S::Ok, S::Error> {
    serializer.serialize_bytes(data)
}

/// Reads a pose: when, if the message says so, and where, if it says a place (see
/// [`Pose::from_position_orientation`]).
pub(crate) fn read_pose(
    pose_type: PoseType,
    encoding: Encoding,
    data: &[u8],
) -> Result<(Option<Stamp>, Option<Pose>), MessageFault> {
    let (header, position_m, orientation_xyzw) = match pose_type {
        PoseType::Odometry => {
            let odometry: OdometryMessage<&[u8]> = decode(encoding, data)?;
            (odometry.header, odometry.position_m, odometry.orientation_xyzw)
        }
        PoseType::PoseStamped => {
            let pose: PoseStampedMessage<&[u8]> = decode(encoding, data)?;
            (pose.header, pose.position_m, pose.orientation_xyzw)
        }
    };
    Ok((stamp(&header), Pose::from_position_orientation(position_m, orientation_xyzw)))
}

/// Reads a command: when it was given, if the message says so, and what, if it says a velocity (see
/// [`Command::from_twist`]).
pub(crate) fn read_command(
    command_type: CommandType,
    encoding: Encoding,
    data: &[u8],
) -> Result<(Option<Stamp>, Option<Command>), MessageFault> {
    let (at, twist) = match command_type {
        CommandType::Twist => (None, decode::<TwistMessage>(encoding, data)?.twist),
        CommandType::TwistStamped => {
            let command: TwistStampedMessage<&[u8]> = decode(encoding, data)?;
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

/// Reads a message.
pub(crate) fn decode<'a, T: Deserialize<'a>>(encoding: Encoding, data: &'a [u8]) -> Result<T, MessageFault> {
    let cut_short = || MessageFault::CutShort { n_bytes: data.len() };
    if encoding == Encoding::Ros1 {
        return ros1::from_bytes(data).ok_or_else(cut_short);
    }
    let (&[high, low, _, _], body) = data.split_first_chunk::<4>().ok_or_else(cut_short)?;
    let decoded = match u16::from_be_bytes([high, low]) {
        0 => cdr_encoding::from_bytes::<T, BigEndian>(body),
        1 => cdr_encoding::from_bytes::<T, LittleEndian>(body),
        kind => return Err(MessageFault::Encapsulation { kind }),
    };
    // Integers, floats and bytes take every value, so all that can be wrong is that there are too few bytes.
    decoded.map(|(message, _n_bytes)| message).map_err(|_| cut_short())
}

/// The stamp of a message that begins with a header; `None` if nobody set it, or there is none.
pub(crate) fn header_stamp(encoding: Encoding, data: &[u8]) -> Option<Stamp> {
    decode::<Header<&[u8]>>(encoding, data).ok().and_then(|header| stamp(&header))
}

/// What a string of a message says: without the closing zero that it has in CDR.
pub(crate) fn unterminated(string: &[u8]) -> &[u8] {
    string.strip_suffix(b"\0").unwrap_or(string)
}

pub(crate) fn stamp<S>(header: &Header<S>) -> Option<Stamp> {
    let is_set = header.sec != 0 || header.nanosec != 0;
    is_set.then(|| Stamp::from_sec_nsec(header.sec, header.nanosec))
}
