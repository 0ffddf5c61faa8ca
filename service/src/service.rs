//! The loop that serves one sensor.

use std::path::Path;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

use kinds_messages::{
    ChannelError, FRAME_BUFFER, Frame, FrameHeader, FrameReader, HealthPublisher, HealthReport, KindReport,
    MAX_DIMS, MAX_KINDS, Node, ReloadDesk, ReportPublisher, ReportStatus, SensorName, Waiting, monotonic_ns,
};
use kinds_model::response::INVALID;
use kinds_model::{
    Classification, Command, Filter, MedianFilter, N_DIMS_MAX, N_KINDS_MAX, SensorLayout, Status,
};

use crate::Classify;
use crate::conditions::Conditions;
use crate::drift::DriftWindow;
use crate::health::Health;
use crate::refusal::{Refusal, Refusals};
use crate::reload::{OpenModel, Opened, Reloads};
use crate::sequence::{Place, Sequence};

// Whatever a model says fits in a report.
const _: () = assert!(N_KINDS_MAX <= MAX_KINDS && N_DIMS_MAX <= MAX_DIMS);

/// Longest time between two looks at the stop flag, and shortest between two at who has come and gone: frames do not pay for it.
const TICK: Duration = Duration::from_millis(100);
/// Polls between two looks at the clock, so that a poll does not pay for what is done once a tick.
const POLLS_PER_LOOK: u32 = 256;
/// How often what killed programs left is looked for.
const CLEAN_UP_PERIOD: Duration = Duration::from_secs(2);

/// Said once of every run. A robot that nobody has told anything yet does stand still, and should not be without kinds until
/// somebody does; of a driver shim that does not know commands its integrator should hear.
const UNCOMMANDED: &str = "frames have no command, and the model compares commands beside readings; until one comes the \
                           robot is taken to stand still";

/// Who is told of every health report.
type HealthListener = dyn FnMut(&HealthReport);

/// Serves one sensor with one model.
pub struct Service<C> {
    node: Node,
    sensor: SensorName,
    frames: FrameReader,
    reports: ReportPublisher,
    health_reports: HealthPublisher,
    classifier: C,
    /// What frames pass before they are classified. Of the run that the last report is on, like the filter.
    median: Option<MedianFilter>,
    filter: Filter,
    drift: DriftWindow,
    layout: SensorLayout,
    waiting: Waiting,
    sequence: Sequence,
    refusals: Refusals,
    /// Filled anew for every frame.
    report: KindReport,
    summary: Summary,
    health: Health,
    conditions: Conditions,
    /// Told of every health report.
    listener: Option<Box<HealthListener>>,
    /// None where the model stays.
    reloads: Option<Reloads<C>>,
    shim_is_there: bool,
    last_clean_up: Instant,
    /// The last run of which it was said that its frames have no command.
    uncommanded_run: Option<u64>,
}

/// What a service did.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Summary {
    /// Frames that came.
    pub n_frames: u64,
    /// Of these, classified and reported.
    pub n_classified: u64,
    /// Of these, reported as invalid.
    pub n_invalid: u64,
    /// Of these, come twice or out of order, and left alone.
    pub n_repeated: u64,
    /// Of these, not for the model.
    pub n_refused: u64,
    /// Frames that never came, by the gaps in their sequence.
    pub n_lost: u64,
    /// Of those classified, compared by commands and without one: taken as of a robot that stands still.
    pub n_uncommanded: u64,
}

impl<C: Classify> Service<C> {
    /// Opens both channels of a sensor.
    ///
    /// Fails when another service serves this sensor. The frames channel is opened before the kinds channel: a driver
    /// shim that sees a service may rely on its frames' being received.
    pub fn start(node: &Node, sensor: &SensorName, classifier: C) -> Result<Self, ChannelError> {
        Self::start_with(node, sensor, classifier, Waiting::ByEvent)
    }

    /// The same for a service that may look for frames in another way than by event.
    pub fn start_with(
        node: &Node,
        sensor: &SensorName,
        classifier: C,
        waiting: Waiting,
    ) -> Result<Self, ChannelError> {
        let frames = FrameReader::open_with(node, sensor, waiting)?;
        let reports = ReportPublisher::create(node, sensor)?;
        let health_reports = HealthPublisher::create(node, sensor)?;
        let shim_is_there = frames.is_published();
        let mut report = KindReport::default();
        classifier.introduce(&mut report);
        let mut service = Self {
            node: node.clone(),
            sensor: sensor.clone(),
            frames,
            reports,
            health_reports,
            layout: classifier.layout(),
            median: classifier.median(),
            filter: classifier.filter(),
            drift: classifier.drift(),
            classifier,
            waiting,
            sequence: Sequence::new(shim_is_there),
            refusals: Refusals::default(),
            report,
            summary: Summary::default(),
            health: Health::new(),
            conditions: Conditions::new(sensor),
            listener: None,
            reloads: None,
            shim_is_there,
            last_clean_up: Instant::now(),
            uncommanded_run: None,
        };
        // For who looks before the first second is over.
        service.tell_health()?;
        Ok(service)
    }

