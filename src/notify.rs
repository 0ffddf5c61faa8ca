//! Whoever supervises this program: what systemd is told of a unit of `Type=notify` (`sd_notify(3)`).
//!
//! One socket is kept for good, nothing is allocated in the loop that is watched, and nobody waits there: what the
//! supervisor has no room for is left out.

use std::fmt;
use std::io::{self, ErrorKind, Write};
use std::os::linux::net::SocketAddrExt;
use std::os::unix::ffi::OsStrExt;
use std::os::unix::net::{SocketAddr, UnixDatagram};
use std::sync::Arc;
use std::time::{Duration, Instant};

use kinds_messages::{HealthReport, SensorName, monotonic_ns};

/// Most bytes of a message.
const N_BYTES_MAX: usize = 512;

/// How long it is tried to say what must be heard.
const PATIENCE: Duration = Duration::from_secs(2);

/// Between two tries.
const PAUSE: Duration = Duration::from_millis(10);

/// Whoever supervises this program, if anybody does.
#[derive(Clone, Debug, Default)]
pub(crate) struct Supervisor {
    socket: Option<Arc<UnixDatagram>>,
}

impl Supervisor {
    /// The one that is named in the environment. One that cannot be reached is told in the log, and missed by nobody else.
    pub(crate) fn from_environment() -> Self {
        let Some(name) = std::env::var_os("NOTIFY_SOCKET") else { return Self::default() };
        let connected = connect(name.as_bytes());
        if let Err(error) = &connected {
            tracing::warn!("cannot reach the supervisor at NOTIFY_SOCKET={}: {error}", name.display());
        }
        Self { socket: connected.ok().map(Arc::new) }
    }

    /// Says that the program does what it is for, and what that is.
    pub(crate) fn ready(&self, status: impl fmt::Display) {
        self.insist(format_args!("READY=1\nSTATUS={status}"));
    }

    /// Says that the program is about to end.
    pub(crate) fn stopping(&self) {
        self.insist(format_args!("STOPPING=1\nSTATUS=ending"));
    }

    /// Says that the program takes up something new, which [`Self::ready`] ends.
    pub(crate) fn reloading(&self) {
        let now_us = monotonic_ns() / 1000;
        self.insist(format_args!("RELOADING=1\nMONOTONIC_USEC={now_us}\nSTATUS=opening a model"));
    }

    /// Says that the loop turns. Called by the loop itself and from nowhere else: one that hangs falls silent.
    pub(crate) fn alive(&self, status: impl fmt::Display) {
        // What is left out now is said the next time.
        let _ = self.say(format_args!("WATCHDOG=1\nSTATUS={status}"));
    }

    /// Says something that must be heard.
    fn insist(&self, message: fmt::Arguments) {
        let start = Instant::now();
        loop {
            match self.say(message) {
                Err(error) if error.kind() == ErrorKind::WouldBlock && start.elapsed() < PATIENCE => {
                    std::thread::sleep(PAUSE);
                }
                Err(error) => {
                    return tracing::warn!("cannot tell the supervisor how this program fares: {error}");
                }
                Ok(()) => return,
            }
        }
    }

    fn say(&self, message: fmt::Arguments) -> io::Result<()> {
        let Some(socket) = &self.socket else { return Ok(()) };
        let mut bytes = [0; N_BYTES_MAX];
        let mut rest = &mut bytes[..];
        // A message that is too long ends early.
        let _ = rest.write_fmt(message);
        let n_left = rest.len();
        socket.send(&bytes[..N_BYTES_MAX - n_left]).map(drop)
    }
}

fn connect(name: &[u8]) -> io::Result<UnixDatagram> {
    let address = match name {
        [b'@', name @ ..] => SocketAddr::from_abstract_name(name)?,
        path => SocketAddr::from_pathname(std::ffi::OsStr::from_bytes(path))?,
    };
    let socket = UnixDatagram::unbound()?;
    socket.connect_addr(&address)?;
    socket.set_nonblocking(true)?;
    Ok(socket)
}

