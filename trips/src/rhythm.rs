//! How regularly something came: its usual period, and where it failed to come.
//!
//! Periods are counted in eight bins to the octave, so that memory does not grow with how many there are. The usual
//! period is the mean of the bin that the median falls into: of a steady sensor it is exact.

use crate::Stamp;

/// Times the usual period from which on a period is a gap.
const GAP_PERIODS: f64 = 3.0;

const BINS_PER_OCTAVE: usize = 8;

/// Moments, one after the other.
#[derive(Debug, Default)]
pub(crate) struct Rhythm {
    first: Option<Stamp>,
    last: Stamp,
    latest: Stamp,
    n_backwards: u64,
    /// By the logarithm of a period: how many, and their sum, ns. Not before the second moment.
    periods: Vec<(u64, f64)>,
    longest: Option<Gap>,
}

/// A time without messages.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Gap {
    /// The moment of the last message before it.
    pub after: Stamp,
    /// How long it was, seconds.
    pub length_s: f64,
}

impl Rhythm {
    pub(crate) fn add(&mut self, at: Stamp) {
        if self.first.is_none() {
            (self.first, self.last, self.latest) = (Some(at), at, at);
            return;
        }
        let before = std::mem::replace(&mut self.last, at);
        self.latest = self.latest.max(at);
        let period_ns = at.0.saturating_sub(before.0);
        if period_ns < 0 {
            self.n_backwards += 1;
            return;
        }
        let length_s = at.seconds_since(before);
        if self.longest.is_none_or(|longest| length_s > longest.length_s) {
            self.longest = Some(Gap { after: before, length_s });
        }
        self.periods.resize(64 * BINS_PER_OCTAVE, (0, 0.0));
        let (count, sum_ns) = &mut self.periods[bin(period_ns as u64)];
        *count += 1;
        *sum_ns += period_ns as f64;
    }

    /// The first moment, and the latest.
    pub(crate) fn span(&self) -> Option<(Stamp, Stamp)> {
        self.first.map(|first| (first, self.latest))
    }

    /// Moments that came after a later one.
    pub(crate) fn n_backwards(&self) -> u64 {
        self.n_backwards
    }

    /// The usual period, seconds; none of fewer than two moments, or if they are all the same.
    pub(crate) fn period_s(&self) -> Option<f64> {
        let n_periods: u64 = self.periods.iter().map(|(count, _)| count).sum();
        let mut n_shorter = 0;
        let median = self.periods.iter().find(|(count, _)| {
            n_shorter += count;
            2 * n_shorter > n_periods
        });
        median.map(|(count, sum_ns)| 1e-9 * sum_ns / *count as f64).filter(|period_s| *period_s > 0.0)
    }

    /// How many gaps there were, and the longest.
    pub(crate) fn gaps(&self) -> Option<(u64, Gap)> {
        let least_s = GAP_PERIODS * self.period_s()?;
        let longest = self.longest.filter(|longest| longest.length_s > least_s)?;
        let is_gap = |&&(count, sum_ns): &&(u64, f64)| 1e-9 * sum_ns > least_s * count as f64;
        let n_gaps: u64 = self.periods.iter().filter(is_gap).map(|(count, _)| count).sum();
        // The longest may lie in a bin whose mean is below.
        Some((n_gaps.max(1), longest))
    }
}

/// Eight to the octave, from 0.
fn bin(period_ns: u64) -> usize {
    let octave = period_ns.max(1).ilog2() as usize;
    // The three bits after the leading one.
    let eighth = ((u128::from(period_ns) << 3) >> octave) as usize % BINS_PER_OCTAVE;
    octave * BINS_PER_OCTAVE + eighth
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    fn rhythm(moments_ms: &[i64]) -> Rhythm {
        let mut rhythm = Rhythm::default();
        moments_ms.iter().for_each(|ms| rhythm.add(Stamp(ms * 1_000_000)));
        rhythm
    }

    #[test]
    fn a_steady_sensor_has_its_exact_period_and_no_gap() {
        let steady = rhythm(&[0, 100, 200, 300, 400]);
        assert!((steady.period_s().unwrap() - 0.1).abs() < 1e-15);
        assert_eq!((steady.gaps(), steady.n_backwards()), (None, 0));
        assert_eq!(steady.span(), Some((Stamp(0), Stamp(400_000_000))));
    }

    #[test]
    fn gaps_are_counted_and_the_longest_is_told() {
        let gappy = rhythm(&[0, 100, 200, 700, 800, 900, 2000, 2100, 2350]);
        assert!((gappy.period_s().unwrap() - 0.1).abs() < 1e-15);
        let longest = Gap { after: Stamp(900_000_000), length_s: 1.1 };
        assert_eq!(gappy.gaps(), Some((2, longest)));
    }

    #[test]
    fn what_has_no_period_has_no_gaps() {
        for moments_ms in [&[][..], &[5], &[5, 5, 5], &[9, 5]] {
            let none = rhythm(moments_ms);
            assert_eq!((none.period_s(), none.gaps()), (None, None), "{moments_ms:?}");
        }
        let backwards = rhythm(&[0, 100, 50, 200]);
        assert_eq!((backwards.n_backwards(), backwards.span()), (1, Some((Stamp(0), Stamp(200_000_000)))));
    }

    proptest! {
        #[test]
        fn bins_are_in_order_of_periods(a: u64, b: u64) {
            let (shorter, longer) = (a.min(b), a.max(b));
            prop_assert!(bin(shorter) <= bin(longer));
            prop_assert!(bin(longer) < 64 * BINS_PER_OCTAVE);
            // An eighth of an octave's span is never exceeded.
            if bin(shorter) == bin(longer) {
                prop_assert!((longer - shorter) as f64 <= shorter as f64 / 8.0 + 1.0);
            }
        }
    }
}
