//! Bags of any content, made with the `mcap` crate and a CDR encoder of the tests' own, and a reader that takes all.

use std::collections::BTreeMap;
use std::fs::File;
use std::io::BufWriter;
use std::path::{Path, PathBuf};

use kinds_trips::{Command, FrameInfo, FrameLayout, Selection, TripError, TripReader, Truncation};
use mcap::records::MessageHeader;

pub(crate) const LASER_SCAN: &str = "sensor_msgs/msg/LaserScan";
pub(crate) const IMAGE: &str = "sensor_msgs/msg/Image";
pub(crate) const ODOMETRY: &str = "nav_msgs/msg/Odometry";
pub(crate) const POSE_STAMPED: &str = "geometry_msgs/msg/PoseStamped";
pub(crate) const RANGE: &str = "sensor_msgs/msg/Range";
pub(crate) const POINT_CLOUD2: &str = "sensor_msgs/msg/PointCloud2";
pub(crate) const COMPRESSED_IMAGE: &str = "sensor_msgs/msg/CompressedImage";
pub(crate) const FLOAT32_MULTI_ARRAY: &str = "std_msgs/msg/Float32MultiArray";
pub(crate) const TWIST: &str = "geometry_msgs/msg/Twist";
pub(crate) const TWIST_STAMPED: &str = "geometry_msgs/msg/TwistStamped";

/// A folder for one test, removed with the value.
pub(crate) struct Folder(tempfile::TempDir);

impl Folder {
    pub(crate) fn new() -> Self {
        Self(tempfile::tempdir().unwrap())
    }

    pub(crate) fn join(&self, name: &str) -> PathBuf {
        self.0.path().join(name)
    }

    /// Writes a file in place of any that was there.
    ///
    /// The old one is removed first: a file system may wait for the disk when a file is overwritten, for the sake of
    /// programs that do no better, and these tests write some hundred thousand.
    pub(crate) fn write(&self, name: &str, content: &[u8]) -> PathBuf {
        let path = self.join(name);
        let _ = std::fs::remove_file(&path);
        std::fs::write(&path, content).unwrap();
        path
    }

    /// The names in it, sorted.
    pub(crate) fn names(&self) -> Vec<String> {
        let entries = std::fs::read_dir(self.0.path()).unwrap();
        let mut names: Vec<String> =
            entries.map(|entry| entry.unwrap().file_name().into_string().unwrap()).collect();
        names.sort();
        names
    }
}

/// A bag being made.
pub(crate) struct Bag(mcap::Writer<BufWriter<File>>);

impl Bag {
    pub(crate) fn create(path: &Path) -> Self {
        Self::with_options(path, mcap::WriteOptions::new())
    }

    pub(crate) fn with_options(path: &Path, options: mcap::WriteOptions) -> Self {
        Self(options.create(BufWriter::new(File::create(path).unwrap())).unwrap())
    }

    pub(crate) fn topic(&mut self, name: &str, type_name: &str) -> u16 {
        self.topic_encoded(name, type_name, "cdr")
    }

    pub(crate) fn topic_encoded(&mut self, name: &str, type_name: &str, message_encoding: &str) -> u16 {
        let schema_id = self.0.add_schema(type_name, "ros2msg", b"").unwrap();
        self.0.add_channel(schema_id, name, message_encoding, &BTreeMap::new()).unwrap()
    }

    /// A second channel of a topic, which differs in its metadata.
    pub(crate) fn topic_of_another_publisher(&mut self, name: &str, type_name: &str) -> u16 {
        let schema_id = self.0.add_schema(type_name, "ros2msg", b"").unwrap();
        let metadata = BTreeMap::from([("publisher".to_owned(), "second".to_owned())]);
        self.0.add_channel(schema_id, name, "cdr", &metadata).unwrap()
    }

    pub(crate) fn message(&mut self, channel_id: u16, log_time: u64, data: &[u8]) {
        let header = MessageHeader { channel_id, sequence: 0, log_time, publish_time: log_time };
        self.0.write_to_known_channel(&header, data).unwrap();
    }

