//! Texture: how much readings that stand side by side differ, against how much all readings of a frame do.
//!
//! Places differ in shape and size, and what is measured of them varies, but a sensor's frames have much the same grain: walls
//! and ground go on from one reading to the next, and noise is the sensor's. A frame whose grain is another one is from another
//! sensor, or from a broken one, however near it may be to a frame that was seen.

use crate::array::Array;
use crate::frames::SensorLayout;
use crate::metric::AnyMetric;
use crate::simd::Instructions;
use crate::squares;

/// Two ways in which readings stand side by side: along the rows, and down the columns.
pub(crate) const N_WAYS: usize = 2;

/// For each way, `ln` of the mean squared difference over the variance; 0 where there is no such way.
pub(crate) type Texture = [f64; N_WAYS];

/// Which readings stand side by side.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Weave {
    n_rows: usize,
    n_columns: usize,
    /// Whether a row's last reading is beside its first.
    is_ring: bool,
    /// Whether readings count alike. Where they do not, there is no texture.
    is_even: bool,
}

/// Textures of some frames, to rank others by.
#[derive(Clone, Debug)]
pub(crate) struct Textures {
    /// Shape `(n_frames, N_WAYS)`.
    textures: Array<f64>,
    /// Each way by itself, ascending.
    sorted: [Vec<f64>; N_WAYS],
}

/// How far beyond all others a texture must be to count as beyond them, as a share of their spread: a second trip goes a little
/// beyond the first one on either side.
const MARGIN: f64 = 0.05;

impl Textures {
    /// * `textures` — shape `(n_frames, N_WAYS)`, no NaN
    pub(crate) fn new(textures: Array<f64>) -> Self {
        let (frames, _) = textures.as_chunks::<N_WAYS>();
        let sorted = std::array::from_fn(|way| {
            let mut sorted: Vec<f64> = frames.iter().map(|texture| texture[way]).collect();
            sorted.sort_by(f64::total_cmp);
            sorted
        });
        Self { sorted, textures }
    }

    /// That of one of the frames.
    pub(crate) fn of(&self, index: usize) -> Texture {
        [self.textures[N_WAYS * index], self.textures[N_WAYS * index + 1]]
    }

    /// Those of all, shape `(n_frames, N_WAYS)`.
    pub(crate) fn all(&self) -> &[f64] {
        &self.textures
    }

    /// How far from the middle of all a texture is, in the way in which it is farther: twice the difference of ranks. The number
    /// of frames if it is beyond all of them by a margin.
    pub(crate) fn distance_from_middle(&self, texture: Texture) -> f64 {
        let of_way = |(sorted, texture): (&Vec<f64>, f64)| {
            let (least, most) = (sorted[0], sorted[sorted.len() - 1]);
            let margin = MARGIN * (most - least);
            let is_near = (least - margin..=most + margin).contains(&texture);
            let texture = if is_near { texture.clamp(least, most) } else { texture };
            let n_below = sorted.partition_point(|&other| other < texture);
            let n_up_to = sorted.partition_point(|&other| other <= texture);
            (n_below + n_up_to).abs_diff(sorted.len())
        };
        self.sorted.iter().zip(texture).map(of_way).max().unwrap_or(0) as f64
    }
}

impl Weave {
    /// Of a sensor whose frames are compared by a metric, which may know rings in it that are not its rows.
    pub(crate) fn new(sensor: SensorLayout, metric: &AnyMetric) -> Self {
        let (rows, columns) = (sensor.rows as usize, sensor.columns as usize);
        match metric {
            AnyMetric::Ring(rings) => {
                let n_columns = rings.n_per_ring();
                Self { n_rows: rows * columns / n_columns, n_columns, is_ring: true, is_even: true }
            }
            AnyMetric::Euclidean(_) => {
                Self { n_rows: rows, n_columns: columns, is_ring: sensor.has_rings(), is_even: true }
            }
            AnyMetric::Weighted(_) => {
                Self { n_rows: rows, n_columns: columns, is_ring: false, is_even: false }
            }
        }
    }

    /// Measures a frame.
    ///
    /// * `readings` — on the response's scale, shape `(n_rows, n_columns)`
    ///
    /// Allocates nothing. All sums are exact, so that turned rings have one texture.
    pub(crate) fn of(&self, readings: &[u16]) -> Texture {
        let Self { n_rows, n_columns, is_ring, is_even } = *self;
        if !is_even {
            return [0.0; N_WAYS];
        }
        let n = readings.len() as f64;
        let (sum, of_squares) = moments(readings);
        let mean = sum as f64 / n;
        let variance = (of_squares as f64 / n - mean * mean).max(0.0);
        // Of a count, so that a frame of equal readings has a texture too.
        let ratio = |sum: u64, n_pairs: usize| match n_pairs {
            0 => 0.0,
            _ => libm::log((sum as f64 / n_pairs as f64 + 1.0) / (variance + 1.0)),
        };
        let along = self.along(readings);
        let n_along = n_rows * if is_ring { n_columns } else { n_columns - 1 };
        let down = between(&readings[..(n_rows - 1) * n_columns], &readings[n_columns..]);
        [ratio(along, n_along), ratio(down, (n_rows - 1) * n_columns)]
    }
    /// Squared differences along the rows. As if all rows were one, since a sum over many readings takes less than many over few, and
    /// then without what is between the end of a row and the beginning of the next.
    fn along(&self, readings: &[u16]) -> u64 {
        let Self { n_columns, is_ring, .. } = *self;
        let squared = |a: usize, b: usize| u64::from(readings[a].abs_diff(readings[b])).pow(2);
        let ends = (n_columns..=readings.len()).step_by(n_columns).map(|end| end - 1);
        let between_rows: u64 =
            ends.clone().filter(|end| end + 1 < readings.len()).map(|end| squared(end, end + 1)).sum();
        let closing = ends.filter(|_| is_ring).map(|end| squared(end, end + 1 - n_columns)).sum::<u64>();
        between(&readings[..readings.len() - 1], &readings[1..]) - between_rows + closing
    }
}

