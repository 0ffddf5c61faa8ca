//! Landmark multidimensional scaling, and the one formula that embeds frames in and out of sample.
//!
//! `e(p) = P (δ̄ − δ(p))` with `P = ½ Λ^(−½) Vᵀ`, where λ, V are the positive eigenvalues and eigenvectors of
//! `B = −½ H Δ H` over the landmarks. It is at once de Silva & Tenenbaum 2004, *Sparse multidimensional scaling using
//! landmark points*, §2.2, and Bengio et al. 2004, *Out-of-sample extensions for LLE, Isomap, MDS, eigenmaps, and
//! spectral clustering*, eq. (2): the other terms of that equation vanish because the eigenvectors sum to zero.
//!
//! The paper prints the double centring with `½ S_i`; right is `S_i / n`. With squared Euclidean distances in place of
//! squared geodesics the same code is principal component analysis, up to signs; with those of any other metric, classical
//! scaling.

use rayon::prelude::*;

use crate::array::Array;
use crate::eigen::{Eigen, all_values, largest};
use crate::simd::Instructions;
use crate::symmetric::Symmetric;

/// Landmarks of which all eigenvalues are computed, to see how many of them are negative.
const N_ALL_VALUES_MAX: usize = 1000;

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

/// Eigenvalues of B.
#[derive(Clone, Debug, PartialEq)]
pub struct Spectrum {
    /// The largest, counts², descending. All of them where landmarks are at most a thousand: then the last are often
    /// negative, since geodesics need not fit into any Euclidean space.
    pub eigenvalues: Vec<f64>,
    /// Share of the negative eigenvalues in the sum of all magnitudes: how far the geodesics are from any Euclidean space.
    /// Of more than a thousand landmarks, that of a thousand among them.
    pub negative_share: f64,
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

impl Embedding {
    /// Scales the landmarks.
    ///
    /// * `squared_geodesic` — Δ: between two landmarks, by their places among them, counts²
    /// * `n_dims_max` — d, or the most dimensions wanted when `at_least` is smaller
    /// * `at_least` — fewer positive eigenvalues than this are an error
    ///
    /// An eigenvector's sign is free; here its entry of largest magnitude is positive, so that equal input gives equal
    /// output. O(n_landmarks² · n_dims_max) for some tens of products with B, and up to a thousand landmarks O(n_landmarks³)
    /// for the eigenvalues, on the threads of whoever calls. Holds half a n_landmarks² matrix.
    ///
    /// # Errors
    /// If fewer than `at_least` eigenvalues are positive.
    pub fn fit(
        n_landmarks: usize,
        squared_geodesic: impl Fn(usize, usize) -> f64 + Sync,
        n_dims_max: usize,
        at_least: usize,
    ) -> Result<(Self, Spectrum), MdsError> {
        if n_landmarks <= at_least {
            return Err(MdsError::TooFewLandmarks { n_landmarks, n_dims: at_least });
        }
        let (centred, mean_squared) = centre(n_landmarks, &squared_geodesic);
        let unknown = MdsError::NoEigenvalues { n_landmarks };
        let Eigen { values, vectors } = largest(&centred, n_dims_max).ok_or(unknown.clone())?;
        let limit = EIGENVALUE_SHARE_MIN * values[0].max(0.0);
        let n_positive = values.iter().take_while(|value| **value > limit).count();
        if n_positive < at_least {
            return Err(MdsError::TooFewDimensions { n_positive, n_dims: at_least, n_landmarks });
        }
        let n_dims = n_dims_max.min(n_positive);
        let mut projection = vec![0.0; n_landmarks * n_dims];
        for dim in 0..n_dims {
            let vector = vectors.col(dim);
            let largest = (0..n_landmarks)
                .map(|i| vector[i])
                .fold(0.0, |a: f64, b| if b.abs() > a.abs() { b } else { a });
            let factor = 0.5 * largest.signum() / values[dim].sqrt();
            for landmark in 0..n_landmarks {
                projection[landmark * n_dims + dim] = factor * vector[landmark];
            }
        }
        let n_all = n_landmarks.min(N_ALL_VALUES_MAX);
        let place = |i: usize| i * n_landmarks / n_all;
        let among = match n_all == n_landmarks {
            true => centred,
            false => centre(n_all, |i, j| squared_geodesic(place(i), place(j))).0,
        };
        let all = all_values(among.dense().as_ref()).ok_or(unknown)?;
        let negative_share = negative_share(&all);
        let eigenvalues = if n_all == n_landmarks { all } else { values };
        let embedding =
            Self { n_dims, projection: projection.into(), mean_squared_geodesics: mean_squared.into() };
        Ok((embedding, Spectrum { eigenvalues, negative_share }))
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
        self.embed_with(Instructions::widest(), squared_geodesics, coordinates);
    }

    fn embed_with(&self, instructions: Instructions, squared_geodesics: &[f64], coordinates: &mut [f64]) {
        instructions.run(
            #[inline(always)]
            || match self.n_dims {
                1 => self.embed_by::<1>(squared_geodesics, coordinates),
                2..4 => self.embed_by::<2>(squared_geodesics, coordinates),
                4..8 => self.embed_by::<4>(squared_geodesics, coordinates),
                _ => self.embed_by::<8>(squared_geodesics, coordinates),
            },
        );
    }

