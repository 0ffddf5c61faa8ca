//! Blocks: what a few numbers say of how far apart two frames are at least, before their readings are looked at.
//!
//! A frame is cut into blocks of neighbouring readings. For a block of m readings, of sums S and deviations σ,
//!
//! ```text
//! Σ (q_i − x_i)² = m (mean_q − mean_x)² + Σ ((q_i − mean_q) − (x_i − mean_x))² ≥ (S_q − S_x)² / m + m (σ_q − σ_x)²
//! ```
//!
//! since the deviations of the one, as a vector, are at least as far from those of the other as their lengths differ. So with
//! two *features* of each block, S / √m and √m σ, the squared distance of two frames' features is a lower bound of that of
//! their readings. Features of the frames that are searched are kept in 16 bits, in units of √m counts, since what bounds
//! take is the time to fetch them. Frames are nearest where places are alike, and then blocks are: on camera frames, some hundred numbers
//! tell all but a handful of thousands of frames from the nearest (method of Seidl & Kriegel 1998, *Optimal multi-step
//! k-nearest neighbor search*: bounds first, distances in their order, until a bound is beyond the k-th).
//!
//! There are several levels of blocks: *coarse*, a few features that are compared with those of all frames, and finer ones,
//! each for frames that those before it did not rule out. Few readings are coarse blocks of one each, and their features the
//! readings.

use crate::frames::SensorLayout;
use crate::metric::N_SIDE_BY_SIDE;
use crate::simd::Instructions;
use crate::squares;

/// Frames whose coarse features stand side by side, and numbers that are added side by side.
const LANES: usize = 16;

/// Bounds of frames that stand side by side, counts² by [`Level::limit`].
pub(crate) type Bounds = [f32; LANES];

/// Most coarse blocks.
const N_COARSE_MAX: usize = 32;
/// Parts of a block at the next level.
const N_PARTS: usize = 4;
/// Fewest readings of a block that is part of another. Of fewer, features would be nearly as many bytes as the readings.
const N_PART_READINGS_MIN: usize = 16;
/// Width of the finest blocks of pictures.
const WIDTH_OF_PICTURES: usize = 4;
/// Most readings of a block: the square of its sum, and its number times its sum of squares, are below 2⁶⁴.
const N_BLOCK_READINGS_MAX: usize = 1 << 16;
const _: () = assert!((N_BLOCK_READINGS_MAX as u128 * u16::MAX as u128).pow(2) < 1 << 64);

/// Blocks of one size, that cover a sensor's readings. The last of a row or column may be smaller.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
struct Grid {
    rows: usize,
    columns: usize,
    /// Rows of readings in a block.
    height: usize,
    /// Readings in a row of a block.
    width: usize,
}

/// What features are made of: the sum of a block's readings, and the sum of their squares, shape `(n_blocks,)` each.
#[derive(Clone, Debug)]
struct Moments {
    sums: Vec<u64>,
    squares: Vec<u64>,
}

/// Features of many frames, by which to look for the nearest of them.
#[derive(Clone, Debug)]
pub(crate) struct Blocks {
    /// The coarse blocks, and ever finer ones.
    grids: Vec<Grid>,
    n_frames: usize,
    /// By coarse blocks, shape `(n_chunks, n_features, LANES)`, units.
    coarse: Vec<[u16; LANES]>,
    /// By each of the finer, shape `(n_frames, n_features)`, units.
    finer: Vec<Vec<u16>>,
}

/// Features of one frame, and the memory that computing them takes.
pub(crate) struct Sketch {
    /// Features by the coarse blocks, units, as they are compared with.
    coarse: Vec<f32>,
    /// By the coarse blocks, and by ever finer ones.
    levels: Vec<Drawn>,
    /// Sums of the columns of a row of blocks, and of their squares.
    columns: (Vec<u32>, Vec<u64>),
}

/// Features of one frame by blocks of one size.
struct Drawn {
    grid: Grid,
    /// Readings of each block, m, shape `(n_blocks,)`.
    n_readings: Vec<u64>,
    /// `1 / √(m M)`, with M those of a whole block, shape `(n_blocks,)`.
    scales: Vec<f64>,
    moments: Moments,
    /// Of all blocks first the sums, then the deviations, if there are any; units.
    features: Vec<u16>,
}

