//! `kinds record`: a sensor's frames, poses, commands and kinds, from shared memory into a trip.

use std::path::PathBuf;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

use kinds_driver_shim::Capture;
use kinds_messages::{
    Frame, FrameHeader, FrameReader, KindReport, Node, ReportReader, ReportStatus, ns_since_epoch,
};
use kinds_trips::{FrameLayout, Stamp};

use crate::cli::{Limits, RecordArguments, RecordPlan};
use crate::failure::Failure;
use crate::notify::Supervisor;
use crate::say::mention;
use crate::trip_file::TripFile;
use crate::trip_folder::Destination;
use crate::{log, stop};

/// Longest time between two looks at the stop flag.
const TICK: Duration = Duration::from_millis(50);

/// How often everything is handed to the system and to the disk, which is what a crash can take; and how often it is looked
/// whether there is room, and whether another trip is due.
const FLUSH_PERIOD: Duration = Duration::from_secs(1);

/// Silence of a service that ends the wait for its report on the last frame.
const SILENCE: Duration = Duration::from_secs(2);

/// How often what killed programs left is looked for.
const CLEAN_UP_PERIOD: Duration = Duration::from_secs(2);

pub(crate) fn run(arguments: &RecordArguments) -> Result<(), Failure> {
    let RecordPlan { sensor, output, count, limits } = arguments.plan()?;
    let destination = Destination::new(output.clone(), sensor.clone());
    if limits.need_folder() && !destination.is_folder() {
        return Err(Failure::CouldNot(format!(
            "cannot record several trips into {}: trip_mb_max, trip_s_max and keep need a folder that is there",
            output.display()
        )));
    }
    let stop = stop::on_signals()?;
    let supervisor = Supervisor::from_environment();
    let mut recorder = Recorder::begin(destination, limits)?;
    let node = Node::open(&arguments.domain.domain(), "kinds-record")?;
    // Both before the first frame can come: its report must find a reader.
    let reports = ReportReader::open(&node, &sensor)?;
    let frames = FrameReader::open(&node, &sensor)?;
    supervisor.ready(format_args!("recording {sensor} into {}", recorder.trip.path.display()));
    if !frames.is_published() {
        log::notice(format!("waiting for a driver shim to publish {sensor}"));
    }
    let n_frames_max = count.unwrap_or(u64::MAX);
    let channels = Channels { node, reports, frames };
    let recorded = recorder.record(&channels, n_frames_max, &stop, &supervisor);
    supervisor.stopping();
    // Whatever ended it: what was recorded until then is a trip.
    let ended = recorder.end();
    recorded.and(ended)
}

/// What is recorded.
struct Channels {
    node: Node,
    reports: ReportReader,
    frames: FrameReader,
}

/// One trip after another of a sensor, within limits.
struct Recorder {
    destination: Destination,
    limits: Limits,
    /// The one that is being recorded.
    trip: Recording,
    /// In all trips.
    n_frames: u64,
    n_trips_ended: u64,
    /// There is too little room: frames are counted and left out.
    is_paused: bool,
    /// The last run of which it was said that frames contradict themselves.
    refused_run: Option<u64>,
    /// Of the last frame: its run, and its number in it.
    last_frame: Option<(u64, u64)>,
    last_report: Option<(u64, u64)>,
    /// When the last frame or report was taken.
    last_taken: Instant,
}

impl Recorder {
    fn begin(destination: Destination, limits: Limits) -> Result<Self, Failure> {
        let trip = Recording::begin(destination.path_at(ns_since_epoch())?)?;
        let mut recorder = Self {
            destination,
            limits,
            trip,
            n_frames: 0,
            n_trips_ended: 0,
            is_paused: false,
            refused_run: None,
            last_frame: None,
            last_report: None,
            last_taken: Instant::now(),
        };
        recorder.remove_old_trips()?;
        recorder.look_for_room()?;
        Ok(recorder)
    }

