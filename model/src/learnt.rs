//! The frames that a model is learnt from: those that it keeps, and those that it embeds out of sample and lets go.

use rayon::prelude::*;

use crate::fit::{Progress, Step};
use crate::frames::Frames;
use crate::graph::Edge;
use crate::intrinsic_dims::{IntrinsicDims, N_NEIGHBORS_USED};
use crate::landmarks;
use crate::metric::Metric;
use crate::model::{Model, Origin};
use crate::neighbors::{NeighborLists, length, nearest_of_each};
use crate::out_of_sample::{Manifold, Placer};
use crate::plan::{FitPlan, LandmarkChoice};
use crate::reference::ReferenceSet;
use crate::tally::Tally;

/// Frames at random that suffice to estimate an intrinsic dimension d to d / √2000, two hundredths.
const N_FRAMES_SAMPLED: usize = 2000;

/// Frames that a thread places in one go.
const N_FRAMES_AT_ONCE: usize = 64;

/// Where the frames that a model is learnt from are.
pub(crate) enum Source<'a> {
    /// In trips, all of them, on the response's scale and with their commands.
    Trips(Frames),
    /// In another model, as far as it has kept them.
    Model(&'a Model),
}

impl Source<'_> {
    /// Frames that kinds are learnt from.
    pub(crate) fn n_trained(&self) -> usize {
        match self {
            Self::Trips(trained) => trained.n_frames(),
            Self::Model(model) => model.references().n_trained(),
        }
    }
}

/// The frames that a model is learnt from.
pub(crate) struct Learnt {
    /// The reference frames.
    pub(crate) frames: Frames,
    pub(crate) references: ReferenceSet,
    /// Counts.
    pub(crate) covering_radius: f32,
    /// Of the trained frames. None where these are the reference frames, whose neighbours will tell.
    intrinsic_dims: Option<IntrinsicDims>,
    /// All of them, a row each. None where they are gone.
    trained: Option<Frames>,
}

impl Learnt {
    /// Chooses the frames that a model is to keep, or takes those that another one kept.
    pub(crate) fn by(metric: &impl Metric, source: Source, plan: &FitPlan, progress: &mut Progress) -> Self {
        match source {
            Source::Trips(trained) => {
                let mut done = |n_done| progress(Step::References, n_done, plan.n_frames_max);
                let references = ReferenceSet::choose(&trained, metric, plan.n_frames_max, &mut done);
                Self {
                    frames: references.of(&trained).indexed(plan.sensor),
                    covering_radius: references.covering_radius(&trained, metric),
                    intrinsic_dims: (!references.is_all()).then(|| sampled_dims(&trained, metric, plan)),
                    references,
                    trained: Some(trained),
                }
            }
            Source::Model(model) => {
                let provenance = &model.manifest().provenance;
                Self {
                    frames: model.frames().clone(),
                    references: model.references().clone(),
                    covering_radius: provenance.covering_radius,
                    intrinsic_dims: Some(provenance.intrinsic_dims),
                    trained: None,
                }
            }
        }
    }

    /// Dimensions that the trained frames fill.
    ///
    /// * `lists` — of the reference frames
    pub(crate) fn intrinsic_dims(&self, lists: &NeighborLists) -> IntrinsicDims {
        self.intrinsic_dims.unwrap_or_else(|| IntrinsicDims::estimate(lists))
    }

    /// Edges between reference frames that stand for frames which follow each other in a trip.
    pub(crate) fn edges_in_time(&self, metric: &impl Metric, origin: &Origin) -> Vec<Edge> {
        let edge = |(a, b): (u32, u32)| {
            let squared = metric.squared_distance(self.frames.row(a as usize), self.frames.row(b as usize));
            Edge { a, b, length: length(squared) }
        };
        self.references.consecutive(&origin.trips(self.references.n_trained())).map(edge).collect()
    }

    /// Coordinates of every trained frame, shape `(n_trained, n_dims)`: the others are placed as frames are that the model
    /// will be served, or where they are gone, at the reference frame that stands for them.
    ///
    /// * `kept` — coordinates of the reference frames, shape `(n_frames, n_dims)`
    ///
    /// The same on any number of threads. O(n_trained · n_frames) distances.
    pub(crate) fn place(
        &self,
        metric: &impl Metric,
        manifold: Manifold,
        n_neighbors: usize,
        kept: Vec<f64>,
        progress: &mut Progress,
    ) -> Vec<f64> {
        if self.references.is_all() {
            return kept;
        }
        let n_trained = self.references.n_trained();
        let n_dims = kept.len() / self.frames.n_frames();
        let mut coordinates = vec![0.0; n_trained * n_dims];
        let mut told =
            |n_done| progress(Step::Embedding, n_trained.min(n_done * N_FRAMES_AT_ONCE), n_trained);
        let tally = Tally::new(&mut told);
        let chunks = coordinates.par_chunks_mut(N_FRAMES_AT_ONCE * n_dims).enumerate();
        let placer = || Placer::new(manifold, n_neighbors);
        chunks.with_max_len(1).for_each_init(placer, |placer, (chunk, places)| {
            for (index, place) in (chunk * N_FRAMES_AT_ONCE..).zip(places.chunks_exact_mut(n_dims)) {
                let nearest = self.references.nearest()[index] as usize;
                match &self.trained {
                    Some(trained) if self.references.indices()[nearest] as usize != index => {
                        placer.place(metric, manifold, trained.row(index), place);
                    }
                    _ => place.copy_from_slice(&kept[nearest * n_dims..][..n_dims]),
                }
            }
            tally.add();
        });
        coordinates
    }
}

/// Dimensions that trained frames fill, by some of them at random. Frames that were chosen to be far from each other are no
/// measure: their neighbours are all as far as the next, as in a space of many dimensions.
fn sampled_dims(trained: &Frames, metric: &impl Metric, plan: &FitPlan) -> IntrinsicDims {
    let sample = landmarks::choose(trained, metric, N_FRAMES_SAMPLED, LandmarkChoice::Random, plan.seed);
    let n_listed = N_NEIGHBORS_USED.min(sample.len() - 1);
    IntrinsicDims::estimate(&nearest_of_each(
        &trained.select(&sample).indexed(plan.sensor),
        metric,
        n_listed,
        &mut |_| (),
    ))
}
