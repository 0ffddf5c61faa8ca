//! How a service fares, for whoever looks: `kinds top`, and Prometheus.

use std::fs::File;
use std::io::{Read, Write};
use std::net::TcpStream;
use std::path::Path;
use std::sync::{Arc, Mutex};
use std::time::Duration;

use kinds_messages::{FrameHeader, FramePublisher};
use kinds_model::{Classifier, SensorLayout};
use rustix::process::Signal;
use rustix::pty::{OpenptFlags, grantpt, openpt, ptsname, unlockpt};
use rustix::termios::{Winsize, tcsetwinsize};
use serde_json::Value;

use crate::robot::{MODEL, Robot, SECOND, SENSOR};
use crate::running::await_that;
use crate::world::{open_model, read_trip};

fn scrape(address: &str, path: &str) -> String {
    let mut connection = TcpStream::connect(address).unwrap();
    write!(connection, "GET {path} HTTP/1.1\r\nHost: {address}\r\n\r\n").unwrap();
    let mut answer = String::new();
    connection.read_to_string(&mut answer).unwrap();
    answer
}

#[test]
fn top_and_metrics_count_what_was_served() {
    let robot = Robot::trained();
    let service = robot.start(&["serve", "--model", MODEL, "--sensor", SENSOR, "--metrics", "127.0.0.1:0"]);
    let serving = service.await_out(&format!("serving {SENSOR}: "));
    let (_, address) = serving.split_once("; metrics at http://").unwrap();
    let address = address.strip_suffix("/metrics").unwrap();
    assert_eq!(robot.publish(SECOND, "max").end().code, Some(0));
    await_that(|| scrape(address, "/metrics").contains("kinds_frames_total{sensor=\"crunch/ring\"} 130\n"));
    let answer = scrape(address, "/metrics");
    assert!(answer.starts_with("HTTP/1.1 200 OK\r\n"), "{answer}");
    let count = "kinds_latency_seconds_count{sensor=\"crunch/ring\",stage=\"sent_to_reported\"} 130\n";
    assert!(answer.contains(count), "{answer}");
    assert!(scrape(address, "/").starts_with("HTTP/1.1 404 "));

    let said: Value = serde_json::from_str(&robot.succeed(&["top", "--once", "--json"])).unwrap();
    let sensor = &said["sensors"][0];
    assert_eq!(sensor["sensor"], SENSOR);
    assert_eq!(sensor["programs"][0]["name"], "kinds-serve", "{said}");
    assert_eq!(
        (&sensor["health"]["n_frames"], &sensor["health"]["n_classified"]),
        (&130.into(), &130.into())
    );
    let text = robot.succeed(&["top", "--once"]);
    assert!(text.contains("  connected: kinds-serve ") && text.contains(SENSOR), "{text}");
    service.stop(Signal::TERM);
    assert_eq!(robot.shared_memory(), [""; 0]);
}

