//! The neighbour graph: who is whose neighbour in either direction, and if asked for, who follows whom in a trip; in one
//! piece.
//!
//! *Island*: a connected part of the graph. *Bridge*: an edge added so that two islands become one. Bridges are the
//! minimum spanning set: C islands get the C − 1 edges that join them at least total length, and the caller is told of
//! each, since geodesics across a bridge are a guess.

use crate::neighbors::{NeighborLists, length};

/// An undirected edge.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Edge {
    /// One end.
    pub a: u32,
    /// The other end.
    pub b: u32,
    /// Length, counts on the response's scale.
    pub length: f32,
}

/// An undirected graph over frames in compressed rows: the neighbours of a vertex stand together, by rising index.
#[derive(Clone, Debug)]
pub struct Graph {
    /// Where each vertex' neighbours begin, shape `(n_frames + 1,)`.
    offsets: Vec<u32>,
    /// Neighbour and length, both directions of every edge.
    links: Vec<(u32, f32)>,
}

impl Graph {
    /// Builds the graph of these edges. An edge may be given more than once, in either direction.
    pub fn new(n_frames: usize, edges: impl IntoIterator<Item = Edge>) -> Self {
        let mut directed: Vec<(u32, u32, f32)> = edges
            .into_iter()
            .filter(|edge| edge.a != edge.b)
            .flat_map(|edge| [(edge.a, edge.b, edge.length), (edge.b, edge.a, edge.length)])
            .collect();
        directed.sort_unstable_by(|x, y| (x.0, x.1).cmp(&(y.0, y.1)).then(x.2.total_cmp(&y.2)));
        // Of several edges between two frames the shortest comes first and stays.
        directed.dedup_by_key(|link| (link.0, link.1));
        let mut offsets = vec![0; n_frames + 1];
        for link in &directed {
            offsets[link.0 as usize + 1] += 1;
        }
        for vertex in 0..n_frames {
            offsets[vertex + 1] += offsets[vertex];
        }
        Self { offsets, links: directed.into_iter().map(|(_, to, length)| (to, length)).collect() }
    }

    /// The union of the neighbour lists: an edge wherever one frame is among the other's `n_neighbors` nearest.
    ///
    /// The union, not the directed lists: only then is the shortest path from a to b that from b to a.
    ///
    /// * `besides` — edges that it has whatever the lists say, such as those between frames that follow each other
    pub fn union(lists: &NeighborLists, n_neighbors: usize, besides: &[Edge]) -> Self {
        let edges = lists.nearest(n_neighbors).enumerate().flat_map(|(row, list)| {
            list.iter().map(move |near| Edge { a: row as u32, b: near.frame_index, length: near.distance() })
        });
        Self::new(lists.n_frames(), edges.chain(besides.iter().copied()))
    }

    /// N.
    pub fn n_frames(&self) -> usize {
        self.offsets.len() - 1
    }

    /// Number of undirected edges.
    pub fn n_edges(&self) -> usize {
        self.links.len() / 2
    }

    /// Neighbours of a vertex and the lengths of the edges to them, by rising index.
    pub fn neighbors(&self, vertex: u32) -> &[(u32, f32)] {
        let vertex = vertex as usize;
        &self.links[self.offsets[vertex] as usize..self.offsets[vertex + 1] as usize]
    }

    /// The connected parts, largest first, each with its frames by rising index.
    pub fn islands(&self) -> Vec<Vec<u32>> {
        let mut seen = vec![false; self.n_frames()];
        let mut islands = Vec::new();
        for start in 0..self.n_frames() as u32 {
            let mut island = Vec::new();
            self.reach(start, &mut seen, &mut island);
            if island.is_empty() {
                continue;
            }
            island.sort_unstable();
            islands.push(island);
        }
        islands.sort_by_key(|island| std::cmp::Reverse(island.len()));
        islands
    }

    /// All frames, those of the given one's island first and island after island, each after the one that led to it and before
    /// those that are more edges away.
    pub(crate) fn breadth_first(&self, from: u32) -> Vec<u32> {
        let mut seen = vec![false; self.n_frames()];
        let mut order = Vec::with_capacity(self.n_frames());
        for start in std::iter::once(from).chain(0..self.n_frames() as u32) {
            self.reach(start, &mut seen, &mut order);
        }
        order
    }

    /// Appends a frame and what it is connected with, breadth first, as far as not seen before.
    fn reach(&self, start: u32, seen: &mut [bool], order: &mut Vec<u32>) {
        let mut next = order.len();
        if !std::mem::replace(&mut seen[start as usize], true) {
            order.push(start);
        }
        while let Some(&vertex) = order.get(next) {
            next += 1;
            for &(to, _) in self.neighbors(vertex) {
                if !std::mem::replace(&mut seen[to as usize], true) {
                    order.push(to);
                }
            }
        }
    }

    /// The same graph with other numbers for its frames.
    ///
    /// * `order` — which frame gets number 0, 1, …
    /// * `places` — which number each frame gets
    pub(crate) fn renumbered(&self, order: &[u32], places: &[u32]) -> Self {
        let mut offsets = Vec::with_capacity(self.offsets.len());
        let mut links: Vec<(u32, f32)> = Vec::with_capacity(self.links.len());
        offsets.push(0);
        for &vertex in order {
            let first = links.len();
            links.extend(self.neighbors(vertex).iter().map(|&(to, length)| (places[to as usize], length)));
            links[first..].sort_unstable_by_key(|&(to, _)| to);
            offsets.push(links.len() as u32);
        }
        Self { offsets, links }
    }

