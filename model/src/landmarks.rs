//! Landmarks: the reference frames that geodesics are measured from.

use std::ops::Deref;

use rand::RngExt;
use rand::seq::index;
use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::SeedableRng;
use rayon::prelude::*;

use crate::blocks::{Bounded, Bounds, Sketch};
use crate::frames::Frames;
use crate::metric::Metric;
use crate::plan::LandmarkChoice;

/// Rounds of k-means. Landmarks need not be the best of means: after a few rounds little moves.
const N_ROUNDS_MAX: usize = 10;

/// Chooses `n_landmarks` frames, by rising index. All of them if there are no more.
///
/// Distances are whole numbers and ties go to the lower index, so that frames and seed determine the choice on every
/// machine and any number of threads. Random costs nothing, farthest point O(n_landmarks · n_frames · n_readings), k-means
/// up to eleven times that.
///
/// The mean of frames reading by reading is the frame nearest to all of them by Euclidean distances, whatever the weights of
/// the readings. Frames that turn have no such mean: for them, k-means is not a choice.
pub fn choose(
    frames: &Frames,
    metric: &impl Metric,
    n_landmarks: usize,
    choice: LandmarkChoice,
    seed: u64,
) -> Vec<u32> {
    let n_frames = frames.n_frames();
    if n_landmarks >= n_frames {
        return (0..n_frames as u32).collect();
    }
    let mut random = ChaCha8Rng::seed_from_u64(seed);
    let mut landmarks: Vec<u32> = match choice {
        LandmarkChoice::Random => return at_random(n_frames, n_landmarks, seed),
        LandmarkChoice::Farthest => {
            let first = random.random_range(0..n_frames as u32);
            and_farthest(frames, metric, vec![first], n_landmarks)
        }
        LandmarkChoice::KMeans => {
            let medoids = nearest_to_means(frames, metric, n_landmarks, &mut random);
            and_farthest(frames, metric, medoids, n_landmarks)
        }
    };
    landmarks.sort_unstable();
    landmarks
}

/// Any of the frames, each as likely, by rising index. All of them if there are no more.
pub(crate) fn at_random(n_frames: usize, n_chosen: usize, seed: u64) -> Vec<u32> {
    let mut random = ChaCha8Rng::seed_from_u64(seed);
    let chosen = index::sample(&mut random, n_frames, n_chosen.min(n_frames));
    let mut chosen: Vec<u32> = chosen.into_iter().map(|index| index as u32).collect();
    chosen.sort_unstable();
    chosen
}

/// How far each frame is from the nearest of the frames chosen so far, and which that is.
pub(crate) struct Cover<'a, M, C> {
    frames: &'a Frames<C>,
    metric: &'a M,
    /// Where frames are indexed and the metric allows bounds.
    bounding: Option<Bounding>,
    /// In the order in which they were chosen.
    chosen: Vec<u32>,
    /// Of the chosen, none: they are not chosen again.
    nearest: Vec<Option<Chosen>>,
}

/// What tells by bounds that a frame is no nearer than those before.
struct Bounding {
    /// Of the frame chosen last.
    sketch: Sketch,
    /// Of every frame from it, shape `(n_chunks, LANES)`.
    coarse: Vec<Bounds>,
}

/// The chosen frame nearest to another.
#[derive(Clone, Copy)]
struct Chosen {
    /// Squared distance to it, counts².
    squared: u64,
    /// Its place in the order of choice.
    rank: usize,
}

/// Counts² that rounding of squared distances to whole ones can take from the triangle inequality, and more.
const ROUNDING: u64 = 8;

