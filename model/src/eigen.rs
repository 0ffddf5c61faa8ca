//! The largest eigenvalues of a symmetric matrix, and their eigenvectors.
//!
//! Largest *algebraic*: centred matrices of squared geodesics have real negative eigenvalues, and those of largest
//! magnitude may be among them.
//!
//! A small matrix is decomposed whole. Of a large one only as much as is asked for: a subspace of Krylov, grown a block at a
//! time, from which the best approximations are taken (Rayleigh-Ritz); where these are not good enough, the subspace is
//! thinned to the best and grown again. Saad 2011, *Numerical methods for large eigenvalue problems*, ch. 6.5 (block
//! Lanczos); Wu & Simon 2000, *Thick-restart Lanczos method for large symmetric eigenvalue problems*. Every new block is made
//! orthogonal to all before it, twice, so that no eigenvalue is found twice.

use faer::{Col, Mat, MatRef, Side};
use rand::RngExt;
use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::SeedableRng;
use rayon::prelude::*;

/// Rows of matrices that are decomposed whole: there, that takes a fraction of a second.
pub(crate) const N_WHOLE_MAX: usize = 1000;

/// Vectors in a block. The matrix is read once for each block, and a subspace of as many vectors in smaller blocks tells
/// closer eigenvalues apart: those of noise are as close as they are many.
const N_IN_BLOCK: usize = 8;

/// Vectors of the subspace at which it is looked whether they suffice. At the last it is thinned.
const SIZES: [usize; 3] = [N_WHOLE_MAX / 4, N_WHOLE_MAX / 2, N_WHOLE_MAX];

/// Vectors that are kept beyond those that are asked for: what is next to be found.
const N_SPARE: usize = 16;

/// Restarts at most. None to a few are usual.
const N_RESTARTS_MAX: usize = 100;

/// Norm of a residual that is good enough, as a share of the largest eigenvalue's magnitude. An eigenvalue then errs by the
/// square of that over its distance to the next, a vector by that over the distance.
const RESIDUAL_MAX: f64 = 1e-9;

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
///
/// By division and conquest, which leaves vectors of close eigenvalues mixed (residuals of 3e-5 of the largest eigenvalue were
/// seen, of matrices of geodesics); what that leaves off the diagonal is turned away by Jacobi's rotations.
pub(crate) fn whole(matrix: MatRef<f64>) -> Option<Eigen> {
    let eigen = matrix.self_adjoint_eigen(Side::Lower).ok()?;
    let mut vectors = eigen.U().to_owned();
    let mut inner = vectors.transpose() * (matrix * &vectors);
    let is_finite = (0..matrix.nrows()).all(|rank| inner[(rank, rank)].is_finite());
    if !is_finite || !diagonalise(&mut inner, &mut vectors) {
        return None;
    }
    let mut order: Vec<usize> = (0..matrix.nrows()).collect();
    order.sort_by(|&a, &b| inner[(b, b)].total_cmp(&inner[(a, a)]));
    let values = order.iter().map(|&rank| inner[(rank, rank)]).collect();
    Some(Eigen {
        values,
        vectors: Mat::from_fn(vectors.nrows(), order.len(), |i, rank| vectors[(i, order[rank])]),
    })
}

/// Sweeps of rotations at most. Of a nearly diagonal matrix, each squares what is left: two or three are usual.
const N_SWEEPS_MAX: usize = 30;

/// Turns a nearly diagonal matrix until nothing but rounding is off its diagonal, and vectors with it (Golub & Van Loan 2013,
/// *Matrix computations*, ch. 8.5.2). Whether that came to an end.
fn diagonalise(inner: &mut Mat<f64>, vectors: &mut Mat<f64>) -> bool {
    let n = inner.nrows();
    let magnitude = (0..n).map(|rank| inner[(rank, rank)].abs()).fold(0.0, f64::max);
    let rounding = f64::EPSILON * magnitude * n as f64;
    for _ in 0..N_SWEEPS_MAX {
        let mut is_diagonal = true;
        for q in 1..n {
            for p in 0..q {
                let off = inner[(p, q)];
                if off.abs() <= rounding {
                    continue;
                }
                is_diagonal = false;
                let ratio = (inner[(q, q)] - inner[(p, p)]) / (2.0 * off);
                let tangent = ratio.signum() / (ratio.abs() + ratio.hypot(1.0));
                let cosine = 1.0 / tangent.hypot(1.0);
                let rotation = (cosine, cosine * tangent);
                turn_columns(inner, (p, q), rotation);
                turn_columns(vectors, (p, q), rotation);
                for column in 0..n {
                    let (a, b) = (inner[(p, column)], inner[(q, column)]);
                    (inner[(p, column)], inner[(q, column)]) =
                        (rotation.0 * a - rotation.1 * b, rotation.1 * a + rotation.0 * b);
                }
            }
        }
        if is_diagonal {
            return true;
        }
    }
    false
}

