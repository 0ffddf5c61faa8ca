//! A trip whose frames have been classified, as the figures of trips take it.

use kinds_trips::Pose;

/// When and where a robot saw which kind, frame by frame.
#[derive(Clone, Copy, Debug)]
pub struct TripKinds<'a> {
    /// What to call the trip.
    pub title: &'a str,
    /// When the sensor took each frame, seconds, ascending, shape `(n_frames,)`; best from the start of the trip.
    pub seconds: &'a [f64],
    /// Where the robot was then, if that is known, shape `(n_frames,)`.
    pub poses: &'a [Option<Pose>],
    /// The most probable kind, shape `(n_frames,)`.
    pub kinds: &'a [usize],
}
