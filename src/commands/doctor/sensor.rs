//! One sensor: who publishes, serves and reads, how its channels are laid out, and what arrives on them.

use std::time::Duration;

use kinds_messages::{Census, Domain, FoundChannel, FrameHeader, KindReport, Life, Purpose, SensorName};
use kinds_model::Model;

use crate::commands::BRIDGE;

use super::arrivals::{Arrivals, look};
use super::finding::{Finding, listed, well, wrong};
use super::{clock, model};

pub(super) fn examine(
    domain: &Domain,
    census: &Census,
    sensor: &SensorName,
    model: Option<&Model>,
    wait_s: f64,
) -> Vec<Finding> {
    let (frames, kinds) = (census.channel(sensor, Purpose::Frames), census.channel(sensor, Purpose::Kinds));
    let mut findings = Vec::new();
    if frames.is_none() && kinds.is_none() {
        findings.push(nobody(census, sensor));
        return findings;
    }
    for channel in census.channels_of(sensor) {
        findings.extend(on_layout(channel));
        findings.extend(on_places(channel));
    }
    findings.push(bridged(sensor, kinds).unwrap_or_else(|| on_publisher(sensor, frames)));
    findings.push(on_service(sensor, kinds));
    // A replay may wait for its first reader, and must not take this program for one.
    let flows = frames.filter(|channel| is_live(channel) && !channel.readers.is_empty());
    let serves = kinds.filter(|channel| is_live(channel));
    let n_readings = frames.and_then(|channel| channel.publisher.as_ref()?.n_readings);
    if let (None, Some(n_readings), Some(model)) = (flows, n_readings, model) {
        findings.extend(model::on_n_readings(model, n_readings));
    }
    if flows.is_none() && serves.is_none() {
        return findings;
    }
    let wait = Duration::from_secs_f64(wait_s);
    // Reports come of frames alone.
    match look(domain, sensor, [flows.is_some(), flows.is_some() && serves.is_some()], wait) {
        Ok(arrivals) => findings.extend(on_arrivals(sensor, &arrivals, flows, serves, model, wait_s)),
        Err(error) => findings.push(wrong("arrivals", error.to_string(), "see above")),
    }
    findings
}

/// Nobody knows this sensor.
fn nobody(census: &Census, sensor: &SensorName) -> Finding {
    let mut others: Vec<&str> = census.channels.iter().map(|channel| channel.sensor.as_str()).collect();
    others.dedup();
    let others = match others.is_empty() {
        true => "nor of any other sensor".to_owned(),
        false => format!("there are channels of {}", others.join(", ")),
    };
    wrong(
        "channels",
        format!("there is no channel of {sensor}; {others}"),
        format!(
            "start its driver shim (kinds publish --sensor {sensor} …) and its service (kinds serve --sensor {sensor} …) in \
             this domain, or ask for the right name"
        ),
    )
}

/// A channel of another layout, field by field.
fn on_layout(channel: &FoundChannel) -> Option<Finding> {
    if channel.differences.is_empty() {
        return None;
    }
    let fields: Vec<String> = channel
        .differences
        .iter()
        .map(|difference| {
            format!("{}: {} instead of {}", difference.field, difference.found, difference.expected)
        })
        .collect();
    Some(wrong(
        "layout",
        format!("{} is laid out otherwise than in this program: {}", channel.name(), fields.join("; ")),
        format!(
            "stop whoever has it open ({}), and start all programs in the same version",
            listed(&channel.programs)
        ),
    ))
}

/// A channel that has no room for one more reader.
fn on_places(channel: &FoundChannel) -> Option<Finding> {
    let limit = channel.purpose.max_readers();
    (channel.readers.len() >= limit).then(|| {
        wrong(
            "channels",
            format!(
                "all {limit} places for readers of {} are taken, by {}",
                channel.name(),
                listed(&channel.readers)
            ),
            "stop one of them before another is started",
        )
    })
}

fn is_live(channel: &FoundChannel) -> bool {
    channel.publisher.as_ref().is_some_and(|publisher| publisher.program.life == Life::Alive)
}

