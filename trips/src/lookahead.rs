//! Frames that wait for the pose and the command after them.
//!
//! A frame's pose lies between two messages of odometry, of which the second comes later in the recording, and may come
//! later still because it is logged late. Its command is the last before it, of which nobody can tell that it is the last
//! before the next has come. So frames wait here, in order, until a pose and a command as late as the first of them
//! have come, or until as many wait as there may: the queue has a bound, and so has a trip's memory.
//!
//! What is joined with a frame waits likewise for each partner's frame after it ([`Partner`]).
//!
//! Each frame takes its pose as soon as that is there, and does not leave it to the end of its wait: where a teleoperator
//! holds a stick still for long, and commands come on change only, poses would be forgotten meanwhile.

use std::collections::VecDeque;
use std::path::PathBuf;
use std::time::Duration;

use crate::catalogue::{CommandType, Encoding, FrameTopics, FrameType, PoseType, Topic};
use crate::counts::{INVALID, Unit};
use crate::frame_message::{FrameHead, Range, quoted, read_frame, read_range};
use crate::history::History;
use crate::message::{read_command, read_pose};
use crate::partner::{Partner, join};
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
    pub(crate) frames: FrameTopics,
    pub(crate) poses: Option<(Topic, PoseType)>,
    pub(crate) commands: Option<(Topic, CommandType)>,
}

/// The frames read ahead, and the poses and commands around them.
pub(crate) struct Lookahead {
    /// The trip's file, for errors.
    path: PathBuf,
    unit: Unit,
    topics: Topics,
    /// Of each topic with frames, what they look like, once there was one.
    layouts: Vec<Option<FrameLayout>>,
    waiting: VecDeque<Waiting>,
    /// Buffers of frames that were taken, for the next.
    spare: Vec<Vec<u16>>,
    around: Around,
    /// Of each topic with frames, if these are single ranges, whose they are.
    range_ids: Vec<Option<Vec<u8>>>,
    /// Messages of each topic with frames.
    n_frames: Vec<u64>,
    /// Of each such topic but the first, frames for which there was none near enough.
    n_missing: Vec<u64>,
    n_poses: u64,
    n_commands: u64,
}

/// What a trip said at moments around those of the frames that wait.
#[derive(Default)]
struct Around {
    poses: History<Pose>,
    commands: History<Command>,
    /// Of each topic with frames but the first.
    partners: Vec<Partner>,
}

struct Waiting {
    info: FrameInfo,
    counts: Vec<u16>,
    awaits_partners: bool,
    awaits_pose: bool,
    awaits_command: bool,
}

impl Lookahead {
    /// * `layouts` — what the frames of each topic look like: known, where there are several
    /// * `tolerance` — how much older than the first topic's frames those of the others may be
    pub(crate) fn new(
        path: PathBuf,
        unit: Unit,
        topics: Topics,
        layouts: Vec<Option<FrameLayout>>,
        tolerance: Duration,
    ) -> Self {
        let partner = |layout: &Option<FrameLayout>| {
            Partner::new(layout.expect("what partners look like is known").n_readings(), tolerance)
        };
        let partners: Vec<Partner> = layouts[1..].iter().map(partner).collect();
        Self {
            path,
            unit,
            topics,
            waiting: VecDeque::new(),
            spare: Vec::new(),
            range_ids: vec![None; layouts.len()],
            n_frames: vec![0; layouts.len()],
            n_missing: vec![0; partners.len()],
            around: Around { partners, ..Around::default() },
            layouts,
            n_poses: 0,
            n_commands: 0,
        }
    }

    pub(crate) fn topics(&self) -> &Topics {
        &self.topics
    }

    /// The layout of all frames, once there was one: of those that several topics make together, a row.
    pub(crate) fn layout(&self) -> Option<FrameLayout> {
        let first = self.layouts[0]?;
        if self.around.partners.is_empty() {
            return Some(first);
        }
        let n_readings =
            first.n_readings() + self.around.partners.iter().map(Partner::n_readings).sum::<usize>();
        Some(FrameLayout { rows: 1, columns: n_readings as u32, ..first })
    }

    /// Frames taken in so far.
    pub(crate) fn n_frames(&self) -> u64 {
        self.n_frames[0]
    }

