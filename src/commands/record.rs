//! `kinds record`: frames, poses, commands, kinds and health of one sensor or several, from shared memory into a trip.

use std::collections::VecDeque;
use std::path::PathBuf;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

use kinds_driver_shim::Capture;
use kinds_messages::{
    Frame, FrameHeader, FrameReader, HealthReader, HealthReport, KindReport, Node, ReportReader,
    ReportStatus, SensorName, ns_since_epoch,
};
use kinds_model::novelty::FALSE_ALARM_RATE;
use kinds_trips::{FrameLayout, Stamp};

use crate::cli::{Limits, RecordArguments, RecordPlan, SensorNames};
use crate::failure::Failure;
use crate::notify::Supervisor;
use crate::say::mention;
use crate::trip_file::{Topics, TripFile};
use crate::trip_folder::Destination;
use crate::{log, stop};

/// Longest time between two looks at the stop flag.
const TICK: Duration = Duration::from_millis(50);

/// The same where several sensors are recorded: only the first one's frames wake the recorder, and sixteen of the others' have room.
const TICK_OF_SEVERAL: Duration = Duration::from_millis(5);

/// How often everything is handed to the system and to the disk, which is what a crash can take; and how often it is looked
/// whether there is room, and whether another trip is due.
const FLUSH_PERIOD: Duration = Duration::from_secs(1);

/// Silence of a service that ends the wait for its report on the last frame.
const SILENCE: Duration = Duration::from_secs(2);

/// Frames of a sensor that may be on their way to their report.
const N_WAITING_MAX: usize = 64;

/// How often what killed programs left is looked for.
const CLEAN_UP_PERIOD: Duration = Duration::from_secs(2);

pub(crate) fn run(arguments: &RecordArguments) -> Result<(), Failure> {
    let RecordPlan { sensors, output, count, novel, limits } = arguments.plan()?;
    let destination = Destination::new(output.clone(), &sensors.to_string());
    if limits.need_folder() && !destination.is_folder() {
        return Err(Failure::CouldNot(format!(
            "cannot record several trips into {}: trip_mb_max, trip_s_max and keep need a folder that is there",
            output.display()
        )));
    }
    let topics = topics_of(&sensors)?;
    let stop = stop::on_signals()?;
    let supervisor = Supervisor::from_environment();
    let trip = Recording::begin(destination.path_at(ns_since_epoch(), None)?, sensors.iter().len())?;
    let node = Node::open(&arguments.domain.domain(), "kinds-record")?;
    let sources = sensors.iter().zip(topics).map(|(sensor, topics)| Source::open(&node, sensor, topics));
    let sources: Vec<Source> = sources.collect::<Result<_, Failure>>()?;
    supervisor.ready(format_args!("recording {sensors} into {}", trip.path.display()));
    for source in sources.iter().filter(|source| !source.frames.is_published()) {
        log::notice(format!("waiting for a driver shim to publish {}", source.sensor));
    }
    let mut recorder = Recorder {
        destination,
        limits,
        only_novel: novel,
        sources,
        trip,
        n_frames: 0,
        n_trips_ended: 0,
        is_paused: false,
        last_taken: Instant::now(),
    };
    let recorded = recorder
        .make_room()
        .and_then(|()| recorder.record(&node, count.unwrap_or(u64::MAX), &stop, &supervisor));
    supervisor.stopping();
    // Whatever ended it: what was recorded until then is a trip.
    let ended = recorder.end();
    recorded.and(ended)
}

/// Where each sensor's part of a trip goes.
fn topics_of(sensors: &SensorNames) -> Result<Vec<Topics>, Failure> {
    if sensors.iter().len() == 1 {
        return Ok(vec![Topics::of_the_only_sensor()]);
    }
    let all: Vec<Topics> = sensors.iter().map(Topics::of).collect();
    for (index, (sensor, topics)) in sensors.iter().zip(&all).enumerate() {
        let alike = sensors.iter().zip(&all).take(index).find(|(_, other)| other.frames() == topics.frames());
        if let Some((before, _)) = alike {
            return Err(Failure::AskedWrongly(format!(
                "{before} and {sensor} would both be {} in one trip, where topics have no dots and dashes; record them by \
                 themselves",
                topics.frames()
            )));
        }
    }
    Ok(all)
}

/// A sensor that is recorded.
struct Source {
    sensor: SensorName,
    topics: Topics,
    reports: ReportReader,
    frames: FrameReader,
    health: HealthReader,
    /// The last run of which it was said that frames contradict themselves.
    refused_run: Option<u64>,
    /// Of the last frame: its run, and its number in it.
    last_frame: Option<(u64, u64)>,
    last_report: Option<(u64, u64)>,
    /// Where only novel frames are recorded: those that are not reported yet.
    waiting: VecDeque<Taken>,
}

