//! Recorded trips: ROS 2 bags in MCAP, read and written, and ROS 1 bags, read.
//!
//! A *trip* is one file: frames of one range sensor and, where the robot knew them, poses (`nav_msgs/Odometry`, or
//! `geometry_msgs/PoseStamped` where there is no odometry or it is asked for by name) and what it was told to do
//! (`geometry_msgs/Twist` or `geometry_msgs/TwistStamped`), encoded as CDR or as ROS 1 does. Frames are messages of
//! `sensor_msgs`: `LaserScan`, `Image` (`16UC1`, `32FC1`), `CompressedImage` (`compressedDepth` in PNG or RVL),
//! `PointCloud2` (organised), `Range`; or `std_msgs/Float32MultiArray`.
//!
//! * [`TripReader`] turns it into *frames*: `u16` counts of a stated unit, each with its time of capture, and the pose
//!   and the command at that time. Reading streams: memory does not grow with the length of the trip.
//! * [`TripInfo`] says what is in a file; [`salvage()`] saves what is whole of a damaged one.
//! * [`TripWriter`] writes the same, and kinds beside them, for `ros2 bag`, Foxglove, PlotJuggler and the `rosbags`
//!   package to read.
//!
//! # Metres become counts
//!
//! | the message says | the count is |
//! |---|---|
//! | NaN, −Inf, a negative value; outside `range_min … range_max`; finite, but more than 65535 counts | 0: invalid |
//! | +Inf: no return | the largest range: of a scan its `range_max` (at most 65535 counts), of an image 65535 |
//! | a cloud's point | its distance: z in an optical frame (`frame_id` ends with `optical_frame`), else from the origin |
//! | any other number of metres | that divided by the unit, rounded to the nearest count |
//! | 16UC1 | its millimetres in the unit; at 1 mm the pixel itself |
//!
//! A range is like one of a scan. Clouds, numbers and compressed images have no limit of their own, as images.
//!
//! # Frames of several topics become one
//!
//! Of several topics, such as rings of single ranges or two sensors of one robot, the first leads: each of its messages makes
//! a frame, a row with the readings of all of them in the order in which they are named. [`Partner`] is the rule by which
//! frames of the others belong to it, which is also that of sensors that are running. Where there is none the frame is invalid
//! (of a single range, only that reading), and [`TripReader::missing_partners`] counts it.
//!
//! # Poses come to frames
//!
//! A frame's pose is interpolated between the two poses around its time of capture, the yaw by the short way round,
//! where these two are at most [`MAX_POSE_GAP_S`] apart. Elsewhere (before the first pose, after the last, in a longer
//! gap) it is the nearest pose if that is at most [`MAX_POSE_REACH_S`] away, and else there is none.
//!
//! # Commands come to frames
//!
//! A frame's command is the last at or before its time of capture, however long ago: a robot does what it was told last.
//! There is none before the first. A message without a stamp was given when it was logged; one that says no velocity
//! (NaN) changes nothing. Of a twist, the speed forward and the turn are read, not the other four axes.
//!
//! # Recordings that were cut off
//!
//! A recording that a power cut ended is read up to its last whole chunk (its last whole message where it has no
//! chunks), and [`TripReader::truncation`] says so. Damage anywhere else is a [`TripError`]. In ROS 1 bags, which have no
//! checksums, only damage to their structure is seen.
#![forbid(unsafe_code)]

mod bag_file;
mod catalogue;
mod chunk;
mod command;
mod compressed_depth;
mod counts;
mod error;
mod frame;
mod frame_message;
mod history;
mod info;
mod lookahead;
mod mcap_file;
mod message;
mod partner;
mod point_cloud;
mod pose;
mod pose_track;
mod position;
mod reader;
mod record;
mod recording;
mod rhythm;
mod ros1;
mod ros1_bag;
mod ros1_record;
mod rvl;
mod salvage;
mod stamp;
mod summary;
mod writer;

pub use bag_file::{Compression, WriterOptions};
pub use catalogue::{Role, Topic};
pub use command::Command;
pub use error::{MessageFault, TripError, TripWriteError};
pub use frame::{FrameInfo, FrameLayout};
pub use info::{Choice, Gives, TopicInfo, TripInfo};
pub use partner::{Partner, USUAL_TOLERANCE, counts_in_unit, join};
pub use pose::Pose;
pub use pose_track::{MAX_POSE_GAP_S, MAX_POSE_REACH_S};
pub use reader::{Selection, TripReader};
pub use recording::{Format, Truncation};
pub use rhythm::Gap;
pub use salvage::{Loss, Salvage, SalvageError, salvage};
pub use stamp::Stamp;
pub use writer::{Image, ImageEncoding, Scan, TripWriter};
