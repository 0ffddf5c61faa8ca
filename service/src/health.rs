//! What a service counts about itself, and says once a second.
//!
//! The loop counts and records for every frame, and allocates nothing in it. Percentiles are worked out once a second,
//! between two frames.

use std::time::{Duration, Instant};

use hdrhistogram::Histogram;
use kinds_messages::{Drift, HealthReport, KindReport, Latency, ReportStatus, StageLatencies, monotonic_ns};

use crate::Summary;

/// How often health is said.
pub(crate) const HEALTH_PERIOD: Duration = Duration::from_secs(1);

/// Longest time that is told from longer ones.
const LATENCY_NS_MAX: u64 = 60_000_000_000;
/// Of a latency, by which histograms are as exact as documented: within 1 %.
const N_DIGITS: u8 = 2;

/// Counters and latencies of a service.
pub(crate) struct Health {
    started: Instant,
    /// Beginning of the interval that is not yet said.
    interval_started: Instant,
    /// What is said next, but for what [`Summary`] counts.
    report: HealthReport,
    sent_to_received: Stage,
    received_to_reported: Stage,
    sent_to_reported: Stage,
    /// Run, number and time of sending of the last frame.
    last_frame: Option<(u64, u64, u64)>,
}

/// Latencies of one stage of a frame's way.
struct Stage {
    last_interval: Histogram<u64>,
    last_interval_ns: u64,
    since_start: Histogram<u64>,
    since_start_ns: u64,
}

impl Health {
    pub(crate) fn new() -> Self {
        let now = Instant::now();
        Self {
            started: now,
            interval_started: now,
            report: HealthReport::default(),
            sent_to_received: Stage::new(),
            received_to_reported: Stage::new(),
            sent_to_reported: Stage::new(),
            last_frame: None,
        }
    }

    /// Takes note of a report that was sent. Allocates nothing.
    ///
    /// * `is_novel` — whether the model calls a frame of such a novelty unlike what it has seen
    pub(crate) fn count(&mut self, report: &KindReport, is_novel: bool) {
        let [sent, received, reported] =
            [report.sent_monotonic_ns, report.received_monotonic_ns, report.reported_monotonic_ns];
        self.sent_to_received.record(received.saturating_sub(sent));
        self.received_to_reported.record(reported.saturating_sub(received));
        self.sent_to_reported.record(reported.saturating_sub(sent));
        let this = (report.run, report.sequence, sent);
        let last = self.last_frame.replace(this);
        let health = &mut self.report;
        health.n_late += u64::from(last.is_some_and(|last| is_late(last, this, reported)));
        health.n_novel += u64::from(is_novel && report.status() == ReportStatus::Classified);
        health.flags |= HealthReport::HAS_LAST_FRAME;
        health.last_status = report.status;
        health.last_kind = report.number(report.kind);
        health.last_probability =
            report.probabilities().get(report.kind as usize).copied().unwrap_or_default();
        health.last_novelty = report.novelty;
    }

    pub(crate) fn count_reload(&mut self, is_taken: bool) {
        let health = &mut self.report;
        *(if is_taken { &mut health.n_reloads } else { &mut health.n_reloads_refused }) += 1;
    }

    pub(crate) fn count_lost_peers(&mut self, n_peers: u64) {
        self.report.n_peers_lost += n_peers;
    }

    /// Whether an interval is over.
    pub(crate) fn is_due(&self) -> bool {
        self.interval_started.elapsed() >= HEALTH_PERIOD
    }

    /// Ends the interval, and says how it was. Allocates nothing.
    pub(crate) fn end_interval(
        &mut self,
        summary: &Summary,
        model_id: [u8; 16],
        has_shim: bool,
        drift: Drift,
    ) -> &HealthReport {
        let now = Instant::now();
        let health = &mut self.report;
        health.sent_monotonic_ns = monotonic_ns();
        health.uptime_ns = now.duration_since(self.started).as_nanos() as u64;
        health.interval_ns = now.duration_since(self.interval_started).as_nanos() as u64;
        self.interval_started = now;
        health.flags &= !HealthReport::HAS_SHIM;
        health.flags |= if has_shim { HealthReport::HAS_SHIM } else { 0 };
        health.model_id = model_id;
        health.drift = drift;
        health.n_frames = summary.n_frames;
        health.n_classified = summary.n_classified;
        health.n_invalid = summary.n_invalid;
        health.n_lost = summary.n_lost;
        health.n_repeated = summary.n_repeated;
        health.n_refused = summary.n_refused;
        health.n_uncommanded = summary.n_uncommanded;
        let stages = [&mut self.sent_to_received, &mut self.received_to_reported, &mut self.sent_to_reported];
        let of = |[sent_to_received, received_to_reported, sent_to_reported]: [Latency; 3]| StageLatencies {
            sent_to_received,
            received_to_reported,
            sent_to_reported,
        };
        let latencies = stages.map(Stage::end_interval);
        health.last_interval = of(latencies.map(|[last_interval, _]| last_interval));
        health.since_start = of(latencies.map(|[_, since_start]| since_start));
        health
    }
}

