//! How long a report takes to consumers in Rust, C, C++ and Python, from when its frame was sent.
//!
//! `cargo bench --bench consumers`, on frames of simulated Crunch's ring of 16 readings, one a millisecond. Needs `cc`, `c++` and a
//! `python3` that has numpy. `KINDS_BENCH_ROUNDS=3` measures fewer rounds than 11; `-- camera` takes Chew's camera of 19840 readings
//! instead.
//!
//! Three processes on one processor: this one publishes and sleeps, `kinds serve` classifies by event, and the consumer looks at
//! the clock when it has the report. So two wake-ups and classifying are in each number; languages differ by what is left. They
//! take turns, and each is started anew in every round.
//!
//! Where the system allows it (`chrt`), all have real-time priority, so that what else the machine does does not count.
#![allow(clippy::print_stdout, reason = "a bench is there to print")]

#[path = "../latency/processors.rs"]
mod processors;
#[path = "../simulated/mod.rs"]
mod simulated;
#[path = "../latency/trained.rs"]
mod trained;

use std::io::{BufRead, BufReader};
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::time::Duration;

use kinds_messages::{
    Domain, FrameHeader, FramePublisher, Node, OwnDomain, Purpose, ReportReader, SensorName, monotonic_ns,
};
use kinds_model::SensorLayout;

use crate::simulated::{CAMERA, RING, Simulated};
use crate::trained::Trained;

const SENSOR: &str = "bench/sensor";
const N_FRAMES: usize = 2000;
/// Frames of a round that are measured, after those that warm up.
const N_MEASURED: usize = 600;
const N_WARM_UP: usize = 50;
const N_REPORTS: usize = N_WARM_UP + N_MEASURED;
const PERIOD: Duration = Duration::from_millis(1);

fn main() {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    if let [kind, sensor, n_reports] = &arguments[..]
        && kind == "consumer"
    {
        consume(sensor, n_reports.parse().expect("a number"));
        return;
    }
    let rounds = std::env::var("KINDS_BENCH_ROUNDS").ok().and_then(|text| text.parse().ok()).unwrap_or(11);
    let robot: &Simulated =
        if arguments.iter().any(|argument| argument == "camera") { &CAMERA } else { &RING };
    let trained = Trained::on(robot, N_FRAMES);
    let folder = tempfile::tempdir().expect("there is a temporary folder");
    let consumers = consumers(folder.path());
    println!(
        "from when a frame is sent to its report in a consumer's hands, µs, on one processor; {}, {N_FRAMES} reference frames\n\
         p50: the median of {rounds} rounds, with the least and the greatest; others: of all {} frames; real-time priority: {}\n\
         consumer    p50   (least … greatest)      p99    p99.9",
        trained.title,
        rounds * N_MEASURED,
        if processors::ask_for_priority() { "yes" } else { "no" },
    );
    let _pinned = processors::keep_to(0);
    let mut all = vec![Vec::new(); consumers.len()];
    for _ in 0..rounds {
        for ((_, command), latencies) in consumers.iter().zip(&mut all) {
            latencies.push(measure(&trained, command));
        }
    }
    for ((language, _), latencies) in consumers.iter().zip(&all) {
        let mut medians: Vec<f64> = latencies.iter().map(|round| quantile(round, 0.5)).collect();
        medians.sort_by(f64::total_cmp);
        let pooled = latencies.concat();
        println!(
            "{language:8} {:6.1}  ({:6.1} … {:6.1}) {:10.1} {:8.1}",
            medians[rounds / 2],
            medians[0],
            medians[rounds - 1],
            quantile(&pooled, 0.99),
            quantile(&pooled, 0.999),
        );
    }
}

/// A program with its first arguments.
type Consumer = Vec<PathBuf>;

