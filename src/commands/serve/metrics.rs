//! A service's health for Prometheus, in its text format, on a thread of its own.
//!
//! The loop leaves a copy of each health report, once a second, and never waits: while a scrape takes its copy, one is left
//! out. Scrapes are answered one after the other, none for longer than [`PATIENCE`].

use std::fmt::Write as _;
use std::io::{self, BufRead, BufReader, Read, Write};
use std::net::{SocketAddr, TcpListener, TcpStream};
use std::sync::{Arc, Mutex};
use std::thread;
use std::time::Duration;

use kinds_messages::{HealthReport, Latency, SensorName};
use kinds_model::ModelId;
use rustix::thread::CpuSet;

use crate::failure::Failure;
use crate::realtime;

/// Longest that a scrape may take to ask or to read.
const PATIENCE: Duration = Duration::from_secs(2);

/// Most bytes of a request that are read.
const N_REQUEST_BYTES_MAX: u64 = 8192;

/// Between two tries where the system has no connection to give.
const PAUSE: Duration = Duration::from_millis(100);

/// A listener that nobody has been answered on yet.
pub(crate) struct Metrics {
    listener: TcpListener,
    address: SocketAddr,
    sensor: SensorName,
}

impl Metrics {
    pub(crate) fn listen(address: SocketAddr, sensor: &SensorName) -> Result<Self, Failure> {
        let listening =
            TcpListener::bind(address).and_then(|listener| Ok((listener.local_addr()?, listener)));
        let (address, listener) = listening.map_err(|error| {
            Failure::CouldNot(format!(
                "cannot serve metrics at {address}: {error}; choose another address or port with --metrics"
            ))
        })?;
        Ok(Self { listener, address, sensor: sensor.clone() })
    }

    /// Where it listens, with the port that the system chose if it was asked to.
    pub(crate) fn address(&self) -> SocketAddr {
        self.address
    }

    /// Starts to answer, as long as this program lives, and returns who is to be told of every health report.
    ///
    /// * `processors` — where to run, if that is not where the caller does
    pub(crate) fn start(self, processors: Option<CpuSet>) -> impl FnMut(&HealthReport) + 'static {
        let latest = Arc::new(Mutex::new(HealthReport::default()));
        let for_scrapes = Arc::clone(&latest);
        thread::spawn(move || {
            realtime::return_to(processors);
            for connection in self.listener.incoming() {
                match connection {
                    Ok(connection) => {
                        let copy = || *for_scrapes.lock().unwrap_or_else(|poisoned| poisoned.into_inner());
                        let answered = answer(&connection, || text(&self.sensor, &copy()));
                        if let Err(error) = answered {
                            tracing::debug!("a scrape of the metrics failed: {error}");
                        }
                    }
                    Err(_) => thread::sleep(PAUSE),
                }
            }
        });
        move |health| {
            if let Ok(mut latest) = latest.try_lock() {
                *latest = *health;
            }
        }
    }
}

/// Answers one request, and closes.
fn answer(mut connection: &TcpStream, metrics: impl FnOnce() -> String) -> io::Result<()> {
    connection.set_read_timeout(Some(PATIENCE))?;
    connection.set_write_timeout(Some(PATIENCE))?;
    let mut request = BufReader::new(connection.take(N_REQUEST_BYTES_MAX));
    let mut first = String::new();
    request.read_line(&mut first)?;
    // Whoever closes before all has been read makes the system take back what was answered.
    let mut header = String::new();
    while request.read_line(&mut header)? > 0 && !header.trim_end().is_empty() {
        header.clear();
    }
    let mut words = first.split_whitespace();
    let (status, body) = match (words.next(), words.next()) {
        (Some("GET"), Some("/metrics")) => ("200 OK", metrics()),
        (Some("GET"), Some(_)) => ("404 Not Found", "the metrics are at /metrics\n".to_string()),
        (Some(_), Some(_)) => ("405 Method Not Allowed", "metrics can only be got\n".to_string()),
        _ => ("400 Bad Request", "this is not HTTP\n".to_string()),
    };
    write!(
        connection,
        "HTTP/1.1 {status}\r\nContent-Type: text/plain; version=0.0.4; charset=utf-8\r\nContent-Length: {}\r\n\
         Connection: close\r\n\r\n{body}",
        body.len()
    )
}

