//! `kinds replay`: a trip through shim, shared memory and service in lockstep, and whether anything has changed.

use std::cell::RefCell;
use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread;
use std::time::Duration;

use kinds_driver_shim::{Flow, Pace, Reading, Replay, Sensor, SensorError, Shim};
use kinds_messages::{ChannelError, Domain, KindReport, Node, ReportReader, SensorName};
use kinds_model::{Classifier, Model};
use kinds_service::Service;
use kinds_trips::{FrameLayout, TripReader};

use crate::cli::ReplayArguments;
use crate::commands::own_domain;
use crate::failure::Failure;
use crate::say::mention;
use crate::{csv, model_file, stop, whole_file};

/// Frames that differ which are shown in full.
const N_SHOWN: usize = 5;

pub(crate) fn run(arguments: &ReplayArguments) -> Result<(), Failure> {
    // Read before the work: a mistyped name should not cost it.
    let expected = arguments.expect.as_deref().map(read_expected).transpose()?;
    let model = Arc::new(model_file::open(&arguments.model)?);
    let trip = TripReader::open(&arguments.trip, &arguments.selection(model.layout().metres_per_count))?;
    let stop = stop::on_signals()?;
    let reports = replay(trip, Arc::clone(&model), &stop)?;
    if stop.load(Ordering::Relaxed) {
        return Err(Failure::CouldNot(format!("stopped after {} frames", reports.len())));
    }
    let found = Outcome::of(&reports);
    mention(format!(
        "replayed {} frames of {} with model {}",
        reports.len(),
        arguments.trip.display(),
        model.id()
    ))?;
    if let Some(path) = &arguments.bless {
        whole_file::write(path, found.text().as_bytes())
            .map_err(|error| Failure::file("write", path, &error))?;
        mention(format!("wrote {}", path.display()))?;
    }
    match expected {
        Some(expected) => expected.compare(&found),
        None => Ok(()),
    }
}

/// Publishes and serves a trip in a domain of its own, and returns every report.
///
/// Shim, shared memory and service are those of a robot, each end with its own node; only that both run here, in two
/// threads, so that a debugger sees all of it.
fn replay(trip: TripReader, model: Arc<Model>, stop: &AtomicBool) -> Result<Vec<KindReport>, Failure> {
    let domain = own_domain()?;
    let sensor: SensorName = "replay/trip".parse().expect("the name is as it should be");
    let all_published = AtomicBool::new(false);
    thread::scope(|scope| {
        let service = scope.spawn(|| -> Result<(), ChannelError> {
            let node = Node::open(&domain, "kinds-replay")?;
            Service::start(&node, &sensor, Classifier::new(model))?.run(&all_published).map(drop)
        });
        let reports = publish(&domain, &sensor, trip, stop);
        all_published.store(true, Ordering::Relaxed);
        service.join().expect("the service does not panic")?;
        reports
    })
}

fn publish(
    domain: &Domain,
    sensor: &SensorName,
    trip: TripReader,
    stop: &AtomicBool,
) -> Result<Vec<KindReport>, Failure> {
    let node = Node::open(domain, "kinds-replay")?;
    let collecting = Collecting {
        device: Replay::new(trip, Pace::AsFastAsFollowed),
        reader: ReportReader::open(&node, sensor)?,
        reports: Vec::new().into(),
    };
    let mut shim = Shim::new(&node, sensor, collecting, Flow::Followed)?;
    let summary = shim.run(stop, &mut |_| ())?;
    let collecting = shim.device();
    collecting.collect()?;
    let reports = collecting.reports.take();
    match summary.n_frames == reports.len() as u64 || stop.load(Ordering::Relaxed) {
        true => Ok(reports),
        false => Err(Failure::CouldNot(format!(
            "{} frames were published and {} reports came: the trip cannot be compared",
            summary.n_frames,
            reports.len()
        ))),
    }
}

/// A device that takes all reports there are before each frame. Followed, it never leaves more of them than there is
/// room for, however slow this process may be.
struct Collecting {
    device: Replay,
    reader: ReportReader,
    reports: RefCell<Vec<KindReport>>,
}

impl Collecting {
    fn collect(&self) -> Result<(), ChannelError> {
        while let Some(report) = self.reader.receive()? {
            self.reports.borrow_mut().push(report);
        }
        Ok(())
    }
}

impl Sensor for Collecting {
    fn layout(&self) -> FrameLayout {
        self.device.layout()
    }