    /// So many coordinates at once, whose sums stay in registers. Where these do not divide the dimensions, the last overlap
    /// those before, and are summed again to the same.
    #[inline(always)]
    fn embed_by<const W: usize>(&self, squared_geodesics: &[f64], coordinates: &mut [f64]) {
        for first in (0..self.n_dims).step_by(W).map(|first| first.min(self.n_dims - W)) {
            let mut sums = [0.0; W];
            let rows = self.projection.chunks_exact(self.n_dims);
            for ((row, mean), delta) in rows.zip(self.mean_squared_geodesics.iter()).zip(squared_geodesics) {
                let weights: &[f64; W] = row[first..first + W].try_into().expect("of this length");
                let difference = mean - delta;
                for dim in 0..W {
                    sums[dim] += weights[dim] * difference;
                }
            }
            coordinates[first..first + W].copy_from_slice(&sums);
        }
    }
}

/// B = −½ H Δ H and δ̄, the means of Δ's columns.
pub(crate) fn centre(
    n_landmarks: usize,
    squared_geodesic: impl Fn(usize, usize) -> f64 + Sync,
) -> (Symmetric, Vec<f64>) {
    let n = n_landmarks as f64;
    let column_mean = |j| (0..n_landmarks).map(|i| squared_geodesic(j, i)).sum::<f64>() / n;
    let means: Vec<f64> = (0..n_landmarks).into_par_iter().map(column_mean).collect();
    let grand_mean = means.iter().sum::<f64>() / n;
    let centred = Symmetric::from_fn(n_landmarks, |i, j| {
        // Written so that (i, j) and (j, i) round alike.
        let delta = 0.5 * (squared_geodesic(i, j) + squared_geodesic(j, i));
        -0.5 * (delta - (means[i] + means[j]) + grand_mean)
    });
    (centred, means)
}

fn negative_share(eigenvalues: &[f64]) -> f64 {
    let magnitude: f64 = eigenvalues.iter().map(|value| value.abs()).sum();
    let negative: f64 = eigenvalues.iter().map(|value| (-value).max(0.0)).sum();
    if magnitude > 0.0 { negative / magnitude } else { 0.0 }
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
        let (embedding, spectrum) = Embedding::fit(5, |i, j| delta[5 * i + j], 2, 2).unwrap();
        let mut places = [[0.0; 2]; 5];
        for (place, row) in places.iter_mut().zip(delta.chunks_exact(5)) {
            embedding.embed(row, place);
        }
        for (found, expected) in squared_distances(&places).iter().zip(&delta) {
            assert!((found - expected).abs() < 1e-12, "{found} {expected}");
        }
        assert!(spectrum.eigenvalues[2].abs() < 1e-12);
        let message = Embedding::fit(5, |i, j| delta[5 * i + j], 3, 3).unwrap_err().to_string();
        assert_eq!(
            message,
            "the 5 landmarks span 2 dimensions and 3 were asked for: their frames are too much alike; ask for fewer \
             dimensions or record a trip that sees more"
        );
    }

    #[test]
    fn every_set_of_instructions_embeds_to_the_bits_of_the_printed_sum() {
        for n_dims in 1..=32 {
            let n_landmarks = 40;
            let number = |index: usize| (index as f64 * 0.7).sin() * 1e3;
            let embedding = Embedding::from_parts(
                n_dims,
                (0..n_landmarks * n_dims).map(number).collect::<Vec<_>>().into(),
                (0..n_landmarks).map(|landmark| number(landmark + 7)).collect::<Vec<_>>().into(),
            )
            .unwrap();
            let delta: Vec<f64> = (0..n_landmarks).map(|landmark| number(3 * landmark)).collect();
            for instructions in Instructions::all() {
                let mut place = vec![f64::NAN; n_dims];
                embedding.embed_with(instructions, &delta, &mut place);
                for (dim, found) in place.iter().enumerate() {
                    let rows = embedding.projection().chunks_exact(n_dims);
                    let differences = embedding.mean_squared_geodesics().iter().zip(&delta);
                    let terms = rows.zip(differences).map(|(row, (mean, delta))| row[dim] * (mean - delta));
                    let expected = terms.fold(0.0, |sum, term| sum + term);
                    assert_eq!(found.to_bits(), f64::to_bits(expected), "{instructions:?} {dim} of {n_dims}");
                }
            }
        }
    }

    #[test]
    fn a_landmark_lands_at_the_root_of_the_eigenvalue_times_its_eigenvector_entry() {
        // √λ_k V_ik = 2 λ_k P_ik: the in-sample coordinates of classical scaling.
        let delta = squared_distances(&POINTS);
        let (embedding, spectrum) = Embedding::fit(5, |i, j| delta[5 * i + j], 2, 2).unwrap();
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
        let refuse = |n_dims| Embedding::fit(3, |_, _| 0.0, n_dims, n_dims).unwrap_err().to_string();
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
