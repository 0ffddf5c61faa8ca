//! Landmark multidimensional scaling, and the one formula that embeds frames in and out of sample.
//!
//! `e(p) = P (δ̄ − δ(p))` with `P = ½ Λ^(−½) Vᵀ`, where λ, V are the positive eigenvalues and eigenvectors of
//! `B = −½ H Δ H` over the landmarks. It is at once de Silva & Tenenbaum 2004, *Sparse multidimensional scaling using
//! landmark points*, §2.2, and Bengio et al. 2004, *Out-of-sample extensions for LLE, Isomap, MDS, eigenmaps, and
//! spectral clustering*, eq. (2): the other terms of that equation vanish because the eigenvectors sum to zero.
//!
//! The paper prints the double centring with `½ S_i`; right is `S_i / n`. With squared Euclidean distances in place of
//! squared geodesics the same code is principal component analysis, up to signs.

use faer::{Mat, Side};

use crate::array::Array;

/// An eigenvalue below this share of the largest is rounding, not a dimension.
const EIGENVALUE_SHARE_MIN: f64 = 1e-12;

/// What embeds a frame, given its squared geodesics to the landmarks.
#[derive(Clone, Debug)]
pub struct Embedding {
    n_dims: usize,
    /// P, landmark by landmark, shape `(n_landmarks, n_dims)`, 1/counts.
    projection: Array<f64>,
    /// δ̄, shape `(n_landmarks,)`, counts².
    mean_squared_geodesics: Array<f64>,
}

/// All eigenvalues of B.
#[derive(Clone, Debug, PartialEq)]
pub struct Spectrum {
    /// Shape `(n_landmarks,)`, counts², descending: the last are often negative, since geodesics need not fit into any
    /// Euclidean space.
    pub eigenvalues: Vec<f64>,
}

/// Why landmarks cannot be scaled.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum MdsError {
    /// Points span at most one dimension less than there are.
    #[error("{n_landmarks} landmarks span at most {} dimensions and {n_dims} were asked for; ask for more landmarks or fewer dimensions", n_landmarks - 1)]
    TooFewLandmarks {
        /// Landmarks.
        n_landmarks: usize,
        /// Dimensions asked for.
        n_dims: usize,
    },
    /// Fewer positive eigenvalues than dimensions.
    #[error(
        "the {n_landmarks} landmarks span {n_positive} dimensions and {n_dims} were asked for: their frames are too much \
         alike; ask for fewer dimensions or record a trip that sees more"
    )]
    TooFewDimensions {
        /// Positive eigenvalues.
        n_positive: usize,
        /// Dimensions asked for.
        n_dims: usize,
        /// Landmarks.
        n_landmarks: usize,
    },
    /// The eigenvalue algorithm did not converge.
    #[error(
        "the eigenvalues of {n_landmarks} landmarks could not be computed: their distances are not finite or do not converge"
    )]
    NoEigenvalues {
        /// Landmarks.
        n_landmarks: usize,
    },
}

impl Spectrum {
    /// Share of the negative eigenvalues in the sum of all magnitudes: how far the geodesics are from any Euclidean space.
    pub fn negative_share(&self) -> f64 {
        let magnitude: f64 = self.eigenvalues.iter().map(|value| value.abs()).sum();
        let negative: f64 =
            self.eigenvalues.iter().filter(|value| **value < 0.0).map(|value| value.abs()).sum();
        if magnitude > 0.0 { negative / magnitude } else { 0.0 }
    }
}

