//! What holds a place in the network, and is let go of without waiting for it.

use std::ops::Deref;
use std::sync::mpsc;
use std::time::Duration;

/// How long an end waits until the other knows that it has gone: a whole link takes a few milliseconds.
const FAREWELL: Duration = Duration::from_millis(50);

/// What takes leave of the other end when it is dropped. A link that takes nothing would hold that up for ten seconds, so it is
/// done on a thread that nobody waits for any longer than [`FAREWELL`].
#[derive(Debug)]
pub(crate) struct Held<T: Send + 'static>(Option<T>);

impl<T: Send + 'static> Held<T> {
    pub(crate) fn new(held: T) -> Self {
        Self(Some(held))
    }
}

impl<T: Send + 'static> Deref for Held<T> {
    type Target = T;

    fn deref(&self) -> &T {
        self.0.as_ref().expect("it is there until it is dropped")
    }
}

impl<T: Send + 'static> Drop for Held<T> {
    fn drop(&mut self) {
        let held = self.0.take();
        let (done, is_done) = mpsc::channel();
        std::thread::spawn(move || {
            drop(held);
            // Nobody may be waiting any more.
            let _ = done.send(());
        });
        let _ = is_done.recv_timeout(FAREWELL);
    }
}

#[cfg(test)]
mod tests {
    use std::sync::{Arc, Mutex};

    use super::*;

    /// Takes as long to go as somebody holds a lock.
    struct Slow(Arc<Mutex<()>>);

    impl Drop for Slow {
        fn drop(&mut self) {
            drop(self.0.lock().unwrap());
        }
    }

    #[test]
    fn what_does_not_go_is_not_waited_for_and_what_goes_is_gone() {
        let lock = Arc::new(Mutex::new(()));
        let held = Held::new(Slow(Arc::clone(&lock)));
        let locked = lock.lock().unwrap();
        // Would never return if it waited.
        drop(held);
        assert_eq!(Arc::strong_count(&lock), 2);
        drop(locked);
        let quick = Held::new(Arc::clone(&lock));
        assert!(quick.try_lock().is_ok());
    }
}