impl<'a, M: Metric, C: Deref<Target = [u16]> + Sync> Cover<'a, M, C> {
    pub(crate) fn new(frames: &'a Frames<C>, metric: &'a M) -> Self {
        let none = Chosen { squared: u64::MAX, rank: usize::MAX };
        let blocks = frames.blocks().filter(|_| M::IS_EUCLIDEAN_OR_MORE);
        let bounding = blocks.map(|blocks| Bounding {
            sketch: blocks.sketch(),
            coarse: vec![Bounds::default(); blocks.n_chunks()],
        });
        Self { frames, metric, bounding, chosen: Vec::new(), nearest: vec![Some(none); frames.n_frames()] }
    }

    /// Adds a frame to the chosen.
    pub(crate) fn choose(&mut self, chosen: u32) {
        let Self { frames, metric, .. } = *self;
        let row = frames.row(chosen as usize);
        let squared_to = |index: u32| metric.squared_distance(row, frames.row(index as usize));
        let rank = self.chosen.len();
        let bounded = self.bounding.as_mut().zip(frames.blocks()).map(|(bounding, blocks)| {
            bounding.sketch.draw(&row[..frames.n_readings()]);
            blocks.coarse_bounds(&bounding.sketch, &mut bounding.coarse);
            (&*bounding, blocks)
        });
        let apart: Vec<u64> = match bounded {
            Some(_) => Vec::new(),
            None => self.chosen.par_iter().map(|&before| squared_to(before)).collect(),
        };
        self.nearest.par_iter_mut().enumerate().for_each(|(index, nearest)| {
            let Some(nearest) = nearest else { return };
            let is_farther = match bounded {
                Some((Bounding { sketch, coarse }, blocks)) => {
                    let (frame_index, bound) = (index as u32, coarse.as_flattened()[index]);
                    blocks.is_beyond(sketch, Bounded { bound, frame_index }, nearest.squared)
                }
                // By the triangle inequality: if the chosen one is more than twice as far from the nearest before it as that
                // is from the frame, it is farther from the frame.
                None => {
                    let twice = nearest.squared.saturating_mul(4).saturating_add(ROUNDING);
                    apart.get(nearest.rank).is_some_and(|&apart| apart > twice)
                }
            };
            if is_farther {
                return;
            }
            let squared = squared_to(index as u32);
            let is_lower = || chosen < self.chosen[nearest.rank];
            if squared < nearest.squared || squared == nearest.squared && is_lower() {
                *nearest = Chosen { squared, rank };
            }
        });
        self.nearest[chosen as usize] = None;
        self.chosen.push(chosen);
    }

    /// Farthest that a frame is from the nearest chosen one, counts²; 0 where all are chosen.
    pub(crate) fn squared_radius(&self) -> u64 {
        self.nearest.iter().flatten().map(|nearest| nearest.squared).max().unwrap_or(0)
    }

    /// The frame farthest from all chosen; of equals the lowest.
    pub(crate) fn farthest(&self) -> u32 {
        let squared = |index: usize| self.nearest[index].map(|nearest| nearest.squared);
        let farthest = |best: usize, index: usize| if squared(index) > squared(best) { index } else { best };
        (0..self.nearest.len()).fold(0, farthest) as u32
    }

    /// A frame that is drawn in proportion to its squared distance; none where all are equal to chosen ones.
    fn draw(&self, random: &mut ChaCha8Rng) -> Option<u32> {
        // Squared distances of 2³² frames of the longest kind are beyond 64 bits.
        let total: u128 = self.nearest.iter().flatten().map(|nearest| u128::from(nearest.squared)).sum();
        let mut left = if total > 0 { random.random_range(0..total) } else { return None };
        let drawn = |nearest: &Option<Chosen>| {
            let squared = nearest.map_or(0, |nearest| u128::from(nearest.squared));
            let is_drawn = left < squared;
            left = left.saturating_sub(squared);
            is_drawn
        };
        self.nearest.iter().position(drawn).map(|index| index as u32)
    }
}

