//! `kinds top`: how all services of the domain fare, and who is connected.

use std::collections::{BTreeMap, BTreeSet};
use std::sync::atomic::Ordering;
use std::time::{Duration, Instant};

use kinds_messages::{
    Census, Domain, HealthReader, HealthReport, Life, Node, Program, Purpose, ReportStatus, SensorName,
};
use kinds_model::ModelId;
use serde_json::{Value, json};

use crate::cli::TopArguments;
use crate::failure::Failure;
use crate::say::say;
use crate::stop;

/// How long a service's health is waited for: it gives the last one to whoever comes, within 50 ms.
const PATIENCE: Duration = Duration::from_secs(2);

/// Between two looks for health.
const LOOK: Duration = Duration::from_millis(10);

/// Between two tables.
const PERIOD: Duration = Duration::from_secs(1);

pub(crate) fn run(arguments: &TopArguments) -> Result<(), Failure> {
    let stop = stop::on_signals()?;
    let domain = arguments.domain.domain();
    let node = Node::open(&domain, "kinds-top")?;
    while !stop.load(Ordering::Relaxed) {
        node.clean_up_dead_nodes();
        let sensors = look(&domain, &node)?;
        let lines = if arguments.json { vec![json_line(&sensors)] } else { table(&sensors) };
        for line in lines {
            say(line)?;
        }
        if arguments.once {
            break;
        }
        let start = Instant::now();
        while start.elapsed() < PERIOD && !stop.load(Ordering::Relaxed) {
            std::thread::sleep(LOOK);
        }
    }
    Ok(())
}

/// What was seen of a sensor.
struct Seen {
    sensor: SensorName,
    /// Who lives and has a channel of it open, this program left out.
    programs: Vec<Program>,
    /// Of its service, if there is one.
    health: Option<HealthReport>,
}

fn look(domain: &Domain, node: &Node) -> Result<Vec<Seen>, Failure> {
    let census = domain.census("kinds-top")?;
    let mut readers = BTreeMap::new();
    for channel in &census.channels {
        if channel.purpose == Purpose::Health && channel.publisher.is_some() {
            readers.insert(channel.sensor.clone(), HealthReader::open(node, &channel.sensor)?);
        }
    }
    let mut healths: BTreeMap<SensorName, HealthReport> = BTreeMap::new();
    let start = Instant::now();
    while healths.len() < readers.len() && start.elapsed() < PATIENCE {
        for (sensor, reader) in &readers {
            if let Some(health) = reader.receive()? {
                healths.insert(sensor.clone(), health);
            }
        }
        std::thread::sleep(LOOK);
    }
    let sensors: BTreeSet<&SensorName> = census.channels.iter().map(|channel| &channel.sensor).collect();
    Ok(sensors
        .into_iter()
        .map(|sensor| Seen {
            sensor: sensor.clone(),
            programs: connected(&census, sensor),
            health: healths.remove(sensor),
        })
        .collect())
}

/// Who lives and has a channel of a sensor open, by process, this program left out.
fn connected(census: &Census, sensor: &SensorName) -> Vec<Program> {
    let programs = census.channels_of(sensor).flat_map(|channel| &channel.programs);
    let others =
        programs.filter(|program| program.life == Life::Alive && program.pid != Some(std::process::id()));
    let mut others: Vec<Program> = others.cloned().collect();
    others.sort_by_key(|program| program.pid);
    others.dedup();
    others
}

fn table(sensors: &[Seen]) -> Vec<String> {
    let mut lines = vec![format!(
        "{:16} {:>7} {:>11} {:>9} {:>9} {:>6} {:>5} {:>8}",
        "sensor", "Hz", "kind", "p50 µs", "p99.9 µs", "lost", "late", "up s"
    )];
    for Seen { sensor, programs, health } in sensors {
        lines.push(match health {
            None => format!("{:16} not served", sensor.as_str()),
            Some(health) => {
                let kind = match health.last_status() {
                    None => "none yet".to_string(),
                    Some(ReportStatus::Invalid) => "invalid".to_string(),
                    Some(ReportStatus::Classified) => {
                        format!("{} {:3.0} %", health.last_kind, 100.0 * health.last_probability)
                    }
                };
                let latency = health.last_interval.sent_to_reported;
                let [p50, p999] = [latency.p50_ns, latency.p999_ns].map(|ns| ns as f64 / 1e3);
                format!(
                    "{:16} {:7.1} {kind:>11} {p50:9.1} {p999:9.1} {:6} {:5} {:8}",
                    sensor.as_str(),
                    health.rate_hz(),
                    health.n_lost,
                    health.n_late,
                    health.uptime_ns / 1_000_000_000
                )
            }
        });
        let names: Vec<_> = programs.iter().map(Program::to_string).collect();
        lines.push(format!("  connected: {}", names.join(", ")));
    }
    lines
}

fn json_line(sensors: &[Seen]) -> String {
    let sensors = sensors.iter().map(|Seen { sensor, programs, health }| {
        let programs = programs.iter().map(|program| json!({ "name": program.name, "pid": program.pid }));
        json!({
            "sensor": sensor.as_str(),
            "programs": programs.collect::<Vec<_>>(),
            "health": health.as_ref().map(health_json),
        })
    });
    json!({ "sensors": sensors.collect::<Vec<_>>() }).to_string()
}

fn health_json(health: &HealthReport) -> Value {
    let stages = [("last_interval", health.last_interval), ("since_start", health.since_start)];
    let mut latencies = serde_json::Map::new();
    for (name, stages) in stages {
        let latency = |latency: kinds_messages::Latency| {
            json!({
                "n_frames": latency.n_frames, "p50_ns": latency.p50_ns, "p90_ns": latency.p90_ns,
                "p99_ns": latency.p99_ns, "p999_ns": latency.p999_ns, "max_ns": latency.max_ns,
            })
        };
        let value = json!({
            "sent_to_received": latency(stages.sent_to_received),
            "received_to_reported": latency(stages.received_to_reported),
            "sent_to_reported": latency(stages.sent_to_reported),
        });
        latencies.insert(name.to_string(), value);
    }
    json!({
        "uptime_s": health.uptime_ns as f64 / 1e9,
        "model": ModelId(health.model_id).to_string(),
        "rate_hz": health.rate_hz(),
        "has_shim": health.has_shim(),
        "kind": health.last_status().map(|_| health.last_kind),
        "n_frames": health.n_frames,
        "n_classified": health.n_classified,
        "n_invalid": health.n_invalid,
        "n_novel": health.n_novel,
        "n_lost": health.n_lost,
        "n_repeated": health.n_repeated,
        "n_late": health.n_late,
        "n_refused": health.n_refused,
        "n_reloads": health.n_reloads,
        "n_reloads_refused": health.n_reloads_refused,
        "n_peers_lost": health.n_peers_lost,
        "latency": latencies,
    })
}