/// A frame that was taken.
struct Taken {
    header: FrameHeader,
    layout: FrameLayout,
    counts: Vec<u16>,
}

impl Taken {
    fn id(&self) -> (u64, u64) {
        (self.header.run, self.header.sequence)
    }
}

impl Source {
    fn open(node: &Node, sensor: &SensorName, topics: Topics) -> Result<Self, Failure> {
        Ok(Self {
            sensor: sensor.clone(),
            topics,
            // Before the first frame can come: its report must find a reader.
            reports: ReportReader::open(node, sensor)?,
            frames: FrameReader::open(node, sensor)?,
            health: HealthReader::open(node, sensor)?,
            refused_run: None,
            last_frame: None,
            last_report: None,
            waiting: VecDeque::new(),
        })
    }

    /// Whether the last frame was reported, or nobody reports.
    fn is_reported(&self) -> Result<bool, Failure> {
        Ok(self.last_frame == self.last_report || self.reports.service().is_none())
    }
}

/// One trip after another, within limits.
struct Recorder {
    destination: Destination,
    limits: Limits,
    /// Frames wait for their report, and those that are not novel go.
    only_novel: bool,
    sources: Vec<Source>,
    /// The one that is being recorded.
    trip: Recording,
    /// In all trips, of all sensors.
    n_frames: u64,
    n_trips_ended: u64,
    /// There is too little room: frames are counted and left out.
    is_paused: bool,
    /// When the last frame or report was taken.
    last_taken: Instant,
}

impl Recorder {
    fn make_room(&mut self) -> Result<(), Failure> {
        self.remove_old_trips()?;
        self.look_for_room()
    }

    /// Records until so many frames are there, or somebody stops it.
    fn record(
        &mut self,
        node: &Node,
        n_frames_max: u64,
        stop: &AtomicBool,
        supervisor: &Supervisor,
    ) -> Result<(), Failure> {
        let (mut last_flush, mut last_clean_up) = (Instant::now(), Instant::now());
        let tick = if self.sources.len() > 1 { TICK_OF_SEVERAL } else { TICK };
        loop {
            // Read before recording: what was sent before the flag was set is recorded.
            let stopping = stop.load(Ordering::Relaxed);
            for index in 0..self.sources.len() {
                self.take_what_waits(index, n_frames_max)?;
            }
            if stopping || self.is_complete(n_frames_max)? {
                return Ok(());
            }
            if last_flush.elapsed() >= FLUSH_PERIOD {
                self.flush()?;
                supervisor.alive(format_args!("recording {}", self.status()));
                last_flush = Instant::now();
            }
            if last_clean_up.elapsed() >= CLEAN_UP_PERIOD {
                node.clean_up_dead_nodes();
                last_clean_up = Instant::now();
            }
            let first = &self.sources[0];
            // The last frame is here, and its report is still on its way.
            if self.n_frames < n_frames_max {
                first.frames.wait(tick)?
            } else {
                first.reports.wait(tick)?
            };
        }
    }

    /// Takes what has come of a sensor.
    fn take_what_waits(&mut self, index: usize, n_frames_max: u64) -> Result<(), Failure> {
        // Reports before frames: whoever reported had been sent the frame, so it is here when its report is written.
        let mut reported = Vec::new();
        while let Some(report) = self.sources[index].reports.receive()? {
            reported.push(report);
        }
        while self.n_frames < n_frames_max
            && let Some(frame) = self.sources[index].frames.receive()?
        {
            self.take_frame(index, &frame)?;
        }
        for report in &reported {
            // A novel frame is written when its report is here.
            if self.only_novel && self.n_frames == n_frames_max {
                break;
            }
            self.take_report(index, report)?;
        }
        while let Some(health) = self.sources[index].health.receive()? {
            // What a service said before the first frame is not of this trip.
            if !self.is_paused && self.trip.n_frames > 0 {
                self.trip.add_health(&self.sources[index].topics, &health)?;
            }
        }
        Ok(())
    }

