//! `kinds demo`, from its first line to the processes that it must not leave behind.

use std::path::{Path, PathBuf};

use kinds_driver_shim::simulated::{Crunch, Floor, Robot as _};
use kinds_messages::Domain;
use rustix::process::{Pid, Signal, kill_process};
use serde_json::Value;

use crate::consumer::Consumer;
use crate::robot::{FIRST, Robot, SECOND, shared_memory};
use crate::running::{Running, await_that};
use crate::world::{Trip, read_trip, read_trip_by};

/// The whole of it, on the robot that it drives itself.
#[test]
fn demo_drives_learns_serves_and_prints_what_its_evaluations_say() {
    let robot = Robot::new();
    let mut demo = robot.start(&["demo", "--output", "results"]);
    let domain = await_domain(&robot, &mut demo);
    let outcome = demo.end();
    assert_eq!((outcome.code, outcome.stderr.as_str()), (Some(0), ""));
    assert_nothing_is_left(&robot, &domain);

    for (name, floor, trip) in [
        ("fourth-floor-1", Floor::Fourth, 1),
        ("fourth-floor-2", Floor::Fourth, 2),
        ("fifth-floor-1", Floor::Fifth, 1),
        ("fifth-floor-2", Floor::Fifth, 2),
    ] {
        assert_trip_is_driven(&robot.path(&format!("results/{name}.mcap")), Crunch::new(floor, trip, 0));
    }
    assert_table_1_is_that_of_the_models(&robot, &outcome.stdout);
    let tables = printed(&outcome.stdout);
    let evaluations = ["evaluation", "evaluation-elsewhere"].map(|name| {
        let json = robot.read(&format!("results/{name}.json"));
        rounded(&serde_json::from_slice(&json).unwrap())
    });
    assert_eq!(tables, evaluations, "{}", outcome.stdout);
    let report = String::from_utf8(robot.read("results/report/report.html")).unwrap();
    for row in tables.iter().flatten() {
        let kappa = format!("{:.2}", row[4]).replace('-', "−");
        assert!(report.contains(&kappa), "κ {kappa} is printed and not in the report");
    }
}

/// Its rows say what the two models have.
fn assert_table_1_is_that_of_the_models(robot: &Robot, stdout: &str) {
    let mut lines = stdout.lines().map(str::trim_start);
    assert!(lines.any(|line| line == "Table 1  readings  dims  kinds"), "{stdout}");
    for (name, file) in [("Isomap", "model.kinds"), ("PCA", "pca.kinds")] {
        let model = crate::world::open_model(&robot.path("results").join(file));
        let expected = format!("{name} 16 {} {}", model.manifest().n_dims, model.mixture().n_kinds());
        let row: Vec<&str> = lines.next().unwrap().split_whitespace().collect();
        assert_eq!(row.join(" "), expected);
    }
}

/// What is recorded is what the robot does when it is driven here.
fn assert_trip_is_driven(path: &Path, mut crunch: Crunch) {
    let mut counts = vec![0; crunch.layout().n_readings()];
    for (frame, recorded) in read_trip_by(path, Some("/ground_truth")) {
        let moment = crunch.step(&mut counts).unwrap();
        assert_eq!((frame.captured, &recorded), (moment.captured, &counts));
        assert_eq!(
            frame.pose.map(|pose| (pose.x_m, pose.y_m)),
            Some((moment.true_pose.x_m, moment.true_pose.y_m))
        );
    }
    assert!(crunch.step(&mut counts).is_none(), "{} ends too early", path.display());
}

#[test]
fn demo_on_recorded_trips_leaves_a_model_and_a_report_for_every_frame() {
    let robot = recorded();
    let mut demo = robot.start(&["demo", FIRST, SECOND, "--output", "results"]);
    let domain = await_domain(&robot, &mut demo);
    let outcome = demo.end();
    assert_eq!((outcome.code, outcome.stderr.as_str()), (Some(0), ""));
    assert_nothing_is_left(&robot, &domain);
    let model = crate::world::open_model(&robot.path("results/model.kinds"));
    assert_eq!(model.frames().n_frames(), Trip::FIRST.n_frames);

    let csv = String::from_utf8(robot.read("results/kinds.csv")).unwrap();
    let mut lines = csv.lines();
    let probabilities: String = (0..model.mixture().n_kinds()).map(|kind| format!(",p{kind}")).collect();
    assert_eq!(
        lines.next(),
        Some(format!("sequence,captured_ns,kind,filtered_kind,novelty,latency_ns{probabilities}").as_str())
    );
    let frames = read_trip(&robot.path(SECOND));
    assert_eq!(lines.clone().count(), frames.len());
    for (sequence, (line, (frame, _))) in lines.zip(&frames).enumerate() {
        let beginning = format!("{sequence},{},", frame.captured.0);
        assert!(line.starts_with(&beginning), "{line}");
        assert_eq!(line.split(',').count(), 6 + model.mixture().n_kinds(), "{line}");
    }
    let evaluation = serde_json::from_slice(&robot.read("results/evaluation.json")).unwrap();
    assert_eq!(printed(&outcome.stdout), [rounded(&evaluation)], "{}", outcome.stdout);
}

