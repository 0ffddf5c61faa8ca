//! What is seen in words and numbers: a row for each sensor, and all about one.

use std::time::{Duration, Instant};

use kinds_messages::{HealthReport, Latency, Program, ReportStatus, SensorName};
use kinds_model::ModelId;

use crate::commands::top::drift;
use crate::commands::top::observer::{LastFrame, Observer, SILENCE, Said, Seen, Service};
use crate::commands::top::passed_on::PassedOn;
use crate::kind_names::KindNames;

/// Least width of the names of sensors: the rows are 79 columns wide then.
const NAME_WIDTH: usize = 17;

/// What stands for a number that stays on the service's machine.
const UNKNOWN: &str = "–";

/// Columns of the bar that shows the probability of the kind of the last frame.
const BAR_WIDTH: usize = 8;

/// All that is seen, for where lines scroll.
pub(crate) fn text(observer: &Observer) -> Vec<String> {
    if observer.sensors.is_empty() {
        return vec![nobody(observer)];
    }
    let width = name_width(observer);
    let mut lines = vec![heading(width)];
    for (sensor, seen) in &observer.sensors {
        lines.push(row(sensor, seen, width));
        lines.extend(named(seen, &observer.names).map(|named| format!("  {named}")));
        lines.extend(whereabouts(seen).map(|whereabouts| format!("  {whereabouts}")));
        lines.extend(remark(seen).map(|remark| format!("  {remark}")));
        lines.push(format!("  {}", connections(&seen.programs)));
    }
    lines
}

/// What to do where there is nothing to see.
pub(crate) fn nobody(observer: &Observer) -> String {
    format!(
        "no sensor in domain {}: start kinds publish or kinds serve, or look elsewhere with --domain",
        observer.domain.root.display()
    )
}

/// Columns for names that none is cut off.
pub(crate) fn name_width(observer: &Observer) -> usize {
    let widths = observer.sensors.keys().map(|sensor| sensor.as_str().len());
    widths.fold(NAME_WIDTH, usize::max)
}

pub(crate) fn heading(width: usize) -> String {
    format!(
        "{:width$} {:>7} {:>17} {:>9} {:>9} {:>7} {:>7}",
        "sensor", "Hz", "kind now", "p50 µs", "p99.9 µs", "lost", "late"
    )
}

/// A sensor in one line.
pub(crate) fn row(sensor: &SensorName, seen: &Seen, width: usize) -> String {
    let rest = match seen.service() {
        Service::None => " not served".to_string(),
        Service::Unreadable(_) => " served, but how it fares cannot be read".to_string(),
        Service::Mute => " served; nothing heard yet".to_string(),
        Service::Heard { age, .. } if age >= SILENCE => format!(" silent for {}", span(age)),
        Service::Heard { said, .. } => numbers(&said.health),
        Service::Elsewhere(passed_on) => numbers_elsewhere(passed_on, Instant::now()),
    };
    format!("{:width$} {rest}", sensor.as_str())
}

fn numbers(health: &HealthReport) -> String {
    let latency = &health.last_interval.sent_to_reported;
    let [p50, p999] = [latency.p50_ns, latency.p999_ns].map(micros);
    let (rate_hz, kind) = (health.rate_hz(), kind_now(LastFrame::of_health(health)));
    format!("{rate_hz:7.1} {kind:>17} {p50:>9} {p999:>9} {:7} {:7}", health.n_lost, health.n_late)
}

/// What is known of them without health.
fn numbers_elsewhere(passed_on: &PassedOn, now: Instant) -> String {
    let kind = kind_now(passed_on.last().map(LastFrame::of_report));
    let rate_hz = passed_on.rate_hz(now).map_or(UNKNOWN.to_string(), |rate_hz| format!("{rate_hz:.1}"));
    format!("{rate_hz:>7} {kind:>17} {UNKNOWN:>9} {UNKNOWN:>9} {UNKNOWN:>7} {UNKNOWN:>7}")
}

/// The kind of the last frame, and how probable it is.
fn kind_now(last: Option<LastFrame>) -> String {
    match last {
        None => "no frame yet".to_string(),
        Some(LastFrame { status: ReportStatus::Invalid, .. }) => "invalid".to_string(),
        Some(LastFrame { status: ReportStatus::Classified, kind, probability, .. }) => {
            let share = probability.clamp(0.0, 1.0);
            let n_full = (share * BAR_WIDTH as f64).round() as usize;
            let bar = "█".repeat(n_full) + &"·".repeat(BAR_WIDTH - n_full);
            format!("{kind:2} {bar} {:3.0} %", 100.0 * share)
        }
    }
}

/// What a person calls the kind of the last frame, if anything.
pub(crate) fn named(seen: &Seen, names: &KindNames) -> Option<String> {
    let last = seen.service().last_frame()?;
    name_of(&last, names).map(|name| format!("kind {} is {name}", last.kind))
}

