//! Residual variance: how much of the geodesics an embedding of d dimensions leaves unexplained.

/// Computes `1 − R²` between geodesics and embedded distances, for every number of dimensions up to `n_dims`.
///
/// Tenenbaum, de Silva & Langford 2000, *A global geometric framework for nonlinear dimensionality reduction*, note 42,
/// over all pairs of a landmark and another frame.
///
/// * `coordinates` — of all frames, shape `(n_frames, n_dims)`
/// * `landmarks` — their frame indices, shape `(n_landmarks,)`
/// * `geodesic` — length from a frame (by index) to a landmark (by place in `landmarks`)
///
/// Returns shape `(n_dims,)`, each in 0…1. O(n_frames · n_landmarks · n_dims).
pub fn residual_variance(
    coordinates: &[f64],
    n_dims: usize,
    landmarks: &[u32],
    geodesic: impl Fn(usize, usize) -> f64,
) -> Vec<f64> {
    let mut moments = vec![Moments::default(); n_dims];
    for (frame_index, frame) in coordinates.chunks_exact(n_dims).enumerate() {
        for (lane, &landmark) in
            landmarks.iter().enumerate().filter(|(_, landmark)| **landmark as usize != frame_index)
        {
            let other = &coordinates[landmark as usize * n_dims..][..n_dims];
            let length = geodesic(frame_index, lane);
            let mut squared = 0.0;
            for ((a, b), moments) in frame.iter().zip(other).zip(&mut moments) {
                squared += (a - b) * (a - b);
                moments.add(length, squared.sqrt());
            }
        }
    }
    moments.iter().map(|moments| 1.0 - moments.r_squared()).collect()
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

/// Running means and co-moments of pairs (Welford's update: no cancellation over millions of pairs).
#[derive(Clone, Default)]
struct Moments {
    n: f64,
    mean: (f64, f64),
    xx: f64,
    yy: f64,
    xy: f64,
}

impl Moments {
    fn add(&mut self, x: f64, y: f64) {
        self.n += 1.0;
        let (dx, dy) = (x - self.mean.0, y - self.mean.1);
        self.mean.0 += dx / self.n;
        self.mean.1 += dy / self.n;
        self.xx += dx * (x - self.mean.0);
        self.yy += dy * (y - self.mean.1);
        self.xy += dx * (y - self.mean.1);
    }

    /// 0 where one side does not vary: nothing is explained.
    fn r_squared(&self) -> f64 {
        let product = self.xx * self.yy;
        if product > 0.0 { (self.xy * self.xy / product).min(1.0) } else { 0.0 }
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
    fn distances_that_the_embedding_keeps_leave_nothing_unexplained() {
        let coordinates = [0.0, 0.0, 3.0, 4.0, 6.0, 1.0];
        let lengths = [[0.0, 5.0], [5.0, 0.0], [37.0_f64.sqrt(), 18.0_f64.sqrt()]];
        let residual = residual_variance(&coordinates, 2, &[0, 1], |frame, lane| lengths[frame][lane]);
        assert!(residual[1].abs() < 1e-15, "{residual:?}");
        assert!(residual[0] > 0.01, "one dimension cannot keep them: {residual:?}");
    }
}
