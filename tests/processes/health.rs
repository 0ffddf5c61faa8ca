//! How a service fares, for whoever looks: `kinds top`, and Prometheus.

use std::fs::File;
use std::io::{Read, Write};
use std::net::TcpStream;
use std::sync::{Arc, Mutex};

use rustix::process::Signal;
use rustix::pty::{OpenptFlags, grantpt, openpt, ptsname, unlockpt};
use rustix::termios::{Winsize, tcsetwinsize};
use serde_json::Value;

use crate::robot::{MODEL, Robot, SECOND, SENSOR};
use crate::running::await_that;

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
