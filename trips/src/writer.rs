//! Writes a trip: frames, poses, commands and diagnostics as standard ROS 2 messages, each with the full text of its definition.

use std::collections::BTreeMap;
use std::fs::File;
use std::path::Path;
use std::sync::Arc;

use mcap::records::MessageHeader;

use crate::bag_file::{BagFile, Channel, ROS2, Schema, WriterOptions};
use crate::catalogue::{
    DIAGNOSTIC_ARRAY, FLOAT64_MULTI_ARRAY, IMAGE, LASER_SCAN, ODOMETRY, POSE_STAMPED, TWIST_STAMPED,
};
use crate::counts::{INVALID, Unit};
use crate::message::{
    ArrayDimension, DiagnosticArrayMessage, DiagnosticStatus, Float64MultiArrayMessage, Header, ImageMessage,
    KeyValue, LaserScanMessage, OdometryMessage, PoseStampedMessage, TwistStampedMessage, encode,
};
use crate::{Command, FrameLayout, Pose, Stamp, TripWriteError};

/// A frame written as `sensor_msgs/msg/LaserScan`: one row of readings, bearings counter-clockwise.
///
/// Count 0 becomes NaN, counts of `range_m_max` and above become +Inf.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Scan<'a> {
    /// `(n_readings,)`, counts.
    pub counts: &'a [u16],
    /// Metres that one count stands for.
    pub metres_per_count: f64,
    /// Bearing of the first reading.
    pub bearing_rad_min: f32,
    /// From one reading's bearing to the next.
    pub bearing_step_rad: f32,
    /// The shortest range the sensor measures.
    pub range_m_min: f32,
    /// The largest range the sensor measures, which stands for no return.
    pub range_m_max: f32,
}

/// A frame written as `sensor_msgs/msg/Image`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Image<'a> {
    /// `(rows, columns)`, counts, row by row.
    pub counts: &'a [u16],
    /// Rows, columns, and the counts' unit.
    pub layout: FrameLayout,
    /// How a pixel is written.
    pub encoding: ImageEncoding,
    /// Whether pixels are written with their most significant byte first.
    pub big_endian: bool,
    /// Bytes added after each row.
    pub row_padding_bytes: u32,
}

/// How a pixel is written.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum ImageEncoding {
    /// `16UC1`: millimetres. Counts of more than 65535 mm become 0.
    Millimetres,
    /// `32FC1`: metres. Count 0 becomes NaN, count 65535 becomes +Inf.
    Metres,
}

/// A trip being written. Messages stand in the file in the order of the calls.
///
/// Dropped without [`finish`](Self::finish), it leaves nothing behind.
pub struct TripWriter {
    bag: BagFile,
    topics: BTreeMap<String, WrittenTopic>,
}

struct WrittenTopic {
    channel_id: u16,
    type_name: &'static str,
    n_messages: u32,
}

impl TripWriter {
    /// Begins a trip that will replace whatever is at `path`.
    ///
    /// # Errors
    ///
    /// The directory does not exist or cannot be written to; `path` is itself a directory.
    pub fn create(path: &Path, options: &WriterOptions) -> Result<TripWriter, TripWriteError> {
        Ok(TripWriter { bag: BagFile::create(path, ROS2, options)?, topics: BTreeMap::new() })
    }

    /// Writes a frame as a laser scan.
    ///
    /// # Errors
    ///
    /// The unit is no positive number; the file cannot be written.
    ///
    /// # Panics
    ///
    /// If the topic has had messages of another type.
    pub fn write_scan(
        &mut self,
        topic: &str,
        captured: Stamp,
        scan: &Scan<'_>,
    ) -> Result<(), TripWriteError> {
        let unit = checked(scan.metres_per_count)?;
        let no_return = unit.no_return(scan.range_m_max);
        let last = scan.counts.len().saturating_sub(1) as f32;
        let message = LaserScanMessage {
            header: header(captured, "sensor"),
            angle_min: scan.bearing_rad_min,
            angle_max: scan.bearing_rad_min + last * scan.bearing_step_rad,
            angle_increment: scan.bearing_step_rad,
            time_increment: 0.0,
            scan_time: 0.0,
            range_min: scan.range_m_min,
            range_max: scan.range_m_max,
            ranges: scan.counts.iter().map(|&count| metres(unit, count, no_return)).collect(),
            intensities: Vec::new(),
        };
        self.write(topic, LASER_SCAN, captured, &encode(&message))
    }

