//! A robot of a test: a folder to work in, a domain of its own, and the programs that it runs.

use std::collections::BTreeMap;
use std::os::unix::process::CommandExt;
use std::path::PathBuf;
use std::process::{ChildStdout, Command, Stdio};

use kinds_messages::{Domain, FrameReader, Node, OwnDomain};
use rustix::process::Signal;
use rustix::thread::{CapabilitySet, remove_capability_from_bounding_set};

use crate::consumer::Consumer;
use crate::running::{Outcome, Running};
use crate::world::Trip;

pub(crate) const SENSOR: &str = "crunch/ring";

pub(crate) const FIRST: &str = "first.mcap";
pub(crate) const SECOND: &str = "second.mcap";
pub(crate) const MODEL: &str = "m.kinds";

/// What a test asks for that does not care how many neighbours, dimensions and kinds there are: choosing them takes longer
/// than all the rest.
pub(crate) const SIZE: [&str; 6] = ["--neighbors", "10", "--dims", "8", "--kinds", "5"];

/// A folder to work in and a domain of its own, gone with all that is in them at the end.
pub(crate) struct Robot {
    domain: OwnDomain,
    folder: tempfile::TempDir,
}

impl Robot {
    pub(crate) fn new() -> Self {
        // A short name: a demo's domain lives in it, and paths of sockets have a limit.
        let folder = tempfile::Builder::new().prefix("k").tempdir().unwrap();
        std::fs::create_dir(folder.path().join("work")).unwrap();
        std::fs::create_dir(folder.path().join("tmp")).unwrap();
        Self { domain: OwnDomain::make().unwrap(), folder }
    }

    /// One with two trips, [`FIRST`] and [`SECOND`], and the model of the first, [`MODEL`].
    pub(crate) fn trained() -> Self {
        let robot = Self::new();
        Trip::FIRST.write(&robot.path(FIRST));
        Trip::SECOND.write(&robot.path(SECOND));
        robot.succeed(&[&["train", FIRST, "--output", MODEL][..], &SIZE].concat());
        robot
    }

    /// One with a model of the simulated Crunch's sensor, [`MODEL`], learnt from its own trip.
    pub(crate) fn crunch() -> Self {
        const DRIVE: &str = "drive.mcap";
        let robot = Self::new();
        let recorder = robot.start(&["record", "--sensor", SENSOR, "--output", DRIVE, "--count", "300"]);
        recorder.await_err("kinds: waiting for a driver shim to publish crunch/ring");
        let shim = robot.start(&["publish", "--simulate", "crunch", "--sensor", SENSOR, "--speed", "100"]);
        assert_eq!(recorder.end().code, Some(0));
        shim.stop(Signal::TERM);
        robot.succeed(&[&["train", DRIVE, "--output", MODEL][..], &SIZE].concat());
        robot
    }

    /// Path of a file in the folder that programs work in. They are told its name only, so that what they print is the
    /// same wherever the folder is.
    pub(crate) fn path(&self, name: &str) -> PathBuf {
        self.folder.path().join("work").join(name)
    }

    /// The folder that programs take for that of temporary files.
    pub(crate) fn temporary_folder(&self) -> PathBuf {
        self.folder.path().join("tmp")
    }

    pub(crate) fn write(&self, name: &str, bytes: impl AsRef<[u8]>) {
        std::fs::write(self.path(name), bytes).unwrap();
    }

    pub(crate) fn read(&self, name: &str) -> Vec<u8> {
        std::fs::read(self.path(name)).unwrap()
    }

    /// All files that programs work with, by their path in that folder.
    pub(crate) fn files(&self) -> BTreeMap<PathBuf, Vec<u8>> {
        let mut files = BTreeMap::new();
        let root = self.path("");
        let mut folders = vec![root.clone()];
        while let Some(folder) = folders.pop() {
            for entry in std::fs::read_dir(folder).unwrap() {
                let path = entry.unwrap().path();
                match path.is_dir() {
                    true => folders.push(path),
                    false => {
                        let bytes = std::fs::read(&path).unwrap();
                        files.insert(path.strip_prefix(&root).unwrap().to_path_buf(), bytes);
                    }
                }
            }
        }
        files
    }

    /// A program of this robot that has not been started.
    pub(crate) fn command(&self, arguments: &[&str]) -> Command {
        self.command_of(env!("CARGO_BIN_EXE_kinds"), arguments)
    }

    /// Another program, as one of this robot.
    pub(crate) fn command_of(&self, program: &str, arguments: &[&str]) -> Command {
        let mut command = Command::new(program);
        command
            .args(arguments)
            .current_dir(self.path(""))
            .env("KINDS_DOMAIN", &self.domain.root)
            .env("TMPDIR", self.temporary_folder())
            .env_remove("KINDS_LOG")
            .env_remove("KINDS_LOG_FORMAT")
            .stdin(Stdio::null())
            .stdout(Stdio::piped())
            .stderr(Stdio::piped());
        command
    }

    /// Starts a program.
    pub(crate) fn start(&self, arguments: &[&str]) -> Running {
        Running::start(&mut self.command(arguments))
    }

