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

use faer::diag::Diag;
use faer::dyn_stack::{MemBuffer, MemStack};
use faer::linalg::evd::{
    ComputeEigenvectors, SelfAdjointEvdParams, self_adjoint_evd, self_adjoint_evd_scratch,
};
use faer::{Auto, Col, Mat, MatRef, Par, Side, Spec};
use rand::RngExt;
use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::SeedableRng;

use crate::symmetric::{N_VECTORS, Symmetric};

/// Rows of matrices that are decomposed whole: more vectors than are wanted cost as much as finding those that are.
const N_WHOLE_MAX: usize = 256;

/// Vectors of the subspace at which it is looked whether they suffice. At the last it is thinned.
const SIZES: [usize; 3] = [64, 128, N_BASIS_MAX];

/// Vectors of the subspace at most. More need fewer products, but each is made orthogonal to all before it, and to take the
/// subspace apart costs the third power of their number.
const N_BASIS_MAX: usize = 256;

/// Vectors that are kept beyond those that are asked for: what is next to be found.
const N_SPARE: usize = 16;

/// Restarts at most. None to a few are usual.
const N_RESTARTS_MAX: usize = 200;

/// Norm of a residual that is good enough, as a share of the largest eigenvalue's magnitude. An eigenvalue then errs by the
/// square of that over its distance to the next, a vector by that over the distance.
const RESIDUAL_MAX: f64 = 1e-9;

/// Eigenvalues in descending order, and eigenvectors in columns of the same order.
pub(crate) struct Eigen {
    pub(crate) values: Vec<f64>,
    /// Shape `(n, values.len())`.
    pub(crate) vectors: Mat<f64>,
}

/// The `n_wanted` largest algebraic eigenvalues, or all where the matrix is small.
///
/// `None` if the matrix is not finite, or the residuals do not become small.
pub(crate) fn largest(matrix: &Symmetric, n_wanted: usize) -> Option<Eigen> {
    if matrix.n() <= N_WHOLE_MAX { whole(matrix.dense().as_ref()) } else { by_blocks(matrix, n_wanted) }
}

/// All eigenvalues, descending, without vectors. O(n³), a sixth of a second for a thousand.
///
/// `None` if the matrix is not finite.
pub(crate) fn all_values(matrix: MatRef<f64>) -> Option<Vec<f64>> {
    if !matrix.is_all_finite() {
        return None;
    }
    let mut values = matrix.self_adjoint_eigenvalues(Side::Lower).ok()?;
    values.reverse();
    Some(values)
}

/// All eigenvalues and their vectors, by rotations of a tridiagonal matrix (Golub & Van Loan 2013, *Matrix computations*,
/// ch. 8.3.5).
///
/// Not by division and conquest, as the library would for more than 128 rows: that leaves vectors mixed (residuals up to 3e-5 of
/// the largest eigenvalue were seen, of matrices of geodesics; by rotations they are 1e-15), and to mend them takes longer.
fn whole(matrix: MatRef<f64>) -> Option<Eigen> {
    let n = matrix.nrows();
    if !matrix.is_all_finite() {
        return None;
    }
    let never_divide = SelfAdjointEvdParams { recursion_threshold: usize::MAX, ..Auto::<f64>::auto() };
    let params = Spec::new(never_divide);
    let (mut values, mut vectors) = (Diag::zeros(n), Mat::zeros(n, n));
    let scratch = self_adjoint_evd_scratch::<f64>(n, ComputeEigenvectors::Yes, Par::Seq, params);
    let mut memory = MemBuffer::new(scratch);
    let stack = MemStack::new(&mut memory);
    self_adjoint_evd(matrix, values.as_mut(), Some(vectors.as_mut()), Par::Seq, stack, params).ok()?;
    Some(Eigen {
        values: (0..n).rev().map(|rank| values[rank]).collect(),
        vectors: vectors.reverse_cols().to_owned(),
    })
}

