//! The simulated robots whose frames are classified, and how a model of them is fitted.

use std::ops::RangeFrom;

use kinds_driver_shim::simulated::{Chew, Crunch, Floor, Robot};
use kinds_model::{EmPlan, FitPlan, ResponsePlan, Scale, SensorLayout};

/// Trips of the reference frames.
pub(crate) const LEARNT: RangeFrom<u32> = 0..;
/// Trips of the frames that are classified: far beyond those before.
pub(crate) const CLASSIFIED: RangeFrom<u32> = 100..;

/// A simulated robot with a sensor.
pub(crate) struct Simulated {
    pub(crate) name: &'static str,
    drive: fn(trip: u32) -> Box<dyn Robot>,
    range_m_max: f64,
    n_dims: usize,
}

pub(crate) const RING: Simulated = Simulated {
    name: "ring",
    drive: |trip| Box::new(Crunch::new(Floor::Fourth, trip, 0)),
    range_m_max: 7.0,
    n_dims: 8,
};

pub(crate) const CAMERA: Simulated =
    Simulated { name: "camera", drive: |trip| Box::new(Chew::new(trip, 0)), range_m_max: 7.5, n_dims: 15 };

impl Simulated {
    /// What its model is like, in words.
    pub(crate) fn title(&self) -> String {
        let FitPlan { sensor, n_neighbors, n_landmarks, n_dims, n_kinds, .. } = self.plan(0);
        let [n_neighbors, n_dims, n_kinds] = [n_neighbors, n_dims, n_kinds].map(|n| n.expect("it is given"));
        format!(
            "{} of {} readings, {n_neighbors} neighbours, {n_landmarks} landmarks, {n_dims} dimensions, {n_kinds} kinds",
            self.name,
            sensor.n_readings()
        )
    }

    /// * `n_frames` — reference frames
    pub(crate) fn plan(&self, n_frames: usize) -> FitPlan {
        let layout = (self.drive)(0).layout();
        FitPlan {
            n_frames_max: n_frames,
            n_neighbors: Some(10),
            n_landmarks: 500,
            n_dims: Some(self.n_dims),
            n_kinds: Some(8),
            em: EmPlan { n_starts: 1, ..EmPlan::new(0) },
            ..FitPlan::new(
                SensorLayout {
                    rows: layout.rows,
                    columns: layout.columns,
                    metres_per_count: layout.metres_per_count,
                },
                ResponsePlan::new(Scale::Inverse, self.range_m_max),
                0,
            )
        }
    }

    /// The first frames of one trip after the other, raw counts, shape `(n_frames, n_readings)`.
    pub(crate) fn frames(&self, trips: RangeFrom<u32>, n_frames: usize) -> Vec<u16> {
        let mut frame = vec![0; self.plan(0).sensor.n_readings()];
        let n_counts = n_frames * frame.len();
        let mut counts = Vec::with_capacity(n_counts);
        for mut robot in trips.map(self.drive) {
            while counts.len() < n_counts && robot.step(&mut frame).is_some() {
                counts.extend_from_slice(&frame);
            }
            if counts.len() == n_counts {
                break;
            }
        }
        counts
    }
}
