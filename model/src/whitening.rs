//! Temporal whitening: a few directions along which frames change slowly, in place of their readings.
//!
//! What a place looks like changes slowly; noise, and what a reading makes of every small turn, change from frame to frame.
//! Principal components of some frames of the trip are scaled to unit variance, and of their combinations those are taken
//! that differ least between consecutive frames: the generalised eigenvectors of the covariance of differences against that
//! of frames (slow feature analysis: Wiskott & Sejnowski 2002, *Slow feature analysis: unsupervised learning of invariances*,
//! linear case). Each direction has unit variance, so that how much a reading varies no longer says how much it counts.
//!
//! A direction is a weighted sum of readings on the response's scale. Weights are whole numbers, so that the sum is exact
//! and all after it stays what it is for readings: `u16` to compare, the same on every machine.

use faer::Mat;
use rayon::prelude::*;
use serde::{Deserialize, Serialize};

use crate::array::Array;
use crate::eigen;
use crate::mds::centre;
use crate::metric::N_SIDE_BY_SIDE;
use crate::simd::Instructions;
use crate::squares;
use crate::symmetric::Symmetric;

/// Which directions are asked for.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct WhiteningPlan {
    /// Principal components of which directions are combined; fewer where frames span fewer.
    pub n_components: usize,
    /// Slow directions that are kept; at most as many as components.
    pub n_directions: usize,
}

impl Default for WhiteningPlan {
    fn default() -> Self {
        Self { n_components: 40, n_directions: 4 }
    }
}

/// Pairs of consecutive frames that directions are learnt from, at most.
const N_PAIRS_MAX: usize = 500;

/// A principal component of less than this share of the first one's variance is rounding.
const VARIANCE_SHARE_MIN: f64 = 1e-6;

/// Counts of a standard deviation along a direction: 32 to either side have room.
const COUNTS_OF_DEVIATION: f64 = 1024.0;

/// The count of the mean.
const CENTRE: f64 = 32768.0;

/// Readings less this fit into 16 bits with a sign, as products in vector instructions ask.
const MIDDLE: f64 = 32768.0;

/// Readings that are multiplied at once.
const N_LANES: usize = 32;

/// Largest magnitude of a weight: with readings within ± 2¹⁵, eight products are below 2³¹.
const WEIGHT_MAX: f64 = 8191.0;

/// Products that are added before they are widened.
const N_NARROW: usize = 8;

/// From readings on the response's scale to slow directions.
#[derive(Clone, Debug)]
pub struct Whitening {
    /// Shape `(n_directions, n_readings)`.
    pub(crate) weights: Array<i16>,
    /// Weighted sum of the mean frame's readings less [`MIDDLE`], shape `(n_directions,)`.
    pub(crate) offsets: Array<f64>,
    /// Standard deviations of a weighted sum of one, shape `(n_directions,)`.
    pub(crate) scales: Array<f64>,
    /// Mean of each reading, shape `(n_readings,)`, counts.
    pub(crate) means: Array<f32>,
    /// Counts that a reading changes by for a standard deviation along a direction, shape `(n_directions, n_readings)`.
    pub(crate) loadings: Array<f32>,
}

/// Some frames of a trip and their next, which directions are learnt from.
pub(crate) struct Pairs {
    n_readings: usize,
    /// On the response's scale, shape `(n, n_readings)`.
    frames: Vec<u16>,
    /// Which of them follow each other.
    pairs: Vec<(usize, usize)>,
    /// Between every two of them, shape `(n, n)`, counts². Exact.
    squared_distances: Vec<f64>,
}

impl Pairs {
    /// Which frames to take: pairs evenly over all trips, the frames of all of them ascending.
    ///
    /// * `trips` — frames of each trip
    pub(crate) fn indices(trips: &[usize]) -> Vec<usize> {
        let mut indices: Vec<usize> =
            firsts(trips).into_iter().flat_map(|first| [first, first + 1]).collect();
        indices.dedup();
        indices
    }

