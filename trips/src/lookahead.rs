//! Frames that wait for the pose after them.
//!
//! A frame's pose lies between two messages of odometry, of which the second comes later in the recording, and may come
//! later still because it is logged late. So frames wait here, in order, until a pose as late as the first of them
//! has come, or until as many wait as there may: the queue has a bound, and so has a trip's memory.

use std::collections::VecDeque;
use std::path::PathBuf;

use crate::catalogue::{FrameType, PoseType, Topic};
use crate::counts::Unit;
use crate::message::{read_image, read_laser_scan, read_pose};
use crate::pose_track::PoseTrack;
use crate::record::Record;
use crate::{FrameInfo, FrameLayout, MessageFault, Stamp, TripError};

/// Frames that wait at most: 2.5 s of a lidar at 100 Hz.
const MAX_WAITING_FRAMES: usize = 256;

/// Readings that wait at most, 32 MiB of them: half a second of an image of 640 × 480 at 100 Hz.
const MAX_WAITING_READINGS: usize = 16 << 20;

/// Frames that may wait however large they are: fewer would hardly ever see the pose after them.
const MIN_WAITING_FRAMES: usize = 4;

/// The frames read ahead, and the poses around them.
pub(crate) struct Lookahead {
    /// The trip's file, for errors.
    path: PathBuf,
    unit: Unit,
    frames: Topic,
    frame_type: FrameType,
    poses: Option<(Topic, PoseType)>,
    layout: Option<FrameLayout>,
    waiting: VecDeque<Waiting>,
    /// Buffers of frames that were taken, for the next.
    spare: Vec<Vec<u16>>,
    track: PoseTrack,
    n_frames: u64,
    n_poses: u64,
}

struct Waiting {
    captured: Stamp,
    counts: Vec<u16>,
}

impl Lookahead {
    pub(crate) fn new(
        path: PathBuf,
        unit: Unit,
        frames: Topic,
        frame_type: FrameType,
        poses: Option<(Topic, PoseType)>,
    ) -> Self {
        Self {
            path,
            unit,
            frames,
            frame_type,
            poses,
            layout: None,
            waiting: VecDeque::new(),
            spare: Vec::new(),
            track: PoseTrack::default(),
            n_frames: 0,
            n_poses: 0,
        }
    }

    pub(crate) fn frames_topic(&self) -> &Topic {
        &self.frames
    }

    pub(crate) fn poses_topic(&self) -> Option<&Topic> {
        self.poses.as_ref().map(|(topic, _)| topic)
    }

    /// The layout of all frames, once there was one.
    pub(crate) fn layout(&self) -> Option<FrameLayout> {
        self.layout
    }

    /// Frames taken in so far.
    pub(crate) fn n_frames(&self) -> u64 {
        self.n_frames
    }

    /// Whether the first frame has waited long enough. `no_more`: nothing more will come.
    pub(crate) fn is_ready(&self, no_more: bool) -> bool {
        self.waiting.front().is_some_and(|first| {
            no_more
                || self.poses.is_none()
                || self.track.reaches(first.captured)
                || self.waiting.len() >= self.bound()
        })
    }

    /// Takes in the next record of the trip. Not to be called while the first frame is ready.
    pub(crate) fn accept(&mut self, record: &Record<'_>) -> Result<(), TripError> {
        let Record::Message { channel_id, log_time, data } = *record else { return Ok(()) };
        let logged = Stamp(i64::try_from(log_time).unwrap_or(i64::MAX));
        if self.frames.channel_ids.contains(&channel_id) {
            return self.accept_frame(data, logged);
        }
        let is_of = |poses: &&(Topic, PoseType)| poses.0.channel_ids.contains(&channel_id);
        if let Some((topic, pose_type)) = self.poses.as_ref().filter(is_of) {
            self.n_poses += 1;
            let (at, pose) = read_pose(*pose_type, data)
                .map_err(|fault| self.message_error(topic, self.n_poses, fault))?;
            // Odometry that is lost says so with NaN: then there is no pose, and frames fare as in any other gap.
            if let Some(pose) = pose {
                self.track.insert(at.unwrap_or(logged), pose);
            }
        }
        Ok(())
    }

    /// Takes the first frame, with the pose at its time.
    ///
    /// # Panics
    ///
    /// If no frame waits, or `counts` is not as long as a frame.
    pub(crate) fn take(&mut self, counts: &mut [u16]) -> FrameInfo {
        let first = self.waiting.pop_front().expect("a frame is taken only when one is ready");
        counts.copy_from_slice(&first.counts);
        self.spare.push(first.counts);
        FrameInfo { captured: first.captured, pose: self.track.pose_at(first.captured) }
    }

