//! Geodesics: lengths of shortest paths in the neighbour graph, from every frame to every landmark.

mod sweeps;

use rayon::prelude::*;

use self::sweeps::{Lanes, N_LANES, Sweeps};
use crate::array::Array;
use crate::graph::Graph;
use crate::simd::Instructions;

/// G, shape `(n_frames, n_landmarks)`, counts. The row of a frame stands together: that is how a new frame reads it.
#[derive(Clone, Debug)]
pub struct Geodesics {
    n_landmarks: usize,
    lengths: Array<f32>,
}

impl Geodesics {
    /// Takes rows of `n_landmarks` lengths that stand one after the other.
    ///
    /// # Panics
    /// If `n_landmarks` is 0 or does not divide the number of lengths: a bug of the caller.
    pub fn new(n_landmarks: usize, lengths: impl Into<Array<f32>>) -> Self {
        let lengths = lengths.into();
        assert!(
            n_landmarks > 0 && lengths.len().is_multiple_of(n_landmarks),
            "rows of {n_landmarks} in {}",
            lengths.len()
        );
        Self { n_landmarks, lengths }
    }

    /// Measures a graph from the given landmarks, in `f32`.
    ///
    /// Path lengths are sums of `f32` rounded edge by edge, from the landmark on. Since such addition is monotone, the result
    /// is the one fixpoint of `G[v] = min over neighbours u of (G[u] + length)`: Dijkstra's algorithm reaches the same bits.
    ///
    /// * `done` — told the number of landmarks finished, now and then
    ///
    /// Lengths to frames on other islands are infinite. O(n_landmarks · n_edges) a few times over, on the threads of
    /// whoever calls; holds `n_frames` lengths to each of some landmarks for every thread beside the result.
    pub fn measure(graph: &Graph, landmarks: &[u32], done: &mut dyn FnMut(usize)) -> Self {
        let (n_frames, n_landmarks) = (graph.n_frames(), landmarks.len());
        let mut lengths = vec![f32::INFINITY; n_frames * n_landmarks];
        let sweeps = Sweeps::new(graph);
        let place = |lane: &usize| sweeps.places[landmarks[*lane] as usize];
        let mut lanes: Vec<usize> = (0..n_landmarks).collect();
        lanes.sort_by_key(place);
        let mut n_done = 0;
        for batches in lanes.chunks(N_LANES * rayon::current_num_threads()) {
            let measured: Vec<Vec<Lanes>> = batches
                .par_chunks(N_LANES)
                .map(|batch| sweeps.measure(&batch.iter().map(place).collect::<Vec<_>>()))
                .collect();
            lengths.par_chunks_exact_mut(n_landmarks).zip(&sweeps.places).for_each(|(row, &place)| {
                for (batch, measured) in batches.chunks(N_LANES).zip(&measured) {
                    batch
                        .iter()
                        .zip(&measured[place as usize])
                        .for_each(|(&lane, &length)| row[lane] = length);
                }
            });
            n_done += batches.len();
            done(n_done);
        }
        Self::new(n_landmarks, lengths)
    }

    /// n.
    pub fn n_landmarks(&self) -> usize {
        self.n_landmarks
    }

    /// N.
    pub fn n_frames(&self) -> usize {
        self.lengths.len() / self.n_landmarks
    }

    /// Geodesics from one frame to each landmark, shape `(n_landmarks,)`, counts.
    pub fn row(&self, frame_index: usize) -> &[f32] {
        &self.lengths[frame_index * self.n_landmarks..][..self.n_landmarks]
    }

    /// Shortest lengths to each landmark of a frame that was not measured, through its neighbours.
    ///
    /// `min over the nearest reference frames j of (‖p − x_j‖ + G_ji)`; for a reference frame among its own neighbours
    /// this is its row again, bit for bit, since G is a fixpoint.
    ///
    /// * `nearest` — reference frames near the new one, and the distance to each, counts
    /// * `lengths` — shape `(n_landmarks,)`, counts; overwritten
    pub fn through(&self, nearest: impl IntoIterator<Item = (u32, f32)>, lengths: &mut [f32]) {
        lengths.fill(f32::INFINITY);
        for (frame_index, distance) in nearest {
            let row = self.row(frame_index as usize);
            Instructions::widest().run(
                #[inline(always)]
                || shorten(lengths, distance, row),
            );
        }
    }

    /// All lengths, row after row.
    pub fn lengths(&self) -> &[f32] {
        &self.lengths
    }
}

/// Takes each length through a frame at a distance, where that is shorter.
#[inline(always)]
fn shorten(lengths: &mut [f32], distance: f32, geodesics: &[f32]) {
    for (length, geodesic) in lengths.iter_mut().zip(geodesics) {
        let through = distance + geodesic;
        // Not `f32::min`, which asks of either whether it is a number.
        *length = if through < *length { through } else { *length };
    }
}

#[cfg(test)]
mod tests {
    use std::cmp::Reverse;
    use std::collections::BinaryHeap;

