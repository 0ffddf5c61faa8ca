//! The largest eigenvalues of a symmetric matrix, and their eigenvectors.
//!
//! Largest *algebraic*: centred matrices of squared geodesics have real negative eigenvalues, and those of largest
//! magnitude may be among them.
//!
//! A small matrix is decomposed whole. Of a large one only as much as is asked for: subspaces of Krylov, a block at a
//! time, from which the best approximations are taken (Rayleigh-Ritz) and grown again until the residuals are nothing
//! but rounding. Saad 2011, *Numerical methods for large eigenvalue problems*, ch. 6.5 and 7.4 (block Lanczos with
//! restarts). Every new block is made orthogonal to all before it, twice, so that no eigenvalue is found twice.

use faer::{Col, Mat, MatRef, Side};
use rand::RngExt;
use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::SeedableRng;
use rayon::prelude::*;

/// Rows of matrices that are decomposed whole: there, that takes a fraction of a second.
pub(crate) const N_WHOLE_MAX: usize = 1000;

/// Vectors in a block beyond those that are asked for: the last ones converge as fast as these are many.
const N_SPARE: usize = 8;

/// Blocks until a restart.
const N_BLOCKS: usize = 8;

/// Restarts at most. A few are usual; a spectrum without any gap takes tens.
const N_RESTARTS_MAX: usize = 200;

/// Norm of a residual that is rounding, as a share of the largest eigenvalue's magnitude.
const RESIDUAL_MAX: f64 = 1e-12;

/// Rows that one thread multiplies at a time. Fixed, so that sums do not depend on the number of threads.
const N_ROWS_AT_A_TIME: usize = 256;

/// Eigenvalues in descending order, and eigenvectors in columns of the same order.
pub(crate) struct Eigen {
    pub(crate) values: Vec<f64>,
    /// Shape `(n, values.len())`.
    pub(crate) vectors: Mat<f64>,
}

/// The largest algebraic eigenvalues: all of them if the matrix has at most [`N_WHOLE_MAX`] rows, else `n_wanted`.
///
/// `None` if they are not finite, or the residuals do not become small.
pub(crate) fn largest(matrix: MatRef<f64>, n_wanted: usize) -> Option<Eigen> {
    if matrix.nrows() <= N_WHOLE_MAX { whole(matrix) } else { by_blocks(matrix, n_wanted) }
}

/// All eigenvalues.
pub(crate) fn whole(matrix: MatRef<f64>) -> Option<Eigen> {
    let eigen = matrix.self_adjoint_eigen(Side::Lower).ok()?;
    let n = matrix.nrows();
    // faer sorts ascending.
    let values: Vec<f64> = (0..n).map(|rank| eigen.S().column_vector()[n - 1 - rank]).collect();
    let is_finite = values.iter().all(|value| value.is_finite());
    is_finite.then(|| Eigen { values, vectors: eigen.U().reverse_cols().to_owned() })
}

/// The `n_wanted` largest eigenvalues.
fn by_blocks(matrix: MatRef<f64>, n_wanted: usize) -> Option<Eigen> {
    let n_in_block = n_wanted + N_SPARE;
    let mut basis = Basis::new(matrix, random_block(matrix.nrows(), n_in_block));
    for _ in 0..N_RESTARTS_MAX {
        for _ in 1..N_BLOCKS {
            basis.grow();
        }
        let (values, largest_residual) = basis.reduce(n_in_block, n_wanted)?;
        if largest_residual <= RESIDUAL_MAX {
            let vectors = basis.vectors.get(.., ..n_wanted).to_owned();
            return Some(Eigen { values: values[..n_wanted].to_vec(), vectors });
        }
    }
    None
}

/// An orthonormal basis of a growing subspace, and what the matrix makes of it.
struct Basis<'a> {
    matrix: MatRef<'a, f64>,
    n_in_block: usize,
    /// Q, shape `(n, m)`.
    vectors: Mat<f64>,
    /// A Q, shape `(n, m)`.
    images: Mat<f64>,
}

impl<'a> Basis<'a> {
    fn new(matrix: MatRef<'a, f64>, block: Mat<f64>) -> Self {
        let vectors = block.qr().compute_thin_Q();
        let images = product(matrix, vectors.as_ref());
        Self { matrix, n_in_block: vectors.ncols(), vectors, images }
    }

    /// Adds the directions into which the matrix leads out of the last block.
    fn grow(&mut self) {
        let m = self.vectors.ncols();
        let mut block = self.images.get(.., m - self.n_in_block..).to_owned();
        // Once leaves rounding of the former length, which may be longer than what is left; the second time does not. A
        // block that had nothing left but rounding becomes random directions, which do no harm.
        for _ in 0..2 {
            block = &block - &self.vectors * (self.vectors.transpose() * &block);
            block = block.qr().compute_thin_Q();
        }
        let image = product(self.matrix, block.as_ref());
        self.vectors = beside(&self.vectors, &block);
        self.images = beside(&self.images, &image);
    }

    /// Replaces the basis by the best approximations in it. Returns their eigenvalues, descending, and the largest norm of
    /// `A q − λ q` of the first `n_wanted`, as a share of the largest magnitude.
    fn reduce(&mut self, n_kept: usize, n_wanted: usize) -> Option<(Vec<f64>, f64)> {
        let inner = self.vectors.transpose() * &self.images;
        let eigen = whole(inner.as_ref())?;
        let kept = eigen.vectors.get(.., ..n_kept);
        self.vectors = &self.vectors * kept;
        self.images = &self.images * kept;
        let magnitude = eigen.values.iter().fold(0.0, |most: f64, value| most.max(value.abs()));
        let residual = |rank: usize| -> f64 {
            let residual: Col<f64> = self.images.col(rank) - self.vectors.col(rank) * eigen.values[rank];
            residual.norm_l2()
        };
        let largest = (0..n_wanted).map(residual).fold(0.0, f64::max);
        // A matrix of nothing has no residuals either.
        let share = if magnitude > 0.0 { largest / magnitude } else { 0.0 };
        Some((eigen.values, share))
    }
}