    pub(crate) fn attach(&mut self, name: &str, data: &[u8]) {
        let (name, media_type) = (name.to_owned(), "application/octet-stream".to_owned());
        let attachment =
            mcap::Attachment { log_time: 0, create_time: 0, name, media_type, data: data.into() };
        self.0.attach(&attachment).unwrap();
    }

    pub(crate) fn finish(mut self) {
        self.0.finish().unwrap();
    }
}

/// A message in CDR, field by field: every number stands at a multiple of its size.
pub(crate) struct Cdr {
    bytes: Vec<u8>,
    big_endian: bool,
}

impl Cdr {
    pub(crate) fn new(big_endian: bool) -> Self {
        Self { bytes: vec![0, u8::from(!big_endian), 0, 0], big_endian }
    }

    fn number<const N: usize>(mut self, little_endian: [u8; N]) -> Self {
        // The four bytes before the message do not count.
        while !(self.bytes.len() - 4).is_multiple_of(N) {
            self.bytes.push(0);
        }
        let mut number = little_endian;
        if self.big_endian {
            number.reverse();
        }
        self.bytes.extend(number);
        self
    }

    pub(crate) fn u8(self, value: u8) -> Self {
        self.number([value])
    }

    pub(crate) fn u32(self, value: u32) -> Self {
        self.number(value.to_le_bytes())
    }

    pub(crate) fn f32s(self, values: &[f32]) -> Self {
        values.iter().fold(self, |cdr, value| cdr.number(value.to_le_bytes()))
    }

    pub(crate) fn f64s(self, values: &[f64]) -> Self {
        values.iter().fold(self, |cdr, value| cdr.number(value.to_le_bytes()))
    }

    pub(crate) fn bytes(self, value: &[u8]) -> Self {
        let mut cdr = self.u32(value.len() as u32);
        cdr.bytes.extend(value);
        cdr
    }

    pub(crate) fn header(self, (sec, nanosec): (u32, u32)) -> Self {
        self.u32(sec).u32(nanosec).bytes(b"sensor\0")
    }

    pub(crate) fn done(self) -> Vec<u8> {
        self.bytes
    }
}

/// A laser scan that measures from 0.1 m to 4 m.
pub(crate) fn scan(stamp: (u32, u32), ranges_m: &[f32]) -> Vec<u8> {
    scan_in(false, stamp, ranges_m)
}

pub(crate) fn scan_in(big_endian: bool, stamp: (u32, u32), ranges_m: &[f32]) -> Vec<u8> {
    let scan = Cdr::new(big_endian).header(stamp).f32s(&[0.0, 1.0, 0.1, 0.0, 0.0, 0.1, 4.0]);
    scan.u32(ranges_m.len() as u32).f32s(ranges_m).u32(0).done()
}

/// An image as it stands in its message.
#[derive(Clone, Copy)]
pub(crate) struct RawImage<'a> {
    pub(crate) rows: u32,
    pub(crate) columns: u32,
    pub(crate) encoding: &'a [u8],
    pub(crate) is_bigendian: u8,
    pub(crate) step: u32,
    pub(crate) data: &'a [u8],
}

pub(crate) fn image_in(big_endian: bool, stamp: (u32, u32), image: RawImage<'_>) -> Vec<u8> {
    let message = Cdr::new(big_endian).header(stamp).u32(image.rows).u32(image.columns).bytes(image.encoding);
    message.u8(image.is_bigendian).u32(image.step).bytes(image.data).done()
}

pub(crate) fn odometry_in(
    big_endian: bool,
    stamp: (u32, u32),
    position_m: [f64; 3],
    xyzw: [f64; 4],
) -> Vec<u8> {
    let message = Cdr::new(big_endian).header(stamp).bytes(b"base_link\0").f64s(&position_m).f64s(&xyzw);
    message.f64s(&[0.0; 36]).f64s(&[0.0; 6]).f64s(&[0.0; 36]).done()
}

