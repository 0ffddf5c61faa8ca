//! How many frames of a trip are as good as independent of each other.
//!
//! A robot moves little between two frames, so a trip of N frames says less than N looks at random places. How much
//! less is measured by the integrated autocorrelation time τ of the embedded trip.

/// Sokal's c: autocorrelations are summed up to a lag of c τ. He takes 4 to 10; robots turn back and come by again, so that
/// what is positive at first is negative later, and a window that ends before has counted one without the other.
const WINDOW: f64 = 10.0;

/// N_eff = N / τ: frames that are as good as independent of each other, at most N.
///
/// In each dimension, `τ = ½ + Σ ρ(t)` over the lags t up to a window of 10 τ: Sokal 1997, *Monte Carlo methods in
/// statistical mechanics*, eq. (2.16), and Madras & Sokal 1988, *The pivot algorithm*, app. C. Of the dimensions the
/// geometric mean: Vats, Flegal & Jones 2019, *Multivariate output analysis for Markov chain Monte Carlo*, eq. (8), for
/// dimensions that are uncorrelated, as those of an embedding are. Dimensions count alike whatever their scale, as they
/// do for a mixture.
///
/// A mean over the trip is worth N / 2τ independent frames, a mean of squares N / τ where ρ decays exponentially: the
/// autocorrelation of the squares is ρ². We count squares, since all but a few of a mixture's parameters are covariances.
///
/// * `coordinates` — of all frames, shape `(n_frames, n_dims)`
/// * `trips` — frames of each trip, in their order: frames of different trips are not taken for neighbours in time
///
/// O(n_frames · n_dims · τ).
pub fn n_frames_effective(coordinates: &[f64], n_dims: usize, trips: &[usize]) -> f64 {
    let n_frames = coordinates.len() / n_dims;
    assert_eq!(trips.iter().sum::<usize>(), n_frames, "every frame is of one trip");
    let log_times = (0..n_dims).map(|dim| {
        let along: Vec<f64> = coordinates.iter().skip(dim).step_by(n_dims).copied().collect();
        integrated_time(along, trips).ln()
    });
    let time = (log_times.sum::<f64>() / n_dims as f64).exp();
    n_frames as f64 / time
}

/// τ of one dimension, frames; 1 where frames are independent, or less alike than independent ones would be.
fn integrated_time(mut along: Vec<f64>, trips: &[usize]) -> f64 {
    let n_frames = along.len();
    let mean = along.iter().sum::<f64>() / n_frames as f64;
    along.iter_mut().for_each(|place| *place -= mean);
    let squares: f64 = along.iter().map(|place| place * place).sum();
    if squares == 0.0 {
        // At one place all the while: one frame says it all.
        return n_frames as f64;
    }
    let lag_max = trips.iter().copied().max().unwrap_or(0);
    let mut time = 0.5;
    for lag in 1..lag_max {
        time += products(&along, trips, lag) / squares;
        if lag as f64 >= WINDOW * time {
            break;
        }
    }
    time.max(1.0)
}

/// Sum of products of places a lag apart, within each trip.
fn products(along: &[f64], trips: &[usize], lag: usize) -> f64 {
    let mut begin = 0;
    let mut sum = 0.0;
    for &n_frames in trips {
        let trip = &along[begin..begin + n_frames];
        let later = &trip[lag.min(n_frames)..];
        sum += trip.iter().zip(later).map(|(now, then)| now * then).sum::<f64>();
        begin += n_frames;
    }
    sum
}

#[cfg(test)]
mod tests {
    use rand::RngExt;
    use rand_chacha::ChaCha8Rng;
    use rand_chacha::rand_core::SeedableRng;

    use super::*;

    /// Even noise between −1 and 1 in two dimensions, each draw `n_times` in a row.
    fn repeated(n_draws: usize, n_times: usize) -> Vec<f64> {
        let mut random = ChaCha8Rng::seed_from_u64(3);
        let draws: Vec<[f64; 2]> =
            (0..n_draws).map(|_| [0, 1].map(|_| random.random_range(-1.0..1.0))).collect();
        draws.iter().flat_map(|draw| vec![*draw; n_times]).flatten().collect()
    }

    #[test]
    fn independent_frames_all_count() {
        let n_effective = n_frames_effective(&repeated(4000, 1), 2, &[4000]);
        assert_eq!(n_effective, 4000.0, "τ is never below one frame");
    }

    #[test]
    fn draws_that_are_repeated_count_about_twice_each() {
        // Triangular autocorrelation: ½ + Σ (1 − t/r) = r/2. By Madras & Sokal's eq. (C.20) each dimension deviates by 0.07.
        let n_effective = n_frames_effective(&repeated(4000, 20), 2, &[80_000]);
        assert!((n_effective / 8000.0 - 1.0).abs() < 0.15, "{n_effective}");
    }

    #[test]
    fn an_exponential_decay_counts_by_its_time_constant() {
        // ρ(t) = aᵗ: τ = ½ + a / (1 − a), 19.5 for a = 0.95.
        let mut random = ChaCha8Rng::seed_from_u64(5);
        let mut place = 0.0;
        let walk: Vec<f64> = (0..200_000)
            .map(|_| {
                place = 0.95 * place + random.random_range(-1.0..1.0);
                place
            })
            .collect();
        let n_effective = n_frames_effective(&walk, 1, &[walk.len()]);
        // Madras & Sokal, eq. (C.20): the relative deviation is √(2 (2 · 10 · 19.5 + 1) / 200,000) = 0.063.
        assert!((n_effective / (200_000.0 / 19.5) - 1.0).abs() < 0.19, "{n_effective}");
    }

    #[test]
    fn where_one_trip_ends_and_another_begins_does_no_harm() {
        // Every trip stands at one of two places for four frames: τ = ½ + ¾ + ½ + ¼. The next trip is at the other place,
        // which says nothing about how fast a robot leaves one.
        let places = [1.0, 1.0, 1.0, 1.0, -1.0, -1.0, -1.0, -1.0].repeat(40);
        assert_eq!(n_frames_effective(&places, 1, &[4; 80]), 320.0 / 2.0);
        assert_ne!(n_frames_effective(&places, 1, &[320]), 320.0 / 2.0);
    }

    #[test]
    fn a_trip_that_stands_still_is_worth_one_frame() {
        assert_eq!(n_frames_effective(&[7.0; 40], 1, &[40]), 1.0);
    }
}
