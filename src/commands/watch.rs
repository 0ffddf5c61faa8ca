//! `kinds watch`: the kinds of one sensor, a line each.

use std::io::{BufWriter, Write};
use std::sync::atomic::Ordering;
use std::time::Duration;

use kinds_messages::{KindReport, Node, ReportReader, ReportStatus, SensorName};
use serde::Serialize;

use crate::cli::WatchArguments;
use crate::failure::Failure;
use crate::{log, stop};

pub(crate) fn run(arguments: &WatchArguments) -> Result<(), Failure> {
    let stop = stop::on_signals()?;
    let mut reports =
        Reports::open(Node::open(&arguments.domain.domain(), "kinds-watch")?, &arguments.sensor)?;
    let mut out = BufWriter::new(std::io::stdout().lock());
    let mut n_left = arguments.count.unwrap_or(u64::MAX);
    while n_left > 0 && !stop.load(Ordering::Relaxed) {
        while n_left > 0
            && let Some(report) = reports.receive()?
        {
            let line = if arguments.json { json_line(&report) } else { text_line(&report) };
            writeln!(out, "{line}")?;
            n_left -= 1;
        }
        out.flush()?;
        if n_left > 0 {
            reports.wait()?;
        }
    }
    Ok(())
}

/// Longest time between two looks at the stop flag and at whether a service is there.
const TICK: Duration = Duration::from_millis(50);

/// How often what killed programs left is looked for, in ticks.
const CLEAN_UP_TICKS: u32 = 40;

/// The reports of a sensor, for a person: says on standard error what it waits for, and what was lost.
pub(crate) struct Reports {
    node: Node,
    sensor: SensorName,
    reader: ReportReader,
    /// Whether a service was there when last looked; unknown at first.
    service_is_there: Option<bool>,
    last: Option<KindReport>,
    n_ticks: u32,
}

impl Reports {
    pub(crate) fn open(node: Node, sensor: &SensorName) -> Result<Self, Failure> {
        let reader = ReportReader::open(&node, sensor)?;
        Ok(Self { node, sensor: sensor.clone(), reader, service_is_there: None, last: None, n_ticks: 0 })
    }

    /// The next report, if one is there.
    pub(crate) fn receive(&mut self) -> Result<Option<KindReport>, Failure> {
        let Some(report) = self.reader.receive()? else { return Ok(None) };
        let n_missed = self.last.replace(report).map_or(0, |last| report.n_missed_since(&last));
        if n_missed > 0 {
            log::notice(format!(
                "{n_missed} reports lost: they came faster than this program could take them"
            ));
        }
        Ok(Some(report))
    }

    /// Waits for more.
    pub(crate) fn wait(&mut self) -> Result<(), Failure> {
        let is_there = self.reader.service().is_some();
        let was_there = self.service_is_there.replace(is_there);
        let sensor = &self.sensor;
        match (was_there, is_there) {
            (None, false) => log::notice(format!(
                "waiting for a service for {sensor} (kinds serve --sensor {sensor} --model …)"
            )),
            (Some(true), false) => {
                log::notice(format!("the service for {sensor} is gone; waiting for another"));
            }
            (Some(false), true) => log::notice(format!("a service for {sensor} is there")),
            _ => {}
        }
        self.reader.wait(TICK)?;
        self.n_ticks = (self.n_ticks + 1) % CLEAN_UP_TICKS;
        if self.n_ticks == 0 {
            // A service that was killed counts as there until somebody has cleaned up after it.
            self.node.clean_up_dead_nodes();
        }
        Ok(())
    }
}

/// What `watch --json` prints for a report.
#[derive(Serialize)]
struct ReportLine<'a> {
    sequence: u64,
    kind: u32,
    probabilities: &'a [f64],
    /// Given all frames of the run so far.
    filtered_kind: u32,
    filtered: &'a [f64],
    /// Null for an invalid frame.
    log_likelihood: f64,
    status: &'static str,
    latency_ns: u64,
}

fn json_line(report: &KindReport) -> String {
    let line = ReportLine {
        sequence: report.sequence,
        kind: report.kind,
        probabilities: report.probabilities(),
        filtered_kind: report.filtered_kind,
        filtered: report.filtered(),
        log_likelihood: report.log_likelihood,
        status: report.status().name(),
        latency_ns: latency_ns(report),
    };
    serde_json::to_string(&line).expect("a report is plain data")
}

pub(crate) fn text_line(report: &KindReport) -> String {
    let latency_us = latency_ns(report) as f64 / 1e3;
    let sequence = report.sequence;
    match report.status() {
        ReportStatus::Classified => {
            let probability = report.probabilities().get(report.kind as usize).copied().unwrap_or(f64::NAN);
            let kind = report.kind;
            let bars = bars(report.probabilities());
            let novelty = report.novelty;
            format!(
                "frame {sequence:6}  kind {kind:2}  {:3.0} %  {bars}  novelty {novelty:.2}  {latency_us:7.1} µs",
                100.0 * probability
            )
        }
        ReportStatus::Invalid => format!("frame {sequence:6}  no valid reading{latency_us:26.1} µs"),
    }
}

/// From the shim's sending the frame to the service's sending the report.
pub(crate) fn latency_ns(report: &KindReport) -> u64 {
    report.reported_monotonic_ns.saturating_sub(report.sent_monotonic_ns)
}

/// A small bar for each kind.
pub(crate) fn bars(probabilities: &[f64]) -> String {
    const HEIGHTS: [char; 9] = ['·', '▁', '▂', '▃', '▄', '▅', '▆', '▇', '█'];
    probabilities
        .iter()
        .map(|probability| HEIGHTS[(8.0 * probability.clamp(0.0, 1.0)).round() as usize])
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn report(run: u64, sequence: u64, n_lost: u64) -> KindReport {
        let mut report = KindReport::default();
        (report.run, report.sequence, report.n_lost) = (run, sequence, n_lost);
        report
    }

    #[test]
    fn a_report_is_one_json_line_with_the_fields_that_scripts_rely_on() {
        let mut classified = report(1, 7, 0);
        classified.status = KindReport::CLASSIFIED;
        classified.kind = 1;
        classified.log_likelihood = -12.5;
        classified.sent_monotonic_ns = 1000;
        classified.reported_monotonic_ns = 4500;
        classified.filtered_kind = 0;
        classified.set_probabilities(&[0.25, 0.75], &[0.625, 0.375]);
        assert_eq!(
            json_line(&classified),
            r#"{"sequence":7,"kind":1,"probabilities":[0.25,0.75],"filtered_kind":0,"filtered":[0.625,0.375],"log_likelihood":-12.5,"status":"classified","latency_ns":3500}"#
        );
        assert_eq!(text_line(&classified), "frame      7  kind  1   75 %  ▂▆  novelty 0.00      3.5 µs");
        let invalid = json_line(&report(1, 8, 0));
        assert!(invalid.contains(r#""log_likelihood":null,"status":"invalid""#), "{invalid}");
    }
}
