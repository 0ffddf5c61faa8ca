//! `kinds publish --device`: frames that other programs send as bytes. Serial lines and cameras are tested where they are read.

#![allow(clippy::print_stderr, reason = "a test that is skipped says so")]

use std::io::Write;
use std::net::UdpSocket;
use std::process::{Command, Stdio};

use kinds_driver_shim::wire::Part;
use kinds_messages::{Frame, FrameHeader, ns_since_epoch};
use kinds_trips::FrameLayout;
use rustix::process::Signal;

use crate::robot::{Robot, SENSOR};
use crate::running::{Running, await_that};

const RING: FrameLayout = FrameLayout { rows: 1, columns: 16, metres_per_count: 0.001 };
const STDIN: [&str; 7] = ["publish", "--sensor", SENSOR, "--device", "stdin", "--columns", "16"];

fn bytes_of(layout: FrameLayout, sequence: u32, n_readings_most: usize) -> Vec<Vec<u8>> {
    let mut parts = Vec::new();
    let counts = vec![1000 + sequence as u16; layout.n_readings()];
    Part::each_of_frame(layout, sequence, 5, &counts, n_readings_most, |part| parts.push(part.to_vec()));
    parts
}

#[test]
fn frames_that_come_in_datagrams_are_published_with_their_time_and_number() {
    let robot = Robot::new();
    let frames = robot.join_frames();
    let sender = UdpSocket::bind("127.0.0.1:0").unwrap();
    // A port that was free a moment ago.
    let port = UdpSocket::bind("127.0.0.1:0").unwrap().local_addr().unwrap();
    let camera = FrameLayout { rows: 40, columns: 60, metres_per_count: 0.0005 };
    let device = format!("udp://{port}");
    let layout = ["--rows", "40", "--columns", "60", "--metres-per-count", "0.0005"];
    let shim = robot.start(&[&["publish", "--sensor", SENSOR, "--device", &device][..], &layout].concat());
    let mut sequence = 0;
    let mut received: Vec<Frame> = Vec::new();
    await_that(|| {
        // Until it listens, nobody does.
        for part in bytes_of(camera, sequence, 714) {
            let _ = sender.send_to(&part, port);
        }
        sequence += 1;
        received.extend(frames.receive().unwrap());
        received.len() >= 2
    });
    for frame in &received {
        let (header, counts) = (frame.header(), frame.counts());
        assert_eq!((header.rows, header.columns, header.metres_per_count), (40, 60, 0.0005));
        assert_eq!(header.captured_ns, 5);
        assert_eq!(counts.len(), 2400);
        assert!(counts.iter().all(|count| *count == counts[0]));
    }
    let [first, second] = [&received[0], &received[1]];
    assert_eq!(first.header().sequence, 0);
    assert_eq!(second.header().sequence, u64::from(second.counts()[0] - first.counts()[0]));
    shim.stop(Signal::TERM);
}

#[test]
fn what_comes_on_standard_input_and_is_no_frame_is_said_and_counted() {
    let robot = Robot::new();
    let (reader, mut writer) = std::io::pipe().unwrap();
    let shim = Running::start(robot.command(&STDIN).stdin(Stdio::from(reader)));
    writer.write_all(b"ring firmware 1.2\r\n").unwrap();
    for sequence in 0..3 {
        writer.write_all(&bytes_of(RING, sequence, 10).concat()).unwrap();
    }
    drop(writer);
    let outcome = shim.end();
    assert_eq!(outcome.code, Some(0), "{outcome:?}");
    assert_eq!(
        outcome.stderr,
        format!(
            "kinds: {SENSOR}: bytes come that are no whole frame; they are left out\n\
             kinds: of what stdin sent, were left out: 19 bytes that were no part of a frame, 0 parts of another layout, 0 frames \
             that lacked a part, 0 parts that came late or again\n"
        )
    );
    assert!(outcome.stdout.starts_with(&format!("published 3 frames of {SENSOR} in ")), "{outcome:?}");
}

#[test]
fn the_python_program_of_the_documents_sends_frames() {
    if Command::new("python3").arg("--version").output().is_err() {
        eprintln!("skipped: there is no python3");
        return;
    }
    let page = std::fs::read_to_string(concat!(env!("CARGO_MANIFEST_DIR"), "/docs/devices.md")).unwrap();
    let (_, program) = page.split_once("```python\n").unwrap();
    let robot = Robot::new();
    robot.write("send.py", program.split_once("```").unwrap().0);
    let frames = robot.join_frames();
    let (reader, writer) = std::io::pipe().unwrap();
    let shim = Running::start(robot.command(&STDIN).stdin(Stdio::from(reader)));
    let mut python = robot.command_of("python3", &["send.py"]).stdout(writer).spawn().unwrap();
    let mut received = None;
    await_that(|| {
        received = frames.receive().unwrap();
        received.is_some()
    });
    let frame = received.unwrap();
    let sequence = frame.header().sequence as u16;
    assert_eq!(frame.counts(), [1000 + sequence; 16]);
    assert!(python.wait().unwrap().success());
    let outcome = shim.end();
    assert_eq!((outcome.code, outcome.stderr.as_str()), (Some(0), ""));
    assert!(outcome.stdout.starts_with(&format!("published 100 frames of {SENSOR} in ")), "{outcome:?}");
}

