//! What shape the kinds may have, and the likeliest covariances of that shape.
//!
//! Given the scatter S_j of each kind, a mixture's expected log-likelihood is, but for a constant,
//! `−½ Σ_j n_j (ln det Σ_j + tr Σ_j⁻¹ S_j)` with n_j = N α_j (McLachlan & Peel 2000, *Finite mixture models*, ch. 3). Its
//! maximum among covariances of a shape whose eigenvalues are no less than a floor:
//!
//! | shape | Σ_j | free parameters |
//! |---|---|---|
//! | full | S_j, its eigenvalues below the floor raised to it | J d (d + 1) / 2 |
//! | tied | the same of Σ α_j S_j | d (d + 1) / 2 |
//! | diagonal | the diagonal of S_j, its entries raised likewise | J d |
//! | spherical | (tr S_j / d) I, raised likewise | J |
//!
//! Raising is the maximum and not a repair, because along each eigenvector `ln λ + s / λ` rises from λ = s on. Hence the
//! log-likelihood never decreases, which adding a constant to the diagonal would not guarantee.

use std::fmt;

use nalgebra::DMatrix;
use serde::{Deserialize, Serialize};

/// What shape the kinds may have.
///
/// Models hold full matrices whatever the shape, and serve alike.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum Covariance {
    /// Each kind any ellipsoid.
    #[serde(alias = "full")]
    Full,
    /// All kinds one ellipsoid.
    #[serde(alias = "tied")]
    Tied,
    /// Each kind an ellipsoid along the dimensions.
    #[serde(alias = "diagonal")]
    Diagonal,
    /// Each kind a ball.
    #[serde(alias = "spherical")]
    Spherical,
}

impl fmt::Display for Covariance {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Full => "full",
            Self::Tied => "tied",
            Self::Diagonal => "diagonal",
            Self::Spherical => "spherical",
        })
    }
}

impl Covariance {
    /// κ: free parameters of a mixture, which are J − 1 weights, J d means, and the covariances.
    pub fn n_parameters(self, n_kinds: usize, n_dims: usize) -> usize {
        let n_of_one = n_dims * (n_dims + 1) / 2;
        let n_of_covariances = match self {
            Self::Full => n_kinds * n_of_one,
            Self::Tied => n_of_one,
            Self::Diagonal => n_kinds * n_dims,
            Self::Spherical => n_kinds,
        };
        (n_kinds - 1) + n_kinds * n_dims + n_of_covariances
    }
}

/// What covariances are chosen from.
#[derive(Clone, Copy)]
pub(super) struct Constraint {
    pub(super) covariance: Covariance,
    /// Least eigenvalue, counts².
    pub(super) floor: f64,
}

impl Constraint {
    /// The likeliest covariances.
    ///
    /// * `weights` — α, shape `(n_kinds,)`
    /// * `scatters` — S, one for each kind, counts²
    pub(super) fn likeliest(self, weights: &[f64], scatters: Vec<DMatrix<f64>>) -> Vec<DMatrix<f64>> {
        let floor = self.floor;
        match self.covariance {
            Covariance::Full => scatters.into_iter().map(|scatter| raise_to_floor(scatter, floor)).collect(),
            Covariance::Tied => {
                let n_kinds = scatters.len();
                let weighted = scatters.into_iter().zip(weights).map(|(scatter, weight)| scatter * *weight);
                let within = weighted.reduce(|sum, next| sum + next);
                within.map_or(Vec::new(), |within| vec![raise_to_floor(within, floor); n_kinds])
            }
            Covariance::Diagonal => {
                let along = |scatter: DMatrix<f64>| scatter.diagonal().map(|variance| variance.max(floor));
                scatters.into_iter().map(|scatter| DMatrix::from_diagonal(&along(scatter))).collect()
            }
            Covariance::Spherical => {
                let ball = |scatter: DMatrix<f64>| {
                    let n_dims = scatter.nrows();
                    DMatrix::from_diagonal_element(
                        n_dims,
                        n_dims,
                        (scatter.trace() / n_dims as f64).max(floor),
                    )
                };
                scatters.into_iter().map(ball).collect()
            }
        }
    }
}