/// Completes a choice by the frame farthest from all chosen, again and again.
fn and_farthest(frames: &Frames, metric: &impl Metric, mut chosen: Vec<u32>, n_landmarks: usize) -> Vec<u32> {
    let mut cover = Cover::new(frames, metric);
    chosen.iter().for_each(|&frame_index| cover.choose(frame_index));
    while chosen.len() < n_landmarks {
        let farthest = cover.farthest();
        cover.choose(farthest);
        chosen.push(farthest);
    }
    chosen
}

/// The frame nearest to each centre of k-means that has frames: at most `n_means`.
///
/// Starts: Arthur & Vassilvitskii 2007, *k-means++: the advantages of careful seeding*. Rounds: Lloyd 1982, *Least squares
/// quantization in PCM*, with centres rounded to whole counts.
fn nearest_to_means(
    frames: &Frames,
    metric: &impl Metric,
    n_means: usize,
    random: &mut ChaCha8Rng,
) -> Vec<u32> {
    let mut cover = Cover::new(frames, metric);
    let mut centres = Vec::with_capacity(n_means * frames.n_columns());
    let mut start = Some(random.random_range(0..frames.n_frames() as u32));
    while let Some(frame_index) = start.filter(|_| centres.len() < n_means * frames.n_columns()) {
        centres.extend_from_slice(frames.row(frame_index as usize));
        cover.choose(frame_index);
        start = cover.draw(random);
    }
    let mut centres = Frames::new(frames.n_columns(), centres);
    let mut nearest = nearest_centres(frames, metric, &centres);
    for _ in 0..N_ROUNDS_MAX {
        centres = means(frames, &nearest, &centres);
        let moved = nearest_centres(frames, metric, &centres);
        if moved.iter().zip(&nearest).all(|(moved, before)| moved.1 == before.1) {
            nearest = moved;
            break;
        }
        nearest = moved;
    }
    let mut medoids = vec![None; centres.n_frames()];
    for (index, &(squared, centre)) in (0..).zip(&nearest) {
        let medoid: &mut Option<(u64, u32)> = &mut medoids[centre];
        if medoid.is_none_or(|best| (squared, index) < best) {
            *medoid = Some((squared, index));
        }
    }
    medoids.into_iter().flatten().map(|(_, index)| index).collect()
}

/// Squared distance of each frame to its nearest centre, and which that is; of equals the lowest.
fn nearest_centres(frames: &Frames, metric: &impl Metric, centres: &Frames) -> Vec<(u64, usize)> {
    let nearest = |index: usize| {
        let row = frames.row(index);
        let each =
            (0..centres.n_frames()).map(|centre| (metric.squared_distance(row, centres.row(centre)), centre));
        each.min().expect("there is a centre")
    };
    (0..frames.n_frames()).into_par_iter().map(nearest).collect()
}

/// The mean of each centre's frames, rounded to whole counts. A centre without frames stays.
fn means(frames: &Frames, nearest: &[(u64, usize)], centres: &Frames) -> Frames {
    let n_columns = frames.n_columns();
    let mut members = vec![Vec::new(); centres.n_frames()];
    nearest.iter().enumerate().for_each(|(index, &(_, centre))| members[centre].push(index));
    let mut counts = Vec::with_capacity(centres.counts().len());
    for (centre, members) in members.iter().enumerate() {
        let n = members.len() as u64;
        if n == 0 {
            counts.extend_from_slice(centres.row(centre));
            continue;
        }
        let mut sums = vec![0_u64; n_columns];
        for &index in members {
            sums.iter_mut().zip(frames.row(index)).for_each(|(sum, &count)| *sum += u64::from(count));
        }
        counts.extend(sums.iter().map(|sum| ((sum + n / 2) / n) as u16));
    }
    Frames::new(n_columns, counts)
}

#[cfg(test)]
mod tests {
    use LandmarkChoice::{Farthest, KMeans, Random};

    use super::*;
    use crate::metric::Euclidean;
    use crate::testing::{SORTS, frames_of, layout};

