//! Writes a trip: frames, poses and commands as standard ROS 2 messages in MCAP.
//!
//! The file has what `ros2 bag`, Foxglove, PlotJuggler and `rosbags` look for: the profile `ros2`, the full text of each
//! message's definition, and the metadata record of `rosbag2` (in its version 5, which every distribution since
//! Humble reads). Until it is finished it stands beside its name under another, `NAME.….partial`.

use std::collections::BTreeMap;
use std::fmt::Write as _;
use std::fs::File;
use std::io::{self, BufWriter};
use std::path::{Path, PathBuf};

use mcap::McapError;
use mcap::records::{MessageHeader, Metadata};
use tempfile::NamedTempFile;

use crate::catalogue::{FLOAT64_MULTI_ARRAY, IMAGE, LASER_SCAN, ODOMETRY, POSE_STAMPED, TWIST_STAMPED};
use crate::counts::{INVALID, Unit};
use crate::message::{
    ArrayDimension, Float64MultiArrayMessage, Header, ImageMessage, LaserScanMessage, OdometryMessage,
    PoseStampedMessage, TwistStampedMessage, encode,
};
use crate::{Command, FrameLayout, Pose, Stamp, TripWriteError};

/// How chunks are compressed.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Compression {
    /// Not at all.
    None,
    /// LZ4. Faster than zstd; of depth images it saves next to nothing.
    Lz4,
    /// Zstandard at level 1, which fits depth images.
    Zstd,
}

/// How a trip is laid out in its file.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct WriterOptions {
    /// How chunks are compressed.
    pub compression: Compression,
    /// Bytes of messages in a chunk, before compression; `None`: no chunks, and no compression either.
    pub chunk_bytes: Option<u64>,
    /// Whether an index and a summary are written, so that readers find topics and times without reading everything.
    pub indexed: bool,
}