/// The name of a frame's kind.
pub(crate) fn name_of<'a>(frame: &LastFrame, names: &'a KindNames) -> Option<&'a str> {
    match frame.status {
        ReportStatus::Classified => names.name(frame.model_id, frame.kind),
        ReportStatus::Invalid => None,
    }
}

/// Where the service is, if not here.
pub(crate) fn whereabouts(seen: &Seen) -> Option<String> {
    match seen.service() {
        Service::Elsewhere(_) => Some(
            "served on another machine: a bridge passes on its kinds; its health stays there".to_string(),
        ),
        _ => None,
    }
}

/// What somebody should see to, if there is anything.
pub(crate) fn remark(seen: &Seen) -> Option<String> {
    match seen.service() {
        Service::Heard { age, .. } if age >= SILENCE => {
            Some(format!("the service has said nothing for {}: it stands still", span(age)))
        }
        Service::Heard { said, .. } if !said.health.has_shim() => {
            Some("no driver shim publishes this sensor".to_string())
        }
        Service::Heard { said, .. } => drift::sentence(&said.health.drift),
        Service::Elsewhere(passed_on) => silence(passed_on, Instant::now()),
        Service::Unreadable(why) => Some(why.to_string()),
        Service::None | Service::Mute => None,
    }
}

fn silence(passed_on: &PassedOn, now: Instant) -> Option<String> {
    let silence = passed_on.silence(now);
    (silence >= SILENCE)
        .then(|| format!("no report has come for {}: look at the link, and at the robot", span(silence)))
}

pub(crate) fn connections(programs: &[Program]) -> String {
    let names: Vec<_> = programs.iter().map(Program::to_string).collect();
    match names.is_empty() {
        true => "nobody is connected any more".to_string(),
        false => format!("connected: {}", names.join(", ")),
    }
}

/// All that a service has said.
pub(crate) fn details(said: &Said) -> Vec<String> {
    let health = &said.health;
    let mut lines = vec![
        format!("model {}, up {}", ModelId(health.model_id), span(Duration::from_nanos(health.uptime_ns))),
        String::new(),
        format!("{:20} {:39}   {:>15}", "latency, µs", "in the last second", "since the start"),
        format!(
            "{:20}{:>8}{:>8}{:>8}{:>8}{:>8}  {:>8}{:>8}",
            "", "p50", "p90", "p99", "p99.9", "max", "p99.9", "max"
        ),
    ];
    let (now, ever) = (&health.last_interval, &health.since_start);
    for (name, now, ever) in [
        ("sent → received", &now.sent_to_received, &ever.sent_to_received),
        ("received → reported", &now.received_to_reported, &ever.received_to_reported),
        ("sent → reported", &now.sent_to_reported, &ever.sent_to_reported),
    ] {
        lines.push(stage(name, now, ever));
    }
    lines.push(String::new());
    lines.extend(counters(said));
    lines.push(drift::line(&health.drift));
    lines
}

fn stage(name: &str, now: &Latency, ever: &Latency) -> String {
    let mut line = format!("{name:20}");
    for ns in [now.p50_ns, now.p90_ns, now.p99_ns, now.p999_ns, now.max_ns] {
        line += &format!("{:>8}", micros(ns));
    }
    line + &format!("  {:>8}{:>8}", micros(ever.p999_ns), micros(ever.max_ns))
}

/// What was counted since the start, and how much of it is new.
fn counters(said: &Said) -> [String; 3] {
    let count = |name: &str, of: fn(&HealthReport) -> u64| {
        let now = of(&said.health);
        match said.before.map_or(0, |before| now.saturating_sub(of(&before))) {
            0 => format!("{name} {now}"),
            more => format!("{name} {now} (+{more})"),
        }
    };
    let novelty = match said.health.last_status() {
        Some(ReportStatus::Classified) => format!("last novelty {:.2}", said.health.last_novelty),
        _ => "no novelty".to_string(),
    };
    let frames = [
        count("frames", |health| health.n_frames),
        count("classified", |health| health.n_classified),
        count("invalid", |health| health.n_invalid),
        count("novel", |health| health.n_novel),
        novelty,
    ];
    let spoilt = [
        count("lost", |health| health.n_lost),
        count("late", |health| health.n_late),
        count("repeated", |health| health.n_repeated),
        count("refused", |health| health.n_refused),
        count("without command", |health| health.n_uncommanded),
    ];
    let changes = [
        count("reloads", |health| health.n_reloads),
        count("refused models", |health| health.n_reloads_refused),
        count("killed programs", |health| health.n_peers_lost),
    ];
    [frames.join("   "), spoilt.join("   "), changes.join("   ")]
}

/// Microseconds in at most six columns; seconds, and said so, where there are too many.
fn micros(ns: u64) -> String {
    let us = ns as f64 / 1e3;
    match us {
        ..10_000.0 => format!("{us:.1}"),
        ..1e6 => format!("{us:.0}"),
        _ => format!("{:.1} s", us / 1e6),
    }
}