#[test]
fn what_a_demo_cannot_be_shown_on_is_a_sentence() {
    let robot = Robot::new();
    for (asked, name) in [(&["krunch"][..], "krunch"), (&["one.mcap"], "one.mcap")] {
        robot.refuse(
            &[&["demo"], asked].concat(),
            2,
            &format!(
                "a demo is shown on crunch, on chew, or on two recorded trips; it was asked for on \"{name}\""
            ),
        );
    }
    robot.refuse(&["demo", "one.mcap", "two.mcap"], 1, "no trip at one.mcap: there is no such file");
    Trip { poses_topics: &[], ..Trip::FIRST }.write(&robot.path(FIRST));
    robot.refuse_with(&["demo", FIRST, FIRST], 1, &["trip first.mcap has no poses", "evaluation needs"]);
}

/// A robot with two trips.
fn recorded() -> Robot {
    let robot = Robot::new();
    Trip::FIRST.write(&robot.path(FIRST));
    Trip::SECOND.write(&robot.path(SECOND));
    robot
}

/// The numbers of the tables of consistency that were printed, row by row.
fn printed(stdout: &str) -> Vec<Vec<Vec<f64>>> {
    let mut lines = stdout.lines().map(str::trim_start);
    let mut tables = Vec::new();
    while lines.any(|line| line.starts_with("method") && line.contains("kappa")) {
        let rows = ["Isomap ", "PCA ", "random "].map(|name| {
            let row = lines.next().unwrap().strip_prefix(name).unwrap();
            let words = row.split_whitespace().filter(|word| !["%", "…"].contains(word));
            words.map(|word| word.parse().unwrap()).collect()
        });
        tables.push(rows.to_vec());
    }
    tables
}

/// The same of an evaluation, as far as the table shows it.
fn rounded(evaluation: &Value) -> Vec<Vec<f64>> {
    let row = |scores: &Value| {
        let rounded = |value: &Value, factor: f64, n_digits: usize| {
            format!("{:.n_digits$}", factor * value.as_f64().unwrap()).parse::<f64>().unwrap()
        };
        let round = |field: &str, factor, n_digits| rounded(&scores[field], factor, n_digits);
        let interval = scores["confidence"]["kappa"].as_array();
        let interval = interval.into_iter().flatten().map(|end| rounded(end, 1.0, 2));
        let before = [
            round("n_dims", 1.0, 0),
            round("n_kinds", 1.0, 0),
            round("consistency", 100.0, 1),
            round("chance", 100.0, 1),
            round("kappa", 1.0, 2),
        ];
        let after = [round("ami", 1.0, 2), round("largest_kind_share", 100.0, 1)];
        before.into_iter().chain(interval).chain(after).collect()
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
    let stderr = check_interrupted(|_, domain| {
        // The shim alone: it ends well, and nobody has told the demo.
        let is_shim = |process: &PathBuf| {
            let line = std::fs::read(process.join("cmdline")).unwrap_or_default();
            String::from_utf8_lossy(&line).contains("\0publish\0")
        };
        let shim = processes_of(domain).into_iter().find(is_shim).expect("it publishes");
        let pid = shim.file_name().and_then(|name| name.to_str()?.parse().ok()).and_then(Pid::from_raw);
        kill_process(pid.expect("a process is a number"), Signal::INT).expect("it is there");
    });
    assert!(stderr.starts_with("kinds: kinds publish was ended by somebody after "), "{stderr}");
    assert!(stderr.contains(" of 130 frames; "), "{stderr}");
}

#[test]
fn a_killed_demo_leaves_no_process_and_nothing_in_shared_memory() {
    let robot = recorded();
    let mut demo = robot.start(&["demo", FIRST, SECOND, "--output", "results"]);
    let domain = await_domain(&robot, &mut demo);
    let mut consumer = Consumer::join(&domain, "demo/sensor");
    consumer.await_reports(3);
    drop(consumer);
    demo.kill();
    // Its service and shim hear of it, and the last of them out puts the light out.
    await_that(|| processes_of(&domain).is_empty());
    assert_nothing_is_left(&robot, &domain);
}

#[test]
fn a_demo_that_is_killed_as_its_first_process_starts_leaves_nothing_either() {
    let robot = recorded();
    let mut demo = robot.start(&["demo", FIRST, SECOND, "--output", "results"]);
    let domain = await_domain(&robot, &mut demo);
    await_that(|| !processes_of(&domain).is_empty());
    demo.kill();
    await_that(|| processes_of(&domain).is_empty());
    assert_nothing_is_left(&robot, &domain);
}

/// Interrupts a demo while it publishes, and returns what it says to that.
fn check_interrupted(interrupt: fn(&Running, &Domain)) -> String {
    let robot = recorded();
    let mut demo = robot.start_group(&["demo", FIRST, SECOND, "--output", "results"]);
    let domain = await_domain(&robot, &mut demo);
    let mut consumer = Consumer::join(&domain, "demo/sensor");
    consumer.await_reports(3);
    drop(consumer);
    interrupt(&demo, &domain);
    let outcome = demo.end();
    assert_eq!(outcome.code, Some(1), "{outcome:?}");
    assert!(!outcome.stdout.contains("evaluate"), "{outcome:?}");
    assert_nothing_is_left(&robot, &domain);
    outcome.stderr
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
