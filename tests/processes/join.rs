//! `kinds join`: several sensors of one robot as one.

use std::collections::BTreeMap;
use std::path::Path;
use std::sync::Arc;

use kinds_driver_shim::simulated::{Crunch, Floor, Robot as _};
use kinds_messages::{Frame, FrameHeader, FrameReader};
use kinds_model::Classifier;
use kinds_trips::{
    Command, FrameInfo, FrameLayout, Image, ImageEncoding, Pose, Selection, TripWriter, WriterOptions,
};
use rustix::process::Signal;

use crate::consumer::Consumer;
use crate::robot::{MODEL, Robot, SIZE};
use crate::running::{Running, await_that};
use crate::world::{open_model, read_trip_with};

const SONAR: &str = "crunch/sonar";
const INFRARED: &str = "crunch/infrared";
const BOTH: &str = "crunch/sonar,crunch/infrared";
const JOINT: &str = "crunch/joint";

/// What a recording of both sensors is learnt from.
const BOTH_TOPICS: [&str; 4] =
    ["--frames-topic", "/crunch/sonar/frames,/crunch/infrared/frames", "--poses-topic", "/crunch/sonar/odom"];

/// Enough to learn from, at 10 Hz.
const N_FRAMES: usize = 400;

/// Of one of Crunch's two rings on a trip: the sonars at 10 Hz; the infrared sensors at 7 Hz, 13 ms before the sonars that they
/// would be with, and a second longer, so that what belongs to the last sonars has come.
fn write(robot: &Robot, name: &str, trip: u32, is_sonar: bool) {
    let mut crunch = Crunch::new(Floor::Fourth, trip, 0);
    let mut writer = TripWriter::create(&robot.path(name), &WriterOptions::default()).unwrap();
    let mut counts = vec![0; 16];
    let n_frames = if is_sonar { N_FRAMES } else { N_FRAMES + 10 };
    for index in 0..n_frames {
        let moment = crunch.step(&mut counts).unwrap();
        let mut at = moment.captured;
        if !is_sonar {
            if index * 7 % 10 >= 7 {
                continue;
            }
            at.0 -= 13_000_000;
        }
        let pose = moment.odometry;
        let pose = Pose { x_m: pose.x_m, y_m: pose.y_m, yaw_rad: pose.yaw_rad };
        writer.write_odometry("/odom", at, &pose).unwrap();
        let command = moment.command;
        let command = Command { forward_m_s: command.forward_m_s, turn_rad_s: command.turn_rad_s };
        writer.write_command("/cmd_vel", at, &command).unwrap();
        let image = Image {
            counts: if is_sonar { &counts[..8] } else { &counts[8..] },
            layout: FrameLayout { rows: 1, columns: 8, metres_per_count: 0.001 },
            encoding: ImageEncoding::Millimetres,
            big_endian: false,
            row_padding_bytes: 0,
        };
        writer.write_image("/frames", at, &image).unwrap();
    }
    writer.finish().unwrap();
}

fn publish(robot: &Robot, trip: &str, sensor: &str) -> Running {
    // Paced replay waits for nobody: slow enough for readers that have to share their processor with other tests.
    robot.start(&["publish", "--trip", trip, "--sensor", sensor, "--speed", "5"])
}

/// Starts a recorder of these sensors, and waits until it would take a frame of each.
fn record(robot: &Robot, sensors: &str, output: &str) -> Running {
    let recorder = robot.start(&["record", "--sensor", sensors, "--output", output]);
    let last = sensors.rsplit(',').next().unwrap();
    recorder.await_err(&format!("kinds: waiting for a driver shim to publish {last}"));
    recorder
}

/// Starts to join the two, and waits until it would take a frame of either.
fn join(robot: &Robot, more: &[&str]) -> Running {
    let joining = robot.start(&[&["join", "--sensor", BOTH, "--as", JOINT], more].concat());
    joining.await_err("kinds: waiting for the first frame of crunch/sonar, crunch/infrared");
    joining
}

