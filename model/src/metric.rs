//! Metrics: how far apart two frames are on the response's scale.
//!
//! Neighbours, landmarks, straight distances and novelty all ask one [`Metric`], in fitting and in serving alike. What a
//! person asks for is a [`MetricPlan`], which stands in the model; compiled for a sensor it becomes an [`AnyMetric`]. That is
//! matched once, outside of all loops: what loops over frames is generic and compiled for each metric by itself.
//!
//! Every metric gives whole counts², the same on every machine and in whatever order it sums. Columns of a frame that are
//! to be compared in another way than its readings can therefore be compared by a metric of their own, on their part of the
//! slices, and the two squared distances added.

use std::fmt;

use serde::{Deserialize, Serialize};

use crate::frames::SensorLayout;
use crate::squares;

/// How far apart two frames are.
pub trait Metric: Sync {
    /// Squared distance between two frames of equal length, counts².
    ///
    /// Symmetric, and 0 from a frame to itself. Its root obeys the triangle inequality.
    fn squared_distance(&self, a: &[u16], b: &[u16]) -> u64;

    /// Squared distances from one frame to several, side by side: sooner where these lie apart in memory.
    fn squared_distances<const R: usize>(&self, from: &[u16], to: [&[u16]; R]) -> [u64; R] {
        to.map(|to| self.squared_distance(from, to))
    }

    /// Whether no distance is less than the [`Euclidean`] one between readings, so that a lower bound of that is one of this.
    const IS_EUCLIDEAN_OR_MORE: bool = false;
}

/// Frames that are worth being measured side by side.
pub(crate) const N_SIDE_BY_SIDE: usize = 8;

/// Which metric, as a plan and a model file say it.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub enum MetricPlan {
    /// Every reading counts as much as every other.
    #[default]
    Euclidean,
    /// Each reading counts by its weight: `Σ w_i (a_i − b_i)²`. One weight for each reading, at least 0, not all 0. Only their
    /// ratios matter: they are scaled to a mean of 1, so that distances keep the size that they have without weights.
    Weighted(Vec<f64>),
    /// Frames are as far apart as they are when one is turned until it is nearest to the other: a robot that turns in place
    /// sees the same.
    Ring {
        /// The readings are so many rings of equal length, one after the other, that turn together.
        n_rings: usize,
    },
}

/// `least distances over all turns of 2 rings`
impl fmt::Display for MetricPlan {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Euclidean => write!(f, "euclidean distances"),
            Self::Weighted(weights) => write!(f, "distances with {} weights", weights.len()),
            Self::Ring { n_rings: 1 } => write!(f, "least distances over all turns of the ring"),
            Self::Ring { n_rings } => write!(f, "least distances over all turns of {n_rings} rings"),
        }
    }
}

/// Why a sensor's frames cannot be compared by a metric.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum MetricError {
    /// Not one weight for each reading.
    #[error(
        "metric: {n_weights} weights were given and the sensor has {n_readings} readings; give one weight for each"
    )]
    NumberOfWeights {
        /// Weights.
        n_weights: usize,
        /// D.
        n_readings: usize,
    },
    /// A weight that is none.
    #[error("metric: the weight of reading {reading} is {weight}; it must be finite and at least 0")]
    Weight {
        /// Which reading, from 0.
        reading: usize,
        /// What was given.
        weight: f64,
    },
    /// Weights without a mean.
    #[error(
        "metric: the {n_weights} weights sum to {sum}; at least one must be above 0, and their sum finite"
    )]
    Sum {
        /// Weights.
        n_weights: usize,
        /// Their sum.
        sum: f64,
    },
    /// Sums of so many readings may be beyond 64 bits.
    #[error(
        "metric: weighted distances are exact up to {limit} readings and the sensor has {n_readings}; use the euclidean metric"
    )]
    TooManyReadings {
        /// D.
        n_readings: usize,
        /// How many at most.
        limit: usize,
    },
    /// A camera.
    #[error(
        "metric: the sensor has {rows} rows of readings, as cameras have, which do not look all around; a sensor of rings has \
         at most {limit}; use the euclidean metric or weights"
    )]
    Camera {
        /// Rows of the sensor.
        rows: u32,
        /// How many at most.
        limit: u32,
    },
    /// Rings that do not lie in the sensor's rows.
    #[error(
        "metric: {rows} × {columns} readings are not {n_rings} rings of equal length, each within a row and of at least 2 \
         readings; ask for another number of rings"
    )]
    Rings {
        /// Rows of the sensor.
        rows: u32,
        /// Readings in a row.
        columns: u32,
        /// Rings asked for.
        n_rings: usize,
    },
}

