//! Whether the commands given within one kind are of two sorts.
//!
//! Two Gaussians are fitted beside one, and believed only if all of this holds:
//! 1. There are at least [`N_EFFECTIVE_MIN`] independent frames, and BIC prefers them by [`BIC_GAIN_MIN`] (Kass & Raftery 1995, *Bayes factors*: "very strong"), for as many frames as
//!    are independent: a stick held still for a hundred frames was moved once.
//! 2. Each has [`SHARE_MIN`] of the frames.
//! 3. There is a valley between them: along the ridge on which all modes of two Gaussians lie (Ray & Lindsay 2005, *The
//!    topography of multivariate normal mixtures*, eq. (4)), density falls to [`VALLEY_MAX`] of the lower peak. BIC alone
//!    takes skewed, even and heavy-tailed commands for two Gaussians, and so does Ashman's D > 2 (Ashman, Bird & Zepf
//!    1994, *Detecting bimodality in astronomical datasets*): two Gaussians fitted to evenly spread numbers have D = 3.3,
//!    and half of the peak's density between them.
//! 4. They are [`DISTANCE_MIN`] deviations of all commands apart: less makes no difference to the robot.
//!
//! Two sorts are all that is looked for: of three, two are told as one.

use kinds_model::autocorrelation::n_frames_effective;
use kinds_model::em::fit_mixture;
use kinds_model::mixture::{Mixture, most_probable};
use kinds_model::{Covariance, EmPlan};

/// Fewest independent frames. Two Gaussians on a plane have 11 parameters: of fewer frames than twice as many, gaps that are
/// there by chance alone were taken for valleys.
const N_EFFECTIVE_MIN: f64 = 20.0;

/// By how much two Gaussians' BIC must be lower than one's.
const BIC_GAIN_MIN: f64 = 10.0;

/// Least share of the frames of each sort.
const SHARE_MIN: f64 = 0.15;

/// Most density between two sorts, as a share of the lower peak.
const VALLEY_MAX: f64 = 0.1;

/// Least distance between two sorts, in deviations of all commands.
const DISTANCE_MIN: f64 = 0.5;

/// Least variance of a sort as a share of that of the kind's commands. Commands from a keyboard have no spread at all, and
/// a Gaussian as narrow as their rounding would be as likely as one pleases.
const COVARIANCE_FLOOR: f64 = 0.02;

/// Places along the ridge at which density is looked at.
const N_RIDGE: usize = 200;

/// The sort of every frame, 0 or 1, if there are two.
///
/// * `points` — commands, each component in deviations of all commands, shape `(n_frames, 2)`
/// * `n_effective` — frames that are as good as independent
pub(super) fn two_modes(points: &[f64], n_effective: f64, seed: u64) -> Option<Vec<usize>> {
    let n_frames = points.len() / 2;
    let plan = EmPlan {
        covariance: Covariance::Full,
        covariance_floor: COVARIANCE_FLOOR,
        // Two Gaussians on a plane are found within a few starts.
        n_starts: 6,
        n_iterations_max: 300,
        ..EmPlan::new(seed)
    };
    // Commands that never change, or too few of them, are of one sort.
    let fit = |n_modes| fit_mixture(points, 2, n_modes, &plan, &mut |_| ()).ok();
    let (one, two) = (fit(1)?, fit(2)?);
    let bic = |log_likelihood: f64, n_parameters: f64| {
        -2.0 * n_effective / n_frames as f64 * log_likelihood + n_parameters * n_effective.ln()
    };
    let gain = bic(one.log_likelihood(), 5.0) - bic(two.log_likelihood(), 11.0);
    let modes = of_frames(&two.mixture, points);
    let share_of_second = modes.iter().sum::<usize>() as f64 / n_frames as f64;
    let is_believed = n_effective >= N_EFFECTIVE_MIN
        && gain >= BIC_GAIN_MIN
        && (SHARE_MIN..=1.0 - SHARE_MIN).contains(&share_of_second)
        && distance(&two.mixture) >= DISTANCE_MIN
        && valley(&two.mixture) <= VALLEY_MAX;
    is_believed.then_some(modes)
}