fn consumers(folder: &Path) -> [(&'static str, Consumer); 4] {
    let this = std::env::current_exe().expect("this program has a path");
    let python = vec!["python3".into(), checkout("benches/consumers/latency.py")];
    [
        ("Rust", vec![this, "consumer".into()]),
        ("C", vec![compiled("cc", "gnu11", "c", folder)]),
        ("C++", vec![compiled("c++", "c++17", "cpp", folder)]),
        ("Python", python),
    ]
}

fn checkout(path: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join(path)
}

/// Where cargo has built the library for this bench.
fn library_folder() -> PathBuf {
    Path::new(env!("CARGO_BIN_EXE_kinds")).with_file_name("deps")
}

fn compiled(compiler: &str, standard: &str, ending: &str, folder: &Path) -> PathBuf {
    let output = folder.join(format!("latency-{ending}"));
    let mut command = Command::new(compiler);
    command.arg(format!("-std={standard}")).args(["-O2", "-o"]).arg(&output);
    for include in ["consumers/c/include", "consumers/cpp/include"] {
        command.arg("-I").arg(checkout(include));
    }
    command.arg(checkout(&format!("benches/consumers/latency.{ending}")));
    command.arg("-L").arg(library_folder()).arg("-lnatural_kinds");
    assert!(command.status().expect("there is a compiler").success());
    output
}

/// The consumer in Rust.
fn consume(sensor: &str, n_reports: usize) {
    let folder = std::env::var_os("KINDS_DOMAIN").expect("the bench has set it");
    let node = Node::open(&Domain::in_folder(Path::new(&folder)), "bench-consumer").expect("a domain");
    let sensor: SensorName = sensor.parse().expect("the name is as it should be");
    let reader = ReportReader::open(&node, &sensor).expect("a reader");
    let mut n_left = n_reports;
    while n_left > 0 {
        match reader.receive().expect("receiving works") {
            Some(report) => {
                println!("{}", monotonic_ns() - report.sent_monotonic_ns);
                n_left -= 1;
            }
            None => drop(reader.wait(Duration::from_secs(1)).expect("waiting works")),
        }
    }
}

/// Latencies of a round, µs.
fn measure(trained: &Trained, consumer: &Consumer) -> Vec<f64> {
    let domain = OwnDomain::make().expect("there is a temporary folder");
    let node = Node::open(&domain, "bench").expect("a domain of its own");
    let sensor: SensorName = SENSOR.parse().expect("the name is as it should be");
    let mut service = Command::new(env!("CARGO_BIN_EXE_kinds"));
    service.arg("serve").arg("--model").arg(trained.file()).args(["--sensor", SENSOR]);
    let mut service = start(service.env("KINDS_LOG", "warn"), &domain);
    let mut line = String::new();
    BufReader::new(service.stdout.as_mut().expect("a pipe")).read_line(&mut line).expect("it says something");
    let mut command = Command::new(&consumer[0]);
    command.args(&consumer[1..]).arg(SENSOR).arg(N_REPORTS.to_string());
    let consumer = start(&mut command, &domain);
    let reads = || {
        let census = domain.census("bench").expect("the domain is there");
        let channel = census.channel(&sensor, Purpose::Kinds);
        channel.is_some_and(|kinds| kinds.readers.iter().any(|reader| reader.pid == Some(consumer.id())))
    };
    while !reads() {
        std::thread::sleep(PERIOD);
    }
    publish(trained, &node, &sensor);
    let output = consumer.wait_with_output().expect("it ends");
    service.kill().and_then(|()| service.wait()).expect("a child can be killed");
    drop(Node::open(&domain, "bench-last"));
    let text = String::from_utf8(output.stdout).expect("numbers");
    let latencies = text.lines().map(|line| line.parse::<f64>().expect("a number") / 1e3);
    latencies.skip(N_WARM_UP).collect()
}

fn start(command: &mut Command, domain: &OwnDomain) -> Child {
    command
        .env("KINDS_DOMAIN", &domain.root)
        .env("LD_LIBRARY_PATH", library_folder())
        .env("NATURAL_KINDS_LIBRARY", library_folder().join("libnatural_kinds.so"))
        .env("PYTHONPATH", checkout("consumers/python/src"))
        .env("PYTHONDONTWRITEBYTECODE", "1")
        .stdin(Stdio::null())
        .stdout(Stdio::piped())
        .spawn()
        .expect("the program starts")
}

fn publish(trained: &Trained, node: &Node, sensor: &SensorName) {
    let SensorLayout { rows, columns, metres_per_count } = trained.model.layout();
    let publisher = FramePublisher::create(node, sensor, trained.queries[0].len()).expect("a publisher");
    let start_ns = monotonic_ns();
    for sequence in 0..N_REPORTS {
        let due_ns = start_ns + sequence as u64 * PERIOD.as_nanos() as u64;
        std::thread::sleep(Duration::from_nanos(due_ns.saturating_sub(monotonic_ns())));
        let mut loan = publisher.loan().expect("one loan at a time");
        loan.counts_mut().copy_from_slice(&trained.queries[sequence % trained.queries.len()]);
        let sequence = sequence as u64;
        let header =
            FrameHeader { run: 1, sequence, rows, columns, metres_per_count, ..FrameHeader::default() };
        loan.send(&header).expect("sending works");
    }
    // The last frame goes with its publisher.
    std::thread::sleep(Duration::from_millis(100));
}

fn quantile(values: &[f64], share: f64) -> f64 {
    let mut sorted = values.to_vec();
    sorted.sort_by(f64::total_cmp);
    sorted[((sorted.len() - 1) as f64 * share).round() as usize]
}
