//! Which counts the frames of trips have, and how often: what the scale that frames are compared on is chosen by.

use kinds_model::response::{INVALID, TABLE_LEN};

/// Share of the valid readings that are no longer than the default largest useful range: a sensor's few wildest
/// readings must not stretch the scale.
const USEFUL_SHARE: f64 = 0.99;

/// Counts of all readings of some frames.
#[derive(Clone, Debug)]
pub struct CountsSeen {
    /// Frames.
    pub n_frames: usize,
    /// Readings of each count, shape `(65536,)`.
    n_readings_of: Vec<u64>,
}

/// Of no frames yet.
impl Default for CountsSeen {
    fn default() -> Self {
        Self { n_frames: 0, n_readings_of: vec![0; TABLE_LEN] }
    }
}

impl CountsSeen {
    /// Adds a frame.
    ///
    /// * `frame` — raw counts, shape `(n_readings,)`
    pub fn add(&mut self, frame: &[u16]) {
        self.n_frames += 1;
        frame.iter().for_each(|&count| self.n_readings_of[usize::from(count)] += 1);
    }

    /// The count that 99 of 100 valid ones do not exceed; 1 where none is valid.
    pub(crate) fn largest_useful(&self) -> f64 {
        let of = &self.n_readings_of;
        let n_valid = of.iter().sum::<u64>() - of[usize::from(INVALID)];
        let mut left = (n_valid as f64 * USEFUL_SHARE).ceil() as u64;
        let reached = (1..of.len()).find(|&count| {
            left = left.saturating_sub(of[count]);
            left == 0
        });
        reached.unwrap_or(1) as f64
    }
}