    /// * `frames` — those of [`Self::indices`], on the response's scale, shape `(n, n_readings)`
    ///
    /// O(n² · n_readings).
    pub(crate) fn new(frames: Vec<u16>, n_readings: usize, trips: &[usize]) -> Self {
        let indices = Self::indices(trips);
        let place = |index: usize| indices.partition_point(|&other| other < index);
        let pairs = firsts(trips).into_iter().map(|first| (place(first), place(first + 1))).collect();
        let rows: Vec<&[u16]> = frames.chunks_exact(n_readings).collect();
        assert_eq!(rows.len(), indices.len(), "the frames of all pairs");
        let squared_distances = squared_distances(&rows);
        Self { n_readings, pairs, squared_distances, frames }
    }

    fn rows(&self) -> Vec<&[u16]> {
        self.frames.chunks_exact(self.n_readings).collect()
    }

    /// Learns directions.
    ///
    /// `None` where there are fewer than asked for: frames that are equal, or no two that follow each other.
    ///
    /// The same on any number of threads. O(n²) for some tens of products, O(n · n_readings · n_directions).
    pub(crate) fn whiten(&self, plan: WhiteningPlan) -> Option<Whitening> {
        let WhiteningPlan { n_components, n_directions } = plan;
        let (rows, pairs) = (self.rows(), &self.pairs);
        let n_frames = rows.len();
        if pairs.is_empty() {
            return None;
        }
        // Principal components by products between frames, which follow from exact distances: B = −½ H Δ H.
        let (centred, _) = centre(n_frames, |a, b| self.squared_distances[a * n_frames + b]);
        let found = eigen::largest(&centred, n_components)?;
        let least = VARIANCE_SHARE_MIN * found.values[0].max(0.0);
        let n_components = found.values.iter().take(n_components).take_while(|value| **value > least).count();
        if n_components < n_directions {
            return None;
        }
        // Components of unit variance: √n V.
        let root_n = (n_frames as f64).sqrt();
        let components = Mat::from_fn(n_frames, n_components, |frame, component| {
            root_n * found.vectors[(frame, component)]
        });
        let slow = slowest(&components, pairs, n_directions)?;
        // The directions' own coordinates of the frames, and by what frames are summed for the weights of readings.
        let combined = |divisor: &dyn Fn(usize) -> f64| {
            Mat::from_fn(n_frames, n_directions, |frame, direction| {
                let term = |c: usize| components[(frame, c)] * slow[(c, direction)] / divisor(c);
                (0..n_components).map(term).sum()
            })
        };
        let coordinates = combined(&|_| 1.0);
        let weights = sums_of_frames(&rows, &combined(&|component| found.values[component]));
        let loadings = sums_of_frames(&rows, &coordinates);
        let ones = Mat::from_fn(n_frames, 1, |_, _| 1.0 / n_frames as f64);
        let means = sums_of_frames(&rows, &ones);
        Some(Whitening::rounded(&weights, &loadings, &means, n_frames))
    }
}

impl Whitening {
    /// * `weights`, `loadings` — shape `(n_directions, n_readings)`; loadings as sums over all frames
    fn rounded(weights: &[Vec<f64>], loadings: &[Vec<f64>], means: &[Vec<f64>], n_frames: usize) -> Self {
        let [means] = means else { unreachable!("one mean of each reading") };
        let (mut whole, mut offsets, mut scales) = (Vec::new(), Vec::new(), Vec::new());
        for weights in weights {
            let largest = weights.iter().fold(0.0, |largest: f64, weight| largest.max(weight.abs()));
            let scale = largest / WEIGHT_MAX;
            let rounded: Vec<i16> = weights.iter().map(|weight| (weight / scale).round() as i16).collect();
            let of_mean =
                rounded.iter().zip(means).map(|(&weight, mean)| f64::from(weight) * (mean - MIDDLE));
            offsets.push(of_mean.sum());
            scales.push(scale);
            whole.extend(rounded);
        }
        let loadings: Vec<f32> =
            loadings.iter().flatten().map(|sum| (sum / n_frames as f64) as f32).collect();
        let means: Vec<f32> = means.iter().map(|&mean| mean as f32).collect();
        Self {
            weights: whole.into(),
            offsets: Array::from(offsets),
            scales: scales.into(),
            means: means.into(),
            loadings: loadings.into(),
        }
    }