/// A level pose with yaw 0.
pub(crate) fn odometry(stamp: (u32, u32), x_m: f64) -> Vec<u8> {
    odometry_in(false, stamp, [x_m, 0.0, 0.0], [0.0, 0.0, 0.0, 1.0])
}

/// The same without odometry: a message half as long, of other fields after the pose.
pub(crate) fn pose_stamped(stamp: (u32, u32), x_m: f64) -> Vec<u8> {
    Cdr::new(false).header(stamp).f64s(&[x_m, 0.0, 0.0]).f64s(&[0.0, 0.0, 0.0, 1.0]).done()
}

/// A twist of six different velocities, without a stamp.
pub(crate) fn twist_in(big_endian: bool, forward_m_s: f64, turn_rad_s: f64) -> Vec<u8> {
    Cdr::new(big_endian).f64s(&[forward_m_s, 10.0, 20.0, 30.0, 40.0, turn_rad_s]).done()
}

/// The same with one.
pub(crate) fn twist_stamped_in(
    big_endian: bool,
    stamp: (u32, u32),
    forward_m_s: f64,
    turn_rad_s: f64,
) -> Vec<u8> {
    let message = Cdr::new(big_endian).header(stamp);
    message.f64s(&[forward_m_s, 10.0, 20.0, 30.0, 40.0, turn_rad_s]).done()
}

/// Everything a trip gave.
#[derive(Debug)]
pub(crate) struct Read {
    pub(crate) layout: FrameLayout,
    pub(crate) frames: Vec<(FrameInfo, Vec<u16>)>,
    pub(crate) failure: Option<TripError>,
    pub(crate) truncation: Option<Truncation>,
}

impl Read {
    pub(crate) fn counts(&self) -> Vec<Vec<u16>> {
        self.frames.iter().map(|(_, counts)| counts.clone()).collect()
    }

    /// The x of each frame's pose.
    pub(crate) fn x_m(&self) -> Vec<Option<f64>> {
        self.frames.iter().map(|(info, _)| info.pose.map(|pose| pose.x_m)).collect()
    }

    /// Each frame's command: forward and turn.
    pub(crate) fn commands(&self) -> Vec<Option<(f64, f64)>> {
        let of = |command: Command| (command.forward_m_s, command.turn_rad_s);
        self.frames.iter().map(|(info, _)| info.command.map(of)).collect()
    }
}

/// Reads a trip to its end, be that an error.
pub(crate) fn read_with(path: &Path, selection: &Selection) -> Result<Read, TripError> {
    let mut reader = TripReader::open(path, selection)?;
    let layout = reader.layout();
    let mut counts = vec![0; layout.n_readings()];
    let mut frames = Vec::new();
    let failure = loop {
        match reader.next_frame(&mut counts) {
            Ok(Some(info)) => frames.push((info, counts.clone())),
            Ok(None) => break None,
            Err(failure) => break Some(failure),
        }
    };
    assert!(matches!(reader.next_frame(&mut counts), Ok(None)), "a trip that ended stays ended");
    let (n_bytes_read, n_bytes) = reader.progress();
    assert!(n_bytes_read <= n_bytes);
    Ok(Read { layout, frames, failure, truncation: reader.truncation().cloned() })
}

pub(crate) fn read(path: &Path) -> Result<Read, TripError> {
    read_with(path, &Selection::default())
}

/// Reads a trip that is whole.
pub(crate) fn read_whole(path: &Path) -> Read {
    let read = read(path).unwrap();
    assert!(read.failure.is_none() && read.truncation.is_none(), "{:?} {:?}", read.failure, read.truncation);
    read
}

/// The sentence with which a trip refuses to open.
pub(crate) fn refusal(path: &Path, selection: &Selection) -> String {
    read_with(path, selection).map(|_| ()).unwrap_err().to_string()
}
