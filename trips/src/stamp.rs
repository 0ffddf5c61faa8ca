//! A moment: nanoseconds since the epoch.

use std::fmt;

/// A moment, in nanoseconds since the Unix epoch.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Default)]
pub struct Stamp(pub i64);

impl Stamp {
    /// The moment `sec` seconds and `nanosec` nanoseconds after the epoch, as in `builtin_interfaces/msg/Time`.
    pub fn from_sec_nsec(sec: i32, nanosec: u32) -> Self {
        // |sec| ≤ 2³¹, so the sum is below 2.2e18 and fits.
        Self(i64::from(sec) * 1_000_000_000 + i64::from(nanosec))
    }

    /// Seconds from `earlier` to this moment; negative if `earlier` is the later one.
    pub fn seconds_since(self, earlier: Self) -> f64 {
        self.0.saturating_sub(earlier.0) as f64 * 1e-9
    }

    /// The two parts of `builtin_interfaces/msg/Time`. Seconds saturate where 32 bits end (1901 and 2038).
    pub(crate) fn sec_nsec(self) -> (i32, u32) {
        let sec = self.0.div_euclid(1_000_000_000).clamp(i64::from(i32::MIN), i64::from(i32::MAX));
        (sec as i32, self.0.rem_euclid(1_000_000_000) as u32)
    }
}

/// Seconds since the epoch, to the nanosecond.
impl fmt::Display for Stamp {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let sign = if self.0 < 0 { "-" } else { "" };
        let ns = self.0.unsigned_abs();
        write!(f, "{sign}{}.{:09}", ns / 1_000_000_000, ns % 1_000_000_000)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn parts_and_whole_agree_on_both_sides_of_the_epoch() {
        for (sec, nanosec, ns) in
            [(0, 0, 0), (2, 5, 2_000_000_005), (-1, 999_999_999, -1), (-2, 0, -2_000_000_000)]
        {
            assert_eq!(Stamp::from_sec_nsec(sec, nanosec), Stamp(ns));
            assert_eq!(Stamp(ns).sec_nsec(), (sec, nanosec));
        }
    }

    #[test]
    fn stamps_are_shown_as_seconds() {
        assert_eq!(Stamp(1_150_000_000_033_333_333).to_string(), "1150000000.033333333");
        assert_eq!(Stamp(-1).to_string(), "-0.000000001");
    }

    #[test]
    fn the_longest_time_there_is_does_not_overflow() {
        assert!(Stamp(i64::MAX).seconds_since(Stamp(i64::MIN)) > 9e9);
    }
}
