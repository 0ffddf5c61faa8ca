//! What the robot was told to do, as a part of its frames: learnt, served, evaluated, replayed, recorded.

use kinds_trips::Command;
use rustix::process::Signal;
use serde_json::Value;

use crate::robot::{FIRST, MODEL, Robot, SECOND, SENSOR, SIZE};
use crate::world::{Trip, assert_reports_equal_classifying_here, told_along_the_loop};

/// A robot with two trips of which somebody told it what to do, and no model.
fn teleoperated() -> Robot {
    let robot = Robot::new();
    Trip { command: told_along_the_loop, ..Trip::FIRST }.write(&robot.path(FIRST));
    Trip { command: told_along_the_loop, ..Trip::SECOND }.write(&robot.path(SECOND));
    robot
}

fn train(robot: &Robot, trip: &str, flags: &[&str]) -> crate::running::Outcome {
    robot.run(&[&["train", trip, "--output", MODEL][..], &SIZE, flags].concat())
}

#[test]
fn commands_are_compared_in_serving_as_in_training() {
    for method in ["isomap", "pca"] {
        let robot = teleoperated();
        Trip::SECOND.write(&robot.path("silent.mcap"));
        let outcome = train(&robot, FIRST, &["--method", method, "--commands-weight", "0.5"]);
        assert_eq!(
            outcome.stderr,
            "kinds: 5 of 160 frames come before a trip's first command; there the robot is taken to stand still\n"
        );
        assert!(outcome.stdout.contains(" and commands in 8 dimensions"), "{outcome:?}");
        // The second trip's first frames come before its first command, and the same readings without any are elsewhere.
        let [told, silent] = [(SECOND, 4), ("silent.mcap", 130)].map(|(trip, n_uncommanded)| {
            let consumer = robot.join();
            let service = robot.serve();
            let mut shim = robot.publish(trip, "max");
            let reports = consumer.await_end_of(&mut shim);
            assert_reports_equal_classifying_here(&reports, &robot.path(MODEL), &robot.path(trip));
            service.await_err(
                "WARN frames have no command, and the model compares commands beside readings; until one comes the robot is \
                 taken to stand still",
            );
            let said = service.stop(Signal::TERM);
            let expected = format!(
                "served 130 frames: 130 classified, 0 invalid, 0 repeated, 0 refused; 0 lost; {n_uncommanded} without a \
                 command, taken as standing still"
            );
            assert_eq!(said.lines().last(), Some(&*expected));
            reports
        });
        let is_elsewhere = |index: usize| told[index].coordinates() != silent[index].coordinates();
        assert!((0..130).all(|index| is_elsewhere(index) == (index >= 4)));
    }
}

#[test]
fn a_weight_of_0_is_a_model_by_readings_alone_to_the_byte() {
    let robot = teleoperated();
    assert_eq!(train(&robot, FIRST, &[]).code, Some(0));
    let without = robot.read(MODEL);
    let outcome = train(&robot, FIRST, &["--commands-weight", "0"]);
    assert_eq!((outcome.code, outcome.stderr.as_str()), (Some(0), ""));
    assert!(robot.read(MODEL) == without);
    robot.write("none.ron", "(commands: (weight: 0))");
    train(&robot, FIRST, &["--config", "none.ron"]);
    assert!(robot.read(MODEL) == without);
    // Nor do commands matter that are recorded and not asked for.
    Trip::FIRST.write(&robot.path(FIRST));
    train(&robot, FIRST, &[]);
    assert!(robot.read(MODEL) == without);
}

#[test]
fn the_weight_in_a_file_is_that_of_the_flag_and_inspect_says_it() {
    let robot = teleoperated();
    train(&robot, FIRST, &["--commands-weight", "0.25"]);
    let by_flag = robot.read(MODEL);
    robot.write("commands.ron", "(commands: (weight: 0.25))");
    train(&robot, FIRST, &["--config", "commands.ron"]);
    assert!(robot.read(MODEL) == by_flag);
    let text = robot.succeed(&["inspect", MODEL]);
    let line = "commands     0.25 times as much as readings: half 0.00 to 0.60 m/s forward, half -0.80 to 0.80 rad/s of turn";
    let said = text.lines().find(|line| line.starts_with("commands ")).unwrap_or_default();
    assert_eq!(said, line, "{text}");
    let inspection: Value = serde_json::from_str(&robot.succeed(&["inspect", MODEL, "--json"])).unwrap();
    assert_eq!(inspection["commands"]["weight"], 0.25);
    train(&robot, FIRST, &[]);
    let without = robot.succeed(&["inspect", MODEL]);
    assert!(!without.contains("commands "), "{without}");
}

