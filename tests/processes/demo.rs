//! `kinds demo`, from its first line to the processes that it must not leave behind.

use std::path::PathBuf;

use kinds_messages::Domain;
use rustix::process::{Pid, Signal, kill_process};
use serde_json::Value;

use crate::consumer::Consumer;
use crate::robot::{Robot, shared_memory};
use crate::running::{Running, await_that};
use crate::world::read_trip;

#[test]
fn demo_leaves_a_model_a_report_for_every_frame_and_the_evaluation_that_it_printed() {
    let robot = Robot::new();
    let mut demo = robot.start(&["demo", "--output", "results"]);
    let domain = await_domain(&robot, &mut demo);
    let outcome = demo.end();
    assert_eq!((outcome.code, outcome.stderr.as_str()), (Some(0), ""));
    assert_nothing_is_left(&robot, &domain);

    let files: Vec<PathBuf> = robot.files().into_keys().collect();
    let names = ["evaluation.json", "kinds.csv", "model.kinds", "trip1.mcap", "trip2.mcap"];
    assert_eq!(files, names.map(|name| PathBuf::from("results").join(name)));
    assert_eq!(crate::world::open_model(&robot.path("results/model.kinds")).frames().n_frames(), 900);

    let csv = String::from_utf8(robot.read("results/kinds.csv")).unwrap();
    let mut lines = csv.lines();
    assert_eq!(lines.next(), Some("sequence,captured_ns,kind,novelty,latency_ns,p0,p1,p2,p3,p4"));
    let frames = read_trip(&robot.path("results/trip2.mcap"));
    assert_eq!(lines.clone().count(), frames.len());
    for (sequence, (line, (frame, _))) in lines.zip(&frames).enumerate() {
        let beginning = format!("{sequence},{},", frame.captured.0);
        assert!(line.starts_with(&beginning) && line.split(',').count() == 10, "{line}");
    }

    let evaluation: Value = serde_json::from_slice(&robot.read("results/evaluation.json")).unwrap();
    assert_eq!(printed(&outcome.stdout), rounded(&evaluation), "{}", outcome.stdout);
}

/// The numbers of the table that was printed, row by row.
fn printed(stdout: &str) -> Vec<Vec<f64>> {
    let row_of = |name: &str| stdout.lines().find_map(|line| line.trim_start().strip_prefix(name)).unwrap();
    let words = |row: &'_ str| row.split_whitespace().map(str::to_string).collect::<Vec<_>>();
    let rows = ["Isomap ", "PCA ", "random "].map(|name| words(row_of(name)));
    rows.map(|row| row.iter().filter(|word| *word != "%").map(|word| word.parse().unwrap()).collect())
        .to_vec()
}

/// The same of an evaluation, as far as the table shows it.
fn rounded(evaluation: &Value) -> Vec<Vec<f64>> {
    let row = |scores: &Value| {
        let round = |field: &str, factor: f64, n_digits: usize| {
            let shown = format!("{:.n_digits$}", factor * scores[field].as_f64().unwrap());
            shown.parse::<f64>().unwrap()
        };
        vec![
            round("n_dims", 1.0, 0),
            round("n_kinds", 1.0, 0),
            round("consistency", 100.0, 1),
            round("chance", 100.0, 1),
            round("kappa", 1.0, 2),
            round("ami", 1.0, 2),
            round("largest_kind_share", 100.0, 1),
        ]
    };
    ["isomap", "pca", "random"].map(|method| row(&evaluation["methods"][method])).to_vec()
}

#[test]
fn a_signal_ends_demo_and_its_processes_and_leaves_nothing_in_shared_memory() {
    check_interrupted(|demo, _| demo.signal(Signal::INT));
}

#[test]
fn ctrl_c_in_a_terminal_ends_demo_and_its_processes_and_leaves_nothing_in_shared_memory() {
    check_interrupted(|demo, _| demo.signal_group(Signal::INT));
}

#[test]
fn demo_does_not_take_a_shim_that_a_signal_ended_for_one_that_has_published_all() {
    check_interrupted(|demo, domain| {
        // Service and shim are signalled too, and get the time to end before the demo looks.
        demo.signal(Signal::STOP);
        demo.signal(Signal::INT);
        for process in processes_of(domain) {
            let pid =
                process.file_name().and_then(|name| name.to_str()?.parse().ok()).and_then(Pid::from_raw);
            kill_process(pid.expect("a process is a number"), Signal::INT).expect("it is there");
        }
        await_that(|| n_programs(domain) == 1);
        demo.signal(Signal::CONT);
    });
}

/// Programs that are in a domain: each has a folder there.
fn n_programs(domain: &Domain) -> usize {
    let entries = std::fs::read_dir(domain.root.join("nodes")).unwrap();
    // Files come and go while we look.
    entries.filter(|entry| entry.as_ref().is_ok_and(|entry| entry.path().is_dir())).count()
}

/// Interrupts a demo while it publishes.
fn check_interrupted(interrupt: fn(&Running, &Domain)) {
    let robot = Robot::new();
    let mut demo = robot.start_group(&["demo", "--output", "results"]);
    let domain = await_domain(&robot, &mut demo);
    let mut consumer = Consumer::join(&domain, "demo/sensor");
    consumer.await_reports(3);
    drop(consumer);
    interrupt(&demo, &domain);
    let outcome = demo.end();
    assert_eq!(outcome.code, Some(1), "{outcome:?}");
    assert!(!outcome.stdout.contains("3. evaluate"), "{outcome:?}");
    assert_nothing_is_left(&robot, &domain);
}

/// The domain that a demo makes for its processes: a folder among the temporary ones.
fn await_domain(robot: &Robot, demo: &mut Running) -> Domain {
    let root = || std::fs::read_dir(robot.temporary_folder()).unwrap().next();
    await_that(|| root().is_some() || demo.has_ended());
    let entry = root().unwrap_or_else(|| panic!("the demo has made no domain; {:?}", demo.err()));
    Domain::in_folder(&entry.unwrap().path())
}

/// Processes that were started in a domain, as their folders in /proc.
fn processes_of(domain: &Domain) -> Vec<PathBuf> {
    let with_domain = |process: &PathBuf| {
        // Processes come and go while we look.
        let line = std::fs::read(process.join("cmdline")).unwrap_or_default();
        String::from_utf8_lossy(&line).contains(domain.root.to_str().unwrap())
    };
    let processes = std::fs::read_dir("/proc").unwrap().map(|entry| entry.unwrap().path());
    processes.filter(with_domain).collect()
}

fn assert_nothing_is_left(robot: &Robot, domain: &Domain) {
    let processes = processes_of(domain);
    assert!(processes.is_empty(), "{processes:?}");
    assert_eq!(shared_memory(domain), [""; 0]);
    let shared = std::fs::read_dir("/dev/shm").unwrap().map(|entry| entry.unwrap().file_name());
    let shared: Vec<_> = shared.filter(|name| name.to_string_lossy().starts_with(&domain.prefix)).collect();
    assert!(shared.is_empty(), "{shared:?}: a demo's domain ends for good, with all of its files");
    assert_eq!(std::fs::read_dir(robot.temporary_folder()).unwrap().count(), 0);
}
