//! `kinds publish --simulate`: a robot that nobody has.

use std::path::Path;

use kinds_driver_shim::simulated::{Chew, Crunch, Floor, Robot as Simulated};

use crate::robot::{Robot, SENSOR};
use crate::running::await_that;
use crate::world::read_trip;

/// Reads the first frames that a simulated robot publishes, and compares them with driving it here.
fn check(arguments: &[&str], mut here: Box<dyn Simulated>) {
    let robot = Robot::new();
    let frames = robot.join_frames();
    let shim = robot.start(&[&["publish", "--sensor", SENSOR, "--simulate"], arguments].concat());
    let mut expected = vec![0; here.layout().n_readings()];
    for sequence in 0..5 {
        let mut received = None;
        await_that(|| {
            received = frames.receive().unwrap();
            received.is_some()
        });
        let frame = received.unwrap();
        let moment = here.step(&mut expected).unwrap();
        assert_eq!(frame.header().sequence, sequence);
        assert_eq!(frame.header().captured_ns, moment.captured.0);
        assert_eq!(frame.header().known_pose(), Some(moment.odometry));
        assert_eq!(frame.header().known_command(), Some(moment.command));
        assert_eq!(frame.header().known_true_pose(), Some(moment.true_pose));
        assert_eq!(frame.counts(), expected);
    }
    shim.stop(rustix::process::Signal::TERM);
}

#[test]
fn crunch_drives_the_floor_and_trip_that_are_asked_for() {
    check(&["crunch"], Box::new(Crunch::new(Floor::Fourth, 1, 0)));
    check(
        &["crunch", "--world", "fifth-floor", "--trip", "3", "--seed", "7", "--speed", "2"],
        Box::new(Crunch::new(Floor::Fifth, 3, 7)),
    );
}

#[test]
fn chew_drives_on_its_campus() {
    check(&["chew", "--trip", "2", "--speed", "2"], Box::new(Chew::new(2, 0)));
}

/// Every 38th frame of its second trip, `tests/replay/README.md`: the same on every machine, pixel for pixel. A change here
/// changes everybody's simulated trips: say so in the change log.
#[test]
fn chew_still_sees_what_the_recording_that_the_repository_carries_has_of_it() {
    const EVERY: usize = 38;
    let recorded = read_trip(Path::new(concat!(env!("CARGO_MANIFEST_DIR"), "/tests/replay/camera2.mcap")));
    let mut chew = Chew::new(2, 0);
    let mut counts = vec![0; chew.layout().n_readings()];
    for (index, (frame, expected)) in recorded.iter().take(6).enumerate() {
        let n_steps = if index == 0 { 1 } else { EVERY };
        let moment = (0..n_steps).map(|_| chew.step(&mut counts).unwrap()).last().unwrap();
        assert_eq!(frame.captured, moment.captured);
        assert!(*expected == counts, "frame {} has changed", index * EVERY);
    }
}

#[test]
fn what_cannot_be_simulated_is_a_sentence() {
    let robot = Robot::new();
    let publish = ["publish", "--sensor", SENSOR];
    for (arguments, sentence) in [
        (
            &["--simulate", "crunch", "--trip", "trip2.mcap"][..],
            "with --simulate, --trip is the number of one of the robot's trips, such as 2; it is \"trip2.mcap\"",
        ),
        (
            &["--simulate", "chew", "--world", "fifth-floor"],
            "chew drives on its campus alone; leave out --world",
        ),
    ] {
        robot.refuse(&[&publish[..], arguments].concat(), 2, sentence);
    }
    for (arguments, part) in [
        (
            &["--simulate", "crunch", "--world", "attic"][..],
            "there is no floor \"attic\" to drive on; choose fourth-floor or fifth-floor",
        ),
        (&["--seed", "3", "--trip", "trip2.mcap"], "--simulate"),
        (&[], "--trip"),
    ] {
        let outcome = robot.run(&[&publish[..], arguments].concat());
        assert_eq!(outcome.code, Some(2), "{outcome:?}");
        assert!(outcome.stderr.contains(part), "{outcome:?}");
    }
}
