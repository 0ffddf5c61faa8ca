//! Form: what a frame looks like from afar, against what all trained frames look like.
//!
//! A frame is cut into a few tiles, and the logarithms of their means are one place in a space of as many dimensions, where trained
//! frames are taken for one Gaussian: of logarithms, since one wall near by would outweigh all else. A frame whose squared Mahalanobis
//! distance is large has near and far where the sensor, as it is mounted, never has them: ground above and sky below, or one reading
//! near where its neighbours are far. Nearest frames tell that only if it is much against how far they are in any case; here each
//! direction counts by how little frames vary along it.

use rayon::prelude::*;

use crate::frames::SensorLayout;
use crate::metric::AnyMetric;
use crate::mixture::Mixture;
use crate::simd::Instructions;

/// Most tiles down and across a picture. Of a sensor with fewer rows there are more across.
const N_TILES_DOWN_MAX: usize = 8;
const N_TILES_MAX: usize = 64;

/// Columns that are added side by side.
const N_STRIP: usize = 64;

/// Parts of the trained frames, in order of time, of which each is measured by what the others look like.
const N_PARTS: usize = 5;

/// What is added to each tile's variance, as a share of the mean one: a direction in which a trip happens not to vary is not known to
/// be fixed. A hundredth of that lets a few frames before a unique wall hide all else.
const FLOOR: f64 = 1e-2;

/// And at least, nats², so that tiles that never change span a volume too.
const FLOOR_MIN: f64 = 1e-6;

/// Where a frame is cut: into tiles of about one size.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Tiles {
    n_rows: usize,
    n_columns: usize,
    down: usize,
    across: usize,
}

/// What frames look like from afar.
#[derive(Clone, Debug)]
pub(crate) struct Form {
    /// Of one kind, in one dimension for each tile.
    gaussian: Mixture,
}

/// Of some frames: how many, the sum of what they have beyond a middle, and of its products, shape `(n_tiles, n_tiles)`, lower
/// triangle.
#[derive(Clone)]
struct Moments {
    n_frames: usize,
    sums: Vec<f64>,
    products: Vec<f64>,
}

impl Tiles {
    /// For a sensor whose frames are compared by a metric; none if it takes turned frames for the same, or readings for more and
    /// less.
    pub(crate) fn new(sensor: SensorLayout, metric: &AnyMetric) -> Option<Self> {
        let (n_rows, n_columns) = (sensor.rows as usize, sensor.columns as usize);
        let down = n_rows.min(N_TILES_DOWN_MAX);
        let across = n_columns.min(N_TILES_MAX / down);
        matches!(metric, AnyMetric::Euclidean(_)).then_some(Self { n_rows, n_columns, down, across })
    }

    pub(crate) fn n_tiles(&self) -> usize {
        self.down * self.across
    }

    /// Measures a frame.
    ///
    /// * `readings` — on the response's scale, shape `(n_rows, n_columns)`
    /// * `means` — `ln (mean + 1)` of each tile in counts, shape `(n_tiles,)`; overwritten
    ///
    /// Allocates nothing. Sums are exact, so that it has the same bits on every machine.
    pub(crate) fn measure(&self, readings: &[u16], means: &mut [f64]) {
        Instructions::widest().run(
            #[inline(always)]
            || self.average(readings, means),
        );
        means.iter_mut().for_each(|mean| *mean = libm::log1p(*mean));
    }