    /// Directions.
    pub fn n_directions(&self) -> usize {
        self.scales.len()
    }

    /// Readings of a frame.
    pub fn n_readings(&self) -> usize {
        self.means.len()
    }

    /// Computes a frame's counts along the directions.
    ///
    /// * `readings` — on the response's scale, shape `(n_readings,)`
    /// * `directions` — overwritten, shape `(n_directions,)`
    ///
    /// Allocates nothing.
    pub(crate) fn map(&self, readings: &[u16], directions: &mut [u16]) {
        self.map_with(Instructions::widest(), readings, directions);
    }

    fn map_with(&self, instructions: Instructions, readings: &[u16], directions: &mut [u16]) {
        assert_eq!(readings.len(), self.n_readings(), "a frame of another sensor");
        let of_directions = self.weights.chunks_exact(readings.len());
        let parts = of_directions.zip(self.offsets.iter().zip(&*self.scales));
        for ((weights, (offset, scale)), direction) in parts.zip(directions) {
            let sum = instructions.run(
                #[inline(always)]
                || weighted_sum(readings, weights),
            );
            let deviations = (sum as f64 - offset) * scale;
            // `as` saturates.
            *direction = (deviations * COUNTS_OF_DEVIATION + CENTRE).round() as u16;
        }
    }

    /// The frame that the directions say, as far as they say it: the mean and what readings change by along each.
    ///
    /// * `directions` — shape `(n_directions,)`
    ///
    /// Returns readings on the response's scale, shape `(n_readings,)`.
    pub fn frame_of(&self, directions: &[u16]) -> Vec<u16> {
        let deviations: Vec<f32> = directions
            .iter()
            .map(|&count| ((f64::from(count) - CENTRE) / COUNTS_OF_DEVIATION) as f32)
            .collect();
        let loadings: Vec<&[f32]> = self.loadings.chunks_exact(self.n_readings()).collect();
        let reading = |(index, mean): (usize, &f32)| {
            let changes =
                loadings.iter().zip(&deviations).map(|(loadings, deviation)| loadings[index] * deviation);
            (mean + changes.sum::<f32>()).round() as u16
        };
        self.means.iter().enumerate().map(reading).collect()
    }
}

/// The first frame of each pair, ascending.
///
/// * `trips` — frames of each trip
fn firsts(trips: &[usize]) -> Vec<usize> {
    let mut firsts = Vec::new();
    let mut begin = 0;
    for n_frames in trips {
        firsts.extend(begin..begin + n_frames.saturating_sub(1));
        begin += n_frames;
    }
    let n_pairs = firsts.len().min(N_PAIRS_MAX);
    (0..n_pairs).map(|index| firsts[index * firsts.len() / n_pairs]).collect()
}

/// Combinations of components that differ least between frames that follow each other, slowest first, shape
/// `(n_components, n_directions)`, orthonormal.
fn slowest(components: &Mat<f64>, pairs: &[(usize, usize)], n_directions: usize) -> Option<Mat<f64>> {
    let n_components = components.ncols();
    // The least of the differences' covariance are the largest of its negative.
    let negative = Symmetric::from_fn(n_components, |a, b| {
        let difference =
            |of: usize, &(first, next): &(usize, usize)| components[(next, of)] - components[(first, of)];
        -pairs.iter().map(|pair| difference(a, pair) * difference(b, pair)).sum::<f64>() / pairs.len() as f64
    });
    let found = eigen::largest(&negative, n_directions)?;
    let sign = |direction: usize| {
        let entries = (0..n_components).map(|component| found.vectors[(component, direction)]);
        entries.fold(0.0, |a: f64, b| if b.abs() > a.abs() { b } else { a }).signum()
    };
    Some(Mat::from_fn(n_components, n_directions, |component, direction| {
        sign(direction) * found.vectors[(component, direction)]
    }))
}