impl MetricPlan {
    /// Checks the plan against a sensor, and prepares what computes.
    ///
    /// # Errors
    /// If the weights or rings do not fit the sensor, with the numbers of both.
    pub fn compile(&self, sensor: SensorLayout) -> Result<AnyMetric, MetricError> {
        Ok(match self {
            Self::Euclidean => AnyMetric::Euclidean(Euclidean),
            Self::Weighted(weights) => AnyMetric::Weighted(Weighted::new(weights, sensor.n_readings())?),
            Self::Ring { n_rings } => AnyMetric::Ring(Ring::new(*n_rings, sensor)?),
        })
    }
}

/// One of the metrics, ready to compute. Match it once, outside of loops.
#[derive(Clone, Debug)]
pub enum AnyMetric {
    /// See [`Euclidean`].
    Euclidean(Euclidean),
    /// See [`Weighted`].
    Weighted(Weighted),
    /// See [`Ring`].
    Ring(Ring),
}

/// The root of the sum of squared differences.
///
/// Counts are `u16`, so that a squared distance is at most 65535² · D: exact in `u64`.
#[derive(Clone, Copy, Debug)]
pub struct Euclidean;

impl Metric for Euclidean {
    fn squared_distance(&self, a: &[u16], b: &[u16]) -> u64 {
        if a.len() < N_READINGS_FEW {
            return squares::plain(a, b);
        }
        let [sum] = squares::sums(a, [b]);
        sum
    }

    fn squared_distances<const R: usize>(&self, from: &[u16], to: [&[u16]; R]) -> [u64; R] {
        if from.len() < N_READINGS_FEW {
            return to.map(|to| squares::plain(from, to));
        }
        squares::sums(from, to)
    }

    const IS_EUCLIDEAN_OR_MORE: bool = true;
}

/// Fewer readings than this are summed before vector instructions are under way.
const N_READINGS_FEW: usize = 64;

/// As [`Euclidean`], with a weight for each reading.
///
/// Weights are whole multiples of 2⁻¹² of their mean. The weighted sum of whole numbers is exact and free of order, and
/// rounded to whole counts² once, at its end: by half a count², which is less than rounding the readings themselves to whole
/// counts has put into any distance of a count or more. Where distances are so small, the triangle inequality holds up to
/// that rounding.
#[derive(Clone, Debug)]
pub struct Weighted {
    /// In units of 2⁻¹² of their mean, shape `(n_readings,)`. Their sum is at most 2³², see [`Weighted::N_READINGS_MAX`].
    weights: Vec<u32>,
}

/// Bits of a weight behind the point.
const WEIGHT_BITS: u32 = 12;

impl Weighted {
    /// Weights of a mean of 1 sum to at most `D · (2¹² + ½)`, each rounded by half a unit at most. Up to here that is at most
    /// 2³², and with differences of at most 2¹⁶ − 1 the whole sum at most `2³² · (2¹⁶ − 1)² = 2⁶⁴ − 2⁴⁹ + 2³²`: with the half
    /// that rounds it, below 2⁶⁴.
    pub const N_READINGS_MAX: usize = ((1_u64 << 33) / ((2 << WEIGHT_BITS) + 1)) as usize;