    /// Records until so many frames are there, or somebody stops it.
    fn record(
        &mut self,
        channels: &Channels,
        n_frames_max: u64,
        stop: &AtomicBool,
        supervisor: &Supervisor,
    ) -> Result<(), Failure> {
        let (mut last_flush, mut last_clean_up) = (Instant::now(), Instant::now());
        loop {
            // Read before recording: what was sent before the flag was set is recorded.
            let stopping = stop.load(Ordering::Relaxed);
            // Reports before frames: whoever reported had been sent the frame, so it is here when its report is written.
            let mut reported = Vec::new();
            while let Some(report) = channels.reports.receive()? {
                reported.push(report);
            }
            while self.n_frames < n_frames_max
                && let Some(frame) = channels.frames.receive()?
            {
                self.take_frame(&frame)?;
            }
            for report in &reported {
                self.take_report(report)?;
            }
            if stopping || self.is_complete(n_frames_max, channels.reports.service().is_some()) {
                return Ok(());
            }
            if last_flush.elapsed() >= FLUSH_PERIOD {
                self.flush()?;
                supervisor.alive(format_args!("recording {}", self.status()));
                last_flush = Instant::now();
            }
            if last_clean_up.elapsed() >= CLEAN_UP_PERIOD {
                channels.node.clean_up_dead_nodes();
                last_clean_up = Instant::now();
            }
            // The last frame is here, and its report is still on its way.
            if self.n_frames < n_frames_max {
                channels.frames.wait(TICK)?
            } else {
                channels.reports.wait(TICK)?
            };
        }
    }

    fn take_frame(&mut self, frame: &Frame) -> Result<(), Failure> {
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
        if let Some((run, sequence)) = self.last_frame.replace((header.run, header.sequence))
            && run == header.run
        {
            self.trip.losses.n_lost += header.sequence.saturating_sub(sequence).saturating_sub(1);
        }
        self.last_taken = Instant::now();
        if self.is_paused {
            self.trip.losses.n_left_out += 1;
            return Ok(());
        }
        if let Some(expected) = self.trip.layout.filter(|expected| *expected != layout) {
            if !self.destination.is_folder() {
                return Err(Failure::CouldNot(format!(
                    "cannot record frames of {layout} after frames of {expected}: one trip is of one sensor"
                )));
            }
            self.begin_another_trip()?;
        }
        self.n_frames += 1;
        self.trip.add_frame(frame, layout)
    }

    /// Takes kinds of frames that are in this trip or the one before; a late joiner's first report may be of one that is in
    /// none.
    fn take_report(&mut self, report: &KindReport) -> Result<(), Failure> {
        let is_taken =
            self.last_frame.is_some_and(|(run, sequence)| run == report.run && report.sequence <= sequence);
        if !is_taken {
            return Ok(());
        }
        self.last_report = Some((report.run, report.sequence));
        self.last_taken = Instant::now();
        match self.is_paused {
            true => Ok(()),
            false => self.trip.add_report(report),
        }
    }

    /// Whether all frames that were asked for are there, and the report on the last of them if somebody reports.
    fn is_complete(&self, n_frames_max: u64, is_served: bool) -> bool {
        let awaits_report =
            is_served && self.last_report != self.last_frame && self.last_taken.elapsed() < SILENCE;
        self.n_frames >= n_frames_max && !awaits_report
    }

    fn flush(&mut self) -> Result<(), Failure> {
        if !self.is_paused {
            self.trip.flush()?;
            if self.trip.is_full(&self.limits)? {
                self.begin_another_trip()?;
            }
        }
        self.look_for_room()
    }

    fn begin_another_trip(&mut self) -> Result<(), Failure> {
        let next = Recording::begin(self.destination.path_at(ns_since_epoch())?)?;
        let ended = std::mem::replace(&mut self.trip, next);
        self.n_trips_ended += 1;
        mention(ended.end()?)?;
        self.remove_old_trips()
    }

    fn remove_old_trips(&self) -> Result<(), Failure> {
        match self.limits.n_kept {
            Some(n_kept) => self.destination.keep_last(n_kept, &self.trip.path),
            None => Ok(()),
        }
    }

    /// Pauses where there is too little room, and goes on when there is a tenth more: not to and fro at the limit.
    fn look_for_room(&mut self) -> Result<(), Failure> {
        const MB: u64 = 1_000_000;
        let (free, limit) = (self.destination.free_bytes()?, self.limits.free_bytes_min);
        let (free_mb, limit_mb) = (free / MB, limit / MB);
        let path = self.trip.path.display();
        if !self.is_paused && free < limit {
            self.is_paused = true;
            log::notice(format!(
                "recording into {path} pauses: {free_mb} MB are free there, and {limit_mb} MB are to stay so (free_mb_min)"
            ));
        } else if self.is_paused && free >= limit.saturating_add(limit / 10) {
            self.is_paused = false;
            let n_left_out = self.trip.losses.n_left_out;
            log::notice(format!(
                "recording into {path} goes on: {free_mb} MB are free there; {n_left_out} frames were left out"
            ));
        }
        Ok(())
    }

    /// How the trip fares, for a supervisor.
    fn status(&self) -> String {
        let Recording { path, n_frames, losses, .. } = &self.trip;
        let paused = if self.is_paused { "; paused for want of room" } else { "" };
        let (sensor, path) = (self.destination.sensor(), path.display());
        format!("{sensor} into {path}: {n_frames} frames, {} lost{paused}", losses.n_lost)
    }