    /// Whether the first frame has waited long enough. `no_more`: nothing more will come.
    pub(crate) fn is_ready(&self, no_more: bool) -> bool {
        self.waiting
            .front()
            .is_some_and(|first| no_more || !first.awaits_anything() || self.waiting.len() >= self.bound())
    }

    /// Takes in the next record of the trip. Not to be called while the first frame is ready.
    pub(crate) fn accept(&mut self, record: &Record<'_>) -> Result<(), TripError> {
        let Record::Message { channel_id, log_time, data, .. } = *record else { return Ok(()) };
        let logged = Stamp(i64::try_from(log_time).unwrap_or(i64::MAX));
        let is_of = |topic: &Topic| topic.channel_ids.contains(&channel_id);
        if let Some(index) = self.topics.frames.0.iter().position(|(topic, _)| is_of(topic)) {
            self.accept_frame(index, data, logged)?;
        } else if let Some((topic, pose_type)) = self.topics.poses.as_ref().filter(|(topic, _)| is_of(topic))
        {
            self.n_poses += 1;
            let (at, pose) = read_pose(*pose_type, encoding(topic), data)
                .map_err(|fault| self.message_error(topic, self.n_poses, fault))?;
            // Odometry that is lost says so with NaN: then there is no pose, and frames fare as in any other gap.
            if let Some(pose) = pose {
                self.around.poses.insert(at.unwrap_or(logged), pose);
            }
        } else if let Some((topic, command_type)) =
            self.topics.commands.as_ref().filter(|(topic, _)| is_of(topic))
        {
            self.n_commands += 1;
            let (at, command) = read_command(*command_type, encoding(topic), data)
                .map_err(|fault| self.message_error(topic, self.n_commands, fault))?;
            if let Some(command) = command {
                self.around.commands.insert(at.unwrap_or(logged), command);
            }
        } else {
            return Ok(());
        }
        self.waiting.iter_mut().for_each(|frame| frame.settle(&self.around, &mut self.n_missing, false));
        Ok(())
    }

    /// Takes the first frame, with the pose and the command at its time.
    ///
    /// # Panics
    ///
    /// If no frame waits, or `counts` is not as long as a frame.
    pub(crate) fn take(&mut self, counts: &mut [u16]) -> FrameInfo {
        let mut first = self.waiting.pop_front().expect("a frame is taken only when one is ready");
        first.settle(&self.around, &mut self.n_missing, true);
        counts.copy_from_slice(&first.counts);
        self.spare.push(first.counts);
        first.info
    }

    /// For how many frames there was none near enough, of each topic of which that was so, and of what sort it is.
    pub(crate) fn missing_partners(&self) -> impl Iterator<Item = (&str, u64, &Partner)> {
        let partners = self.topics.frames.0[1..].iter().zip(&self.n_missing).zip(&self.around.partners);
        let missing = partners.filter(|((_, n_missing), _)| **n_missing > 0);
        missing.map(|(((topic, _), n_missing), partner)| (topic.name.as_str(), *n_missing, partner))
    }

    /// Takes in a frame of one of the topics.
    ///
    /// * `index` — which; the first is the one whose frames are taken, with what belongs to them of the others
    fn accept_frame(&mut self, index: usize, data: &[u8], logged: Stamp) -> Result<(), TripError> {
        let number = self.n_frames[index] + 1;
        let mut counts = self.spare.pop().unwrap_or_default();
        let (topic, frame_type) = &self.topics.frames.0[index];
        let head = match frame_type {
            FrameType::Range => {
                let range = read_range(encoding(topic), data, self.unit)
                    .and_then(|range| of_one_sensor(range, &mut self.range_ids[index]));
                counts.clear();
                range.map(|Range { captured, count, .. }| {
                    counts.push(count);
                    FrameHead { captured, rows: 1, columns: 1 }
                })
            }
            _ => read_frame(*frame_type, encoding(topic), data, self.unit, &mut counts),
        };
        let head = head.map_err(|fault| self.message_error(topic, number, fault))?;
        let layout = head.layout(self.unit);
        let from = *self.layouts[index].get_or_insert(layout);
        if layout != from {
            return Err(TripError::FrameSizeChanged {
                path: self.path.clone(),
                topic: topic.name.clone(),
                number,
                from,
                to: layout,
            });
        }
        self.n_frames[index] = number;
        let captured = head.captured.unwrap_or(logged);
        match index.checked_sub(1) {
            Some(partner) => {
                self.around.partners[partner].insert(captured, &counts);
                self.spare.push(counts);
            }
            None => self.queue(captured, counts),
        }
        Ok(())
    }

