//! From frames to coordinates: neighbours, graph, geodesics and scaling, by a metric.

use rayon::prelude::*;

use crate::fit::{FitError, Progress, Step};
use crate::frames::{Frames, SensorLayout};
use crate::geodesics::Geodesics;
use crate::graph::{Edge, Graph};
use crate::intrinsic_dims::N_NEIGHBORS_USED;
use crate::landmarks;
use crate::learnt::{HeldOut, Learnt, Placed, Source};
use crate::lengths::Lengths;
use crate::mds::Embedding;
use crate::metric::Metric;
use crate::model::Provenance;
use crate::neighborhood::{N_NEIGHBORS_TRIED_MAX, N_NEIGHBORS_USUAL, chosen, try_neighbors};
use crate::neighbors::{NeighborLists, nearest_of_each};
use crate::out_of_sample::Manifold;
use crate::plan::{FitPlan, Method};
use crate::reference::ReferenceSet;
use crate::residual_variance::{
    N_DIMS_BEYOND_ELBOW, N_DIMS_REPORTED, elbow, fewest_within_tolerance, residual_variance,
};
use crate::stream::StreamError;

/// All that follows from how far apart frames are.
pub(crate) struct Located {
    /// The reference frames.
    pub(crate) frames: Frames,
    pub(crate) references: ReferenceSet,
    pub(crate) n_neighbors: usize,
    /// None in native space.
    pub(crate) landmarks: Vec<u32>,
    /// Only by Isomap.
    pub(crate) geodesics: Option<Geodesics>,
    /// None in native space.
    pub(crate) embedding: Option<Embedding>,
    /// Of the trained frames, shape `(n_trained, n_dims)`, counts.
    pub(crate) coordinates: Vec<f64>,
    /// Of the reference frames, ascending, counts².
    pub(crate) squared_radii: Vec<u64>,
    pub(crate) held_out: HeldOut,
}

/// What the neighbour graph is made of.
struct Links<'a, M> {
    frames: &'a Frames,
    metric: &'a M,
    lists: &'a NeighborLists,
    /// Edges between frames that follow each other.
    in_time: &'a [Edge],
}

impl Located {
    /// By a metric, for which its loops are compiled.
    ///
    /// * `compared` — what is compared of a frame
    ///
    /// # Errors
    /// If frames cannot be read, or their lengths make no coordinates.
    pub(crate) fn by<M: Metric, E: Send>(
        metric: &M,
        source: Source<E>,
        compared: SensorLayout,
        plan: &FitPlan,
        provenance: &mut Provenance,
        progress: &mut Progress,
    ) -> Result<Self, StreamError<E>> {
        let mut learnt = Learnt::by(metric, source, compared, plan, progress)?;
        let frames = &learnt.frames.clone();
        let n_frames = frames.n_frames();
        // As many as anything asks for: those beyond ns cost next to nothing.
        let n_listed =
            plan.n_neighbors.unwrap_or(N_NEIGHBORS_TRIED_MAX).max(N_NEIGHBORS_USED).min(n_frames - 1);
        let mut done = |n_done| progress(Step::Neighbors, n_done, n_frames);
        let lists = nearest_of_each(frames, metric, n_listed, &mut done);
        let landmarks = match plan.method {
            Method::Native => Vec::new(),
            _ => landmarks::choose(frames, metric, plan.n_landmarks, plan.landmark_choice, plan.seed),
        };
        let in_time = match plan.consecutive_edges {
            true => learnt.edges_in_time(metric, &provenance.origin, progress)?,
            false => Vec::new(),
        };
        provenance.intrinsic_dims = learnt.intrinsic_dims(&lists);
        let links = Links { frames, metric, lists: &lists, in_time: &in_time };
        let n_neighbors = links.find_neighbors(&landmarks, plan, provenance, progress);
        let lengths = match plan.method {
            Method::Isomap => {
                let graph = links.join(n_neighbors, provenance);
                let mut done = |n_done| progress(Step::Geodesics, n_done, landmarks.len());
                Some(Lengths::Geodesic(Geodesics::measure(&graph, &landmarks, &mut done)))
            }
            Method::Pca => Some(Lengths::straight(frames, metric, &landmarks)),
            Method::Native => None,
        };
        progress(Step::Embedding, 0, 1);
        let (embedding, kept) = match &lengths {
            Some(lengths) => {
                let (embedding, kept) = embed(lengths, &landmarks, plan, provenance)?;
                (Some(embedding), kept)
            }
            None => (None, as_they_are(frames)?),
        };
        let geodesics = lengths.and_then(Lengths::into_geodesics);
        let manifold = Manifold {
            frames,
            landmarks: &landmarks,
            geodesics: geodesics.as_ref(),
            embedding: embedding.as_ref(),
        };
        let placed = learnt.place(metric, manifold, n_neighbors, kept, progress)?;
        progress(Step::Embedding, 1, 1);
        let Placed { references, covering_radius, coordinates, held_out } = placed;
        provenance.covering_radius = covering_radius;
        let mut squared_radii: Vec<u64> =
            lists.nearest(n_neighbors).map(|list| list[n_neighbors - 1].squared_distance).collect();
        squared_radii.sort_unstable();
        Ok(Self {
            frames: frames.clone(),
            references,
            n_neighbors,
            landmarks,
            geodesics,
            embedding,
            coordinates,
            squared_radii,
            held_out,
        })
    }
}

