//! A trip whose frames have been classified: what figures, maps and policies are made of.

use kinds_trips::{Command, Pose};

/// When and where a robot saw which kind, and what it had been told to do, frame by frame.
#[derive(Clone, Copy, Debug)]
pub struct TripKinds<'a> {
    /// What to call the trip.
    pub title: &'a str,
    /// When the sensor took each frame, seconds, ascending, shape `(n_frames,)`; best from the start of the trip.
    pub seconds: &'a [f64],
    /// Where the robot was then, if that is known, shape `(n_frames,)`.
    pub poses: &'a [Option<Pose>],
    /// What it had been told to do then, if that is known, shape `(n_frames,)`.
    pub commands: &'a [Option<Command>],
    /// The most probable kind, shape `(n_frames,)`.
    pub kinds: &'a [usize],
}

impl TripKinds<'_> {
    /// Number of frames.
    pub fn n_frames(&self) -> usize {
        self.kinds.len()
    }

    /// When the last frame's turn is over: a usual distance between frames after it, seconds.
    pub fn end_s(&self) -> f64 {
        let mut steps: Vec<f64> = self.seconds.windows(2).map(|pair| pair[1] - pair[0]).collect();
        steps.sort_by(f64::total_cmp);
        self.seconds.last().copied().unwrap_or(0.0) + steps.get(steps.len() / 2).copied().unwrap_or(0.0)
    }

    /// When a frame's turn begins, seconds; for the number of frames, when the last one's is over.
    pub(crate) fn turn_s(&self, frame: usize) -> f64 {
        self.seconds.get(frame).copied().unwrap_or_else(|| self.end_s())
    }
}
