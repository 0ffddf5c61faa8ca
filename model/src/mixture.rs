//! The Gaussian mixture over embedded frames: one component is one kind.
//!
//! The posterior carries the mixing weights, `P(j | e) ∝ α_j p(e | j)`; the paper's Algorithm 2 leaves them out.
//! Everything that serving computes here is in a fixed order and without the system's `exp` and `ln`, so that equal
//! models give equal bits on every machine.

use std::f64::consts::TAU;

use nalgebra::DMatrix;

/// Frames that are taken side by side where there are many.
pub(crate) const LANES: usize = 8;

/// One number for each of [`LANES`] frames.
pub(crate) type Lanes = [f64; LANES];

/// J Gaussians in d dimensions.
#[derive(Clone, Debug)]
pub struct Mixture {
    n_dims: usize,
    /// α, shape `(n_kinds,)`.
    weights: Vec<f64>,
    /// μ, shape `(n_kinds, n_dims)`, counts.
    means: Vec<f64>,
    /// Σ, shape `(n_kinds, n_dims, n_dims)`, counts².
    covariances: Vec<f64>,
    /// L⁻¹ with Σ = L Lᵀ, shape `(n_kinds, n_dims, n_dims)`, lower triangles by row, 1/counts.
    whitenings: Vec<f64>,
    /// `ln α − ½ (d ln 2π + ln det Σ)`, shape `(n_kinds,)`.
    log_peaks: Vec<f64>,
}

/// What the mixture says of a place.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Density {
    /// `ln p(e)`, nats.
    pub log_likelihood: f64,
    /// Least squared Mahalanobis distance to a kind.
    pub squared_mahalanobis: f64,
}

/// Why numbers are not a mixture.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum MixtureError {
    /// The arrays do not belong together.
    #[error(
        "mixture: {n_weights} weights, {n_means} means and {n_covariances} covariances of {n_dims} dimensions do not fit together"
    )]
    Shape {
        /// Weights given.
        n_weights: usize,
        /// Numbers in means.
        n_means: usize,
        /// Numbers in covariances.
        n_covariances: usize,
        /// Dimensions.
        n_dims: usize,
    },
    /// Weights that are no probabilities.
    #[error("mixture: the mixing weights must lie in 0…1 and sum to 1; they sum to {sum}")]
    Weights {
        /// Their sum.
        sum: f64,
    },
    /// A covariance that spans no volume, or is not finite.
    #[error(
        "mixture: the covariance of kind {kind} is singular or not finite; fewer kinds or a higher covariance floor avoid it"
    )]
    Singular {
        /// Which kind.
        kind: usize,
    },
}

impl Mixture {
    /// Checks the numbers and prepares what the density needs.
    ///
    /// * `weights` — α, shape `(n_kinds,)`
    /// * `means` — μ, shape `(n_kinds, n_dims)`, counts
    /// * `covariances` — Σ, shape `(n_kinds, n_dims, n_dims)`, counts²; their lower triangles count
    ///
    /// # Errors
    /// If shapes do not fit, weights are no probabilities, or a covariance is not positive definite.
    pub fn new(
        n_dims: usize,
        weights: Vec<f64>,
        means: Vec<f64>,
        covariances: Vec<f64>,
    ) -> Result<Self, MixtureError> {
        let n_kinds = weights.len();
        if n_dims == 0
            || n_kinds == 0
            || means.len() != n_kinds * n_dims
            || covariances.len() != means.len() * n_dims
        {
            let (n_means, n_covariances) = (means.len(), covariances.len());
            return Err(MixtureError::Shape { n_weights: n_kinds, n_means, n_covariances, n_dims });
        }
        let sum: f64 = weights.iter().sum();
        if !weights.iter().all(|weight| (0.0..=1.0).contains(weight)) || (sum - 1.0).abs() > 1e-9 {
            return Err(MixtureError::Weights { sum });
        }
        let mut whitenings = Vec::with_capacity(covariances.len());
        let mut log_peaks = Vec::with_capacity(n_kinds);
        for (kind, covariance) in covariances.chunks_exact(n_dims * n_dims).enumerate() {
            let (whitening, log_determinant) =
                whiten(n_dims, covariance).ok_or(MixtureError::Singular { kind })?;
            if !means[kind * n_dims..][..n_dims].iter().all(|mean| mean.is_finite()) {
                return Err(MixtureError::Singular { kind });
            }
            whitenings.extend_from_slice(&whitening);
            log_peaks
                .push(libm::log(weights[kind]) - 0.5 * (n_dims as f64 * libm::log(TAU) + log_determinant));
        }
        Ok(Self { n_dims, weights, means, covariances, whitenings, log_peaks })
    }

