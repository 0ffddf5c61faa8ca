//! `kinds watch`: the kinds of one sensor, a line each.

use std::io::{BufWriter, Write};
use std::sync::atomic::Ordering;
use std::time::Duration;

use kinds_messages::{KindReport, MAX_KINDS, Node, ReportReader, ReportStatus, SensorName};
use kinds_model::mixture::most_probable;
use serde::Serialize;

use crate::cli::WatchArguments;
use crate::failure::Failure;
use crate::kind_names::KindNames;
use crate::{log, stop};

pub(crate) fn run(arguments: &WatchArguments) -> Result<(), Failure> {
    let names = KindNames::read(arguments.model.as_deref())?;
    let stop = stop::on_signals()?;
    let mut reports =
        Reports::open(Node::open(&arguments.domain.domain(), "kinds-watch")?, &arguments.sensor)?;
    let mut out = BufWriter::new(std::io::stdout().lock());
    let mut n_left = arguments.count.unwrap_or(u64::MAX);
    while n_left > 0 && !stop.load(Ordering::Relaxed) {
        while n_left > 0
            && let Some(report) = reports.receive()?
        {
            let kinds = ShownKinds::of(&report, arguments.kinds, &names);
            let line = if arguments.json { json_line(&report, &kinds) } else { line_of(&report, &kinds) };
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

/// The kinds of a report as somebody wants to see them: those of the model, or groups of those that are most alike.
#[derive(Serialize)]
struct ShownKinds<'a> {
    kind: usize,
    probabilities: Vec<f64>,
    /// Given all frames of the run so far.
    filtered_kind: usize,
    filtered: Vec<f64>,
    /// Of the model's kinds in each.
    numbers: Vec<Vec<u32>>,
    /// What a person calls the most probable, if it is one kind and has a name.
    #[serde(skip_serializing_if = "Option::is_none")]
    name: Option<&'a str>,
}

impl<'a> ShownKinds<'a> {
    /// * `n_kinds` — how many to show; none for all
    fn of(report: &KindReport, n_kinds: Option<u32>, names: &'a KindNames) -> Self {
        let level = report.at_level(n_kinds.map_or(MAX_KINDS, |n_kinds| n_kinds as usize));
        let (probabilities, filtered) = (level.probabilities().to_vec(), level.filtered().to_vec());
        let mut numbers = vec![Vec::new(); probabilities.len()];
        for (&group, &number) in level.groups().iter().zip(report.numbers()) {
            numbers[usize::from(group)].push(number);
        }
        let [kind, filtered_kind] = match n_kinds {
            None => [report.kind, report.filtered_kind].map(|kind| kind as usize),
            Some(_) => [&probabilities, &filtered].map(|probabilities| most_probable(probabilities)),
        };
        let name = match numbers.get(kind).map(Vec::as_slice) {
            Some(&[number]) => names.name(report.model_id, number),
            _ => None,
        };
        Self { kind, probabilities, filtered_kind, filtered, numbers, name }
    }

    /// What the most probable is called by: its number, or its kinds' numbers.
    fn label(&self) -> String {
        let numbers = self.numbers.get(self.kind).into_iter().flatten();
        numbers.map(u32::to_string).collect::<Vec<_>>().join("+")
    }
}

/// What `watch --json` prints for a report.
#[derive(Serialize)]
struct ReportLine<'a> {
    sequence: u64,
    #[serde(flatten)]
    kinds: &'a ShownKinds<'a>,
    /// Null for an invalid frame.
    log_likelihood: f64,
    status: &'static str,
    latency_ns: u64,
}

fn json_line(report: &KindReport, kinds: &ShownKinds) -> String {
    let line = ReportLine {
        sequence: report.sequence,
        kinds,
        log_likelihood: report.log_likelihood,
        status: report.status().name(),
        latency_ns: latency_ns(report),
    };
    serde_json::to_string(&line).expect("a report is plain data")
}

pub(crate) fn text_line(report: &KindReport) -> String {
    line_of(report, &ShownKinds::of(report, None, &KindNames::default()))
}

fn line_of(report: &KindReport, kinds: &ShownKinds) -> String {
    let latency_us = latency_ns(report) as f64 / 1e3;
    let sequence = report.sequence;
    match report.status() {
        ReportStatus::Classified => {
            let percent = 100.0 * kinds.probabilities.get(kinds.kind).copied().unwrap_or(f64::NAN);
            let (label, bars, novelty) = (kinds.label(), bars(&kinds.probabilities), report.novelty);
            let name = kinds.name.map_or(String::new(), |name| format!("  {name}"));
            format!(
                "frame {sequence:6}  kind {label:>2}  {percent:3.0} %  {bars}  novelty {novelty:.2}  {latency_us:7.1} µs{name}"
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
        classified.set_kinds([0, 4].into_iter(), [(0, 1)].into_iter());
        classified.set_probabilities(&[0.25, 0.75], &[0.625, 0.375]);
        let names = KindNames::default();
        let json = |report: &KindReport, n_kinds| json_line(report, &ShownKinds::of(report, n_kinds, &names));
        assert_eq!(
            json(&classified, None),
            r#"{"sequence":7,"kind":1,"probabilities":[0.25,0.75],"filtered_kind":0,"filtered":[0.625,0.375],"numbers":[[0],[4]],"log_likelihood":-12.5,"status":"classified","latency_ns":3500}"#
        );
        assert_eq!(text_line(&classified), "frame      7  kind  4   75 %  ▂▆  novelty 0.00      3.5 µs");
        // Both taken together.
        assert_eq!(
            json(&classified, Some(1)),
            r#"{"sequence":7,"kind":0,"probabilities":[1.0],"filtered_kind":0,"filtered":[1.0],"numbers":[[0,4]],"log_likelihood":-12.5,"status":"classified","latency_ns":3500}"#
        );
        let together = line_of(&classified, &ShownKinds::of(&classified, Some(1), &names));
        assert_eq!(together, "frame      7  kind 0+4  100 %  █  novelty 0.00      3.5 µs");
        let invalid = json(&report(1, 8, 0), None);
        assert!(invalid.contains(r#""log_likelihood":null,"status":"invalid""#), "{invalid}");
    }
}
