//! `kinds record`: a sensor's frames, poses, commands and kinds, from shared memory into a trip.

use std::path::Path;
use std::sync::atomic::Ordering;
use std::time::{Duration, Instant};

use kinds_driver_shim::Capture;
use kinds_messages::{
    Frame, FrameHeader, FrameReader, KindReport, Node, ReportReader, ReportStatus, SensorName, ns_since_epoch,
};
use kinds_trips::{FrameLayout, Stamp, TripWriteError};

use crate::cli::{RecordArguments, RecordPlan};
use crate::failure::Failure;
use crate::notify::Supervisor;
use crate::say::mention;
use crate::trip_file::TripFile;
use crate::{log, stop};

/// Longest time between two looks at the stop flag.
const TICK: Duration = Duration::from_millis(50);

/// How often everything is handed to the system: what a crash can take.
const FLUSH_PERIOD: Duration = Duration::from_secs(1);

/// Silence of a service that ends the wait for its report on the last frame.
const SILENCE: Duration = Duration::from_secs(2);

/// How often what killed programs left is looked for.
const CLEAN_UP_PERIOD: Duration = Duration::from_secs(2);

pub(crate) fn run(arguments: &RecordArguments) -> Result<(), Failure> {
    let RecordPlan { sensor, output, count } = arguments.plan()?;
    let sensor = &sensor;
    let path = &match output.is_dir() {
        true => output.join(name_at(sensor, ns_since_epoch())),
        false => output,
    };
    if path.exists() {
        return Err(Failure::CouldNot(format!(
            "cannot record into {}: it is there already; choose another name",
            path.display()
        )));
    }
    let stop = stop::on_signals()?;
    let supervisor = Supervisor::from_environment();
    let mut recording = Recording::begin(TripFile::create(path)?);
    let node = Node::open(&arguments.domain.domain(), "kinds-record")?;
    // Both before the first frame can come: its report must find a reader.
    let reports = ReportReader::open(&node, sensor)?;
    let frames = FrameReader::open(&node, sensor)?;
    supervisor.ready(format_args!("recording {sensor} into {}", path.display()));
    if !frames.is_published() {
        log::notice(format!("waiting for a driver shim to publish {sensor}"));
    }
    let n_frames_max = count.unwrap_or(u64::MAX);
    let (mut last_flush, mut last_clean_up) = (Instant::now(), Instant::now());
    loop {
        // Read before recording: what was sent before the flag was set is recorded.
        let stopping = stop.load(Ordering::Relaxed);
        // Reports before frames: whoever reported had been sent the frame, so it is here when its report is written.
        let mut reported = Vec::new();
        while let Some(report) = reports.receive()? {
            reported.push(report);
        }
        while recording.n_frames < n_frames_max
            && let Some(frame) = frames.receive()?
        {
            recording.add_frame(&frame)?;
        }
        for report in &reported {
            recording.add_report(report)?;
        }
        if stopping || recording.is_complete(n_frames_max, reports.service().is_some()) {
            break;
        }
        if last_flush.elapsed() >= FLUSH_PERIOD {
            recording.file.flush()?;
            let (n_frames, n_lost) = (recording.n_frames, recording.n_lost);
            supervisor.alive(format_args!(
                "recording {sensor} into {}: {n_frames} frames, {n_lost} lost",
                path.display()
            ));
            last_flush = Instant::now();
        }
        if last_clean_up.elapsed() >= CLEAN_UP_PERIOD {
            node.clean_up_dead_nodes();
            last_clean_up = Instant::now();
        }
        // The last frame is here, and its report is still on its way.
        if recording.n_frames < n_frames_max {
            frames.wait(TICK)?
        } else {
            reports.wait(TICK)?
        };
    }
    supervisor.stopping();
    let summary = recording.end(path)?;
    mention(summary)
}

/// The name of a trip of a sensor that begins at a time: `crunch-ring-2026-11-27T12-30-00Z.mcap`.
///
/// * `at_ns` — since the epoch
fn name_at(sensor: &SensorName, at_ns: i64) -> String {
    const DAY_S: i64 = 24 * 60 * 60;
    let at_s = at_ns.div_euclid(1_000_000_000);
    let (day, second) = (at_s.div_euclid(DAY_S), at_s.rem_euclid(DAY_S));
    let (year, month, day) = date(day);
    let [hour, minute, second] = [second / 3600, second / 60 % 60, second % 60];
    let sensor = sensor.as_str().replace('/', "-");
    format!("{sensor}-{year:04}-{month:02}-{day:02}T{hour:02}-{minute:02}-{second:02}Z.mcap")
}