/// A frame, and what is known of how far it is at least.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Bounded {
    /// By blocks of some level: see [`Blocks::limit`].
    pub(crate) bound: f32,
    pub(crate) frame_index: u32,
}

impl Grid {
    /// Blocks of one reading each, made larger until they are few: about as high as wide where rows are a picture's, and of
    /// one row where they are rings.
    fn coarse(sensor: SensorLayout) -> Self {
        let (rows, columns) = (sensor.rows as usize, sensor.columns as usize);
        let mut grid = Self { rows, columns, height: 1, width: 1 };
        while grid.n_blocks() > N_COARSE_MAX && grid.n_readings_in_block() < N_BLOCK_READINGS_MAX {
            let is_narrow = sensor.has_rings() || grid.width <= grid.height || grid.height >= rows;
            match is_narrow && grid.width < columns {
                true => grid.width *= 2,
                false => grid.height *= 2,
            }
        }
        grid
    }

    /// Blocks of a quarter of the readings, where these are enough.
    fn parts(self) -> Option<Self> {
        let (height, width) = match self.height {
            1 => (1, self.width / N_PARTS),
            height => (height / 2, self.width / 2),
        };
        (height * width >= N_PART_READINGS_MIN).then_some(Self { height, width, ..self })
    }

    fn n_readings_in_block(self) -> usize {
        self.height * self.width
    }

    fn blocks_in_row(self) -> usize {
        self.columns.div_ceil(self.width)
    }

    fn n_blocks(self) -> usize {
        self.rows.div_ceil(self.height) * self.blocks_in_row()
    }

    /// A block of one reading has no deviation.
    fn n_features(self) -> usize {
        self.n_blocks() * if self.n_readings_in_block() > 1 { 2 } else { 1 }
    }

    /// Readings of each block.
    fn n_readings(self) -> Vec<u64> {
        let sizes = |n: usize, size: usize| (0..n).step_by(size).map(move |begin| size.min(n - begin) as u64);
        sizes(self.rows, self.height)
            .flat_map(|height| sizes(self.columns, self.width).map(move |width| height * width))
            .collect()
    }

    /// * `readings` — shape `(rows, columns)`
    /// * `columns` — shape `(columns,)` each; overwritten
    /// * `moments` — overwritten
    #[inline(always)]
    fn measure(self, readings: &[u16], columns: &mut (Vec<u32>, Vec<u64>), moments: &mut Moments) {
        let (sums, squares) = (&mut columns.0[..self.columns], &mut columns.1[..self.columns]);
        let of_rows = moments.sums.chunks_exact_mut(self.blocks_in_row());
        let of_rows = of_rows.zip(moments.squares.chunks_exact_mut(self.blocks_in_row()));
        for (rows, (of_sums, of_squares)) in readings.chunks(self.height * self.columns).zip(of_rows) {
            sums.fill(0);
            squares.fill(0);
            for row in rows.chunks_exact(self.columns) {
                for column in 0..self.columns {
                    let reading = u32::from(row[column]);
                    // A block has at most 2¹⁶ rows, and 65535² is below 2³².
                    sums[column] += reading;
                    squares[column] += u64::from(reading * reading);
                }
            }
            fold(sums, self.width, of_sums);
            fold(squares, self.width, of_squares);
        }
    }

    /// Moments of these blocks from those of their parts.
    fn gather(self, parts: Self, of_parts: &Moments, moments: &mut Moments) {
        let (down, across) = (self.height / parts.height, self.width / parts.width);
        let both = [(&of_parts.sums, &mut moments.sums), (&of_parts.squares, &mut moments.squares)];
        for (of_parts, of_blocks) in both {
            of_blocks.fill(0);
            for (row, of_row) in of_parts.chunks_exact(parts.blocks_in_row()).enumerate() {
                let of_blocks = &mut of_blocks[row / down * self.blocks_in_row()..][..self.blocks_in_row()];
                for (parts, block) in of_row.chunks(across).zip(of_blocks) {
                    *block += parts.iter().sum::<u64>();
                }
            }
        }
    }

