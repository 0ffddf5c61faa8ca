//! Features: what a frame's readings say by themselves of how unlike others it is, without any other frame.

use rayon::prelude::*;

use crate::form::Tiles;
use crate::frames::SensorLayout;
use crate::metric::AnyMetric;
use crate::texture::{Texture, Weave};

/// How features are measured.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Extractor {
    weave: Weave,
    tiles: Option<Tiles>,
}

/// Of one frame.
#[derive(Clone, Debug, Default)]
pub(crate) struct Features {
    pub(crate) texture: Texture,
    /// Logarithms of the means of tiles, shape `(n_tiles,)`, nats; empty where frames have none.
    pub(crate) means: Vec<f64>,
}

/// Of many frames.
#[derive(Clone, Debug, Default)]
pub(crate) struct ManyFeatures {
    pub(crate) textures: Vec<Texture>,
    /// Shape `(n_frames, n_tiles)`, nats.
    pub(crate) means: Vec<f32>,
}

impl Extractor {
    /// For a sensor whose frames are compared by a metric.
    pub(crate) fn new(sensor: SensorLayout, metric: &AnyMetric) -> Self {
        Self { weave: Weave::new(sensor, metric), tiles: Tiles::new(sensor, metric) }
    }

    /// Tiles of a frame; 0 where frames have none.
    pub(crate) fn n_tiles(&self) -> usize {
        self.tiles.map_or(0, |tiles| tiles.n_tiles())
    }

    /// Memory for the features of a frame.
    pub(crate) fn memory(&self) -> Features {
        Features { texture: Texture::default(), means: vec![0.0; self.n_tiles()] }
    }

    /// Measures a frame. Allocates nothing.
    ///
    /// * `readings` — on the response's scale
    /// * `features` — overwritten
    pub(crate) fn extract(&self, readings: &[u16], features: &mut Features) {
        features.texture = self.weave.of(readings);
        if let Some(tiles) = &self.tiles {
            tiles.measure(readings, &mut features.means);
        }
    }

    /// Measures frames.
    pub(crate) fn extract_all<'r>(
        &self,
        readings: impl IndexedParallelIterator<Item = &'r [u16]>,
    ) -> ManyFeatures {
        let of_frame = |features: &mut Features, readings| {
            self.extract(readings, features);
            features.clone()
        };
        let features: Vec<Features> = readings.map_init(|| self.memory(), of_frame).collect();
        let mut all = ManyFeatures::default();
        features.iter().for_each(|features| all.push(features));
        all
    }
}

impl ManyFeatures {
    pub(crate) fn n_frames(&self) -> usize {
        self.textures.len()
    }

    pub(crate) fn push(&mut self, features: &Features) {
        self.textures.push(features.texture);
        self.means.extend(features.means.iter().map(|&mean| mean as f32));
    }
}