/// A block to begin with: any will do that leaves out no eigenvector. Always the same, so that results are.
fn random_block(n: usize, n_in_block: usize) -> Mat<f64> {
    let mut random = ChaCha8Rng::seed_from_u64(0);
    Mat::from_fn(n, n_in_block, |_, _| random.random_range(-1.0..1.0))
}

/// A symmetric matrix times a block, by rows on the threads of whoever calls.
fn product(matrix: MatRef<f64>, block: MatRef<f64>) -> Mat<f64> {
    let n = matrix.nrows();
    let starts: Vec<usize> = (0..n).step_by(N_ROWS_AT_A_TIME).collect();
    let parts: Vec<Mat<f64>> = starts
        .par_iter()
        .with_max_len(1)
        // Columns stand together in memory, and a symmetric matrix' rows are its columns.
        .map(|&start| matrix.get(.., start..n.min(start + N_ROWS_AT_A_TIME)).transpose() * block)
        .collect();
    Mat::from_fn(n, block.ncols(), |row, column| {
        parts[row / N_ROWS_AT_A_TIME][(row % N_ROWS_AT_A_TIME, column)]
    })
}

fn beside(left: &Mat<f64>, right: &Mat<f64>) -> Mat<f64> {
    let n_left = left.ncols();
    Mat::from_fn(left.nrows(), n_left + right.ncols(), |row, column| {
        if column < n_left { left[(row, column)] } else { right[(row, column - n_left)] }
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A symmetric matrix with these eigenvalues, turned by an orthogonal matrix.
    fn with_eigenvalues(values: &[f64]) -> Mat<f64> {
        let turn = random_block(values.len(), values.len()).qr().compute_thin_Q();
        let scaled = Mat::from_fn(values.len(), values.len(), |i, j| turn[(i, j)] * values[j]);
        scaled * turn.transpose()
    }

    /// Eigenvalues and the residual of every pair, against those that the matrix was made of.
    fn check(values: &[f64], n_wanted: usize) {
        let matrix = with_eigenvalues(values);
        let mut expected = values.to_vec();
        expected.sort_by(|a, b| b.total_cmp(a));
        let magnitude = values.iter().fold(0.0, |most: f64, value| most.max(value.abs()));
        let found = by_blocks(matrix.as_ref(), n_wanted).expect("it converges");
        for (rank, (found_value, expected)) in found.values.iter().zip(&expected).enumerate() {
            // Rounding of making and taking apart a matrix of hundreds of rows.
            assert!((found_value - expected).abs() < 1e-11 * magnitude, "{rank}: {found_value}, {expected}");
            let vector = found.vectors.col(rank);
            let residual: Col<f64> = &matrix * vector - vector * *found_value;
            assert!(residual.norm_l2() < 1e-11 * magnitude, "{rank}: {}", residual.norm_l2());
        }
        let unity = found.vectors.transpose() * &found.vectors;
        for i in 0..n_wanted {
            for j in 0..n_wanted {
                assert!((unity[(i, j)] - f64::from(u8::from(i == j))).abs() < 1e-11);
            }
        }
    }

    #[test]
    fn negative_eigenvalues_of_largest_magnitude_are_not_taken() {
        let values: Vec<f64> = (0..600)
            .map(|index| if index < 20 { -1000.0 + f64::from(index) } else { f64::from(index).sqrt() })
            .collect();
        check(&values, 10);
    }

    #[test]
    fn eigenvalues_that_fall_as_those_of_geodesics_do_are_found() {
        let values: Vec<f64> = (1..700).map(|rank| 1e6 * f64::from(rank).powi(-2) - 20.0).collect();
        check(&values, 30);
    }

    #[test]
    fn eigenvalues_that_occur_more_than_once_are_found_as_often() {
        let values: Vec<f64> =
            (0..500).map(|index| if index < 6 { 9.0 } else { f64::from(index % 7) }).collect();
        check(&values, 8);
    }

    #[test]
    fn a_matrix_of_few_dimensions_has_zeros_for_the_others() {
        let mut values = vec![0.0; 400];
        values[..3].copy_from_slice(&[5.0, 3.0, -4.0]);
        check(&values, 30);
    }

    #[test]
    fn numbers_that_are_none_have_no_eigenvalues() {
        let mut matrix = with_eigenvalues(&[1.0; 60]);
        matrix[(3, 5)] = f64::NAN;
        matrix[(5, 3)] = f64::NAN;
        assert!(by_blocks(matrix.as_ref(), 2).is_none());
        assert!(whole(matrix.as_ref()).is_none());
    }

    #[test]
    fn the_same_bits_come_out_on_one_thread_and_on_two() {
        let values: Vec<f64> = (1..600).map(|rank| 1.0 / f64::from(rank)).collect();
        let matrix = with_eigenvalues(&values);
        let on = |n_threads| {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(n_threads).build().unwrap();
            pool.install(|| by_blocks(matrix.as_ref(), 5).unwrap())
        };
        let (one, two) = (on(1), on(2));
        assert_eq!(one.values, two.values);
        assert_eq!(one.vectors, two.vectors);
    }
}
