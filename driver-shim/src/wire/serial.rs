//! A serial line, whose device may be unplugged and come back.

use std::io;
use std::os::fd::OwnedFd;
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

use rustix::fs::{Mode, OFlags};
use rustix::termios::{self, ControlModes, OptionalActions, QueueSelector, SpecialCodeIndex};

use super::link::{Link, Received, read_within};

/// Between two looks whether the device is back.
const RETRY: Duration = Duration::from_millis(500);

/// Opens the line when it can be, and again whenever it has hung up.
pub(crate) struct Serial {
    path: PathBuf,
    baud: u32,
    port: Option<OwnedFd>,
    retry_at: Instant,
    told_gone: bool,
}

impl Serial {
    pub(crate) fn new(path: PathBuf, baud: u32) -> Self {
        Self { path, baud, port: None, retry_at: Instant::now(), told_gone: false }
    }

    fn gone(&mut self, why: &str) -> Received {
        self.port = None;
        self.retry_at = Instant::now() + RETRY;
        if std::mem::replace(&mut self.told_gone, true) {
            return Received::Nothing;
        }
        Received::Gone(format!("{} cannot be read: {why}; waiting until it can", self.path.display()))
    }

    fn open_again(&mut self, timeout: Duration) -> Received {
        let wait = self.retry_at.saturating_duration_since(Instant::now());
        std::thread::sleep(wait.min(timeout));
        if wait > timeout {
            return Received::Nothing;
        }
        match open(&self.path, self.baud) {
            Err(error) => self.gone(&error.to_string()),
            Ok(port) => {
                self.port = Some(port);
                match std::mem::take(&mut self.told_gone) {
                    true => Received::Back(format!("{} can be read", self.path.display())),
                    false => Received::Nothing,
                }
            }
        }
    }
}

impl Link for Serial {
    fn receive(&mut self, room: &mut [u8], timeout: Duration) -> Result<Received, io::Error> {
        let Some(port) = &self.port else { return Ok(self.open_again(timeout)) };
        Ok(match read_within(port, room, timeout) {
            Ok(None) => Received::Nothing,
            Ok(Some(0)) => self.gone("it has hung up"),
            Ok(Some(n_bytes)) => Received::Bytes(n_bytes),
            Err(error) => self.gone(&error.to_string()),
        })
    }
}

/// Opens a line for bytes as they are: no echo, no signals, no translation, no handshake, eight bits, no parity.
fn open(path: &Path, baud: u32) -> Result<OwnedFd, io::Error> {
    // Without O_NONBLOCK, a modem line that is not raised would keep us here.
    let flags = OFlags::RDONLY | OFlags::NOCTTY | OFlags::NONBLOCK | OFlags::CLOEXEC;
    let port = rustix::fs::open(path, flags, Mode::empty())?;
    let mut settings = termios::tcgetattr(&port)?;
    settings.make_raw();
    settings.set_speed(baud)?;
    settings.control_modes |= ControlModes::CLOCAL | ControlModes::CREAD;
    // So that a read of nothing is EAGAIN, and 0 means that the other end has hung up.
    settings.special_codes[SpecialCodeIndex::VMIN] = 1;
    settings.special_codes[SpecialCodeIndex::VTIME] = 0;
    termios::tcsetattr(&port, OptionalActions::Now, &settings)?;
    // What came before is of another time.
    termios::tcflush(&port, QueueSelector::IFlush)?;
    Ok(port)
}
