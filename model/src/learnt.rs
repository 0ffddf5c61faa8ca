//! The frames that a model is learnt from: those that it keeps, and those that it embeds out of sample and lets go.

use rayon::prelude::*;

use crate::features::{Extractor, ManyFeatures};
use crate::fit::{Progress, Step, no_room};
use crate::form::Form;
use crate::frames::{Frames, GrowingFrames, SensorLayout};
use crate::graph::Edge;
use crate::intrinsic_dims::{IntrinsicDims, N_NEIGHBORS_USED};
use crate::landmarks;
use crate::metric::Metric;
use crate::model::{Model, Origin};
use crate::neighbors::{NeighborLists, length, nearest_of_each, neighbor};
use crate::novelty::N_HELD_OUT_MAX;
use crate::out_of_sample::{Manifold, Placer};
use crate::plan::FitPlan;
use crate::reference::{Kept, ReferenceSet};
use crate::search::Search;
use crate::stream::{Stream, StreamError};
use crate::texture::{N_WAYS, Texture};

/// Frames at random that suffice to estimate an intrinsic dimension d to d / √2000, two hundredths.
const N_FRAMES_SAMPLED: usize = 2000;

/// Where the frames that a model is learnt from are.
pub(crate) enum Source<'a, E> {
    /// In memory, as they are compared and with their commands, and their features: all of them are reference frames.
    All(Frames, ManyFeatures),
    /// Wherever they are read from: some of them are reference frames.
    Stream(Stream<'a, E>),
    /// In another model, as far as it has kept them.
    Model(&'a Model),
}

impl<E: Send> Source<'_, E> {
    /// Frames that kinds are learnt from.
    pub(crate) fn n_trained(&self) -> usize {
        match self {
            Self::All(trained, _) => trained.n_frames(),
            Self::Stream(stream) => stream.n_frames(),
            Self::Model(model) => model.references().n_trained(),
        }
    }
}

/// The frames that a model is learnt from.
pub(crate) struct Learnt<'a, E> {
    /// The reference frames.
    pub(crate) frames: Frames,
    trained: Trained<'a, E>,
    /// Of the trained frames. None where these are the reference frames, whose neighbours will tell.
    intrinsic_dims: Option<IntrinsicDims>,
    held_out: HeldOut,
}

/// Some trained frames at random, from which is learnt what is usual.
pub(crate) struct HeldOut {
    /// Among the trained frames, ascending.
    pub(crate) trained: Vec<u32>,
    /// Theirs; all alike where nobody knows it any more.
    pub(crate) textures: Vec<Texture>,
    /// What all trained frames look like; none where frames have no form, or nobody knows it any more.
    pub(crate) form: Option<Form>,
    /// What they measure by the form of frames at other times; 0 where there is none.
    pub(crate) distances: Vec<f64>,
    rows: Rows,
}

enum Rows {
    /// They are reference frames; of those gone no others are left.
    OfReferences(Vec<u32>),
    Copied(Frames),
}

/// What there is of the trained frames, beyond the reference frames.
enum Trained<'a, E> {
    /// There are no others.
    AsKept,
    /// They can be read again.
    Read {
        stream: Box<Stream<'a, E>>,
        /// Which of them the reference frames are, ascending.
        kept: Vec<u32>,
    },
    /// They are gone.
    Gone(&'a Model),
}

/// Where the trained frames are.
pub(crate) struct Placed {
    pub(crate) references: ReferenceSet,
    /// Farthest that a trained frame is from the nearest reference frame, counts.
    pub(crate) covering_radius: f32,
    /// Of every trained frame, shape `(n_trained, n_dims)`.
    pub(crate) coordinates: Vec<f64>,
    pub(crate) held_out: HeldOut,
}

impl HeldOut {
    /// * `features` — of the reference frames
    fn of_references(references: &ReferenceSet, features: &ManyFeatures, seed: u64) -> Self {
        let chosen = landmarks::at_random(references.n_frames(), N_HELD_OUT_MAX, seed);
        let trained: Vec<u32> =
            chosen.iter().map(|&reference| references.indices()[reference as usize]).collect();
        let (textures, form, distances) = looks(features, &chosen);
        Self { trained, textures, form, distances, rows: Rows::OfReferences(chosen) }
    }

    /// Every second frame of some that were sampled already.
    ///
    /// * `sample` — which of the trained frames they are
    /// * `features` — of all trained frames from the first one on, which none of the sampled comes before
    fn of_sampled(sample: &[u32], sampled: &Frames, features: &ManyFeatures, first: u32) -> Self {
        let rows = (0..sample.len()).step_by(2).flat_map(|index| sampled.row(index));
        let rows: Vec<u16> = rows.copied().collect();
        let n_more = sampled.n_columns() - sampled.n_readings();
        let rows = Frames::with_more_columns(sampled.n_readings(), n_more, rows);
        let trained: Vec<u32> = sample.iter().copied().step_by(2).collect();
        let chosen: Vec<u32> = trained.iter().map(|trained| trained - first).collect();
        let (textures, form, distances) = looks(features, &chosen);
        Self { trained, textures, form, distances, rows: Rows::Copied(rows) }
    }

