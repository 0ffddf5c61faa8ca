//! SIGTERM and SIGINT as a flag.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

use signal_hook::consts::{SIGINT, SIGTERM};

use crate::failure::Failure;

/// A flag that SIGTERM and SIGINT set. A second of them ends the program at once.
pub(crate) fn on_signals() -> Result<Arc<AtomicBool>, Failure> {
    let stop = Arc::new(AtomicBool::new(false));
    for signal in [SIGTERM, SIGINT] {
        // In this order: the first signal finds the flag unset, and then sets it.
        signal_hook::flag::register_conditional_shutdown(signal, 1, Arc::clone(&stop))
            .and_then(|_| signal_hook::flag::register(signal, Arc::clone(&stop)))
            .map_err(|error| Failure::CouldNot(format!("cannot handle signals: {error}")))?;
    }
    Ok(stop)
}

/// From now on the first signal ends the program at once: nothing is left to be tidied.
pub(crate) fn from_now_on_at_once(stop: &AtomicBool) {
    stop.store(true, Ordering::Relaxed);
}