impl Embedding {
    /// Scales the landmarks.
    ///
    /// * `squared_geodesics` — Δ, symmetric, shape `(n_landmarks, n_landmarks)`, counts²
    /// * `n_dims_max` — d, or the most dimensions wanted when `at_least` is smaller
    /// * `at_least` — fewer positive eigenvalues than this are an error
    ///
    /// An eigenvector's sign is free; here its entry of largest magnitude is positive, so that equal input gives equal
    /// output. Dense: O(n_landmarks³).
    ///
    /// # Errors
    /// If fewer than `at_least` eigenvalues are positive.
    pub fn fit(
        squared_geodesics: &[f64],
        n_landmarks: usize,
        n_dims_max: usize,
        at_least: usize,
    ) -> Result<(Self, Spectrum), MdsError> {
        assert_eq!(
            squared_geodesics.len(),
            n_landmarks * n_landmarks,
            "one distance for each pair of landmarks"
        );
        if n_landmarks <= at_least {
            return Err(MdsError::TooFewLandmarks { n_landmarks, n_dims: at_least });
        }
        let mean_squared: Vec<f64> = squared_geodesics.chunks_exact(n_landmarks).map(mean).collect();
        let grand_mean = mean(&mean_squared);
        let centred = Mat::from_fn(n_landmarks, n_landmarks, |i, j| {
            // Written so that (i, j) and (j, i) round alike.
            let delta =
                0.5 * (squared_geodesics[i * n_landmarks + j] + squared_geodesics[j * n_landmarks + i]);
            -0.5 * (delta - (mean_squared[i] + mean_squared[j]) + grand_mean)
        });
        let eigen =
            centred.self_adjoint_eigen(Side::Lower).map_err(|_| MdsError::NoEigenvalues { n_landmarks })?;
        // faer sorts ascending.
        let value = |rank: usize| eigen.S().column_vector()[n_landmarks - 1 - rank];
        let eigenvalues: Vec<f64> = (0..n_landmarks).map(value).collect();
        let limit = EIGENVALUE_SHARE_MIN * eigenvalues[0].max(0.0);
        let n_positive = eigenvalues.iter().take_while(|value| **value > limit).count();
        if n_positive < at_least {
            return Err(MdsError::TooFewDimensions { n_positive, n_dims: at_least, n_landmarks });
        }
        let n_dims = n_dims_max.min(n_positive);
        let mut projection = vec![0.0; n_landmarks * n_dims];
        for dim in 0..n_dims {
            let vector = eigen.U().col(n_landmarks - 1 - dim);
            let largest = (0..n_landmarks)
                .map(|i| vector[i])
                .fold(0.0, |a: f64, b| if b.abs() > a.abs() { b } else { a });
            let factor = 0.5 * largest.signum() / eigenvalues[dim].sqrt();
            for landmark in 0..n_landmarks {
                projection[landmark * n_dims + dim] = factor * vector[landmark];
            }
        }
        let embedding =
            Self { n_dims, projection: projection.into(), mean_squared_geodesics: mean_squared.into() };
        Ok((embedding, Spectrum { eigenvalues }))
    }

    /// An embedding that was computed before. `None` if the shapes do not fit.
    pub fn from_parts(
        n_dims: usize,
        projection: Array<f64>,
        mean_squared_geodesics: Array<f64>,
    ) -> Option<Self> {
        let fits = n_dims > 0 && mean_squared_geodesics.len().checked_mul(n_dims) == Some(projection.len());
        fits.then_some(Self { n_dims, projection, mean_squared_geodesics })
    }

    /// d.
    pub fn n_dims(&self) -> usize {
        self.n_dims
    }

    /// n.
    pub fn n_landmarks(&self) -> usize {
        self.mean_squared_geodesics.len()
    }

    /// P, shape `(n_landmarks, n_dims)`, 1/counts.
    pub fn projection(&self) -> &[f64] {
        &self.projection
    }

    /// δ̄, shape `(n_landmarks,)`, counts².
    pub fn mean_squared_geodesics(&self) -> &[f64] {
        &self.mean_squared_geodesics
    }

    /// The same embedding with only its first `n_dims` dimensions.
    pub fn truncated(&self, n_dims: usize) -> Self {
        assert!(n_dims <= self.n_dims, "{n_dims} of {} dimensions", self.n_dims);
        let rows = self.projection.chunks_exact(self.n_dims);
        let projection: Vec<f64> = rows.flat_map(|row| row[..n_dims].iter().copied()).collect();
        Self {
            n_dims,
            projection: projection.into(),
            mean_squared_geodesics: self.mean_squared_geodesics.clone(),
        }
    }

