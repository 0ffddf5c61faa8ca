//! What `kinds top --json` prints.

use std::time::Instant;

use kinds_messages::{Drift, HealthReport, Latency, Program, StageLatencies};
use kinds_model::ModelId;
use serde_json::{Value, json};

use crate::commands::top::drift;
use crate::commands::top::observer::{LastFrame, Observer, Seen, Service};
use crate::commands::top::passed_on::PassedOn;
use crate::commands::top::table::name_of;
use crate::kind_names::KindNames;

/// All that is seen, on one line.
pub(crate) fn line(observer: &Observer) -> String {
    let sensors =
        observer.sensors.iter().map(|(sensor, seen)| sensor_json(sensor.as_str(), seen, &observer.names));
    json!({ "sensors": sensors.collect::<Vec<_>>() }).to_string()
}

fn sensor_json(sensor: &str, seen: &Seen, names: &KindNames) -> Value {
    let program = |program: &Program| json!({ "name": program.name, "pid": program.pid });
    let programs: Vec<_> = seen.programs.iter().map(program).collect();
    let (health, age_s) = match seen.service() {
        Service::Heard { said, age } => (Some(health_json(&said.health, names)), Some(age.as_secs_f64())),
        _ => (None, None),
    };
    let elsewhere = match seen.service() {
        Service::Elsewhere(passed_on) => Some(elsewhere_json(passed_on, names)),
        _ => None,
    };
    json!({
        "sensor": sensor,
        "programs": programs,
        "health": health,
        "health_age_s": age_s,
        "elsewhere": elsewhere,
    })
}

/// What is known of a service on another machine.
fn elsewhere_json(passed_on: &PassedOn, names: &KindNames) -> Value {
    let now = Instant::now();
    let last = passed_on.last().map(LastFrame::of_report);
    json!({
        "rate_hz": passed_on.rate_hz(now),
        "silence_s": passed_on.silence(now).as_secs_f64(),
        "sequence": passed_on.last().map(|report| report.sequence),
        "model": last.as_ref().map(|last| ModelId(last.model_id).to_string()),
        "kind": last.as_ref().map(|last| last.kind),
        "kind_name": last.as_ref().and_then(|last| name_of(last, names)),
        "probability": last.as_ref().map(|last| last.probability),
        "novelty": last.as_ref().map(|last| last.novelty),
    })
}

fn health_json(health: &HealthReport, names: &KindNames) -> Value {
    let last = LastFrame::of_health(health);
    json!({
        "uptime_s": health.uptime_ns as f64 / 1e9,
        "model": ModelId(health.model_id).to_string(),
        "rate_hz": health.rate_hz(),
        "has_shim": health.has_shim(),
        "kind": last.as_ref().map(|last| last.kind),
        "kind_name": last.as_ref().and_then(|last| name_of(last, names)),
        "probability": last.as_ref().map(|last| last.probability),
        "novelty": last.as_ref().map(|last| last.novelty),
        "n_frames": health.n_frames,
        "n_classified": health.n_classified,
        "n_invalid": health.n_invalid,
        "n_novel": health.n_novel,
        "n_lost": health.n_lost,
        "n_repeated": health.n_repeated,
        "n_late": health.n_late,
        "n_refused": health.n_refused,
        "n_uncommanded": health.n_uncommanded,
        "n_reloads": health.n_reloads,
        "n_reloads_refused": health.n_reloads_refused,
        "n_peers_lost": health.n_peers_lost,
        "drift": drift_json(&health.drift),
        "latency": {
            "last_interval": stages_json(&health.last_interval),
            "since_start": stages_json(&health.since_start),
        },
    })
}

/// What is not known yet is null.
fn drift_json(drift: &Drift) -> Value {
    json!({
        "n_frames": drift.n_frames,
        "novel": drift.novel,
        "novel_usual": drift.novel_usual,
        "total_variation": drift.total_variation,
        "total_variation_usual": drift.total_variation_usual,
        "half_split": drift.half_split,
        "half_split_usual": drift.half_split_usual,
        "is_unusual": drift::sentence(drift).is_some(),
    })
}

fn stages_json(stages: &StageLatencies) -> Value {
    json!({
        "sent_to_received": latency_json(&stages.sent_to_received),
        "received_to_reported": latency_json(&stages.received_to_reported),
        "sent_to_reported": latency_json(&stages.sent_to_reported),
    })
}

fn latency_json(latency: &Latency) -> Value {
    json!({
        "n_frames": latency.n_frames, "p50_ns": latency.p50_ns, "p90_ns": latency.p90_ns,
        "p99_ns": latency.p99_ns, "p999_ns": latency.p999_ns, "max_ns": latency.max_ns,
    })
}
