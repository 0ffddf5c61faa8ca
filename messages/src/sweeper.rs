//! A thread that removes what killed programs leave half made in shared memory, as soon as it is there.
//!
//! Whoever of iceoryx2 0.10.0 meets shared memory that was not given its size yet waits for that without limit, in whatever call it
//! is: to join a domain, to leave it, to look for messages. Its maker has a few microseconds in which a kill leaves it so. Only
//! another thread can free who waits.

use std::io::{PipeReader, PipeWriter, pipe};
use std::os::fd::OwnedFd;
use std::thread::JoinHandle;

use rustix::event::{PollFd, PollFlags, Timespec, poll};
use rustix::fs::inotify::{self, CreateFlags, WatchFlags};

use crate::Domain;
use crate::half_made::{MAKING, remove};
use crate::memory::SHARED_MEMORY;

/// The thread, while this lives. It sleeps until files are made in shared memory, by whomever.
#[derive(Debug)]
pub(crate) struct Sweeper {
    /// The thread ends when this is closed.
    stop: Option<PipeWriter>,
    sweeping: Option<JoinHandle<()>>,
}

impl Sweeper {
    /// Begins to sweep a domain. Where the system has no thread or no watch to spare, others will do it.
    pub(crate) fn of(domain: &Domain) -> Self {
        Self::try_of(domain).unwrap_or_else(|error| {
            tracing::debug!("what killed programs leave half made in shared memory stays: {error}");
            Self { stop: None, sweeping: None }
        })
    }

    fn try_of(domain: &Domain) -> std::io::Result<Self> {
        let (stopped, stop) = pipe()?;
        let news = inotify::init(CreateFlags::CLOEXEC | CreateFlags::NONBLOCK)?;
        inotify::add_watch(&news, SHARED_MEMORY, WatchFlags::CREATE)?;
        let domain = domain.clone();
        let sweep = move || sweep(&domain, &news, &stopped);
        let sweeping = std::thread::Builder::new().name("sweeper".to_owned()).spawn(sweep)?;
        Ok(Self { stop: Some(stop), sweeping: Some(sweeping) })
    }
}

impl Drop for Sweeper {
    fn drop(&mut self) {
        self.stop = None;
        if let Some(sweeping) = self.sweeping.take() {
            let _ = sweeping.join();
        }
    }
}

fn sweep(domain: &Domain, news: &OwnedFd, stopped: &PipeReader) {
    let making = Timespec { tv_sec: 0, tv_nsec: MAKING.as_nanos() as i64 };
    let (stopped, arrived) = (PollFd::new(stopped, PollFlags::IN), PollFd::new(news, PollFlags::IN));
    loop {
        let are_left = remove(domain);
        let _ = poll(&mut [stopped.clone(), arrived.clone()], are_left.then_some(&making));
        // Files come in bursts, and each must be left alone for so long.
        let is_stopped = poll(&mut [stopped.clone()], Some(&making)).is_ok_and(|n_ready| n_ready > 0);
        if is_stopped {
            return;
        }
        // Whatever came until now is looked at next.
        let mut names = [0; 4096];
        while rustix::io::read(news, &mut names).is_ok_and(|n_bytes| n_bytes > 0) {}
    }
}

#[cfg(test)]
mod tests {
    use std::fs::{File, Permissions};
    use std::os::unix::fs::PermissionsExt as _;
    use std::path::Path;
    use std::time::{Duration, Instant};

    use super::*;
    use crate::OwnDomain;

    #[test]
    fn what_its_maker_leaves_half_made_goes_soon_after_and_what_is_being_made_stays() {
        let domain = OwnDomain::make().unwrap();
        let _sweeper = Sweeper::of(&domain);
        let path = Path::new(SHARED_MEMORY).join(format!("{}0123.connection", domain.prefix));
        let maker = File::create(&path).unwrap();
        maker.set_permissions(Permissions::from_mode(0o200)).unwrap();
        std::thread::sleep(5 * MAKING);
        assert!(path.exists());
        drop(maker);
        let begun = Instant::now();
        while path.exists() {
            assert!(begun.elapsed() < Duration::from_secs(10), "it is still there");
            std::thread::sleep(MAKING / 10);
        }
    }
}