fn read_topics(path: &Path, frames: &str) -> Vec<(FrameInfo, Vec<u16>)> {
    let topic = |name: &str| Some(name.to_string());
    let poses_topic = topic("/crunch/sonar/odom");
    read_trip_with(path, &Selection { frames_topic: topic(frames), poses_topic, ..Selection::default() })
}

#[test]
fn a_trip_of_two_sensors_trains_what_their_joint_frames_are_served_by_bit_for_bit() {
    let robot = Robot::new();
    for trip in [1, 2] {
        write(&robot, &format!("sonar{trip}.mcap"), trip, true);
        write(&robot, &format!("infrared{trip}.mcap"), trip, false);
    }
    // Both are recorded into one trip, which is learnt from.
    let recorder = record(&robot, BOTH, "both1.mcap");
    let shims = [publish(&robot, "sonar1.mcap", SONAR), publish(&robot, "infrared1.mcap", INFRARED)];
    for shim in shims {
        assert_eq!(shim.end().code, Some(0));
    }
    let recorded = recorder.stop(Signal::TERM);
    assert!(recorded.ends_with("; 0 frames lost\n"), "{recorded}");
    let learnt =
        robot.succeed(&[&["train", "both1.mcap", "--output", MODEL][..], &BOTH_TOPICS, &SIZE].concat());
    assert!(learnt.contains(" frames of 16 readings"), "{learnt}");

    // The second time they are joined and served while they are recorded; service, recorder and consumer know of nothing new.
    let service = robot.start(&["serve", "--model", MODEL, "--sensor", JOINT]);
    service.await_out("serving crunch/joint: 5 kinds of 16 readings (1 × 16)");
    let mut consumer = Consumer::join(robot.domain(), JOINT);
    let watch = robot.start(&["watch", "--sensor", JOINT, "--count", "3"]);
    let joining = join(&robot, &["--wait-ms", "10000"]);
    let recorder = record(&robot, "crunch/sonar,crunch/infrared,crunch/joint", "both2.mcap");
    let shims = [publish(&robot, "sonar2.mcap", SONAR), publish(&robot, "infrared2.mcap", INFRARED)];
    joining.await_out(
        "joining crunch/sonar,crunch/infrared as crunch/joint: 16 readings (1 × 16) of 0.001 m a count",
    );
    // Taken as they come: there is room for 256.
    let reports = consumer.await_reports(N_FRAMES).to_vec();
    for shim in shims {
        assert_eq!(shim.end().code, Some(0));
    }
    assert_eq!(watch.end().code, Some(0));
    let recorded = recorder.stop(Signal::TERM);
    assert!(recorded.ends_with("; 0 frames lost\n"), "{recorded}");
    let told = joining.stop(Signal::TERM);
    assert!(told.contains(&format!("published {N_FRAMES} frames of crunch/joint in ")), "{told}");
    let told = service.stop(Signal::TERM);
    assert!(told.contains(&format!("served {N_FRAMES} frames: {N_FRAMES} classified")), "{told}");

    // Joint frames as they were published are those of the trip.
    let both2 = robot.path("both2.mcap");
    let live = read_topics(&both2, "/crunch/joint/frames");
    let paired = read_topics(&both2, "/crunch/sonar/frames,/crunch/infrared/frames");
    assert_eq!(live.len(), N_FRAMES);
    for ((live, live_counts), (paired, paired_counts)) in live.iter().zip(&paired) {
        assert_eq!((live.captured, live_counts), (paired.captured, paired_counts));
    }
    let is_whole = |(_, counts): &(FrameInfo, Vec<u16>)| {
        let (sonar, infrared) = counts.split_at(8);
        [sonar, infrared].iter().all(|part| part.iter().any(|&count| count != 0))
    };
    assert!(paired.iter().all(is_whole));
    // Reports are what the model says of them.
    let mut classifier = Classifier::new(Arc::new(open_model(&robot.path(MODEL))));
    for (report, (frame, counts)) in reports.iter().zip(&paired) {
        let here = classifier.classify(counts);
        assert_eq!((report.captured_ns, report.kind as usize), (frame.captured.0, here.kind));
        let bits = |numbers: &[f64]| numbers.iter().map(|number| number.to_bits()).collect::<Vec<_>>();
        assert_eq!(bits(report.probabilities()), bits(&here.probabilities));
        assert_eq!(report.novelty.to_bits(), here.novelty.to_bits());
    }
    // And kinds are those by which the trip is evaluated.
    robot.succeed(&[&["evaluate", MODEL, "both2.mcap", "--report", "uses"][..], &BOTH_TOPICS].concat());
    let kinds = kinds_on_path(&robot.path("uses"));
    assert_eq!(kinds.len(), N_FRAMES);
    for (index, report) in reports.iter().enumerate() {
        assert_eq!(kinds[&index], report.filtered_kind as usize, "frame {index}");
    }
}