    /// A frame is farther than a squared distance, counts², if its bound by these blocks is greater than this. Rises with it.
    ///
    /// Features are in units of √M counts, M being the readings of a whole block, so that they are at most 65535 as the
    /// readings are, and rounded to whole units, off by at most 1/2 each. (The rounding of `f64` before is nothing beside it.)
    /// With f for exact features, f̃ for rounded ones and n for their number, by the triangle inequality,
    ///
    /// ```text
    /// distance / √M ≥ ‖f(q) − f(x)‖ ≥ ‖f̃(q) − f̃(x)‖ − 1.001 √n
    /// ```
    ///
    /// The square of the last norm is exact at the finer levels until it is rounded to `f32`, and computed in `f32` at the coarse
    /// one, of n differences, squares and sums of nothing below zero. In whatever order these are added, no term is rounded more than n + 2 times,
    /// each time by at most u = 2⁻²⁴ of itself: the bound is at most `(1 + u)^(n+2)` times that square.
    fn limit(self, squared_distance: u64) -> f32 {
        let n_features = self.n_features() as f64;
        let length =
            (squared_distance as f64 / self.n_readings_in_block() as f64).sqrt() + 1.001 * n_features.sqrt();
        let factor = 1.0 + f64::from(f32::EPSILON) * (n_features + 2.0);
        // The next number up, for all that is rounded here.
        ((length * length * factor) as f32).next_up()
    }
}

/// Adds what is in the columns of each block. The last may be narrower.
#[inline(always)]
fn fold<T: Copy + Into<u64>>(columns: &[T], width: usize, blocks: &mut [u64]) {
    #[inline(always)]
    fn sum<T: Copy + Into<u64>>(columns: &[T]) -> u64 {
        columns.iter().map(|&column| column.into()).sum()
    }
    // Of a width that is known here, several blocks are added at once.
    let (whole, rest) = columns.as_chunks::<WIDTH_OF_PICTURES>();
    if width == WIDTH_OF_PICTURES {
        blocks.iter_mut().zip(whole).for_each(|(block, columns)| *block = sum(columns));
        blocks.iter_mut().skip(whole.len()).for_each(|block| *block = sum(rest));
    } else {
        blocks.iter_mut().zip(columns.chunks(width)).for_each(|(block, columns)| *block = sum(columns));
    }
}

impl Drawn {
    fn new(grid: Grid) -> Self {
        let whole = grid.n_readings_in_block() as u64;
        let n_readings = grid.n_readings();
        let zeros = vec![0; grid.n_blocks()];
        Self {
            grid,
            scales: n_readings.iter().map(|n| 1.0 / ((n * whole) as f64).sqrt()).collect(),
            n_readings,
            moments: Moments { sums: zeros.clone(), squares: zeros },
            features: vec![0; grid.n_features()],
        }
    }

    /// Features from moments.
    #[inline(always)]
    fn write(&mut self) {
        let Self { n_readings, scales, moments: Moments { sums, squares }, features, .. } = self;
        let (of_sums, of_deviations) = features.split_at_mut(sums.len());
        for ((&sum, scale), feature) in sums.iter().zip(&*scales).zip(of_sums) {
            *feature = rounded(sum as f64 * scale);
        }
        let moments = sums.iter().zip(squares).zip(n_readings);
        for (((&sum, &mut squares), &mut n), (scale, feature)) in
            moments.zip(scales.iter().zip(of_deviations))
        {
            // m² σ², exact: see [`N_BLOCK_READINGS_MAX`].
            let variance = n * squares - sum * sum;
            *feature = rounded((variance as f64).sqrt() * scale);
        }
    }
}

/// Of 0 … 65535, the nearest whole number: added to 2⁵², whose last digit counts ones, it stands in the last digits. (What the
/// standard library does about other numbers would be more work than all the rest.)
#[inline(always)]
fn rounded(feature: f64) -> u16 {
    (feature + (1_u64 << 52) as f64).to_bits() as u16
}