    fn take_frame(&mut self, index: usize, frame: &Frame) -> Result<(), Failure> {
        let source = &mut self.sources[index];
        let header = frame.header();
        let layout = layout_of(header);
        let n_readings = frame.counts().len();
        if layout.n_readings() != n_readings {
            // One bad frame must not cost the whole trip. It is counted among the lost, as a gap.
            if source.refused_run.replace(header.run) != Some(header.run) {
                eprintln!(
                    "kinds: frames that have {n_readings} readings but say {} × {} are left out; their driver shim is at fault",
                    layout.rows, layout.columns
                );
            }
            return Ok(());
        }
        let losses = &mut self.trip.parts[index].losses;
        if let Some((run, sequence)) = source.last_frame.replace((header.run, header.sequence))
            && run == header.run
        {
            losses.n_lost += header.sequence.saturating_sub(sequence).saturating_sub(1);
        }
        self.last_taken = Instant::now();
        if self.is_paused {
            losses.n_left_out += 1;
            return Ok(());
        }
        if self.only_novel {
            if source.waiting.len() == N_WAITING_MAX {
                source.waiting.pop_front();
            }
            source.waiting.push_back(Taken { header: *header, layout, counts: frame.counts().to_vec() });
            return Ok(());
        }
        self.write_frame(index, header, layout, frame.counts())
    }

    fn write_frame(
        &mut self,
        index: usize,
        header: &FrameHeader,
        layout: FrameLayout,
        counts: &[u16],
    ) -> Result<(), Failure> {
        if let Some(expected) = self.trip.parts[index].layout.filter(|expected| *expected != layout) {
            if !self.destination.is_folder() {
                return Err(Failure::CouldNot(format!(
                    "cannot record frames of {layout} after frames of {expected}: one trip is of one sensor"
                )));
            }
            self.begin_another_trip()?;
        }
        self.n_frames += 1;
        self.trip.add_frame(index, &self.sources[index].topics, header, layout, counts)
    }

    /// Takes kinds of frames that are in this trip or the one before; a late joiner's first report may be of one that is in
    /// none.
    fn take_report(&mut self, index: usize, report: &KindReport) -> Result<(), Failure> {
        let source = &mut self.sources[index];
        let is_taken =
            source.last_frame.is_some_and(|(run, sequence)| run == report.run && report.sequence <= sequence);
        if !is_taken {
            return Ok(());
        }
        source.last_report = Some((report.run, report.sequence));
        self.last_taken = Instant::now();
        if self.is_paused {
            return Ok(());
        }
        if self.only_novel {
            let id = (report.run, report.sequence);
            let Some(at) = source.waiting.iter().position(|frame| frame.id() == id) else { return Ok(()) };
            // Those before it will not be reported any more.
            source.waiting.drain(..at);
            let Some(Taken { header, layout, counts }) = source.waiting.pop_front() else { return Ok(()) };
            if report.status() != ReportStatus::Classified || report.novelty < 1.0 - FALSE_ALARM_RATE {
                return Ok(());
            }
            self.write_frame(index, &header, layout, &counts)?;
        }
        self.trip.add_report(&self.sources[index].topics, report)
    }

    /// Whether all frames that were asked for are there, and the report on the last of each sensor that somebody reports on.
    fn is_complete(&self, n_frames_max: u64) -> Result<bool, Failure> {
        if self.n_frames < n_frames_max {
            return Ok(false);
        }
        if self.only_novel || self.last_taken.elapsed() >= SILENCE {
            return Ok(true);
        }
        for source in &self.sources {
            if !source.is_reported()? {
                return Ok(false);
            }
        }
        Ok(true)
    }

    fn flush(&mut self) -> Result<(), Failure> {
        if !self.is_paused {
            self.trip.flush(&self.sources)?;
            if self.trip.is_full(&self.limits)? {
                self.begin_another_trip()?;
            }
        }
        self.look_for_room()
    }

