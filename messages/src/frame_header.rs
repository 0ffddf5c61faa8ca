//! What travels with a frame's counts: layout version 1, the same for every language.

use iceoryx2::prelude::ZeroCopySend;

/// Place of the robot on the floor when a frame was captured, in the frame that the robot calls fixed (ROS: `odom` or
/// `map`).
#[derive(Clone, Copy, Debug, Default, PartialEq, ZeroCopySend)]
#[repr(C)]
#[type_name("natural_kinds::Pose")]
pub struct Pose {
    /// Forward of the fixed frame's origin, metres.
    pub x_m: f64,
    /// Left of the fixed frame's origin, metres.
    pub y_m: f64,
    /// Heading counter-clockwise from the fixed frame's x axis, radians.
    pub yaw_rad: f64,
}

/// What the robot had been told to do when a frame was captured.
#[derive(Clone, Copy, Debug, Default, PartialEq, ZeroCopySend)]
#[repr(C)]
#[type_name("natural_kinds::Command")]
pub struct Command {
    /// Speed forward, metres per second.
    pub forward_m_s: f64,
    /// Turn counter-clockwise, radians per second.
    pub turn_rad_s: f64,
}

/// Everything about a frame but its counts, which are the message's payload: `rows` × `columns` of `u16`, row by row,
/// 0 for a reading without measurement.
// Only integers and floats, since anything else from a faulty writer could be undefined behaviour in a reader. No padding;
// offsets are asserted below, and stand in `consumers/layout.csv` for all languages. Words here are the C header's too.
#[derive(Clone, Copy, Debug, PartialEq, ZeroCopySend)]
#[repr(C)]
#[type_name("natural_kinds::FrameHeader")]
pub struct FrameHeader {
    /// `VERSION` of the program that wrote this.
    pub version: u32,
    /// `HAS_POSE`, `HAS_COMMAND` and `HAS_TRUE_POSE`, or-ed.
    pub flags: u32,
    /// Start of the publishing driver shim, ns since the epoch. Identifies a run, within which `sequence` counts; it
    /// is compared for equality only, since the wall clock may be set between two runs.
    pub run: u64,
    /// Number of this frame within its run, from 0.
    pub sequence: u64,
    /// When the sensor captured the frame, ns since the epoch.
    pub captured_ns: i64,
    /// When the frame was sent, ns on CLOCK_MONOTONIC. Set by sending.
    pub sent_monotonic_ns: u64,
    /// Metres that one count stands for.
    pub metres_per_count: f64,
    /// Rows of the sensor: 1 for a ring.
    pub rows: u32,
    /// Columns of the sensor.
    pub columns: u32,
    /// Where the robot takes itself to have been. Meaningful with `HAS_POSE`.
    pub pose: Pose,
    /// What the robot had been told to do. Meaningful with `HAS_COMMAND`.
    pub command: Command,
    /// Where the robot was, told by somebody who need not guess: a simulation, a tracking system. For judging kinds and
    /// poses, never for making them. Meaningful with `HAS_TRUE_POSE`.
    pub true_pose: Pose,
}

const _: () = {
    use std::mem::{offset_of, size_of};
    assert!(offset_of!(FrameHeader, version) == 0);
    assert!(offset_of!(FrameHeader, flags) == 4);
    assert!(offset_of!(FrameHeader, run) == 8);
    assert!(offset_of!(FrameHeader, sequence) == 16);
    assert!(offset_of!(FrameHeader, captured_ns) == 24);
    assert!(offset_of!(FrameHeader, sent_monotonic_ns) == 32);
    assert!(offset_of!(FrameHeader, metres_per_count) == 40);
    assert!(offset_of!(FrameHeader, rows) == 48);
    assert!(offset_of!(FrameHeader, columns) == 52);
    assert!(offset_of!(FrameHeader, pose) == 56);
    assert!(offset_of!(FrameHeader, command) == 80);
    assert!(offset_of!(FrameHeader, true_pose) == 96);
    assert!(size_of::<FrameHeader>() == 120);
    assert!(size_of::<Pose>() == 24);
    assert!(size_of::<Command>() == 16);
};

