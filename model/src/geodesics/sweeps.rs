//! Shortest paths from many landmarks at once, by sweeps over the vertices.
//!
//! Plainly: `G[v] = min over neighbours u of (G[u] + length)`, for one vertex after the other, until nothing changes
//! (Bellman 1958, *On a routing problem*, with each result used at once). A heap settles a vertex once, but takes tens of
//! nanoseconds to find out which is next, for every landmark anew. Departures from the plain way:
//!
//! 1. **All landmarks of a batch at once.** Their lengths to one vertex stand side by side, so that one edge is relaxed for
//!    all by a few instructions.
//! 2. **Vertices in breadth-first order** from one end of the graph: most shortest paths go through rising or falling places,
//!    and a sweep follows such a path to its end. Sweeps go forth and back in turn. In the order of a Swiss roll's random
//!    points four times as many vertices are relaxed.
//! 3. **Only where a neighbour changed** since the vertex was last relaxed.
//! 4. **Landmarks near each other share a batch**, so that they change the same vertices in the same sweep.

use crate::graph::Graph;
use crate::simd::Instructions;

/// Landmarks in a batch: four of the widest registers for the lengths of one vertex, and a few thousand vertices in a core's
/// cache.
pub(super) const N_LANES: usize = 64;

/// Lengths from the landmarks of a batch to one vertex, counts.
pub(super) type Lanes = [f32; N_LANES];

/// A graph whose vertices are numbered along it.
pub(super) struct Sweeps {
    /// Its vertices are places.
    graph: Graph,
    /// Where each frame is in the breadth-first order, shape `(n_frames,)`.
    pub(super) places: Vec<u32>,
}

impl Sweeps {
    pub(super) fn new(graph: &Graph) -> Self {
        // What a search reaches last is at an end of the graph.
        let end = *graph.breadth_first(0).last().expect("a graph has a frame");
        let order = graph.breadth_first(end);
        let mut places = vec![0; graph.n_frames()];
        (0..).zip(&order).for_each(|(place, &frame_index)| places[frame_index as usize] = place);
        Self { graph: graph.renumbered(&order, &places), places }
    }

    /// Shortest lengths from at most [`N_LANES`] places to every place, shape `(n_frames,)`; infinite in other lanes and
    /// on other islands.
    pub(super) fn measure(&self, sources: &[u32]) -> Vec<Lanes> {
        let n_frames = self.graph.n_frames();
        let mut batch = Batch {
            graph: &self.graph,
            lengths: vec![[f32::INFINITY; N_LANES]; n_frames],
            is_stale: vec![false; n_frames],
            n_stale: 0,
        };
        for (lane, &source) in sources.iter().enumerate() {
            batch.lengths[source as usize][lane] = 0.0;
            batch.tell_neighbors(source);
        }
        Instructions::widest().run(|| {
            while batch.n_stale > 0 {
                (0..n_frames as u32).for_each(|vertex| batch.relax(vertex));
                (0..n_frames as u32).rev().for_each(|vertex| batch.relax(vertex));
            }
        });
        batch.lengths
    }
}

/// Lengths from the landmarks of a batch, as far as they are known.
struct Batch<'a> {
    graph: &'a Graph,
    lengths: Vec<Lanes>,
    /// Whether a neighbour changed since a vertex was relaxed.
    is_stale: Vec<bool>,
    n_stale: usize,
}

impl Batch<'_> {
    /// Takes what its neighbours know for a vertex. Inlined, so that it is compiled for the instructions of whoever calls.
    #[inline(always)]
    fn relax(&mut self, vertex: u32) {
        let index = vertex as usize;
        if !std::mem::replace(&mut self.is_stale[index], false) {
            return;
        }
        self.n_stale -= 1;
        let before = self.lengths[index];
        let mut lengths = before;
        for &(neighbor, edge) in self.graph.neighbors(vertex) {
            for (length, known) in lengths.iter_mut().zip(&self.lengths[neighbor as usize]) {
                let through = known + edge;
                // Not f32::min, which asks for numbers that are none.
                *length = if through < *length { through } else { *length };
            }
        }
        let mut is_changed = false;
        for (length, before) in lengths.iter().zip(&before) {
            is_changed |= length != before;
        }
        if is_changed {
            self.lengths[index] = lengths;
            self.tell_neighbors(vertex);
        }
    }

    #[inline(always)]
    fn tell_neighbors(&mut self, vertex: u32) {
        for &(neighbor, _) in self.graph.neighbors(vertex) {
            let was_stale = std::mem::replace(&mut self.is_stale[neighbor as usize], true);
            self.n_stale += usize::from(!was_stale);
        }
    }
}
