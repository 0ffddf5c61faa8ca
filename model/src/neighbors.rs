//! Exact nearest neighbours among the reference frames, by integer arithmetic.
//!
//! Squared distances are whole numbers by every [`Metric`], the same on every machine. Ties go to the lower frame index.

use rayon::prelude::*;

use crate::frames::Frames;
use crate::metric::Metric;
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

/// Squared distances from a frame to every reference frame, counts².
///
/// * `query` — counts on the response's scale, shape `(n_readings,)`
/// * `squared` — shape `(n_frames,)`; overwritten
pub fn squared_distances(frames: &Frames, metric: &impl Metric, query: &[u16], squared: &mut [u64]) {
    assert_eq!(squared.len(), frames.n_frames(), "one distance for each reference frame");
    squared
        .iter_mut()
        .enumerate()
        .for_each(|(index, squared)| *squared = metric.squared_distance(query, frames.row(index)));
}

/// The `nearest.len()` reference frames nearest to a frame, nearest first.
///
/// * `query` — counts on the response's scale, shape `(n_readings,)`
/// * `nearest` — overwritten; at most `n_frames` long
///
/// Allocates nothing. O(n_frames) distances.
pub fn nearest(frames: &Frames, metric: &impl Metric, query: &[u16], nearest: &mut [Neighbor]) {
    let candidates = (0..frames.n_frames())
        .map(|index| neighbor(index, metric.squared_distance(query, frames.row(index))));
    keep_nearest(candidates, nearest);
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
/// O(n_frames²) distances, on the threads of whoever calls.
pub fn nearest_of_each(
    frames: &Frames,
    metric: &impl Metric,
    k: usize,
    done: &mut (dyn FnMut(usize) + Send),
) -> NeighborLists {
    let n_frames = frames.n_frames();
    assert!((1..n_frames).contains(&k), "{k} neighbours among {n_frames} frames");
    let mut neighbors = vec![neighbor(0, 0); n_frames * k];
    // Rows are compared in tiles that stay in cache together: read plainly, 2000 frames of 19840 readings would come
    // from memory 2000 times.
    const TILE_BYTES: usize = 1 << 19;
    // Their distances to all frames must fit into memory too.
    const N_DISTANCES: usize = 1 << 20;
    let tile = (TILE_BYTES / (2 * frames.n_readings())).min(N_DISTANCES / n_frames).clamp(1, n_frames);
    let mut told = |n_tiles: usize| done(n_frames.min(n_tiles * tile));
    let tally = Tally::new(&mut told);
    neighbors.par_chunks_mut(tile * k).enumerate().for_each_init(
        || vec![0; tile * n_frames],
        |squared, (index, lists)| {
            let first = index * tile;
            for other in 0..n_frames {
                for row in 0..lists.len() / k {
                    squared[row * n_frames + other] =
                        metric.squared_distance(frames.row(first + row), frames.row(other));
                }
            }
            for (row, list) in lists.chunks_exact_mut(k).enumerate() {
                let distances = &squared[row * n_frames..][..n_frames];
                let others = (0..n_frames).filter(|&other| other != first + row);
                keep_nearest(others.map(|other| neighbor(other, distances[other])), list);
            }
            tally.add();
        },
    );
    NeighborLists { k, neighbors }
}

fn neighbor(frame_index: usize, squared_distance: u64) -> Neighbor {
    Neighbor { squared_distance, frame_index: frame_index as u32 }
}

/// Keeps the least of `candidates`, in order, by insertion: lists are short.
fn keep_nearest(candidates: impl Iterator<Item = Neighbor>, nearest: &mut [Neighbor]) {
    let mut n_kept = 0;
    for candidate in candidates {
        if n_kept < nearest.len() {
            n_kept += 1;
        } else if nearest.last().is_none_or(|last| candidate > *last) {
            continue;
        }
        let mut place = n_kept - 1;
        while place > 0 && nearest[place - 1] > candidate {
            nearest[place] = nearest[place - 1];
            place -= 1;
        }
        nearest[place] = candidate;
    }
    assert_eq!(n_kept, nearest.len(), "more neighbours asked for than there are frames");
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;
    use crate::metric::Euclidean;

    /// The plainest way: every distance in 128 bits, then a full sort.
    fn by_sorting(frames: &Frames, query: &[u16]) -> Vec<Neighbor> {
        let mut all: Vec<_> = (0..frames.n_frames())
            .map(|index| {
                let sum: i128 = query
                    .iter()
                    .zip(frames.row(index))
                    .map(|(&a, &b)| (i128::from(a) - i128::from(b)).pow(2))
                    .sum();
                neighbor(index, sum as u64)
            })
            .collect();
        all.sort();
        all
    }

    fn few_frames() -> impl Strategy<Value = (Frames, Vec<u16>, usize)> {
        // A small alphabet makes ties and duplicates common; the extremes show overflow.
        let reading = prop_oneof![0..4_u16, Just(u16::MAX), any::<u16>()];
        (1..6_usize, 2..30_usize).prop_flat_map(move |(n_readings, n_frames)| {
            (
                prop::collection::vec(reading.clone(), n_readings * n_frames),
                prop::collection::vec(reading.clone(), n_readings),
                1..n_frames,
            )
                .prop_map(move |(counts, query, k)| (Frames::new(n_readings, counts), query, k))
        })
    }

    proptest! {
        #[test]
        fn nearest_equals_a_full_sort_with_ties_by_index((frames, query, k) in few_frames()) {
            let mut found = vec![neighbor(0, 0); k];
            nearest(&frames, &Euclidean, &query, &mut found);
            prop_assert_eq!(&found[..], &by_sorting(&frames, &query)[..k]);
        }

        #[test]
        fn nearest_of_each_equals_a_full_sort_without_the_frame_itself((frames, _, k) in few_frames()) {
            let lists: Vec<_> = nearest_of_each(&frames, &Euclidean, k, &mut |_| ()).nearest(k).flatten().copied().collect();
            for row in 0..frames.n_frames() {
                let mut expected = by_sorting(&frames, frames.row(row));
                expected.retain(|neighbor| neighbor.frame_index as usize != row);
                prop_assert_eq!(&lists[row * k..][..k], &expected[..k]);
            }
        }
    }
}