    /// Has a frame wait for what belongs to it.
    fn queue(&mut self, captured: Stamp, mut counts: Vec<u16>) {
        let n_readings = self.layout().expect("there is a frame").n_readings();
        counts.resize(n_readings, INVALID);
        self.waiting.push_back(Waiting {
            info: FrameInfo { captured, pose: None, command: None },
            counts,
            awaits_partners: !self.around.partners.is_empty(),
            awaits_pose: self.topics.poses.is_some(),
            awaits_command: self.topics.commands.is_some(),
        });
    }

    fn message_error(&self, topic: &Topic, number: u64, fault: MessageFault) -> TripError {
        TripError::Message { path: self.path.clone(), topic: topic.name.clone(), number, fault }
    }

    /// Frames that may wait.
    fn bound(&self) -> usize {
        let n_readings = self.layout().map_or(1, |layout| layout.n_readings());
        (MAX_WAITING_READINGS / n_readings).clamp(MIN_WAITING_FRAMES, MAX_WAITING_FRAMES)
    }

    /// Frames that wait, and buffers kept for more.
    #[cfg(test)]
    pub(crate) fn n_buffers(&self) -> (usize, usize) {
        (self.waiting.len(), self.spare.len())
    }
}

impl Waiting {
    fn awaits_anything(&self) -> bool {
        self.awaits_partners || self.awaits_pose || self.awaits_command
    }

    /// Takes what was said around its time where it has waited long enough for that; `at_last`: as it is.
    fn settle(&mut self, around: &Around, n_missing: &mut [u64], at_last: bool) {
        let at = self.info.captured;
        if self.awaits_partners && (at_last || around.partners.iter().all(|partner| partner.reaches(at))) {
            self.awaits_partners = false;
            let n_joined: usize = around.partners.iter().map(Partner::n_readings).sum();
            join(at, self.counts.len() - n_joined, around.partners.iter(), &mut self.counts);
            for (partner, n_missing) in around.partners.iter().zip(n_missing) {
                *n_missing += u64::from(partner.at(at).is_none());
            }
        }
        if self.awaits_pose && (at_last || around.poses.reaches(at)) {
            self.awaits_pose = false;
            self.info.pose = pose_at(&around.poses, at);
        }
        if self.awaits_command && (at_last || around.commands.reaches(at)) {
            self.awaits_command = false;
            let [held, _next] = around.commands.around(at);
            self.info.command = held.map(|(_, command)| command);
        }
    }
}

/// A range, if it is of the sensor that those before on its topic are of.
fn of_one_sensor<'a>(range: Range<'a>, frame_id: &mut Option<Vec<u8>>) -> Result<Range<'a>, MessageFault> {
    let before = frame_id.get_or_insert_with(|| range.frame_id.to_owned());
    match before == range.frame_id {
        true => Ok(range),
        false => Err(MessageFault::OtherSensor { from: quoted(before), to: quoted(range.frame_id) }),
    }
}

/// How a chosen topic's messages are encoded: none is chosen of which that is not known.
pub(crate) fn encoding(topic: &Topic) -> Encoding {
    topic.encoding().unwrap_or(Encoding::Cdr)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::catalogue::{IMAGE, ODOMETRY, TWIST_STAMPED};
    use crate::history::MAX_VALUES;
    use crate::message::{Header, ImageMessage, OdometryMessage, TwistStampedMessage, encode};

    fn topic(channel_id: u32, type_name: &str) -> Topic {
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
            frames: FrameTopics(vec![(topic(1, IMAGE), FrameType::Image)]),
            poses: Some((topic(2, ODOMETRY), PoseType::Odometry)),
            commands: Some((topic(3, TWIST_STAMPED), CommandType::TwistStamped)),
        };
        Lookahead::new(PathBuf::new(), Unit::new(0.001).unwrap(), topics, vec![None], Duration::ZERO)
    }

    fn accept(lookahead: &mut Lookahead, channel_id: u32, data: &[u8]) {
        let message = Record::Message { channel_id, sequence: 0, log_time: 0, publish_time: 0, data };
        lookahead.accept(&message).unwrap();
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
