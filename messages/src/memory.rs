//! How much shared memory channels take, and whether there is as much.
//!
//! A publisher keeps a slot for every message that any reader may leave waiting or hold, so that sending never waits
//! and never fails. The system hands out pages at first touch, and a process that touches one when none are left is
//! killed (SIGBUS). So this is asked before.

use std::mem::size_of;
use std::path::Path;

use iceoryx2::service::header::publish_subscribe::Header;

use crate::channel::{Channel, Limits};
use crate::{ChannelError, FrameHeader, HealthReport, KindReport, ReloadAnswer};

/// Where Linux mounts POSIX shared memory.
pub const SHARED_MEMORY: &str = "/dev/shm";
/// Lists of slots and connections to readers, for a channel with all its readers.
const HOUSEKEEPING_BYTES: u64 = 512 * 1024;
/// Rounding of a slot to its alignment.
const SLOT_ROUNDING_BYTES: usize = 64;

/// Most shared memory that a sensor's frames channel may come to use: 0.6 MB for 16 readings, 6.3 MB for 19840.
///
/// 145 slots: 8 readers × (16 waiting + 2 held), and one being filled.
pub fn frames_memory_bytes(n_readings: usize) -> u64 {
    channel_bytes(Limits::FRAMES, size_of::<FrameHeader>() + n_readings * size_of::<u16>())
}

/// Most shared memory that a sensor's kinds channel may come to use: 8.4 MB.
///
/// 4130 slots: 16 readers × (256 waiting + 2 held), one for late joiners and one being filled.
pub fn reports_memory_bytes() -> u64 {
    channel_bytes(Limits::KINDS, size_of::<KindReport>())
}

/// Most shared memory that all channels of a service may come to use: 9.5 MB.
pub fn service_memory_bytes() -> u64 {
    reports_memory_bytes()
        + fixed_memory_bytes::<HealthReport>(Limits::HEALTH)
        + fixed_memory_bytes::<ReloadAnswer>(Limits::RELOADS)
}

/// Most shared memory that any of the channels beside them may come to use.
pub(crate) fn fixed_memory_bytes<T>(limits: Limits) -> u64 {
    channel_bytes(limits, size_of::<T>())
}

fn channel_bytes(limits: Limits, message_bytes: usize) -> u64 {
    let slot_bytes = size_of::<Header>() + message_bytes + SLOT_ROUNDING_BYTES;
    (limits.slots() * slot_bytes) as u64 + HOUSEKEEPING_BYTES
}

/// Refuses a channel for which there is not enough shared memory left.
pub(crate) fn check_free(channel: &Channel, needed_bytes: u64) -> Result<(), ChannelError> {
    enough(channel, needed_bytes, free_memory_bytes()?)
}

/// Shared memory that is left.
///
/// # Errors
/// If the system does not tell.
pub fn free_memory_bytes() -> Result<u64, ChannelError> {
    let path = Path::new(SHARED_MEMORY);
    let space = rustix::fs::statvfs(path)
        .map_err(|error| ChannelError::SharedMemoryUnknown { path: path.into(), source: error.into() })?;
    Ok(space.f_bavail.saturating_mul(space.f_frsize))
}

fn enough(channel: &Channel, needed_bytes: u64, free_bytes: u64) -> Result<(), ChannelError> {
    if needed_bytes <= free_bytes {
        return Ok(());
    }
    Err(ChannelError::SharedMemory {
        channel: channel.name(),
        path: SHARED_MEMORY.into(),
        needed_kb: needed_bytes.div_ceil(1000),
        free_kb: free_bytes / 1000,
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::OwnDomain;
    use crate::testing::{frames_channel, shared_memory_bytes};
    use crate::{FramePublisher, FrameReader, Node, ReportPublisher, ReportReader};

    #[test]
    fn documented_sizes_are_right() {
        assert_eq!(frames_memory_bytes(16), 562_568);
        assert_eq!(frames_memory_bytes(19840), 6_311_528);
        assert_eq!(reports_memory_bytes(), 8_354_768);
        assert_eq!(service_memory_bytes(), 9_461_992);
    }

    #[test]
    fn too_little_shared_memory_is_refused_in_words() {
        let domain = OwnDomain::make().unwrap();
        let channel = frames_channel(&domain, "crunch/ring");
        assert!(enough(&channel, 6_000_000, 6_000_000).is_ok());
        assert_eq!(
            enough(&channel, 6_000_001, 1_999_999).unwrap_err().to_string(),
            "channel natural-kinds/crunch/ring/frames needs 6001 kB of shared memory and /dev/shm has 1999 kB \
             free; delete files there or enlarge it"
        );
    }

    #[test]
    fn what_is_asked_for_covers_what_the_transport_takes() {
        for n_readings in [1, 16, 19840] {
            let domain = OwnDomain::make().unwrap();
            let node = Node::open(&domain, "test").unwrap();
            let sensor = "ring".parse().unwrap();
            let _publisher = FramePublisher::create(&node, &sensor, n_readings).unwrap();
            let _readers: Vec<_> = (0..8)
                .map(|_| {
                    let reader = FrameReader::open(&node, &sensor).unwrap();
                    _publisher.update().unwrap();
                    reader.receive().unwrap();
                    reader
                })
                .collect();
            check_against(shared_memory_bytes(&domain), frames_memory_bytes(n_readings));
        }
        let domain = OwnDomain::make().unwrap();
        let node = Node::open(&domain, "test").unwrap();
        let sensor = "ring".parse().unwrap();
        let _publisher = ReportPublisher::create(&node, &sensor).unwrap();
        let _readers: Vec<_> = (0..16)
            .map(|_| {
                let reader = ReportReader::open(&node, &sensor).unwrap();
                _publisher.update().unwrap();
                reader.receive().unwrap();
                reader
            })
            .collect();
        check_against(shared_memory_bytes(&domain), reports_memory_bytes());
    }

    fn check_against(taken: u64, asked: u64) {
        assert!(taken <= asked, "transport takes {taken} bytes, only {asked} were asked for");
        assert!(
            asked - taken <= HOUSEKEEPING_BYTES + asked / 10,
            "{asked} bytes asked for, only {taken} taken"
        );
    }
}
