//! What a service asks of the system: granted and in force, or refused and told.

use rustix::process::Signal;
use rustix::thread::{CapabilitySet, CpuSet, capabilities, sched_getaffinity};

use crate::robot::{MODEL, Robot, SECOND, SENSOR};
use crate::running::Running;

/// A robot with real-time settings, and its service of them, with the line that it began with.
fn serve(robot: &Robot, settings: &str) -> (Running, String) {
    robot.write("realtime.ron", settings);
    let service = robot.start(&["serve", "--model", MODEL, "--sensor", SENSOR, "--realtime", "realtime.ron"]);
    let told = service.await_out(&format!("serving {SENSOR}: "));
    (service, told)
}

/// How the system schedules a program: policy and real-time priority (fields 41 and 40 of `/proc/PID/stat`).
fn scheduling(service: &Running) -> [u32; 2] {
    let stat = std::fs::read_to_string(format!("/proc/{}/stat", service.pid())).unwrap();
    let (_, after_name) = stat.rsplit_once(") ").unwrap();
    let fields: Vec<&str> = after_name.split(' ').collect();
    [fields[41 - 3], fields[40 - 3]].map(|field| field.parse().unwrap())
}

const FIFO: u32 = 1;

fn serves_every_frame(robot: &Robot, service: Running) {
    let consumer = robot.join();
    let mut shim = robot.publish(SECOND, "max");
    assert_eq!(consumer.await_end_of(&mut shim).len(), 130);
    service.stop(Signal::TERM);
}

#[test]
fn a_service_runs_on_the_processors_that_it_is_given_and_opens_models_elsewhere() {
    let robot = Robot::trained();
    let ours = sched_getaffinity(None).unwrap();
    let cpu = (0..CpuSet::MAX_CPU).rfind(|&cpu| ours.is_set(cpu)).unwrap();
    let (service, told) = serve(&robot, &format!("(cpus: [{cpu}])"));
    assert!(told.ends_with(&format!("; on processors {cpu}")), "{told}");
    assert_eq!(service.status("Cpus_allowed_list:"), cpu.to_string());
    robot.succeed(&["reload", "--sensor", SENSOR]);
    serves_every_frame(&robot, service);
}

#[test]
fn processors_that_are_not_there_are_told_and_served_without() {
    let robot = Robot::trained();
    let before = sched_getaffinity(None).unwrap();
    let (service, told) = serve(&robot, "(cpus: [1023])");
    let list = service.status("Cpus_allowed_list:");
    assert!(told.ends_with(&format!("; on processors {list} as before")), "{told}");
    assert_eq!(before, sched_getaffinity(None).unwrap());
    service.await_err(&format!(
        "WARN cannot run on processors 1023 (Invalid argument (os error 22)); this program runs on {list}: name some of \
         these, or allow it more (AllowedCPUs in a systemd unit); serving on"
    ));
    serves_every_frame(&robot, service);
}

#[test]
fn a_real_time_priority_is_in_force_or_not_claimed() {
    let robot = Robot::trained();
    let (service, told) = serve(&robot, "(priority: 7, lock_memory: true)");
    let has_priority = told.ends_with("; real-time priority 7");
    assert!(
        told.contains("; memory is ") && (has_priority || told.ends_with("; no real-time priority")),
        "{told}"
    );
    assert_eq!(scheduling(&service) == [FIFO, 7], has_priority, "{told}");
    let has_right = capabilities(None).unwrap().effective.contains(CapabilitySet::SYS_NICE);
    assert!(has_priority || !has_right, "{told}; {:?}", service.err());
    serves_every_frame(&robot, service);
}

#[test]
fn a_real_time_priority_that_is_not_allowed_is_told_with_its_cure() {
    let robot = Robot::trained();
    robot.write("realtime.ron", "(priority: 7)");
    let service = robot.start_limited(
        "-r 0",
        CapabilitySet::SYS_NICE,
        &["serve", "--model", MODEL, "--sensor", SENSOR, "--realtime", "realtime.ron"],
    );
    let told = service.await_out(&format!("serving {SENSOR}: "));
    assert!(told.ends_with("; no real-time priority"), "{told}");
    service.await_err(
        "WARN cannot run at real-time priority 7: the limit is 0 (Operation not permitted (os error 1)); raise it, with \
         ulimit -r in a shell or LimitRTPRIO=7 in a systemd unit; serving on, though frames may wait for other programs",
    );
    assert_eq!(scheduling(&service), [0, 0]);
    serves_every_frame(&robot, service);
}

#[test]
fn settings_that_cannot_be_are_refused_with_file_line_and_column() {
    let robot = Robot::trained();
    for (settings, sentence) in [
        (
            "(\n  priority: 100,\n)",
            "line 2, column 13: priority is 100; it must be between 1 and 99, or left out for none",
        ),
        ("(cpu: [0])", "line 1, column 2: there is no field cpu; did you mean cpus?"),
    ] {
        robot.write("realtime.ron", settings);
        robot.refuse(
            &["serve", "--model", MODEL, "--sensor", SENSOR, "--realtime", "realtime.ron"],
            2,
            &format!("real-time settings realtime.ron: {sentence}"),
        );
    }
    robot.refuse(
        &["serve", "--model", MODEL, "--sensor", SENSOR, "--realtime", "none.ron"],
        1,
        "cannot read real-time settings none.ron: there is no such file or folder",
    );
}
