//! Search: the reference frames nearest to one frame, exactly, without looking at most of them.
//!
//! The plain way is to measure every frame and keep the nearest. Departures from it, where frames are
//! [indexed](Frames::indexed) and the metric allows bounds ([`blocks`](crate::blocks)):
//! 1. Coarse bounds of all frames.
//! 2. Some are measured first, for a k-th distance to beat: of those with the least coarse bounds and those that were
//!    nearest to the last query (a robot's next frame is much like the one before), the half with the least bounds at the next
//!    finer level, and so on to the finest. The nearer these are, the fewer others are looked at.
//! 3. Frames whose coarse bound is beyond that distance, or whose bound at a finer level is, are farther than k others.
//! 4. The rest are measured by rising bounds, several side by side, until a bound is beyond the k-th distance.
//!
//! A frame is only passed over for a bound that proves it farther than the k-th, never for one that equals it, so that ties
//! go to the lower index here too. What the last query was decides what is measured, and not what is found.

use std::ops::{Deref, Range};

use crate::blocks::{Blocks, Bounded, Bounds, Sketch};
use crate::frames::Frames;
use crate::metric::{Metric, N_SIDE_BY_SIDE};
use crate::neighbors::{Neighbor, keep, neighbor};

/// Looks for the k nearest of the same frames again and again. Holds all memory that this takes.
pub(crate) struct Search {
    k: usize,
    nearest: Vec<Neighbor>,
    pruned: Option<Pruned>,
}

/// What looking by bounds takes.
struct Pruned {
    sketch: Sketch,
    /// By coarse blocks, shape `(n_chunks, LANES)`.
    bounds: Vec<Bounds>,
    /// Frames that are not ruled out.
    candidates: Vec<Bounded>,
    /// By level, frames with bounds of that level, that nearer ones were measured before.
    waiting: Vec<Vec<Bounded>>,
    /// Frames that were measured for the last answer.
    n_measured: usize,
}

impl Search {
    /// * `k` — at least 1, at most `n_frames`
    pub(crate) fn new(frames: &Frames<impl Deref<Target = [u16]>>, k: usize) -> Self {
        let n_frames = frames.n_frames();
        assert!((1..=n_frames).contains(&k), "{k} neighbours among {n_frames} frames");
        let pruned = frames.blocks().map(|blocks| Pruned::new(blocks, n_frames, k));
        Self { k, nearest: Vec::with_capacity(k), pruned }
    }

    /// The k frames nearest to another, nearest first, of equals the lower index first.
    ///
    /// * `query` — as rows of the frames
    ///
    /// Allocates nothing. O(n_frames) distances at worst.
    pub(crate) fn nearest(
        &mut self,
        frames: &Frames<impl Deref<Target = [u16]>>,
        metric: &impl Metric,
        query: &[u16],
    ) -> &[Neighbor] {
        self.nearest_without(frames, metric, query, 0..0)
    }

    /// The same, as if some frames were not there.
    ///
    /// * `hidden` — so few that k others are left
    pub(crate) fn nearest_without<M: Metric>(
        &mut self,
        frames: &Frames<impl Deref<Target = [u16]>>,
        metric: &M,
        query: &[u16],
        hidden: Range<u32>,
    ) -> &[Neighbor] {
        let Self { k, nearest, pruned } = self;
        match pruned {
            Some(pruned) if M::IS_EUCLIDEAN_OR_MORE => {
                pruned.find(frames, metric, query, hidden, *k, nearest);
            }
            _ => {
                nearest.clear();
                let hidden = hidden.start as usize..hidden.end as usize;
                for index in (0..hidden.start).chain(hidden.end..frames.n_frames()) {
                    keep(neighbor(index, metric.squared_distance(query, frames.row(index))), *k, nearest);
                }
            }
        }
        nearest
    }

    /// The last answer.
    pub(crate) fn last(&self) -> &[Neighbor] {
        &self.nearest
    }

    /// Frames that were measured for the last answer; none where it measures all.
    pub(crate) fn n_measured(&self) -> Option<usize> {
        self.pruned.as_ref().map(|pruned| pruned.n_measured).filter(|n| *n > 0)
    }
}

