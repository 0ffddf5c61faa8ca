//! Programs of a domain that ends with the program that started them: `kinds demo` and its service and shim.
//!
//! The owner holds the other end of their standard input. The system closes it when the owner ends, however that ends;
//! a signal on a parent's death would come while other threads of it still live, and so would its place in the domain.

use std::io::Read;
use std::ops::Deref;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread;
use std::time::{Duration, Instant};

use kinds_messages::{Domain, Node};

/// How long a program whose owner is gone tries to clear the domain: others may still be on their way out.
const PATIENCE: Duration = Duration::from_secs(5);

/// Between two tries.
const PAUSE: Duration = Duration::from_millis(10);

/// A domain that this program is in.
pub(crate) struct Joined {
    domain: Domain,
    /// Whether there was an owner, and it has ended.
    is_orphan: Arc<AtomicBool>,
}

impl Joined {
    /// Joins a domain. Declare it before anything that is opened in it.
    ///
    /// * `has_owner` — whether whoever started this program holds its standard input, to end it together with itself
    /// * `stop` — is set when the owner has ended
    pub(crate) fn new(domain: Domain, has_owner: bool, stop: &Arc<AtomicBool>) -> Self {
        let is_orphan = Arc::new(AtomicBool::new(false));
        if has_owner {
            let (is_orphan, stop) = (Arc::clone(&is_orphan), Arc::clone(stop));
            thread::spawn(move || {
                // Nothing is ever written. An error is as good as the end.
                let _ = std::io::stdin().read_to_end(&mut Vec::new());
                is_orphan.store(true, Ordering::Relaxed);
                stop.store(true, Ordering::Relaxed);
            });
        }
        Self { domain, is_orphan }
    }
}

impl Deref for Joined {
    type Target = Domain;

    fn deref(&self) -> &Domain {
        &self.domain
    }
}

impl Drop for Joined {
    fn drop(&mut self) {
        let start = Instant::now();
        while self.is_orphan.load(Ordering::Relaxed) && start.elapsed() < PATIENCE {
            // Whoever joins clears the places of those that were killed. Nobody is left to be told of a failure.
            drop(Node::open(&self.domain, "kinds-last"));
            if self.domain.remove_if_deserted().is_ok_and(|is_removed| is_removed) {
                return;
            }
            thread::sleep(PAUSE);
        }
    }
}
