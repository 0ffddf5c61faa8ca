//! The second trip as on a robot: a service and a shim in processes of their own, and this one as the consumer.

use std::path::Path;
use std::sync::atomic::{AtomicBool, Ordering};

use kinds_messages::{KindReport, Node};

use crate::commands::demo::live::{Course, LiveView};
use crate::commands::demo::processes::Process;
use crate::commands::demo::subject::Subject;
use crate::commands::{own_domain, watch};
use crate::csv;
use crate::failure::Failure;

/// Runs service and shim as processes in a domain of their own, and returns every report on the trip.
pub(crate) fn serve_and_watch(
    model: &Path,
    course: &Course,
    speed: &str,
    subject: &Subject,
    stop: &AtomicBool,
) -> Result<Vec<KindReport>, Failure> {
    // Declared first, so that it goes last.
    let domain = own_domain()?;
    let serve = ["--model".as_ref(), model.as_os_str()];
    let mut service = Process::start(&domain, &subject.sensor, "serve", &serve)?;
    service.await_line()?;
    // Only now: a demo that is killed cannot clear its place in the domain, and the service can.
    let mut watched = watch::Reports::open(Node::open(&domain, "kinds-demo")?, &subject.sensor)?;
    let trip = &subject.trips[1];
    let mut live = LiveView::of(course);
    let publish =
        ["--trip".as_ref(), trip.as_os_str(), "--speed".as_ref(), speed.as_ref(), "--follow".as_ref()];
    let mut shim = Process::start(&domain, &subject.sensor, "publish", &publish)?;
    let reports = watch_until_end(&mut watched, &mut shim, &mut live, stop)?;
    live.end(&reports)?;
    shim.end_well()?;
    // Whoever may have ended it, it ended well: only what was reported tells whether the trip was over. Nor would our own flag,
    // which a signal sets in whichever thread the system hands it to, perhaps later than we look.
    let (n_reported, n_frames) = (reports.last().map_or(0, |last| last.sequence + 1), course.n_frames());
    if n_reported < n_frames {
        return Err(Failure::CouldNot(format!(
            "kinds publish was ended by somebody after {n_reported} of {n_frames} frames; the model is learnt, its results are \
             not there"
        )));
    }
    service.terminate();
    service.end_well()?;
    Ok(reports)
}

/// Collects reports until the shim has ended and none is left. The shim ends only when its frames have been reported.
fn watch_until_end(
    watched: &mut watch::Reports,
    shim: &mut Process,
    live: &mut LiveView,
    stop: &AtomicBool,
) -> Result<Vec<KindReport>, Failure> {
    let mut reports = Vec::new();
    loop {
        let has_ended = shim.has_ended()?;
        while let Some(report) = watched.receive()? {
            reports.push(report);
        }
        live.show(&reports)?;
        // Asked first: Ctrl-C in a terminal goes to all three processes, and the shim's early end is a good one to it.
        if stop.load(Ordering::Relaxed) {
            return Err(Failure::CouldNot(
                "stopped before the trip was over; the model is learnt, its results are not there"
                    .to_string(),
            ));
        }
        if has_ended {
            return Ok(reports);
        }
        watched.wait()?;
    }
}

/// What came, for a person.
pub(crate) fn statistics(reports: &[KindReport]) -> String {
    let Some(last) = reports.last() else { return "no report came".to_string() };
    let mut latencies: Vec<u64> = reports.iter().map(watch::latency_ns).collect();
    latencies.sort_unstable();
    let n_reports = reports.len();
    let n_switches = reports.windows(2).filter(|pair| pair[0].filtered_kind != pair[1].filtered_kind).count();
    format!(
        "{} frames, {n_reports} reports; the kind changed {n_switches} times; frame to report: median {:.0} µs, 99 % within {:.0} µs",
        last.sequence + 1,
        latencies[n_reports / 2] as f64 / 1e3,
        latencies[n_reports * 99 / 100] as f64 / 1e3
    )
}

/// A line of CSV for each report.
pub(crate) fn table(reports: &[KindReport]) -> Vec<u8> {
    let n_kinds = reports.first().map_or(0, |report| report.probabilities().len());
    let mut text = format!(
        "sequence,captured_ns,kind,filtered_kind,novelty,latency_ns{}\n",
        csv::probability_titles('p', n_kinds)
    );
    for report in reports {
        let (latency_ns, novelty) = (watch::latency_ns(report), csv::number(report.novelty));
        let probabilities = csv::probabilities(report.probabilities());
        text += &format!(
            "{},{},{},{},{novelty},{latency_ns}{probabilities}\n",
            report.sequence, report.captured_ns, report.kind, report.filtered_kind
        );
    }
    text.into_bytes()
}