/// Whether a frame was reported when the next was due already, if frames keep coming as this one came after the last.
///
/// Only of frames that follow each other in one run can that be said. By the clock of sending: the wall clock may be set.
fn is_late(last: (u64, u64, u64), this: (u64, u64, u64), reported_ns: u64) -> bool {
    let ((last_run, last_sequence, last_sent_ns), (run, sequence, sent_ns)) = (last, this);
    let follows = run == last_run && sequence.checked_sub(1) == Some(last_sequence);
    follows && reported_ns.saturating_sub(sent_ns) > sent_ns.saturating_sub(last_sent_ns)
}

impl Stage {
    fn new() -> Self {
        // Of fixed size: recording never allocates.
        let histogram =
            || Histogram::new_with_max(LATENCY_NS_MAX, N_DIGITS).expect("bounds are as they should be");
        Self { last_interval: histogram(), last_interval_ns: 0, since_start: histogram(), since_start_ns: 0 }
    }

    fn record(&mut self, ns: u64) {
        self.last_interval.saturating_record(ns);
        self.last_interval_ns = self.last_interval_ns.saturating_add(ns);
    }

    /// What was in the interval, and what was since the start. Begins another interval.
    fn end_interval(&mut self) -> [Latency; 2] {
        self.since_start.add(&self.last_interval).expect("both have the same bounds");
        self.since_start_ns = self.since_start_ns.saturating_add(self.last_interval_ns);
        let last_interval = latency(&self.last_interval, self.last_interval_ns);
        self.last_interval.reset();
        self.last_interval_ns = 0;
        [last_interval, latency(&self.since_start, self.since_start_ns)]
    }
}

