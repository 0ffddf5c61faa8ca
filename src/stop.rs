//! Signals as flags.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

use signal_hook::consts::{SIGHUP, SIGINT, SIGTERM};

use crate::failure::Failure;

/// A flag that SIGTERM and SIGINT set. A second of them ends the program at once.
pub(crate) fn on_signals() -> Result<Arc<AtomicBool>, Failure> {
    let stop = Arc::new(AtomicBool::new(false));
    for signal in [SIGTERM, SIGINT] {
        // In this order: the first signal finds the flag unset, and then sets it.
        signal_hook::flag::register_conditional_shutdown(signal, 1, Arc::clone(&stop))
            .and_then(|_| signal_hook::flag::register(signal, Arc::clone(&stop)))
            .map_err(unhandled)?;
    }
    Ok(stop)
}

/// A flag that SIGHUP sets, every time.
pub(crate) fn reload_on_signal() -> Result<Arc<AtomicBool>, Failure> {
    let reload = Arc::new(AtomicBool::new(false));
    signal_hook::flag::register(SIGHUP, Arc::clone(&reload)).map_err(unhandled)?;
    Ok(reload)
}

fn unhandled(error: std::io::Error) -> Failure {
    Failure::CouldNot(format!("cannot handle signals: {error}"))
}

/// From now on the first signal ends the program at once: nothing is left to be tidied.
pub(crate) fn from_now_on_at_once(stop: &AtomicBool) {
    stop.store(true, Ordering::Relaxed);
}
