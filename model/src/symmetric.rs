//! A large symmetric matrix, and its product with a few vectors.
//!
//! Plainly: `y_i = Σ_j A_ij x_j`. A large matrix is not in any cache, so that a product takes as long as it takes to read it.
//! Departures from the plain way:
//!
//! 1. **Each pair of entries is stored and read once**: as A_ij for y_i, and as A_ji for y_j.
//! 2. **By tiles**, which stay in a core's cache with the parts of the vectors that they are multiplied with.
//! 3. **Several vectors at once**, whose entries stand side by side: the more there are, the more is made of what was read.
//! 4. **Parts of about equal work side by side**, each with sums of its own. There are always as many parts and they are added
//!    in their order, so that what comes out does not depend on the number of threads.

use faer::{Mat, MatRef};
use rayon::prelude::*;

use crate::simd::Instructions;

/// Vectors that are multiplied at once.
pub(crate) const N_VECTORS: usize = 16;

/// Rows and columns of a tile: 32 kB, the larger part of a core's first cache.
const N_TILE: usize = 64;

/// Rows of a tile that are multiplied at once: their sums stay in registers.
const N_ROWS: usize = 4;

const N_PARTS: usize = 8;

/// Entries of one row of the vectors.
type Lanes = [f64; N_VECTORS];

/// Rows of the vectors that a tile is multiplied with.
type Rows = [Lanes; N_TILE];

/// Rows of a tile.
type Tile = [[f64; N_TILE]; N_TILE];

const NOTHING: Rows = [[0.0; N_VECTORS]; N_TILE];

/// The lower triangle of tiles, row after row; zeros beyond the matrix' end.
pub(crate) struct Symmetric {
    n: usize,
    tiles: Vec<Tile>,
}

impl Symmetric {
    /// * `entry` — the same for a row and a column as for that column and row
    pub(crate) fn from_fn(n: usize, entry: impl Fn(usize, usize) -> f64 + Sync) -> Self {
        let fill = |(row, column): (usize, usize)| {
            let mut tile = [[0.0; N_TILE]; N_TILE];
            for (i, along) in (row * N_TILE..n).zip(&mut tile) {
                for (j, place) in (column * N_TILE..n).zip(along) {
                    *place = entry(i, j);
                }
            }
            tile
        };
        let places: Vec<(usize, usize)> =
            (0..n.div_ceil(N_TILE)).flat_map(|row| (0..=row).map(move |column| (row, column))).collect();
        Self { n, tiles: places.into_par_iter().map(fill).collect() }
    }

    /// Rows, which are as many as columns.
    pub(crate) fn n(&self) -> usize {
        self.n
    }

    /// The whole matrix.
    pub(crate) fn dense(&self) -> Mat<f64> {
        Mat::from_fn(self.n, self.n, |i, j| {
            let (row, column) = (i.max(j), i.min(j));
            self.tile(row / N_TILE, column / N_TILE)[row % N_TILE][column % N_TILE]
        })
    }

    /// The matrix times a few vectors, on the threads of whoever calls.
    ///
    /// * `vectors` — shape `(n, N_VECTORS)`
    pub(crate) fn product(&self, vectors: MatRef<f64>) -> Mat<f64> {
        assert_eq!(
            (vectors.nrows(), vectors.ncols()),
            (self.n, N_VECTORS),
            "a block of vectors of this length"
        );
        let mut along = vec![NOTHING; self.n.div_ceil(N_TILE)];
        for (row, lanes) in along.as_flattened_mut()[..self.n].iter_mut().enumerate() {
            *lanes = std::array::from_fn(|lane| vectors[(row, lane)]);
        }
        let parts: Vec<Vec<Rows>> = (0..N_PARTS)
            .into_par_iter()
            .with_max_len(1)
            .map(|part| {
                let mut sums = vec![NOTHING; along.len()];
                for row in self.first_row(part)..self.first_row(part + 1) {
                    Instructions::widest().run(
                        #[inline(always)]
                        || self.add_row(row, &along, &mut sums),
                    );
                }
                sums
            })
            .collect();
        Mat::from_fn(self.n, N_VECTORS, |row, lane| {
            parts.iter().map(|sums| sums[row / N_TILE][row % N_TILE][lane]).sum()
        })
    }