    #[inline(always)]
    fn average(&self, readings: &[u16], means: &mut [f64]) {
        let Self { n_rows, n_columns, down, across } = *self;
        for (tile, means) in means.chunks_exact_mut(across).enumerate() {
            let (top, bottom) = (tile * n_rows / down, (tile + 1) * n_rows / down);
            let rows = &readings[top * n_columns..bottom * n_columns];
            let mut sums = [0_u64; N_TILES_MAX];
            let mut tile = 0;
            // Columns by themselves first: many readings that stand side by side are added at once.
            for begin in (0..n_columns).step_by(N_STRIP) {
                let n_in_strip = N_STRIP.min(n_columns - begin);
                let mut of_columns = [0_u64; N_STRIP];
                // Of 65536 rows at most: below 2³².
                for rows in rows.chunks(n_columns << 16) {
                    let mut partial = [0_u32; N_STRIP];
                    for row in rows.chunks_exact(n_columns) {
                        let strip = &row[begin..begin + n_in_strip];
                        partial.iter_mut().zip(strip).for_each(|(sum, &reading)| *sum += u32::from(reading));
                    }
                    of_columns.iter_mut().zip(partial).for_each(|(sum, partial)| *sum += u64::from(partial));
                }
                for (column, sum) in (begin..).zip(&of_columns[..n_in_strip]) {
                    while column >= (tile + 1) * n_columns / across {
                        tile += 1;
                    }
                    sums[tile] += sum;
                }
            }
            for (tile, (mean, sum)) in means.iter_mut().zip(sums).enumerate() {
                let width = (tile + 1) * n_columns / across - tile * n_columns / across;
                *mean = sum as f64 / ((bottom - top) * width) as f64;
            }
        }
    }
}

impl Form {
    /// What some frames look like, and what each of some of them measures by what frames at other times look like.
    ///
    /// * `means` — of the tiles of frames in order of time, shape `(n_frames, n_tiles)`, nats
    /// * `chosen` — which of them are measured
    ///
    /// The same on any number of threads.
    pub(crate) fn learn(means: &[f32], n_tiles: usize, chosen: &[u32]) -> (Self, Vec<f64>) {
        let n_frames = means.len() / n_tiles;
        let middle = middle_of(means, n_tiles);
        let n_parts = N_PARTS.min(n_frames);
        let part_of = |frame: usize| frame * n_parts / n_frames;
        let begin_of = |part: usize| (part * n_frames).div_ceil(n_parts);
        let parts: Vec<Moments> = (0..n_parts)
            .into_par_iter()
            .map(|part| Moments::of(&means[begin_of(part) * n_tiles..begin_of(part + 1) * n_tiles], &middle))
            .collect();
        let all_but = |left_out: Option<usize>| {
            let mut all = Moments::none(n_tiles);
            let others = parts.iter().enumerate().filter(|(part, _)| left_out != Some(*part));
            others.for_each(|(_, part)| all.add(part));
            Self { gaussian: all.gaussian(&middle) }
        };
        // One frame is measured by itself.
        let without: Vec<Self> =
            (0..n_parts).into_par_iter().map(|part| all_but((n_parts > 1).then_some(part))).collect();
        let measure = |&frame: &u32| {
            let means = &means[frame as usize * n_tiles..][..n_tiles];
            let means: Vec<f64> = means.iter().map(|&mean| f64::from(mean)).collect();
            without[part_of(frame as usize)].distance(&means)
        };
        (all_but(None), chosen.par_iter().map(measure).collect())
    }

    /// * `means` — shape `(n_tiles,)`
    /// * `covariance` — shape `(n_tiles, n_tiles)`
    ///
    /// None if these are no Gaussian.
    pub(crate) fn from_parts(means: &[f64], covariance: &[f64]) -> Option<Self> {
        let gaussian = Mixture::new(means.len(), vec![1.0], means.to_vec(), covariance.to_vec());
        gaussian.ok().map(|gaussian| Self { gaussian })
    }

    pub(crate) fn means(&self) -> &[f64] {
        self.gaussian.means()
    }

    pub(crate) fn covariance(&self) -> &[f64] {
        self.gaussian.covariances()
    }

    /// Squared Mahalanobis distance of a frame.
    ///
    /// * `means` — of its tiles, shape `(n_tiles,)`, nats
    ///
    /// Allocates nothing. O(n_tiles²).
    pub(crate) fn distance(&self, means: &[f64]) -> f64 {
        self.gaussian.squared_mahalanobis(0, means)
    }
}