impl<M: Metric> Links<'_, M> {
    /// The number of neighbours that the plan asks for or the evidence speaks for.
    fn find_neighbors(
        &self,
        landmarks: &[u32],
        plan: &FitPlan,
        provenance: &mut Provenance,
        progress: &mut Progress,
    ) -> usize {
        let Self { frames, metric, lists, in_time } = *self;
        match (plan.n_neighbors, plan.method) {
            (Some(n_neighbors), _) => n_neighbors,
            // There is no graph; the distance of a new frame to the nearest is judged by that of reference frames to so many.
            (None, Method::Pca | Method::Native) => N_NEIGHBORS_USUAL.min(lists.k()),
            (None, Method::Isomap) => {
                let mut done = |n_done, n_tried| progress(Step::Neighborhood, n_done, n_tried);
                provenance.neighbors_tried =
                    try_neighbors(frames, metric, lists, in_time, landmarks, plan.n_dims, &mut done);
                chosen(&provenance.neighbors_tried).expect("one number is tried at least").n_neighbors
            }
        }
    }

    /// The neighbour graph in one piece.
    fn join(&self, n_neighbors: usize, provenance: &mut Provenance) -> Graph {
        let Self { frames, metric, lists, in_time } = *self;
        let mut graph = Graph::union(lists, n_neighbors, in_time);
        provenance.islands = graph.islands().iter().map(Vec::len).collect();
        let between =
            |a: u32, b: u32| metric.squared_distance(frames.row(a as usize), frames.row(b as usize));
        provenance.bridges =
            graph.join_islands(between).iter().map(|bridge| (bridge.a, bridge.b, bridge.length)).collect();
        graph
    }
}

/// Scales the landmarks and embeds every reference frame. Returns the embedding, and coordinates of shape
/// `(n_frames, n_dims)`.
fn embed(
    lengths: &Lengths,
    landmarks: &[u32],
    plan: &FitPlan,
    provenance: &mut Provenance,
) -> Result<(Embedding, Vec<f64>), FitError> {
    let (n_frames, n_landmarks) = (lengths.n_frames(), landmarks.len());
    let between = |i: usize, j: usize| lengths.squared(landmarks[i] as usize, j);
    // Where all are at the first one's place, all are at one place.
    if (0..n_landmarks).all(|lane| between(0, lane) == 0.0) {
        return Err(FitError::AllEqual { n_frames });
    }
    let n_dims_max = plan.n_dims.unwrap_or(0).max(N_DIMS_REPORTED);
    let (embedding, spectrum) = Embedding::fit(n_landmarks, between, n_dims_max, plan.n_dims.unwrap_or(1))?;
    provenance.negative_share = spectrum.negative_share;
    provenance.eigenvalues = spectrum.eigenvalues.iter().take(n_dims_max).copied().collect();

    let mut coordinates = vec![0.0; n_frames * embedding.n_dims()];
    coordinates.par_chunks_exact_mut(embedding.n_dims()).enumerate().for_each_init(
        || vec![0.0; n_landmarks],
        |delta, (frame_index, place)| {
            lengths.squared_row(frame_index, delta);
            embedding.embed(delta, place);
        },
    );
    let length = |frame_index, lane| lengths.length(frame_index, lane);
    provenance.residual_variance = residual_variance(&coordinates, embedding.n_dims(), landmarks, length);

    let curve = &provenance.residual_variance;
    provenance.elbow = elbow(&curve[..curve.len().min(N_DIMS_REPORTED)]);
    provenance.n_dims_within_tolerance = fewest_within_tolerance(curve);
    // Of slow directions no more than there are: principal components, which it may be compared with, have no more.
    let n_dims_max =
        plan.whitening.map_or(embedding.n_dims(), |asked| embedding.n_dims().min(asked.n_directions));
    let n_dims = plan.n_dims.unwrap_or((provenance.elbow + N_DIMS_BEYOND_ELBOW).min(n_dims_max));
    let kept: Vec<f64> =
        coordinates.chunks_exact(embedding.n_dims()).flat_map(|place| &place[..n_dims]).copied().collect();
    Ok((embedding.truncated(n_dims), kept))
}

/// Coordinates of native space, shape `(n_frames, n_readings)`.
fn as_they_are(frames: &Frames) -> Result<Vec<f64>, FitError> {
    let n_frames = frames.n_frames();
    if (1..n_frames).all(|index| frames.row(index) == frames.row(0)) {
        return Err(FitError::AllEqual { n_frames });
    }
    Ok(frames.counts().iter().map(|&count| f64::from(count)).collect())
}
