//! What a frame looks like, and what is known about one besides its counts.

use std::fmt;

use crate::{Command, Pose, Stamp};

/// How the readings of a frame lie, and their unit. All frames of a trip have the same.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct FrameLayout {
    /// Rows of readings: 1 for a laser scan, the height of an image.
    pub rows: u32,
    /// Readings in a row.
    pub columns: u32,
    /// Metres that one count stands for.
    pub metres_per_count: f64,
}

impl FrameLayout {
    /// Readings in one frame: rows × columns, row by row.
    pub fn n_readings(&self) -> usize {
        self.rows as usize * self.columns as usize
    }
}

/// `19840 readings (124 × 160)`
impl fmt::Display for FrameLayout {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{} readings ({} × {})", self.n_readings(), self.rows, self.columns)
    }
}

/// What is known about one frame besides its counts.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct FrameInfo {
    /// When the sensor took it: the message's own stamp, or the time it was logged if that stamp is zero.
    pub captured: Stamp,
    /// Where the robot was then, if the trip says so.
    pub pose: Option<Pose>,
    /// What it had been told to do by then, if the trip says so.
    pub command: Option<Command>,
}
