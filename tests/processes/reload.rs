//! Another model for a service that runs: frames go on, and each is reported once, by one or the other.

use rustix::process::Signal;

use crate::robot::{FIRST, MODEL, Robot, SECOND, SENSOR, SIZE};
use crate::world::{
    Trip, assert_reports_equal_classifying_by, assert_reports_equal_classifying_here, open_model,
};

const OTHER: &str = "other.kinds";

/// A robot with two models, [`MODEL`] and [`OTHER`].
fn trained_twice() -> Robot {
    let robot = Robot::trained();
    robot.succeed(&[&["train", SECOND, "--output", OTHER][..], &SIZE].concat());
    robot
}

fn id(robot: &Robot, model: &str) -> String {
    open_model(&robot.path(model)).id().to_string()
}

/// Gives a file another one's name, as whoever copies a model is to do.
fn replace(robot: &Robot, model: &str, bytes: &[u8]) {
    robot.write("new", bytes);
    std::fs::rename(robot.path("new"), robot.path(model)).unwrap();
}

#[test]
fn a_model_is_changed_between_two_frames_and_every_frame_is_reported_once() {
    const LONG: &str = "long.mcap";
    for flags in [&[][..], &["--busy-poll"]] {
        let robot = trained_twice();
        Trip { n_frames: 20_000, ..Trip::SECOND }.write(&robot.path(LONG));
        let service = robot.serve_with(flags);
        let mut consumer = robot.join();
        let publish = ["publish", "--trip", LONG, "--sensor", SENSOR, "--speed", "20", "--follow"];
        let mut shim = robot.start(&publish);
        consumer.await_reports(100);
        for model in [OTHER, MODEL] {
            let mut reload = robot.start(&["reload", "--sensor", SENSOR, "--model", model]);
            let n_before = consumer.await_that(|| reload.has_ended());
            let outcome = reload.end();
            assert_eq!((outcome.code, outcome.stderr.as_str()), (Some(0), ""), "{outcome:?}");
            let [now, before] =
                if model == OTHER { [OTHER, MODEL] } else { [MODEL, OTHER] }.map(|name| id(&robot, name));
            let path = robot.path(model);
            assert_eq!(
                outcome.stdout,
                format!("{SENSOR} is now served by model {now} of {}, before by {before}\n", path.display())
            );
            consumer.await_reports(n_before + 100);
        }
        shim.signal(Signal::TERM);
        let reports = consumer.await_end_of(&mut shim);
        let models = [MODEL, OTHER].map(|model| open_model(&robot.path(model)));
        let ids: Vec<_> = reports.iter().map(|report| report.model_id).collect();
        let changes: Vec<_> = ids.chunk_by(|a, b| a == b).map(|chunk| chunk[0]).collect();
        assert_eq!(changes, [models[0].id().0, models[1].id().0, models[0].id().0]);
        assert_reports_equal_classifying_by(&models, &reports, &robot.path(LONG));
        assert!(
            shim.end().stdout.starts_with(&format!("published {} frames of {SENSOR} in ", reports.len()))
        );
        let n_frames = reports.len();
        let told = service.stop(Signal::TERM);
        let served = format!(
            "served {n_frames} frames: {n_frames} classified, 0 invalid, 0 repeated, 0 refused; 0 lost"
        );
        assert_eq!(told.lines().last(), Some(&*served));
        assert_eq!(robot.shared_memory(), [""; 0]);
    }
}

#[test]
fn a_hang_up_signal_reads_the_models_file_again() {
    let robot = trained_twice();
    let service = robot.serve();
    let [old, new] = [MODEL, OTHER].map(|model| id(&robot, model));
    let path = robot.path(MODEL);

    service.signal(Signal::HUP);
    service.await_err(&format!(
        "INFO {SENSOR} is served by model {old} as before, read again from {}",
        path.display()
    ));
    replace(&robot, MODEL, &robot.read(OTHER));
    service.signal(Signal::HUP);
    service.await_err(&format!(
        "INFO {SENSOR} is now served by model {new} of {}, before by {old}",
        path.display()
    ));
    check_served_by(&robot, OTHER);

    replace(&robot, MODEL, &robot.read(FIRST));
    service.signal(Signal::HUP);
    service.await_err(&format!("WARN cannot open model {}: not a whole model file: ", path.display()));
    check_served_by(&robot, OTHER);
    service.stop(Signal::TERM);
}

