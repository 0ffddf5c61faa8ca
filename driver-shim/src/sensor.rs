//! What a device is to the shim.

use std::time::Duration;

use kinds_messages::{Command, FrameHeader, Pose, ns_since_epoch};
use kinds_trips::{FrameLayout, Stamp, TripError};

/// A source of frames.
pub trait Sensor {
    /// What all of its frames look like.
    fn layout(&self) -> FrameLayout;

    /// Waits for the next frame and writes its counts.
    ///
    /// * `counts` — `(n_readings,)`, in shared memory. After [`Reading::NotYet`] the next call gets the same slice with
    ///   what was written to it; after a frame it gets another one.
    /// * `timeout` — longest wait, so that whoever calls can end.
    ///
    /// After an error or [`Reading::End`] it is not called again.
    fn read(&mut self, counts: &mut [u16], timeout: Duration) -> Result<Reading, SensorError>;

    /// The oldest of what the device has to tell a person and has not told yet. Asked for after each [`Self::read`].
    fn news(&mut self) -> Option<String> {
        None
    }
}

/// What became of waiting for a frame.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Reading {
    /// A frame: all counts are written.
    Frame(Capture),
    /// A frame of a device that numbers its frames itself, and may not have written all of its counts.
    Numbered(NumberedFrame),
    /// None within the timeout.
    NotYet,
    /// There are no more frames.
    End,
}

/// A frame as its device numbers it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct NumberedFrame {
    /// What is known of it.
    pub capture: Capture,
    /// Its number, from 0. Numbers that never come are frames that were lost before they reached us; one that comes again,
    /// or late, is sent all the same.
    pub sequence: u64,
    /// Counts that are written, from the first: as many as the layout has, unless the device is at fault.
    pub n_readings: usize,
}

/// What is known of a frame besides its counts.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Capture {
    /// When the sensor captured it.
    pub captured: Stamp,
    /// Where the robot was, where it knew.
    pub pose: Option<Pose>,
    /// What the robot had been told to do, where it knew.
    pub command: Option<Command>,
    /// Where the robot truly was, where the device need not guess: a simulated robot's.
    pub true_pose: Option<Pose>,
}

impl Capture {
    /// Of a frame that the sensor captured then, and of which nothing else is known.
    pub fn at(captured: Stamp) -> Self {
        Self { captured, pose: None, command: None, true_pose: None }
    }

    /// Of a frame that was sent, by its header.
    pub fn of(header: &FrameHeader) -> Self {
        Self {
            captured: Stamp(header.captured_ns),
            pose: header.known_pose(),
            command: header.known_command(),
            true_pose: header.known_true_pose(),
        }
    }

    /// Of a frame that comes just now, and of which nothing else is known.
    pub fn now() -> Self {
        Self::at(Stamp(ns_since_epoch()))
    }
}

/// Why a device cannot go on.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum SensorError {
    /// A replayed trip cannot be read further.
    #[error(transparent)]
    Trip(#[from] TripError),
    /// A device that this crate does not know: its own words.
    #[error("{0}")]
    Device(Box<dyn std::error::Error + Send + Sync>),
}