impl Sketch {
    fn new(grids: &[Grid]) -> Self {
        let n_columns = grids[0].columns;
        let levels = grids.iter().map(|&grid| Drawn::new(grid)).collect();
        Self {
            coarse: vec![0.0; grids[0].n_features()],
            levels,
            columns: (vec![0; n_columns], vec![0; n_columns]),
        }
    }

    /// Computes a frame's features.
    ///
    /// * `readings` — shape `(n_readings,)`
    pub(crate) fn draw(&mut self, readings: &[u16]) {
        let Self { coarse, levels, columns } = self;
        Instructions::widest().run(
            #[inline(always)]
            || {
                let mut parts: Option<&Drawn> = None;
                for level in levels.iter_mut().rev() {
                    match parts {
                        Some(parts) => level.grid.gather(parts.grid, &parts.moments, &mut level.moments),
                        None => level.grid.measure(readings, columns, &mut level.moments),
                    }
                    level.write();
                    parts = Some(level);
                }
                coarse.iter_mut().zip(&levels[0].features).for_each(|(to, &feature)| *to = feature.into());
            },
        );
    }
}

impl Blocks {
    /// Features of all frames. Reads each once: some 10 µs for one of 19840 readings.
    ///
    /// * `readings` — of a frame, shape `(n_readings,)`
    pub(crate) fn new<'a>(
        sensor: SensorLayout,
        n_frames: usize,
        readings: impl Fn(usize) -> &'a [u16],
    ) -> Self {
        let mut blocks = Self::none(sensor, n_frames);
        let mut sketch = blocks.sketch();
        (0..n_frames).for_each(|frame_index| blocks.push(&mut sketch, readings(frame_index)));
        blocks
    }

    /// Features of no frames yet.
    ///
    /// * `n_frames_max` — frames that memory is reserved for
    pub(crate) fn none(sensor: SensorLayout, n_frames_max: usize) -> Self {
        let grids: Vec<Grid> =
            std::iter::successors(Some(Grid::coarse(sensor)), |grid| grid.parts()).collect();
        let coarse = Vec::with_capacity(n_frames_max.div_ceil(LANES) * grids[0].n_features());
        let finer = |grid: &Grid| Vec::with_capacity(n_frames_max * grid.n_features());
        let finer = grids[1..].iter().map(finer).collect();
        Self { grids, n_frames: 0, coarse, finer }
    }

    /// Adds the features of one more frame.
    ///
    /// * `readings` — shape `(n_readings,)`
    pub(crate) fn push(&mut self, sketch: &mut Sketch, readings: &[u16]) {
        sketch.draw(readings);
        let (n_coarse, lane) = (self.grids[0].n_features(), self.n_frames % LANES);
        if lane == 0 {
            self.coarse.resize(self.coarse.len() + n_coarse, [0; LANES]);
        }
        let last_chunk = self.coarse.len() - n_coarse;
        for (lanes, feature) in self.coarse[last_chunk..].iter_mut().zip(&sketch.levels[0].features) {
            lanes[lane] = *feature;
        }
        for (finer, level) in self.finer.iter_mut().zip(&sketch.levels[1..]) {
            finer.extend_from_slice(&level.features);
        }
        self.n_frames += 1;
    }

    /// Forgets all frames.
    pub(crate) fn clear(&mut self) {
        self.n_frames = 0;
        self.coarse.clear();
        self.finer.iter_mut().for_each(Vec::clear);
    }

    /// Memory for features of a frame to compare with these.
    pub(crate) fn sketch(&self) -> Sketch {
        Sketch::new(&self.grids)
    }

    /// Length of the array that [`Self::coarse_bounds`] fills.
    pub(crate) fn n_chunks(&self) -> usize {
        self.n_frames.div_ceil(LANES)
    }

    /// At least 1: the coarse one is level 0.
    pub(crate) fn n_levels(&self) -> usize {
        self.grids.len()
    }

    /// A frame whose bound at a level is greater is farther than this squared distance, counts².
    pub(crate) fn limit(&self, level: usize, squared_distance: u64) -> f32 {
        self.grids[level].limit(squared_distance)
    }

    /// Bounds by coarse blocks, of every frame in order.
    ///
    /// * `bounds` — shape `(n_chunks, LANES)`; overwritten, beyond the last frame by infinity
    pub(crate) fn coarse_bounds(&self, sketch: &Sketch, bounds: &mut [Bounds]) {
        assert_eq!(bounds.len(), self.n_chunks(), "bounds for each frame");
        let query = &sketch.coarse[..];
        Instructions::widest().run(
            #[inline(always)]
            || {
                for (features, bounds) in self.coarse.chunks_exact(query.len()).zip(bounds.iter_mut()) {
                    *bounds = between_one_and_chunk(query, features);
                }
            },
        );
        if let Some(last) = bounds.last_mut() {
            last[(self.n_frames - 1) % LANES + 1..].fill(f32::INFINITY);
        }
    }

    /// Whether bounds prove a frame farther than a squared distance, counts².
    ///
    /// * `coarse` — its bound by coarse blocks
    pub(crate) fn is_beyond(&self, sketch: &Sketch, coarse: Bounded, squared_distance: u64) -> bool {
        let mut frame = [coarse];
        (0..self.n_levels()).any(|level| {
            self.refine(level, sketch, &mut frame);
            frame[0].bound > self.limit(level, squared_distance)
        })
    }

    /// Bounds at a level beyond the coarse one, of some frames. At the coarse level, leaves those that they have.
    pub(crate) fn refine(&self, level: usize, sketch: &Sketch, frames: &mut [Bounded]) {
        if level == 0 {
            return;
        }
        let (query, finer) = (&sketch.levels[level].features[..], &self.finer[level - 1][..]);
        let features = |frame: &Bounded| &finer[frame.frame_index as usize * query.len()..][..query.len()];
        let (some, rest) = frames.as_chunks_mut::<N_SIDE_BY_SIDE>();
        for some in some {
            let sums = squares::sums(query, some.each_ref().map(features));
            some.iter_mut().zip(sums).for_each(|(frame, sum)| frame.bound = sum as f32);
        }
        for frame in rest {
            let [sum] = squares::sums(query, [features(frame)]);
            frame.bound = sum as f32;
        }
    }
}

