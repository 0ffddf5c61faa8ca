//! Places a frame among the reference frames: the one way, for frames of the trips that a model does not keep and for
//! those that it is served.

use crate::frames::Frames;
use crate::geodesics::Geodesics;
use crate::mds::Embedding;
use crate::metric::Metric;
use crate::neighbors::{Neighbor, nearest, squared_distances};

/// What a frame is placed by: parts of a model, or of one that is being fitted.
#[derive(Clone, Copy)]
pub(crate) struct Manifold<'a> {
    pub(crate) frames: &'a Frames,
    /// Frame indices, shape `(n_landmarks,)`; none in native space.
    pub(crate) landmarks: &'a [u32],
    /// None where lengths are straight distances: these are taken from the frames.
    pub(crate) geodesics: Option<&'a Geodesics>,
    /// None in native space: there the frame itself is its place.
    pub(crate) embedding: Option<&'a Embedding>,
}

/// Memory that placing a frame takes.
pub(crate) struct Placer {
    /// Its nearest reference frames: with geodesics, shape `(n_neighbors,)`; in native space, the nearest one.
    nearest: Vec<Neighbor>,
    /// To all reference frames, shape `(n_frames,)`, counts². Empty where straight distances are not embedded.
    squared_distances: Vec<u64>,
    /// Shortest lengths to the landmarks, shape `(n_landmarks,)`, counts.
    lengths: Vec<f32>,
    /// δ, shape `(n_landmarks,)`, counts².
    squared_geodesics: Vec<f64>,
}

impl Placer {
    pub(crate) fn new(manifold: Manifold, n_neighbors: usize) -> Self {
        let n_landmarks = manifold.landmarks.len();
        let (n_nearest, n_distances) = match (manifold.geodesics, manifold.embedding) {
            (Some(_), _) => (n_neighbors, 0),
            (None, Some(_)) => (0, manifold.frames.n_frames()),
            (None, None) => (1, 0),
        };
        Self {
            nearest: vec![Neighbor { squared_distance: 0, frame_index: 0 }; n_nearest],
            squared_distances: vec![0; n_distances],
            lengths: vec![0.0; n_landmarks],
            squared_geodesics: vec![0.0; n_landmarks],
        }
    }

    /// Places one frame, and returns its squared distance to the nearest reference frame, counts².
    ///
    /// * `mapped` — the frame on the response's scale and its command, shape `(n_columns,)`
    /// * `coordinates` — shape `(n_dims,)`, counts; overwritten
    ///
    /// Allocates nothing. O(n_frames) distances.
    pub(crate) fn place(
        &mut self,
        metric: &impl Metric,
        manifold: Manifold,
        mapped: &[u16],
        coordinates: &mut [f64],
    ) -> u64 {
        let squared_to_nearest = self.measure(metric, manifold, mapped);
        match manifold.embedding {
            Some(embedding) => embedding.embed(&self.squared_geodesics, coordinates),
            None => coordinates
                .iter_mut()
                .zip(mapped)
                .for_each(|(coordinate, &count)| *coordinate = f64::from(count)),
        }
        squared_to_nearest
    }

    /// Fills δ (squared shortest lengths to the landmarks, or squared distances; nothing in native space) and finds how far the
    /// nearest reference frame is.
    fn measure(&mut self, metric: &impl Metric, manifold: Manifold, mapped: &[u16]) -> u64 {
        match (manifold.geodesics, manifold.embedding) {
            (Some(geodesics), _) => {
                nearest(manifold.frames, metric, mapped, &mut self.nearest);
                let nearest = self.nearest.iter().map(|near| (near.frame_index, near.distance()));
                geodesics.through(nearest, &mut self.lengths);
                for (squared, &length) in self.squared_geodesics.iter_mut().zip(&self.lengths) {
                    *squared = f64::from(length) * f64::from(length);
                }
                self.nearest[0].squared_distance
            }
            (None, Some(_)) => {
                squared_distances(manifold.frames, metric, mapped, &mut self.squared_distances);
                for (squared, &landmark) in self.squared_geodesics.iter_mut().zip(manifold.landmarks) {
                    *squared = self.squared_distances[landmark as usize] as f64;
                }
                self.squared_distances.iter().copied().min().unwrap_or(u64::MAX)
            }
            (None, None) => {
                nearest(manifold.frames, metric, mapped, &mut self.nearest);
                self.nearest[0].squared_distance
            }
        }
    }
}
