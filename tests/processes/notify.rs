//! What a program tells its supervisor, over a socket as systemd's.

use std::io::ErrorKind;
use std::os::linux::net::SocketAddrExt;
use std::os::unix::net::{SocketAddr, UnixDatagram};

use rustix::process::Signal;

use crate::robot::{MODEL, Robot, SECOND, SENSOR};
use crate::running::{DEADLINE, Running};

/// A supervisor: it hears what is told by whoever it has started.
struct Supervisor {
    socket: UnixDatagram,
    name: String,
}

impl Supervisor {
    fn by_path(robot: &Robot) -> Self {
        let path = robot.path("notify");
        Self::new(UnixDatagram::bind(&path).unwrap(), path.to_str().unwrap().to_string())
    }

    fn by_abstract_name(robot: &Robot) -> Self {
        let name = robot.path("notify").display().to_string();
        let address = SocketAddr::from_abstract_name(name.as_bytes()).unwrap();
        Self::new(UnixDatagram::bind_addr(&address).unwrap(), format!("@{name}"))
    }

    fn new(socket: UnixDatagram, name: String) -> Self {
        socket.set_read_timeout(Some(DEADLINE)).unwrap();
        Self { socket, name }
    }

    fn start(&self, robot: &Robot, arguments: &[&str]) -> Running {
        Running::start(robot.command(arguments).env("NOTIFY_SOCKET", &self.name))
    }

    /// The next message.
    fn next(&self) -> String {
        let mut bytes = [0; 1024];
        let n_bytes = self.socket.recv(&mut bytes).unwrap();
        String::from_utf8(bytes[..n_bytes].to_vec()).unwrap()
    }

    /// The next message that begins so.
    fn await_that(&self, beginning: &str) -> String {
        loop {
            let message = self.next();
            if message.starts_with(beginning) {
                return message;
            }
            assert!(message.starts_with("WATCHDOG=1\n"), "{message:?} instead of {beginning:?}");
        }
    }

    /// Messages that have come.
    fn drain(&self) -> usize {
        self.socket.set_nonblocking(true).unwrap();
        let mut n_messages = 0;
        let end = loop {
            match self.socket.recv(&mut [0; 1024]) {
                Ok(_) => n_messages += 1,
                Err(error) => break error,
            }
        };
        assert_eq!(end.kind(), ErrorKind::WouldBlock);
        self.socket.set_nonblocking(false).unwrap();
        n_messages
    }
}

#[test]
fn a_service_tells_its_supervisor_when_it_is_ready_reloads_lives_and_ends() {
    let robot = Robot::trained();
    for supervisor in [Supervisor::by_path(&robot), Supervisor::by_abstract_name(&robot)] {
        let service = supervisor.start(&robot, &["serve", "--model", MODEL, "--sensor", SENSOR]);
        let ready = supervisor.next();
        assert!(ready.starts_with("READY=1\nSTATUS=serving crunch/ring: 5 kinds of 16 readings"), "{ready}");
        // Alive without any frame.
        let alive = supervisor.next();
        assert_eq!(alive, "WATCHDOG=1\nSTATUS=serving crunch/ring: 0 frames, 0 lost, no driver shim");
        service.signal(Signal::HUP);
        let reloading = supervisor.await_that("RELOADING=1\nMONOTONIC_USEC=");
        let at_us: u64 = reloading.lines().nth(1).unwrap().split('=').nth(1).unwrap().parse().unwrap();
        assert!(at_us > 0 && at_us <= kinds_messages::monotonic_ns() / 1000);
        let reloaded = supervisor.await_that("READY=1\n");
        assert!(reloaded.contains("\nSTATUS=serving crunch/ring: "), "{reloaded}");
        // One that is refused ends in ready, too.
        let refused = robot.run(&["reload", "--sensor", SENSOR, "--model", "none.kinds"]);
        assert_eq!(refused.code, Some(1), "{refused:?}");
        supervisor.await_that("RELOADING=1\n");
        supervisor.await_that("READY=1\n");
        service.signal(Signal::TERM);
        supervisor.await_that("STOPPING=1\n");
        assert_eq!(service.end().code, Some(0));
    }
}

#[test]
fn a_loop_that_does_not_turn_is_silent_and_is_heard_again_when_it_does() {
    let robot = Robot::trained();
    let supervisor = Supervisor::by_path(&robot);
    let service = supervisor.start(&robot, &["serve", "--model", MODEL, "--sensor", SENSOR]);
    supervisor.await_that("READY=1\n");
    supervisor.await_that("WATCHDOG=1\n");
    service.freeze();
    supervisor.drain();
    // Longer than any that is heard.
    std::thread::sleep(std::time::Duration::from_millis(2500));
    assert_eq!(supervisor.drain(), 0);
    service.signal(Signal::CONT);
    supervisor.await_that("WATCHDOG=1\n");
    service.stop(Signal::TERM);
}

#[test]
fn a_shim_that_waits_and_a_recorder_without_frames_are_alive() {
    let robot = Robot::trained();
    let supervisor = Supervisor::by_path(&robot);
    // Nobody reads: the first frame of a replay waits.
    let shim = supervisor.start(&robot, &["publish", "--trip", SECOND, "--sensor", SENSOR]);
    assert_eq!(supervisor.next(), "READY=1\nSTATUS=publishing crunch/ring");
    for _ in 0..2 {
        assert_eq!(supervisor.next(), "WATCHDOG=1\nSTATUS=publishing crunch/ring");
    }
    shim.signal(Signal::TERM);
    supervisor.await_that("STOPPING=1\n");
    shim.end();
    let recorder = supervisor.start(&robot, &["record", "--sensor", SENSOR, "--output", "trip.mcap"]);
    assert_eq!(supervisor.next(), "READY=1\nSTATUS=recording crunch/ring into trip.mcap");
    assert_eq!(
        supervisor.next(),
        "WATCHDOG=1\nSTATUS=recording crunch/ring into trip.mcap: 0 frames, 0 lost"
    );
    recorder.signal(Signal::TERM);
    supervisor.await_that("STOPPING=1\n");
    recorder.end();
}

#[test]
fn a_supervisor_that_is_gone_is_told_of_and_missed_by_nobody() {
    let robot = Robot::trained();
    let path = robot.path("nobody");
    let mut command = robot.command(&["serve", "--model", MODEL, "--sensor", SENSOR]);
    let service = Running::start(command.env("NOTIFY_SOCKET", &path));
    service.await_out("serving crunch/ring: ");
    service.await_err(&format!("WARN cannot reach the supervisor at NOTIFY_SOCKET={}: ", path.display()));
    service.stop(Signal::TERM);
}
