//! `kinds doctor`: each thing that may be wrong is found with its cure, and a robot that is well is told so.

#![allow(clippy::print_stderr, reason = "a test that is skipped says so")]

use std::os::unix::process::CommandExt;
use std::process::Command;

use rustix::process::Signal;
use serde_json::Value;

use crate::robot::{MODEL, Robot, SECOND, SENSOR};
use crate::running::Running;
use crate::world::Trip;

/// What a doctor found.
struct Findings {
    code: Option<i32>,
    findings: Vec<Value>,
}

impl Findings {
    fn of(robot: &Robot, flags: &[&str]) -> Self {
        Self::said(robot.start(&[&["doctor", "--json"], flags].concat()))
    }

    fn said(doctor: Running) -> Self {
        let outcome = doctor.end();
        let report: Value = serde_json::from_str(&outcome.stdout).unwrap_or_else(|_| panic!("{outcome:?}"));
        let findings = report["findings"].as_array().unwrap().clone();
        assert_eq!(report["well"], outcome.code == Some(0), "{outcome:?}");
        let n_wrong = findings.iter().filter(|finding| finding["well"] == false).count();
        let told = match n_wrong {
            0 => String::new(),
            _ => format!("kinds: {n_wrong} of {} findings are wrong\n", findings.len()),
        };
        assert_eq!(outcome.stderr, told);
        Self { code: outcome.code, findings }
    }

    /// What is wrong, with its cure.
    fn wrong(&self) -> Vec<(&str, &str)> {
        let wrong = self.findings.iter().filter(|finding| finding["well"] == false);
        wrong.map(|finding| (finding["what"].as_str().unwrap(), finding["cure"].as_str().unwrap())).collect()
    }

    /// That there is something wrong, with this cure, and nothing else but what follows from it.
    fn has(&self, what: &str, cure: &str) {
        assert_eq!(self.code, Some(1));
        assert!(
            self.wrong().iter().any(|(found, with)| found.starts_with(what) && with.starts_with(cure)),
            "no {what:?} with {cure:?} in {:#?}",
            self.findings
        );
    }

    fn is_well(&self, what: &str) {
        let mut well = self.findings.iter().filter(|finding| finding["well"] == true);
        let found = well.any(|finding| finding["what"].as_str().unwrap().starts_with(what));
        assert!(found, "no {what:?} in {:#?}", self.findings);
    }
}

const ABOUT: [&str; 4] = ["--sensor", SENSOR, "--model", MODEL];

#[test]
fn a_robot_that_is_well_is_told_who_is_there_and_that_all_arrives() {
    let robot = Robot::trained();
    let service = robot.serve();
    let shim = robot.publish(SECOND, "1");
    let mut consumer = robot.join();
    consumer.await_reports(1);
    let said = robot.run(&[&["doctor"][..], &ABOUT].concat());
    let (shim_pid, service_pid, own_pid) = (shim.pid(), service.pid(), std::process::id());
    let model = crate::world::open_model(&robot.path(MODEL)).id();
    for line in [
        format!("well   model     m.kinds is whole: 16 readings (1 × 16) of 0.001 m a count, model {model}"),
        format!(
            "well   frames    crunch/ring is published by kinds-publish (pid {shim_pid}), up to 16 readings a frame; read by \
             kinds-serve (pid {service_pid})"
        ),
        "well   model     it understands the frames".to_owned(),
    ] {
        assert!(said.stdout.lines().any(|said| said == line), "no {line:?} in {}", said.stdout);
    }
    for part in [
        "\nwell   arrivals  frames of crunch/ring come, up to number ".to_owned(),
        "\nwell   arrivals  kinds of crunch/ring come: frame ".to_owned(),
        format!("consumer (pid {own_pid})"),
    ] {
        assert!(said.stdout.contains(&part), "no {part:?} in {}", said.stdout);
    }
    assert_eq!((said.code, said.stderr.as_str()), (Some(0), ""), "{}", said.stdout);
    let findings = Findings::of(&robot, &[]);
    assert_eq!((findings.code, findings.wrong()), (Some(0), vec![]), "all sensors that there are");
    shim.stop(Signal::INT);
    service.stop(Signal::INT);
}