    /// Writes a frame as a depth image.
    ///
    /// # Errors
    ///
    /// The unit is no positive number; the file cannot be written.
    ///
    /// # Panics
    ///
    /// If there are not as many counts as the layout says, or the topic has had messages of another type.
    pub fn write_image(
        &mut self,
        topic: &str,
        captured: Stamp,
        image: &Image<'_>,
    ) -> Result<(), TripWriteError> {
        assert_eq!(image.counts.len(), image.layout.n_readings(), "an image has rows × columns counts");
        let unit = checked(image.layout.metres_per_count)?;
        let (encoding, bytes_per_pixel) = match image.encoding {
            ImageEncoding::Millimetres => ("16UC1", 2),
            ImageEncoding::Metres => ("32FC1", 4),
        };
        let message = ImageMessage {
            header: header(captured, "sensor"),
            height: image.layout.rows,
            width: image.layout.columns,
            encoding,
            is_bigendian: u8::from(image.big_endian),
            step: image.layout.columns * bytes_per_pixel + image.row_padding_bytes,
            data: &pixels(image, unit),
        };
        self.write(topic, IMAGE, captured, &encode(&message))
    }

    /// Writes a pose, from the frame `odom` to `base_link`, without covariance or velocity.
    ///
    /// # Errors
    ///
    /// The file cannot be written.
    ///
    /// # Panics
    ///
    /// If the topic has had messages of another type.
    pub fn write_odometry(&mut self, topic: &str, at: Stamp, pose: &Pose) -> Result<(), TripWriteError> {
        let (position_m, orientation_xyzw) = pose.position_orientation();
        let message = OdometryMessage {
            header: header(at, "odom"),
            child_frame_id: "base_link",
            position_m,
            orientation_xyzw,
            pose_covariance: [[0.0; 6]; 6],
            twist: [0.0; 6],
            twist_covariance: [[0.0; 6]; 6],
        };
        self.write(topic, ODOMETRY, at, &encode(&message))
    }

    /// Writes a pose without odometry, such as the truth to judge odometry by, as `geometry_msgs/msg/PoseStamped` in the
    /// frame `map`.
    ///
    /// # Errors
    ///
    /// The file cannot be written.
    ///
    /// # Panics
    ///
    /// If the topic has had messages of another type.
    pub fn write_pose(&mut self, topic: &str, at: Stamp, pose: &Pose) -> Result<(), TripWriteError> {
        let (position_m, orientation_xyzw) = pose.position_orientation();
        let message = PoseStampedMessage { header: header(at, "map"), position_m, orientation_xyzw };
        self.write(topic, POSE_STAMPED, at, &encode(&message))
    }

    /// Writes what the robot was told to do, as `geometry_msgs/msg/TwistStamped` in the frame `base_link`.
    ///
    /// # Errors
    ///
    /// The file cannot be written.
    ///
    /// # Panics
    ///
    /// If the topic has had messages of another type.
    pub fn write_command(&mut self, topic: &str, at: Stamp, command: &Command) -> Result<(), TripWriteError> {
        let message = TwistStampedMessage { header: header(at, "base_link"), twist: command.twist() };
        self.write(topic, TWIST_STAMPED, at, &encode(&message))
    }

    /// Writes a row of numbers, such as the probability of each kind, as `std_msgs/msg/Float64MultiArray`.
    ///
    /// The message has no stamp: `at` is its time in the recording.
    ///
    /// # Errors
    ///
    /// The file cannot be written.
    ///
    /// # Panics
    ///
    /// If the topic has had messages of another type.
    pub fn write_numbers(
        &mut self,
        topic: &str,
        at: Stamp,
        label: &str,
        numbers: &[f64],
    ) -> Result<(), TripWriteError> {
        let size = numbers.len() as u32;
        let dimensions = vec![ArrayDimension { label, size, stride: size }];
        let message = Float64MultiArrayMessage { dimensions, data_offset: 0, data: numbers };
        self.write(topic, FLOAT64_MULTI_ARRAY, at, &encode(&message))
    }

    /// Writes how a program fares, as `diagnostic_msgs/msg/DiagnosticArray` of one status.
    ///
    /// * `name` — of the program
    /// * `is_well` — whether its status is OK, rather than WARN
    /// * `values` — what it says of itself, each thing under its name
    ///
    /// # Errors
    ///
    /// The file cannot be written.
    ///
    /// # Panics
    ///
    /// If the topic has had messages of another type.
    pub fn write_diagnostics(
        &mut self,
        topic: &str,
        at: Stamp,
        name: &str,
        is_well: bool,
        values: &[(&str, String)],
    ) -> Result<(), TripWriteError> {
        let values = values.iter().map(|(key, value)| KeyValue { key, value }).collect();
        let status =
            DiagnosticStatus { level: u8::from(!is_well), name, message: "", hardware_id: "", values };
        let message = DiagnosticArrayMessage { header: header(at, ""), statuses: vec![status] };
        self.write(topic, DIAGNOSTIC_ARRAY, at, &encode(&message))
    }

