//! Where bytes come from.

use std::io;
use std::net::UdpSocket;
use std::os::fd::AsFd;
use std::time::Duration;

use rustix::event::{PollFd, PollFlags, Timespec, poll};

/// A way on which bytes come.
pub(crate) trait Link {
    /// Whether each receipt is a message of its own, so that nothing goes on in the next.
    fn is_of_messages(&self) -> bool {
        false
    }

    /// Waits for bytes.
    ///
    /// * `room` — where they are written, at least one byte
    fn receive(&mut self, room: &mut [u8], timeout: Duration) -> Result<Received, io::Error>;
}

#[derive(Debug, PartialEq, Eq)]
pub(crate) enum Received {
    /// So many bytes.
    Bytes(usize),
    /// None within the timeout.
    Nothing,
    /// The device cannot be reached, for this reason; it is told once.
    Gone(String),
    /// It can be reached again.
    Back(String),
    /// There will be no more.
    End,
}

/// A socket that is bound, and whose reads do not wait.
impl Link for UdpSocket {
    fn is_of_messages(&self) -> bool {
        true
    }

    fn receive(&mut self, room: &mut [u8], timeout: Duration) -> Result<Received, io::Error> {
        if !has_come(&*self, timeout)? {
            return Ok(Received::Nothing);
        }
        match self.recv(room) {
            Err(error) if is_passing(&error) => Ok(Received::Nothing),
            read => Ok(Received::Bytes(read?)),
        }
    }
}

/// A pipe or file that ends.
pub(crate) struct Pipe<F>(pub(crate) F);

impl<F: AsFd> Link for Pipe<F> {
    fn receive(&mut self, room: &mut [u8], timeout: Duration) -> Result<Received, io::Error> {
        Ok(match read_within(&self.0, room, timeout)? {
            None => Received::Nothing,
            Some(0) => Received::End,
            Some(n_bytes) => Received::Bytes(n_bytes),
        })
    }
}

/// Reads what is there within the timeout: `None` if nothing came, 0 at the end.
pub(crate) fn read_within(
    from: impl AsFd,
    room: &mut [u8],
    timeout: Duration,
) -> Result<Option<usize>, io::Error> {
    if !has_come(&from, timeout)? {
        return Ok(None);
    }
    match rustix::io::read(from, room).map_err(io::Error::from) {
        Err(error) if is_passing(&error) => Ok(None),
        read => read.map(Some),
    }
}

fn has_come(from: impl AsFd, timeout: Duration) -> Result<bool, io::Error> {
    let mut fds = [PollFd::new(&from, PollFlags::IN)];
    let timeout = Timespec::try_from(timeout).ok();
    match poll(&mut fds, timeout.as_ref()) {
        Err(rustix::io::Errno::INTR) => Ok(false),
        polled => Ok(polled? > 0),
    }
}

fn is_passing(error: &io::Error) -> bool {
    matches!(error.kind(), io::ErrorKind::WouldBlock | io::ErrorKind::Interrupted)
}
