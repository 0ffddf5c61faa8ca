//! `kinds demo`: the whole way once, with real processes, on two trips.

use std::ffi::OsStr;
use std::io::{BufRead, BufReader, IsTerminal, Write};
use std::os::unix::process::CommandExt;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, ExitStatus, Stdio};
use std::sync::atomic::{AtomicBool, Ordering};

use kinds_messages::{Domain, KindReport, Node, SensorName};
use kinds_trainer::{Config, EvaluationPlan, Trained};
use kinds_trips::Selection;
use rustix::process::{Pid, Signal, kill_process};

use crate::cli::DemoArguments;
use crate::commands::{evaluate, own_domain, train, watch};
use crate::failure::Failure;
use crate::{csv, model_file, stop, whole_file};

/// The made-up pair of trips; `demo/README.md` says how it was made.
const TRIP1: &[u8] = include_bytes!("../../demo/trip1.mcap");
const TRIP2: &[u8] = include_bytes!("../../demo/trip2.mcap");

/// Times the recorded pace: fast enough to be short, slow enough to look at.
const SPEED: &str = "20";

const SENSOR: &str = "demo/sensor";

pub(crate) fn run(arguments: &DemoArguments) -> Result<(), Failure> {
    let folder = &arguments.output;
    std::fs::create_dir_all(folder).map_err(|error| Failure::file("make folder", folder, &error))?;
    let [trip1, trip2] = match &arguments.trips[..] {
        [trip1, trip2] => [trip1.clone(), trip2.clone()],
        _ => [write_file(folder, "trip1.mcap", TRIP1)?, write_file(folder, "trip2.mcap", TRIP2)?],
    };

    let model_path = folder.join("model.kinds");
    println!("1. train: {} → {}", trip1.display(), model_path.display());
    learn(&trip1, &model_path)?;

    println!(
        "2. serve, publish, watch: {} at {SPEED} times the recorded pace, as three processes",
        trip2.display()
    );
    let stop = stop::on_signals()?;
    let reports = serve_and_watch(&model_path, &trip2, &stop)?;
    stop::from_now_on_at_once(&stop);
    println!("   {}", statistics(&reports));
    write_file(folder, "kinds.csv", &table(&reports))?;

    println!("3. evaluate: do places that both trips saw get the same kind?");
    let model = model_file::open(&model_path)?;
    let selection = Selection { metres_per_count: model.layout().metres_per_count, ..Selection::default() };
    let plan = EvaluationPlan { radius_m: 0.3, share: 0.5, seed: 0 };
    let evaluation = evaluate::evaluate(model, [&trip1, &trip2], &selection, &plan)?;
    println!("   {}", evaluate::headline(&evaluation));
    for line in evaluate::table(&evaluation) {
        println!("   {line}");
    }
    let json = serde_json::to_vec_pretty(&evaluation).expect("an evaluation is plain data");
    write_file(folder, "evaluation.json", &json)?;
    println!("left in {}: model.kinds, kinds.csv, evaluation.json", folder.display());
    Ok(())
}

fn learn(trip: &Path, model_path: &Path) -> Result<(), Failure> {
    model_file::check_writable(model_path)?;
    let Trained { model, remarks } = train::train(&[trip.to_path_buf()], &Config::default())?;
    for remark in remarks {
        println!("   {remark}");
    }
    model_file::write(model_path, &model)?;
    println!("   {}", train::summary(&model));
    Ok(())
}

/// Runs service and shim as processes in a domain of their own, and returns every report on the trip.
fn serve_and_watch(model: &Path, trip: &Path, stop: &AtomicBool) -> Result<Vec<KindReport>, Failure> {
    // Declared first, so that it goes last.
    let domain = own_domain()?;
    let sensor: SensorName = SENSOR.parse().expect("the name is as it should be");
    let mut watched = watch::Reports::open(Node::open(&domain, "kinds-demo")?, &sensor)?;
    let mut service = Process::start(&domain, "serve", &["--model".as_ref(), model.as_os_str()])?;
    service.await_line()?;
    let replay =
        ["--trip".as_ref(), trip.as_os_str(), "--speed".as_ref(), SPEED.as_ref(), "--follow".as_ref()];
    let mut shim = Process::start(&domain, "publish", &replay)?;
    let reports = watch_until_end(&mut watched, &mut shim, stop)?;
    shim.end_well()?;
    service.terminate();
    service.end_well()?;
    Ok(reports)
}