    /// Closes the current chunk and hands everything to the system: what a crash from here on cannot take.
    ///
    /// # Errors
    ///
    /// The file cannot be written.
    pub fn flush(&mut self) -> Result<(), TripWriteError> {
        self.bag.flush()
    }

    /// The file as the system has it, to ask how long it is, or to wait, in whatever thread, until the disk has what was
    /// flushed.
    pub fn file(&self) -> &Arc<File> {
        self.bag.file()
    }

    /// Closes the trip, waits until the disk has it, and gives it its name.
    ///
    /// # Errors
    ///
    /// The file cannot be written or renamed; then nothing is left of it.
    pub fn finish(self) -> Result<(), TripWriteError> {
        self.bag.finish()
    }

    fn write(
        &mut self,
        topic: &str,
        type_name: &'static str,
        at: Stamp,
        data: &[u8],
    ) -> Result<(), TripWriteError> {
        let log_time = u64::try_from(at.0).unwrap_or(0);
        let (channel_id, sequence) = self.channel(topic, type_name)?;
        self.bag.write(&MessageHeader { channel_id, sequence, log_time, publish_time: log_time }, data)
    }

    /// The channel of a topic, and the number of the next message on it.
    fn channel(&mut self, topic: &str, type_name: &'static str) -> Result<(u16, u32), TripWriteError> {
        if let Some(written) = self.topics.get_mut(topic) {
            assert_eq!(written.type_name, type_name, "a topic has messages of one type");
            written.n_messages += 1;
            return Ok((written.channel_id, written.n_messages - 1));
        }
        let definition = match type_name {
            LASER_SCAN => include_str!("definitions/LaserScan.msg"),
            IMAGE => include_str!("definitions/Image.msg"),
            POSE_STAMPED => include_str!("definitions/PoseStamped.msg"),
            TWIST_STAMPED => include_str!("definitions/TwistStamped.msg"),
            DIAGNOSTIC_ARRAY => include_str!("definitions/DiagnosticArray.msg"),
            FLOAT64_MULTI_ARRAY => include_str!("definitions/Float64MultiArray.msg"),
            _ => include_str!("definitions/Odometry.msg"),
        };
        let schema = Schema {
            name: type_name.to_owned(),
            encoding: "ros2msg".to_owned(),
            definition: definition.into(),
        };
        let channel = Channel {
            topic: topic.to_owned(),
            message_encoding: "cdr".to_owned(),
            metadata: BTreeMap::from([("offered_qos_profiles".to_owned(), String::new())]),
        };
        let channel_id = self.bag.add_channel(&schema, &channel)?;
        self.topics.insert(topic.to_owned(), WrittenTopic { channel_id, type_name, n_messages: 1 });
        Ok((channel_id, 0))
    }
}

fn header(at: Stamp, frame_id: &str) -> Header<&str> {
    let (sec, nanosec) = at.sec_nsec();
    Header { sec, nanosec, frame_id }
}

/// A count in metres: NaN if invalid, +Inf from `no_return` on.
fn metres(unit: Unit, count: u16, no_return: u16) -> f32 {
    match count {
        INVALID => f32::NAN,
        count if count >= no_return => f32::INFINITY,
        count => unit.to_metres(count) as f32,
    }
}

fn pixels(image: &Image<'_>, unit: Unit) -> Vec<u8> {
    let mut bytes = Vec::new();
    for row in image.counts.chunks(image.layout.columns.max(1) as usize) {
        for &count in row {
            match (image.encoding, image.big_endian) {
                (ImageEncoding::Millimetres, false) => bytes.extend(unit.to_millimetres(count).to_le_bytes()),
                (ImageEncoding::Millimetres, true) => bytes.extend(unit.to_millimetres(count).to_be_bytes()),
                (ImageEncoding::Metres, false) => bytes.extend(metres(unit, count, u16::MAX).to_le_bytes()),
                (ImageEncoding::Metres, true) => bytes.extend(metres(unit, count, u16::MAX).to_be_bytes()),
            }
        }
        bytes.resize(bytes.len() + image.row_padding_bytes as usize, 0);
    }
    bytes
}

fn checked(metres_per_count: f64) -> Result<Unit, TripWriteError> {
    Unit::new(metres_per_count).ok_or(TripWriteError::Unit { metres_per_count })
}
