//! The frames of one sensor on the response's scale, one row a frame.

use std::sync::Arc;

use crate::array::Array;
use crate::blocks::Blocks;

/// What one frame of a sensor looks like. Frames of another layout cannot be compared with these.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SensorLayout {
    /// Rows of pixels; 1 for a ring of ranges.
    pub rows: u32,
    /// Readings in a row.
    pub columns: u32,
    /// Metres that one raw count stands for.
    pub metres_per_count: f64,
}

impl SensorLayout {
    /// Sensors with more rows are cameras.
    pub const N_RING_ROWS_MAX: u32 = 4;

    /// D: readings in one frame.
    pub fn n_readings(&self) -> usize {
        self.rows as usize * self.columns as usize
    }

    /// Whether its rows are rings, whose last reading is beside their first: a camera's are not.
    pub fn has_rings(&self) -> bool {
        self.rows <= Self::N_RING_ROWS_MAX
    }
}

impl std::fmt::Display for SensorLayout {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let (rows, columns) = (self.rows, self.columns);
        write!(
            f,
            "{} readings ({rows} × {columns}) of {} m a count",
            self.n_readings(),
            self.metres_per_count
        )
    }
}

/// N frames of D readings, counts on the response's scale, and whatever else frames are compared by behind them: shape
/// `(n_frames, n_columns)`, of which the first `n_readings` columns are the sensor's.
#[derive(Clone, Debug)]
pub struct Frames {
    n_readings: usize,
    n_columns: usize,
    counts: Array<u16>,
    /// None where nothing is looked for among them, or so far.
    blocks: Option<Arc<Blocks>>,
}

impl Frames {
    /// Takes rows of `n_readings` counts that stand one after the other.
    ///
    /// # Panics
    /// If `n_readings` is 0 or does not divide the number of counts: a bug of the caller.
    pub fn new(n_readings: usize, counts: impl Into<Array<u16>>) -> Self {
        Self::with_more_columns(n_readings, 0, counts)
    }

    /// Takes rows of `n_readings` counts and `n_more` others.
    ///
    /// # Panics
    /// If `n_readings` is 0 or the columns do not divide the number of counts: a bug of the caller.
    pub fn with_more_columns(n_readings: usize, n_more: usize, counts: impl Into<Array<u16>>) -> Self {
        let (n_columns, counts) = (n_readings + n_more, counts.into());
        assert!(
            n_readings > 0 && counts.len().is_multiple_of(n_columns),
            "rows of {n_columns} in {}",
            counts.len()
        );
        Self { n_readings, n_columns, counts, blocks: None }
    }

    /// The same frames, ready to be searched: whoever looks for the nearest of them finds the same, sooner.
    ///
    /// Reads every frame once.
    ///
    /// # Panics
    /// If the sensor has another number of readings: a bug of the caller.
    pub fn indexed(mut self, sensor: SensorLayout) -> Self {
        assert_eq!(sensor.n_readings(), self.n_readings, "these are frames of another sensor");
        if self.blocks.is_none() {
            self.blocks = Some(Arc::new(Blocks::new(sensor, self.n_frames(), |index| self.readings(index))));
        }
        self
    }

    /// By which to search them, once they are [`indexed`](Self::indexed).
    pub(crate) fn blocks(&self) -> Option<&Blocks> {
        self.blocks.as_deref()
    }

    /// N.
    pub fn n_frames(&self) -> usize {
        self.counts.len() / self.n_columns
    }

    /// Counts in a row: readings, and what else frames are compared by.
    pub fn n_columns(&self) -> usize {
        self.n_columns
    }

    /// D.
    pub fn n_readings(&self) -> usize {
        self.n_readings
    }

    /// All that one frame is compared by, shape `(n_columns,)`.
    pub fn row(&self, frame_index: usize) -> &[u16] {
        &self.counts[frame_index * self.n_columns..][..self.n_columns]
    }

    /// What the sensor saw in one frame, shape `(n_readings,)`.
    pub fn readings(&self, frame_index: usize) -> &[u16] {
        &self.row(frame_index)[..self.n_readings]
    }

    /// Copies some of the frames.
    ///
    /// * `indices` — of the frames to copy, in the order in which they are to stand
    pub(crate) fn select(&self, indices: &[u32]) -> Self {
        let mut counts = Vec::with_capacity(indices.len() * self.n_columns);
        indices.iter().for_each(|&index| counts.extend_from_slice(self.row(index as usize)));
        Self::with_more_columns(self.n_readings, self.n_columns - self.n_readings, counts)
    }

    /// All counts, row after row.
    pub fn counts(&self) -> &[u16] {
        &self.counts
    }
}
