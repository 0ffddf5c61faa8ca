//! How many neighbours the graph has, by evidence: graphs of more and more neighbours, and what speaks for each.
//!
//! Too few neighbours leave islands, and every bridge between them is a guess that residual variance takes for good: long
//! lengths that one dimension explains. So what is tried begins where nearly all frames are on one island. Few more make a
//! graph that is hardly more than the thread of the trip: geodesics are time, which residual variance takes for good too.
//! So there are [`N_NEIGHBORS_USUAL`] at least, unless so many make a short circuit. Too many link frames of different
//! places, and no embedding keeps their geodesics. So of those, the fewest are taken whose residual variance is within
//! [`TOLERANCE`] of the least: what is left of a smaller difference is how the landmarks fell, and every neighbour more may
//! be of another place.
//!
//! A *short circuit* is flagged where the median geodesic falls by more than a tenth from one number to the next, or the
//! residual variance doubles. Only the second ends what is chosen from: on recorded trips paths straighten by a tenth while
//! few neighbours become a few more.
//!
//! Neighbour lists are nested, so that the islands of a graph of more neighbours are unions of those of one of fewer. Its
//! bridges are among the other's: what a minimum spanning set leaves out is the longest edge of some round, and stays that
//! when frames are merged. So islands are joined once, at the fewest neighbours that are tried. Edges that every graph has,
//! between frames that follow each other, change none of this.

use crate::frames::Frames;
use crate::geodesics::Geodesics;
use crate::graph::{Edge, Graph};
use crate::mds::Embedding;
use crate::metric::Metric;
use crate::model::NeighborsTrial;
use crate::neighbors::NeighborLists;
use crate::residual_variance::{N_DIMS_BEYOND_ELBOW, N_DIMS_REPORTED, TOLERANCE, elbow, residual_variance};

/// Most neighbours that are tried.
pub const N_NEIGHBORS_TRIED_MAX: usize = 30;

/// Most bridges that the fewest neighbours tried may leave, where there is a choice.
pub const N_BRIDGES_FEW: usize = 3;

/// Share of the frames that should be on the largest island of the fewest neighbours tried: some frames are unlike all
/// others, and it takes many neighbours to reach them.
pub const LARGEST_ISLAND_SHARE: f64 = 0.95;

/// Fewest neighbours that are chosen where they make no short circuit. On a simulated campus of 877 camera frames residual
/// variance is least at 2 neighbours, where kinds are consistent by κ = .35, against .46 at 10.
pub const N_NEIGHBORS_USUAL: usize = 10;

/// Landmarks that suffice to compare numbers of neighbours: each gives a length to every frame.
const N_LANDMARKS: usize = 100;

/// Share by which the median geodesic falls from one number to the next where there may be a short circuit.
const SHORT_CIRCUIT_FALL: f64 = 0.1;

/// Factor by which the residual variance rises where there may be one: a roll whose turns touch goes from 0.001 to 0.03,
/// while its median geodesic falls by 9 %.
const SHORT_CIRCUIT_RISE: f64 = 2.0;