/// For each column of factors, the sum of all frames, each times its factor; shape `(n_columns, n_readings)`.
fn sums_of_frames(rows: &[&[u16]], factors: &Mat<f64>) -> Vec<Vec<f64>> {
    let n_readings = rows[0].len();
    let of_column = |column: usize| {
        let mut sums = vec![0.0; n_readings];
        // Readings side by side, frames in their order.
        sums.par_chunks_mut(1024).enumerate().for_each(|(chunk, sums)| {
            for (frame, row) in rows.iter().enumerate() {
                let factor = factors[(frame, column)];
                let row = &row[chunk * 1024..][..sums.len()];
                sums.iter_mut().zip(row).for_each(|(sum, &count)| *sum += factor * f64::from(count));
            }
        });
        sums
    };
    (0..factors.ncols()).map(of_column).collect()
}

/// Of every two frames, shape `(n_frames, n_frames)`. Exact.
fn squared_distances(rows: &[&[u16]]) -> Vec<f64> {
    let n_frames = rows.len();
    let mut squared = vec![0.0; n_frames * n_frames];
    // Of each frame to those before it. There are none where no two follow each other.
    squared.par_chunks_exact_mut(n_frames.max(1)).enumerate().for_each(|(index, squared)| {
        let from = rows[index];
        let (some, rest) = rows[..index].as_chunks::<N_SIDE_BY_SIDE>();
        let (squared_of_some, squared_of_rest) = squared[..index].as_chunks_mut::<N_SIDE_BY_SIDE>();
        for (to, squared) in some.iter().zip(squared_of_some) {
            *squared = squares::sums(from, *to).map(|sum| sum as f64);
        }
        for (to, squared) in rest.iter().zip(squared_of_rest) {
            let [sum] = squares::sums(from, [to]);
            *squared = sum as f64;
        }
    });
    for index in 0..n_frames {
        for before in 0..index {
            squared[before * n_frames + index] = squared[index * n_frames + before];
        }
    }
    squared
}

/// `Σ w_j (x_j − 2¹⁵)`, exact.
#[inline(always)]
fn weighted_sum(readings: &[u16], weights: &[i16]) -> i64 {
    const N_SPAN: usize = N_LANES * N_NARROW;
    #[inline(always)]
    fn product(reading: u16, weight: i16) -> i32 {
        i32::from((reading ^ (1 << 15)) as i16) * i32::from(weight)
    }
    let (spans, rest) = readings.as_chunks::<N_SPAN>();
    let (weight_spans, weights_of_rest) = weights.as_chunks::<N_SPAN>();
    let mut sum = 0;
    for (readings, weights) in spans.iter().zip(weight_spans) {
        let mut lanes = [0_i32; N_LANES];
        for (readings, weights) in readings.chunks_exact(N_LANES).zip(weights.chunks_exact(N_LANES)) {
            for (lane, (&reading, &weight)) in lanes.iter_mut().zip(readings.iter().zip(weights)) {
                *lane += product(reading, weight);
            }
        }
        sum += lanes.iter().map(|&lane| i64::from(lane)).sum::<i64>();
    }
    let of_rest = rest.iter().zip(weights_of_rest);
    sum + of_rest.map(|(&reading, &weight)| i64::from(product(reading, weight))).sum::<i64>()
}

#[cfg(test)]
mod tests {
    use nalgebra::{DMatrix, SymmetricEigen};
    use proptest::prelude::*;

    use super::*;
    use crate::testing::{SORTS, Sort, frames_of, layout};

    fn pairs_of(frames: &[u16], n_readings: usize) -> Pairs {
        let trips = [frames.len() / n_readings];
        let indices = Pairs::indices(&trips);
        let taken = indices.iter().flat_map(|index| &frames[index * n_readings..][..n_readings]);
        Pairs::new(taken.copied().collect(), n_readings, &trips)
    }

