//! The ways of a frame there and of its report back, from the publisher's and consumer's side.

use std::io::{BufRead, BufReader};
use std::os::unix::net::UnixDatagram;
use std::process::{Child, Command, Stdio};
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Arc, mpsc};
use std::thread::{self, JoinHandle};
use std::time::Duration;

use kinds_messages::{FrameHeader, FramePublisher, Node, OwnDomain, ReportReader, SensorName, Waiting};
use kinds_model::SensorLayout;
use tempfile::TempDir;

use crate::child::{REPORT_BYTES, bind, connect};
use crate::processors;
use crate::trained::Trained;

/// Whatever has not come by then will not come.
const DEADLINE: Duration = Duration::from_secs(10);

/// How both ends wait, and where.
#[derive(Clone, Copy)]
pub(crate) struct Condition {
    pub(crate) name: &'static str,
    pub(crate) waiting: Waiting,
    /// Of the service; publisher and consumer have the first.
    pub(crate) processor: usize,
}

/// A way there and back.
pub(crate) trait Hop {
    /// Puts what the sensor captured where it will be sent from, waits until it is due, sends it, and returns when its report
    /// is here.
    fn there_and_back(&mut self, sequence: u64, counts: &[u16], until_due: &mut dyn FnMut());
}

/// A process that runs while this lives.
struct Other(Child);

impl Other {
    /// Starts a program on the service's processor, and waits for its first line.
    fn start(condition: Condition, command: &mut Command) -> Self {
        let pinned = processors::keep_to(condition.processor);
        let child = command.stdin(Stdio::null()).stdout(Stdio::piped()).spawn();
        // It may soon poll there.
        drop(pinned);
        let mut child = child.expect("the program starts");
        let mut line = String::new();
        BufReader::new(child.stdout.take().expect("a pipe")).read_line(&mut line).expect("it says something");
        assert!(!line.is_empty(), "it ended before it was ready");
        Self(child)
    }

    /// Starts this very program as one of its children.
    fn child(condition: Condition, arguments: &[&str]) -> Self {
        let program = std::env::current_exe().expect("this program has a path");
        Self::start(condition, Command::new(program).args(arguments))
    }
}

impl Drop for Other {
    fn drop(&mut self) {
        self.0.kill().and_then(|()| self.0.wait()).expect("a child can be killed");
    }
}

/// Through shared memory, as on a robot.
pub(crate) struct Channels {
    reader: ReportReader,
    publisher: FramePublisher,
    layout: SensorLayout,
    condition: Condition,
    other: Option<Other>,
    domain: OwnDomain,
}

const SENSOR: &str = "bench/sensor";

impl Channels {
    /// To `kinds serve`.
    pub(crate) fn to_kinds(trained: &Trained, condition: Condition) -> Self {
        Self::to(trained, condition, |domain| {
            let mut command = Command::new(env!("CARGO_BIN_EXE_kinds"));
            command.arg("serve").arg("--model").arg(trained.file()).args(["--sensor", SENSOR]);
            command.arg("--domain").arg(&domain.root).env("KINDS_LOG", "warn");
            let polls = condition.waiting == Waiting::Polling;
            Other::start(condition, command.args(polls.then_some("--busy-poll")))
        })
    }

    /// To a service that answers at once.
    pub(crate) fn to_nothing(trained: &Trained, condition: Condition) -> Self {
        let SensorLayout { rows, columns, metres_per_count } = trained.model.layout();
        Self::to(trained, condition, |domain| {
            let root = domain.root.to_str().expect("a plain path");
            let layout = [rows.to_string(), columns.to_string(), metres_per_count.to_string()];
            let [rows, columns, metres] = &layout;
            Other::child(
                condition,
                &["nothing", name_of(condition.waiting), root, SENSOR, rows, columns, metres],
            )
        })
    }

    fn to(trained: &Trained, condition: Condition, start: impl FnOnce(&OwnDomain) -> Other) -> Self {
        let layout = trained.model.layout();
        let domain = OwnDomain::make().expect("there is a temporary folder");
        let other = start(&domain);
        let node = Node::open(&domain, "bench").expect("a domain of its own");
        let sensor: SensorName = SENSOR.parse().expect("the name is as it should be");
        let reader = ReportReader::open_with(&node, &sensor, condition.waiting).expect("a reader");
        let publisher = FramePublisher::create(&node, &sensor, layout.n_readings()).expect("a publisher");
        Self { reader, publisher, layout, condition, other: Some(other), domain }
    }
}