    /// Tells a function of every health report, as it goes out on the channel: in the loop, so it must not wait.
    pub fn listen_to_health(&mut self, listener: impl FnMut(&HealthReport) + 'static) {
        self.listener = Some(Box::new(listener));
    }

    /// Serves until `stop` is set, then serves the frames that wait already, and ends.
    ///
    /// Sees the flag after 100 ms at most, or at once when a signal sets it or when it polls. Returns what was done since the start.
    pub fn run(&mut self, stop: &AtomicBool) -> Result<Summary, ChannelError> {
        if !self.shim_is_there {
            tracing::info!(sensor = %self.sensor, condition = "no shim", "waiting for a driver shim to publish this sensor");
        }
        let mut last_tick = Instant::now();
        let mut n_turns = 0_u32;
        loop {
            // Read before serving: frames that were sent before the flag was set are served.
            let stopping = stop.load(Ordering::Relaxed);
            let n_served = self.serve_waiting()?;
            if stopping {
                return Ok(self.summary);
            }
            n_turns = n_turns.wrapping_add(1);
            let looks = self.waiting == Waiting::ByEvent || n_turns.is_multiple_of(POLLS_PER_LOOK);
            if looks && last_tick.elapsed() >= TICK {
                last_tick = Instant::now();
                self.tick()?;
            }
            match self.waiting {
                Waiting::Polling => std::hint::spin_loop(),
                Waiting::ByEvent if n_served < FRAME_BUFFER => {
                    self.frames.wait(TICK.saturating_sub(last_tick.elapsed()))?;
                }
                Waiting::ByEvent => {}
            }
        }
    }

    /// All that is not for a frame.
    fn tick(&mut self) -> Result<(), ChannelError> {
        if self.last_clean_up.elapsed() >= CLEAN_UP_PERIOD {
            self.clean_up();
            self.last_clean_up = Instant::now();
        }
        self.reports.update()?;
        self.health_reports.update()?;
        self.look_for_shim();
        self.look_for_model();
        if self.health.is_due() {
            self.tell_health()?;
        }
        Ok(())
    }

    /// Removes what killed programs left, and says so: each time, since it never ends.
    fn clean_up(&mut self) {
        let n_peers = self.node.clean_up_dead_nodes();
        if n_peers > 0 {
            self.health.count_lost_peers(n_peers);
            tracing::info!(sensor = %self.sensor, n_peers, "cleaned up after programs that were killed");
        }
    }

    fn tell_health(&mut self) -> Result<(), ChannelError> {
        let drift = self.drift.drift(monotonic_ns());
        let health = self.health.end_interval(&self.summary, self.report.model_id, self.shim_is_there, drift);
        self.conditions.tell(health);
        if let Some(listener) = &mut self.listener {
            listener(health);
        }
        self.health_reports.send(health)
    }

    /// Serves the frames that wait, but at most a buffer full, so that a fast driver shim cannot keep us from the rest
    /// of the loop.
    fn serve_waiting(&mut self) -> Result<usize, ChannelError> {
        for n_served in 0..FRAME_BUFFER {
            let Some(frame) = self.frames.receive()? else { return Ok(n_served) };
            self.serve(&frame, monotonic_ns())?;
        }
        Ok(FRAME_BUFFER)
    }

    fn serve(&mut self, frame: &Frame, received_monotonic_ns: u64) -> Result<(), ChannelError> {
        let header = *frame.header();
        self.summary.n_frames += 1;
        if let Some(refusal) = Refusal::of(frame, self.layout) {
            self.summary.n_refused += 1;
            self.refusals.say_once(&self.sensor, header.run, refusal);
            return Ok(());
        }
        let Place::New { n_lost } = self.sequence.take(header.run, header.sequence) else {
            self.summary.n_repeated += 1;
            return Ok(());
        };
        self.summary.n_lost = self.summary.n_lost.saturating_add(n_lost);
        let command = command_of(&header);
        let is_uncommanded = command.is_none() && self.classifier.compares_commands();
        if self.report.run != header.run {
            self.begin_run(header.run);
        }
        let counts = passed(&mut self.median, frame.counts());
        let classification = self.classifier.classify(counts, command);
        match classification.status {
            Status::Classified => self.summary.n_classified += 1,
            Status::Invalid => self.summary.n_invalid += 1,
        }
        if is_uncommanded && classification.status == Status::Classified {
            self.summary.n_uncommanded += 1;
            if self.uncommanded_run.replace(header.run) != Some(header.run) {
                tracing::warn!(sensor = %self.sensor, condition = "uncommanded", "{UNCOMMANDED}");
            }
        }
        let report = &mut self.report;
        report.sequence = header.sequence;
        report.n_lost = n_lost;
        report.captured_ns = header.captured_ns;
        report.sent_monotonic_ns = header.sent_monotonic_ns;
        report.received_monotonic_ns = received_monotonic_ns;
        fill(report, classification, &mut self.filter);
        report.reported_monotonic_ns = self.reports.send(report)?;
        let is_novel = self.classifier.is_novel(report.novelty);
        self.health.count(report, is_novel);
        if report.status() == ReportStatus::Classified {
            self.count_drift(received_monotonic_ns, is_novel);
        }
        Ok(())
    }