#[test]
fn a_trip_without_commands_where_they_are_asked_for_is_a_sentence() {
    let robot = teleoperated();
    train(&robot, FIRST, &["--commands-weight", "0.5"]);
    Trip::SECOND.write(&robot.path("silent.mcap"));
    let sentence = "trip silent.mcap has no commands to compare frames by: no message of type geometry_msgs/msg/Twist or \
                    geometry_msgs/msg/TwistStamped came at or before any of its 130 frames, or there are several such topics; \
                    name one with --commands-topic, record what the robot is told, or train with a commands weight of 0";
    let train = ["train", FIRST, "silent.mcap", "--output", "both.kinds", "--commands-weight", "0.5"];
    robot.refuse(&train, 1, sentence);
    robot.refuse(&["evaluate", MODEL, FIRST, "silent.mcap"], 1, sentence);
    let named = ["train", FIRST, "--output", "both.kinds", "--commands-topic", "/joystick"];
    robot.refuse_with(
        &named,
        1,
        &["first.mcap has no topic /joystick, asked for with --commands-topic; it has /cmd_vel ("],
    );
}

#[test]
fn evaluation_and_replay_compare_commands_too() {
    let robot = teleoperated();
    train(&robot, FIRST, &["--commands-weight", "0.5"]);
    let evaluate = |model: &str| -> Value {
        let arguments = ["evaluate", model, FIRST, SECOND, "--json"];
        serde_json::from_str(&robot.succeed(&arguments)).unwrap()
    };
    let isomap = evaluate(MODEL);
    for method in ["isomap", "pca"] {
        let kappa = isomap["methods"][method]["kappa"].as_f64().unwrap();
        assert!(kappa > 0.3, "{method}: {kappa}");
    }
    // The rival of either method is the model of the other.
    train(&robot, FIRST, &["--commands-weight", "0.5", "--method", "pca"]);
    assert_eq!(evaluate(MODEL)["methods"], isomap["methods"]);
    // A replay is blind to nothing: the same readings with other commands are other frames.
    robot.succeed(&["replay", SECOND, "--model", MODEL, "--bless", "kinds.csv"]);
    robot.succeed(&["replay", SECOND, "--model", MODEL, "--expect", "kinds.csv"]);
    let reverse = |place| {
        told_along_the_loop(place).map(|command| Command { turn_rad_s: -command.turn_rad_s, ..command })
    };
    Trip { command: reverse, ..Trip::SECOND }.write(&robot.path("reverse.mcap"));
    let outcome = robot.run(&["replay", "reverse.mcap", "--model", MODEL, "--expect", "kinds.csv"]);
    assert_eq!(outcome.code, Some(1));
    assert!(outcome.stderr.contains(" of 130 frames differ from what was expected"), "{outcome:?}");
}

#[test]
fn a_simulated_crunch_is_recorded_with_what_its_teleoperator_tells_it_and_learnt_by_that() {
    let robot = Robot::new();
    let recorder = robot.start(&["record", "--sensor", SENSOR, "--output", "drive.mcap", "--count", "150"]);
    recorder.await_err("kinds: waiting for a driver shim to publish crunch/ring");
    let shim = robot.start(&["publish", "--simulate", "crunch", "--sensor", SENSOR, "--speed", "20"]);
    let outcome = recorder.end();
    assert_eq!(outcome.code, Some(0), "{outcome:?}");
    shim.stop(Signal::TERM);
    let outcome = train(&robot, "drive.mcap", &["--commands-weight", "0.5"]);
    assert_eq!((outcome.code, outcome.stderr.as_str()), (Some(0), ""), "{outcome:?}");
    let inspection: Value = serde_json::from_str(&robot.succeed(&["inspect", MODEL, "--json"])).unwrap();
    // Crunch was told to drive ahead at its pace, and to turn either way.
    let column = |component: &str, end: &str| inspection["commands"][component][end].as_f64().unwrap();
    assert!(
        column("forward", "greatest") > 0.1
            && column("turn", "least") < 0.0
            && column("turn", "greatest") > 0.0
    );
}