    /// The same with kinds in another order.
    ///
    /// * `order` — which of the kinds comes first, second, …; each once
    pub(crate) fn in_order(&self, order: &[usize]) -> Self {
        assert_eq!(order.len(), self.n_kinds(), "each kind once");
        let of = |numbers: &[f64]| {
            let n_each = numbers.len() / self.n_kinds();
            order.iter().flat_map(|&kind| numbers[kind * n_each..][..n_each].to_vec()).collect()
        };
        Self {
            n_dims: self.n_dims,
            weights: of(&self.weights),
            means: of(&self.means),
            covariances: of(&self.covariances),
            whitenings: of(&self.whitenings),
            log_peaks: of(&self.log_peaks),
        }
    }

    /// J.
    pub fn n_kinds(&self) -> usize {
        self.weights.len()
    }

    /// d.
    pub fn n_dims(&self) -> usize {
        self.n_dims
    }

    /// α, shape `(n_kinds,)`.
    pub fn weights(&self) -> &[f64] {
        &self.weights
    }

    /// μ, shape `(n_kinds, n_dims)`, counts.
    pub fn means(&self) -> &[f64] {
        &self.means
    }

    /// Σ, shape `(n_kinds, n_dims, n_dims)`, counts².
    pub fn covariances(&self) -> &[f64] {
        &self.covariances
    }

    /// Squared Mahalanobis distance of a place from the mean of a kind: `(e − μ)ᵀ Σ⁻¹ (e − μ)`.
    ///
    /// * `coordinates` — shape `(n_dims,)`, counts
    pub fn squared_mahalanobis(&self, kind: usize, coordinates: &[f64]) -> f64 {
        let d = self.n_dims;
        assert_eq!(coordinates.len(), d, "a place has as many coordinates as the mixture has dimensions");
        let mean = &self.means[kind * d..][..d];
        let whitening = &self.whitenings[kind * d * d..][..d * d];
        let mut squared = 0.0;
        for (row, weights) in whitening.chunks_exact(d).enumerate() {
            let mut along = 0.0;
            for ((weight, place), mean) in weights[..=row].iter().zip(coordinates).zip(mean) {
                along += weight * (place - mean);
            }
            squared += along * along;
        }
        squared
    }

    /// `ln α + ln p(e | kind)` of several places side by side, each with the bits that it has alone; or, if all are less than
    /// what they are asked to be at least, numbers that are less, too.
    ///
    /// * `places` — shape `(n_dims, LANES)`, counts
    /// * `offsets` — of the same shape; overwritten
    ///
    /// Inlined, so that it is compiled for the instructions of whoever calls.
    #[inline(always)]
    pub(crate) fn log_joints(
        &self,
        kind: usize,
        places: &[Lanes],
        offsets: &mut [Lanes],
        least: &Lanes,
    ) -> Lanes {
        let d = self.n_dims;
        let mean = &self.means[kind * d..][..d];
        let peak = self.log_peaks[kind];
        let mut log_joints = [peak; LANES];
        let mut squared = [0.0; LANES];
        for (row, weights) in self.whitenings[kind * d * d..][..d * d].chunks_exact(d).enumerate() {
            offsets[row] = places[row].map(|place| place - mean[row]);
            let mut along = [0.0; LANES];
            for (weight, offset) in weights[..=row].iter().zip(&*offsets) {
                for lane in 0..LANES {
                    along[lane] += weight * offset[lane];
                }
            }
            let mut are_less = true;
            for lane in 0..LANES {
                squared[lane] += along[lane] * along[lane];
                log_joints[lane] = peak - 0.5 * squared[lane];
                are_less &= log_joints[lane] < least[lane];
            }
            // Squares only take away from it.
            if are_less {
                break;
            }
        }
        log_joints
    }

    /// Computes the posterior of every kind, `P(j | e) ∝ α_j p(e | j)`, and returns the log-likelihood `ln p(e)`.
    ///
    /// * `coordinates` — e, shape `(n_dims,)`, counts
    /// * `probabilities` — shape `(n_kinds,)`; overwritten, sums to 1 however far away the place is
    ///
    /// Allocates nothing. O(n_kinds · n_dims²).
    pub fn posterior(&self, coordinates: &[f64], probabilities: &mut [f64]) -> f64 {
        self.density(coordinates, probabilities).log_likelihood
    }

    /// As [`Self::posterior`], with how far away the nearest kind is.
    pub fn density(&self, coordinates: &[f64], probabilities: &mut [f64]) -> Density {
        assert_eq!(probabilities.len(), self.n_kinds(), "one probability for each kind");
        let mut squared_mahalanobis = f64::INFINITY;
        for (kind, log_joint) in probabilities.iter_mut().enumerate() {
            let squared = self.squared_mahalanobis(kind, coordinates);
            *log_joint = self.log_peaks[kind] - 0.5 * squared;
            squared_mahalanobis = squared_mahalanobis.min(squared);
        }
        let highest = probabilities.iter().copied().fold(f64::NEG_INFINITY, f64::max);
        let mut sum = 0.0;
        for probability in probabilities.iter_mut() {
            *probability = libm::exp(*probability - highest);
            sum += *probability;
        }
        for probability in probabilities.iter_mut() {
            *probability /= sum;
        }
        Density { log_likelihood: highest + libm::log(sum), squared_mahalanobis }
    }
}

