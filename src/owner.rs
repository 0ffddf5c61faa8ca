//! Programs of a domain that ends with the program that started them: `kinds demo` and its service and shim.

use std::ops::Deref;
use std::sync::atomic::{AtomicBool, Ordering};

use kinds_messages::{Domain, Node};
use rustix::process::{Pid, Signal, getppid, set_parent_process_death_signal};

use crate::failure::Failure;

/// A domain that this program is in.
pub(crate) struct Joined {
    domain: Domain,
    is_owned: bool,
}

impl Joined {
    /// Joins a domain. Declare it before anything that is opened in it.
    ///
    /// With an owner, which must have started this program: it ends when the owner does, however that ends.
    pub(crate) fn new(domain: Domain, owner: Option<i32>, stop: &AtomicBool) -> Result<Self, Failure> {
        if let Some(owner) = owner {
            set_parent_process_death_signal(Some(Signal::TERM))
                .map_err(|error| Failure::CouldNot(format!("cannot follow process {owner}: {error}")))?;
            // It may have gone before the system was asked to tell.
            if getppid() != Pid::from_raw(owner) {
                stop.store(true, Ordering::Relaxed);
            }
        }
        Ok(Self { domain, is_owned: owner.is_some() })
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
        if self.is_owned {
            // An owner that was killed has left its place: whoever joins clears it. Nobody is left to be told of a failure.
            drop(Node::open(&self.domain, "kinds-last"));
            let _ = self.domain.remove_if_deserted();
        }
    }
}