    fn begin_another_trip(&mut self) -> Result<(), Failure> {
        let path = self.destination.path_at(ns_since_epoch(), Some(&self.trip.path))?;
        let next = Recording::begin(path, self.sources.len())?;
        let ended = std::mem::replace(&mut self.trip, next);
        self.n_trips_ended += 1;
        mention(ended.end(&self.sources)?)?;
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
            let n_left_out = self.trip.losses().n_left_out;
            log::notice(format!(
                "recording into {path} goes on: {free_mb} MB are free there; {n_left_out} frames were left out"
            ));
        }
        Ok(())
    }

    /// How the trip fares, for a supervisor.
    fn status(&self) -> String {
        let sensors: Vec<&str> = self.sources.iter().map(|source| source.sensor.as_str()).collect();
        let (path, n_frames, n_lost) =
            (self.trip.path.display(), self.trip.n_frames, self.trip.losses().n_lost);
        let paused = if self.is_paused { "; paused for want of room" } else { "" };
        format!("{} into {path}: {n_frames} frames, {n_lost} lost{paused}", sensors.join(","))
    }

    fn end(self) -> Result<(), Failure> {
        let Self { destination, limits, only_novel, sources, trip, n_trips_ended, .. } = self;
        if trip.n_frames > 0 {
            let path = trip.path.clone();
            mention(trip.end(&sources)?)?;
            return match limits.n_kept {
                // The one that has just been recorded is one of them.
                Some(n_kept) => destination.keep_last(n_kept - 1, &path),
                None => Ok(()),
            };
        }
        let path = trip.path.display();
        match (n_trips_ended, trip.losses().n_left_out) {
            (0, 0) if only_novel => Err(Failure::CouldNot(format!(
                "no frame came that was called novel, so {path} was not written"
            ))),
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

/// What a trip has of one sensor.
#[derive(Clone, Copy, Default)]
struct Part {
    layout: Option<FrameLayout>,
    losses: Losses,
    /// What the file says of them.
    losses_written: Losses,
    /// The latest frame that was written.
    last: Option<Stamp>,
}

/// A trip being recorded. Dropped before its end, it leaves nothing behind.
struct Recording {
    path: PathBuf,
    file: TripFile,
    n_frames: u64,
    n_reports: u64,
    /// One of each sensor.
    parts: Vec<Part>,
    /// When the first frame was written.
    began: Option<Instant>,
}

impl Recording {
    fn begin(path: PathBuf, n_sensors: usize) -> Result<Self, Failure> {
        let file = TripFile::create(&path)?;
        Ok(Self {
            path,
            file,
            n_frames: 0,
            n_reports: 0,
            parts: vec![Part::default(); n_sensors],
            began: None,
        })
    }

    fn add_frame(
        &mut self,
        index: usize,
        topics: &Topics,
        header: &FrameHeader,
        layout: FrameLayout,
        counts: &[u16],
    ) -> Result<(), Failure> {
        let capture = Capture::of(header);
        self.file.add_frame(topics, layout, counts, &capture)?;
        self.began.get_or_insert_with(Instant::now);
        let part = &mut self.parts[index];
        (part.layout, part.last) = (Some(layout), Some(capture.captured));
        self.n_frames += 1;
        Ok(())
    }

    fn add_report(&mut self, topics: &Topics, report: &KindReport) -> Result<(), Failure> {
        if report.status() == ReportStatus::Classified {
            self.file.add_kinds(topics, Stamp(report.captured_ns), report.probabilities())?;
            self.n_reports += 1;
        }
        Ok(())
    }

    fn add_health(&mut self, topics: &Topics, health: &HealthReport) -> Result<(), Failure> {
        Ok(self.file.add_health(topics, Stamp(ns_since_epoch()), health)?)
    }

    /// Of all sensors together.
    fn losses(&self) -> Losses {
        self.parts.iter().fold(Losses::default(), |sum, part| Losses {
            n_lost: sum.n_lost + part.losses.n_lost,
            n_left_out: sum.n_left_out + part.losses.n_left_out,
        })
    }

    /// Brings everything so far to where a crash, and soon a power cut, cannot take it.
    fn flush(&mut self, sources: &[Source]) -> Result<(), Failure> {
        self.add_losses(sources)?;
        self.file.flush()?;
        self.file.sync().map_err(|error| Failure::file("write", &self.path, &error))
    }

    /// Says in the file what is missing, if that has changed: whoever finds only the file knows.
    fn add_losses(&mut self, sources: &[Source]) -> Result<(), Failure> {
        for (part, source) in self.parts.iter_mut().zip(sources) {
            let Some(last) = part.last else { continue };
            if part.losses != part.losses_written {
                let Losses { n_lost, n_left_out } = part.losses;
                self.file.add_losses(&source.topics, last, n_lost, n_left_out)?;
                part.losses_written = part.losses;
            }
        }
        Ok(())
    }

    fn is_full(&self, limits: &Limits) -> Result<bool, Failure> {
        let Some(began) = self.began else { return Ok(false) };
        let n_bytes = self.file.n_bytes().map_err(|error| Failure::file("write", &self.path, &error))?;
        let is_large = limits.trip_bytes_max.is_some_and(|n_bytes_max| n_bytes >= n_bytes_max);
        Ok(is_large || limits.trip_duration_max.is_some_and(|duration_max| began.elapsed() >= duration_max))
    }

    fn end(mut self, sources: &[Source]) -> Result<String, Failure> {
        self.add_losses(sources)?;
        let Losses { n_lost, n_left_out } = self.losses();
        self.file.finish()?;
        let (n_frames, n_reports, path) = (self.n_frames, self.n_reports, self.path.display());
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
