//! The demo's service and shim: processes of this same program, in a domain of their own.

use std::ffi::OsStr;
use std::io::{BufRead, BufReader};
use std::os::unix::process::CommandExt;
use std::process::{Child, ChildStdin, Command, ExitStatus, Stdio};

use kinds_messages::{Domain, SensorName};
use rustix::process::{Pid, Signal, kill_process};

use crate::failure::Failure;

/// Another process of this program. It ends with this one, however this one ends; and is ended, and waited for, if it is
/// still there when this goes out of scope.
pub(crate) struct Process {
    name: &'static str,
    child: Child,
    /// Its standard input, which ends with us. Not left to the child, whose `wait` would close it.
    _leash: Option<ChildStdin>,
}

impl Process {
    /// Starts `kinds NAME` for a sensor.
    pub(crate) fn start(
        domain: &Domain,
        sensor: &SensorName,
        name: &'static str,
        arguments: &[&OsStr],
    ) -> Result<Self, Failure> {
        let failed = |error| Failure::CouldNot(format!("cannot start kinds {name}: {error}"));
        let program = std::env::current_exe().map_err(failed)?;
        let mut command = Command::new(program);
        command
            .arg(name)
            .arg("--domain")
            .arg(&domain.root)
            .args(["--owned", "--sensor", &sensor.to_string()])
            .args(arguments)
            .stdin(Stdio::piped())
            .stdout(Stdio::piped());
        // A group of its own: Ctrl-C in a terminal reaches us alone, and we end it, once. A second signal would end it at once
        // and leave what it has in shared memory.
        command.process_group(0);
        // What they have to say is said here.
        command.env("KINDS_LOG", "warn");
        let mut child = command.spawn().map_err(failed)?;
        let leash = child.stdin.take();
        Ok(Self { name, child, _leash: leash })
    }

    /// Waits for its first line: it is ready.
    pub(crate) fn await_line(&mut self) -> Result<(), Failure> {
        let mut line = String::new();
        if let Some(out) = self.child.stdout.as_mut() {
            BufReader::new(out).read_line(&mut line)?;
        }
        // It has ended without a word: say how.
        if line.is_empty() { self.end_well() } else { Ok(()) }
    }

    pub(crate) fn has_ended(&mut self) -> Result<bool, Failure> {
        Ok(self.wait_result(Child::try_wait)?.is_some())
    }

    pub(crate) fn terminate(&mut self) {
        // A process that is gone needs no signal.
        let _ = kill_process(Pid::from_child(&self.child), Signal::TERM);
    }

    /// Waits for its end, which must be a good one.
    pub(crate) fn end_well(&mut self) -> Result<(), Failure> {
        let status = self.wait_result(Child::wait)?;
        match status.success() {
            true => Ok(()),
            false => Err(Failure::CouldNot(format!("kinds {} ended with {status}", self.name))),
        }
    }

    fn wait_result<T>(&mut self, wait: impl FnOnce(&mut Child) -> std::io::Result<T>) -> Result<T, Failure> {
        wait(&mut self.child)
            .map_err(|error| Failure::CouldNot(format!("cannot wait for kinds {}: {error}", self.name)))
    }
}

impl Drop for Process {
    fn drop(&mut self) {
        if let Ok(None) = self.child.try_wait() {
            self.terminate();
            let _: std::io::Result<ExitStatus> = self.child.wait();
        }
    }
}
