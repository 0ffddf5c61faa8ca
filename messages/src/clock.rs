//! The two clocks that messages carry: one for latency, one for people and trips.

use rustix::time::{ClockId, Timespec, clock_gettime};

/// Nanoseconds on CLOCK_MONOTONIC, the same for every process of one machine since its start.
///
/// Latency is a difference of these; it does not jump when the wall clock is set.
pub fn monotonic_ns() -> u64 {
    // CLOCK_MONOTONIC is never negative, and 2^64 ns are 584 years after the machine's start.
    since_start(clock_gettime(ClockId::Monotonic)) as u64
}

/// Nanoseconds since the epoch, by the wall clock, which may be set and so may jump.
pub fn ns_since_epoch() -> i64 {
    since_start(clock_gettime(ClockId::Realtime))
}

/// Nanoseconds since the clock's own zero. An `i64` holds them until the year 2262.
fn since_start(time: Timespec) -> i64 {
    time.tv_sec * 1_000_000_000 + time.tv_nsec
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn monotonic_time_never_goes_back() {
        let times: Vec<u64> = (0..1000).map(|_| monotonic_ns()).collect();
        assert!(times.is_sorted());
        assert!(times[0] > 0);
    }

    #[test]
    fn wall_clock_agrees_with_the_standard_library() {
        let before = std::time::SystemTime::now();
        let ours = ns_since_epoch();
        let after = std::time::SystemTime::now();
        let ns = |time: std::time::SystemTime| {
            time.duration_since(std::time::UNIX_EPOCH).unwrap().as_nanos() as i64
        };
        assert!((ns(before)..=ns(after)).contains(&ours));
    }
}
