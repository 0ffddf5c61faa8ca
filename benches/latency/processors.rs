//! Which processor runs what, and before whom.

use std::process::{Command, Stdio};
use std::sync::OnceLock;

use rustix::thread::{CpuSet, sched_getaffinity, sched_setaffinity};

/// While it lives this thread, and what it starts, keeps to one processor.
pub(crate) struct Pinned {
    before: CpuSet,
}

/// Keeps this thread to the n-th processor that this program may run on, or to the last where there are fewer.
pub(crate) fn keep_to(n: usize) -> Pinned {
    static ALLOWED: OnceLock<Vec<usize>> = OnceLock::new();
    let before = sched_getaffinity(None).expect("the system says where a thread may run");
    let allowed = ALLOWED.get_or_init(|| (0..CpuSet::MAX_CPU).filter(|&cpu| before.is_set(cpu)).collect());
    let mut one = CpuSet::new();
    one.set(allowed[n.min(allowed.len() - 1)]);
    sched_setaffinity(None, &one).expect("a thread may keep to a processor that it may run on");
    Pinned { before }
}

impl Drop for Pinned {
    fn drop(&mut self) {
        sched_setaffinity(None, &self.before).expect("a thread may run where it could before");
    }
}

/// Asks for this thread, and what it starts, to run before all that has no real-time priority. Returns whether it does.
pub(crate) fn ask_for_priority() -> bool {
    let process = std::process::id().to_string();
    let asked = Command::new("chrt").args(["--rr", "--pid", "20", &process]).stderr(Stdio::null()).status();
    asked.is_ok_and(|status| status.success())
}