    fn new(weights: &[f64], n_readings: usize) -> Result<Self, MetricError> {
        let n_weights = weights.len();
        if n_weights != n_readings {
            return Err(MetricError::NumberOfWeights { n_weights, n_readings });
        }
        if n_readings > Self::N_READINGS_MAX {
            return Err(MetricError::TooManyReadings { n_readings, limit: Self::N_READINGS_MAX });
        }
        let is_none = |weight: &f64| !(weight.is_finite() && *weight >= 0.0);
        if let Some(reading) = weights.iter().position(is_none) {
            return Err(MetricError::Weight { reading, weight: weights[reading] });
        }
        let sum: f64 = weights.iter().sum();
        if !(sum.is_finite() && sum > 0.0) {
            return Err(MetricError::Sum { n_weights, sum });
        }
        // First the share, which is at most 1 however large or small the weights are.
        let units = f64::from(1 << WEIGHT_BITS) * n_readings as f64;
        Ok(Self { weights: weights.iter().map(|weight| (weight / sum * units).round() as u32).collect() })
    }
}

impl Metric for Weighted {
    fn squared_distance(&self, a: &[u16], b: &[u16]) -> u64 {
        debug_assert_eq!(a.len(), self.weights.len());
        let weighted = self.weights.iter().zip(squares::each(a, b));
        let sum: u64 = weighted.map(|(&weight, squared)| u64::from(weight) * squared).sum();
        (sum + (1 << (WEIGHT_BITS - 1))) >> WEIGHT_BITS
    }
}

/// The least [`Euclidean`] distance over all turns: `min over s of Σ (a_i − b_{(i + s) mod n})²`, i in a ring of n readings, and
/// rings turning together.
///
/// Turns are a group of isometries, so this is a metric between frames up to turns: 0 between a frame and its turns,
/// symmetric, and with the triangle inequality, since the turns along both legs add up to one along the third side.
///
/// O(n · D) at worst; a turn is given up as soon as it is no nearer than the best before it.
#[derive(Clone, Debug)]
pub struct Ring {
    n_per_ring: usize,
}

/// Readings between two looks at whether a turn is still worth it.
const N_READINGS_AT_ONCE: usize = 64;

impl Ring {
    fn new(n_rings: usize, sensor: SensorLayout) -> Result<Self, MetricError> {
        let SensorLayout { rows, columns, .. } = sensor;
        if !sensor.has_rings() {
            return Err(MetricError::Camera { rows, limit: SensorLayout::N_RING_ROWS_MAX });
        }
        let n_readings = sensor.n_readings();
        // A whole number of rings to each row, and a whole number of readings to each ring.
        let fits = n_rings > 0 && n_rings.is_multiple_of(rows as usize) && n_readings.is_multiple_of(n_rings);
        match fits && n_readings / n_rings >= 2 {
            true => Ok(Self { n_per_ring: n_readings / n_rings }),
            false => Err(MetricError::Rings { rows, columns, n_rings }),
        }
    }

    /// Readings of each ring.
    pub(crate) fn n_per_ring(&self) -> usize {
        self.n_per_ring
    }

    /// Squared distance after a turn, or `limit` if it is not below that.
    fn turned(&self, turn: usize, a: &[u16], b: &[u16], limit: u64) -> u64 {
        let mut sum = 0;
        for (a, b) in a.chunks_exact(self.n_per_ring).zip(b.chunks_exact(self.n_per_ring)) {
            // What stands before the turn comes round at the end.
            let (b_end, b_beginning) = b.split_at(turn);
            let (a_beginning, a_end) = a.split_at(b_beginning.len());
            for (a, b) in [(a_beginning, b_beginning), (a_end, b_end)] {
                for (a, b) in a.chunks(N_READINGS_AT_ONCE).zip(b.chunks(N_READINGS_AT_ONCE)) {
                    sum += squares::plain(a, b);
                    if sum >= limit {
                        return limit;
                    }
                }
            }
        }
        sum
    }
}