    /// Joins the islands by the C − 1 bridges of least total length, and returns these, shortest first.
    ///
    /// * `squared_distance` — between any two frames, counts²
    ///
    /// O(pairs of frames on different islands).
    pub fn join_islands(&mut self, squared_distance: impl Fn(u32, u32) -> u64) -> Vec<Edge> {
        let islands = self.islands();
        if islands.len() == 1 {
            return Vec::new();
        }
        let mut crossings = Vec::new();
        for (index, island) in islands.iter().enumerate() {
            for other in &islands[index + 1..] {
                let shortest = pairs(island, other).map(|(a, b)| (squared_distance(a, b), a, b)).min();
                crossings.extend(shortest);
            }
        }
        crossings.sort_unstable();
        self.join_by(crossings.into_iter().map(|(squared, a, b)| Edge { a, b, length: length(squared) }))
    }

    /// Adds those of the given edges that join islands not joined by an edge before (Kruskal 1956), and returns them.
    ///
    /// * `edges` — shortest first
    pub fn join_by(&mut self, edges: impl IntoIterator<Item = Edge>) -> Vec<Edge> {
        let mut island_of = vec![0; self.n_frames()];
        for (index, island) in self.islands().iter().enumerate() {
            island.iter().for_each(|&frame_index| island_of[frame_index as usize] = index);
        }
        let mut bridges = Vec::new();
        for edge in edges {
            let (keep, join) = (island_of[edge.a as usize], island_of[edge.b as usize]);
            if keep != join {
                island_of.iter_mut().filter(|island| **island == join).for_each(|island| *island = keep);
                bridges.push(edge);
            }
        }
        *self = Self::new(self.n_frames(), self.edges().chain(bridges.iter().copied()).collect::<Vec<_>>());
        bridges
    }

    /// Every undirected edge once, from its lower frame.
    pub fn edges(&self) -> impl Iterator<Item = Edge> + '_ {
        (0..self.n_frames() as u32).flat_map(move |a| {
            let upward = self.neighbors(a).iter().filter(move |(b, _)| a < *b);
            upward.map(move |&(b, length)| Edge { a, b, length })
        })
    }
}

fn pairs<'a>(left: &'a [u32], right: &'a [u32]) -> impl Iterator<Item = (u32, u32)> + 'a {
    left.iter().flat_map(move |&a| right.iter().map(move |&b| (a, b)))
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;
    use crate::frames::Frames;
    use crate::metric::{Euclidean, Metric};
    use crate::neighbors::nearest_of_each;

    /// Two tight groups and a lone frame on a line.
    fn three_islands() -> (Frames, Graph) {
        let frames = Frames::new(1, vec![0, 1, 2, 100, 101, 102, 300]);
        let edges = [(0, 1), (1, 2), (3, 4), (4, 5)];
        let graph = Graph::new(7, edges.map(|(a, b)| Edge { a, b, length: 1.0 }));
        (frames, graph)
    }

    #[test]
    fn islands_are_joined_by_one_bridge_less_than_there_are_islands_and_by_the_shortest() {
        let (frames, mut graph) = three_islands();
        assert_eq!(graph.islands(), [vec![0, 1, 2], vec![3, 4, 5], vec![6]]);
        let bridges = graph
            .join_islands(|a, b| Euclidean.squared_distance(frames.row(a as usize), frames.row(b as usize)));
        assert_eq!(bridges, [Edge { a: 2, b: 3, length: 98.0 }, Edge { a: 5, b: 6, length: 198.0 }]);
        assert_eq!(graph.islands().len(), 1);
        assert_eq!(graph.n_edges(), 6);
    }

    #[test]
    fn an_edge_given_twice_counts_once_with_its_shorter_length() {
        let twice = [Edge { a: 0, b: 1, length: 2.0 }, Edge { a: 1, b: 0, length: 1.0 }];
        let graph = Graph::new(2, twice);
        assert_eq!(graph.edges().collect::<Vec<_>>(), [Edge { a: 0, b: 1, length: 1.0 }]);
    }

    proptest! {
        #[test]
        fn bridges_are_as_long_in_total_as_the_edges_prim_adds(counts in prop::collection::vec(0..2000_u16, 6..40)) {
            let frames = Frames::new(1, counts);
            let n = frames.n_frames();
            let squared = |a: u32, b: u32| Euclidean.squared_distance(frames.row(a as usize), frames.row(b as usize));
            let mut graph = Graph::union(&nearest_of_each(&frames, &Euclidean, 2, &mut |_| ()), 2, &[]);
            // Second method: Prim over all frames, where edges that the graph has already cost nothing.
            let cost = |a: u32, b: u32| {
                let linked = graph.neighbors(a).iter().any(|&(to, _)| to == b);
                if linked { 0.0 } else { f64::from(length(squared(a, b))) }
            };
            let mut reach: Vec<f64> = (0..n as u32).map(|b| if b == 0 { 0.0 } else { cost(0, b) }).collect();
            let mut outside: Vec<u32> = (1..n as u32).collect();
            let mut expected = 0.0;
            while let Some(place) = (0..outside.len()).min_by(|&x, &y| reach[outside[x] as usize].total_cmp(&reach[outside[y] as usize])) {
                let vertex = outside.swap_remove(place);
                expected += reach[vertex as usize];
                for &other in &outside {
                    reach[other as usize] = reach[other as usize].min(cost(vertex, other));
                }
            }
            let n_islands = graph.islands().len();
            let bridges = graph.join_islands(squared);
            prop_assert_eq!(bridges.len(), n_islands - 1);
            prop_assert_eq!(graph.islands().len(), 1);
            let total: f64 = bridges.iter().map(|bridge| f64::from(bridge.length)).sum();
            prop_assert!((total - expected).abs() <= 1e-6 * expected);
        }
    }
}