/// Tries numbers of neighbours: the fewest that leave at most [`N_BRIDGES_FEW`] bridges and [`LARGEST_ISLAND_SHARE`] of the
/// frames on one island, and each above up to [`N_NEIGHBORS_TRIED_MAX`] or the length of the lists. Where none leaves as
/// many frames on one island, as after trips to places that have nothing in common, the bridges alone count.
///
/// Geodesics are measured from at most a hundred of the landmarks.
///
/// * `lists` — of at least one neighbour
/// * `besides` — edges that the graph has whatever the number
/// * `landmarks` — frame indices, at least one
/// * `n_dims` — d of the model; none where it is left to the evidence
/// * `done` — told how many numbers are measured, and of how many
///
/// O(pairs of frames on different islands) distances, and for each number O(100 · n_edges · log n_frames).
pub fn try_neighbors(
    frames: &Frames,
    metric: &impl Metric,
    lists: &NeighborLists,
    besides: &[Edge],
    landmarks: &[u32],
    n_dims: Option<usize>,
    done: &mut dyn FnMut(usize, usize),
) -> Vec<NeighborsTrial> {
    let most = lists.k().min(N_NEIGHBORS_TRIED_MAX);
    let fewest = fewest(lists, besides, most);
    let between = |a: u32, b: u32| metric.squared_distance(frames.row(a as usize), frames.row(b as usize));
    let bridges = Graph::union(lists, fewest, besides).join_islands(between);

    let n_landmarks = landmarks.len().min(N_LANDMARKS);
    // By rising index, so that these are spread over the trip.
    let landmarks: Vec<u32> =
        (0..n_landmarks).map(|lane| landmarks[lane * landmarks.len() / n_landmarks]).collect();
    let n_tried = most - fewest + 1;
    // One after the other, each on all threads: side by side, each would hold its graph and geodesics.
    let measure = |(index, n_neighbors)| {
        let graph = Graph::union(lists, n_neighbors, besides);
        let measured = Measured::new(graph, n_neighbors, &bridges, &landmarks);
        done(index + 1, n_tried);
        measured
    };
    let measured: Vec<Measured> = (fewest..=most).enumerate().map(measure).collect();
    let n_dims = n_dims.unwrap_or_else(|| common_elbow(&measured) + N_DIMS_BEYOND_ELBOW);
    measured.into_iter().map(|measured| measured.at(n_dims)).collect()
}

/// The trials to choose from: those before a short circuit, and of these the ones with [`N_NEIGHBORS_USUAL`] or more, if
/// there are any.
pub fn candidates(trials: &[NeighborsTrial]) -> &[NeighborsTrial] {
    let is_short = |index: &usize| doubles(trials, *index) && trials[*index].residual_variance > TOLERANCE;
    let n_safe = (1..trials.len()).find(is_short).unwrap_or(trials.len());
    let n_fewer = trials[..n_safe].iter().take_while(|trial| trial.n_neighbors < N_NEIGHBORS_USUAL).count();
    &trials[if n_fewer < n_safe { n_fewer } else { 0 }..n_safe]
}

/// The trial to take: of the [`candidates`] the fewest neighbours whose residual variance is within [`TOLERANCE`] of the
/// least.
pub fn chosen(trials: &[NeighborsTrial]) -> Option<&NeighborsTrial> {
    let candidates = candidates(trials);
    let least = least_of(candidates.iter())?.residual_variance;
    candidates.iter().find(|trial| trial.residual_variance <= least + TOLERANCE)
}

/// The best of the [`candidates`] that were not chosen: that with the least residual variance.
pub fn runner_up(trials: &[NeighborsTrial]) -> Option<&NeighborsTrial> {
    let chosen = chosen(trials)?.n_neighbors;
    least_of(candidates(trials).iter().filter(|trial| trial.n_neighbors != chosen))
}

/// The least residual variance, of equals that of the fewest neighbours.
fn least_of<'a>(trials: impl Iterator<Item = &'a NeighborsTrial>) -> Option<&'a NeighborsTrial> {
    trials.min_by(|a, b| a.residual_variance.total_cmp(&b.residual_variance))
}

/// Indices of trials that may have a short circuit which the one before has not. Never the first: there is none before.
pub fn short_circuits(trials: &[NeighborsTrial]) -> Vec<usize> {
    let is_sudden = |index: &usize| {
        let (before, after) = (&trials[index - 1], &trials[*index]);
        after.median_geodesic < (1.0 - SHORT_CIRCUIT_FALL) * before.median_geodesic || doubles(trials, *index)
    };
    (1..trials.len()).filter(is_sudden).collect()
}

/// Whether the residual variance rises suddenly to that of a trial, which is not the first.
fn doubles(trials: &[NeighborsTrial], index: usize) -> bool {
    trials[index].residual_variance > SHORT_CIRCUIT_RISE * trials[index - 1].residual_variance
}