    /// Starts a program within a limit, and without the right to exceed it.
    ///
    /// * `limit` — what `ulimit` is told, such as `-l 64`
    pub(crate) fn start_limited(&self, limit: &str, right: CapabilitySet, arguments: &[&str]) -> Running {
        let script = format!("ulimit {limit} && exec \"$0\" \"$@\"");
        let mut command =
            self.command_of("sh", &[&["-c", &script, env!("CARGO_BIN_EXE_kinds")], arguments].concat());
        // The right to exceed limits is a thread's, and those that it starts have it only if it does. Who may not give it up
        // has not got it.
        std::thread::scope(|scope| {
            let started = scope.spawn(|| {
                let _ = remove_capability_from_bounding_set(right);
                Running::start(&mut command)
            });
            started.join().unwrap()
        })
    }

    /// Starts a program whose standard output is left to the caller.
    pub(crate) fn start_into(&self, arguments: &[&str]) -> (Running, ChildStdout) {
        Running::start_into(&mut self.command(arguments))
    }

    /// Starts a program in a process group of its own, as a shell does.
    pub(crate) fn start_group(&self, arguments: &[&str]) -> Running {
        Running::start(self.command(arguments).process_group(0))
    }

    /// Runs a program to its end.
    pub(crate) fn run(&self, arguments: &[&str]) -> Outcome {
        self.start(arguments).end()
    }

    /// Runs a program that must succeed, and returns what it printed.
    pub(crate) fn succeed(&self, arguments: &[&str]) -> String {
        let outcome = self.run(arguments);
        assert_eq!(outcome.code, Some(0), "kinds {arguments:?} said {:?}", outcome.stderr);
        outcome.stdout
    }

    /// Runs a program that must end with this exit code, with this sentence and no other on standard error, with
    /// nothing on standard output, and with every file as it was.
    pub(crate) fn refuse(&self, arguments: &[&str], code: i32, sentence: &str) {
        let said = self.refusal(arguments, code);
        assert_eq!(said, sentence, "kinds {arguments:?}");
    }

    /// As [`Self::refuse`], for sentences that are not ours alone: they must hold all these parts.
    pub(crate) fn refuse_with(&self, arguments: &[&str], code: i32, parts: &[&str]) {
        let said = self.refusal(arguments, code);
        for part in parts {
            assert!(said.contains(part), "kinds {arguments:?} said {said:?}, without {part:?}");
        }
    }

    fn refusal(&self, arguments: &[&str], code: i32) -> String {
        let before = self.files();
        let outcome = self.run(arguments);
        assert_eq!(outcome.code, Some(code), "kinds {arguments:?} said {:?}", outcome.stderr);
        assert_eq!(outcome.stdout, "", "kinds {arguments:?}");
        let after = self.files();
        assert!(after.keys().eq(before.keys()), "kinds {arguments:?} left {:?}", after.keys());
        assert!(after == before, "kinds {arguments:?} changed a file");
        // What is said of flags goes on with how to get help.
        let first = outcome.stderr.lines().next().unwrap_or_default();
        let Some(sentence) = first.strip_prefix("kinds: ") else { return first.to_string() };
        assert_eq!(outcome.stderr.lines().count(), 1, "kinds {arguments:?} said more: {:?}", outcome.stderr);
        sentence.to_string()
    }

    /// Starts a service of the model and waits until it serves.
    pub(crate) fn serve(&self) -> Running {
        self.serve_with(&[])
    }

    /// The same with more flags.
    pub(crate) fn serve_with(&self, flags: &[&str]) -> Running {
        let service = self.start(&[&["serve", "--model", MODEL, "--sensor", SENSOR], flags].concat());
        service.await_out(&format!("serving {SENSOR}: "));
        service
    }

    /// Starts the replay of a trip.
    pub(crate) fn publish(&self, trip: &str, speed: &str) -> Running {
        self.start(&["publish", "--trip", trip, "--sensor", SENSOR, "--speed", speed])
    }

    /// Joins the robot's domain, in this process, as a reader of frames.
    pub(crate) fn join_frames(&self) -> FrameReader {
        FrameReader::open(&self.node(), &SENSOR.parse().unwrap()).unwrap()
    }

    /// This process as a member of the robot's domain.
    pub(crate) fn node(&self) -> Node {
        Node::open(&self.domain, "test").unwrap()
    }

    pub(crate) fn domain(&self) -> &Domain {
        &self.domain
    }

    /// Joins the robot's domain, in this process, as a reader of kind reports.
    pub(crate) fn join(&self) -> Consumer {
        Consumer::join(&self.domain, SENSOR)
    }

    /// Files of this domain in shared memory, but for the one that the transport keeps by design.
    pub(crate) fn shared_memory(&self) -> Vec<String> {
        shared_memory(&self.domain)
    }
}

impl Drop for Robot {
    fn drop(&mut self) {
        // A test that fails kills its programs. Whoever joins cleans up after them.
        drop(Node::open(&self.domain, "last"));
    }
}

/// Files of a domain in shared memory, but for the one of 16 bytes that the transport keeps by design.
pub(crate) fn shared_memory(domain: &Domain) -> Vec<String> {
    let is_remains = |entry: &std::fs::DirEntry, name: &str| {
        name.ends_with(".global_mgmt") && entry.metadata().is_ok_and(|metadata| metadata.len() == 16)
    };
    let entries = std::fs::read_dir("/dev/shm").unwrap().map(Result::unwrap);
    let names = entries.filter_map(|entry| {
        let name = entry.file_name().into_string().unwrap();
        (name.starts_with(&domain.prefix) && !is_remains(&entry, &name)).then_some(name)
    });
    names.collect()
}