impl Metric for Ring {
    fn squared_distance(&self, a: &[u16], b: &[u16]) -> u64 {
        debug_assert!(a.len() == b.len() && a.len().is_multiple_of(self.n_per_ring));
        (0..self.n_per_ring).fold(u64::MAX, |least, turn| self.turned(turn, a, b, least))
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    fn layout(rows: u32, columns: u32) -> SensorLayout {
        SensorLayout { rows, columns, metres_per_count: 0.001 }
    }

    fn ring(n_rings: usize, n_readings: usize) -> Ring {
        Ring::new(n_rings, layout(1, n_readings as u32)).unwrap()
    }

    fn weighted(weights: &[f64]) -> Weighted {
        Weighted::new(weights, weights.len()).unwrap()
    }

    fn square(a: u16, b: u16) -> u128 {
        u128::from(a.abs_diff(b)).pow(2)
    }

    /// The plainest way: every turn by the printed formula, in 128 bits.
    fn by_formula(n_rings: usize, a: &[u16], b: &[u16]) -> u128 {
        let n = a.len() / n_rings;
        let at_turn = |turn: usize| -> u128 {
            (0..a.len()).map(|i| square(a[i], b[i / n * n + (i % n + turn) % n])).sum()
        };
        (0..n).map(at_turn).min().unwrap()
    }

    fn turned(n_rings: usize, frame: &[u16], turn: usize) -> Vec<u16> {
        let mut frame = frame.to_vec();
        let n = frame.len() / n_rings;
        frame.chunks_exact_mut(n).for_each(|ring| ring.rotate_left(turn % n));
        frame
    }

    /// Number of rings, and three frames of that many.
    fn three_frames() -> impl Strategy<Value = (usize, [Vec<u16>; 3])> {
        // A small alphabet makes turns that are equally near; the extremes show overflow.
        let reading = prop_oneof![0..4_u16, Just(u16::MAX), any::<u16>()];
        (1..4_usize, prop_oneof![2..9_usize, 60..140_usize]).prop_flat_map(move |(n_rings, n)| {
            let frame = prop::collection::vec(reading.clone(), n_rings * n);
            (Just(n_rings), [frame.clone(), frame.clone(), frame])
        })
    }

    /// The triangle inequality between three squared lengths, but for the rounding of three roots and a sum.
    fn is_triangle(ab: u64, bc: u64, ac: u64) -> bool {
        let [ab, bc, ac] = [ab, bc, ac].map(|squared| (squared as f64).sqrt());
        ac <= (ab + bc) * (1.0 + 4.0 * f64::EPSILON)
    }

    proptest! {
        #[test]
        fn the_distance_between_rings_is_that_of_the_formula_and_no_turn_of_either_changes_it(
            (n_rings, [a, b, c]) in three_frames(),
            turns in [0..200_usize, 0..200_usize],
        ) {
            let metric = ring(n_rings, a.len());
            let ab = metric.squared_distance(&a, &b);
            prop_assert_eq!(u128::from(ab), by_formula(n_rings, &a, &b));
            prop_assert_eq!(ab, metric.squared_distance(&b, &a));
            let (a_turned, b_turned) = (turned(n_rings, &a, turns[0]), turned(n_rings, &b, turns[1]));
            prop_assert_eq!(ab, metric.squared_distance(&a_turned, &b_turned));
            prop_assert_eq!(metric.squared_distance(&a, &a_turned), 0);
            prop_assert!(is_triangle(ab, metric.squared_distance(&b, &c), metric.squared_distance(&a, &c)));
            prop_assert!(ab <= Euclidean.squared_distance(&a, &b));
        }

        #[test]
        fn weighted_distances_are_the_formula_to_within_the_rounding_of_weights_and_sum(
            readings in prop::collection::vec((0.0..8.0_f64, any::<u16>(), any::<u16>()), 1..40),
        ) {
            let weights: Vec<f64> = readings.iter().map(|(weight, _, _)| *weight).collect();
            prop_assume!(weights.iter().sum::<f64>() > 0.0);
            let (a, b): (Vec<u16>, Vec<u16>) = readings.iter().map(|&(_, a, b)| (a, b)).unzip();
            let mean = weights.iter().sum::<f64>() / weights.len() as f64;
            let squares: Vec<f64> = a.iter().zip(&b).map(|(&a, &b)| square(a, b) as f64).collect();
            let expected: f64 = squares.iter().zip(&weights).map(|(square, weight)| weight / mean * square).sum();
            let found = weighted(&weights).squared_distance(&a, &b);
            let rounding = 0.5 + 0.5 / 4096.0 * squares.iter().sum::<f64>() + 1e-12 * expected;
            prop_assert!((found as f64 - expected).abs() <= rounding, "{} {}", found, expected);
            prop_assert_eq!(found, weighted(&weights).squared_distance(&b, &a));
        }

        #[test]
        fn weighted_distances_obey_the_triangle_inequality_but_for_half_a_count_squared(
            readings in prop::collection::vec((0.0..8.0_f64, 0..2000_u16, 0..2000_u16, 0..2000_u16), 1..40),
        ) {
            let weights: Vec<f64> = readings.iter().map(|reading| reading.0 + 1e-3).collect();
            let frame = |of: fn(&(f64, u16, u16, u16)) -> u16| readings.iter().map(of).collect::<Vec<u16>>();
            let (a, b, c) = (frame(|reading| reading.1), frame(|reading| reading.2), frame(|reading| reading.3));
            let metric = weighted(&weights);
            let length = |a: &[u16], b: &[u16], rounding: f64| {
                (metric.squared_distance(a, b) as f64 + rounding).max(0.0).sqrt()
            };
            prop_assert!(length(&a, &c, -0.5) <= (length(&a, &b, 0.5) + length(&b, &c, 0.5)) * (1.0 + 1e-12));
        }

        #[test]
        fn equal_weights_of_whatever_size_are_no_weights((_, [a, b, _]) in three_frames(), weight in 1e-300..1e300_f64) {
            let metric = weighted(&vec![weight; a.len()]);
            prop_assert_eq!(metric.squared_distance(&a, &b), Euclidean.squared_distance(&a, &b));
        }
    }

    #[test]
    fn a_weight_of_0_hides_a_reading_and_twice_the_weight_counts_twice() {
        let metric = weighted(&[0.0, 1.0, 2.0]);
        assert_eq!(metric.squared_distance(&[7, 5, 5], &[60_000, 5, 5]), 0);
        assert_eq!(metric.squared_distance(&[7, 0, 0], &[7, 10, 0]), 100);
        assert_eq!(metric.squared_distance(&[7, 0, 0], &[7, 0, 10]), 200);
    }

    #[test]
    fn rings_turn_together() {
        let metric = ring(2, 8);
        let frame = [1, 2, 3, 4, 50, 60, 70, 80];
        assert_eq!(metric.squared_distance(&frame, &[2, 3, 4, 1, 60, 70, 80, 50]), 0);
        // One ring alone turned by a place: as far as 10, 10, 10 and 30 counts, or the other ring is by 1, 1, 1 and 3.
        assert_eq!(metric.squared_distance(&frame, &[1, 2, 3, 4, 60, 70, 80, 50]), 12);
    }

    #[test]
    fn the_largest_possible_distances_do_not_overflow() {
        let n_readings = Weighted::N_READINGS_MAX;
        assert_eq!(n_readings, 1_048_448);
        let (black, white) = (vec![0; n_readings], vec![u16::MAX; n_readings]);
        let most = n_readings as u64 * 65535 * 65535;
        assert_eq!(Euclidean.squared_distance(&black, &white), most);
        let mut weights = vec![0.0; n_readings];
        weights[5] = 1e308;
        assert_eq!(weighted(&weights).squared_distance(&black, &white), most);
        // A mean of 1, and all weights but the first rounded up by as much as can be.
        weights.fill(4095.501 / 4096.0);
        weights[0] = n_readings as f64 - (n_readings - 1) as f64 * weights[1];
        let metric = weighted(&weights);
        let sum: u128 = metric.weights.iter().map(|&weight| u128::from(weight)).sum();
        assert!(sum > (1 << 32) - 2000, "{sum}");
        let expected = (sum * 65535 * 65535 + 2048) >> 12;
        assert_eq!(u128::from(metric.squared_distance(&black, &white)), expected);
        let (black, white) = (&black[..512], &white[..512]);
        assert_eq!(ring(1, 512).squared_distance(black, white), 512 * 65535 * 65535);
    }

    #[test]
    fn a_metric_says_what_it_is() {
        for (plan, words) in [
            (MetricPlan::Euclidean, "euclidean distances"),
            (MetricPlan::Weighted(vec![1.0; 16]), "distances with 16 weights"),
            (MetricPlan::Ring { n_rings: 1 }, "least distances over all turns of the ring"),
            (MetricPlan::Ring { n_rings: 2 }, "least distances over all turns of 2 rings"),
        ] {
            assert_eq!(plan.to_string(), words);
        }
    }

    #[test]
    fn metrics_that_do_not_fit_the_sensor_are_refused_in_words() {
        let refuse =
            |plan: MetricPlan, rows, columns| plan.compile(layout(rows, columns)).unwrap_err().to_string();
        let weights = |weights: &[f64]| MetricPlan::Weighted(weights.to_vec());
        assert_eq!(
            refuse(weights(&[1.0; 5]), 1, 16),
            "metric: 5 weights were given and the sensor has 16 readings; give one weight for each"
        );
        assert_eq!(
            refuse(weights(&[1.0, -0.5]), 1, 2),
            "metric: the weight of reading 1 is -0.5; it must be finite and at least 0"
        );
        assert_eq!(
            refuse(weights(&[f64::NAN, 1.0]), 1, 2),
            "metric: the weight of reading 0 is NaN; it must be finite and at least 0"
        );
        assert_eq!(
            refuse(weights(&[0.0, 0.0]), 1, 2),
            "metric: the 2 weights sum to 0; at least one must be above 0, and their sum finite"
        );
        assert_eq!(
            refuse(weights(&[1e308, 1e308]), 1, 2),
            "metric: the 2 weights sum to inf; at least one must be above 0, and their sum finite"
        );
        assert_eq!(
            refuse(weights(&vec![1.0; 2_000_000]), 1000, 2000),
            "metric: weighted distances are exact up to 1048448 readings and the sensor has 2000000; use the euclidean \
             metric"
        );
        let rings = |n_rings| MetricPlan::Ring { n_rings };
        assert_eq!(
            refuse(rings(124), 124, 160),
            "metric: the sensor has 124 rows of readings, as cameras have, which do not look all around; a sensor of rings \
             has at most 4; use the euclidean metric or weights"
        );
        for (n_rings, rows, columns) in [(0, 1, 16), (3, 1, 16), (16, 1, 16), (1, 2, 8), (3, 2, 9), (6, 2, 8)]
        {
            assert_eq!(
                refuse(rings(n_rings), rows, columns),
                format!(
                    "metric: {rows} × {columns} readings are not {n_rings} rings of equal length, each within a row and of at \
                     least 2 readings; ask for another number of rings"
                )
            );
        }
        assert!(rings(4).compile(layout(2, 8)).is_ok() && rings(2).compile(layout(1, 16)).is_ok());
    }
}