/// Chunks of 1 MiB, compressed with zstd and indexed.
impl Default for WriterOptions {
    fn default() -> Self {
        Self { compression: Compression::Zstd, chunk_bytes: Some(1 << 20), indexed: true }
    }
}

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
    target: PathBuf,
    mcap: mcap::Writer<BufWriter<NamedTempFile>>,
    topics: BTreeMap<String, WrittenTopic>,
    /// Times of the earliest and the latest message, ns.
    logged: Option<(u64, u64)>,
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
        if path.is_dir() {
            return Err(TripWriteError::IsDirectory { path: path.to_owned() });
        }
        let file = partial_file(path).map_err(io_error(path))?;
        let compression = match options.compression {
            Compression::None => None,
            Compression::Lz4 => Some(mcap::Compression::Lz4),
            Compression::Zstd => Some(mcap::Compression::Zstd),
        };
        let mcap = mcap::WriteOptions::new()
            .profile("ros2")
            .library(concat!("kinds-trips ", env!("CARGO_PKG_VERSION")))
            .compression(compression)
            .compression_level(1)
            // In this thread: a robot's other programs need the other cores.
            .compression_threads(0)
            .use_chunks(options.chunk_bytes.is_some())
            .chunk_size(options.chunk_bytes)
            .emit_message_indexes(options.indexed)
            .emit_summary_records(options.indexed)
            .emit_summary_offsets(options.indexed)
            .create(BufWriter::new(file))
            .map_err(mcap_error(path))?;
        Ok(TripWriter { target: path.to_owned(), mcap, topics: BTreeMap::new(), logged: None })
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

    /// Closes the current chunk and hands everything to the system: what a crash from here on cannot take.
    ///
    /// # Errors
    ///
    /// The file cannot be written.
    pub fn flush(&mut self) -> Result<(), TripWriteError> {
        self.mcap.flush().map_err(mcap_error(&self.target))
    }

    /// Closes the trip, waits until the disk has it, and gives it its name.
    ///
    /// # Errors
    ///
    /// The file cannot be written or renamed; then nothing is left of it.
    pub fn finish(mut self) -> Result<(), TripWriteError> {
        let metadata = self.rosbag2_metadata();
        let path = &self.target;
        self.mcap.write_metadata(&metadata).map_err(mcap_error(path))?;
        self.mcap.finish().map_err(mcap_error(path))?;
        let buffered = self.mcap.into_inner();
        let file = buffered.into_inner().map_err(|error| io_error(path)(error.into_error()))?;
        file.as_file().sync_all().map_err(io_error(path))?;
        file.persist(path).map_err(|error| io_error(path)(error.error))?;
        // The new name is on the disk once its directory is.
        File::open(directory_of(path)).and_then(|directory| directory.sync_all()).map_err(io_error(path))
    }

    fn write(
        &mut self,
        topic: &str,
        type_name: &'static str,
        at: Stamp,
        data: &[u8],
    ) -> Result<(), TripWriteError> {
        let log_time = u64::try_from(at.0).unwrap_or(0);
        let (channel_id, sequence) = self.channel(topic, type_name).map_err(mcap_error(&self.target))?;
        let header = MessageHeader { channel_id, sequence, log_time, publish_time: log_time };
        self.mcap.write_to_known_channel(&header, data).map_err(mcap_error(&self.target))?;
        let (earliest, latest) = self.logged.unwrap_or((log_time, log_time));
        self.logged = Some((earliest.min(log_time), latest.max(log_time)));
        Ok(())
    }

    /// The channel of a topic, and the number of the next message on it.
    fn channel(&mut self, topic: &str, type_name: &'static str) -> Result<(u16, u32), McapError> {
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
            FLOAT64_MULTI_ARRAY => include_str!("definitions/Float64MultiArray.msg"),
            _ => include_str!("definitions/Odometry.msg"),
        };
        let schema_id = self.mcap.add_schema(type_name, "ros2msg", definition.as_bytes())?;
        let quality = BTreeMap::from([("offered_qos_profiles".to_owned(), String::new())]);
        let channel_id = self.mcap.add_channel(schema_id, topic, "cdr", &quality)?;
        self.topics.insert(topic.to_owned(), WrittenTopic { channel_id, type_name, n_messages: 1 });
        Ok((channel_id, 0))
    }

    /// What `ros2 bag info` shows, in YAML, as `metadata.yaml` has it beside a bag of several files.
    fn rosbag2_metadata(&self) -> Metadata {
        let (earliest_ns, latest_ns) = self.logged.unwrap_or((0, 0));
        let duration_ns = latest_ns - earliest_ns;
        let n_messages: u64 = self.topics.values().map(|topic| u64::from(topic.n_messages)).sum();
        let file_name = quoted(&self.target.file_name().unwrap_or_default().to_string_lossy());
        let mut topics = String::new();
        for (name, topic) in &self.topics {
            let WrittenTopic { type_name, n_messages, .. } = topic;
            let name = quoted(name);
            // Writing to a string cannot fail.
            let _ = write!(
                topics,
                "\n- topic_metadata:\n    name: {name}\n    type: {type_name}\n    serialization_format: cdr\n    \
                 offered_qos_profiles: ''\n  message_count: {n_messages}"
            );
        }
        if topics.is_empty() {
            topics.push_str(" []");
        }
        let yaml = format!(
            "version: 5\nstorage_identifier: mcap\nduration:\n  nanoseconds: {duration_ns}\nstarting_time:\n  \
             nanoseconds_since_epoch: {earliest_ns}\nmessage_count: {n_messages}\ntopics_with_message_count:{topics}\n\
             compression_format: ''\ncompression_mode: ''\nrelative_file_paths:\n- {file_name}\nfiles:\n- path: \
             {file_name}\n  starting_time:\n    nanoseconds_since_epoch: {earliest_ns}\n  duration:\n    \
             nanoseconds: {duration_ns}\n  message_count: {n_messages}\n"
        );
        Metadata {
            name: "rosbag2".to_owned(),
            metadata: BTreeMap::from([("serialized_metadata".to_owned(), yaml)]),
        }
    }
}

/// A YAML string, whatever is in it.
fn quoted(text: &str) -> String {
    format!("'{}'", text.replace('\'', "''"))
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

/// A file beside the target, with the permissions of any other new file.
fn partial_file(target: &Path) -> io::Result<NamedTempFile> {
    let mut prefix = target.file_name().unwrap_or_default().to_owned();
    prefix.push(".");
    let mut builder = tempfile::Builder::new();
    builder.prefix(&prefix).suffix(".partial");
    #[cfg(unix)]
    {
        use std::os::unix::fs::PermissionsExt as _;
        // The umask is taken off as the file is made; temporary files are otherwise their owner's alone.
        builder.permissions(std::fs::Permissions::from_mode(0o666));
    }
    builder.tempfile_in(directory_of(target))
}

fn directory_of(path: &Path) -> &Path {
    path.parent().filter(|parent| !parent.as_os_str().is_empty()).unwrap_or(Path::new("."))
}

fn io_error(path: &Path) -> impl FnOnce(io::Error) -> TripWriteError + '_ {
    move |source| TripWriteError::Io { path: path.to_owned(), source }
}

fn mcap_error(path: &Path) -> impl FnOnce(McapError) -> TripWriteError + '_ {
    move |error| {
        let source = match error {
            McapError::Io(source) => source,
            other => io::Error::other(other),
        };
        TripWriteError::Io { path: path.to_owned(), source }
    }
}
