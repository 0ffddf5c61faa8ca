//! Random numbers for pixels: some for each of 19840, a hundred times a second and more.
//!
//! A counter-based generator: what a pixel of a frame gets depends on the seed, the frame and the pixel, not on what
//! was drawn before. One 64-bit mix (Steele, Lea & Flood 2014, *Fast splittable pseudorandom number generators*) gives
//! all numbers of a pixel, and a table turns twelve of its bits into a normal number.

/// Quantiles in the table of normal numbers.
const N_QUANTILES: usize = 1 << 12;

/// Source of the noise of one camera.
pub(super) struct PixelNoise {
    seed: u64,
    /// `(N_QUANTILES,)`: quantiles of the standard normal distribution, at the middles of equal shares.
    normal: Vec<f64>,
}

/// The random numbers of one pixel in one frame, independent of each other.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Draw {
    /// Standard normal; at most about 3.7 either way.
    pub(super) normal: f64,
    /// Uniform in 0…1, each to 17 bits.
    pub(super) uniform: [f64; 3],
}

impl PixelNoise {
    pub(super) fn new(seed: u64) -> Self {
        let share = |index: usize| (index as f64 + 0.5) / N_QUANTILES as f64;
        Self { seed, normal: (0..N_QUANTILES).map(|index| normal_quantile(share(index))).collect() }
    }

    /// The numbers of all pixels of frame `frame_index`, in order.
    pub(super) fn frame(&self, frame_index: u64) -> impl Iterator<Item = Draw> + '_ {
        let frame = mix(self.seed ^ mix(frame_index));
        (0u64..).map(move |pixel| {
            let bits = mix(frame.wrapping_add(pixel.wrapping_mul(GOLDEN)));
            let uniform = [12, 29, 46].map(|shift| ((bits >> shift) & 0x1_FFFF) as f64 / f64::from(1 << 17));
            Draw { normal: self.normal[bits as usize % N_QUANTILES], uniform }
        })
    }
}

/// 2⁶⁴ divided by the golden ratio, odd: counters become far apart before they are mixed.
const GOLDEN: u64 = 0x9E37_79B9_7F4A_7C15;

/// The finaliser of SplitMix64.
fn mix(counter: u64) -> u64 {
    let bits = counter.wrapping_add(GOLDEN);
    let bits = (bits ^ (bits >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
    let bits = (bits ^ (bits >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
    bits ^ (bits >> 31)
}

/// Where the standard normal distribution reaches `share`, by bisection: it is asked for a table, once.
fn normal_quantile(share: f64) -> f64 {
    let (mut low, mut high) = (-8.0, 8.0);
    for _ in 0..40 {
        let middle = (low + high) / 2.0;
        let below = 0.5 * libm::erfc(-middle * std::f64::consts::FRAC_1_SQRT_2);
        *(if below < share { &mut low } else { &mut high }) = middle;
    }
    (low + high) / 2.0
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn quantiles_are_those_of_the_tables() {
        for (share, expected) in [(0.5, 0.0), (0.975, 1.959_963_984_540_054), (0.01, -2.326_347_874_040_841)]
        {
            assert!((normal_quantile(share) - expected).abs() < 1e-9);
        }
    }

    /// Each mean of n independent numbers lies within six of its standard errors.
    #[test]
    fn numbers_have_the_moments_of_their_distributions_and_are_not_correlated() {
        let n = 40_000;
        let draws: Vec<Draw> = PixelNoise::new(1).frame(7).take(n).collect();
        let mean = |of: &dyn Fn(&Draw) -> f64| draws.iter().map(of).sum::<f64>() / n as f64;
        let six_errors = |sd: f64| 6.0 * sd / (n as f64).sqrt();
        assert!(mean(&|draw| draw.normal).abs() < six_errors(1.0));
        assert!((mean(&|draw| draw.normal * draw.normal) - 1.0).abs() < six_errors(2.0_f64.sqrt()));
        for k in 0..3 {
            assert!((mean(&|draw| draw.uniform[k]) - 0.5).abs() < six_errors(12.0_f64.sqrt().recip()));
            assert!(mean(&|draw| draw.normal * (draw.uniform[k] - 0.5)).abs() < six_errors(0.29));
            assert!(
                mean(&|draw| (draw.uniform[k] - 0.5) * (draw.uniform[(k + 1) % 3] - 0.5)).abs()
                    < six_errors(1.0 / 12.0)
            );
        }
    }

    #[test]
    fn frames_and_seeds_have_different_noise() {
        let of = |seed, frame| PixelNoise::new(seed).frame(frame).take(8).collect::<Vec<_>>();
        assert_eq!(of(1, 0), of(1, 0));
        assert_ne!(of(1, 0), of(1, 1));
        assert_ne!(of(1, 0), of(2, 0));
    }
}
