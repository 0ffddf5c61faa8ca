//! What is believed of one kind of a Dirichlet process, and how the stick is divided among kinds.

use std::f64::consts::LN_2;

use nalgebra::DMatrix;

use super::{CONCENTRATION, N_FRAMES_OF_MEAN};

/// What is believed of one kind: its weight, and a normal-Wishart distribution of its mean and precision.
pub(super) struct Kind {
    /// n_j: independent frames.
    pub(super) n_frames: f64,
    /// m_j, counts. Worth β_j = β₀ + n_j frames.
    pub(super) mean: Vec<f64>,
    /// ν_j.
    pub(super) degrees_of_freedom: f64,
    /// W_j⁻¹, counts².
    pub(super) scatter: DMatrix<f64>,
    /// E α_j.
    pub(super) weight: f64,
    /// E ln α_j.
    log_weight: f64,
}

impl Kind {
    /// A kind whose piece of the stick is not yet broken off.
    pub(super) fn new(n_frames: f64, mean: Vec<f64>, degrees_of_freedom: f64, scatter: DMatrix<f64>) -> Self {
        Self { n_frames, mean, degrees_of_freedom, scatter, weight: 0.0, log_weight: 0.0 }
    }

    fn n_frames_of_mean(&self) -> f64 {
        N_FRAMES_OF_MEAN + self.n_frames
    }

    pub(super) fn log_normaliser(&self) -> f64 {
        log_normaliser(self.n_frames_of_mean(), self.degrees_of_freedom, &self.scatter)
    }

    /// ln of the weight with which one Gaussian, of the expected mean and covariance, says of frames what all those that are
    /// believed in say on average: Bishop 2006, eqs. (10.46), (10.64) and (10.65).
    pub(super) fn log_weight_of_gaussian(&self) -> f64 {
        let half_degrees = 0.5 * self.degrees_of_freedom;
        let narrower: f64 = (0..self.mean.len())
            .map(|dim| digamma(half_degrees - 0.5 * dim as f64) - half_degrees.ln())
            .sum();
        self.log_weight + 0.5 * (narrower - self.mean.len() as f64 / self.n_frames_of_mean())
    }
}

/// ln of what a normal-Wishart distribution is divided by, but for a constant: Bishop 2006, eq. (B.79).
pub(super) fn log_normaliser(n_frames_of_mean: f64, degrees_of_freedom: f64, scatter: &DMatrix<f64>) -> f64 {
    let n_dims = scatter.nrows();
    let cholesky = scatter.clone().cholesky().expect("the prior has volume, and frames only add to it");
    let log_gammas: f64 = (0..n_dims).map(|dim| libm::lgamma(0.5 * (degrees_of_freedom - dim as f64))).sum();
    let of_mean = n_dims as f64 * n_frames_of_mean.ln();
    0.5 * (degrees_of_freedom * (n_dims as f64 * LN_2 - cholesky.ln_determinant()) - of_mean) + log_gammas
}

/// Breaks a piece off the stick for each kind in turn, and returns what that adds to the bound: Blei & Jordan 2006,
/// sec. 3.2.
pub(super) fn break_stick(kinds: &mut [Kind]) -> f64 {
    let (mut left, mut log_left, mut gain) = (1.0, 0.0, 0.0);
    for index in 0..kinds.len() {
        let n_frames_after: f64 = kinds[index + 1..].iter().map(|kind| kind.n_frames).sum();
        let kind = &mut kinds[index];
        let (a, b) = (1.0 + kind.n_frames, CONCENTRATION + n_frames_after);
        kind.weight = left * a / (a + b);
        kind.log_weight = log_left + digamma(a) - digamma(a + b);
        left *= b / (a + b);
        log_left += digamma(b) - digamma(a + b);
        gain += log_beta(a, b) - log_beta(1.0, CONCENTRATION);
    }
    gain
}

fn log_beta(a: f64, b: f64) -> f64 {
    libm::lgamma(a) + libm::lgamma(b) - libm::lgamma(a + b)
}

/// ψ(x) for x above 0: Abramowitz & Stegun 1964, *Handbook of mathematical functions*, eqs. (6.3.5) and (6.3.18). Beyond 10
/// the first term that is left out is 8e-16.
fn digamma(x: f64) -> f64 {
    /// Of x⁻², x⁻⁴, …
    const SERIES: [f64; 6] =
        [1.0 / 12.0, -1.0 / 120.0, 1.0 / 252.0, -1.0 / 240.0, 1.0 / 132.0, -691.0 / 32760.0];
    let (mut x, mut below) = (x, 0.0);
    while x < 10.0 {
        below += 1.0 / x;
        x += 1.0;
    }
    let square = 1.0 / (x * x);
    let beyond = SERIES.iter().rev().fold(0.0, |sum, term| square * (term + sum));
    libm::log(x) - 0.5 / x - beyond - below
}

#[cfg(test)]
mod tests {
    use std::f64::consts::PI;

    use super::*;

    #[test]
    fn digamma_has_its_known_values_and_recurrence() {
        const EULER: f64 = 0.577_215_664_901_532_9;
        let check = |x: f64, expected: f64| {
            let found = digamma(x);
            assert!(
                (found - expected).abs() < 2e-14 * expected.abs().max(1.0),
                "{x}: {found} instead of {expected}"
            );
        };
        check(1.0, -EULER);
        check(0.5, -EULER - 2.0 * LN_2);
        check(0.25, -EULER - 0.5 * PI - 3.0 * LN_2);
        for x in [0.3, 2.7, 9.5, 10.0, 40.0, 1e6] {
            check(x + 1.0, digamma(x) + 1.0 / x);
        }
    }

    /// Pieces in the order given, by the formula that is printed.
    fn gain(n_frames: &[f64]) -> f64 {
        let kind = |&n_frames: &f64| Kind::new(n_frames, vec![0.0], 1.0, DMatrix::identity(1, 1));
        break_stick(&mut n_frames.iter().map(kind).collect::<Vec<_>>())
    }

    #[test]
    fn no_order_of_kinds_is_likelier_than_the_falling_one() {
        let falling = gain(&[31.0, 8.5, 2.0, 0.0]);
        for other in
            [[8.5, 31.0, 2.0, 0.0], [31.0, 2.0, 8.5, 0.0], [0.0, 31.0, 8.5, 2.0], [31.0, 8.5, 0.0, 2.0]]
        {
            assert!(gain(&other) < falling, "{other:?}");
        }
    }

    #[test]
    fn pieces_of_the_stick_are_its_expected_ones() {
        let mut kinds: Vec<Kind> =
            [6.0, 3.0].map(|n_frames| Kind::new(n_frames, vec![0.0], 1.0, DMatrix::identity(1, 1))).into();
        break_stick(&mut kinds);
        // Beta(7, 4), and of the rest Beta(4, 1).
        let expected = [7.0 / 11.0, 4.0 / 11.0 * 4.0 / 5.0];
        for (kind, expected) in kinds.iter().zip(expected) {
            assert!((kind.weight - expected).abs() < 1e-15, "{} instead of {expected}", kind.weight);
        }
    }
}
