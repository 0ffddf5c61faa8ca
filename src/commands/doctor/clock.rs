//! The clocks: the wall clock may be unset, and frames' times may be of another clock than ours.

use std::time::Duration;

use kinds_messages::{FrameHeader, monotonic_ns, ns_since_epoch};

use super::finding::{Finding, well, wrong};

/// Before this program was written no time is right.
const YEAR_MIN: i64 = 2026;
/// Nor long after: a clock that counts from another epoch, or overflows.
const YEAR_MAX: i64 = 2200;

/// Mean length of a year.
const NS_PER_YEAR: i64 = 31_556_952 * 1_000_000_000;

/// Frames that are sent later than now by more are of another clock.
const LEAD_MAX: Duration = Duration::from_secs(1);

pub(super) fn examine() -> Finding {
    let before = monotonic_ns();
    std::thread::sleep(Duration::from_millis(2));
    on_clocks(ns_since_epoch(), before, monotonic_ns())
}

fn on_clocks(realtime_ns: i64, before: u64, after: u64) -> Finding {
    let year = 1970 + realtime_ns.div_euclid(NS_PER_YEAR);
    if after <= before {
        let what = "the monotonic clock stands still";
        return wrong("clock", what, "restart the machine; its kernel or virtual machine is at fault");
    }
    match (YEAR_MIN..=YEAR_MAX).contains(&year) {
        true => well("clock", format!("the wall clock says that it is {year}, and the monotonic clock runs")),
        false => wrong(
            "clock",
            format!(
                "the wall clock says that it is the year {year}: frames and trips would carry wrong times"
            ),
            "set it: start time synchronisation (systemd-timesyncd, chrony), or date --set; kinds and latencies do not depend \
             on it",
        ),
    }
}

/// A frame that was sent by another clock than ours.
pub(super) fn on_frame(header: &FrameHeader, now_monotonic_ns: u64) -> Option<Finding> {
    let lead = Duration::from_nanos(header.sent_monotonic_ns.saturating_sub(now_monotonic_ns));
    (lead > LEAD_MAX).then(|| {
        wrong(
            "clock",
            format!(
                "frames are sent {:.1} s from now by the monotonic clock: their driver shim has another clock",
                lead.as_secs_f64()
            ),
            "run driver shim and service in the same time namespace (not in containers with clocks of their own)",
        )
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    const NOW: i64 = 1_795_000_000_000_000_000;

    #[test]
    fn clocks_that_are_unset_or_stand_still_are_wrong() {
        assert_eq!(
            on_clocks(NOW, 1, 2).what,
            "the wall clock says that it is 2026, and the monotonic clock runs"
        );
        assert!(on_clocks(NOW, 1, 2).well);
        for (realtime_ns, year) in [(0, 1970), (-1, 1969), (i64::MAX, 2262)] {
            let finding = on_clocks(realtime_ns, 1, 2);
            assert_eq!(
                finding.what,
                format!(
                    "the wall clock says that it is the year {year}: frames and trips would carry wrong times"
                )
            );
            assert!(!finding.well && finding.cure.unwrap().starts_with("set it: "));
        }
        assert_eq!(on_clocks(NOW, 2, 2).what, "the monotonic clock stands still");
    }

    #[test]
    fn frames_from_the_future_are_of_another_clock() {
        let header = FrameHeader { sent_monotonic_ns: 5_000_000_000, ..FrameHeader::default() };
        assert_eq!(on_frame(&header, 6_000_000_000), None);
        assert_eq!(on_frame(&header, 4_500_000_000), None);
        assert_eq!(
            on_frame(&header, 1_000_000_000).unwrap().what,
            "frames are sent 4.0 s from now by the monotonic clock: their driver shim has another clock"
        );
    }
}