/// Frames of a kind whose commands are as good as independent of each other.
///
/// Of two ways of counting the lesser. Frames that follow each other without a break are alike; but where the kind
/// flickers, so are those before and after another kind's: a trip's frames of the kind, put one after the other, show that.
///
/// * `points` — commands, shape `(n_frames, 2)`
/// * `stretches`, `trips` — frames of each unbroken stretch and of each trip, in their order
pub(super) fn n_independent(points: &[f64], stretches: &[usize], trips: &[usize]) -> f64 {
    let along = along_principal_axis(points);
    let counted = |parts| n_frames_effective(&along, 1, parts);
    // It counts for squares; a command that is held throughout a visit would be worth two. Where sorts lie is a matter of means,
    // for which there are half as many ([`kinds_model::autocorrelation`]).
    let n_of_squares = counted(stretches).min(counted(trips));
    if n_of_squares < along.len() as f64 { (n_of_squares / 2.0).max(1.0) } else { n_of_squares }
}

/// Where commands lie along the direction in which they differ most: there two sorts are apart, if there are two. Across it,
/// the trembling of a hand would pass for steering.
fn along_principal_axis(points: &[f64]) -> Vec<f64> {
    let n_frames = (points.len() / 2) as f64;
    let places = || points.chunks_exact(2).map(|point| (point[0], point[1]));
    let (x, y) = places().fold((0.0, 0.0), |(x, y), point| (x + point.0 / n_frames, y + point.1 / n_frames));
    let sum = |of: fn(f64, f64) -> f64| places().map(|point| of(point.0 - x, point.1 - y)).sum::<f64>();
    let (xx, xy, yy) = (sum(|x, _| x * x), sum(|x, y| x * y), sum(|_, y| y * y));
    let (sin, cos) = (0.5 * (2.0 * xy).atan2(xx - yy)).sin_cos();
    places().map(|point| cos * (point.0 - x) + sin * (point.1 - y)).collect()
}

fn of_frames(mixture: &Mixture, points: &[f64]) -> Vec<usize> {
    let mut probabilities = [0.0; 2];
    let of_frame = |place: &[f64]| {
        mixture.posterior(place, &mut probabilities);
        most_probable(&probabilities)
    };
    points.chunks_exact(2).map(of_frame).collect()
}

/// Distance between the means.
fn distance(mixture: &Mixture) -> f64 {
    let [ax, ay, bx, by] = mixture.means() else { unreachable!("two means in two dimensions") };
    (bx - ax).hypot(by - ay)
}

/// Least density between the two peaks, as a share of the lower one; 1 if there is one peak alone.
fn valley(mixture: &Mixture) -> f64 {
    let mut probabilities = [0.0; 2];
    let log_densities: Vec<f64> = (0..=N_RIDGE)
        .map(|index| mixture.posterior(&ridge(mixture, index as f64 / N_RIDGE as f64), &mut probabilities))
        .collect();
    let highest = |part: &[f64]| part.iter().copied().fold(f64::NEG_INFINITY, f64::max);
    let depth = |index: usize| {
        let (before, after) = (highest(&log_densities[..=index]), highest(&log_densities[index..]));
        log_densities[index] - before.min(after)
    };
    (0..=N_RIDGE).map(depth).fold(0.0, f64::min).exp()
}

/// A place on the ridge: `[(1 − a) Σ₀⁻¹ + a Σ₁⁻¹]⁻¹ [(1 − a) Σ₀⁻¹ μ₀ + a Σ₁⁻¹ μ₁]`.
fn ridge(mixture: &Mixture, a: f64) -> [f64; 2] {
    let (means, covariances) = (mixture.means(), mixture.covariances());
    let precision = |mode: usize| {
        let c = &covariances[4 * mode..][..4];
        let determinant = c[0] * c[3] - c[1] * c[2];
        [c[3] / determinant, -c[2] / determinant, c[0] / determinant]
    };
    let weights = [1.0 - a, a];
    let (mut p, mut q) = ([0.0; 3], [0.0; 2]);
    for mode in 0..2 {
        let [xx, xy, yy] = precision(mode).map(|entry| weights[mode] * entry);
        let (x, y) = (means[2 * mode], means[2 * mode + 1]);
        p = [p[0] + xx, p[1] + xy, p[2] + yy];
        q = [q[0] + xx * x + xy * y, q[1] + xy * x + yy * y];
    }
    let determinant = p[0] * p[2] - p[1] * p[1];
    [(p[2] * q[0] - p[1] * q[1]) / determinant, (p[0] * q[1] - p[1] * q[0]) / determinant]
}
