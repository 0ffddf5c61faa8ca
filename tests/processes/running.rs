//! A program of a robot while it runs: what it prints, signals to it, and its end.

use std::io::{BufRead, BufReader, Read};
use std::process::{Child, ChildStdout, Command, ExitStatus};
use std::sync::{Arc, Condvar, Mutex};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

use rustix::process::{Pid, Signal, kill_process, kill_process_group};

/// Nothing here takes nearly as long; whatever has not come by then will not come.
pub(crate) const DEADLINE: Duration = Duration::from_secs(60);

/// Between two looks at a condition that nobody tells of.
const LOOK: Duration = Duration::from_millis(5);

/// A program that runs. Killed when it goes out of scope before its end.
pub(crate) struct Running {
    arguments: String,
    child: Child,
    /// None where the caller has it.
    out: Option<Lines>,
    err: Lines,
}

/// How a program ended.
#[derive(Debug)]
pub(crate) struct Outcome {
    /// None if a signal ended it.
    pub(crate) code: Option<i32>,
    pub(crate) stdout: String,
    pub(crate) stderr: String,
}

impl Running {
    /// Starts a program whose outputs are pipes.
    pub(crate) fn start(command: &mut Command) -> Self {
        let (mut running, stdout) = Self::start_into(command);
        running.out = Some(Lines::of(stdout));
        running
    }

    /// As [`Self::start`], with standard output left to the caller.
    pub(crate) fn start_into(command: &mut Command) -> (Self, ChildStdout) {
        let arguments: Vec<_> = command.get_args().map(|argument| argument.to_string_lossy()).collect();
        let arguments = arguments.join(" ");
        let mut child = command.spawn().unwrap();
        let (stdout, err) = (child.stdout.take().unwrap(), Lines::of(child.stderr.take().unwrap()));
        (Self { arguments, child, out: None, err }, stdout)
    }

    /// Waits for a line on standard output that begins so, and returns it.
    #[track_caller]
    pub(crate) fn await_out(&self, beginning: &str) -> String {
        self.out.as_ref().unwrap().wait_for(beginning).unwrap_or_else(|lines| {
            panic!("kinds {}: no {beginning:?} in {lines:?}; {:?}", self.arguments, self.err())
        })
    }

    /// Waits for a line on standard output of which something holds, and returns it.
    ///
    /// * `n_before` — lines before it, that are passed over
    /// * `what` — in words, for who reads why the test failed
    #[track_caller]
    pub(crate) fn await_line(&self, n_before: usize, what: &str, holds: impl Fn(&str) -> bool) -> String {
        self.out.as_ref().unwrap().wait_until(n_before, holds).unwrap_or_else(|lines| {
            panic!("kinds {}: no {what:?} in {lines:?}; {:?}", self.arguments, self.err())
        })
    }

    /// Waits for a line on standard error that begins so, and returns it.
    pub(crate) fn await_err(&self, beginning: &str) -> String {
        self.err
            .wait_for(beginning)
            .unwrap_or_else(|lines| panic!("kinds {}: no {beginning:?} in {lines:?}", self.arguments))
    }

    /// How many lines it has printed so far.
    pub(crate) fn n_out(&self) -> usize {
        self.out.as_ref().unwrap().shared.0.lock().unwrap().lines.len()
    }

    /// What it has said on standard error so far.
    pub(crate) fn err(&self) -> Vec<String> {
        self.err.so_far()
    }

    /// The system's line about it that begins so, without the beginning (`/proc/PID/status`).
    pub(crate) fn status(&self, beginning: &str) -> String {
        let status = std::fs::read_to_string(format!("/proc/{}/status", self.child.id())).unwrap();
        status.lines().find_map(|line| line.strip_prefix(beginning)).unwrap().trim().to_string()
    }

    /// Stops it (SIGSTOP), and returns when it stands still.
    pub(crate) fn freeze(&self) {
        self.signal(Signal::STOP);
        await_that(|| self.status("State:").starts_with('T'));
    }

    /// Its process.
    pub(crate) fn pid(&self) -> u32 {
        self.child.id()
    }

    pub(crate) fn has_ended(&mut self) -> bool {
        self.child.try_wait().unwrap().is_some()
    }