#[test]
fn drift_is_told_of_readings_in_another_order_and_not_of_a_second_trip_and_begins_anew_with_a_model() {
    let robot = Robot::new();
    let replay = |name: &str| {
        std::fs::read(Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/replay").join(name)).unwrap()
    };
    robot.write(MODEL, replay("ring.kinds"));
    robot.write(SECOND, replay("ring2.mcap"));
    let service = robot.start(&["serve", "--model", MODEL, "--sensor", SENSOR, "--metrics", "127.0.0.1:0"]);
    let serving = service.await_out(&format!("serving {SENSOR}: "));
    let (_, address) = serving.split_once("; metrics at http://").unwrap();
    let address = address.strip_suffix("/metrics").unwrap();
    let drift = || {
        let said: Value = serde_json::from_str(&robot.succeed(&["top", "--once", "--json"])).unwrap();
        said["sensors"][0]["health"]["drift"].clone()
    };
    assert_eq!((&drift()["n_frames"], &drift()["novel"]), (&0.into(), &Value::Null));

    assert_eq!(robot.publish(SECOND, "max").end().code, Some(0));
    await_that(|| drift()["n_frames"] == 600);
    let of_second = drift();
    let model = Arc::new(open_model(&robot.path(MODEL)));
    let (mut classifier, mut filter) = (Classifier::new(Arc::clone(&model)), model.filter());
    let frames = read_trip(&robot.path(SECOND));
    let (mut n_novel, mut sums, mut kinds) = (0, [0.0; 5], Vec::new());
    for (_, counts) in &frames {
        let found = classifier.classify(counts);
        n_novel += usize::from(found.novelty >= 0.99);
        sums.iter_mut().zip(&found.probabilities).for_each(|(sum, probability)| *sum += probability);
        filter.take(Some(&found.probabilities), 0);
        kinds.push(filter.kind());
    }
    let weights = model.mixture().weights();
    let apart: f64 = sums.iter().zip(weights).map(|(sum, weight)| (sum / 600.0 - weight).abs()).sum();
    let n_changes = kinds.windows(2).filter(|pair| pair[0] != pair[1]).count();
    let n_draws = n_changes as f64 / (1.0 - weights.iter().map(|weight| weight * weight).sum::<f64>());
    let of_kind = |weight: &f64| (weight * (1.0 - weight) / std::f64::consts::PI / n_draws).sqrt();
    for (field, expected) in [
        ("novel", n_novel as f64 / 600.0),
        ("novel_usual", 0.01),
        ("total_variation", apart / 2.0),
        ("total_variation_usual", weights.iter().map(of_kind).sum()),
        ("half_split_usual", model.manifest().half_split.unwrap().usual),
    ] {
        assert!(
            (of_second[field].as_f64().unwrap() - expected).abs() < 1e-9,
            "{field} {expected} {of_second}"
        );
    }
    assert_eq!(of_second["is_unusual"], false, "{of_second}");
    let text = robot.succeed(&["top", "--once"]);
    assert!(!text.contains("drift"), "{text}");

    let publisher = FramePublisher::create(&robot.node(), &SENSOR.parse().unwrap(), 16).unwrap();
    let SensorLayout { rows, columns, metres_per_count } = model.layout();
    for (sequence, (_, counts)) in (0..).zip(&frames) {
        // As fast as they are served, for the most part.
        std::thread::sleep(Duration::from_millis(1));
        let mut loan = publisher.loan().unwrap();
        let order = |place: usize| counts[5 * place % 16];
        loan.counts_mut().iter_mut().enumerate().for_each(|(place, count)| *count = order(place));
        loan.send(&FrameHeader { sequence, metres_per_count, rows, columns, ..FrameHeader::default() })
            .unwrap();
    }
    await_that(|| drift()["is_unusual"] == true);
    let text = robot.succeed(&["top", "--once"]);
    let end = ": look at the sensor; if all is well, kinds update learns from such trips";
    let is_told = |line: &str| line.starts_with("  drift: in the last 10 min ") && line.ends_with(end);
    assert!(text.lines().any(is_told), "{text}");
    let answer = scrape(address, "/metrics");
    let (_, after) = answer.split_once("kinds_recent_novel_share{sensor=\"crunch/ring\"} ").unwrap();
    let novel: f64 = after.lines().next().unwrap().parse().unwrap();
    assert!(novel > 0.05, "{novel}");

    robot.succeed(&["reload", "--sensor", SENSOR, "--model", MODEL]);
    await_that(|| drift()["n_frames"] == 0);
    service.stop(Signal::TERM);
}

/// A terminal of 80 columns and 24 rows: the end that is a person's, and the one that is a program's.
fn terminal() -> (File, File) {
    let ours = openpt(OpenptFlags::RDWR | OpenptFlags::NOCTTY).unwrap();
    grantpt(&ours).unwrap();
    unlockpt(&ours).unwrap();
    let name = ptsname(&ours, Vec::new()).unwrap().into_string().unwrap();
    let theirs = File::options().read(true).write(true).open(name).unwrap();
    tcsetwinsize(&theirs, Winsize { ws_row: 24, ws_col: 80, ws_xpixel: 0, ws_ypixel: 0 }).unwrap();
    (File::from(ours), theirs)
}

#[test]
fn top_shows_a_screen_in_a_terminal_until_q_and_says_when_the_service_is_killed() {
    let robot = Robot::trained();
    let service = robot.serve();
    let (mut ours, theirs) = terminal();
    let mut command = robot.command(&["top"]);
    command.env("TERM", "xterm").stdin(theirs.try_clone().unwrap()).stdout(theirs);
    let mut top = command.spawn().unwrap();
    drop(command);
    let shown: Arc<Mutex<Vec<u8>>> = Arc::default();
    let reading = {
        let (shown, mut ours) = (Arc::clone(&shown), ours.try_clone().unwrap());
        std::thread::spawn(move || {
            let mut bytes = [0; 4096];
            // The last program that closes its end ends the terminal: an error here.
            while let Ok(n @ 1..) = ours.read(&mut bytes) {
                shown.lock().unwrap().extend(&bytes[..n]);
            }
        })
    };
    let is_shown = |words: &str| String::from_utf8_lossy(&shown.lock().unwrap()).contains(words);
    // Only what changes is written: words that stand where nothing was, and then others over numbers.
    await_that(|| is_shown("kinds-serve") && is_shown("received"));
    service.kill();
    await_that(|| is_shown("not served"));
    ours.write_all(b"q").unwrap();
    await_that(|| top.try_wait().unwrap().is_some());
    assert!(top.wait().unwrap().success());
    reading.join().unwrap();
    // It leaves the screen as it was.
    assert!(is_shown("\u{1b}[?1049l"));
}
