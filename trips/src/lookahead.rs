//! Frames that wait for the pose and the command after them.
//!
//! A frame's pose lies between two messages of odometry, of which the second comes later in the recording, and may come
//! later still because it is logged late. Its command is the last before it, of which nobody can tell that it is the last
//! before the next has come. So frames wait here, in order, until a pose and a command as late as the first of them
//! have come, or until as many wait as there may: the queue has a bound, and so has a trip's memory.
//!
//! Each frame takes its pose as soon as that is there, and does not leave it to the end of its wait: where a teleoperator
//! holds a stick still for long, and commands come on change only, poses would be forgotten meanwhile.

use std::collections::VecDeque;
use std::path::PathBuf;

use crate::catalogue::{CommandType, FrameType, PoseType, Topic};
use crate::counts::Unit;
use crate::history::History;
use crate::message::{read_command, read_image, read_laser_scan, read_pose};
use crate::pose_track::pose_at;
use crate::record::Record;
use crate::{Command, FrameInfo, FrameLayout, MessageFault, Pose, Stamp, TripError};

/// Frames that wait at most: 2.5 s of a lidar at 100 Hz.
const MAX_WAITING_FRAMES: usize = 256;

/// Readings that wait at most, 32 MiB of them: half a second of an image of 640 × 480 at 100 Hz.
const MAX_WAITING_READINGS: usize = 16 << 20;

/// Frames that may wait however large they are: fewer would hardly ever see the pose after them.
const MIN_WAITING_FRAMES: usize = 4;

/// The topics that are read.
pub(crate) struct Topics {
    pub(crate) frames: (Topic, FrameType),
    pub(crate) poses: Option<(Topic, PoseType)>,
    pub(crate) commands: Option<(Topic, CommandType)>,
}

/// The frames read ahead, and the poses and commands around them.
pub(crate) struct Lookahead {
    /// The trip's file, for errors.
    path: PathBuf,
    unit: Unit,
    topics: Topics,
    layout: Option<FrameLayout>,
    waiting: VecDeque<Waiting>,
    /// Buffers of frames that were taken, for the next.
    spare: Vec<Vec<u16>>,
    poses: History<Pose>,
    commands: History<Command>,
    n_frames: u64,
    n_poses: u64,
    n_commands: u64,
}

struct Waiting {
    info: FrameInfo,
    counts: Vec<u16>,
    awaits_pose: bool,
    awaits_command: bool,
}

impl Lookahead {
    pub(crate) fn new(path: PathBuf, unit: Unit, topics: Topics) -> Self {
        Self {
            path,
            unit,
            topics,
            layout: None,
            waiting: VecDeque::new(),
            spare: Vec::new(),
            poses: History::default(),
            commands: History::default(),
            n_frames: 0,
            n_poses: 0,
            n_commands: 0,
        }
    }

