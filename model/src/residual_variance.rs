//! Residual variance: how much of the geodesics an embedding of d dimensions leaves unexplained, and how many dimensions
//! that speaks for.

use rayon::prelude::*;

use crate::simd::Instructions;

/// Frames whose pairs are summed by one thread at a time. Fixed, so that sums do not depend on the number of threads.
const N_FRAMES_AT_A_TIME: usize = 64;

/// Dimensions that residual variance is computed for.
pub const N_DIMS_REPORTED: usize = 30;

/// Dimensions kept beyond the elbow of the residual variance. What lies there is little, but not all of it is noise.
pub const N_DIMS_BEYOND_ELBOW: usize = 2;

/// How near the least residual variance is near enough: a hundredth of the geodesics' variance, about what the bends of a
/// graph of a thousand frames hide anyway.
pub const TOLERANCE: f64 = 0.01;

/// Computes `1 − R²` between geodesics and embedded distances, for every number of dimensions up to `n_dims`.
///
/// Tenenbaum, de Silva & Langford 2000, *A global geometric framework for nonlinear dimensionality reduction*, note 42,
/// over all pairs of a landmark and another frame.
///
/// * `coordinates` — of all frames, shape `(n_frames, n_dims)`
/// * `landmarks` — their frame indices, shape `(n_landmarks,)`
/// * `geodesic` — length from a frame (by index) to a landmark (by place in `landmarks`)
///
/// Returns shape `(n_dims,)`, each in 0…1. O(n_frames · n_landmarks · n_dims), on the threads of whoever calls.
pub fn residual_variance(
    coordinates: &[f64],
    n_dims: usize,
    landmarks: &[u32],
    geodesic: impl Fn(usize, usize) -> f64 + Sync,
) -> Vec<f64> {
    let of_some = |(some, places): (usize, &[f64])| {
        let mut moments = Moments::new(n_dims);
        for (index, frame) in places.chunks_exact(n_dims).enumerate() {
            let frame_index = some * N_FRAMES_AT_A_TIME + index;
            Instructions::widest().run(
                #[inline(always)]
                || {
                    for (lane, &landmark) in landmarks.iter().enumerate() {
                        if landmark as usize != frame_index {
                            let other = &coordinates[landmark as usize * n_dims..][..n_dims];
                            moments.add(geodesic(frame_index, lane), frame, other);
                        }
                    }
                },
            );
        }
        moments
    };
    let parts: Vec<Moments> =
        coordinates.par_chunks(N_FRAMES_AT_A_TIME * n_dims).enumerate().map(of_some).collect();
    let mut all = Moments::new(n_dims);
    parts.iter().for_each(|part| all.merge(part));
    all.residual_variance()
}

/// Where the curve of residual variances bends, in dimensions: more of them explain little more.
///
/// Satopää, Albrecht, Irwin & Raghavan 2011, *Finding a "kneedle" in a haystack*, for a falling convex curve without
/// smoothing: with both axes scaled to 0…1, the point farthest below the line from the curve's beginning to its end,
/// the largest `1 − x − y`. 1 where the curve does not fall.
///
/// * `residual_variances` — of 1, 2, … dimensions, at least one
pub fn elbow(residual_variances: &[f64]) -> usize {
    let lowest = residual_variances.iter().copied().fold(f64::INFINITY, f64::min);
    let highest = residual_variances.iter().copied().fold(f64::NEG_INFINITY, f64::max);
    let last = residual_variances.len() - 1;
    if last == 0 || highest <= lowest {
        return 1;
    }
    let below = |index: usize| {
        1.0 - index as f64 / last as f64 - (residual_variances[index] - lowest) / (highest - lowest)
    };
    1 + (1..=last).fold(0, |best, index| if below(index) > below(best) { index } else { best })
}

/// The fewest dimensions whose residual variance is within [`TOLERANCE`] of the least: a second opinion beside the elbow,
/// which asks only for the curve's shape and not for what is left.
///
/// * `residual_variances` — of 1, 2, … dimensions, at least one
pub fn fewest_within_tolerance(residual_variances: &[f64]) -> usize {
    let least = residual_variances.iter().copied().fold(f64::INFINITY, f64::min);
    1 + residual_variances.iter().take_while(|share| **share > least + TOLERANCE).count()
}

/// Running means and co-moments of geodesics x and embedded distances y (Welford's update: no cancellation over millions
/// of pairs). Dimension by dimension in arrays, so that the compiler takes several at once.
struct Moments {
    n: f64,
    mean_x: f64,
    xx: f64,
    /// Of this pair, in 1, 2, … dimensions.
    y: Vec<f64>,
    mean_y: Vec<f64>,
    yy: Vec<f64>,
    xy: Vec<f64>,
}

impl Moments {
    fn new(n_dims: usize) -> Self {
        let zeros = || vec![0.0; n_dims];
        Self { n: 0.0, mean_x: 0.0, xx: 0.0, y: zeros(), mean_y: zeros(), yy: zeros(), xy: zeros() }
    }