    /// What one of them is compared by, by its place among them, shape `(n_columns,)`.
    ///
    /// * `frames` — the reference frames
    pub(crate) fn row<'a>(&'a self, frames: &'a Frames, index: usize) -> &'a [u16] {
        match &self.rows {
            Rows::OfReferences(chosen) => frames.row(chosen[index] as usize),
            Rows::Copied(rows) => rows.row(index),
        }
    }
}

/// Of some frames among all: their textures, what all look like, and how far each of the some is from that.
fn looks(features: &ManyFeatures, chosen: &[u32]) -> (Vec<Texture>, Option<Form>, Vec<f64>) {
    let textures = chosen.iter().map(|&frame| features.textures[frame as usize]).collect();
    match features.means.len() / features.n_frames() {
        0 => (textures, None, vec![0.0; chosen.len()]),
        n_tiles => {
            let (form, distances) = Form::learn(&features.means, n_tiles, chosen);
            (textures, Some(form), distances)
        }
    }
}

impl<'a, E: Send> Learnt<'a, E> {
    /// Chooses the frames that a model is to keep, or takes those that another one kept.
    ///
    /// * `compared` — what is compared of a frame
    ///
    /// # Errors
    /// If frames cannot be read, or there is no memory for those to keep.
    pub(crate) fn by(
        metric: &impl Metric,
        source: Source<'a, E>,
        compared: SensorLayout,
        plan: &FitPlan,
        progress: &mut Progress,
    ) -> Result<Self, StreamError<E>> {
        match source {
            Source::All(trained, features) => {
                let frames = trained.indexed(compared);
                let references = ReferenceSet::all(frames.n_frames());
                let held_out = HeldOut::of_references(&references, &features, plan.seed);
                Ok(Self { frames, trained: Trained::AsKept, intrinsic_dims: None, held_out })
            }
            Source::Stream(stream) => Self::choose(metric, stream, compared, plan, progress),
            Source::Model(model) => {
                let frames = model.frames();
                let readings = (0..frames.n_frames()).into_par_iter().map(|index| frames.readings(index));
                let features = match model.whitening() {
                    None => Extractor::new(model.layout(), model.metric()).extract_all(readings),
                    // Of frames that are kept along slow directions nobody knows their readings any more.
                    Some(_) => ManyFeatures {
                        textures: vec![[0.0; N_WAYS]; frames.n_frames()],
                        ..ManyFeatures::default()
                    },
                };
                Ok(Self {
                    frames: frames.clone(),
                    trained: Trained::Gone(model),
                    intrinsic_dims: Some(model.manifest().provenance.intrinsic_dims),
                    held_out: HeldOut::of_references(model.references(), &features, plan.seed),
                })
            }
        }
    }

    /// Chooses reference frames in one pass.
    fn choose(
        metric: &impl Metric,
        mut stream: Stream<'a, E>,
        compared: SensorLayout,
        plan: &FitPlan,
        progress: &mut Progress,
    ) -> Result<Self, StreamError<E>> {
        let (n_trained, n_columns) = (stream.n_frames(), stream.n_columns());
        let no_room = |_| no_room(plan, n_trained, n_columns);
        let mut kept =
            Kept::new(metric, compared, n_columns, plan.n_frames_max, n_trained).map_err(no_room)?;
        let sample = stream.sample(N_FRAMES_SAMPLED, plan.seed);
        let mut sampled = GrowingFrames::new(compared, n_columns, sample.len()).map_err(no_room)?;
        let pass = stream.pass(&mut |first, rows| {
            kept.pass(first, rows);
            for (index, row) in (first as u32..).zip(rows.chunks_exact(n_columns)) {
                // Sampled frames come in their order.
                if sample.get(sampled.frames().n_frames()) == Some(&index) {
                    sampled.push(row);
                }
            }
            progress(Step::References, first + rows.len() / n_columns, n_trained);
        });
        pass.map_err(StreamError::Read)?;
        let (frames, kept) = kept.into_references();
        let sampled = sampled.into_frames();
        let intrinsic_dims = Some(dims_of(&sampled, metric));
        let first = stream.first_with_features() as u32;
        let held_out = HeldOut::of_sampled(&sample, &sampled, &stream.features, first);
        Ok(Self {
            frames,
            trained: Trained::Read { stream: Box::new(stream), kept },
            intrinsic_dims,
            held_out,
        })
    }