    fn end(self) -> Result<(), Failure> {
        let Self { destination, limits, trip, n_trips_ended, .. } = self;
        if trip.n_frames > 0 {
            let path = trip.path.clone();
            mention(trip.end()?)?;
            return match limits.n_kept {
                // The one that has just been recorded is one of them.
                Some(n_kept) => destination.keep_last(n_kept - 1, &path),
                None => Ok(()),
            };
        }
        let path = trip.path.display();
        match (n_trips_ended, trip.losses.n_left_out) {
            (0, 0) => Err(Failure::CouldNot(format!("no frame came, so {path} was not written"))),
            (0, n_left_out) => Err(Failure::CouldNot(format!(
                "{path} was not written: {n_left_out} frames came, and there was no room for them"
            ))),
            // One that was begun when the last one was full, and got no frame.
            _ => Ok(()),
        }
    }
}

/// Frames that are not in a trip.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
struct Losses {
    /// On the way from the driver shim, those that contradict themselves among them.
    n_lost: u64,
    /// For want of room.
    n_left_out: u64,
}

/// A trip being recorded. Dropped before its end, it leaves nothing behind.
struct Recording {
    path: PathBuf,
    file: TripFile,
    n_frames: u64,
    n_reports: u64,
    layout: Option<FrameLayout>,
    losses: Losses,
    /// What the file says of them.
    losses_written: Losses,
    /// When the first frame was written.
    began: Option<Instant>,
    /// The latest frame that was written.
    last: Stamp,
}

impl Recording {
    fn begin(path: PathBuf) -> Result<Self, Failure> {
        let file = TripFile::create(&path)?;
        let none = Losses::default();
        Ok(Self {
            path,
            file,
            n_frames: 0,
            n_reports: 0,
            layout: None,
            losses: none,
            losses_written: none,
            began: None,
            last: Stamp(0),
        })
    }

    fn add_frame(&mut self, frame: &Frame, layout: FrameLayout) -> Result<(), Failure> {
        let header = frame.header();
        let captured = Stamp(header.captured_ns);
        let capture = Capture {
            captured,
            pose: header.known_pose(),
            command: header.known_command(),
            true_pose: header.known_true_pose(),
        };
        self.file.add_frame(layout, frame.counts(), &capture)?;
        self.began.get_or_insert_with(Instant::now);
        (self.layout, self.last) = (Some(layout), captured);
        self.n_frames += 1;
        Ok(())
    }

    fn add_report(&mut self, report: &KindReport) -> Result<(), Failure> {
        if report.status() == ReportStatus::Classified {
            self.file.add_kinds(Stamp(report.captured_ns), report.probabilities())?;
            self.n_reports += 1;
        }
        Ok(())
    }

    /// Brings everything so far to where a crash, and soon a power cut, cannot take it.
    fn flush(&mut self) -> Result<(), Failure> {
        self.add_losses()?;
        self.file.flush()?;
        self.file.sync().map_err(|error| Failure::file("write", &self.path, &error))
    }

    /// Says in the file what is missing, if that has changed: whoever finds only the file knows.
    fn add_losses(&mut self) -> Result<(), Failure> {
        if self.n_frames > 0 && self.losses != self.losses_written {
            let Losses { n_lost, n_left_out } = self.losses;
            self.file.add_losses(self.last, n_lost, n_left_out)?;
            self.losses_written = self.losses;
        }
        Ok(())
    }

    fn is_full(&self, limits: &Limits) -> Result<bool, Failure> {
        let Some(began) = self.began else { return Ok(false) };
        let n_bytes = self.file.n_bytes().map_err(|error| Failure::file("write", &self.path, &error))?;
        let is_large = limits.trip_bytes_max.is_some_and(|n_bytes_max| n_bytes >= n_bytes_max);
        Ok(is_large || limits.trip_duration_max.is_some_and(|duration_max| began.elapsed() >= duration_max))
    }

    fn end(mut self) -> Result<String, Failure> {
        self.add_losses()?;
        self.file.finish()?;
        let (n_frames, n_reports, path) = (self.n_frames, self.n_reports, self.path.display());
        let Losses { n_lost, n_left_out } = self.losses;
        let left_out = match n_left_out {
            0 => String::new(),
            _ => format!(", {n_left_out} left out for want of room"),
        };
        Ok(format!(
            "recorded {n_frames} frames and {n_reports} reports into {path}; {n_lost} frames lost{left_out}"
        ))
    }
}

fn layout_of(header: &FrameHeader) -> FrameLayout {
    FrameLayout { rows: header.rows, columns: header.columns, metres_per_count: header.metres_per_count }
}