/// Collects reports until the shim has ended and none is left. The shim ends only when its frames have been reported.
fn watch_until_end(
    watched: &mut watch::Reports,
    shim: &mut Process,
    stop: &AtomicBool,
) -> Result<Vec<KindReport>, Failure> {
    let is_terminal = std::io::stdout().is_terminal();
    let mut reports = Vec::new();
    loop {
        let has_ended = shim.has_ended()?;
        while let Some(report) = watched.receive()? {
            reports.push(report);
        }
        if let Some(last) = reports.last().filter(|_| is_terminal) {
            show_live(last)?;
        }
        // Asked first: Ctrl-C in a terminal goes to all three processes, and the shim's early end is a good one to it.
        if stop.load(Ordering::Relaxed) {
            return Err(Failure::CouldNot(
                "stopped before the trip was over; the model is learnt, its results are not there"
                    .to_string(),
            ));
        }
        if has_ended {
            break;
        }
        watched.wait()?;
    }
    if is_terminal {
        print!("\r\x1b[K");
    }
    Ok(reports)
}

fn show_live(report: &KindReport) -> Result<(), Failure> {
    let mut out = std::io::stdout().lock();
    write!(out, "\r\x1b[K   {}", watch::text_line(report))?;
    Ok(out.flush()?)
}

fn statistics(reports: &[KindReport]) -> String {
    let Some(last) = reports.last() else { return "no report came".to_string() };
    let mut latencies: Vec<u64> = reports.iter().map(watch::latency_ns).collect();
    latencies.sort_unstable();
    let n_reports = reports.len();
    let n_switches = reports.windows(2).filter(|pair| pair[0].kind != pair[1].kind).count();
    format!(
        "{} frames, {n_reports} reports; the kind changed {n_switches} times; frame to report: median {:.0} µs, 99 % within {:.0} µs",
        last.sequence + 1,
        latencies[n_reports / 2] as f64 / 1e3,
        latencies[n_reports * 99 / 100] as f64 / 1e3
    )
}

fn table(reports: &[KindReport]) -> Vec<u8> {
    let n_kinds = reports.first().map_or(0, |report| report.probabilities().len());
    let mut text =
        format!("sequence,captured_ns,kind,novelty,latency_ns{}\n", csv::probability_titles(n_kinds));
    for report in reports {
        let (latency_ns, novelty) = (watch::latency_ns(report), csv::number(report.novelty));
        let probabilities = csv::probabilities(report.probabilities());
        text += &format!(
            "{},{},{},{novelty},{latency_ns}{probabilities}\n",
            report.sequence, report.captured_ns, report.kind
        );
    }
    text.into_bytes()
}

fn write_file(folder: &Path, name: &str, bytes: &[u8]) -> Result<PathBuf, Failure> {
    let path = folder.join(name);
    whole_file::write(&path, bytes).map_err(|error| Failure::file("write", &path, &error))?;
    Ok(path)
}

/// Another process of this program. Killed, and waited for, if it is still there when this goes out of scope.
struct Process {
    name: &'static str,
    child: Child,
}

impl Process {
    fn start(domain: &Domain, name: &'static str, arguments: &[&OsStr]) -> Result<Self, Failure> {
        let failed = |error| Failure::CouldNot(format!("cannot start kinds {name}: {error}"));
        let program = std::env::current_exe().map_err(failed)?;
        let mut command = Command::new(program);
        command
            .arg(name)
            .arg("--domain")
            .arg(&domain.root)
            .args(["--sensor", SENSOR])
            .args(arguments)
            .stdin(Stdio::null())
            .stdout(Stdio::piped());
        // A group of its own: Ctrl-C in a terminal reaches us alone, and we end it, once. A second signal would end it at once
        // and leave what it has in shared memory.
        command.process_group(0);
        // What they have to say is said here.
        command.env("KINDS_LOG", "warn");
        let child = command.spawn().map_err(failed)?;
        Ok(Self { name, child })
    }

    /// Waits for its first line: it is ready.
    fn await_line(&mut self) -> Result<(), Failure> {
        let mut line = String::new();
        if let Some(out) = self.child.stdout.as_mut() {
            BufReader::new(out).read_line(&mut line)?;
        }
        // It has ended without a word: say how.
        if line.is_empty() { self.end_well() } else { Ok(()) }
    }

    fn has_ended(&mut self) -> Result<bool, Failure> {
        Ok(self.wait_result(Child::try_wait)?.is_some())
    }

    fn terminate(&mut self) {
        // A process that is gone needs no signal.
        let _ = kill_process(Pid::from_child(&self.child), Signal::TERM);
    }

    /// Waits for its end, which must be a good one.
    fn end_well(&mut self) -> Result<(), Failure> {
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
