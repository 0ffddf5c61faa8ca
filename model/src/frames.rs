//! The frames of one sensor on the response's scale, one row a frame.

use std::collections::TryReserveError;
use std::ops::Deref;
use std::sync::Arc;

use crate::array::Array;
use crate::blocks::{Blocks, Sketch};

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

    /// Whether counts of both stand for as many metres. One may have been through a text, so that they are the same where they
    /// differ by less than a billionth; what is not a number is another unit.
    pub fn has_unit_of(&self, other: &Self) -> bool {
        const TOLERANCE: f64 = 1e-9;
        (self.metres_per_count - other.metres_per_count).abs() <= TOLERANCE * other.metres_per_count
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
pub struct Frames<C = Array<u16>> {
    n_readings: usize,
    n_columns: usize,
    counts: C,
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
}

impl<C: Deref<Target = [u16]>> Frames<C> {
    /// By which to search them, once they are [`indexed`](Frames::indexed).
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

    /// All counts, row after row.
    pub fn counts(&self) -> &[u16] {
        &self.counts
    }
}

/// Frames that come one after the other, ready to be searched at any time.
pub(crate) struct GrowingFrames {
    frames: Frames<Vec<u16>>,
    sketch: Sketch,
}

impl GrowingFrames {
    /// None yet.
    ///
    /// * `n_columns` — `n_readings`, and what else frames are compared by
    /// * `n_frames_max` — frames that memory is reserved for
    ///
    /// # Errors
    /// If there is not so much memory.
    pub(crate) fn new(
        sensor: SensorLayout,
        n_columns: usize,
        n_frames_max: usize,
    ) -> Result<Self, TryReserveError> {
        let mut counts = Vec::new();
        counts.try_reserve_exact(n_frames_max.saturating_mul(n_columns))?;
        let blocks = Blocks::none(sensor, n_frames_max);
        let sketch = blocks.sketch();
        let frames =
            Frames { n_readings: sensor.n_readings(), n_columns, counts, blocks: Some(Arc::new(blocks)) };
        Ok(Self { frames, sketch })
    }

    /// Adds a frame.
    ///
    /// * `row` — shape `(n_columns,)`
    pub(crate) fn push(&mut self, row: &[u16]) {
        let Self { frames, sketch } = self;
        assert_eq!(row.len(), frames.n_columns, "frames have as many columns as each other");
        let blocks = frames.blocks.as_mut().and_then(Arc::get_mut).expect("blocks that nobody shares");
        blocks.push(sketch, &row[..frames.n_readings]);
        frames.counts.extend_from_slice(row);
    }

    /// Keeps some of the frames and forgets the others.
    ///
    /// * `indices` — ascending
    pub(crate) fn keep(&mut self, indices: &[u32]) {
        let Self { frames, sketch } = self;
        let n_columns = frames.n_columns;
        let blocks = frames.blocks.as_mut().and_then(Arc::get_mut).expect("blocks that nobody shares");
        blocks.clear();
        for (to, &from) in indices.iter().enumerate() {
            let from = from as usize * n_columns;
            frames.counts.copy_within(from..from + n_columns, to * n_columns);
            blocks.push(sketch, &frames.counts[to * n_columns..][..frames.n_readings]);
        }
        frames.counts.truncate(indices.len() * n_columns);
    }

    /// As they are now.
    pub(crate) fn frames(&self) -> &Frames<Vec<u16>> {
        &self.frames
    }

    /// For good.
    pub(crate) fn into_frames(self) -> Frames {
        let Frames { n_readings, n_columns, mut counts, blocks } = self.frames;
        counts.shrink_to_fit();
        Frames { n_readings, n_columns, counts: counts.into(), blocks }
    }
}