fn latency(histogram: &Histogram<u64>, sum_ns: u64) -> Latency {
    let [p50_ns, p90_ns, p99_ns, p999_ns] =
        [0.5, 0.9, 0.99, 0.999].map(|quantile| histogram.value_at_quantile(quantile));
    Latency { n_frames: histogram.len(), sum_ns, p50_ns, p90_ns, p99_ns, p999_ns, max_ns: histogram.max() }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A report on a frame that was sent at a time, µs, received so much later, and reported again so much later.
    fn report(run: u64, sequence: u64, sent_us: u64, [received_us, reported_us]: [u64; 2]) -> KindReport {
        let mut report = KindReport::default();
        report.status = KindReport::CLASSIFIED;
        (report.run, report.sequence) = (run, sequence);
        report.sent_monotonic_ns = 1000 * sent_us;
        report.received_monotonic_ns = 1000 * (sent_us + received_us);
        report.reported_monotonic_ns = 1000 * (sent_us + received_us + reported_us);
        report
    }

    fn end_interval(health: &mut Health) -> HealthReport {
        *health.end_interval(&Summary::default(), [7; 16], true, Drift::default())
    }

    #[test]
    fn percentiles_are_those_of_the_sorted_latencies_to_a_hundredth() {
        let mut health = Health::new();
        // Squares, in an order that is not theirs.
        let us = |index: u64| (index * 7919 % 1000 + 1).pow(2);
        for index in 0..1000 {
            health.count(&report(1, index, 0, [us(index), 2 * us(index)]), false);
        }
        let said = end_interval(&mut health).last_interval;
        for (latency, factor) in
            [(said.sent_to_received, 1), (said.received_to_reported, 2), (said.sent_to_reported, 3)]
        {
            let ranks = [(latency.p50_ns, 500), (latency.p90_ns, 900), (latency.p99_ns, 990)];
            for (ns, rank) in ranks.into_iter().chain([(latency.p999_ns, 999), (latency.max_ns, 1000)]) {
                let expected = 1000 * factor * u64::pow(rank, 2);
                assert!(ns.abs_diff(expected) <= expected / 100, "rank {rank}: {ns} ns, not {expected} ns");
            }
            let sum_us: u64 = (1..=1000).map(|rank| factor * u64::pow(rank, 2)).sum();
            assert_eq!((latency.n_frames, latency.sum_ns), (1000, 1000 * sum_us));
        }
    }

    #[test]
    fn an_interval_forgets_and_the_whole_time_does_not() {
        let mut health = Health::new();
        health.count(&report(1, 0, 0, [10, 20]), false);
        let first = end_interval(&mut health);
        assert_eq!(first.last_interval, first.since_start);
        health.count(&report(1, 1, 1_000_000, [10, 20]), false);
        health.count(&report(1, 2, 2_000_000, [10, 20]), false);
        let second = end_interval(&mut health);
        let n_frames = |stages: StageLatencies| stages.sent_to_reported.n_frames;
        assert_eq!((n_frames(second.last_interval), n_frames(second.since_start)), (2, 3));
        let third = end_interval(&mut health);
        assert_eq!(third.last_interval, StageLatencies::default());
        assert_eq!(third.since_start, second.since_start);
        assert!(third.uptime_ns >= second.uptime_ns && second.interval_ns > 0);
    }

    #[test]
    fn a_latency_beyond_all_bounds_is_the_longest_there_is() {
        let mut health = Health::new();
        let mut report = report(1, 0, 0, [0, 0]);
        report.reported_monotonic_ns = u64::MAX;
        health.count(&report, false);
        let latency = end_interval(&mut health).since_start.sent_to_reported;
        assert!(latency.max_ns >= LATENCY_NS_MAX && latency.max_ns < 2 * LATENCY_NS_MAX, "{latency:?}");
        // From the future, which only a faulty writer is.
        report.sent_monotonic_ns = u64::MAX;
        report.reported_monotonic_ns = 0;
        health.count(&report, false);
        assert_eq!(end_interval(&mut health).last_interval.sent_to_reported.max_ns, 0);
    }

    #[test]
    fn a_report_is_late_when_the_next_frame_was_due() {
        let mut health = Health::new();
        let mut n_late = |run, sequence, sent_us, reported_us| {
            health.count(&report(run, sequence, sent_us, [0, reported_us]), false);
            end_interval(&mut health).n_late
        };
        assert_eq!(n_late(1, 0, 1000, 900_000), 0, "nothing to compare with");
        assert_eq!(n_late(1, 1, 2000, 1000), 0, "just in time");
        assert_eq!(n_late(1, 2, 3000, 1001), 1);
        assert_eq!(n_late(1, 5, 4000, 900_000), 1, "frames between them are lost: the period is not known");
        assert_eq!(n_late(2, 6, 5000, 900_000), 1, "another run");
        assert_eq!(n_late(2, 7, 6000, 1001), 2);
    }

    #[test]
    fn novel_are_classified_frames_that_the_model_calls_novel() {
        let mut health = Health::new();
        for (status, is_novel) in
            [(KindReport::CLASSIFIED, true), (KindReport::CLASSIFIED, false), (KindReport::INVALID, true)]
        {
            let mut report = report(1, 0, 0, [0, 0]);
            report.status = status;
            health.count(&report, is_novel);
        }
        assert_eq!(end_interval(&mut health).n_novel, 1);
    }

    #[test]
    fn what_is_said_of_the_last_frame_is_its_report() {
        let mut health = Health::new();
        assert_eq!(end_interval(&mut health).last_status(), None);
        let mut report = report(1, 0, 0, [10, 20]);
        report.kind = 1;
        report.novelty = 0.5;
        report.set_kinds([0, 6].into_iter(), [(0, 1)].into_iter());
        report.set_probabilities(&[0.25, 0.75], &[0.25, 0.75]);
        health.count(&report, false);
        let said = end_interval(&mut health);
        assert_eq!(said.last_status(), Some(ReportStatus::Classified));
        assert_eq!((said.last_kind, said.last_probability, said.last_novelty), (6, 0.75, 0.5));
        assert!(said.has_shim() && said.model_id == [7; 16]);
    }

    #[test]
    #[ignore = "prints a time"]
    #[allow(clippy::print_stdout, reason = "it is there to print")]
    fn what_counting_a_frame_costs() {
        let reports: Vec<KindReport> = (0..1000)
            .map(|index| report(1, index, 1000 * index, [index * 7 % 100, index * 13 % 400]))
            .collect();
        let mut health = Health::new();
        let mut rounds: Vec<[u128; 2]> = Vec::new();
        for _ in 0..101 {
            let start = Instant::now();
            reports.iter().for_each(|report| health.count(std::hint::black_box(report), false));
            let counted = start.elapsed();
            std::hint::black_box(end_interval(&mut health));
            rounds.push([counted.as_nanos() / 1000, (start.elapsed() - counted).as_nanos()]);
        }
        let median = |index: usize| {
            let mut times: Vec<u128> = rounds.iter().map(|round| round[index]).collect();
            times.sort_unstable();
            times[times.len() / 2]
        };
        println!("a frame {} ns, the end of a second {} ns", median(0), median(1));
    }
}