    /// A hundred frames at one place, two at another, and one far from both.
    fn uneven() -> Frames {
        let there = (0..100).map(|index| 1000 + index);
        Frames::new(1, there.chain([20_000, 20_010, 60_000]).collect::<Vec<u16>>())
    }

    #[test]
    fn landmarks_are_distinct_frames_by_rising_index_that_follow_from_the_seed() {
        let frames =
            Frames::new(2, (0..2000_u32).map(|index| (index * index % 7919) as u16).collect::<Vec<_>>());
        for choice in [Random, Farthest, KMeans] {
            let chosen = choose(&frames, &Euclidean, 100, choice, 7);
            assert_eq!(chosen.len(), 100);
            assert!(chosen.windows(2).all(|pair| pair[0] < pair[1]) && chosen[99] < 1000, "{chosen:?}");
            assert_eq!(chosen, choose(&frames, &Euclidean, 100, choice, 7));
            assert_ne!(chosen, choose(&frames, &Euclidean, 100, choice, 8), "{choice:?}");
        }
    }

    #[test]
    fn every_frame_is_a_landmark_when_as_many_are_asked_for() {
        for choice in [Random, Farthest, KMeans] {
            assert_eq!(choose(&Frames::new(1, vec![3; 5]), &Euclidean, 9, choice, 0), [0, 1, 2, 3, 4]);
        }
    }

    #[test]
    fn farthest_points_and_means_find_a_place_that_was_seen_once() {
        for choice in [Farthest, KMeans] {
            for seed in 0..10 {
                let chosen = choose(&uneven(), &Euclidean, 3, choice, seed);
                assert!(chosen[0] < 100 && [100, 101].contains(&chosen[1]), "{choice:?}: {chosen:?}");
                assert_eq!(chosen[2], 102, "{choice:?}");
            }
        }
    }

    #[test]
    fn a_mean_is_stood_for_by_the_frame_in_the_middle_and_a_farthest_point_lies_at_the_edge() {
        let frames = Frames::new(1, (0..101).chain(30_000..30_101).collect::<Vec<u16>>());
        for seed in 0..10 {
            assert_eq!(choose(&frames, &Euclidean, 2, KMeans, seed), [50, 151]);
            let far = choose(&frames, &Euclidean, 2, Farthest, seed);
            assert!(far[0] == 0 || far[1] == 201, "{far:?}");
        }
    }

    #[test]
    fn frames_that_are_all_alike_still_make_as_many_landmarks_as_were_asked_for() {
        for choice in [Random, Farthest, KMeans] {
            assert_eq!(choose(&Frames::new(3, vec![7; 30]), &Euclidean, 4, choice, 1).len(), 4);
        }
    }

    #[test]
    fn bounds_and_the_triangle_inequality_choose_the_same_frames() {
        for sort in SORTS {
            for (rows, columns) in [(1, 7), (1, 300), (30, 40)] {
                let sensor = layout(rows, columns);
                let frames = Frames::new(sensor.n_readings(), frames_of(sort, sensor, 90, 4));
                for choice in [Farthest, KMeans] {
                    let plain = choose(&frames, &Euclidean, 30, choice, 5);
                    let bounded = choose(&frames.clone().indexed(sensor), &Euclidean, 30, choice, 5);
                    assert_eq!(plain, bounded, "{sort:?}, {rows} × {columns}, {choice:?}");
                }
            }
        }
    }

    #[test]
    fn the_choice_is_the_same_on_one_thread_and_on_two() {
        let frames =
            Frames::new(2, (0..600_u32).map(|index| (index * index % 4801) as u16).collect::<Vec<_>>());
        for choice in [Farthest, KMeans] {
            let on = |n_threads| {
                let pool = rayon::ThreadPoolBuilder::new().num_threads(n_threads).build().unwrap();
                pool.install(|| choose(&frames, &Euclidean, 40, choice, 3))
            };
            assert_eq!(on(1), on(2));
        }
    }
}