    use proptest::prelude::*;

    use super::*;
    use crate::graph::Edge;

    /// Shortest lengths from one vertex to all, by Dijkstra's algorithm.
    fn paths(graph: &Graph, source: u32) -> Vec<f32> {
        // Lengths are never negative, so their bits order as they do.
        let mut lengths = vec![f32::INFINITY; graph.n_frames()];
        let mut queue = BinaryHeap::new();
        lengths[source as usize] = 0.0;
        queue.push(Reverse((0.0_f32.to_bits(), source)));
        while let Some(Reverse((bits, vertex))) = queue.pop() {
            let length = f32::from_bits(bits);
            if length > lengths[vertex as usize] {
                continue;
            }
            for &(to, edge) in graph.neighbors(vertex) {
                let through = length + edge;
                if through < lengths[to as usize] {
                    lengths[to as usize] = through;
                    queue.push(Reverse((through.to_bits(), to)));
                }
            }
        }
        lengths
    }

    fn check(graph: &Graph, landmarks: &[u32]) -> Result<(), TestCaseError> {
        let measured = Geodesics::measure(graph, landmarks, &mut |_| ());
        for (lane, &landmark) in landmarks.iter().enumerate() {
            for (vertex, expected) in paths(graph, landmark).iter().enumerate() {
                prop_assert_eq!(measured.row(vertex)[lane].to_bits(), expected.to_bits());
            }
        }
        Ok(())
    }

    proptest! {
        #[test]
        fn every_set_of_instructions_shortens_to_the_same_bits(
            lengths in prop::collection::vec((0.0..1e6_f32, prop_oneof![0.0..1e6_f32, Just(f32::INFINITY)]), 0..100),
            distance in 0.0..1e6_f32,
        ) {
            let (lengths, geodesics): (Vec<f32>, Vec<f32>) = lengths.into_iter().unzip();
            let least = |(length, geodesic): (&f32, &f32)| length.min(distance + geodesic).to_bits();
            let expected: Vec<u32> = lengths.iter().zip(&geodesics).map(least).collect();
            for instructions in Instructions::all() {
                let mut shortened = lengths.clone();
                instructions.run(|| shorten(&mut shortened, distance, &geodesics));
                let found: Vec<u32> = shortened.iter().map(|length| length.to_bits()).collect();
                prop_assert_eq!(&found, &expected, "{:?}", instructions);
            }
        }

        #[test]
        fn geodesics_are_those_of_dijkstra_bit_for_bit_on_islands_and_over_edges_of_no_length(
            n_frames in 1..200_usize,
            raw in prop::collection::vec((0..200_u32, 0..200_u32, prop_oneof![Just(0.0), 0.0..100.0_f32]), 0..600),
            landmarks in prop::collection::vec(0..200_u32, 1..150),
        ) {
            let n = n_frames as u32;
            let edges = raw.into_iter().map(|(a, b, length)| Edge { a: a % n, b: b % n, length });
            // More than one batch, and the same landmark more than once.
            let landmarks: Vec<u32> = landmarks.into_iter().map(|landmark| landmark % n).collect();
            check(&Graph::new(n_frames, edges), &landmarks)?;
        }

        #[test]
        fn geodesics_along_a_long_thread_are_those_of_dijkstra(
            lengths in prop::collection::vec(0.0..1e7_f32, 300),
            order in Just((0..301).collect::<Vec<u32>>()).prop_shuffle(),
        ) {
            let edge = |(pair, &length): (&[u32], &f32)| Edge { a: pair[0], b: pair[1], length };
            let graph = Graph::new(301, order.windows(2).zip(&lengths).map(edge));
            check(&graph, &[0, 150, 300])?;
        }

        #[test]
        fn geodesics_equal_relaxing_every_edge_until_nothing_changes(
            raw in prop::collection::vec((0..12_u32, 0..12_u32, 0.0..100.0_f32), 0..60),
        ) {
            let graph = Graph::new(12, raw.into_iter().map(|(a, b, length)| Edge { a, b, length }));
            let landmarks: Vec<u32> = vec![0, 5, 11];
            let measured = Geodesics::measure(&graph, &landmarks, &mut |_| ());
            for (lane, &landmark) in landmarks.iter().enumerate() {
                let mut expected = [f32::INFINITY; 12];
                expected[landmark as usize] = 0.0;
                // Bellman-Ford: no shortest path has more edges than there are vertices.
                for _ in 0..12 {
                    for edge in graph.edges() {
                        let (a, b) = (edge.a as usize, edge.b as usize);
                        expected[a] = expected[a].min(expected[b] + edge.length);
                        expected[b] = expected[b].min(expected[a] + edge.length);
                    }
                }
                for (vertex, expected) in expected.iter().enumerate() {
                    prop_assert_eq!(measured.row(vertex)[lane].to_bits(), expected.to_bits());
                }
            }
        }
    }
}
