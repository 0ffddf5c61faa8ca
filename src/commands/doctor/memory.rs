//! Shared memory: is there as much as channels that are still to be made will take?

use std::collections::BTreeSet;

use kinds_messages::{
    Census, Purpose, SHARED_MEMORY, SensorName, frames_memory_bytes, free_memory_bytes, service_memory_bytes,
};
use kinds_model::Model;

use super::finding::{Finding, well, wrong};

/// * `model` — of whose sensor frames will be
pub(super) fn examine(census: &Census, sensors: &BTreeSet<SensorName>, model: Option<&Model>) -> Finding {
    let is_published = |sensor: &SensorName, purpose: Purpose| {
        census.channel(sensor, purpose).is_some_and(|channel| channel.publisher.is_some())
    };
    let without =
        |purpose: Purpose| sensors.iter().filter(|sensor| !is_published(sensor, purpose)).count() as u64;
    let (without_shim, without_service) = (without(Purpose::Frames), without(Purpose::Kinds));
    let n_readings = model.map(|model| model.layout().n_readings());
    let needed =
        without_shim * n_readings.map_or(0, frames_memory_bytes) + without_service * service_memory_bytes();
    let is_partial = without_shim > 0 && n_readings.is_none();
    match free_memory_bytes() {
        Ok(free) => on_space(needed, free, is_partial),
        Err(error) => wrong("memory", error.to_string(), "mount a tmpfs at /dev/shm"),
    }
}

/// * `is_partial` — whether frames need more, nobody knows how much
fn on_space(needed: u64, free: u64, is_partial: bool) -> Finding {
    let (needed_kb, free_kb) = (needed.div_ceil(1000), free / 1000);
    let frames = if is_partial { ", and frames as their sensor asks (--model says how much)" } else { "" };
    if needed > free {
        return wrong(
            "memory",
            format!(
                "{SHARED_MEMORY} has {free_kb} kB free, and channels that are not there yet need {needed_kb} kB{frames}"
            ),
            format!(
                "delete files in {SHARED_MEMORY}, or enlarge it: mount -o remount,size=256m {SHARED_MEMORY}"
            ),
        );
    }
    let need = match needed {
        0 => format!("the channels have theirs{frames}"),
        _ => format!("channels that are not there yet need {needed_kb} kB{frames}"),
    };
    well("memory", format!("{SHARED_MEMORY} has {free_kb} kB free; {need}"))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn too_little_is_wrong_with_both_numbers() {
        assert!(on_space(6_000_000, 6_000_000, false).well);
        assert_eq!(
            on_space(6_000_001, 1_999_999, false).what,
            "/dev/shm has 1999 kB free, and channels that are not there yet need 6001 kB"
        );
        assert_eq!(
            on_space(0, 1_999_999, true).what,
            "/dev/shm has 1999 kB free; the channels have theirs, and frames as their sensor asks (--model says how much)"
        );
    }
}