/// Of each tile, shape `(n_tiles,)`.
fn middle_of(means: &[f32], n_tiles: usize) -> Vec<f64> {
    let mut middle = vec![0.0; n_tiles];
    for frame in means.chunks_exact(n_tiles) {
        middle.iter_mut().zip(frame).for_each(|(sum, &mean)| *sum += f64::from(mean));
    }
    let n_frames = (means.len() / n_tiles) as f64;
    middle.iter_mut().for_each(|sum| *sum /= n_frames);
    middle
}

impl Moments {
    fn none(n_tiles: usize) -> Self {
        Self { n_frames: 0, sums: vec![0.0; n_tiles], products: vec![0.0; n_tiles * n_tiles] }
    }

    fn of(means: &[f32], middle: &[f64]) -> Self {
        let n_tiles = middle.len();
        let mut moments = Self::none(n_tiles);
        let mut beyond = vec![0.0; n_tiles];
        for frame in means.chunks_exact(n_tiles) {
            for ((beyond, &mean), middle) in beyond.iter_mut().zip(frame).zip(middle) {
                *beyond = f64::from(mean) - middle;
            }
            moments.sums.iter_mut().zip(&beyond).for_each(|(sum, beyond)| *sum += beyond);
            for (row, products) in moments.products.chunks_exact_mut(n_tiles).enumerate() {
                let factor = beyond[row];
                products[..=row].iter_mut().zip(&beyond).for_each(|(sum, other)| *sum += factor * other);
            }
            moments.n_frames += 1;
        }
        moments
    }

    fn add(&mut self, others: &Self) {
        self.n_frames += others.n_frames;
        self.sums.iter_mut().zip(&others.sums).for_each(|(sum, other)| *sum += other);
        self.products.iter_mut().zip(&others.products).for_each(|(sum, other)| *sum += other);
    }