    fn read(&mut self, counts: &mut [u16], timeout: Duration) -> Result<Reading, SensorError> {
        self.collect().map_err(|error| SensorError::Device(error.into()))?;
        self.device.read(counts, timeout)
    }
}

/// What a replay gives, as lines of a file that a person can compare: CSV, numbers with all their digits.
#[derive(Debug, PartialEq)]
struct Outcome {
    /// By frame: kind, and the whole line.
    frames: BTreeMap<u64, (String, String)>,
    titles: String,
}

impl Outcome {
    fn of(reports: &[KindReport]) -> Self {
        let n_kinds = reports.first().map_or(0, |report| report.probabilities().len());
        let frames =
            reports.iter().map(|report| (report.sequence, (report.kind.to_string(), line(report)))).collect();
        Self {
            frames,
            titles: format!(
                "sequence,status,kind,novelty,log_likelihood{},filtered_kind{}",
                csv::probability_titles('p', n_kinds),
                csv::probability_titles('f', n_kinds)
            ),
        }
    }

    fn text(&self) -> String {
        let lines = self.frames.values().map(|(_, line)| line);
        std::iter::once(&self.titles).chain(lines).map(|line| format!("{line}\n")).collect()
    }

    /// Reads what [`Self::text`] wrote. Fails with the number of the first line that it cannot have written.
    fn parse(text: &str) -> Result<Self, usize> {
        let mut lines = text.lines().enumerate();
        let (_, titles) =
            lines.next().filter(|(_, titles)| titles.starts_with("sequence,status,kind,")).ok_or(1_usize)?;
        let mut frames = BTreeMap::new();
        for (index, line) in lines {
            let mut fields = line.split(',');
            let sequence = fields.next().and_then(|field| field.parse().ok());
            let (Some(sequence), Some(kind)) = (sequence, fields.nth(1)) else { return Err(index + 1) };
            frames.insert(sequence, (kind.to_string(), line.to_string()));
        }
        Ok(Self { frames, titles: titles.to_string() })
    }

    /// Says what differs in what was found.
    fn compare(&self, found: &Self) -> Result<(), Failure> {
        let frames: BTreeSet<u64> = self.frames.keys().chain(found.frames.keys()).copied().collect();
        let differs = |sequence: &&u64| self.frames.get(sequence) != found.frames.get(sequence);
        let different: Vec<u64> = frames.iter().filter(differs).copied().collect();
        if different.is_empty() && self.titles == found.titles {
            mention(format!("as expected: {} frames, every digit", found.frames.len()))?;
            return Ok(());
        }
        mention(format!("  {}", found.titles))?;
        let mut moves: BTreeMap<(&str, &str), usize> = BTreeMap::new();
        for (shown, sequence) in different.iter().enumerate() {
            let [old, new] = [self, found].map(|outcome| outcome.frames.get(sequence));
            if shown < N_SHOWN {
                for (sign, frame) in [("-", old), ("+", new)] {
                    mention(format!("{sign} {}", frame.map_or("no such frame", |(_, line)| line)))?;
                }
            }
            let [old, new] = [old, new].map(|frame| frame.map_or("none", |(kind, _)| kind.as_str()));
            if old != new {
                *moves.entry((old, new)).or_default() += 1;
            }
        }
        for ((old, new), n_frames) in &moves {
            mention(format!("kind {old} → {new}: {n_frames} frames"))?;
        }
        let n_moved: usize = moves.values().sum();
        Err(Failure::CouldNot(format!(
            "{} of {} frames differ from what was expected, {n_moved} of them in kind",
            different.len(),
            frames.len()
        )))
    }
}

fn line(report: &KindReport) -> String {
    let (sequence, status, kind) = (report.sequence, report.status().name(), report.kind);
    let (novelty, log_likelihood) = (csv::number(report.novelty), csv::number(report.log_likelihood));
    let probabilities = csv::probabilities(report.probabilities());
    let (filtered_kind, filtered) = (report.filtered_kind, csv::probabilities(report.filtered()));
    format!("{sequence},{status},{kind},{novelty},{log_likelihood}{probabilities},{filtered_kind}{filtered}")
}

fn read_expected(path: &Path) -> Result<Outcome, Failure> {
    let text = std::fs::read_to_string(path).map_err(|error| Failure::file("read", path, &error))?;
    Outcome::parse(&text).map_err(|line| {
        Failure::CouldNot(format!(
            "{} holds no replay: line {line} is not one of its lines; write it with --bless",
            path.display()
        ))
    })
}
