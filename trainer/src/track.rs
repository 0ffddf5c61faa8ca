//! When and where the frames of a trip were taken, and what the robot was told: what is needed of a trip once its frames are
//! learnt or classified.

use kinds_trips::{Command, Pose, Stamp};

use crate::survey::Survey;
use crate::trip_kinds::TripKinds;

/// When and where a robot took the frames of a trip, and what it had been told to do.
#[derive(Clone, Debug, PartialEq)]
pub struct Track {
    /// What to call the trip: its file's name, without folder and extension.
    pub title: String,
    /// When the sensor took each frame, seconds from the trip's first, shape `(n_frames,)`.
    pub seconds: Vec<f64>,
    /// Where the robot was then, if that is known, shape `(n_frames,)`.
    pub poses: Vec<Option<Pose>>,
    /// What it had been told to do, if that is known, shape `(n_frames,)`.
    pub commands: Vec<Option<Command>>,
}

impl Track {
    /// Of all frames that have a valid reading.
    pub fn of(trip: &Survey) -> Self {
        let start_ns = trip.captured.first().map_or(0, |captured| captured.0);
        let seconds = |captured: &Stamp| (captured.0 - start_ns) as f64 / 1e9;
        Self {
            title: trip.title(),
            seconds: trip.captured.iter().map(seconds).collect(),
            poses: trip.poses.clone(),
            commands: trip.commands.clone(),
        }
    }

    /// Number of frames.
    pub fn n_frames(&self) -> usize {
        self.poses.len()
    }

    /// The trip with the most probable kind of each frame.
    ///
    /// * `kinds` — shape `(n_frames,)`
    pub fn with_kinds<'a>(&'a self, kinds: &'a [usize]) -> TripKinds<'a> {
        TripKinds {
            title: &self.title,
            seconds: &self.seconds,
            poses: &self.poses,
            commands: &self.commands,
            kinds,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use kinds_model::SensorLayout;

    #[test]
    fn time_runs_from_the_trips_first_frame_though_nobody_knew_where_that_was() {
        let place = Some(Pose { x_m: 1.0, y_m: 2.0, yaw_rad: 0.5 });
        let trip = Survey {
            path: "trips/fourth-floor-1.mcap".into(),
            layout: SensorLayout { rows: 1, columns: 1, metres_per_count: 0.001 },
            captured: [1_000_000_000, 1_250_000_000, 1_500_000_000].map(Stamp).to_vec(),
            poses: vec![None, place, place],
            commands: vec![None; 3],
            n_frames_invalid: 0,
            remarks: Vec::new(),
        };
        let expected = Track {
            title: "fourth-floor-1".to_string(),
            seconds: vec![0.0, 0.25, 0.5],
            poses: vec![None, place, place],
            commands: vec![None; 3],
        };
        assert_eq!(Track::of(&trip), expected);
    }
}