/// The fewest neighbours to try.
fn fewest(lists: &NeighborLists, besides: &[Edge], most: usize) -> usize {
    let mut few_bridges = None;
    for n_neighbors in 1..most {
        let islands = Graph::union(lists, n_neighbors, besides).islands();
        if islands.len() > N_BRIDGES_FEW + 1 {
            continue;
        }
        if islands[0].len() as f64 >= LARGEST_ISLAND_SHARE * lists.n_frames() as f64 {
            return n_neighbors;
        }
        few_bridges = few_bridges.or(Some(n_neighbors));
    }
    few_bridges.unwrap_or(most)
}

/// What one number of neighbours comes to, for every number of dimensions.
struct Measured {
    n_neighbors: usize,
    n_islands: usize,
    bridges: Vec<f32>,
    residual_variance: Vec<f64>,
    median_geodesic: f64,
}

impl Measured {
    /// * `bridges` — of a graph of no more neighbours, shortest first
    fn new(mut graph: Graph, n_neighbors: usize, bridges: &[Edge], landmarks: &[u32]) -> Self {
        let n_islands = graph.islands().len();
        let bridges = graph.join_by(bridges.iter().copied());
        let geodesics = Geodesics::measure(&graph, landmarks, &mut |_| ());
        Self {
            n_neighbors,
            n_islands,
            bridges: bridges.iter().map(|bridge| bridge.length).collect(),
            residual_variance: embedded(&geodesics, landmarks),
            median_geodesic: median(&geodesics),
        }
    }

    /// * `n_dims` — that are kept; where geodesics span fewer, as many as these
    fn at(self, n_dims: usize) -> NeighborsTrial {
        let n_dims = n_dims.min(self.residual_variance.len());
        NeighborsTrial {
            n_neighbors: self.n_neighbors,
            n_islands: self.n_islands,
            bridges: self.bridges,
            n_dims,
            residual_variance: self.residual_variance[n_dims - 1],
            median_geodesic: self.median_geodesic,
        }
    }
}

/// Residual variance for 1, 2, … dimensions of an embedding of the landmarks' geodesics; 1 where they span none.
fn embedded(geodesics: &Geodesics, landmarks: &[u32]) -> Vec<f64> {
    let n_landmarks = landmarks.len();
    let squared = |frame_index: usize, lane: usize| f64::from(geodesics.row(frame_index)[lane]).powi(2);
    let between = |i: usize, j: usize| squared(landmarks[i] as usize, j);
    let Ok((embedding, _)) = Embedding::fit(n_landmarks, between, N_DIMS_REPORTED, 1) else {
        return vec![1.0];
    };
    let mut coordinates = vec![0.0; geodesics.n_frames() * embedding.n_dims()];
    let mut delta = vec![0.0; n_landmarks];
    for (frame_index, place) in coordinates.chunks_exact_mut(embedding.n_dims()).enumerate() {
        delta.iter_mut().enumerate().for_each(|(lane, delta)| *delta = squared(frame_index, lane));
        embedding.embed(&delta, place);
    }
    let length = |frame_index: usize, lane: usize| f64::from(geodesics.row(frame_index)[lane]);
    residual_variance(&coordinates, embedding.n_dims(), landmarks, length)
}

/// Median length between a landmark and another frame, counts.
fn median(geodesics: &Geodesics) -> f64 {
    let mut lengths = geodesics.lengths().to_vec();
    let middle = lengths.len() / 2;
    f64::from(*lengths.select_nth_unstable_by(middle, f32::total_cmp).1)
}

/// Where the curves of residual variance bend: the median over all numbers, so that all are compared at equal dimensions.
fn common_elbow(measured: &[Measured]) -> usize {
    let mut elbows: Vec<usize> = measured.iter().map(|measured| elbow(&measured.residual_variance)).collect();
    elbows.sort_unstable();
    elbows[elbows.len() / 2]
}
