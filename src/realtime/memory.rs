//! Memory that the system never takes away to make room for other programs.

use std::fmt;
use std::io;

use rustix::mm::{MlockAllFlags, mlockall};
use rustix::process::{Resource, getrlimit};
use rustix::thread::{CapabilitySet, capabilities};

/// Why memory could not be locked.
#[derive(Debug)]
pub(super) struct NotLocked {
    mapped_bytes: Option<u64>,
    /// None where there is no limit.
    limit_bytes: Option<u64>,
    error: io::Error,
}

/// Locks all that this program has mapped, a model's file too, and brings it into memory.
///
/// What will be mapped later, such as the frames of a driver shim that comes, is locked too where no limit could be reached by
/// it: beyond one the system would refuse the mapping itself, and with it the shim.
pub(super) fn lock() -> Result<(), NotLocked> {
    let limit_bytes = getrlimit(Resource::Memlock).current;
    let may_exceed = capabilities(None).is_ok_and(|sets| sets.effective.contains(CapabilitySet::IPC_LOCK));
    let flags = match limit_bytes {
        Some(_) if !may_exceed => MlockAllFlags::CURRENT,
        _ => MlockAllFlags::CURRENT | MlockAllFlags::FUTURE,
    };
    mlockall(flags).map_err(|error| NotLocked {
        mapped_bytes: mapped_bytes(),
        limit_bytes,
        error: error.into(),
    })
}

/// What this program has mapped, which is what the limit is compared with.
fn mapped_bytes() -> Option<u64> {
    let status = std::fs::read_to_string("/proc/self/status").ok()?;
    let line = status.lines().find_map(|line| line.strip_prefix("VmSize:"))?;
    let n_kb: u64 = line.trim().strip_suffix(" kB")?.parse().ok()?;
    Some(n_kb * 1024)
}

impl fmt::Display for NotLocked {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("cannot lock memory: ")?;
        if let Some(bytes) = self.mapped_bytes {
            write!(f, "{} kB are mapped, ", bytes / 1024)?;
        }
        match self.limit_bytes {
            Some(bytes) => write!(f, "the limit is {} kB ", bytes / 1024)?,
            None => f.write_str("there is no limit ")?,
        }
        write!(
            f,
            "({}); raise it, with ulimit -l in a shell or LimitMEMLOCK=infinity in a systemd unit; serving on, though the \
             system may page the model out",
            self.error
        )
    }
}