/// The `n_wanted` largest eigenvalues.
fn by_blocks(matrix: &Symmetric, n_wanted: usize) -> Option<Eigen> {
    let mut basis = Basis::new(matrix);
    for _ in 0..=N_RESTARTS_MAX {
        for size in SIZES {
            while basis.n + N_VECTORS <= size.min(matrix.n()) {
                basis.grow();
            }
            if basis.n < n_wanted + N_SPARE {
                continue;
            }
            let (values, inner) = basis.best(n_wanted + N_SPARE)?;
            if basis.largest_residual(&values[..n_wanted], inner.get(.., ..n_wanted)) <= RESIDUAL_MAX {
                let vectors = basis.vectors.get(.., ..basis.n) * inner.get(.., ..n_wanted);
                return Some(Eigen { values: values[..n_wanted].to_vec(), vectors });
            }
            if size == N_BASIS_MAX {
                basis.thin(inner.as_ref());
            }
        }
    }
    None
}

/// An orthonormal basis of a growing subspace, and what the matrix makes of it.
struct Basis<'a> {
    matrix: &'a Symmetric,
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
    fn new(matrix: &'a Symmetric) -> Self {
        let n_rows = matrix.n();
        let next = random_block(n_rows, N_VECTORS).qr().compute_thin_Q();
        let zeros = Mat::zeros(n_rows, N_BASIS_MAX.min(n_rows));
        Self { matrix, n: 0, vectors: zeros.clone(), images: zeros, next }
    }

    /// Adds the next block, and finds the one after it.
    fn grow(&mut self) {
        let after = self.n + N_VECTORS;
        let mut block = self.matrix.product(self.next.as_ref());
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

#[cfg(test)]
mod tests {
    use super::*;

    /// A symmetric matrix with these eigenvalues, turned by an orthogonal matrix.
    fn with_eigenvalues(values: &[f64]) -> Mat<f64> {
        let turn = random_block(values.len(), values.len()).qr().compute_thin_Q();
        let scaled = Mat::from_fn(values.len(), values.len(), |i, j| turn[(i, j)] * values[j]);
        scaled * turn.transpose()
    }

    fn stored(matrix: &Mat<f64>) -> Symmetric {
        Symmetric::from_fn(matrix.nrows(), |i, j| 0.5 * (matrix[(i, j)] + matrix[(j, i)]))
    }

    /// Eigenvalues and the residual of every pair, against those that the matrix was made of.
    fn check(values: &[f64], n_wanted: usize) {
        let matrix = with_eigenvalues(values);
        let mut expected = values.to_vec();
        expected.sort_by(|a, b| b.total_cmp(a));
        let magnitude = values.iter().fold(0.0, |most: f64, value| most.max(value.abs()));
        let found = by_blocks(&stored(&matrix), n_wanted).expect("it converges");
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
            for (alone, value) in all_values(matrix.as_ref()).unwrap().iter().zip(&values) {
                assert!((alone - value).abs() < 1e-11 * values[0], "{alone} {value}");
            }
            assert!(values.windows(2).all(|pair| pair[0] >= pair[1]));
            for rank in 0..300 {
                let residual: Col<f64> = &matrix * vectors.col(rank) - vectors.col(rank) * values[rank];
                assert!(residual.norm_l2() < 1e-11 * values[0], "{rank}: {}", residual.norm_l2());
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
        assert!(by_blocks(&stored(&matrix), 2).is_none());
        assert!(whole(matrix.as_ref()).is_none() && all_values(matrix.as_ref()).is_none());
    }

    #[test]
    fn the_same_bits_come_out_on_one_thread_and_on_two() {
        let values: Vec<f64> = (1..1300).map(|rank| 1.0 / f64::from(rank)).collect();
        let matrix = with_eigenvalues(&values);
        let on = |n_threads| {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(n_threads).build().unwrap();
            pool.install(|| by_blocks(&stored(&matrix), 5).unwrap())
        };
        let (one, two) = (on(1), on(2));
        assert_eq!(one.values, two.values);
        assert_eq!(one.vectors, two.vectors);
    }
}