/// A time in its two largest units.
fn span(time: Duration) -> String {
    let s = time.as_secs();
    match s {
        0..60 => format!("{s} s"),
        60..3600 => format!("{} min {:02} s", s / 60, s % 60),
        3600..86_400 => format!("{} h {:02} min", s / 3600, s / 60 % 60),
        _ => format!("{} d {:02} h", s / 86_400, s / 3600 % 24),
    }
}

#[cfg(test)]
mod tests {
    use kinds_messages::KindReport;

    use super::*;

    fn said() -> Said {
        let latency = |factor: u64| Latency {
            n_frames: 5,
            sum_ns: 0,
            p50_ns: 15_200 * factor,
            p90_ns: 20_000 * factor,
            p99_ns: 41_000 * factor,
            p999_ns: 62_040 * factor,
            max_ns: 60_000_000_000,
        };
        let mut health = HealthReport {
            flags: HealthReport::HAS_LAST_FRAME | HealthReport::HAS_SHIM,
            uptime_ns: 3_723_000_000_000,
            interval_ns: 1_000_000_000,
            model_id: [0xab; 16],
            n_frames: 15_234,
            n_classified: 15_200,
            n_invalid: 34,
            n_lost: 12,
            last_status: KindReport::CLASSIFIED,
            last_kind: 3,
            last_probability: 0.76,
            last_novelty: 0.125,
            ..HealthReport::default()
        };
        health.drift.novel = 0.013;
        health.drift.novel_usual = 0.01;
        health.last_interval.sent_to_received = latency(1);
        health.last_interval.sent_to_reported = latency(1000);
        let before = HealthReport { n_lost: 9, ..health };
        Said { health, before: Some(before) }
    }

    #[test]
    fn a_row_has_a_place_for_every_number() {
        let health = said().health;
        assert_eq!(heading(17).chars().count(), 79);
        assert_eq!(
            heading(17),
            "sensor                 Hz          kind now    p50 µs  p99.9 µs    lost    late"
        );
        assert_eq!(numbers(&health), "    5.0  3 ██████··  76 %     15200     62040      12       0");
        let invalid = HealthReport { last_status: KindReport::INVALID, ..health };
        assert_eq!(kind_now(LastFrame::of_health(&invalid)), "invalid");
        assert_eq!(kind_now(LastFrame::of_health(&HealthReport::default())), "no frame yet");
    }

    #[test]
    fn of_a_service_elsewhere_what_is_known_stands_in_its_place_and_silence_is_told() {
        let begin = Instant::now();
        let at = |ms| begin + Duration::from_millis(ms);
        let mut passed_on = PassedOn::begun(begin);
        assert_eq!(
            numbers_elsewhere(&passed_on, at(0)),
            "      –      no frame yet         –         –       –       –"
        );
        let mut report = KindReport::default();
        report.set_kinds([3].into_iter(), [].into_iter());
        report.set_probabilities(&[0.76], &[0.76]);
        report.status = KindReport::CLASSIFIED;
        for ms in [0, 500, 1000] {
            passed_on.add(report, at(ms));
        }
        let row = numbers_elsewhere(&passed_on, at(1000));
        assert_eq!(row, "    2.0  3 ██████··  76 %         –         –       –       –");
        assert_eq!(row.chars().count(), numbers(&said().health).chars().count());
        assert_eq!(silence(&passed_on, at(3900)), None);
        let told = "no report has come for 4 s: look at the link, and at the robot";
        assert_eq!(silence(&passed_on, at(5000)).as_deref(), Some(told));
    }

    #[test]
    fn details_fit_in_a_terminal_of_80_columns() {
        let lines = details(&said());
        assert_eq!(
            lines,
            [
                "model abababababababababababababababab, up 1 h 02 min",
                "",
                "latency, µs          in the last second                        since the start",
                "                         p50     p90     p99   p99.9     max     p99.9     max",
                "sent → received         15.2    20.0    41.0    62.0  60.0 s       0.0     0.0",
                "received → reported      0.0     0.0     0.0     0.0     0.0       0.0     0.0",
                "sent → reported        15200   20000   41000   62040  60.0 s       0.0     0.0",
                "",
                "frames 15234   classified 15200   invalid 34   novel 0   last novelty 0.12",
                "lost 12 (+3)   late 0   repeated 0   refused 0   without command 0",
                "reloads 0   refused models 0   killed programs 0",
                "10 min (usual)   novel 1.3 % (1.0)   shares ? (?)   halves ? (?)",
            ]
        );
        assert!(lines.iter().all(|line| line.chars().count() <= 78), "{lines:#?}");
    }

    #[test]
    fn spans_are_told_in_two_units() {
        for (s, told) in
            [(0, "0 s"), (59, "59 s"), (61, "1 min 01 s"), (7260, "2 h 01 min"), (180_000, "2 d 02 h")]
        {
            assert_eq!(span(Duration::from_secs(s)), told);
        }
    }
}