impl FrameHeader {
    /// Version of this layout. Readers refuse frames of any other.
    pub const VERSION: u32 = 1;
    /// The robot knew where it was.
    pub const HAS_POSE: u32 = 1;
    /// The robot knew what it had been told to do.
    pub const HAS_COMMAND: u32 = 2;
    /// Somebody knew where the robot truly was.
    pub const HAS_TRUE_POSE: u32 = 4;

    /// This header with a pose, or without.
    pub fn with_pose(mut self, pose: Option<Pose>) -> Self {
        self.set_flag(Self::HAS_POSE, pose.is_some());
        self.pose = pose.unwrap_or_default();
        self
    }

    /// This header with a command, or without.
    pub fn with_command(mut self, command: Option<Command>) -> Self {
        self.set_flag(Self::HAS_COMMAND, command.is_some());
        self.command = command.unwrap_or_default();
        self
    }

    /// This header with a true pose, or without.
    pub fn with_true_pose(mut self, true_pose: Option<Pose>) -> Self {
        self.set_flag(Self::HAS_TRUE_POSE, true_pose.is_some());
        self.true_pose = true_pose.unwrap_or_default();
        self
    }

    /// The pose, where the robot knew it.
    pub fn known_pose(&self) -> Option<Pose> {
        (self.flags & Self::HAS_POSE != 0).then_some(self.pose)
    }

    /// The command, where the robot knew it.
    pub fn known_command(&self) -> Option<Command> {
        (self.flags & Self::HAS_COMMAND != 0).then_some(self.command)
    }

    /// The true pose, where somebody knew it.
    pub fn known_true_pose(&self) -> Option<Pose> {
        (self.flags & Self::HAS_TRUE_POSE != 0).then_some(self.true_pose)
    }

    fn set_flag(&mut self, flag: u32, on: bool) {
        self.flags = if on { self.flags | flag } else { self.flags & !flag };
    }
}

/// A header of this version in which nothing is known yet.
impl Default for FrameHeader {
    fn default() -> Self {
        Self {
            version: Self::VERSION,
            flags: 0,
            run: 0,
            sequence: 0,
            captured_ns: 0,
            sent_monotonic_ns: 0,
            metres_per_count: 0.0,
            rows: 0,
            columns: 0,
            pose: Pose::default(),
            command: Command::default(),
            true_pose: Pose::default(),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testing::assert_layout;

    #[test]
    fn layout_is_the_one_that_other_languages_see() {
        assert_layout!("kinds_pose", Pose, [x_m, y_m, yaw_rad]);
        assert_layout!("kinds_command", Command, [forward_m_s, turn_rad_s]);
        assert_layout!(
            "kinds_frame_header",
            FrameHeader,
            [
                version,
                flags,
                run,
                sequence,
                captured_ns,
                sent_monotonic_ns,
                metres_per_count,
                rows,
                columns,
                pose,
                command,
                true_pose
            ]
        );
    }

    #[test]
    fn poses_and_command_are_known_only_when_given() {
        let pose = Pose { x_m: 1.0, y_m: 2.0, yaw_rad: 0.5 };
        let true_pose = Pose { x_m: 1.1, ..pose };
        let command = Command { forward_m_s: 0.2, turn_rad_s: -0.1 };
        let neither = FrameHeader::default();
        assert_eq!((neither.known_pose(), neither.known_command()), (None, None));
        let both = neither.with_pose(Some(pose)).with_command(Some(command));
        assert_eq!((both.known_pose(), both.known_command()), (Some(pose), Some(command)));
        assert_eq!(both.known_true_pose(), None);
        let all = both.with_true_pose(Some(true_pose));
        assert_eq!((all.known_pose(), all.known_true_pose()), (Some(pose), Some(true_pose)));
        assert_eq!(both.with_pose(None).known_pose(), None);
        assert_eq!(both.with_pose(None).known_command(), Some(command));
    }
}
