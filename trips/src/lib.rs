//! Recorded trips: ROS 2 bags in MCAP, read and written.
//!
//! A *trip* is one `.mcap` file: frames of one range sensor (`sensor_msgs/msg/LaserScan`, or `sensor_msgs/msg/Image`
//! as `16UC1` or `32FC1`) and, where the robot knew them, poses (`nav_msgs/msg/Odometry`, or
//! `geometry_msgs/msg/PoseStamped` where there is no odometry or it is asked for by name) and what it was told to do
//! (`geometry_msgs/msg/Twist` or `geometry_msgs/msg/TwistStamped`), encoded as CDR.
//!
//! * [`TripReader`] turns it into *frames*: `u16` counts of a stated unit, each with its time of capture, and the pose
//!   and the command at that time. Reading streams: memory does not grow with the length of the trip.
//! * [`TripWriter`] writes the same, and kinds beside them, for `ros2 bag`, Foxglove, PlotJuggler and the `rosbags`
//!   package to read.
//!
//! # Metres become counts
//!
//! | the message says | the count is |
//! |---|---|
//! | NaN, −Inf, a negative value; outside `range_min … range_max`; finite, but more than 65535 counts | 0: invalid |
//! | +Inf: no return | the largest range: of a scan its `range_max` (at most 65535 counts), of an image 65535 |
//! | any other number of metres | that divided by the unit, rounded to the nearest count |
//! | 16UC1 | its millimetres in the unit; at 1 mm the pixel itself |
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
//! chunks), and [`TripReader::truncation`] says so. Damage anywhere else is a [`TripError`].
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
mod point_cloud;
mod pose;
mod pose_track;
mod reader;
mod record;
mod recording;
mod rhythm;
mod ros1;
mod ros1_bag;
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
pub use lookahead::MAX_RANGE_REACH_S;
pub use pose::Pose;
pub use pose_track::{MAX_POSE_GAP_S, MAX_POSE_REACH_S};
pub use reader::{Selection, TripReader};
pub use recording::{Format, Truncation};
pub use rhythm::Gap;
pub use salvage::{Loss, Salvage, SalvageError, salvage};
pub use stamp::Stamp;
pub use writer::{Image, ImageEncoding, Scan, TripWriter};
