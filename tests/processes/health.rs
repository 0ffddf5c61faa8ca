//! How a service fares, for whoever looks: `kinds top`, and Prometheus.

use std::io::{Read, Write};
use std::net::TcpStream;

use rustix::process::Signal;
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