/// Turns two columns by an angle of this cosine and sine.
fn turn_columns(matrix: &mut Mat<f64>, (p, q): (usize, usize), (cosine, sine): (f64, f64)) {
    for row in 0..matrix.nrows() {
        let (a, b) = (matrix[(row, p)], matrix[(row, q)]);
        (matrix[(row, p)], matrix[(row, q)]) = (cosine * a - sine * b, sine * a + cosine * b);
    }
}

/// The `n_wanted` largest eigenvalues.
fn by_blocks(matrix: MatRef<f64>, n_wanted: usize) -> Option<Eigen> {
    let mut basis = Basis::new(matrix);
    for _ in 0..=N_RESTARTS_MAX {
        for size in SIZES {
            while basis.n + N_IN_BLOCK <= size.min(matrix.nrows()) {
                basis.grow();
            }
            let (values, inner) = basis.best(n_wanted + N_SPARE)?;
            if basis.largest_residual(&values[..n_wanted], inner.get(.., ..n_wanted)) <= RESIDUAL_MAX {
                let vectors = basis.vectors.get(.., ..basis.n) * inner.get(.., ..n_wanted);
                return Some(Eigen { values: values[..n_wanted].to_vec(), vectors });
            }
            if size == N_WHOLE_MAX {
                basis.thin(inner.as_ref());
            }
        }
    }
    None
}

/// An orthonormal basis of a growing subspace, and what the matrix makes of it.
struct Basis<'a> {
    matrix: MatRef<'a, f64>,
    /// Vectors so far: the first columns of what follows.
    n: usize,
    /// Q.
    vectors: Mat<f64>,
    /// A Q.
    images: Mat<f64>,
    /// Directions into which the matrix leads out of the subspace, orthonormal to it.
    next: Mat<f64>,
}

impl<'a> Basis<'a> {
    fn new(matrix: MatRef<'a, f64>) -> Self {
        let n_rows = matrix.nrows();
        let next = random_block(n_rows, N_IN_BLOCK).qr().compute_thin_Q();
        let zeros = Mat::zeros(n_rows, N_WHOLE_MAX.min(n_rows));
        Self { matrix, n: 0, vectors: zeros.clone(), images: zeros, next }
    }

    /// Adds the next block, and finds the one after it.
    fn grow(&mut self) {
        let after = self.n + N_IN_BLOCK;
        let mut block = product(self.matrix, self.next.as_ref());
        self.vectors.get_mut(.., self.n..after).copy_from(&self.next);
        self.images.get_mut(.., self.n..after).copy_from(&block);
        self.n = after;
        let vectors = self.vectors.get(.., ..after);
        // Once leaves rounding of the former length, which may be longer than what is left; the second time does not. A
        // block that had nothing left but rounding becomes random directions, which do no harm.
        for _ in 0..2 {
            block = &block - vectors * (vectors.transpose() * &block);
            block = block.qr().compute_thin_Q();
        }
        self.next = block;
    }

    /// The best approximations in the subspace: eigenvalues, descending, and each vector's parts of the basis.
    fn best(&self, n_best: usize) -> Option<(Vec<f64>, Mat<f64>)> {
        let inner = self.vectors.get(.., ..self.n).transpose() * self.images.get(.., ..self.n);
        let Eigen { values, vectors } = whole(inner.as_ref())?;
        Some((values, vectors.get(.., ..n_best).to_owned()))
    }

    /// The largest norm of `A q − λ q`, as a share of the largest magnitude of these λ.
    fn largest_residual(&self, values: &[f64], inner: MatRef<f64>) -> f64 {
        let (vectors, images) =
            (self.vectors.get(.., ..self.n) * inner, self.images.get(.., ..self.n) * inner);
        let magnitude = values.iter().fold(0.0, |most: f64, value| most.max(value.abs()));
        let residual = |(rank, value): (usize, &f64)| -> f64 {
            let residual: Col<f64> = images.col(rank) - vectors.col(rank) * *value;
            residual.norm_l2()
        };
        let largest = values.iter().enumerate().map(residual).fold(0.0, f64::max);
        // A matrix of nothing has no residuals either.
        if magnitude > 0.0 { largest / magnitude } else { largest }
    }