    fn whitened(frames: &[u16], n_readings: usize, plan: WhiteningPlan) -> Option<(Pairs, Whitening)> {
        let pairs = pairs_of(frames, n_readings);
        let whitening = pairs.whiten(plan)?;
        Some((pairs, whitening))
    }

    /// Deviations along each direction, one column each.
    fn deviations(whitening: &Whitening, rows: &[&[u16]]) -> DMatrix<f64> {
        let mut counts = vec![0; whitening.n_directions()];
        let mut all = DMatrix::zeros(rows.len(), counts.len());
        for (frame, row) in rows.iter().enumerate() {
            whitening.map(row, &mut counts);
            for (direction, &count) in counts.iter().enumerate() {
                all[(frame, direction)] = (f64::from(count) - CENTRE) / COUNTS_OF_DEVIATION;
            }
        }
        all
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(60))]

        #[test]
        fn a_weighted_sum_is_exact_by_all_instructions(
            n in prop_oneof![1..40_usize, 250..260_usize, 500..1100_usize],
            seed in any::<u64>(),
            is_greatest in any::<bool>(),
        ) {
            let random = frames_of(Sort::Random, layout(2, n as u32), 1, seed);
            let (readings, others) = random.split_at(n);
            let largest = WEIGHT_MAX as i32;
            let weight = |&count: &u16| match is_greatest {
                true => -largest as i16,
                false => (i32::from(count) % (2 * largest + 1) - largest) as i16,
            };
            let weights: Vec<i16> = others.iter().map(weight).collect();
            let readings: Vec<u16> = if is_greatest { vec![0; n] } else { readings.to_vec() };
            let plain: i128 = readings
                .iter()
                .zip(&weights)
                .map(|(&reading, &weight)| (i128::from(reading) - (1 << 15)) * i128::from(weight))
                .sum();
            for instructions in Instructions::all() {
                let sum = instructions.run(
                    #[inline(always)]
                    || weighted_sum(&readings, &weights),
                );
                prop_assert_eq!(i128::from(sum), plain);
            }
        }

        #[test]
        fn whatever_frames_are_directions_have_no_mean_and_a_deviation_of_one_or_there_are_none(
            sort in prop::sample::select(&SORTS[..]), n_frames in 2..60_usize, seed in any::<u64>(),
        ) {
            let frames = frames_of(sort, layout(3, 11), n_frames, seed);
            let Some((pairs, whitening)) = whitened(&frames, 33, WhiteningPlan { n_components: 8, n_directions: 2 })
            else {
                return Ok(());
            };
            let found = deviations(&whitening, &pairs.rows());
            for direction in found.column_iter() {
                // Counts and weights are rounded.
                prop_assert!(direction.mean().abs() < 0.01, "{}", direction.mean());
                prop_assert!((direction.variance() - 1.0).abs() < 0.02, "{}", direction.variance());
            }
        }
    }

    /// Readings that follow two slow signals and many quick ones.
    fn slow_and_quick(n_frames: usize) -> (Vec<u16>, DMatrix<f64>) {
        let n_readings = 9;
        let noise = frames_of(Sort::Random, layout(1, n_readings), n_frames, 3);
        let slow = DMatrix::from_fn(n_frames, 2, |t, signal| match signal {
            0 => (t as f64 / 40.0).sin(),
            _ => (t as f64 / 17.0).cos(),
        });
        let frames = (0..n_frames * n_readings as usize).map(|index| {
            let (t, reading) = (index / n_readings as usize, index % n_readings as usize);
            // The second signal is everywhere against the first one's grain.
            let signal = 900.0 * slow[(t, 0)] + if reading % 2 == 0 { 700.0 } else { -500.0 } * slow[(t, 1)];
            (30_000.0 + signal + f64::from(noise[index]) / 65.0) as u16
        });
        (frames.collect(), slow)
    }

    #[test]
    fn the_slowest_directions_follow_slow_signals_through_noise() {
        let (frames, slow) = slow_and_quick(400);
        let (pairs, whitening) =
            whitened(&frames, 9, WhiteningPlan { n_components: 9, n_directions: 2 }).unwrap();
        let found = deviations(&whitening, &pairs.rows());
        // Each signal is nearly all a combination of both directions.
        for signal in slow.column_iter() {
            let centred = signal.add_scalar(-signal.mean());
            let explained: f64 = found
                .column_iter()
                .map(|direction| direction.dot(&centred).powi(2) / direction.norm_squared())
                .sum();
            let share = explained / centred.norm_squared();
            assert!(share > 0.9, "{share}");
        }
    }

    #[test]
    fn how_slow_directions_are_a_generalised_eigenvalue_problem_says_too() {
        let (frames, _) = slow_and_quick(300);
        let (pairs, whitening) =
            whitened(&frames, 9, WhiteningPlan { n_components: 9, n_directions: 4 }).unwrap();
        let rows = pairs.rows();
        let readings = DMatrix::from_fn(rows.len(), 9, |frame, reading| f64::from(rows[frame][reading]));
        let mean = readings.row_mean();
        let centred =
            DMatrix::from_fn(rows.len(), 9, |frame, reading| readings[(frame, reading)] - mean[reading]);
        let covariance = centred.tr_mul(&centred) / rows.len() as f64;
        let difference = DMatrix::from_fn(pairs.pairs.len(), 9, |pair, reading| {
            let (first, next) = pairs.pairs[pair];
            centred[(next, reading)] - centred[(first, reading)]
        });
        let of_differences = difference.tr_mul(&difference) / pairs.pairs.len() as f64;
        // N w = λ C w, by the root of C.
        let inverse = covariance.cholesky().unwrap().l().try_inverse().unwrap();
        let mut expected: Vec<f64> = SymmetricEigen::new(&inverse * of_differences * inverse.transpose())
            .eigenvalues
            .iter()
            .copied()
            .collect();
        expected.sort_by(f64::total_cmp);
        let found = deviations(&whitening, &rows);
        for (direction, expected) in expected.into_iter().take(4).enumerate() {
            let squared = |&(first, next): &(usize, usize)| {
                (found[(next, direction)] - found[(first, direction)]).powi(2)
            };
            let slowness = pairs.pairs.iter().map(squared).sum::<f64>() / pairs.pairs.len() as f64;
            assert!((slowness / expected - 1.0).abs() < 0.01, "{slowness} and {expected}");
        }
    }

    #[test]
    fn a_frame_is_said_again_as_far_as_its_directions_say_it() {
        let (frames, _) = slow_and_quick(200);
        let (pairs, whitening) =
            whitened(&frames, 9, WhiteningPlan { n_components: 9, n_directions: 9 }).unwrap();
        let mut counts = [0; 9];
        for row in pairs.rows() {
            whitening.map(row, &mut counts);
            for (&said, &seen) in whitening.frame_of(&counts).iter().zip(row) {
                assert!(said.abs_diff(seen) <= 12, "{said} and {seen}");
            }
        }
        // The mean frame stands in the middle of all directions.
        let middle = whitening.frame_of(&[CENTRE as u16; 9]);
        assert!(
            middle.iter().zip(&*whitening.means).all(|(&said, mean)| (f32::from(said) - mean).abs() <= 0.5)
        );
    }

    #[test]
    fn pairs_are_of_one_trip_and_spread_over_all() {
        assert_eq!(Pairs::indices(&[3, 1, 2]), [0, 1, 2, 4, 5]);
        assert_eq!(Pairs::indices(&[1, 1]), [0; 0]);
        let indices = Pairs::indices(&[10_000, 30_000]);
        assert_eq!(indices.len(), 2 * N_PAIRS_MAX);
        assert!(!indices.contains(&10_000) || indices.contains(&10_001));
        assert_eq!(indices.iter().filter(|&&index| index < 10_000).count(), N_PAIRS_MAX / 2);
    }

    #[test]
    fn equal_frames_have_no_directions() {
        assert!(whitened(&[700; 90], 9, WhiteningPlan { n_components: 3, n_directions: 1 }).is_none());
    }
}