/// The kind of each frame in the report of an evaluation.
fn kinds_on_path(report: &Path) -> BTreeMap<usize, usize> {
    let files = std::fs::read_dir(report).unwrap().map(|entry| entry.unwrap().path());
    let mut tables = files.filter(|path| path.extension().is_some_and(|end| end == "csv"));
    let text = tables.find_map(|path| {
        let text = std::fs::read_to_string(path).unwrap();
        text.starts_with("trip,frame,x_m,y_m,kind").then_some(text)
    });
    let number = |field: &str| field.parse().unwrap();
    let kind = |line: &str| {
        let fields: Vec<&str> = line.split(',').collect();
        (number(fields[1]), number(fields[4]))
    };
    text.unwrap().lines().skip(1).map(kind).collect()
}

/// The next frame of which something holds: what is known of it.
fn await_frame(frames: &FrameReader, holds: impl Fn(&Frame) -> bool) -> FrameHeader {
    let mut found = None;
    await_that(|| {
        while let Some(frame) = frames.receive().unwrap() {
            if holds(&frame) {
                found = Some(*frame.header());
            }
        }
        found.is_some()
    });
    found.unwrap()
}

fn frames_of(robot: &Robot, sensor: &str) -> FrameReader {
    FrameReader::open(&robot.node(), &sensor.parse().unwrap()).unwrap()
}

/// Crunch, fast. Its time of capture begins where it does each time.
fn simulate(robot: &Robot, sensor: &str) -> Running {
    robot.start(&["publish", "--simulate", "crunch", "--sensor", sensor, "--speed", "5"])
}

#[test]
fn without_a_partner_that_is_killed_joint_frames_are_invalid_until_it_is_back() {
    let robot = Robot::new();
    let (joint, of_infrared) = (frames_of(&robot, JOINT), frames_of(&robot, INFRARED));
    let is_whole = |frame: &Frame| frame.counts()[16..].iter().any(|&count| count != 0);
    let joining = join(&robot, &["--tolerance-ms", "1000"]);
    // The partner first each time: it is ahead of the leader, so that what belongs to the leader's frames has come.
    let start = || {
        let infrared = simulate(&robot, INFRARED);
        await_frame(&of_infrared, |_| true);
        (infrared, simulate(&robot, SONAR))
    };
    let (infrared, sonar) = start();
    await_frame(&joint, is_whole);
    infrared.kill();
    await_frame(&joint, |frame| frame.counts().iter().all(|&count| count == 0));
    joining.await_err(
        "kinds: crunch/joint: crunch/infrared has no frame at the time of those of crunch/sonar, or at most 1000 ms before (its last \
         was captured ",
    );
    // Both anew, so that their times are alike again.
    sonar.kill();
    while of_infrared.receive().unwrap().is_some() {}
    let (infrared, sonar) = start();
    await_frame(&joint, is_whole);
    joining.await_err(
        "kinds: crunch/joint: crunch/infrared has frames at the time of those of crunch/sonar again; ",
    );
    sonar.stop(Signal::TERM);
    infrared.stop(Signal::TERM);
    joining.signal(Signal::TERM);
    let outcome = joining.end();
    assert_eq!(outcome.code, Some(0), "{outcome:?}");
    let summary = outcome.stderr.lines().last().unwrap();
    assert!(
        summary.contains(" frames of crunch/sonar, ") && summary.contains(" were joined without one of"),
        "{summary}"
    );
}