    /// Dimensions that the trained frames fill.
    ///
    /// * `lists` — of the reference frames
    pub(crate) fn intrinsic_dims(&self, lists: &NeighborLists) -> IntrinsicDims {
        self.intrinsic_dims.unwrap_or_else(|| IntrinsicDims::estimate(lists))
    }

    /// Edges between reference frames that stand for frames which follow each other in a trip. Where not all trained frames
    /// are at hand, in a pass of its own.
    ///
    /// # Errors
    /// If frames cannot be read.
    pub(crate) fn edges_in_time(
        &mut self,
        metric: &impl Metric,
        origin: &Origin,
        progress: &mut Progress,
    ) -> Result<Vec<Edge>, StreamError<E>> {
        let frames = &self.frames;
        let references = match &mut self.trained {
            Trained::AsKept => ReferenceSet::all(frames.n_frames()),
            Trained::Gone(model) => model.references().clone(),
            Trained::Read { stream, kept } => {
                let n_trained = stream.n_frames();
                let nearest = stream.map(
                    || Search::new(frames, 1),
                    |search, index, row| match kept.binary_search(&index) {
                        Ok(reference) => reference as u32,
                        Err(_) => search.nearest(frames, metric, row)[0].frame_index,
                    },
                    &mut |n_done| progress(Step::References, n_done, n_trained),
                );
                let nearest = nearest.map_err(StreamError::Read)?;
                ReferenceSet::from_parts(kept.clone().into(), nearest.into())
            }
        };
        let edge = |(a, b): (u32, u32)| {
            let squared = metric.squared_distance(frames.row(a as usize), frames.row(b as usize));
            Edge { a, b, length: length(squared) }
        };
        Ok(references.consecutive(&origin.trips(references.n_trained())).map(edge).collect())
    }

    /// Places every trained frame: reference frames where they are, the others in a pass over them, as frames are that the model
    /// will be served, or where they are gone, at the reference frame that stands for them.
    ///
    /// * `at` — coordinates of the reference frames, shape `(n_frames, n_dims)`
    ///
    /// The same on any number of threads. O(n_trained · n_frames) distances at worst.
    ///
    /// # Errors
    /// If frames cannot be read.
    pub(crate) fn place(
        self,
        metric: &impl Metric,
        manifold: Manifold,
        n_neighbors: usize,
        at: Vec<f64>,
        progress: &mut Progress,
    ) -> Result<Placed, StreamError<E>> {
        let (n_frames, held_out) = (self.frames.n_frames(), self.held_out);
        let n_dims = at.len() / n_frames;
        let at_reference = |reference: usize| &at[reference * n_dims..][..n_dims];
        match self.trained {
            Trained::AsKept => {
                let references = ReferenceSet::all(n_frames);
                Ok(Placed { references, covering_radius: 0.0, coordinates: at, held_out })
            }
            Trained::Gone(model) => {
                let references = model.references().clone();
                let places = references.nearest().iter().map(|&nearest| at_reference(nearest as usize));
                let coordinates = places.flatten().copied().collect();
                let covering_radius = model.manifest().provenance.covering_radius;
                Ok(Placed { references, covering_radius, coordinates, held_out })
            }
            Trained::Read { mut stream, kept } => {
                let n_trained = stream.n_frames();
                let placed = stream.map(
                    || Placer::new(manifold, n_neighbors),
                    |placer, index, row| match kept.binary_search(&index) {
                        Ok(reference) => (neighbor(reference, 0), at_reference(reference).to_vec()),
                        Err(_) => {
                            let mut place = vec![0.0; n_dims];
                            (placer.place(metric, manifold, row, &mut place), place)
                        }
                    },
                    &mut |n_done| progress(Step::Embedding, n_done, n_trained),
                );
                let placed = placed.map_err(StreamError::Read)?;
                let nearest: Vec<u32> = placed.iter().map(|(nearest, _)| nearest.frame_index).collect();
                let squared_radius = placed.iter().map(|(nearest, _)| nearest.squared_distance).max();
                Ok(Placed {
                    references: ReferenceSet::from_parts(kept.into(), nearest.into()),
                    covering_radius: length(squared_radius.unwrap_or(0)),
                    coordinates: placed.into_iter().flat_map(|(_, place)| place).collect(),
                    held_out,
                })
            }
        }
    }
}

/// Dimensions that trained frames fill, by some of them at random. Frames that were chosen to be far from each other are no
/// measure: their neighbours are all as far as the next, as in a space of many dimensions.
fn dims_of(sampled: &Frames, metric: &impl Metric) -> IntrinsicDims {
    let n_listed = N_NEIGHBORS_USED.min(sampled.n_frames() - 1);
    IntrinsicDims::estimate(&nearest_of_each(sampled, metric, n_listed, &mut |_| ()))
}
