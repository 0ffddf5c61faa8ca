//! Random numbers by name: every source of chance in a simulated world has a stream of its own.
//!
//! A stream follows from the scene, the trip, the seed, and the source's name and number, and from nothing else:
//! drawing more from one, or adding another, changes no other.

use rand::RngExt;
use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::SeedableRng;

/// All streams of one trip.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Streams {
    seed: u64,
    /// Hash of scene and trip.
    trip: u64,
}

impl Streams {
    /// The streams of a trip through a scene (a world with its robot).
    pub(crate) fn new(scene: &str, trip: u32, seed: u64) -> Self {
        Self { seed, trip: hashed(hashed(HASH_OF_NOTHING, scene.as_bytes()), &trip.to_le_bytes()) }
    }

    /// The stream of the only source of its name.
    pub(crate) fn named(&self, source: &str) -> Random {
        self.numbered(source, 0)
    }

    /// The stream of one of several sources of the same name.
    pub(crate) fn numbered(&self, source: &str, index: usize) -> Random {
        let stream = hashed(hashed(self.trip, source.as_bytes()), &(index as u64).to_le_bytes());
        let mut random = ChaCha8Rng::seed_from_u64(self.seed);
        random.set_stream(stream);
        Random(random)
    }
}

const HASH_OF_NOTHING: u64 = 0xcbf2_9ce4_8422_2325;

/// FNV-1a (Fowler, Noll & Vo 1991): streams need distinct numbers, not unpredictable ones. The length keeps two
/// neighbouring texts apart.
fn hashed(before: u64, bytes: &[u8]) -> u64 {
    let length = (bytes.len() as u64).to_le_bytes();
    let step = |hash: u64, byte: &u8| (hash ^ u64::from(*byte)).wrapping_mul(0x0000_0100_0000_01b3);
    bytes.iter().chain(&length).fold(before, step)
}

/// One stream.
#[derive(Clone, Debug)]
pub(crate) struct Random(ChaCha8Rng);

impl Random {
    /// Uniform from 0 to below 1.
    pub(crate) fn uniform(&mut self) -> f64 {
        self.0.random()
    }

    /// Uniform from `low` to below `high`.
    pub(crate) fn between(&mut self, low: f64, high: f64) -> f64 {
        low + (high - low) * self.uniform()
    }

    /// True with a probability.
    pub(crate) fn chance(&mut self, probability: f64) -> bool {
        self.uniform() < probability
    }

    /// Normal with mean 0 and variance 1. Box & Muller 1958; always two draws, so that the stream's place follows from
    /// the number of calls.
    pub(crate) fn normal(&mut self) -> f64 {
        let radius = (-2.0 * libm::log(1.0 - self.uniform())).sqrt();
        radius * libm::cos(std::f64::consts::TAU * self.uniform())
    }
}

/// A value that wanders about 0 and forgets: the Ornstein–Uhlenbeck process.
#[derive(Clone, Debug)]
pub(crate) struct Wander {
    random: Random,
    value: f64,
    /// What is left of the value after a step.
    kept: f64,
    /// Standard deviation of what a step adds.
    added: f64,
}

impl Wander {
    /// * `deviation` — standard deviation of the value at all times
    /// * `memory_s` — after which a deviation has shrunk to 1/e
    pub(crate) fn new(mut random: Random, deviation: f64, memory_s: f64, step_s: f64) -> Self {
        let kept = libm::exp(-step_s / memory_s);
        let value = deviation * random.normal();
        Self { random, value, kept, added: deviation * (1.0 - kept * kept).sqrt() }
    }

    /// The value one step later.
    pub(crate) fn step(&mut self) -> f64 {
        self.value = self.kept * self.value + self.added * self.random.normal();
        self.value
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn draws(mut random: Random) -> [f64; 4] {
        std::array::from_fn(|_| random.uniform())
    }

    #[test]
    fn streams_differ_by_seed_scene_trip_name_and_number_and_by_nothing_else() {
        let same = draws(Streams::new("a", 1, 7).numbered("wheel", 2));
        assert_eq!(draws(Streams::new("a", 1, 7).numbered("wheel", 2)), same);
        for other in [
            Streams::new("a", 1, 8).numbered("wheel", 2),
            Streams::new("b", 1, 7).numbered("wheel", 2),
            Streams::new("a", 2, 7).numbered("wheel", 2),
            Streams::new("a", 1, 7).numbered("wheels", 2),
            Streams::new("a", 1, 7).numbered("wheel", 3),
        ] {
            assert_ne!(draws(other), same);
        }
    }

    #[test]
    fn normals_have_mean_0_and_variance_1() {
        let mut random = Streams::new("a", 1, 7).named("normal");
        let n = 100_000;
        let values: Vec<f64> = (0..n).map(|_| random.normal()).collect();
        let mean = values.iter().sum::<f64>() / f64::from(n);
        let variance = values.iter().map(|value| value * value).sum::<f64>() / f64::from(n);
        // Five standard errors: 1/√n of the mean, √(2/n) of the variance.
        assert!(mean.abs() < 5.0 * 0.003_17, "{mean}");
        assert!((variance - 1.0).abs() < 5.0 * 0.004_48, "{variance}");
    }

    #[test]
    fn a_wander_keeps_its_deviation_and_its_memory() {
        let (n, lag) = (400_000, 50);
        let mut wander = Wander::new(Streams::new("a", 1, 7).named("wander"), 0.5, 1.0, 0.02);
        let values: Vec<f64> = (0..n).map(|_| wander.step()).collect();
        let covariance =
            |lag: usize| (lag..n).map(|at| values[at] * values[at - lag]).sum::<f64>() / (n - lag) as f64;
        // 400 000 steps are n_eff = 8000 s / 2 s independent draws: five standard errors of a variance are
        // 5 √(2 / 4000) = 11 % of it.
        assert!((covariance(0) / 0.25 - 1.0).abs() < 0.11, "{}", covariance(0));
        assert!((covariance(lag) / 0.25 - libm::exp(-1.0)).abs() < 0.11, "{}", covariance(lag));
    }
}
