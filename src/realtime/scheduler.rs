//! The one system call here that rustix has not.
#![allow(unsafe_code, reason = "no library has this call with the flag that it needs here")]

use std::io;

/// Makes all programs that are not real-time wait for this thread (`SCHED_FIFO`), but not for threads that it starts: a model
/// that is opened beside the one in use must not hold up frames.
///
/// * `priority` — 1 to 99
pub(super) fn run_before_others(priority: u8) -> io::Result<()> {
    const THIS_THREAD: libc::pid_t = 0;
    let parameters = libc::sched_param { sched_priority: priority.into() };
    let policy = libc::SCHED_FIFO | libc::SCHED_RESET_ON_FORK;
    // SAFETY: the call reads `parameters`, which outlives it, and touches no other memory of this program.
    match unsafe { libc::sched_setscheduler(THIS_THREAD, policy, &raw const parameters) } {
        0 => Ok(()),
        _ => Err(io::Error::last_os_error()),
    }
}