    /// Embeds one frame, in or out of sample: `e(p) = P (δ̄ − δ(p))`.
    ///
    /// * `squared_geodesics` — δ(p), shape `(n_landmarks,)`, counts²
    /// * `coordinates` — shape `(n_dims,)`, counts; overwritten
    ///
    /// Sums in the landmarks' order on every machine. Allocates nothing. O(n_landmarks · n_dims).
    pub fn embed(&self, squared_geodesics: &[f64], coordinates: &mut [f64]) {
        assert_eq!(squared_geodesics.len(), self.n_landmarks(), "one squared geodesic for each landmark");
        coordinates.fill(0.0);
        let rows = self.projection.chunks_exact(self.n_dims);
        for ((row, mean), delta) in rows.zip(self.mean_squared_geodesics.iter()).zip(squared_geodesics) {
            let difference = mean - delta;
            for (coordinate, weight) in coordinates.iter_mut().zip(row) {
                *coordinate += weight * difference;
            }
        }
    }
}

fn mean(values: &[f64]) -> f64 {
    values.iter().sum::<f64>() / values.len() as f64
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Squared distances between points of a plane.
    fn squared_distances(points: &[[f64; 2]]) -> Vec<f64> {
        let squared = |a: &[f64; 2], b: &[f64; 2]| (a[0] - b[0]).powi(2) + (a[1] - b[1]).powi(2);
        points.iter().flat_map(|a| points.iter().map(move |b| squared(a, b))).collect()
    }

    const POINTS: [[f64; 2]; 5] = [[0.0, 0.0], [3.0, 0.5], [1.0, 2.0], [-2.0, 1.0], [0.5, -1.5]];

    #[test]
    fn points_of_a_plane_keep_their_distances_and_span_two_dimensions() {
        let delta = squared_distances(&POINTS);
        let (embedding, spectrum) = Embedding::fit(&delta, 5, 2, 2).unwrap();
        let mut places = [[0.0; 2]; 5];
        for (place, row) in places.iter_mut().zip(delta.chunks_exact(5)) {
            embedding.embed(row, place);
        }
        for (found, expected) in squared_distances(&places).iter().zip(&delta) {
            assert!((found - expected).abs() < 1e-12, "{found} {expected}");
        }
        assert!(spectrum.eigenvalues[2].abs() < 1e-12);
        let message = Embedding::fit(&delta, 5, 3, 3).unwrap_err().to_string();
        assert_eq!(
            message,
            "the 5 landmarks span 2 dimensions and 3 were asked for: their frames are too much alike; ask for fewer \
             dimensions or record a trip that sees more"
        );
    }

    #[test]
    fn a_landmark_lands_at_the_root_of_the_eigenvalue_times_its_eigenvector_entry() {
        // √λ_k V_ik = 2 λ_k P_ik: the in-sample coordinates of classical scaling.
        let delta = squared_distances(&POINTS);
        let (embedding, spectrum) = Embedding::fit(&delta, 5, 2, 2).unwrap();
        for (landmark, row) in delta.chunks_exact(5).enumerate() {
            let mut place = [0.0; 2];
            embedding.embed(row, &mut place);
            for (dim, found) in place.iter().enumerate() {
                let expected = 2.0 * spectrum.eigenvalues[dim] * embedding.projection()[landmark * 2 + dim];
                assert!((found - expected).abs() < 1e-12);
            }
        }
    }

    #[test]
    fn equal_frames_and_too_few_landmarks_are_refused_in_words() {
        let refuse = |n_dims| Embedding::fit(&[0.0; 9], 3, n_dims, n_dims).unwrap_err().to_string();
        assert!(
            refuse(1).starts_with("the 3 landmarks span 0 dimensions and 1 were asked for"),
            "{}",
            refuse(1)
        );
        assert_eq!(
            refuse(3),
            "3 landmarks span at most 2 dimensions and 3 were asked for; ask for more landmarks or fewer dimensions"
        );
    }
}