    /// Row of tiles that a part begins with: a triangle's first rows hold the square of their share of its tiles.
    fn first_row(&self, part: usize) -> usize {
        let share = (part as f64 / N_PARTS as f64).sqrt();
        (share * self.n.div_ceil(N_TILE) as f64).round() as usize
    }

    fn tile(&self, row: usize, column: usize) -> &Tile {
        &self.tiles[row * (row + 1) / 2 + column]
    }

    /// Adds what a row of tiles makes of the vectors. Inlined, as all that it calls, so that it is compiled for the instructions
    /// of whoever calls.
    #[inline(always)]
    fn add_row(&self, row: usize, along: &[Rows], sums: &mut [Rows]) {
        let (above, from_here) = sums.split_at_mut(row);
        let of_row = &mut from_here[0];
        for (column, of_column) in above.iter_mut().enumerate() {
            add_both(self.tile(row, column), &along[row], &along[column], of_row, of_column);
        }
        // The tile on the diagonal has both of each pair.
        add_both(self.tile(row, row), &NOTHING, &along[row], of_row, &mut NOTHING.clone());
    }
}

/// Adds a tile times the vectors along its columns to the sums of its rows, and the other way round.
#[inline(always)]
fn add_both(tile: &Tile, along_rows: &Rows, along_columns: &Rows, of_rows: &mut Rows, of_columns: &mut Rows) {
    let rows = tile.as_chunks::<N_ROWS>().0.iter();
    let along_rows = along_rows.as_chunks::<N_ROWS>().0.iter();
    let of_rows = of_rows.as_chunks_mut::<N_ROWS>().0.iter_mut();
    for ((entries, along_rows), of_rows) in rows.zip(along_rows).zip(of_rows) {
        let mut sums = *of_rows;
        for column in 0..N_TILE {
            let (along_column, of_column) = (&along_columns[column], &mut of_columns[column]);
            for row in 0..N_ROWS {
                let entry = entries[row][column];
                for lane in 0..N_VECTORS {
                    sums[row][lane] += entry * along_column[lane];
                    of_column[lane] += entry * along_rows[row][lane];
                }
            }
        }
        *of_rows = sums;
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    /// Whole numbers, whose sums have no rounding.
    fn entry(i: usize, j: usize) -> f64 {
        ((i * j + 3 * (i + j)) % 17) as f64 - 8.0
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(20))]
        #[test]
        fn a_product_is_that_of_the_whole_matrix(n in 1..400_usize) {
            let matrix = Symmetric::from_fn(n, entry);
            let dense = Mat::from_fn(n, n, entry);
            prop_assert_eq!(&matrix.dense(), &dense);
            let vectors = Mat::from_fn(n, N_VECTORS, |row, lane| ((row * (lane + 5)) % 13) as f64 - 6.0);
            prop_assert_eq!(matrix.product(vectors.as_ref()), &dense * &vectors);
        }
    }

    #[test]
    fn the_widest_instructions_round_as_the_plain_ones() {
        let matrix = Symmetric::from_fn(2 * N_TILE, |i, j| (entry(i, j) + 0.1).sqrt().max(-3.0));
        let along = [0, 1]
            .map(|row| std::array::from_fn(|i| std::array::from_fn(|lane| ((row + i * lane) as f64).sin())));
        let (mut wide, mut plain) = ([NOTHING; 2], [NOTHING; 2]);
        for row in 0..2 {
            Instructions::widest().run(
                #[inline(always)]
                || matrix.add_row(row, &along, &mut wide),
            );
            matrix.add_row(row, &along, &mut plain);
        }
        assert!(plain[0][0][1] != 0.0);
        assert_eq!(wide, plain);
    }
}
