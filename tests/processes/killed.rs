//! Programs that are killed at every call by which they change what others find in files and shared memory, from their first to
//! their last: whatever is left half done, the others go on, and the next program of the kind takes the place.

#![allow(clippy::print_stderr, reason = "a test that is skipped says so")]

use std::process::Command;

use rustix::process::Signal;

use crate::robot::{MODEL, Robot, SENSOR};
use crate::running::{Running, await_that};

const SHIM: [&str; 7] = ["publish", "--device", "stdin", "--columns", "16", "--sensor", SENSOR];
const SERVICE: [&str; 5] = ["serve", "--model", MODEL, "--sensor", SENSOR];
const CONSUMER: [&str; 6] = ["watch", "--sensor", SENSOR, "--json", "--count", "2"];

/// A robot whose programs can be killed at a call.
struct Doomed {
    robot: Robot,
    library: String,
}

impl Doomed {
    /// None, in words, where there is no compiler.
    fn new() -> Option<Self> {
        let robot = Robot::crunch();
        let library = robot.path("killed_at.so").display().to_string();
        let source = concat!(env!("CARGO_MANIFEST_DIR"), "/tests/processes/killed_at.c");
        let arguments = ["-std=gnu11", "-shared", "-fPIC", "-o", &library, source, "-ldl"];
        let Ok(compiled) = Command::new("cc").args(arguments).output() else {
            eprintln!("skipped: there is no cc");
            return None;
        };
        assert!(compiled.status.success(), "{}", String::from_utf8_lossy(&compiled.stderr));
        Some(Self { robot, library })
    }

    fn start(&self, arguments: &[&str], (what, of): (&str, &str)) -> Running {
        let mut command = self.robot.command(arguments);
        Running::start(command.env("LD_PRELOAD", &self.library).env(what, of))
    }

    /// How many such calls the program makes from its start to its good end.
    ///
    /// * `live` — does with it what makes it end
    fn n_calls(&self, arguments: &[&str], live: impl Fn(&mut Running)) -> usize {
        let mut program = self.start(arguments, ("COUNTED", "counted"));
        live(&mut program);
        succeeds(program, 0);
        let counted = String::from_utf8(self.robot.read("counted")).unwrap();
        counted.parse().unwrap()
    }

    /// Starts it and waits until it is killed at a call.
    fn kill_at(&self, call: usize, arguments: &[&str], live: impl Fn(&mut Running)) {
        let mut program = self.start(arguments, ("KILLED_AT", &call.to_string()));
        live(&mut program);
        let outcome = program.end();
        assert_eq!(outcome.code, None, "call {call} of {arguments:?}: {outcome:?}");
    }
}

/// Asserts that a program comes to its end, and a good one.
fn succeeds(program: Running, after: usize) {
    let outcome = program.end();
    assert_eq!(outcome.code, Some(0), "after one that was killed at call {after}: {outcome:?}");
}

/// What a program needs that comes to its end by itself.
fn nothing(_: &mut Running) {}

/// Ends a service as soon as it says that it serves, unless it ended before.
fn end_when_it_serves(service: &mut Running) {
    await_that(|| service.n_out() > 0 || service.has_ended());
    if !service.has_ended() {
        service.signal(Signal::TERM);
    }
}

#[test]
fn a_shim_that_is_killed_at_any_call_is_followed_by_another() {
    let Some(doomed) = Doomed::new() else { return };
    let robot = &doomed.robot;
    let service = robot.start(&SERVICE);
    service.await_out("serving");
    let n_calls = doomed.n_calls(&SHIM, nothing);
    assert!(n_calls > 20, "{n_calls}");
    for call in 1..=n_calls {
        doomed.kill_at(call, &SHIM, nothing);
        // A second one is killed while it takes the place of the first.
        doomed.kill_at(1 + 7 * call % 20, &SHIM, nothing);
        succeeds(robot.start(&SHIM), call);
    }
    service.stop(Signal::TERM);
}

#[test]
fn a_service_or_a_consumer_that_is_killed_at_any_call_is_followed_by_another_and_reports_come() {
    let Some(doomed) = Doomed::new() else { return };
    let robot = &doomed.robot;
    let shim = robot.start(&["publish", "--simulate", "crunch", "--sensor", SENSOR, "--speed", "10"]);
    let n_calls = doomed.n_calls(&SERVICE, end_when_it_serves);
    assert!(n_calls > 100, "{n_calls}");
    for call in (1..=n_calls).step_by(4) {
        doomed.kill_at(call, &SERVICE, end_when_it_serves);
        let service = robot.start(&SERVICE);
        service.await_out("serving");
        doomed.kill_at(1 + call % 30, &CONSUMER, nothing);
        succeeds(robot.start(&CONSUMER), call);
        service.stop(Signal::TERM);
    }
    shim.stop(Signal::TERM);
}