impl Pruned {
    fn new(blocks: &Blocks, n_frames: usize, k: usize) -> Self {
        let waiting =
            (0..blocks.n_levels()).rev().map(|finer| Vec::with_capacity(n_first(k, finer).min(n_frames)));
        Self {
            sketch: blocks.sketch(),
            bounds: vec![Bounds::default(); blocks.n_chunks()],
            candidates: Vec::with_capacity(n_frames),
            waiting: waiting.collect(),
            n_measured: 0,
        }
    }

    /// * `nearest` — of the last query, or none; overwritten
    fn find(
        &mut self,
        frames: &Frames<impl Deref<Target = [u16]>>,
        metric: &impl Metric,
        query: &[u16],
        hidden: Range<u32>,
        k: usize,
        nearest: &mut Vec<Neighbor>,
    ) {
        let Self { sketch, bounds, candidates, waiting, n_measured } = self;
        let blocks = frames.blocks().expect("frames do not lose their blocks");
        let finest = blocks.n_levels() - 1;
        sketch.draw(&query[..frames.n_readings()]);
        blocks.coarse_bounds(sketch, bounds);

        // As those that have been taken.
        bounds.as_flattened_mut()[hidden.start as usize..hidden.end as usize].fill(f32::INFINITY);
        nearest.retain(|last| !hidden.contains(&last.frame_index));
        candidates.clear();
        candidates.extend(nearest.drain(..).map(|last| take(bounds, last.frame_index)));
        // Fewer than k, of which some are hidden now, are no limit.
        let last = candidates.iter().map(|last| last.bound).max_by(f32::total_cmp);
        let worst = last.filter(|_| candidates.len() >= k);
        take_least(bounds, n_first(k, finest), worst.unwrap_or(f32::INFINITY), candidates);
        for (level, waiting) in waiting.iter_mut().enumerate() {
            blocks.refine(level, sketch, candidates);
            let n_first = n_first(k, finest - level);
            part(candidates, n_first);
            waiting.clear();
            waiting.extend(candidates.drain(n_first.min(candidates.len())..));
        }
        measure(frames, metric, query, candidates, k, nearest);
        *n_measured = candidates.len();

        let squared_limit = nearest[k - 1].squared_distance;
        candidates.clear();
        take_within(bounds, blocks.limit(0, squared_limit), candidates);
        for (level, waiting) in waiting.iter_mut().enumerate() {
            blocks.refine(level, sketch, candidates);
            candidates.append(waiting);
            let limit = blocks.limit(level, squared_limit);
            candidates.retain(|candidate| candidate.bound <= limit);
        }
        candidates.sort_unstable_by(by_bound);
        for some in candidates.chunks(N_SIDE_BY_SIDE) {
            let limit = blocks.limit(finest, nearest[k - 1].squared_distance);
            let n_within = some.partition_point(|candidate| candidate.bound <= limit);
            measure(frames, metric, query, &some[..n_within], k, nearest);
            *n_measured += n_within;
        }
    }
}

/// Of the frames that are measured first, how many are looked at before so many finer levels.
fn n_first(k: usize, n_finer: usize) -> usize {
    k.next_multiple_of(N_SIDE_BY_SIDE) << n_finer
}

fn by_bound(a: &Bounded, b: &Bounded) -> std::cmp::Ordering {
    a.bound.total_cmp(&b.bound)
}

/// Takes a frame out of those that are to be looked at.
fn take(bounds: &mut [Bounds], frame_index: u32) -> Bounded {
    let bound = &mut bounds.as_flattened_mut()[frame_index as usize];
    Bounded { bound: std::mem::replace(bound, f32::INFINITY), frame_index }
}

/// Brings the `n` frames with the least bounds to the front, the `n`-th at its place.
fn part(frames: &mut [Bounded], n: usize) {
    if frames.len() > n {
        frames.select_nth_unstable_by(n - 1, by_bound);
    }
}

/// Takes the `n` frames with the least bounds below a limit, or all that there are.
fn take_least(bounds: &mut [Bounds], n: usize, mut limit: f32, taken: &mut Vec<Bounded>) {
    let n_before = taken.len();
    for (chunk, bounds) in bounds.iter().enumerate() {
        if any_below(bounds, limit) {
            taken.extend(below(chunk, bounds, limit));
        }
        if taken.len() >= n_before + 2 * n {
            part(&mut taken[n_before..], n);
            taken.truncate(n_before + n);
            limit = taken[n_before + n - 1].bound;
        }
    }
    part(&mut taken[n_before..], n);
    taken.truncate(n_before + n);
    for taken in &taken[n_before..] {
        take(bounds, taken.frame_index);
    }
}