fn between(a: &[u16], b: &[u16]) -> u64 {
    let [sum] = squares::sums(a, [b]);
    sum
}

/// `Σ x` and `Σ x²`. Exact.
fn moments(readings: &[u16]) -> (u64, u64) {
    Instructions::widest().run(
        #[inline(always)]
        || {
            let squares = readings.iter().map(|&reading| u64::from(u32::from(reading) * u32::from(reading)));
            (readings.iter().map(|&reading| u64::from(reading)).sum(), squares.sum())
        },
    )
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;
    use crate::metric::{Euclidean, MetricPlan};
    use crate::testing::{SORTS, Sort, frames_of, layout};

    /// By its definition.
    fn plain(readings: &[u16], n_columns: usize, is_ring: bool) -> Texture {
        let n_rows = readings.len() / n_columns;
        let at = |row: usize, column: usize| f64::from(readings[row * n_columns + column]);
        let mean = readings.iter().map(|&reading| f64::from(reading)).sum::<f64>() / readings.len() as f64;
        let variance = readings.iter().map(|&reading| (f64::from(reading) - mean).powi(2)).sum::<f64>()
            / readings.len() as f64;
        let mut along = Vec::new();
        let mut down = Vec::new();
        for row in 0..n_rows {
            for column in 0..n_columns {
                if is_ring || column + 1 < n_columns {
                    along.push((at(row, column) - at(row, (column + 1) % n_columns)).powi(2));
                }
                if row + 1 < n_rows {
                    down.push((at(row, column) - at(row + 1, column)).powi(2));
                }
            }
        }
        [along, down].map(|squares| match squares.is_empty() {
            true => 0.0,
            false => ((squares.iter().sum::<f64>() / squares.len() as f64 + 1.0) / (variance + 1.0)).ln(),
        })
    }

    proptest! {
        #[test]
        fn texture_is_its_definition(
            (rows, columns) in (1..12_u32, 1..40_u32),
            sort in prop::sample::select(&SORTS[..]),
            seed in any::<u64>(),
        ) {
            let sensor = layout(rows, columns);
            let frame = frames_of(sort, sensor, 1, seed);
            let found = Weave::new(sensor, &AnyMetric::Euclidean(Euclidean)).of(&frame);
            let expected = plain(&frame, columns as usize, sensor.has_rings());
            for (found, expected) in found.into_iter().zip(expected) {
                prop_assert!((found - expected).abs() < 1e-6, "{} and {}", found, expected);
            }
        }

        #[test]
        fn turned_rings_have_one_texture(
            n_rings in 1..4_usize, n_columns in 2..20_usize, turn in 0..20_usize, seed in any::<u64>(),
        ) {
            let sensor = layout(1, (n_rings * n_columns) as u32);
            let mut frame = frames_of(Sort::Random, sensor, 1, seed);
            let weave = Weave::new(sensor, &MetricPlan::Ring { n_rings }.compile(sensor).unwrap());
            let before = weave.of(&frame);
            frame.chunks_exact_mut(n_columns).for_each(|ring| ring.rotate_left(turn % n_columns));
            prop_assert_eq!(weave.of(&frame), before);
        }
    }

    #[test]
    fn a_texture_is_as_far_from_the_middle_as_ranks_say_and_farthest_beyond_all_on_either_side() {
        let textures = Textures::new([[0.0, 5.0], [1.0, 5.0], [2.0, 5.0], [100.0, 5.0]].concat().into());
        let along = [-5.1, -4.9, 0.0, 1.0, 1.5, 99.0, 100.0, 104.9, 105.1];
        let found = along.map(|along| textures.distance_from_middle([along, 5.0]));
        assert_eq!(found, [4.0, 3.0, 3.0, 1.0, 0.0, 2.0, 3.0, 3.0, 4.0]);
        assert_eq!([4.9, 5.1].map(|down| textures.distance_from_middle([1.5, down])), [4.0, 4.0]);
        assert_eq!((textures.of(3), textures.all().len()), ([100.0, 5.0], 8));
    }

    #[test]
    fn a_smooth_picture_has_little_texture_and_noise_as_much_as_variance_allows() {
        let sensor = layout(40, 60);
        let weave = Weave::new(sensor, &AnyMetric::Euclidean(Euclidean));
        let of = |sort| weave.of(&frames_of(sort, sensor, 1, 1));
        assert!(of(Sort::Smooth).iter().all(|texture| *texture < -4.0), "{:?}", of(Sort::Smooth));
        // Independent readings differ by twice their variance.
        assert!(of(Sort::Random).iter().all(|texture| (texture - 2.0_f64.ln()).abs() < 0.1));
        assert_eq!(of(Sort::Greatest), [0.0, 0.0]);
    }
}