/// How a service fares, in words, and whether another model has come or been refused: what its supervisor is told of each
/// health report.
pub(crate) struct Reporter {
    supervisor: Supervisor,
    sensor: SensorName,
    n_models_asked_for: u64,
}

impl Reporter {
    pub(crate) fn new(supervisor: Supervisor, sensor: SensorName) -> Self {
        Self { supervisor, sensor, n_models_asked_for: 0 }
    }

    pub(crate) fn tell(&mut self, health: &HealthReport) {
        let status = Status { sensor: &self.sensor, health };
        let n_models_asked_for = health.n_reloads + health.n_reloads_refused;
        if n_models_asked_for == self.n_models_asked_for {
            self.supervisor.alive(status);
        } else if self.supervisor.say(format_args!("READY=1\nWATCHDOG=1\nSTATUS={status}")).is_ok() {
            self.n_models_asked_for = n_models_asked_for;
        }
    }
}

struct Status<'a> {
    sensor: &'a SensorName,
    health: &'a HealthReport,
}

impl fmt::Display for Status<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { sensor, health } = self;
        write!(f, "serving {sensor}: {} frames, {} lost, ", health.n_frames, health.n_lost)?;
        match health.has_shim() {
            true => write!(f, "the last of kind {}", health.last_kind),
            false => f.write_str("no driver shim"),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn received(socket: &UnixDatagram) -> String {
        let mut bytes = [0; 2 * N_BYTES_MAX];
        let n_bytes = socket.recv(&mut bytes).unwrap();
        String::from_utf8(bytes[..n_bytes].to_vec()).unwrap()
    }

    #[test]
    fn a_supervisor_is_reached_by_path_and_by_abstract_name() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("notify");
        let by_path = UnixDatagram::bind(&path).unwrap();
        let name = format!("kinds-test-{}", std::process::id());
        let by_name =
            UnixDatagram::bind_addr(&SocketAddr::from_abstract_name(name.as_bytes()).unwrap()).unwrap();
        for (socket, named) in [(by_path, path.to_str().unwrap().to_string()), (by_name, format!("@{name}"))]
        {
            let supervisor = Supervisor { socket: Some(Arc::new(connect(named.as_bytes()).unwrap())) };
            supervisor.ready("serving");
            assert_eq!(received(&socket), "READY=1\nSTATUS=serving");
            supervisor.alive("x".repeat(2 * N_BYTES_MAX));
            assert_eq!(received(&socket).len(), N_BYTES_MAX);
            supervisor.stopping();
            assert_eq!(received(&socket), "STOPPING=1\nSTATUS=ending");
        }
    }

    #[test]
    fn a_supervisor_that_does_not_listen_never_holds_up_the_loop() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("notify");
        let deaf = UnixDatagram::bind(&path).unwrap();
        let supervisor = Supervisor { socket: Some(Arc::new(connect(path.as_os_str().as_bytes()).unwrap())) };
        // More than any system's queue of datagrams holds by default.
        (0..5000).for_each(|_| supervisor.alive("serving"));
        assert!(supervisor.say(format_args!("WATCHDOG=1")).is_err());
        drop(deaf);
    }

    #[test]
    fn models_that_were_asked_for_are_answered_once_each() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("notify");
        let socket = UnixDatagram::bind(&path).unwrap();
        let supervisor = Supervisor { socket: Some(Arc::new(connect(path.as_os_str().as_bytes()).unwrap())) };
        let mut reporter = Reporter::new(supervisor, "crunch/ring".parse().unwrap());
        let mut health = HealthReport { n_frames: 7, ..HealthReport::default() };
        reporter.tell(&health);
        health.n_reloads_refused = 1;
        reporter.tell(&health);
        (health.flags, health.last_kind) = (HealthReport::HAS_SHIM, 2);
        reporter.tell(&health);
        let status = "STATUS=serving crunch/ring: 7 frames, 0 lost, ";
        assert_eq!(received(&socket), format!("WATCHDOG=1\n{status}no driver shim"));
        assert_eq!(received(&socket), format!("READY=1\nWATCHDOG=1\n{status}no driver shim"));
        assert_eq!(received(&socket), format!("WATCHDOG=1\n{status}the last of kind 2"));
    }
}
