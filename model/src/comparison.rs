//! Comparison: what of a raw frame is compared with others.

use std::sync::Arc;

use crate::frames::SensorLayout;
use crate::response::Response;
use crate::whitening::Whitening;

/// From raw counts to what is compared: readings on the response's scale, or slow directions of these.
#[derive(Clone, Debug)]
pub(crate) struct Comparison {
    pub(crate) response: Response,
    pub(crate) whitening: Option<Arc<Whitening>>,
}

impl Comparison {
    /// What is compared, laid out as if a sensor had read it.
    pub(crate) fn layout(&self, sensor: SensorLayout) -> SensorLayout {
        match &self.whitening {
            None => sensor,
            Some(whitening) => SensorLayout { rows: 1, columns: whitening.n_directions() as u32, ..sensor },
        }
    }

    /// Memory that [`Self::map`] works in.
    pub(crate) fn scratch(&self) -> Vec<u16> {
        vec![0; self.whitening.as_ref().map_or(0, |whitening| whitening.n_readings())]
    }

    /// The readings of a frame that was mapped, on the response's scale.
    ///
    /// * `scratch`, `compared` — as [`Self::map`] left them
    pub(crate) fn readings<'a>(&self, scratch: &'a [u16], compared: &'a [u16]) -> &'a [u16] {
        if self.whitening.is_some() { scratch } else { compared }
    }

    /// Maps a frame, and returns the number of invalid readings in it. Allocates nothing.
    ///
    /// * `raw` — raw counts, shape `(n_readings,)`
    /// * `compared` — overwritten; what is compared of it
    pub(crate) fn map(&self, raw: &[u16], scratch: &mut [u16], compared: &mut [u16]) -> usize {
        match &self.whitening {
            None => self.response.map(raw, compared),
            Some(whitening) => {
                let n_invalid = self.response.map(raw, scratch);
                whitening.map(scratch, compared);
                n_invalid
            }
        }
    }
}