    pub(crate) fn topics(&self) -> &Topics {
        &self.topics
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
            no_more || !(first.awaits_pose || first.awaits_command) || self.waiting.len() >= self.bound()
        })
    }

    /// Takes in the next record of the trip. Not to be called while the first frame is ready.
    pub(crate) fn accept(&mut self, record: &Record<'_>) -> Result<(), TripError> {
        let Record::Message { channel_id, log_time, data } = *record else { return Ok(()) };
        let logged = Stamp(i64::try_from(log_time).unwrap_or(i64::MAX));
        let is_of = |topic: &Topic| topic.channel_ids.contains(&channel_id);
        if is_of(&self.topics.frames.0) {
            self.accept_frame(data, logged)?;
        } else if let Some((topic, pose_type)) = self.topics.poses.as_ref().filter(|(topic, _)| is_of(topic))
        {
            self.n_poses += 1;
            let (at, pose) = read_pose(*pose_type, data)
                .map_err(|fault| self.message_error(topic, self.n_poses, fault))?;
            // Odometry that is lost says so with NaN: then there is no pose, and frames fare as in any other gap.
            if let Some(pose) = pose {
                self.poses.insert(at.unwrap_or(logged), pose);
            }
        } else if let Some((topic, command_type)) =
            self.topics.commands.as_ref().filter(|(topic, _)| is_of(topic))
        {
            self.n_commands += 1;
            let (at, command) = read_command(*command_type, data)
                .map_err(|fault| self.message_error(topic, self.n_commands, fault))?;
            if let Some(command) = command {
                self.commands.insert(at.unwrap_or(logged), command);
            }
        } else {
            return Ok(());
        }
        self.waiting.iter_mut().for_each(|frame| frame.settle(&self.poses, &self.commands, false));
        Ok(())
    }

    /// Takes the first frame, with the pose and the command at its time.
    ///
    /// # Panics
    ///
    /// If no frame waits, or `counts` is not as long as a frame.
    pub(crate) fn take(&mut self, counts: &mut [u16]) -> FrameInfo {
        let mut first = self.waiting.pop_front().expect("a frame is taken only when one is ready");
        first.settle(&self.poses, &self.commands, true);
        counts.copy_from_slice(&first.counts);
        self.spare.push(first.counts);
        first.info
    }

    fn accept_frame(&mut self, data: &[u8], logged: Stamp) -> Result<(), TripError> {
        let number = self.n_frames + 1;
        let mut counts = self.spare.pop().unwrap_or_default();
        let (topic, frame_type) = &self.topics.frames;
        let head = match frame_type {
            FrameType::LaserScan => read_laser_scan(data, self.unit, &mut counts),
            FrameType::Image => read_image(data, self.unit, &mut counts),
        }
        .map_err(|fault| self.message_error(topic, number, fault))?;
        let metres_per_count = self.unit.metres_per_count();
        let layout = FrameLayout { rows: head.rows, columns: head.columns, metres_per_count };
        let from = *self.layout.get_or_insert(layout);
        if layout != from {
            return Err(TripError::FrameSizeChanged {
                path: self.path.clone(),
                topic: topic.name.clone(),
                number,
                from,
                to: layout,
            });
        }
        self.waiting.push_back(Waiting {
            info: FrameInfo { captured: head.captured.unwrap_or(logged), pose: None, command: None },
            counts,
            awaits_pose: self.topics.poses.is_some(),
            awaits_command: self.topics.commands.is_some(),
        });
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

impl Waiting {
    /// Takes the pose and the command of its time where it has waited long enough for them; `at_last`: as they are.
    fn settle(&mut self, poses: &History<Pose>, commands: &History<Command>, at_last: bool) {
        let at = self.info.captured;
        if self.awaits_pose && (at_last || poses.reaches(at)) {
            self.awaits_pose = false;
            self.info.pose = pose_at(poses, at);
        }
        if self.awaits_command && (at_last || commands.reaches(at)) {
            self.awaits_command = false;
            let [held, _next] = commands.around(at);
            self.info.command = held.map(|(_, command)| command);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::catalogue::{IMAGE, ODOMETRY, TWIST_STAMPED};
    use crate::history::MAX_VALUES;
    use crate::message::{Header, ImageMessage, OdometryMessage, TwistStampedMessage, encode};

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

    fn odometry(sec: i32, nanosec: u32) -> Vec<u8> {
        encode(&OdometryMessage {
            header: Header { sec, nanosec, frame_id: "" },
            child_frame_id: "",
            position_m: [f64::from(sec), 0.0, 0.0],
            orientation_xyzw: [0.0, 0.0, 0.0, 1.0],
            pose_covariance: [[0.0; 6]; 6],
            twist: [0.0; 6],
            twist_covariance: [[0.0; 6]; 6],
        })
    }

    fn command(sec: i32) -> Vec<u8> {
        encode(&TwistStampedMessage {
            header: Header { sec, nanosec: 0, frame_id: "" },
            twist: [f64::from(sec), 0.0, 0.0, 0.0, 0.0, 0.0],
        })
    }

    /// Of images on channel 1, odometry on channel 2 and commands on channel 3.
    fn lookahead() -> Lookahead {
        let topics = Topics {
            frames: (topic(1, IMAGE), FrameType::Image),
            poses: Some((topic(2, ODOMETRY), PoseType::Odometry)),
            commands: Some((topic(3, TWIST_STAMPED), CommandType::TwistStamped)),
        };
        Lookahead::new(PathBuf::new(), Unit::new(0.001).unwrap(), topics)
    }

    fn accept(lookahead: &mut Lookahead, channel_id: u16, data: &[u8]) {
        lookahead.accept(&Record::Message { channel_id, log_time: 0, data }).unwrap();
    }

    /// Runs a trip whose odometry or commands stop after their first message; the largest number of frames that waited.
    fn most_waiting(stopping: &str, side: u32, n_frames: i32) -> usize {
        let mut lookahead = lookahead();
        accept(&mut lookahead, 2, &odometry(1, 0));
        accept(&mut lookahead, 3, &command(1));
        let mut counts = vec![0; (side * side) as usize];
        let (mut most, mut n_taken) = (0, 0);
        for sec in 1..=n_frames {
            match stopping {
                "odometry" => accept(&mut lookahead, 3, &command(sec)),
                _ => accept(&mut lookahead, 2, &odometry(sec, 0)),
            }
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
    fn the_frames_that_wait_are_bounded_when_odometry_or_commands_stop() {
        for stopping in ["odometry", "commands"] {
            assert_eq!(most_waiting(stopping, 1, 2000), MAX_WAITING_FRAMES);
            // 2048 × 2048 readings are a quarter of what may wait.
            assert_eq!(most_waiting(stopping, 2048, 8), MIN_WAITING_FRAMES);
            assert_eq!(most_waiting(stopping, 512, 80), MAX_WAITING_READINGS / (512 * 512));
        }
    }

    #[test]
    fn a_frame_that_waits_for_a_command_keeps_the_pose_that_it_has_met() {
        let mut lookahead = lookahead();
        accept(&mut lookahead, 3, &command(1));
        accept(&mut lookahead, 1, &image(2, 1));
        // More poses than are remembered, long before the next command.
        for index in 0..2 * MAX_VALUES as u32 {
            accept(&mut lookahead, 2, &odometry(2, index));
        }
        assert!(!lookahead.is_ready(false));
        accept(&mut lookahead, 3, &command(9));
        assert!(lookahead.is_ready(false));
        let FrameInfo { pose, command, .. } = lookahead.take(&mut [0]);
        assert_eq!(pose.map(|pose| pose.x_m), Some(2.0));
        assert_eq!(command, Some(Command { forward_m_s: 1.0, turn_rad_s: 0.0 }));
    }
}