    /// Of the frame of the last report, when nobody waits for that any more.
    fn count_drift(&mut self, now_ns: u64, is_novel: bool) {
        let Self { drift, report, classifier, .. } = self;
        drift.count(now_ns, report.probabilities(), report.filtered_kind, is_novel);
        if drift.is_measured(now_ns)
            && let Some(error) = classifier.half_split_error()
        {
            drift.measure(now_ns, error);
        }
    }

    /// Forgets the frames before.
    fn begin_run(&mut self, run: u64) {
        if let Some(median) = &mut self.median {
            median.begin();
        }
        self.filter.begin();
        (self.report.run, self.report.n_filtered) = (run, 0);
    }

    /// Takes a model into use that was asked for and is ready.
    fn look_for_model(&mut self) {
        let Some(reloads) = &mut self.reloads else { return };
        let Some(Opened { request, path, result }) = reloads.look(&self.sensor) else { return };
        self.health.count_reload(result.is_ok());
        let exchanged = result.map(|(classifier, replaced)| {
            let before = std::mem::replace(&mut self.classifier, classifier);
            let ids = [before.model_id(), self.classifier.model_id()];
            replaced.take(before);
            self.classifier.introduce(&mut self.report);
            self.median = self.classifier.median();
            self.drift = self.classifier.drift();
            (self.filter, self.report.n_filtered) = (self.classifier.filter(), 0);
            ids.map(|id| id.to_string())
        });
        reloads.answer(&self.sensor, request, path, exchanged);
    }

    fn look_for_shim(&mut self) {
        let is_there = self.frames.is_published();
        if is_there != self.shim_is_there {
            self.shim_is_there = is_there;
            let sensor = &self.sensor;
            if is_there {
                tracing::info!(%sensor, condition = "no shim", "a driver shim publishes this sensor");
            } else {
                tracing::info!(%sensor, condition = "no shim", "the driver shim is gone; waiting for another to publish this sensor");
            }
        }
    }
}

impl<C: Classify + Send + 'static> Service<C> {
    /// Lets the model be changed while frames are served: by whoever asks through the sensor's reload channel
    /// ([`ReloadAsker`](kinds_messages::ReloadAsker)), and by a flag.
    ///
    /// A model that cannot be opened, or is for another sensor, is refused in words, and the one in use stays.
    ///
    /// * `path` — the file of the model in use
    /// * `open` — opens another and makes it ready
    /// * `asked` — set it to ask for the file of the model in use to be read again
    pub fn accept_reloads(
        &mut self,
        path: &Path,
        open: Arc<OpenModel<C>>,
        asked: Arc<AtomicBool>,
    ) -> Result<(), ChannelError> {
        let desk = ReloadDesk::open(&self.node, &self.sensor)?;
        self.reloads = Some(Reloads::new(desk, path, self.layout, open, asked));
        Ok(())
    }
}

/// A frame as it is classified. One without any valid reading tells nothing, and passes by.
fn passed<'a>(median: &'a mut Option<MedianFilter>, counts: &'a [u16]) -> &'a [u16] {
    match median {
        Some(median) if counts.iter().any(|&count| count != INVALID) => median.take(counts),
        _ => counts,
    }
}

/// What the robot had been told, where the frame says so in numbers.
fn command_of(header: &FrameHeader) -> Option<Command> {
    let command = header.known_command()?;
    let (forward_m_s, turn_rad_s) = (command.forward_m_s, command.turn_rad_s);
    (forward_m_s.is_finite() && turn_rad_s.is_finite()).then_some(Command { forward_m_s, turn_rad_s })
}

/// * `report` — run, sequence and losses are the frame's
fn fill(report: &mut KindReport, classification: &Classification, filter: &mut Filter) {
    let told = match classification.status {
        Status::Classified => Some(&classification.probabilities[..]),
        Status::Invalid => None,
    };
    report.status = if told.is_some() { KindReport::CLASSIFIED } else { KindReport::INVALID };
    let filtered = filter.take(told, report.n_lost);
    report.set_probabilities(&classification.probabilities, filtered);
    report.filtered_kind = filter.kind() as u32;
    report.n_filtered = report.n_filtered.saturating_add(1);
    report.kind = classification.kind as u32;
    report.n_invalid = classification.n_invalid as u32;
    report.log_likelihood = classification.log_likelihood;
    report.novelty = classification.novelty;
    report.set_coordinates(&classification.coordinates);
}