impl Hop for Channels {
    fn there_and_back(&mut self, sequence: u64, counts: &[u16], until_due: &mut dyn FnMut()) {
        let SensorLayout { rows, columns, metres_per_count } = self.layout;
        let header =
            FrameHeader { run: 1, sequence, rows, columns, metres_per_count, ..FrameHeader::default() };
        let mut loan = self.publisher.loan().expect("one loan at a time");
        loan.counts_mut().copy_from_slice(counts);
        until_due();
        loan.send(&header).expect("sending works");
        loop {
            match self.reader.receive().expect("receiving works") {
                Some(report) if report.sequence == sequence && report.run == 1 => return,
                Some(_) => {}
                None if self.condition.waiting == Waiting::Polling => std::hint::spin_loop(),
                None => drop(self.reader.wait(DEADLINE).expect("waiting works")),
            }
        }
    }
}

impl Drop for Channels {
    fn drop(&mut self) {
        // The service is killed, and who joins after it clears its place.
        drop(self.other.take());
        drop(Node::open(&self.domain, "bench-last"));
    }
}

/// Through Unix datagram sockets.
pub(crate) struct Socket {
    socket: UnixDatagram,
    report: [u8; REPORT_BYTES],
    is_one_byte: bool,
    _other: Other,
    _folder: TempDir,
}

impl Socket {
    /// To a process that classifies.
    pub(crate) fn to_classifier(trained: &Trained, condition: Condition) -> Self {
        Self::to(condition, &[trained.file().to_str().expect("a plain path")])
    }

    /// To a process that answers a byte with a byte.
    pub(crate) fn of_one_byte(condition: Condition) -> Self {
        Self::to(condition, &[])
    }

    fn to(condition: Condition, model: &[&str]) -> Self {
        let folder = tempfile::Builder::new().prefix("k").tempdir().expect("there is a temporary folder");
        let socket = bind(folder.path(), "consumer");
        let path = folder.path().to_str().expect("a plain path");
        let other = Other::child(condition, &[&["socket", name_of(condition.waiting), path], model].concat());
        connect(&socket, folder.path(), "service");
        socket.set_nonblocking(condition.waiting == Waiting::Polling).expect("a socket can poll");
        Self {
            socket,
            report: [0; REPORT_BYTES],
            is_one_byte: model.is_empty(),
            _other: other,
            _folder: folder,
        }
    }
}

impl Hop for Socket {
    fn there_and_back(&mut self, _: u64, counts: &[u16], until_due: &mut dyn FnMut()) {
        let frame = if self.is_one_byte { &[0] } else { bytemuck::cast_slice(counts) };
        until_due();
        self.socket.send(frame).expect("sending works");
        while self.socket.recv(&mut self.report).is_err() {
            std::hint::spin_loop();
        }
    }
}

/// A number that another thread adds one to.
pub(crate) struct OneNumber {
    numbers: Arc<[Line; 2]>,
    thread: Option<JoinHandle<()>>,
}

/// A number with a cache line of its own.
#[repr(align(128))]
#[derive(Default)]
struct Line(AtomicU64);

const STOP: u64 = u64::MAX;

impl OneNumber {
    pub(crate) fn begin() -> Self {
        let numbers = Arc::new([Line::default(), Line::default()]);
        let theirs = Arc::clone(&numbers);
        let (is_there, await_there) = mpsc::channel();
        let thread = thread::spawn(move || {
            let _pinned = processors::keep_to(1);
            is_there.send(()).expect("it is waited for");
            let [there, back] = &*theirs;
            loop {
                match there.0.load(Ordering::Acquire) {
                    STOP => return,
                    number => back.0.store(number, Ordering::Release),
                }
                std::hint::spin_loop();
            }
        });
        await_there.recv().expect("the thread keeps to a processor");
        Self { numbers, thread: Some(thread) }
    }
}

impl Hop for OneNumber {
    fn there_and_back(&mut self, sequence: u64, _: &[u16], until_due: &mut dyn FnMut()) {
        until_due();
        let [there, back] = &*self.numbers;
        there.0.store(sequence + 1, Ordering::Release);
        while back.0.load(Ordering::Acquire) != sequence + 1 {
            std::hint::spin_loop();
        }
    }
}

impl Drop for OneNumber {
    fn drop(&mut self) {
        self.numbers[0].0.store(STOP, Ordering::Release);
        self.thread.take().expect("it runs").join().expect("it ends");
    }
}

fn name_of(waiting: Waiting) -> &'static str {
    match waiting {
        Waiting::ByEvent => "by-event",
        Waiting::Polling => "polling",
    }
}