/// Year, month and day, from days since the epoch.
///
/// Hinnant 2021, *chrono-Compatible Low-Level Date Algorithms*, `civil_from_days`: years begin in March, so that the leap day is
/// a year's last.
fn date(days: i64) -> (i64, i64, i64) {
    const ERA: i64 = 146_097;
    let days = days + 719_468;
    let (era, day_of_era) = (days.div_euclid(ERA), days.rem_euclid(ERA));
    let year_of_era = (day_of_era - day_of_era / 1460 + day_of_era / 36_524 - day_of_era / 146_096) / 365;
    let day_of_year = day_of_era - (365 * year_of_era + year_of_era / 4 - year_of_era / 100);
    let month_from_march = (5 * day_of_year + 2) / 153;
    let day = day_of_year - (153 * month_from_march + 2) / 5 + 1;
    let month = if month_from_march < 10 { month_from_march + 3 } else { month_from_march - 9 };
    (400 * era + year_of_era + i64::from(month <= 2), month, day)
}

/// A trip being recorded. Dropped before its end, it leaves nothing behind.
struct Recording {
    file: TripFile,
    n_frames: u64,
    n_reports: u64,
    n_lost: u64,
    layout: Option<FrameLayout>,
    /// The last run of which it was said that frames contradict themselves.
    refused_run: Option<u64>,
    /// Of the last frame: its run, and its number in it.
    last_frame: Option<(u64, u64)>,
    last_report: Option<(u64, u64)>,
    /// When the last frame or report was written.
    last_written: Instant,
}

impl Recording {
    fn begin(file: TripFile) -> Self {
        Self {
            file,
            n_frames: 0,
            n_reports: 0,
            n_lost: 0,
            layout: None,
            refused_run: None,
            last_frame: None,
            last_report: None,
            last_written: Instant::now(),
        }
    }

    fn add_frame(&mut self, frame: &Frame) -> Result<(), Failure> {
        let header = frame.header();
        let layout = layout_of(header);
        let n_readings = frame.counts().len();
        if layout.n_readings() != n_readings {
            // One bad frame must not cost the whole trip. It is counted among the lost, as a gap.
            if self.refused_run.replace(header.run) != Some(header.run) {
                eprintln!(
                    "kinds: frames that have {n_readings} readings but say {} × {} are left out; their driver shim is at fault",
                    layout.rows, layout.columns
                );
            }
            return Ok(());
        }
        let expected = *self.layout.get_or_insert(layout);
        if layout != expected {
            return Err(Failure::CouldNot(format!(
                "cannot record frames of {layout} after frames of {expected}: one trip is of one sensor"
            )));
        }
        let capture = Capture {
            captured: Stamp(header.captured_ns),
            pose: header.known_pose(),
            command: header.known_command(),
            true_pose: header.known_true_pose(),
        };
        self.file.add_frame(layout, frame.counts(), &capture)?;
        if let Some((run, sequence)) = self.last_frame.replace((header.run, header.sequence))
            && run == header.run
        {
            self.n_lost += header.sequence.saturating_sub(sequence).saturating_sub(1);
        }
        self.n_frames += 1;
        self.last_written = Instant::now();
        Ok(())
    }

    /// Kinds of frames that are in the trip; a late joiner's first report may be of one that is not.
    fn add_report(&mut self, report: &KindReport) -> Result<(), TripWriteError> {
        let is_recorded =
            self.last_frame.is_some_and(|(run, sequence)| run == report.run && report.sequence <= sequence);
        if !is_recorded {
            return Ok(());
        }
        self.last_report = Some((report.run, report.sequence));
        self.last_written = Instant::now();
        if report.status() == ReportStatus::Classified {
            self.file.add_kinds(Stamp(report.captured_ns), report.probabilities())?;
            self.n_reports += 1;
        }
        Ok(())
    }

    /// Whether all frames that were asked for are there, and the report on the last of them if somebody reports.
    fn is_complete(&self, n_frames_max: u64, is_served: bool) -> bool {
        let awaits_report =
            is_served && self.last_report != self.last_frame && self.last_written.elapsed() < SILENCE;
        self.n_frames >= n_frames_max && !awaits_report
    }

    fn end(self, path: &Path) -> Result<String, Failure> {
        if self.n_frames == 0 {
            return Err(Failure::CouldNot(format!("no frame came, so {} was not written", path.display())));
        }
        let (n_frames, n_reports, n_lost) = (self.n_frames, self.n_reports, self.n_lost);
        self.file.finish()?;
        let path = path.display();
        Ok(format!("recorded {n_frames} frames and {n_reports} reports into {path}; {n_lost} frames lost"))
    }
}

fn layout_of(header: &FrameHeader) -> FrameLayout {
    FrameLayout { rows: header.rows, columns: header.columns, metres_per_count: header.metres_per_count }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn trips_are_named_by_sensor_and_time() {
        let sensor = "crunch/ring".parse().unwrap();
        // By `date --utc --date @… +%FT%H-%M-%SZ`.
        for (at_s, time) in [
            (0, "1970-01-01T00-00-00Z"),
            (-1, "1969-12-31T23-59-59Z"),
            (951_782_400, "2000-02-29T00-00-00Z"),
            (1_709_251_199, "2024-02-29T23-59-59Z"),
            (1_795_782_600, "2026-11-27T12-30-00Z"),
            (4_107_542_400, "2100-03-01T00-00-00Z"),
        ] {
            assert_eq!(name_at(&sensor, at_s * 1_000_000_000), format!("crunch-ring-{time}.mcap"));
        }
    }
}