    fn gaussian(mut self, middle: &[f64]) -> Mixture {
        let (n_tiles, n_frames) = (self.sums.len(), self.n_frames as f64);
        self.sums.iter_mut().for_each(|sum| *sum /= n_frames);
        let mean = &self.sums;
        for row in 0..n_tiles {
            for column in 0..=row {
                let covariance = self.products[row * n_tiles + column] / n_frames - mean[row] * mean[column];
                self.products[row * n_tiles + column] = covariance;
                self.products[column * n_tiles + row] = covariance;
            }
        }
        let variance = (0..n_tiles).map(|tile| self.products[tile * (n_tiles + 1)].max(0.0)).sum::<f64>();
        let floor = FLOOR * variance / n_tiles as f64 + FLOOR_MIN;
        for tile in 0..n_tiles {
            self.products[tile * (n_tiles + 1)] += floor;
        }
        let means = mean.iter().zip(middle).map(|(beyond, middle)| beyond + middle).collect();
        Mixture::new(n_tiles, vec![1.0], means, self.products)
            .expect("products of finite numbers and more on the diagonal than rounding takes from it")
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;
    use crate::metric::{Euclidean, MetricPlan};
    use crate::testing::{SORTS, frames_of, layout};

    fn tiles(rows: u32, columns: u32) -> Tiles {
        Tiles::new(layout(rows, columns), &AnyMetric::Euclidean(Euclidean)).unwrap()
    }

    proptest! {
        #[test]
        fn every_reading_is_in_one_tile_and_counts_alike_there(
            (rows, columns) in (1..30_u32, 1..100_u32),
            sort in prop::sample::select(&SORTS[..]),
            seed in any::<u64>(),
        ) {
            let (sensor, tiles) = (layout(rows, columns), tiles(rows, columns));
            let frame = frames_of(sort, sensor, 1, seed);
            let mut means = vec![f64::NAN; tiles.n_tiles()];
            tiles.measure(&frame, &mut means);
            // A reading's tile is the last that begins at it or before.
            let place = |index: usize, n: usize, n_tiles: usize| {
                (0..n_tiles).rev().find(|tile| tile * n / n_tiles <= index).unwrap()
            };
            let mut of_tiles = vec![Vec::new(); tiles.n_tiles()];
            for (index, &reading) in frame.iter().enumerate() {
                let (row, column) = (index / columns as usize, index % columns as usize);
                let (down, across) = (place(row, rows as usize, tiles.down), place(column, columns as usize, tiles.across));
                of_tiles[down * tiles.across + across].push(f64::from(reading));
            }
            for (mean, inside) in means.iter().zip(of_tiles) {
                prop_assert_eq!(*mean, libm::log1p(inside.iter().sum::<f64>() / inside.len() as f64));
            }
        }

        #[test]
        fn frames_are_measured_by_the_covariance_of_those_at_other_times(
            (n_tiles, frames) in (1..6_usize, 1..30_usize).prop_flat_map(|(n_tiles, n_frames)| {
                (Just(n_tiles), prop::collection::vec(0.0..11.0_f32, n_tiles * n_frames))
            }),
        ) {
            let n_frames = frames.len() / n_tiles;
            let chosen: Vec<u32> = (0..n_frames as u32).collect();
            let (_, measured) = Form::learn(&frames, n_tiles, &chosen);
            // By the definition, frame for frame.
            let n_parts = N_PARTS.min(n_frames);
            for (frame, measured) in measured.into_iter().enumerate() {
                let is_other = |other: &usize| n_parts == 1 || other * n_parts / n_frames != frame * n_parts / n_frames;
                let others: Vec<usize> = (0..n_frames).filter(is_other).collect();
                let at = |frame: usize| nalgebra::DVector::from_fn(n_tiles, |tile, _| f64::from(frames[frame * n_tiles + tile]));
                let n = others.len() as f64;
                let mean = others.iter().map(|&other| at(other)).sum::<nalgebra::DVector<f64>>() / n;
                let mut covariance = nalgebra::DMatrix::zeros(n_tiles, n_tiles);
                for &other in &others {
                    let beyond = at(other) - &mean;
                    covariance += &beyond * beyond.transpose() / n;
                }
                let floor = FLOOR * covariance.trace() / n_tiles as f64 + FLOOR_MIN;
                covariance += nalgebra::DMatrix::identity(n_tiles, n_tiles) * floor;
                let beyond = at(frame) - mean;
                let expected = beyond.dot(&covariance.lu().solve(&beyond).unwrap());
                prop_assert!((measured - expected).abs() <= 1e-5 * expected + 1e-5, "{} and {}", measured, expected);
            }
        }
    }

    #[test]
    fn cameras_have_eight_tiles_either_way_and_rings_one_for_each_of_few_readings() {
        let of = |rows, columns| (tiles(rows, columns).down, tiles(rows, columns).across);
        assert_eq!(
            [of(124, 160), of(1, 16), of(1, 1080), of(2, 500), of(5, 3)],
            [(8, 8), (1, 16), (1, 64), (2, 32), (5, 3)]
        );
        let sensor = layout(1, 16);
        let ring = MetricPlan::Ring { n_rings: 1 }.compile(sensor).unwrap();
        assert!(Tiles::new(sensor, &ring).is_none());
    }

    #[test]
    fn frames_that_are_all_alike_have_a_form_and_others_are_far_from_it() {
        let (form, measured) = Form::learn(&[7.0; 20], 4, &[0, 4]);
        assert_eq!((measured, form.distance(&[7.0; 4])), (vec![0.0; 2], 0.0));
        assert!((form.distance(&[7.0, 7.0, 7.5, 7.0]) - 0.25 / FLOOR_MIN).abs() < 1.0);
    }
}
