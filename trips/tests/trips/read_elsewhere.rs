//! What we write is read by `rosbags`, the independent reader of ROS bags in Python, where Python has it.

use std::path::Path;
use std::process::Command;

use kinds_trips::{
    Command as Told, Compression, FrameLayout, Image, ImageEncoding, Pose, Scan, Stamp, TripWriter,
    WriterOptions,
};

use crate::bag::Folder;
use crate::made_elsewhere::skipped;

/// Prints every message of a bag, decoded by the definitions that the bag itself carries.
const PRINT_BAG: &str = r#"
import sys
from pathlib import Path
from rosbags.highlevel import AnyReader

with AnyReader([Path(sys.argv[1])]) as reader:
    print(reader.message_count, reader.start_time, reader.duration)
    for connection, logged, raw in reader.messages():
        m = reader.deserialize(raw, connection.msgtype)
        at = m.header.stamp.sec * 10**9 + m.header.stamp.nanosec
        what = connection.msgtype.split("/")[-1]
        if what == "LaserScan":
            values = [f"{v:.4g}" for v in (m.range_min, m.range_max, *m.ranges)]
        elif what == "Image":
            values = [m.encoding, m.height, m.width, m.step, m.is_bigendian, bytes(m.data).hex()]
        elif what == "TwistStamped":
            values = [f"{v:.4f}" for v in (m.twist.linear.x, m.twist.angular.z)]
        else:
            pose = m.pose if what == "PoseStamped" else m.pose.pose
            p, q = pose.position, pose.orientation
            values = [f"{v:.4f}" for v in (p.x, p.y, q.z, q.w)]
        print(connection.topic, logged - at, at, *values)
"#;

const EXPECTED: &str = "\
5 1000000000 500000001
/scan 0 1000000000 0.05 4 nan 1.5 inf
/it's depth 0 1250000000 16UC1 1 2 5 1 0102030400
/odom 0 1500000000 1.0000 -2.0000 0.7071 0.7071
/ground_truth 0 1500000000 1.0000 -2.0000 0.7071 0.7071
/cmd_vel 0 1500000000 0.2500 -1.5000
";

fn write_trip(path: &Path, options: &WriterOptions) {
    let mut writer = TripWriter::create(path, options).unwrap();
    let scan = Scan {
        counts: &[0, 1500, 4000],
        metres_per_count: 0.001,
        bearing_rad_min: 0.0,
        bearing_step_rad: 0.1,
        range_m_min: 0.05,
        range_m_max: 4.0,
    };
    writer.write_scan("/scan", Stamp(1_000_000_000), &scan).unwrap();
    let image = Image {
        counts: &[0x0102, 0x0304],
        layout: FrameLayout { rows: 1, columns: 2, metres_per_count: 0.001 },
        encoding: ImageEncoding::Millimetres,
        big_endian: true,
        row_padding_bytes: 1,
    };
    writer.write_image("/it's depth", Stamp(1_250_000_000), &image).unwrap();
    let pose = Pose { x_m: 1.0, y_m: -2.0, yaw_rad: std::f64::consts::FRAC_PI_2 };
    writer.write_odometry("/odom", Stamp(1_500_000_000), &pose).unwrap();
    writer.write_pose("/ground_truth", Stamp(1_500_000_000), &pose).unwrap();
    let told = Told { forward_m_s: 0.25, turn_rad_s: -1.5 };
    writer.write_command("/cmd_vel", Stamp(1_500_000_000), &told).unwrap();
    writer.finish().unwrap();
}

/// What rosbags prints of a bag.
fn printed(bag: &Path) -> String {
    let output = Command::new("python3").arg("-c").arg(PRINT_BAG).arg(bag).output().unwrap();
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    String::from_utf8(output.stdout).unwrap()
}

pub(crate) fn rosbags_is_here() -> bool {
    let probe = Command::new("python3").args(["-c", "import rosbags.highlevel"]).output();
    let here = probe.is_ok_and(|output| output.status.success());
    if !here {
        skipped("python3 has no package rosbags");
    }
    here
}

#[test]
fn rosbags_reads_what_we_write() {
    if !rosbags_is_here() {
        return;
    }
    let folder = Folder::new();
    let path = folder.join("trip.mcap");
    for compression in [Compression::None, Compression::Lz4, Compression::Zstd] {
        for chunk_bytes in [None, Some(500)] {
            let options = WriterOptions { compression, chunk_bytes, indexed: true };
            write_trip(&path, &options);
            assert_eq!(printed(&path), EXPECTED, "{options:?}");
        }
    }
}

#[test]
fn the_metadata_in_a_trip_makes_it_a_bag_in_a_folder() {
    if !rosbags_is_here() {
        return;
    }
    let folder = Folder::new();
    let path = folder.join("trip.mcap");
    write_trip(&path, &WriterOptions::default());
    let bytes = std::fs::read(&path).unwrap();
    let summary = mcap::Summary::read(&bytes).unwrap().unwrap();
    let metadata = mcap::read::metadata(&bytes, &summary.metadata_indexes[0]).unwrap();
    assert_eq!(metadata.name, "rosbag2");
    let yaml = metadata.metadata["serialized_metadata"].replace('\n', "\n  ");
    std::fs::write(folder.join("metadata.yaml"), format!("rosbag2_bagfile_information:\n  {yaml}")).unwrap();
    assert_eq!(printed(&folder.join("")), EXPECTED);
}