/// Takes the frames whose bounds are at most a limit.
fn take_within(bounds: &[Bounds], limit: f32, taken: &mut Vec<Bounded>) {
    let limit = limit.next_up();
    for (chunk, bounds) in bounds.iter().enumerate() {
        if any_below(bounds, limit) {
            taken.extend(below(chunk, bounds, limit));
        }
    }
}

/// Those frames of a chunk whose bounds are below a limit.
fn below(chunk: usize, bounds: &Bounds, limit: f32) -> impl Iterator<Item = Bounded> {
    let first = (chunk * bounds.len()) as u32;
    let of_chunk = (first..).zip(bounds).map(|(frame_index, &bound)| Bounded { bound, frame_index });
    of_chunk.filter(move |frame| frame.bound < limit)
}

/// Written without a branch for each, so that all are compared at once.
fn any_below(bounds: &Bounds, limit: f32) -> bool {
    bounds.iter().fold(false, |any, bound| any | (*bound < limit))
}

/// Measures frames, and keeps those of them that are among the k nearest.
fn measure(
    frames: &Frames<impl Deref<Target = [u16]>>,
    metric: &impl Metric,
    query: &[u16],
    candidates: &[Bounded],
    k: usize,
    nearest: &mut Vec<Neighbor>,
) {
    let rest = measure_by::<N_SIDE_BY_SIDE>(frames, metric, query, candidates, k, nearest);
    let rest = measure_by::<{ N_SIDE_BY_SIDE / 2 }>(frames, metric, query, rest, k, nearest);
    let rest = measure_by::<{ N_SIDE_BY_SIDE / 4 }>(frames, metric, query, rest, k, nearest);
    measure_by::<1>(frames, metric, query, rest, k, nearest);
}