/// Health in Prometheus' text format, version 0.0.4.
fn text(sensor: &SensorName, health: &HealthReport) -> String {
    let mut text = String::new();
    let counters = [
        ("frames", "Frames that came.", health.n_frames),
        ("frames_classified", "Frames classified.", health.n_classified),
        ("frames_invalid", "Frames without any valid reading.", health.n_invalid),
        ("frames_novel", "Frames classified that are unlike what the model has seen.", health.n_novel),
        ("frames_lost", "Frames that never came, by gaps in their sequence.", health.n_lost),
        ("frames_repeated", "Frames that came twice or out of order.", health.n_repeated),
        ("frames_late", "Frames reported when the next one was due.", health.n_late),
        ("frames_refused", "Frames that were not for the model.", health.n_refused),
        ("frames_uncommanded", "Frames without a command that the model compares.", health.n_uncommanded),
        ("reloads", "Models taken into use after the first.", health.n_reloads),
        ("reloads_refused", "Models asked for and refused.", health.n_reloads_refused),
        ("peers_lost", "Killed programs that were cleaned up after.", health.n_peers_lost),
    ];
    for (name, help, value) in counters {
        single(&mut text, sensor, &format!("kinds_{name}_total"), "counter", help, value as f64);
    }
    let uptime_s = seconds(health.uptime_ns);
    single(&mut text, sensor, "kinds_uptime_seconds", "gauge", "Since the service started.", uptime_s);
    let has_shim = f64::from(u8::from(health.has_shim()));
    let help = "Whether a driver shim publishes the sensor.";
    single(&mut text, sensor, "kinds_shim_present", "gauge", help, has_shim);
    metric(&mut text, "kinds_model_info", "gauge", "The model in use.");
    let model = ModelId(health.model_id);
    line(&mut text, &format!("kinds_model_info{{sensor=\"{sensor}\",model=\"{model}\"}}"), 1.0);
    let drift = &health.drift;
    for (name, help, value) in [
        (
            "recent_frames",
            "Frames classified in the last ten minutes, which drift is of.",
            drift.n_frames as f64,
        ),
        ("recent_novel_share", "Share of them that are novel.", drift.novel),
        ("usual_novel_share", "The same of frames like those learnt from.", drift.novel_usual),
        ("recent_total_variation", "Of the kinds' shares from those in training.", drift.total_variation),
        ("usual_total_variation", "What chance makes of that.", drift.total_variation_usual),
        ("recent_half_split_error", "Median, as a share of the radius of trained places.", drift.half_split),
        ("usual_half_split_error", "The same of frames like those learnt from.", drift.half_split_usual),
    ] {
        single(&mut text, sensor, &format!("kinds_{name}"), "gauge", help, value);
    }
    let name = "kinds_latency_seconds";
    metric(
        &mut text,
        name,
        "summary",
        "Time that a stage of a frame's way took: quantiles over the last second.",
    );
    let (last, all) = (&health.last_interval, &health.since_start);
    for (stage, last, all) in [
        ("sent_to_received", last.sent_to_received, all.sent_to_received),
        ("received_to_reported", last.received_to_reported, all.received_to_reported),
        ("sent_to_reported", last.sent_to_reported, all.sent_to_reported),
    ] {
        let labels = format!("sensor=\"{sensor}\",stage=\"{stage}\"");
        for (quantile, ns) in quantiles(&last) {
            // What no frame has measured is not 0.
            let value = if last.n_frames == 0 { f64::NAN } else { seconds(ns) };
            line(&mut text, &format!("{name}{{{labels},quantile=\"{quantile}\"}}"), value);
        }
        line(&mut text, &format!("{name}_sum{{{labels}}}"), seconds(all.sum_ns));
        line(&mut text, &format!("{name}_count{{{labels}}}"), all.n_frames as f64);
    }
    text
}

fn quantiles(latency: &Latency) -> [(&'static str, u64); 5] {
    let Latency { p50_ns, p90_ns, p99_ns, p999_ns, max_ns, .. } = *latency;
    [("0.5", p50_ns), ("0.9", p90_ns), ("0.99", p99_ns), ("0.999", p999_ns), ("1", max_ns)]
}

fn seconds(ns: u64) -> f64 {
    ns as f64 / 1e9
}

/// A metric of one value for the sensor.
fn single(text: &mut String, sensor: &SensorName, name: &str, kind: &str, help: &str, value: f64) {
    metric(text, name, kind, help);
    line(text, &format!("{name}{{sensor=\"{sensor}\"}}"), value);
}

fn metric(text: &mut String, name: &str, kind: &str, help: &str) {
    writeln!(text, "# HELP {name} {help}\n# TYPE {name} {kind}").expect("a string takes any text");
}

fn line(text: &mut String, name: &str, value: f64) {
    writeln!(text, "{name} {value}").expect("a string takes any text");
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn metrics_are_lines_of_prometheus_text() {
        let mut health =
            HealthReport { n_frames: 7, flags: HealthReport::HAS_SHIM, ..HealthReport::default() };
        health.uptime_ns = 1_500_000_000;
        health.drift.novel = 0.125;
        let latency = Latency { n_frames: 2, sum_ns: 3000, p50_ns: 1000, ..Latency::default() };
        health.last_interval.sent_to_received = latency;
        health.since_start.sent_to_received = Latency { n_frames: 5, sum_ns: 9000, ..latency };
        let text = text(&"crunch/ring".parse().unwrap(), &health);
        for line in [
            "# HELP kinds_frames_total Frames that came.",
            "# TYPE kinds_frames_total counter",
            "kinds_frames_total{sensor=\"crunch/ring\"} 7",
            "kinds_uptime_seconds{sensor=\"crunch/ring\"} 1.5",
            "kinds_shim_present{sensor=\"crunch/ring\"} 1",
            "kinds_recent_novel_share{sensor=\"crunch/ring\"} 0.125",
            "kinds_usual_total_variation{sensor=\"crunch/ring\"} NaN",
            "kinds_latency_seconds{sensor=\"crunch/ring\",stage=\"sent_to_received\",quantile=\"0.5\"} 0.000001",
            "kinds_latency_seconds_sum{sensor=\"crunch/ring\",stage=\"sent_to_received\"} 0.000009",
            "kinds_latency_seconds_count{sensor=\"crunch/ring\",stage=\"sent_to_received\"} 5",
            "kinds_latency_seconds{sensor=\"crunch/ring\",stage=\"sent_to_reported\",quantile=\"0.5\"} NaN",
        ] {
            assert!(text.lines().any(|found| found == line), "no {line:?} in\n{text}");
        }
        let names: Vec<&str> = text.lines().filter_map(|line| line.strip_prefix("# TYPE ")).collect();
        assert_eq!(names.len(), 23);
    }
}