/// Squared differences of the features of one frame and of [`LANES`] others.
#[inline(always)]
fn between_one_and_chunk(query: &[f32], features: &[[u16; LANES]]) -> Bounds {
    let mut sums = [0.0; LANES];
    for (lanes, query) in features.iter().zip(query) {
        for lane in 0..LANES {
            let difference = f32::from(lanes[lane]) - query;
            sums[lane] += difference * difference;
        }
    }
    sums
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;
    use crate::testing::{SORTS, frames_of, layout};

    /// The coarse blocks of a sensor and all finer ones: height and width.
    fn sides(rows: u32, columns: u32) -> Vec<(usize, usize)> {
        let grids = std::iter::successors(Some(Grid::coarse(layout(rows, columns))), |grid| grid.parts());
        grids.map(|grid| (grid.height, grid.width)).collect()
    }

    #[test]
    fn blocks_are_about_square_in_pictures_and_pieces_of_rings_and_few_readings_stay_by_themselves() {
        assert_eq!(sides(124, 160), [(32, 32), (16, 16), (8, 8), (4, 4)]);
        assert_eq!(sides(480, 640), [(128, 128), (64, 64), (32, 32), (16, 16), (8, 8), (4, 4)]);
        assert_eq!(sides(1, 16), [(1, 1)]);
        assert_eq!(sides(2, 16), [(1, 1)]);
        assert_eq!(sides(1, 1080), [(1, 64), (1, 16)]);
        assert_eq!(sides(4, 1 << 12), [(1, 512), (1, 128), (1, 32)]);
        assert_eq!(sides(5, 1 << 12), [(8, 128), (4, 64), (2, 32), (1, 16)]);
        assert_eq!(sides(7, 9), [(2, 2)]);
    }

    #[test]
    fn readings_beyond_what_64_bits_can_square_are_cut_into_more_blocks() {
        let grid = Grid::coarse(layout(1, 1 << 24));
        assert_eq!((grid.n_readings_in_block(), grid.n_blocks()), (N_BLOCK_READINGS_MAX, 256));
        let white = vec![u16::MAX; grid.columns];
        let mut sketch = Sketch::new(&[grid]);
        sketch.draw(&white);
        let (sums, deviations) = sketch.levels[0].features.split_at(grid.n_blocks());
        assert!(sums.iter().all(|sum| *sum == 65535) && deviations.iter().all(|deviation| *deviation == 0));
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(30))]

        #[test]
        fn no_bound_is_beyond_the_limit_of_the_distance_itself(
            (rows, columns) in prop_oneof![(1..20_u32, 1..40_u32), Just((124, 160)), Just((1, 20_000))],
            sorts in [prop::sample::select(&SORTS[..]), prop::sample::select(&SORTS[..])],
            seed in any::<u64>(),
        ) {
            const N_FRAMES: usize = 19;
            let sensor = layout(rows, columns);
            let frames = frames_of(sorts[0], sensor, N_FRAMES, seed);
            let row = |index: usize| &frames[index * sensor.n_readings()..][..sensor.n_readings()];
            let blocks = Blocks::new(sensor, N_FRAMES, row);
            let query = frames_of(sorts[1], sensor, 1, seed ^ 1);
            let mut sketch = blocks.sketch();
            let mut coarse = vec![Bounds::default(); blocks.n_chunks()];
            // A frame of the set itself is not beyond any limit either.
            for query in [&query, row(7)] {
                sketch.draw(query);
                blocks.coarse_bounds(&sketch, &mut coarse);
                prop_assert!(coarse.as_flattened()[N_FRAMES..].iter().all(|bound| *bound == f32::INFINITY));
                let bounds = coarse.as_flattened()[..N_FRAMES].iter();
                let mut bounded: Vec<Bounded> =
                    (0..).zip(bounds).map(|(frame_index, &bound)| Bounded { bound, frame_index }).collect();
                for level in 0..blocks.n_levels() {
                    blocks.refine(level, &sketch, &mut bounded);
                    for (index, bounded) in bounded.iter().enumerate() {
                        let limit = blocks.limit(level, squares::plain(query, row(index)));
                        prop_assert!(bounded.bound <= limit, "level {}: {} > {}", level, bounded.bound, limit);
                    }
                }
            }
        }

        #[test]
        fn features_of_any_level_are_those_of_its_blocks_by_their_definition(
            (rows, columns) in prop_oneof![(1..20_u32, 1..40_u32), Just((124, 160))],
            sort in prop::sample::select(&SORTS[..]),
            seed in any::<u64>(),
        ) {
            let sensor = layout(rows, columns);
            let readings = frames_of(sort, sensor, 1, seed);
            let blocks = Blocks::new(sensor, 1, |_| &readings);
            let mut sketch = blocks.sketch();
            sketch.draw(&readings);
            for Drawn { grid, n_readings, features, .. } in &sketch.levels {
                prop_assert_eq!(n_readings.iter().sum::<u64>(), readings.len() as u64);
                for block in 0..grid.n_blocks() {
                    let (down, across) = (block / grid.blocks_in_row(), block % grid.blocks_in_row());
                    let is_inside = |index: &usize| {
                        (index / grid.columns / grid.height, index % grid.columns / grid.width) == (down, across)
                    };
                    let inside: Vec<f64> =
                        (0..readings.len()).filter(is_inside).map(|index| f64::from(readings[index])).collect();
                    let m = inside.len() as f64;
                    let mean = inside.iter().sum::<f64>() / m;
                    let variance = inside.iter().map(|reading| (reading - mean).powi(2)).sum::<f64>() / m;
                    let share = (m / grid.n_readings_in_block() as f64).sqrt();
                    let close = |found: u16, expected: f64| (f64::from(found) - expected).abs() <= 0.5001;
                    prop_assert!(close(features[block], mean * share));
                    if features.len() > n_readings.len() {
                        prop_assert!(close(features[n_readings.len() + block], variance.sqrt() * share));
                    }
                }
            }
        }
    }
}