fn check_served_by(robot: &Robot, model: &str) {
    let consumer = robot.join();
    let mut shim = robot.publish(SECOND, "max");
    let reports = consumer.await_end_of(&mut shim);
    // A consumer that comes is first given the last report of the trip before.
    let n_frames = 130.min(reports.len());
    let reports = &reports[reports.len() - n_frames..];
    assert_reports_equal_classifying_here(reports, &robot.path(model), &robot.path(SECOND));
}

#[test]
fn a_model_that_cannot_be_served_is_refused_in_words_and_the_one_in_use_stays() {
    let robot = trained_twice();
    Trip { n_readings: 8, ..Trip::FIRST }.write(&robot.path("narrow.mcap"));
    robot.succeed(&[&["train", "narrow.mcap", "--output", "narrow.kinds"][..], &SIZE].concat());
    let whole = robot.read(OTHER);
    robot.write("cut.kinds", &whole[..whole.len() - 1]);
    let mut flipped = whole.clone();
    flipped[whole.len() / 2] ^= 1;
    robot.write("flipped.kinds", flipped);
    let service = robot.serve();
    let end = format!("; {SENSOR} is served by the model that it has");
    let path = |model: &str| robot.path(model).display().to_string();
    for (model, parts) in [
        (
            "nowhere.kinds",
            [format!("no model at {}: there is no such file", path("nowhere.kinds")), end.clone()],
        ),
        (
            "cut.kinds",
            [format!("cannot open model {}: not a whole model file: ", path("cut.kinds")), end.clone()],
        ),
        (
            "flipped.kinds",
            [
                format!("cannot open model {}: the model file is damaged: ", path("flipped.kinds")),
                end.clone(),
            ],
        ),
        (
            "narrow.kinds",
            [
                format!(
                    "model {} is for 8 readings (1 × 8) of 0.001 m a count, this service is for 16 readings (1 × 16) of \
                     0.001 m a count; give it a model that was trained on this sensor",
                    path("narrow.kinds")
                ),
                end.clone(),
            ],
        ),
    ] {
        let parts: Vec<&str> = parts.iter().map(String::as_str).collect();
        robot.refuse_with(&["reload", "--sensor", SENSOR, "--model", model], 1, &parts);
        service.await_err(&format!("WARN {}", parts[0]));
    }
    check_served_by(&robot, MODEL);
    // Without a name it is the file in use that is read again, not the last that was refused.
    let said = robot.succeed(&["reload", "--sensor", SENSOR]);
    let model = id(&robot, MODEL);
    assert_eq!(
        said,
        format!("{SENSOR} is served by model {model} as before, read again from {}\n", path(MODEL))
    );
    service.stop(Signal::TERM);
}

#[test]
fn a_reload_where_nobody_serves_is_a_sentence() {
    let robot = Robot::trained();
    let reload = ["reload", "--sensor", SENSOR, "--model", MODEL];
    let sentence = "there is no service for crunch/ring that could be given a model; start one (kinds serve --sensor \
                    crunch/ring --model …)";
    robot.refuse(&reload, 1, sentence);
    // Nor is one that was killed.
    robot.serve().kill();
    robot.refuse(&reload, 1, sentence);
    assert_eq!(robot.shared_memory(), [""; 0]);
}

#[test]
fn a_reload_ends_when_its_service_hangs_or_dies() {
    let robot = Robot::trained();
    let reload = || robot.start(&["reload", "--sensor", SENSOR]);
    let service = robot.serve();
    service.signal(Signal::STOP);
    let hanging = reload();
    hanging.await_err("kinds: waiting for the service of crunch/ring to answer");
    hanging.signal(Signal::INT);
    let outcome = hanging.end();
    assert_eq!(outcome.code, Some(1));
    let last = outcome.stderr.lines().last().unwrap();
    assert_eq!(
        last,
        "kinds: cannot reload crunch/ring: stopped before the service has answered; it may still take the model into use"
    );
    let orphan = reload();
    orphan.await_err("kinds: waiting for the service of crunch/ring to answer");
    service.kill();
    let outcome = orphan.end();
    assert_eq!(outcome.code, Some(1));
    let last = outcome.stderr.lines().last().unwrap();
    assert_eq!(last, "kinds: cannot reload crunch/ring: the service has ended without an answer");
}