/// The scatter with eigenvalues below the floor raised to it.
pub(super) fn raise_to_floor(scatter: DMatrix<f64>, floor: f64) -> DMatrix<f64> {
    let eigen = scatter.clone().symmetric_eigen();
    if eigen.eigenvalues.iter().all(|value| *value >= floor) {
        return scatter;
    }
    let raised = DMatrix::from_diagonal(&eigen.eigenvalues.map(|value| value.max(floor)));
    let raised = &eigen.eigenvectors * raised * eigen.eigenvectors.transpose();
    // The product is symmetric but for rounding.
    (&raised + raised.transpose()) * 0.5
}

#[cfg(test)]
pub(super) mod tests {
    use proptest::prelude::*;

    use super::*;

    pub(in super::super) const ALL: [Covariance; 4] =
        [Covariance::Full, Covariance::Tied, Covariance::Diagonal, Covariance::Spherical];

    #[test]
    fn free_parameters_are_weights_means_and_covariances() {
        // Three kinds in four dimensions: two weights, twelve means, and 30, 10, 12 or 3.
        assert_eq!(ALL.map(|covariance| covariance.n_parameters(3, 4)), [44, 24, 26, 17]);
        // One dimension leaves no shapes but the tied one.
        assert_eq!(ALL.map(|covariance| covariance.n_parameters(2, 1)), [5, 4, 5, 5]);
    }

    /// Any covariance of a shape that keeps to the floor, made of numbers as they come.
    fn other(covariance: Covariance, floor: f64, numbers: &[[f64; 9]]) -> Vec<DMatrix<f64>> {
        let square = |numbers: &[f64; 9]| {
            let root = DMatrix::from_row_slice(3, 3, numbers);
            &root * root.transpose() + DMatrix::from_diagonal_element(3, 3, floor)
        };
        let diagonal = |matrix: DMatrix<f64>| DMatrix::from_diagonal(&matrix.diagonal());
        let of_one = |kind: usize| match covariance {
            Covariance::Full => square(&numbers[kind]),
            Covariance::Tied => square(&numbers[0]),
            Covariance::Diagonal => diagonal(square(&numbers[kind])),
            Covariance::Spherical => {
                DMatrix::from_diagonal_element(3, 3, floor + numbers[kind][0] * numbers[kind][0])
            }
        };
        (0..numbers.len()).map(of_one).collect()
    }

    /// `Σ_j α_j (ln det Σ_j + tr Σ_j⁻¹ S_j)`: lower is likelier.
    fn cost(weights: &[f64], covariances: &[DMatrix<f64>], scatters: &[DMatrix<f64>]) -> f64 {
        let of_one = |((weight, covariance), scatter): ((&f64, &DMatrix<f64>), &DMatrix<f64>)| {
            let inverse = covariance.clone().try_inverse().unwrap();
            weight * (covariance.determinant().ln() + (inverse * scatter).trace())
        };
        weights.iter().zip(covariances).zip(scatters).map(of_one).sum()
    }

    proptest! {
        #[test]
        fn no_other_covariances_of_the_shape_above_the_floor_are_likelier(
            roots in prop::array::uniform2(prop::array::uniform9(-2.0..2.0_f64)),
            others in prop::array::uniform2(prop::array::uniform9(-2.0..2.0_f64)),
            near in 0.0..1.0_f64,
            weight in 0.1..0.9_f64,
            floor in 0.01..3.0_f64,
        ) {
            let weights = [weight, 1.0 - weight];
            let scatters = roots.map(|root| {
                let root = DMatrix::from_row_slice(3, 3, &root);
                &root * root.transpose()
            });
            for covariance in ALL {
                let best = Constraint { covariance, floor }.likeliest(&weights, scatters.to_vec());
                for matrix in &best {
                    prop_assert!(matrix.symmetric_eigenvalues().min() >= floor * (1.0 - 1e-9));
                }
                let least = cost(&weights, &best, &scatters);
                // Far away, and close by: all these sets are convex.
                let far = other(covariance, floor, &others);
                let close: Vec<DMatrix<f64>> =
                    best.iter().zip(&far).map(|(best, far)| best * (1.0 - near) + far * near).collect();
                for other in [far, close] {
                    let found = cost(&weights, &other, &scatters);
                    prop_assert!(found >= least - 1e-9 * least.abs().max(1.0), "{covariance:?}: {found} < {least}");
                }
            }
        }
    }
}