/// L⁻¹ by rows, and ln det Σ.
///
/// By nalgebra and not by faer: its plain loops do not choose instructions by processor, and a model is to give the same
/// bits wherever it is loaded.
fn whiten(n_dims: usize, covariance: &[f64]) -> Option<(Vec<f64>, f64)> {
    let lower = DMatrix::from_row_slice(n_dims, n_dims, covariance).cholesky()?.unpack();
    let log_determinant = 2.0 * lower.diagonal().iter().map(|pivot| libm::log(*pivot)).sum::<f64>();
    let inverse = lower.solve_lower_triangular(&DMatrix::identity(n_dims, n_dims))?;
    let whitening: Vec<f64> =
        inverse.row_iter().flat_map(|row| row.iter().copied().collect::<Vec<_>>()).collect();
    (log_determinant.is_finite() && whitening.iter().all(|value| value.is_finite()))
        .then_some((whitening, log_determinant))
}

/// The most probable kind, the first of equals.
pub fn most_probable(probabilities: &[f64]) -> usize {
    let higher =
        |best: usize, kind: usize| if probabilities[kind] > probabilities[best] { kind } else { best };
    (0..probabilities.len()).fold(0, higher)
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    fn two_kinds() -> Mixture {
        let covariances = vec![4.0, 1.0, 1.0, 2.0, 1.0, 0.0, 0.0, 9.0];
        Mixture::new(2, vec![0.25, 0.75], vec![0.0, 0.0, 5.0, -1.0], covariances).unwrap()
    }

    #[test]
    fn density_equals_the_printed_formula() {
        // Eq. (1) of the paper by hand: Σ₀ = [4 1; 1 2], det 7, inverse [2 −1; −1 4] / 7; Σ₁ = diag(1, 9).
        let (x, y) = (1.0, -2.0);
        let m0: f64 = (2.0 * x * x - 2.0 * x * y + 4.0 * y * y) / 7.0;
        let m1: f64 = (x - 5.0) * (x - 5.0) + (y + 1.0) * (y + 1.0) / 9.0;
        let p0 = 0.25 * (-0.5 * m0).exp() / (TAU * 7.0_f64.sqrt());
        let p1 = 0.75 * (-0.5 * m1).exp() / (TAU * 3.0);
        let mut probabilities = [0.0; 2];
        let log_likelihood = two_kinds().posterior(&[x, y], &mut probabilities);
        assert!((log_likelihood - (p0 + p1).ln()).abs() < 1e-14);
        assert!((probabilities[0] - p0 / (p0 + p1)).abs() < 1e-14);
    }

    #[test]
    fn mixing_weights_decide_where_densities_are_equal() {
        let mixture = Mixture::new(1, vec![0.2, 0.8], vec![-1.0, 1.0], vec![1.0, 1.0]).unwrap();
        let mut probabilities = [0.0; 2];
        mixture.posterior(&[0.0], &mut probabilities);
        assert!((probabilities[0] - 0.2).abs() < 1e-15 && (probabilities[1] - 0.8).abs() < 1e-15);
    }

    #[test]
    fn numbers_that_are_no_mixture_are_refused_in_words() {
        let refuse = |weights: Vec<f64>, covariances: Vec<f64>| {
            Mixture::new(1, weights, vec![0.0, 1.0], covariances).unwrap_err().to_string()
        };
        assert_eq!(
            refuse(vec![0.5, 0.6], vec![1.0, 1.0]),
            "mixture: the mixing weights must lie in 0…1 and sum to 1; they sum to 1.1"
        );
        assert_eq!(
            refuse(vec![0.5, 0.5], vec![1.0, 0.0]),
            "mixture: the covariance of kind 1 is singular or not finite; fewer kinds or a higher covariance floor avoid it"
        );
        assert_eq!(
            refuse(vec![0.5, 0.5], vec![1.0]),
            "mixture: 2 weights, 2 means and 1 covariances of 1 dimensions do not fit together"
        );
    }

    proptest! {
        #[test]
        fn probabilities_are_finite_and_sum_to_one_wherever_a_frame_lands(x in -1e150..1e150_f64, y in -1e150..1e150_f64) {
            let mut probabilities = [0.0; 2];
            let log_likelihood = two_kinds().posterior(&[x, y], &mut probabilities);
            prop_assert!(probabilities.iter().all(|p| (0.0..=1.0).contains(p)));
            prop_assert!((probabilities.iter().sum::<f64>() - 1.0).abs() < 1e-12);
            prop_assert!(log_likelihood <= 0.0);
        }
    }
}
