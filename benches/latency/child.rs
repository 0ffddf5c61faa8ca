//! What this program does as the other end of a way. It says a line when it is ready, and runs until it is killed.

use std::os::unix::net::UnixDatagram;
use std::path::Path;
use std::sync::Arc;
use std::sync::atomic::AtomicBool;

use bytes::Bytes;
use kinds_messages::{Domain, KindReport, Node, Waiting};
use kinds_model::{
    Classification, Classifier, Command, Filter, MedianFilter, ModelId, SensorLayout, Status, file,
};
use kinds_service::{Classify, DriftWindow, Service};

pub(crate) const REPORT_BYTES: usize = size_of::<KindReport>();
const FRAME_READINGS_MAX: usize = 19840;

/// Is the other end if the arguments say so, and then does not return but when it cannot go on.
pub(crate) fn run_if_one(arguments: &[String]) -> bool {
    let arguments: Vec<&str> = arguments.iter().map(String::as_str).collect();
    match arguments[..] {
        ["nothing", waiting, root, sensor, rows, columns, metres_per_count] => {
            let layout = SensorLayout {
                rows: rows.parse().expect("a number"),
                columns: columns.parse().expect("a number"),
                metres_per_count: metres_per_count.parse().expect("a number"),
            };
            serve_nothing(waiting_of(waiting), Path::new(root), sensor, layout);
        }
        ["socket", waiting, folder] => echo(waiting_of(waiting), Path::new(folder)),
        ["socket", waiting, folder, model] => {
            classify(waiting_of(waiting), Path::new(folder), Path::new(model));
        }
        _ => return false,
    }
    true
}

/// Knows the answer before it has seen the frame.
struct Nothing {
    layout: SensorLayout,
    classification: Classification,
}

impl Classify for Nothing {
    fn layout(&self) -> SensorLayout {
        self.layout
    }

    fn model_id(&self) -> ModelId {
        ModelId([0; 16])
    }

    fn introduce(&self, report: &mut KindReport) {
        report.set_kinds(0..self.classification.probabilities.len() as u32, (1..8).map(|from| (0, from)));
    }

    fn compares_commands(&self) -> bool {
        false
    }

    fn is_novel(&self, _novelty: f64) -> bool {
        false
    }

    fn median(&self) -> Option<MedianFilter> {
        None
    }

    fn filter(&self) -> Filter {
        Filter::new(0.0, &self.classification.probabilities)
    }

    fn drift(&self) -> DriftWindow {
        DriftWindow::new(&self.classification.probabilities, 0.01, None)
    }

    fn half_split_error(&mut self) -> Option<f64> {
        None
    }

    fn classify(&mut self, _: &[u16], _: Option<Command>) -> &Classification {
        &self.classification
    }
}

fn serve_nothing(waiting: Waiting, root: &Path, sensor: &str, layout: SensorLayout) {
    let classification = Classification {
        status: Status::Classified,
        kind: 0,
        n_invalid: 0,
        probabilities: vec![1.0 / 8.0; 8],
        coordinates: vec![0.0; 15],
        log_likelihood: 0.0,
        novelty: 0.0,
    };
    let node = Node::open(&Domain::in_folder(root), "bench-service").expect("the domain is there");
    let sensor = sensor.parse().expect("the name is as it should be");
    let service = Service::start_with(&node, &sensor, Nothing { layout, classification }, waiting);
    println!("ready");
    service.expect("a service").run(&AtomicBool::new(false)).expect("serving works");
}

fn classify(waiting: Waiting, folder: &Path, model: &Path) {
    let bytes = Bytes::from(std::fs::read(model).expect("the model is there"));
    let mut classifier = Classifier::new(Arc::new(file::from_bytes(&bytes).expect("it is a model")));
    let mut counts = vec![0_u16; FRAME_READINGS_MAX];
    let mut report = [0; REPORT_BYTES];
    answer(waiting, folder, |socket| {
        let n_bytes = socket.recv(bytemuck::cast_slice_mut(&mut counts)).ok()?;
        let classification = classifier.classify(&counts[..n_bytes / 2]);
        let numbers = classification.probabilities.iter().chain(&classification.coordinates);
        for (bytes, number) in report.chunks_exact_mut(8).zip(numbers) {
            bytes.copy_from_slice(&number.to_le_bytes());
        }
        socket.send(&report).ok().map(drop)
    });
}

fn echo(waiting: Waiting, folder: &Path) {
    answer(waiting, folder, |socket| {
        let mut byte = [0];
        socket.recv(&mut byte).ok()?;
        socket.send(&byte).ok().map(drop)
    });
}

/// Answers again and again. An answer that cannot be is of a poll that found nothing.
fn answer(waiting: Waiting, folder: &Path, mut once: impl FnMut(&UnixDatagram) -> Option<()>) {
    let socket = bind(folder, "service");
    connect(&socket, folder, "consumer");
    socket.set_nonblocking(waiting == Waiting::Polling).expect("a socket can poll");
    println!("ready");
    loop {
        if once(&socket).is_none() {
            std::hint::spin_loop();
        }
    }
}

pub(crate) fn bind(folder: &Path, name: &str) -> UnixDatagram {
    UnixDatagram::bind(folder.join(name)).expect("a socket can be made there")
}

pub(crate) fn connect(socket: &UnixDatagram, folder: &Path, name: &str) {
    socket.connect(folder.join(name)).expect("the other end is there");
}

fn waiting_of(name: &str) -> Waiting {
    match name {
        "by-event" => Waiting::ByEvent,
        "polling" => Waiting::Polling,
        other => panic!("no way to wait is called {other}"),
    }
}