    /// Leaves only the best approximations. What leads out of the subspace leads out of them.
    fn thin(&mut self, inner: MatRef<f64>) {
        let n_kept = inner.ncols();
        let vectors = self.vectors.get(.., ..self.n) * inner;
        let images = self.images.get(.., ..self.n) * inner;
        self.vectors.get_mut(.., ..n_kept).copy_from(&vectors);
        self.images.get_mut(.., ..n_kept).copy_from(&images);
        self.n = n_kept;
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
            // Rounding of making and taking apart a matrix of a thousand rows.
            assert!((found_value - expected).abs() < 1e-11 * magnitude, "{rank}: {found_value}, {expected}");
            let vector = found.vectors.col(rank);
            let residual: Col<f64> = &matrix * vector - vector * *found_value;
            assert!(residual.norm_l2() < 1.1e-9 * magnitude, "{rank}: {}", residual.norm_l2());
        }
        let unity = found.vectors.transpose() * &found.vectors;
        for i in 0..n_wanted {
            for j in 0..n_wanted {
                assert!((unity[(i, j)] - f64::from(u8::from(i == j))).abs() < 1e-11);
            }
        }
    }

    #[test]
    fn every_vector_of_a_whole_decomposition_is_one_whatever_is_close_to_it() {
        let mut random = ChaCha8Rng::seed_from_u64(3);
        let clusters = |index: usize| (1.0 + (index / 40) as f64) * (1.0 + 1e-7 * (index % 40) as f64) - 3.0;
        let falling = |index: usize| 1e6 / (1 + index * index) as f64 - 20.0;
        for values in [(0..300).map(clusters).collect::<Vec<f64>>(), (0..300).map(falling).collect()] {
            let mut matrix = with_eigenvalues(&values);
            for i in 0..300 {
                for j in 0..i {
                    let noise = random.random_range(-1e-3..1e-3);
                    matrix[(i, j)] += noise;
                    matrix[(j, i)] = matrix[(i, j)];
                }
            }
            let Eigen { values, vectors } = whole(matrix.as_ref()).unwrap();
            assert!(values.windows(2).all(|pair| pair[0] >= pair[1]));
            for rank in 0..300 {
                let residual: Col<f64> = &matrix * vectors.col(rank) - vectors.col(rank) * values[rank];
                assert!(residual.norm_l2() < 1e-11 * values[0], "{rank}: {}", residual.norm_l2());
            }
        }
    }

    #[test]
    fn what_is_off_the_diagonal_is_turned_away() {
        let values = [5.0, 5.0 + 1e-9, -2.0, 0.0];
        let mut inner = with_eigenvalues(&values);
        let mut vectors = Mat::identity(4, 4);
        assert!(diagonalise(&mut inner, &mut vectors));
        let mut found: Vec<f64> = (0..4).map(|rank| inner[(rank, rank)]).collect();
        found.sort_by(f64::total_cmp);
        for (found, expected) in found.iter().zip([-2.0, 0.0, 5.0, 5.0 + 1e-9]) {
            assert!((found - expected).abs() < 1e-13, "{found} {expected}");
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
        let values: Vec<f64> = (1..1500).map(|rank| 1e6 * f64::from(rank).powi(-2) - 20.0).collect();
        check(&values, 30);
    }

    #[test]
    fn eigenvalues_as_close_as_those_of_noise_are_told_apart_after_restarts() {
        let values: Vec<f64> = (0..2500)
            .map(|index| {
                if index < 9 { 1000.0 / f64::from(1 + index) } else { 3.0 - 6.0 * f64::from(index) / 2500.0 }
            })
            .collect();
        check(&values, 30);
    }

    #[test]
    fn eigenvalues_that_occur_more_than_once_are_found_as_often() {
        let values: Vec<f64> =
            (0..1100).map(|index| if index < 6 { 9.0 } else { f64::from(index % 7) }).collect();
        check(&values, 8);
    }

    #[test]
    fn a_matrix_of_few_dimensions_has_zeros_for_the_others() {
        let mut values = vec![0.0; 1100];
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
        let values: Vec<f64> = (1..1300).map(|rank| 1.0 / f64::from(rank)).collect();
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