    pub(crate) fn signal(&self, signal: Signal) {
        kill_process(Pid::from_child(&self.child), signal).unwrap();
    }

    /// What Ctrl-C in a terminal does: the signal goes to the whole process group.
    pub(crate) fn signal_group(&self, signal: Signal) {
        kill_process_group(Pid::from_child(&self.child), signal).unwrap();
    }

    /// Kills it (SIGKILL), and returns when it is gone.
    pub(crate) fn kill(mut self) {
        self.child.kill().unwrap();
        self.wait();
    }

    /// Waits for its end, and for the end of what it wrote.
    pub(crate) fn end(mut self) -> Outcome {
        let status = self.wait();
        let text = |lines: &mut Lines| lines.whole().iter().map(|line| format!("{line}\n")).collect();
        Outcome {
            code: status.code(),
            stdout: self.out.as_mut().map_or(String::new(), text),
            stderr: text(&mut self.err),
        }
    }

    /// Sends a signal, waits for the end, which must be a good one, and returns what was printed.
    pub(crate) fn stop(self, signal: Signal) -> String {
        self.signal(signal);
        let arguments = self.arguments.clone();
        let outcome = self.end();
        assert_eq!(outcome.code, Some(0), "kinds {arguments} said {:?}", outcome.stderr);
        outcome.stdout
    }

    fn wait(&mut self) -> ExitStatus {
        await_that(|| self.has_ended());
        self.child.wait().unwrap()
    }
}

impl Drop for Running {
    fn drop(&mut self) {
        if let Ok(None) = self.child.try_wait() {
            // With all that it has started, where it has a process group of its own.
            let _ = kill_process_group(Pid::from_child(&self.child), Signal::KILL);
            let _ = self.child.kill();
            let _ = self.child.wait();
        }
    }
}

/// Waits for a condition that nobody tells of.
#[track_caller]
pub(crate) fn await_that(mut condition: impl FnMut() -> bool) {
    let start = Instant::now();
    while !condition() {
        assert!(start.elapsed() < DEADLINE, "what was waited for has not come");
        std::thread::sleep(LOOK);
    }
}

/// The lines that a program writes, as they come.
struct Lines {
    shared: Arc<(Mutex<Written>, Condvar)>,
    reading: Option<JoinHandle<()>>,
}

#[derive(Default)]
struct Written {
    lines: Vec<String>,
    ended: bool,
}

impl Lines {
    fn of(stream: impl Read + Send + 'static) -> Self {
        let shared: Arc<(Mutex<Written>, Condvar)> = Arc::default();
        let theirs = Arc::clone(&shared);
        let reading = std::thread::spawn(move || {
            let (written, news) = &*theirs;
            for line in BufReader::new(stream).lines() {
                written.lock().unwrap().lines.push(line.unwrap());
                news.notify_all();
            }
            written.lock().unwrap().ended = true;
            news.notify_all();
        });
        Self { shared, reading: Some(reading) }
    }

    /// The first line that begins so, or all lines if there is none until the end or the deadline.
    fn wait_for(&self, beginning: &str) -> Result<String, Vec<String>> {
        self.wait_until(0, |line| line.trim_start().starts_with(beginning))
    }

    /// The first line after so many of which something holds, or all lines if there is none until the end or the deadline.
    fn wait_until(&self, n_before: usize, holds: impl Fn(&str) -> bool) -> Result<String, Vec<String>> {
        let (written, news) = &*self.shared;
        let found = |written: &Written| written.lines.iter().skip(n_before).find(|line| holds(line)).cloned();
        let (written, _) = news
            .wait_timeout_while(written.lock().unwrap(), DEADLINE, |written| {
                found(written).is_none() && !written.ended
            })
            .unwrap();
        found(&written).ok_or_else(|| written.lines.clone())
    }

    fn so_far(&self) -> Vec<String> {
        self.shared.0.lock().unwrap().lines.clone()
    }

    /// All lines, when the stream has ended.
    fn whole(&mut self) -> Vec<String> {
        if let Some(reading) = self.reading.take() {
            reading.join().unwrap();
        }
        self.so_far()
    }
}