    /// Inlined, so that it is compiled for the instructions of whoever calls.
    #[inline(always)]
    fn add(&mut self, x: f64, frame: &[f64], other: &[f64]) {
        self.n += 1.0;
        let share = 1.0 / self.n;
        let dx = x - self.mean_x;
        self.mean_x += dx * share;
        self.xx += dx * (x - self.mean_x);
        let mut squared = 0.0;
        for ((a, b), y) in frame.iter().zip(other).zip(&mut self.y) {
            squared += (a - b) * (a - b);
            *y = squared;
        }
        let moments = self.mean_y.iter_mut().zip(&mut self.yy).zip(&mut self.xy);
        for (squared, ((mean, yy), xy)) in self.y.iter().zip(moments) {
            let y = squared.sqrt();
            let dy = y - *mean;
            *mean += dy * share;
            *yy += dy * (y - *mean);
            *xy += dx * (y - *mean);
        }
    }

    /// Takes in the pairs of another: Chan, Golub & LeVeque 1979, *Updating formulae and a pairwise algorithm for computing
    /// sample variances*, eq. (2.1).
    fn merge(&mut self, other: &Self) {
        let n = self.n + other.n;
        if n == 0.0 {
            return;
        }
        let (share, weight) = (other.n / n, self.n * other.n / n);
        let dx = other.mean_x - self.mean_x;
        self.n = n;
        self.mean_x += dx * share;
        self.xx += other.xx + dx * dx * weight;
        for dim in 0..self.y.len() {
            let dy = other.mean_y[dim] - self.mean_y[dim];
            self.mean_y[dim] += dy * share;
            self.yy[dim] += other.yy[dim] + dy * dy * weight;
            self.xy[dim] += other.xy[dim] + dx * dy * weight;
        }
    }

    fn residual_variance(&self) -> Vec<f64> {
        // Nothing is explained where one side does not vary.
        let r_squared = |(yy, xy): (&f64, &f64)| {
            let product = self.xx * yy;
            if product > 0.0 { (xy * xy / product).min(1.0) } else { 0.0 }
        };
        self.yy.iter().zip(&self.xy).map(|moments| 1.0 - r_squared(moments)).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_elbow_is_farthest_below_the_line_from_beginning_to_end() {
        // Below the line from (0, 1) to (1, 0): 0, .35, .483, .25, 0.
        assert_eq!(elbow(&[0.8, 0.4, 0.08, 0.06, 0.05]), 3);
        // A straight fall has none: all are on the line.
        assert_eq!(elbow(&[1.0, 0.75, 0.5, 0.25, 0.0]), 1);
        assert_eq!(elbow(&[0.3]), 1);
        assert_eq!(elbow(&[0.3, 0.3, 0.3]), 1);
        // The end may rise a little, as with geodesics that fit into no Euclidean space.
        assert_eq!(elbow(&[0.5, 0.1, 0.01, 0.02, 0.03]), 2);
    }

    #[test]
    fn the_fewest_dimensions_within_the_tolerance_leave_at_most_a_hundredth_more_than_the_best() {
        assert_eq!(fewest_within_tolerance(&[0.8, 0.4, 0.058, 0.052, 0.05, 0.055]), 3);
        assert_eq!(fewest_within_tolerance(&[0.8, 0.4, 0.061, 0.052, 0.05, 0.055]), 4);
        assert_eq!(fewest_within_tolerance(&[0.3]), 1);
    }

    #[test]
    fn many_frames_at_a_time_have_the_correlation_of_the_printed_formula() {
        let n_frames = 3 * N_FRAMES_AT_A_TIME + 5;
        let place = |index: usize| [(index * index % 101) as f64, (index * 37 % 89) as f64];
        let coordinates: Vec<f64> = (0..n_frames).flat_map(place).collect();
        let landmarks = [3, 70, 150];
        let length = |frame: usize, lane: usize| ((frame + 13) * (lane + 5) % 97) as f64;
        let found = residual_variance(&coordinates, 2, &landmarks, length);

        let pairs: Vec<(f64, f64)> = (0..n_frames)
            .flat_map(|frame| {
                landmarks.iter().enumerate().map(move |(lane, &landmark)| (frame, lane, landmark))
            })
            .filter(|&(frame, _, landmark)| frame != landmark as usize)
            .map(|(frame, lane, landmark)| {
                let (a, b) = (place(frame), place(landmark as usize));
                (length(frame, lane), (a[0] - b[0]).hypot(a[1] - b[1]))
            })
            .collect();
        let mean = |of: fn(&(f64, f64)) -> f64| pairs.iter().map(of).sum::<f64>() / pairs.len() as f64;
        let (x, y) = (mean(|pair| pair.0), mean(|pair| pair.1));
        let moment =
            |of: &dyn Fn(f64, f64) -> f64| pairs.iter().map(|pair| of(pair.0 - x, pair.1 - y)).sum::<f64>();
        let (xx, yy, xy) = (moment(&|a, _| a * a), moment(&|_, b| b * b), moment(&|a, b| a * b));
        assert!((found[1] - (1.0 - xy * xy / (xx * yy))).abs() < 1e-12, "{found:?}");
    }

    #[test]
    fn distances_that_the_embedding_keeps_leave_nothing_unexplained() {
        let coordinates = [0.0, 0.0, 3.0, 4.0, 6.0, 1.0];
        let lengths = [[0.0, 5.0], [5.0, 0.0], [37.0_f64.sqrt(), 18.0_f64.sqrt()]];
        let residual = residual_variance(&coordinates, 2, &[0, 1], |frame, lane| lengths[frame][lane]);
        assert!(residual[1].abs() < 1e-15, "{residual:?}");
        assert!(residual[0] > 0.01, "one dimension cannot keep them: {residual:?}");
    }
}