#[test]
fn a_leader_that_is_killed_and_back_is_joined_in_rising_numbers() {
    let robot = Robot::new();
    let joint = frames_of(&robot, JOINT);
    let joining = join(&robot, &[]);
    let (_infrared, sonar) = (simulate(&robot, INFRARED), simulate(&robot, SONAR));
    let before = await_frame(&joint, |frame| frame.header().sequence > 10);
    sonar.kill();
    let sonar = simulate(&robot, SONAR);
    // Its time of capture begins anew.
    let after = await_frame(&joint, |frame| frame.header().captured_ns < before.captured_ns);
    assert!(after.sequence > before.sequence && after.run == before.run, "{before:?} {after:?}");
    sonar.stop(Signal::TERM);
    joining.stop(Signal::TERM);
}

#[test]
fn a_sensor_that_becomes_another_is_left_out_in_words() {
    let robot = Robot::new();
    let joint = frames_of(&robot, JOINT);
    let joining = join(&robot, &[]);
    let (_sonar, infrared) = (simulate(&robot, SONAR), simulate(&robot, INFRARED));
    await_frame(&joint, |_| true);
    infrared.stop(Signal::TERM);
    write(&robot, "other.mcap", 1, true);
    let _other = publish(&robot, "other.mcap", INFRARED);
    joining.await_err(
        "kinds: crunch/joint: frames of crunch/infrared have 8 readings (1 × 8) of 0.001 m a count, and had 16 readings (2 × 8) of \
         0.001 m a count when joining began; they are left out. If they are to stay so, start this program anew",
    );
    await_frame(&joint, |frame| frame.counts().len() == 32);
    joining.stop(Signal::TERM);
}

#[test]
fn what_cannot_be_joined_is_a_sentence() {
    let robot = Robot::new();
    for (arguments, sentence) in [
        (
            &["--sensor", SONAR, "--as", JOINT][..],
            "sensor is crunch/sonar; it takes two or more to join, with commas between them",
        ),
        (
            &["--sensor", BOTH, "--as", INFRARED],
            "as is crunch/infrared, which is one of the sensors to join; give joint frames a name of their own",
        ),
        (
            &["--sensor", BOTH, "--as", JOINT, "--wait-ms", "10001"],
            "wait_ms is 10001; it must be at most 10000",
        ),
    ] {
        robot.refuse(&[&["join"][..], arguments].concat(), 2, sentence);
    }
    robot.refuse_with(
        &["join", "--sensor", "crunch/sonar,crunch/sonar", "--as", JOINT],
        2,
        &["crunch/sonar is there twice; name each sensor once"],
    );
    robot.write("join.ron", "Join(sensor: \"crunch/sonar,crunch/infrared\")");
    let no_name = "say which sensor to publish joint frames as: with as in the configuration, or --as";
    robot.refuse(&["join", "--config", "join.ron"], 2, no_name);
    // Somebody else publishes under this name already.
    let of_joint = frames_of(&robot, JOINT);
    let _shims = [JOINT, SONAR, INFRARED].map(|sensor| simulate(&robot, sensor));
    await_frame(&of_joint, |_| true);
    let outcome = robot.run(&["join", "--config", "join.ron", "--as", JOINT]);
    assert_eq!(outcome.code, Some(1), "{outcome:?}");
    assert_eq!(
        outcome.stderr.lines().last(),
        Some(
            "kinds: sensor crunch/joint is already published by another driver shim; stop that one first, or publish under another \
             sensor name"
        )
    );
}

#[test]
fn a_signal_ends_it_before_the_sensors_are_there() {
    let robot = Robot::new();
    let joining = join(&robot, &[]);
    joining.stop(Signal::TERM);
    assert!(robot.shared_memory().is_empty(), "{:?}", robot.shared_memory());
}
