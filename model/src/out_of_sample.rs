//! Places a frame among the reference frames: the one way, for frames of the trips that a model does not keep and for
//! those that it is served.

use std::ops::Range;

use crate::frames::Frames;
use crate::geodesics::Geodesics;
use crate::mds::Embedding;
use crate::metric::Metric;
use crate::neighbors::Neighbor;
use crate::search::Search;

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
    /// For its nearest reference frames: with geodesics, ns; without, the nearest one.
    search: Search,
    /// Shortest lengths to the landmarks, or distances, shape `(n_landmarks,)`, counts.
    lengths: Vec<f32>,
    /// δ, shape `(n_landmarks,)`, counts².
    squared_geodesics: Vec<f64>,
}

impl Placer {
    pub(crate) fn new(manifold: Manifold, n_neighbors: usize) -> Self {
        let n_landmarks = manifold.landmarks.len();
        let n_nearest = if manifold.geodesics.is_some() { n_neighbors } else { 1 };
        Self {
            search: Search::new(manifold.frames, n_nearest),
            lengths: vec![0.0; n_landmarks],
            squared_geodesics: vec![0.0; n_landmarks],
        }
    }

    /// Places one frame, and returns the reference frame nearest to it.
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
    ) -> Neighbor {
        self.place_without(metric, manifold, mapped, 0..0, coordinates)
    }

    /// The same, as if some reference frames were not there: neighbours are looked for among the others.
    ///
    /// * `hidden` — so few that neighbours enough are left
    pub(crate) fn place_without(
        &mut self,
        metric: &impl Metric,
        manifold: Manifold,
        mapped: &[u16],
        hidden: Range<u32>,
        coordinates: &mut [f64],
    ) -> Neighbor {
        let nearest = self.measure(metric, manifold, mapped, hidden);
        match manifold.embedding {
            Some(embedding) => embedding.embed(&self.squared_geodesics, coordinates),
            None => coordinates
                .iter_mut()
                .zip(mapped)
                .for_each(|(coordinate, &count)| *coordinate = f64::from(count)),
        }
        nearest
    }

    /// √δ of the frame placed last: lengths by which it was embedded, shape `(n_landmarks,)`, counts.
    pub(crate) fn lengths(&self) -> &[f32] {
        &self.lengths
    }

    /// Reference frames by which the frame placed last was placed, nearest first: ns of them with geodesics, one without.
    pub(crate) fn nearest(&self) -> &[Neighbor] {
        self.search.last()
    }

    /// Fills δ (squared shortest lengths to the landmarks, or squared distances; nothing in native space) and finds the nearest
    /// reference frame.
    fn measure(
        &mut self,
        metric: &impl Metric,
        manifold: Manifold,
        mapped: &[u16],
        hidden: Range<u32>,
    ) -> Neighbor {
        let Self { search, lengths, squared_geodesics } = self;
        let frames = manifold.frames;
        let nearest = search.nearest_without(frames, metric, mapped, hidden);
        match (manifold.geodesics, manifold.embedding) {
            (Some(geodesics), _) => {
                geodesics.through(nearest.iter().map(|near| (near.frame_index, near.distance())), lengths);
                for (squared, &length) in squared_geodesics.iter_mut().zip(&*lengths) {
                    *squared = f64::from(length) * f64::from(length);
                }
            }
            (None, Some(_)) => {
                let measured = lengths.iter_mut().zip(squared_geodesics);
                for ((length, squared), &landmark) in measured.zip(manifold.landmarks) {
                    *squared = metric.squared_distance(mapped, frames.row(landmark as usize)) as f64;
                    *length = squared.sqrt() as f32;
                }
            }
            (None, None) => {}
        }
        nearest[0]
    }
}
