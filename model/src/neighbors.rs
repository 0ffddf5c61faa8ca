//! Exact nearest neighbours among the reference frames, by integer arithmetic.
//!
//! Squared distances are whole numbers by every [`Metric`], the same on every machine. Ties go to the lower frame index.

use rayon::prelude::*;

use crate::frames::Frames;
use crate::metric::Metric;
use crate::search::Search;
use crate::tally::Tally;

/// A reference frame near another frame. Orders by distance, then by index.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub struct Neighbor {
    /// Squared distance by the metric, counts².
    pub squared_distance: u64,
    /// Which reference frame.
    pub frame_index: u32,
}

impl Neighbor {
    /// Distance, counts. In `f32`, which is what geodesics are summed in.
    pub fn distance(&self) -> f32 {
        length(self.squared_distance)
    }
}

/// Length of a squared distance, counts, rounded once.
pub fn length(squared_distance: u64) -> f32 {
    (squared_distance as f64).sqrt() as f32
}

/// The nearest other frames of every frame, nearest first, as many for each.
#[derive(Clone, Debug)]
pub struct NeighborLists {
    k: usize,
    /// Shape `(n_frames, k)`.
    neighbors: Vec<Neighbor>,
}

impl NeighborLists {
    /// Neighbours listed of each frame.
    pub fn k(&self) -> usize {
        self.k
    }

    /// N.
    pub fn n_frames(&self) -> usize {
        self.neighbors.len() / self.k
    }

    /// The `n_neighbors` nearest of each frame in turn: a list of fewer is the beginning of one of more.
    ///
    /// * `n_neighbors` — at most [`Self::k`]
    pub fn nearest(&self, n_neighbors: usize) -> impl Iterator<Item = &[Neighbor]> {
        self.neighbors.chunks_exact(self.k).map(move |list| &list[..n_neighbors])
    }
}

/// The `k` nearest other frames of every frame.
///
/// * `k` — at least 1, at most `n_frames` − 1
/// * `done` — told the number of frames finished, now and then
///
/// O(n_frames²) distances at worst, on the threads of whoever calls. Of frames that are [indexed](Frames::indexed) and alike in
/// places, a few hundredths of them.
pub fn nearest_of_each(
    frames: &Frames,
    metric: &impl Metric,
    k: usize,
    done: &mut (dyn FnMut(usize) + Send),
) -> NeighborLists {
    let n_frames = frames.n_frames();
    assert!((1..n_frames).contains(&k), "{k} neighbours among {n_frames} frames");
    let mut neighbors = vec![neighbor(0, 0); n_frames * k];
    match search_pays(frames, metric, k) {
        true => search_each(frames, metric, k, &mut neighbors, done),
        false => scan_each(frames, metric, k, &mut neighbors, done),
    }
    NeighborLists { k, neighbors }
}

/// Frames that are searched for to see whether bounds tell them apart.
const N_TRIED: usize = 32;

/// Share of the frames that a search may measure: a scan measures frames where they are in cache.
const SHARE_MEASURED_MAX: f64 = 0.1;

/// Whether searching for each frame is sooner than measuring all pairs. Either gives the same.
fn search_pays(frames: &Frames, metric: &impl Metric, k: usize) -> bool {
    let n_frames = frames.n_frames();
    let n_tried = n_frames.min(N_TRIED);
    let mut search = Search::new(frames, k + 1);
    let n_measured = |tried: usize| {
        search.nearest(frames, metric, frames.row(tried * n_frames / n_tried));
        search.n_measured()
    };
    let n_measured: Option<usize> = (0..n_tried).map(n_measured).sum();
    n_measured.is_some_and(|n| (n as f64) < SHARE_MEASURED_MAX * (n_tried * n_frames) as f64)
}

/// Frames that one thread searches for in one go.
const N_SEARCHES: usize = 16;

fn search_each(
    frames: &Frames,
    metric: &impl Metric,
    k: usize,
    neighbors: &mut [Neighbor],
    done: &mut (dyn FnMut(usize) + Send),
) {
    let n_frames = frames.n_frames();
    let mut told = |n_chunks: usize| done(n_frames.min(n_chunks * N_SEARCHES));
    let tally = Tally::new(&mut told);
    neighbors.par_chunks_mut(N_SEARCHES * k).enumerate().for_each_init(
        || Search::new(frames, k + 1),
        |search, (chunk, lists)| {
            for (index, list) in (chunk * N_SEARCHES..).zip(lists.chunks_exact_mut(k)) {
                // The frame itself is among them, or as many others that are equal to it.
                let found = search.nearest(frames, metric, frames.row(index));
                let others = found.iter().filter(|near| near.frame_index as usize != index);
                list.iter_mut().zip(others).for_each(|(place, near)| *place = *near);
            }
            tally.add();
        },
    );
}