#[test]
fn a_domain_without_programs_is_wrong_and_stays_as_it_is() {
    let robot = Robot::new();
    let findings = Findings::of(&robot, &[]);
    findings.has(
        "no program is in the domain ",
        "start a driver shim (kinds publish) and a service (kinds serve)",
    );
    assert_eq!(robot.shared_memory(), [""; 0]);
    let findings = Findings::of(&robot, &["--domain", "/tmp/kinds-nowhere"]);
    findings.has("there is no folder /tmp/kinds-nowhere: ", "start the programs, all with the same --domain");
    assert!(!std::path::Path::new("/tmp/kinds-nowhere").exists());
}

#[test]
fn who_is_missing_is_told() {
    let robot = Robot::trained();
    let service = robot.serve();
    let findings = Findings::of(&robot, &ABOUT);
    findings.has("nobody publishes crunch/ring", "start its driver shim: kinds publish --sensor crunch/ring");
    findings.is_well("crunch/ring is served by kinds-serve (pid ");
    assert_eq!(findings.wrong().len(), 1, "{:?}", findings.wrong());
    let findings = Findings::of(&robot, &["--sensor", "crunch/rong"]);
    findings.has(
        "there is no channel of crunch/rong; there are channels of crunch/ring",
        "start its driver shim (kinds publish --sensor crunch/rong",
    );
    service.stop(Signal::INT);
    let shim = robot.publish(SECOND, "1");
    shim.await_err("kinds: waiting for ");
    let findings = Findings::of(&robot, &ABOUT);
    findings.has("nobody serves crunch/ring", "start its service: kinds serve --sensor crunch/ring");
    // It is still waiting: the doctor is no reader.
    assert!(shim.stop(Signal::INT).starts_with("published 0 frames"));
}

#[test]
fn a_killed_program_is_told_until_another_has_cleaned_up() {
    let robot = Robot::trained();
    let service = robot.serve();
    let pid = service.pid();
    service.kill();
    for _ in 0..2 {
        let findings = Findings::of(&robot, &ABOUT);
        findings.has(
            &format!("kinds-serve (pid {pid}) was killed, and what it left is still there"),
            "start it again, or any program of this domain",
        );
    }
    let service = robot.serve();
    let findings = Findings::of(&robot, &ABOUT);
    assert_eq!(findings.wrong().len(), 1, "{:?}", findings.wrong());
    service.stop(Signal::INT);
}

#[test]
fn a_program_that_is_stopped_and_frames_that_do_not_come_are_told() {
    let robot = Robot::trained();
    let service = robot.serve();
    let shim = robot.publish(SECOND, "1");
    robot.join().await_reports(1);
    shim.signal(Signal::STOP);
    let pid = shim.pid();
    // What was on its way is taken.
    robot.join().await_reports(1);
    crate::running::await_that(|| shim.status("State:").starts_with('T'));
    let findings = Findings::of(&robot, &[&ABOUT[..], &["--wait-s", "0.5"]].concat());
    findings.has(
        &format!("kinds-publish (pid {pid}) is there but stopped: it does nothing until it is continued"),
        &format!("kill -CONT {pid}"),
    );
    findings
        .has("no frame of crunch/ring came in 0.5 s, though its driver shim is there", "look at the sensor");
    shim.signal(Signal::CONT);
    let findings = Findings::of(&robot, &ABOUT);
    assert_eq!(findings.code, Some(0), "{:?}", findings.wrong());
    shim.stop(Signal::INT);
    service.stop(Signal::INT);
}

#[test]
fn a_model_of_another_sensor_is_told_field_by_field_and_that_its_service_reports_nothing() {
    let robot = Robot::trained();
    Trip { n_readings: 8, ..Trip::SECOND }.write(&robot.path("other.mcap"));
    let service = robot.serve();
    let shim = robot.publish("other.mcap", "1");
    service.await_err("WARN frames have 8 readings");
    let findings = Findings::of(&robot, &[&ABOUT[..], &["--wait-s", "1"]].concat());
    findings.has(
        "frames are not of the model's sensor: 8 columns instead of 16",
        "give the service a model that was trained on this sensor",
    );
    findings.has(
        "frames of crunch/ring come, and its service reports on none of them",
        "see what the service says",
    );
    shim.stop(Signal::INT);
    service.stop(Signal::INT);
}

