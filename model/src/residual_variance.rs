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
    fn distances_that_the_embedding_keeps_leave_nothing_unexplained() {
        let coordinates = [0.0, 0.0, 3.0, 4.0, 6.0, 1.0];
        let lengths = [[0.0, 5.0], [5.0, 0.0], [37.0_f64.sqrt(), 18.0_f64.sqrt()]];
        let residual = residual_variance(&coordinates, 2, &[0, 1], |frame, lane| lengths[frame][lane]);
        assert!(residual[1].abs() < 1e-15, "{residual:?}");
        assert!(residual[0] > 0.01, "one dimension cannot keep them: {residual:?}");
    }
}