fn scan_each(
    frames: &Frames,
    metric: &impl Metric,
    k: usize,
    neighbors: &mut [Neighbor],
    done: &mut (dyn FnMut(usize) + Send),
) {
    let n_frames = frames.n_frames();
    // Rows are compared in tiles that stay in cache together: read plainly, 2000 frames of 19840 readings would come
    // from memory 2000 times.
    const TILE_BYTES: usize = 1 << 19;
    // Their distances to all frames must fit into memory too.
    const N_DISTANCES: usize = 1 << 20;
    let tile = (TILE_BYTES / (2 * frames.n_readings())).min(N_DISTANCES / n_frames).clamp(1, n_frames);
    let mut told = |n_tiles: usize| done(n_frames.min(n_tiles * tile));
    let tally = Tally::new(&mut told);
    neighbors.par_chunks_mut(tile * k).enumerate().for_each_init(
        || (vec![0; tile * n_frames], Vec::with_capacity(k)),
        |(squared, nearest), (index, lists)| {
            let first = index * tile;
            for other in 0..n_frames {
                for row in 0..lists.len() / k {
                    squared[row * n_frames + other] =
                        metric.squared_distance(frames.row(first + row), frames.row(other));
                }
            }
            for (row, list) in lists.chunks_exact_mut(k).enumerate() {
                nearest.clear();
                let distances = &squared[row * n_frames..][..n_frames];
                for other in (0..n_frames).filter(|&other| other != first + row) {
                    keep(neighbor(other, distances[other]), k, nearest);
                }
                list.copy_from_slice(nearest);
            }
            tally.add();
        },
    );
}

/// A frame and its squared distance, counts².
pub(crate) fn neighbor(frame_index: usize, squared_distance: u64) -> Neighbor {
    Neighbor { squared_distance, frame_index: frame_index as u32 }
}

/// Keeps a frame among the `k` nearest, in order, if it is one of them. By insertion: lists are short.
pub(crate) fn keep(candidate: Neighbor, k: usize, nearest: &mut Vec<Neighbor>) {
    if nearest.len() == k {
        if nearest.last().is_none_or(|last| candidate > *last) {
            return;
        }
        nearest.pop();
    }
    let place = nearest.iter().rposition(|nearer| *nearer < candidate).map_or(0, |place| place + 1);
    nearest.insert(place, candidate);
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;
    use crate::metric::Euclidean;
    use crate::testing::{Sort, frames_of, layout};

    /// The plainest way: every distance in 128 bits, then a full sort, for every frame.
    fn by_sorting(frames: &Frames, k: usize) -> Vec<Neighbor> {
        let of_frame = |from: usize| {
            let squared = |(&a, &b): (&u16, &u16)| (i128::from(a) - i128::from(b)).pow(2);
            let distance = |to: usize| frames.row(from).iter().zip(frames.row(to)).map(squared).sum::<i128>();
            let others = (0..frames.n_frames()).filter(|&other| other != from);
            let mut all: Vec<_> = others.map(|other| neighbor(other, distance(other) as u64)).collect();
            all.sort();
            all.truncate(k);
            all
        };
        (0..frames.n_frames()).flat_map(of_frame).collect()
    }

    fn lists(frames: &Frames, k: usize) -> Vec<Neighbor> {
        nearest_of_each(frames, &Euclidean, k, &mut |_| ()).nearest(k).flatten().copied().collect()
    }

    fn few_frames() -> impl Strategy<Value = (Frames, usize)> {
        // A small alphabet makes ties and duplicates common; the extremes show overflow.
        let reading = prop_oneof![0..4_u16, Just(u16::MAX), any::<u16>()];
        (1..6_usize, 2..30_usize).prop_flat_map(move |(n_readings, n_frames)| {
            let counts = prop::collection::vec(reading.clone(), n_readings * n_frames);
            (counts.prop_map(move |counts| Frames::new(n_readings, counts)), 1..n_frames)
        })
    }

    proptest! {
        #[test]
        fn nearest_of_each_equals_a_full_sort_without_the_frame_itself((frames, k) in few_frames()) {
            let expected = by_sorting(&frames, k);
            prop_assert_eq!(lists(&frames, k), &expected[..]);
            let sensor = layout(1, frames.n_readings() as u32);
            prop_assert_eq!(lists(&frames.indexed(sensor), k), expected);
        }
    }

    #[test]
    fn either_way_gives_the_same_and_a_search_pays_where_frames_are_alike_in_places() {
        for (sort, pays) in [(Sort::Smooth, true), (Sort::Random, false)] {
            for (rows, columns) in [(1, 16), (30, 40)] {
                let sensor = layout(rows, columns);
                let frames = Frames::new(sensor.n_readings(), frames_of(sort, sensor, 400, 2));
                let k = 7;
                // Of 16 readings bounds are distances.
                let indexed = frames.clone().indexed(sensor);
                assert_eq!(search_pays(&indexed, &Euclidean, k), pays || columns == 16, "{sort:?} {columns}");
                assert!(!search_pays(&frames, &Euclidean, k));
                let (mut searched, mut scanned) =
                    (vec![neighbor(0, 0); 400 * k], vec![neighbor(0, 0); 400 * k]);
                let mut n_done = 0;
                search_each(&indexed, &Euclidean, k, &mut searched, &mut |n| n_done = n);
                assert_eq!(n_done, 400);
                scan_each(&frames, &Euclidean, k, &mut scanned, &mut |n| n_done = n);
                assert_eq!(n_done, 400);
                assert_eq!(searched, scanned);
                assert_eq!(searched, by_sorting(&frames, k));
            }
        }
    }
}