#[test]
fn a_model_that_is_missing_or_damaged_or_not_the_one_that_is_served_is_told() {
    let robot = Robot::trained();
    let findings = Findings::of(&robot, &["--model", "nowhere.kinds"]);
    findings.has("no model at nowhere.kinds: there is no such file", "name the right file");
    let mut bytes = robot.read(MODEL);
    let middle = bytes.len() / 2;
    bytes[middle] ^= 1;
    robot.write("damaged.kinds", bytes);
    let findings = Findings::of(&robot, &["--model", "damaged.kinds"]);
    findings.has(
        "cannot open model damaged.kinds: the model file is damaged",
        "name the right file, copy it again",
    );
    robot.succeed(&[
        "train",
        SECOND,
        "--output",
        "other.kinds",
        "--neighbors",
        "10",
        "--dims",
        "3",
        "--kinds",
        "2",
    ]);
    let service = robot.serve();
    let shim = robot.publish(SECOND, "1");
    robot.join().await_reports(1);
    let findings = Findings::of(&robot, &["--sensor", SENSOR, "--model", "other.kinds"]);
    let [served, asked] =
        [MODEL, "other.kinds"].map(|model| crate::world::open_model(&robot.path(model)).id().to_string());
    findings.has(
        &format!("the service has model {served}, and this one is {asked}"),
        "give the service this model: kinds reload --sensor NAME --model M.kinds",
    );
    shim.stop(Signal::INT);
    service.stop(Signal::INT);
}

#[test]
fn a_sensor_that_sees_nothing_is_told() {
    let robot = Robot::trained();
    let all: Vec<usize> = (0..Trip::SECOND.n_frames).collect();
    Trip { invalid_frames: &all, ..Trip::SECOND }.write(&robot.path("dark.mcap"));
    let service = robot.serve();
    let shim = robot.publish("dark.mcap", "1");
    robot.join().await_reports(1);
    let findings = Findings::of(&robot, &ABOUT);
    findings
        .has("frames of crunch/ring come, and no reading of the last ", "look at the sensor: cover, cable");
    shim.stop(Signal::INT);
    service.stop(Signal::INT);
}

#[test]
fn a_domain_of_another_user_is_told_with_both() {
    if !rustix::process::geteuid().is_root() {
        eprintln!("skipped: only the superuser may run a program as another user");
        return;
    }
    const NOBODY: u32 = 65_534;
    let robot = Robot::trained();
    let service = robot.serve();
    let mut doctor = robot.command(&["doctor", "--json"]);
    // A folder that this user may be in.
    doctor.current_dir("/").uid(NOBODY).gid(NOBODY);
    let findings = Findings::said(Running::start(&mut doctor));
    let wrong = findings.wrong();
    let (what, cure) = wrong[0];
    assert!(
        what.contains(" belongs to user root (mode ") && what.contains("), and this program runs as user "),
        "{what}"
    );
    assert!(cure.starts_with("run all programs of a robot, this one too, as one user"), "{cure}");
    service.stop(Signal::INT);
}

#[test]
fn too_little_shared_memory_is_told_with_both_numbers() {
    let robot = Robot::trained();
    // Of its own mounts, it has half a megabyte.
    let script = "mount -t tmpfs -o size=512k tmpfs /dev/shm && exec \"$@\"";
    let kinds = env!("CARGO_BIN_EXE_kinds");
    let doctor = [&["-m", "sh", "-c", script, "sh", kinds, "doctor", "--json"], &ABOUT[..]].concat();
    if !Command::new("unshare")
        .args(["-m", "sh", "-c", script, "sh", "true"])
        .status()
        .is_ok_and(|status| status.success())
    {
        eprintln!("skipped: this user may not mount anything, not even for itself");
        return;
    }
    let findings = Findings::said(Running::start(&mut robot.command_of("unshare", &doctor)));
    findings.has(
        "/dev/shm has 524 kB free, and channels that are not there yet need 10025 kB",
        "delete files in /dev/shm, or enlarge it: mount -o remount,size=256m /dev/shm",
    );
}
