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