/// Compiles the program that lets another meet a camera. None, in words, where it cannot be.
fn emulated_camera(robot: &Robot) -> Option<String> {
    let source = concat!(env!("CARGO_MANIFEST_DIR"), "/tests/processes/emulated_camera.c");
    let program = robot.path("emulated_camera").display().to_string();
    let Ok(compiled) = Command::new("cc").args(["-std=gnu11", "-o", &program, source]).output() else {
        eprintln!("skipped: there is no cc");
        return None;
    };
    let said = String::from_utf8_lossy(&compiled.stderr);
    if said.contains(".h: No such file") {
        eprintln!("skipped: a header of the system is not there: {said}");
        return None;
    }
    assert!(compiled.status.success(), "{said}");
    // Whether this system lets one process answer another's calls.
    let tried = robot.command_of(&program, &["tried", "1", "1", "/bin/true"]).output().unwrap();
    if tried.status.code() == Some(77) {
        eprintln!("skipped: calls cannot be answered here: {}", String::from_utf8_lossy(&tried.stderr));
        return None;
    }
    assert!(tried.status.success(), "{tried:?}");
    Some(program)
}

#[test]
fn frames_of_a_camera_are_read_through_the_systems_calls_and_its_memory() {
    let robot = Robot::new();
    let Some(camera) = emulated_camera(&robot) else { return };
    let frames = robot.join_frames();
    let file = robot.path("video0").display().to_string();
    let device = format!("v4l2://{file}?rate_hz=30");
    let publish = ["publish", "--sensor", SENSOR, "--rows", "40", "--columns", "60", "--device", &device];
    let kinds = [&file[..], "40", "60", env!("CARGO_BIN_EXE_kinds")];
    let before_ns = ns_since_epoch();
    let shim = Running::start(&mut robot.command_of(&camera, &[&kinds[..], &publish].concat()));
    let mut received: Vec<(FrameHeader, Vec<u16>)> = Vec::new();
    // Some of them of its second stream, which begins with the number after the first one's last.
    await_that(|| {
        while let Some(frame) = frames.receive().unwrap() {
            received.push((*frame.header(), frame.counts().to_vec()));
        }
        received.last().is_some_and(|(header, _)| header.sequence >= 13)
    });
    let now_ns = ns_since_epoch();
    let mut captured_ns = before_ns;
    for (header, counts) in received {
        assert_eq!((header.rows, header.columns), (40, 60));
        assert!(![5, 6].contains(&header.sequence), "damaged and lost frames are missing");
        let number = if header.sequence < 10 { header.sequence } else { header.sequence - 10 };
        let count = |index: u64| (number * 1009 + index / 60 * 31 + index % 60) as u16;
        assert!(counts.into_iter().eq((0..2400).map(count)), "frame {}", header.sequence);
        assert!((captured_ns..=now_ns).contains(&header.captured_ns));
        captured_ns = header.captured_ns;
    }
    shim.signal(Signal::TERM);
    let outcome = shim.end();
    assert_eq!(outcome.code, Some(0), "{outcome:?}");
    let expected = [
        format!("{SENSOR}: {file} does not send 30 frames a second, but 90.0"),
        format!("{SENSOR}: frames come damaged, as their driver says; they are left out"),
        format!("{SENSOR}: {file} cannot be read: it is not there; waiting until it can"),
        format!("{SENSOR}: {file} can be read"),
        format!(
            "of what {device} sent, were left out: 1 frames that its driver flagged as damaged, 0 that were cut short"
        ),
    ];
    let said = outcome.stderr.lines().filter_map(|line| line.strip_prefix("kinds: "));
    // If a hundred whole frames have come by then.
    let said: Vec<&str> = said.filter(|line| !line.contains("frames come as they should again")).collect();
    assert_eq!(said, expected);
}

#[test]
fn a_camera_that_is_not_there_is_waited_for_until_a_signal() {
    let robot = Robot::new();
    let device = ["--device", "v4l2:///dev/there-is-no-such-camera", "--rows", "240", "--columns", "424"];
    let shim = robot.start(&[&["publish", "--sensor", SENSOR][..], &device].concat());
    let said = "/dev/there-is-no-such-camera cannot be read: it is not there; waiting until it can";
    shim.await_err(&format!("kinds: {SENSOR}: {said}"));
    shim.stop(Signal::TERM);
}

#[test]
fn what_cannot_be_read_from_a_device_is_a_sentence() {
    let robot = Robot::new();
    let publish = ["publish", "--sensor", SENSOR];
    for (arguments, code, sentence) in [
        (
            &["--device", "stdin"][..],
            2,
            "say how many readings a row of the device's frames has: with columns in the configuration, or --columns",
        ),
        (
            &["--device", "stdin", "--columns", "16", "--speed", "2"],
            2,
            "a device's frames come as it sends them; leave out speed",
        ),
        (
            &["--simulate", "crunch", "--columns", "16"],
            2,
            "rows and columns are a device's; leave them out, or say which with --device",
        ),
        (
            &["--device", "stdin", "--columns", "0"],
            1,
            "frames of 1 × 0 readings cannot be read; there must be 1 to 16777216 of them",
        ),
        (
            &["--device", "v4l2:///dev/null", "--columns", "0"],
            1,
            "frames of 1 × 0 readings cannot be read; there must be 1 to 16777216 of them",
        ),
        (
            &["--device", "v4l2:///dev/null", "--rows", "240", "--columns", "424"],
            1,
            "/dev/null sends no pictures; name the device file of a camera that does (v4l2-ctl --list-devices shows them)",
        ),
    ] {
        robot.refuse(&[&publish[..], arguments].concat(), code, sentence);
    }
    let wrong = robot.run(&[&publish[..], &["--device", "tty", "--columns", "16"]].concat());
    assert_eq!(wrong.code, Some(2), "{wrong:?}");
    assert!(wrong.stderr.contains("device \"tty\" is none of udp://ADDRESS:PORT"), "{wrong:?}");
}