/// Measures so many at a time, and returns those that are left over.
fn measure_by<'a, const R: usize>(
    frames: &Frames<impl Deref<Target = [u16]>>,
    metric: &impl Metric,
    query: &[u16],
    candidates: &'a [Bounded],
    k: usize,
    nearest: &mut Vec<Neighbor>,
) -> &'a [Bounded] {
    let (some, rest) = candidates.as_chunks::<R>();
    for some in some {
        let indices = some.map(|candidate| candidate.frame_index as usize);
        let squared = metric.squared_distances(query, indices.map(|index| frames.row(index)));
        for (index, squared) in indices.into_iter().zip(squared) {
            keep(neighbor(index, squared), k, nearest);
        }
    }
    rest
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;
    use crate::command::{Command, CommandScale, Commands, N_COMMAND_COLUMNS, WithCommands};
    use crate::frames::SensorLayout;
    use crate::metric::Euclidean;
    use crate::testing::{SORTS, Sort, frames_of, layout};

    /// The plainest way: every distance, then a full sort.
    fn by_sorting(frames: &Frames, metric: &impl Metric, query: &[u16]) -> Vec<Neighbor> {
        let measured = |index: usize| neighbor(index, metric.squared_distance(query, frames.row(index)));
        let mut all: Vec<_> = (0..frames.n_frames()).map(measured).collect();
        all.sort();
        all
    }

    /// Searches for several queries in turn, and for a frame of the set.
    fn check(frames: &Frames, metric: &impl Metric, queries: &Frames, k: usize) -> Result<(), TestCaseError> {
        let mut search = Search::new(frames, k);
        let rows = (0..queries.n_frames()).map(|index| queries.row(index));
        let middle = frames.n_frames() / 2;
        // Around one of the frames, as many as may be.
        let n_hidden = (frames.n_frames() - k).min(middle);
        let hidden = (middle - n_hidden / 2) as u32..(middle - n_hidden / 2 + n_hidden) as u32;
        for query in rows.chain([frames.row(middle)]) {
            let mut expected = by_sorting(frames, metric, query);
            prop_assert_eq!(search.nearest(frames, metric, query), &expected[..k]);
            expected.retain(|near| !hidden.contains(&near.frame_index));
            let found = search.nearest_without(frames, metric, query, hidden.clone());
            prop_assert_eq!(found, &expected[..k]);
        }
        Ok(())
    }

    /// A sensor of few readings, or of many; a number of frames; how many of them are looked for.
    fn sizes() -> impl Strategy<Value = (SensorLayout, usize, usize)> {
        let sensor = prop_oneof![
            3 => (1..12_u32, 1..30_u32),
            1 => Just((124, 160)),
            1 => Just((1, 20_000)),
        ];
        let n_and_k = (1..70_usize)
            .prop_flat_map(|n_frames| (Just(n_frames), prop_oneof![Just(1), Just(n_frames), 1..=n_frames]));
        (sensor, n_and_k).prop_map(|((rows, columns), (n, k))| (layout(rows, columns), n, k))
    }

    fn sorts() -> impl Strategy<Value = [Sort; 2]> {
        [prop::sample::select(&SORTS[..]), prop::sample::select(&SORTS[..])]
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(100))]

        #[test]
        fn a_search_finds_what_a_full_sort_finds_with_ties_by_index(
            (sensor, n_frames, k) in sizes(), sorts in sorts(), seed in any::<u64>(),
        ) {
            let frames = Frames::new(sensor.n_readings(), frames_of(sorts[0], sensor, n_frames, seed));
            // As the frames are, and unlike them.
            for (sort, seed) in [(sorts[0], seed), (sorts[0], seed ^ 1), (sorts[1], seed)] {
                let queries = Frames::new(sensor.n_readings(), frames_of(sort, sensor, 3, seed));
                check(&frames, &Euclidean, &queries, k)?;
                check(&frames.clone().indexed(sensor), &Euclidean, &queries, k)?;
            }
        }

        #[test]
        fn commands_are_among_what_a_search_compares(
            (sensor, n_frames, k) in sizes(), sorts in sorts(), seed in any::<u64>(), weight in 0.01..3.0_f64,
        ) {
            let n_readings = sensor.n_readings();
            let command = |index: usize| Command { forward_m_s: (index % 3) as f64, turn_rad_s: (index % 5) as f64 };
            let commands = Commands { weight, of_frames: (0..n_frames).map(command).collect() };
            let scale = CommandScale::new(&commands, 1e8);
            let counts = frames_of(sorts[0], sensor, n_frames, seed);
            let frames = scale.append(counts, n_readings, &commands.of_frames).indexed(sensor);
            let queries = scale.append(frames_of(sorts[1], sensor, 3, seed), n_readings, &[1, 2, 3].map(command));
            prop_assert_eq!(frames.n_columns(), n_readings + N_COMMAND_COLUMNS);
            check(&frames, &WithCommands::new(&Euclidean, &scale), &queries, k)?;
        }
    }

    #[test]
    fn of_frames_that_are_alike_in_places_few_are_measured() {
        for (rows, columns) in [(1, 16), (1, 1080), (124, 160)] {
            let sensor = layout(rows, columns);
            let counts = frames_of(Sort::Smooth, sensor, 300, 5);
            let frames = Frames::new(sensor.n_readings(), counts).indexed(sensor);
            let mut search = Search::new(&frames, 10);
            for index in [0, 150, 299] {
                search.nearest(&frames, &Euclidean, frames.row(index));
                let n_measured = search.n_measured().unwrap();
                assert!((10..50).contains(&n_measured), "{n_measured} of {rows} × {columns}");
            }
        }
    }

    #[test]
    fn a_metric_that_bounds_say_nothing_of_measures_every_frame() {
        let sensor = layout(1, 16);
        let metric = crate::metric::MetricPlan::Ring { n_rings: 1 }.compile(sensor).unwrap();
        let crate::metric::AnyMetric::Ring(ring) = &metric else { panic!("a ring was asked for") };
        let frames = Frames::new(16, frames_of(Sort::Noisy, sensor, 50, 3)).indexed(sensor);
        let turned: Vec<u16> = (0..16).map(|index| frames.row(20)[(index + 5) % 16]).collect();
        let mut search = Search::new(&frames, 4);
        assert_eq!(search.nearest(&frames, ring, &turned), &by_sorting(&frames, ring, &turned)[..4]);
        assert_eq!(search.nearest(&frames, ring, &turned)[0], neighbor(20, 0));
        assert_eq!(search.n_measured(), None);
    }
}
