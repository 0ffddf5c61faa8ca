//! Lengths from every frame to every landmark, by whichever method: what the coordinates are to keep.

use rayon::prelude::*;

use crate::frames::Frames;
use crate::geodesics::Geodesics;
use crate::metric::Metric;

/// Lengths from N frames to n landmarks.
pub(crate) enum Lengths {
    /// Shortest paths in the neighbour graph.
    Geodesic(Geodesics),
    /// Distances by the metric, squared as whole numbers: exact, as serving computes them.
    Straight {
        /// n.
        n_landmarks: usize,
        /// Shape `(n_frames, n_landmarks)`, counts².
        squared: Vec<f64>,
    },
}

impl Lengths {
    /// Measures distances. O(n_frames · n_landmarks · n_readings) on the threads of whoever calls.
    pub(crate) fn straight(frames: &Frames, metric: &impl Metric, landmarks: &[u32]) -> Self {
        let n_landmarks = landmarks.len();
        let mut squared = vec![0.0; frames.n_frames() * n_landmarks];
        squared.par_chunks_exact_mut(n_landmarks).enumerate().for_each(|(frame_index, row)| {
            for (squared, &landmark) in row.iter_mut().zip(landmarks) {
                *squared =
                    metric.squared_distance(frames.row(frame_index), frames.row(landmark as usize)) as f64;
            }
        });
        Self::Straight { n_landmarks, squared }
    }

    /// N.
    pub(crate) fn n_frames(&self) -> usize {
        match self {
            Self::Geodesic(geodesics) => geodesics.n_frames(),
            Self::Straight { n_landmarks, squared } => squared.len() / n_landmarks,
        }
    }

    /// From a frame to the landmark in a lane, counts².
    pub(crate) fn squared(&self, frame_index: usize, lane: usize) -> f64 {
        match self {
            Self::Geodesic(geodesics) => f64::from(geodesics.row(frame_index)[lane]).powi(2),
            Self::Straight { n_landmarks, squared } => squared[frame_index * n_landmarks + lane],
        }
    }

    /// From a frame to the landmark in a lane, counts.
    pub(crate) fn length(&self, frame_index: usize, lane: usize) -> f64 {
        // Of a square of f32 in f64, which is exact, the root is that f32 again.
        self.squared(frame_index, lane).sqrt()
    }

    /// δ of a frame.
    ///
    /// * `row` — shape `(n_landmarks,)`, counts²; overwritten
    pub(crate) fn squared_row(&self, frame_index: usize, row: &mut [f64]) {
        row.iter_mut().enumerate().for_each(|(lane, squared)| *squared = self.squared(frame_index, lane));
    }

    /// The geodesics, where these are what was measured.
    pub(crate) fn into_geodesics(self) -> Option<Geodesics> {
        match self {
            Self::Geodesic(geodesics) => Some(geodesics),
            Self::Straight { .. } => None,
        }
    }
}