/// Where the sensor is another machine's: its frames stay there.
fn bridged(sensor: &SensorName, kinds: Option<&FoundChannel>) -> Option<Finding> {
    let publisher = kinds.filter(|channel| is_live(channel))?.publisher.as_ref()?;
    (publisher.program.name.as_deref() == Some(BRIDGE)).then(|| {
        well(
            "frames",
            format!("those of {sensor} stay on the machine that {} has its kinds from", publisher.program),
        )
    })
}

fn on_publisher(sensor: &SensorName, frames: Option<&FoundChannel>) -> Finding {
    let cure = format!("start its driver shim: kinds publish --sensor {sensor} …");
    match frames.and_then(|channel| Some((channel, channel.publisher.as_ref()?))) {
        None => wrong("frames", format!("nobody publishes {sensor}"), cure),
        Some((_, publisher)) if publisher.program.life != Life::Alive => {
            wrong("frames", format!("{}, which published {sensor}, was killed", publisher.program), cure)
        }
        Some((channel, publisher)) => well(
            "frames",
            format!(
                "{sensor} is published by {}, up to {} readings a frame; read by {}",
                publisher.program,
                publisher.n_readings.unwrap_or_default(),
                listed(&channel.readers)
            ),
        ),
    }
}

fn on_service(sensor: &SensorName, kinds: Option<&FoundChannel>) -> Finding {
    let cure = format!("start its service: kinds serve --sensor {sensor} --model …");
    match kinds.and_then(|channel| Some((channel, channel.publisher.as_ref()?))) {
        None => wrong("kinds", format!("nobody serves {sensor}"), cure),
        Some((_, publisher)) if publisher.program.life != Life::Alive => {
            wrong("kinds", format!("{}, which served {sensor}, was killed", publisher.program), cure)
        }
        Some((channel, publisher)) => well(
            "kinds",
            format!("{sensor} is served by {}; read by {}", publisher.program, listed(&channel.readers)),
        ),
    }
}

fn on_arrivals(
    sensor: &SensorName,
    arrivals: &Arrivals,
    frames: Option<&FoundChannel>,
    kinds: Option<&FoundChannel>,
    model: Option<&Model>,
    wait_s: f64,
) -> Vec<Finding> {
    let mut findings = Vec::new();
    let Some(last) = arrivals.frames.last() else {
        if frames.is_some() {
            findings.push(wrong(
                "arrivals",
                format!("no frame of {sensor} came in {wait_s} s, though its driver shim is there"),
                "look at the sensor and at what its driver shim says; a sensor that is slower takes a longer --wait-s",
            ));
        }
        return findings;
    };
    let header = &last.header;
    let &FrameHeader { version, rows, columns, .. } = header;
    if version != FrameHeader::VERSION {
        findings.push(wrong(
            "layout",
            format!("frames have layout version {version}, and this program reads {}", FrameHeader::VERSION),
            "start all programs in the same version",
        ));
        return findings;
    }
    if u64::from(rows) * u64::from(columns) != last.n_readings as u64 {
        findings.push(wrong(
            "layout",
            format!("frames have {} readings but say {rows} × {columns}", last.n_readings),
            "mend their driver shim",
        ));
    }
    match arrivals.frames.iter().any(|frame| frame.has_valid) {
        true => findings
            .push(well("arrivals", format!("frames of {sensor} come, up to number {}", header.sequence))),
        false => findings.push(wrong(
            "arrivals",
            format!("frames of {sensor} come, and no reading of the last {} is valid", arrivals.frames.len()),
            "look at the sensor: cover, cable, power, driver",
        )),
    }
    findings.extend(clock::on_frame(header, last.received_monotonic_ns));
    findings.extend(model.into_iter().flat_map(|model| model::on_frame(model, header)));
    match (arrivals.reports.last(), kinds) {
        (Some(report), _) => {
            findings.push(well("arrivals", format!("kinds of {sensor} come: {}", said(report))));
            findings.extend(model.and_then(|model| model::on_report(model, report)));
        }
        (None, Some(_)) => findings.push(wrong(
            "arrivals",
            format!("frames of {sensor} come, and its service reports on none of them"),
            "see what the service says; --model compares its model with the frames",
        )),
        (None, None) => {}
    }
    findings
}

fn said(report: &KindReport) -> String {
    format!(
        "frame {} is {}, kind {}, novelty {:.2}",
        report.sequence,
        report.status().name(),
        report.kind,
        report.novelty
    )
}