    fn accept_frame(&mut self, data: &[u8], logged: Stamp) -> Result<(), TripError> {
        let number = self.n_frames + 1;
        let mut counts = self.spare.pop().unwrap_or_default();
        let head = match self.frame_type {
            FrameType::LaserScan => read_laser_scan(data, self.unit, &mut counts),
            FrameType::Image => read_image(data, self.unit, &mut counts),
        }
        .map_err(|fault| self.message_error(&self.frames, number, fault))?;
        let metres_per_count = self.unit.metres_per_count();
        let layout = FrameLayout { rows: head.rows, columns: head.columns, metres_per_count };
        let from = *self.layout.get_or_insert(layout);
        if layout != from {
            return Err(TripError::FrameSizeChanged {
                path: self.path.clone(),
                topic: self.frames.name.clone(),
                number,
                from,
                to: layout,
            });
        }
        self.waiting.push_back(Waiting { captured: head.captured.unwrap_or(logged), counts });
        self.n_frames = number;
        Ok(())
    }

    fn message_error(&self, topic: &Topic, number: u64, fault: MessageFault) -> TripError {
        TripError::Message { path: self.path.clone(), topic: topic.name.clone(), number, fault }
    }

    /// Frames that may wait.
    fn bound(&self) -> usize {
        let n_readings = self.layout.map_or(1, |layout| layout.n_readings());
        (MAX_WAITING_READINGS / n_readings).clamp(MIN_WAITING_FRAMES, MAX_WAITING_FRAMES)
    }

    /// Frames that wait, and buffers kept for more.
    #[cfg(test)]
    pub(crate) fn n_buffers(&self) -> (usize, usize) {
        (self.waiting.len(), self.spare.len())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::catalogue::{IMAGE, ODOMETRY};
    use crate::message::{Header, ImageMessage, OdometryMessage, encode};

    fn topic(channel_id: u16, type_name: &str) -> Topic {
        Topic {
            name: format!("/{channel_id}"),
            type_name: type_name.to_owned(),
            n_messages: 1,
            message_encoding: "cdr".to_owned(),
            channel_ids: vec![channel_id],
        }
    }

    fn image(sec: i32, side: u32) -> Vec<u8> {
        encode(&ImageMessage {
            header: Header { sec, nanosec: 0, frame_id: "" },
            height: side,
            width: side,
            encoding: "16UC1",
            is_bigendian: 0,
            step: 2 * side,
            data: &vec![1; 2 * (side * side) as usize],
        })
    }

    fn odometry(sec: i32) -> Vec<u8> {
        encode(&OdometryMessage {
            header: Header { sec, nanosec: 0, frame_id: "" },
            child_frame_id: "",
            position_m: [0.0; 3],
            orientation_xyzw: [0.0, 0.0, 0.0, 1.0],
            pose_covariance: [[0.0; 6]; 6],
            twist: [0.0; 6],
            twist_covariance: [[0.0; 6]; 6],
        })
    }

    /// Runs a trip whose odometry stops after its first message; the largest number of frames that waited.
    fn most_waiting(side: u32, n_frames: i32) -> usize {
        let unit = Unit::new(0.001).unwrap();
        let poses = Some((topic(2, ODOMETRY), PoseType::Odometry));
        let mut lookahead = Lookahead::new(PathBuf::new(), unit, topic(1, IMAGE), FrameType::Image, poses);
        let accept = |lookahead: &mut Lookahead, channel_id, data: &[u8]| {
            lookahead.accept(&Record::Message { channel_id, log_time: 0, data }).unwrap();
        };
        accept(&mut lookahead, 2, &odometry(1));
        let mut counts = vec![0; (side * side) as usize];
        let (mut most, mut n_taken) = (0, 0);
        for sec in 1..=n_frames {
            accept(&mut lookahead, 1, &image(sec, side));
            let (n_waiting, n_spare) = lookahead.n_buffers();
            assert!(n_waiting + n_spare <= lookahead.bound() + 1, "buffers are used again");
            most = most.max(n_waiting);
            while lookahead.is_ready(false) {
                lookahead.take(&mut counts);
                n_taken += 1;
            }
        }
        while lookahead.is_ready(true) {
            lookahead.take(&mut counts);
            n_taken += 1;
        }
        assert_eq!(n_taken, n_frames, "every frame is taken in the end");
        most
    }

    #[test]
    fn the_frames_that_wait_are_bounded_when_odometry_stops() {
        assert_eq!(most_waiting(1, 2000), MAX_WAITING_FRAMES);
        // 2048 × 2048 readings are a quarter of what may wait.
        assert_eq!(most_waiting(2048, 8), MIN_WAITING_FRAMES);
        assert_eq!(most_waiting(512, 80), MAX_WAITING_READINGS / (512 * 512));
    }
}
