//! Reads a trip frame by frame.

use std::path::Path;
use std::time::Duration;

use crate::catalogue::{Catalogue, FrameTopics, Role, Topic, choose, choose_frames};
use crate::counts::Unit;
use crate::frame_message::read_frame;
use crate::lookahead::{Lookahead, Topics, encoding};
use crate::partner::{Partner, USUAL_TOLERANCE};
use crate::record::Record;
use crate::recording::{End, Recording};
use crate::{FrameInfo, FrameLayout, TripError, Truncation};

/// What is read of a trip.
#[derive(Debug, Clone, PartialEq)]
pub struct Selection {
    /// The topic with frames, or several that are joined, in the order of a frame's readings and with commas between them;
    /// `None`: the only one that fits, or all with single ranges if there is nothing better.
    pub frames_topic: Option<String>,
    /// Of several topics, how much older than the first one's frames those of the others may be.
    pub tolerance: Duration,
    /// The topic with poses; `None`: the only one that fits, if any.
    pub poses_topic: Option<String>,
    /// The topic with commands; `None`: the only one that fits, and none of several.
    pub commands_topic: Option<String>,
    /// Metres that one count stands for.
    pub metres_per_count: f64,
}

/// Topics by type, counts of a millimetre.
impl Default for Selection {
    fn default() -> Self {
        Self {
            frames_topic: None,
            tolerance: USUAL_TOLERANCE,
            poses_topic: None,
            commands_topic: None,
            metres_per_count: 0.001,
        }
    }
}

/// A trip being read: frames in the order of the recording, each with its pose and its command.
///
/// Holds one chunk of the recording, at most 256 frames that wait for the pose and the command after them (and at most
/// 32 MiB of these, but at least 4), the last 4096 poses and as many commands, and of each topic whose frames are joined with
/// another's the last [`Partner::n_frames_max`], however long the trip.
pub struct TripReader {
    recording: Recording,
    lookahead: Lookahead,
    layout: FrameLayout,
    tolerance: Duration,
    /// What stopped the reading, kept until the frames before it are taken.
    failure: Option<TripError>,
    no_more: bool,
    truncation: Option<Truncation>,
}

impl TripReader {
    /// Opens a trip and reads as far as its first frame.
    ///
    /// Without an index (a recording that was not closed, or whose writer made none) the whole file is read once, to
    /// find its topics; nothing of it is kept. Where several topics are joined, it is read once up to the first frame of each.
    ///
    /// # Errors
    ///
    /// No such file, not MCAP, no frames, several topics to choose from, a damaged beginning: see [`TripError`].
    pub fn open(path: &Path, selection: &Selection) -> Result<TripReader, TripError> {
        let metres_per_count = selection.metres_per_count;
        let unit = Unit::new(metres_per_count).ok_or(TripError::Unit { metres_per_count })?;
        let mut recording = Recording::open(path)?;
        let topics = topics(&mut recording, selection)?;
        let frames = choose_frames(path, &topics, selection.frames_topic.as_deref())?;
        let poses = choose(path, &topics, Role::Poses, selection.poses_topic.as_deref())?;
        let commands = choose(path, &topics, Role::Commands, selection.commands_topic.as_deref())?;
        let Some(frames) = frames else {
            return Err(TripError::NoFrames { path: path.to_owned(), topics });
        };
        let poses = poses.and_then(|topic| topic.key().pose_type().map(|of| (topic, of)));
        let commands = commands.and_then(|topic| topic.key().command_type().map(|of| (topic, of)));
        let layouts = match frames.0.len() {
            1 => vec![None],
            _ => layouts(&mut recording, &topics, &frames, unit)?,
        };
        let (path, wanted) = (path.to_owned(), Topics { frames, poses, commands });
        let mut lookahead = Lookahead::new(path, unit, wanted, layouts, selection.tolerance);
        let layout = loop {
            if let Some(layout) = lookahead.layout() {
                break layout;
            }
            match recording.next_record()? {
                Some(record) => lookahead.accept(&record)?,
                None => return Err(no_first_frame(&recording, topics)),
            }
        };
        Ok(TripReader {
            recording,
            lookahead,
            layout,
            tolerance: selection.tolerance,
            failure: None,
            no_more: false,
            truncation: None,
        })
    }

    /// How the readings of every frame lie, and their unit.
    pub fn layout(&self) -> FrameLayout {
        self.layout
    }

    /// The topic that frames come from; with commas between them if these are several.
    pub fn frames_topic(&self) -> String {
        self.lookahead.topics().frames.name()
    }

    /// How many frames were so far without one of another topic that is joined with them: none of it was captured at their
    /// time, or at most the tolerance before. By topic, without those of which that never was so.
    pub fn missing_partners(&self) -> Vec<(&str, u64)> {
        self.lookahead.missing_partners().map(|(topic, n_missing, _)| (topic, n_missing)).collect()
    }

    /// The topic that poses come from, if the trip has one.
    pub fn poses_topic(&self) -> Option<&str> {
        self.lookahead.topics().poses.as_ref().map(|(topic, _)| topic.name.as_str())
    }

    /// The topic that commands come from, if the trip has one.
    pub fn commands_topic(&self) -> Option<&str> {
        self.lookahead.topics().commands.as_ref().map(|(topic, _)| topic.name.as_str())
    }

    /// Reads the next frame; `None` at the end.
    ///
    /// * `counts` — `(n_readings,)`, counts; overwritten
    ///
    /// # Errors
    ///
    /// A message or frame that cannot be used, damage to the recording: once, after the frames before it; then the trip
    /// has ended. A recording that was cut off is no error: see [`truncation`](Self::truncation).
    ///
    /// # Panics
    ///
    /// If `counts` is not `layout().n_readings()` long.
    pub fn next_frame(&mut self, counts: &mut [u16]) -> Result<Option<FrameInfo>, TripError> {
        assert_eq!(counts.len(), self.layout.n_readings(), "a frame's buffer is as long as a frame");
        while !self.lookahead.is_ready(self.no_more) {
            if self.no_more {
                return self.failure.take().map_or(Ok(None), Err);
            }
            if let Err(failure) = self.read_on() {
                self.failure = Some(failure);
                self.no_more = true;
            }
        }
        Ok(Some(self.lookahead.take(counts)))
    }

    /// Whether the recording was cut off, known once the end was reached.
    pub fn truncation(&self) -> Option<&Truncation> {
        self.truncation.as_ref()
    }

    /// What else is to be said of the trip once its end was reached: each a sentence that begins where its name ends.
    pub fn remarks(&self) -> Vec<String> {
        let n_frames = self.lookahead.n_frames();
        let missing = |(topic, n_missing, partner): (&str, u64, &Partner)| {
            let what = match partner.is_indispensable() {
                true => "these are taken as invalid",
                false => "there its reading is taken as invalid",
            };
            format!(
                "has no frame of {topic} at the time of {n_missing} of its {n_frames} frames, or at most {} ms before; {what}",
                self.tolerance.as_secs_f64() * 1e3
            )
        };
        let truncation = self.truncation.iter().map(Truncation::to_string);
        truncation.chain(self.lookahead.missing_partners().map(missing)).collect()
    }

    /// Bytes of the file read so far, and bytes in the file.
    pub fn progress(&self) -> (u64, u64) {
        (self.recording.n_bytes_read(), self.recording.n_bytes())
    }

    fn read_on(&mut self) -> Result<(), TripError> {
        match self.recording.next_record()? {
            Some(record) => self.lookahead.accept(&record),
            None => {
                self.no_more = true;
                self.truncation = truncation(&self.recording, self.lookahead.n_frames());
                Ok(())
            }
        }
    }
}

/// The topics of a recording: from its summary, or by reading it through.
fn topics(recording: &mut Recording, selection: &Selection) -> Result<Vec<Topic>, TripError> {
    let path = recording.path().to_owned();
    let indexed = recording.catalogue()?;
    recording.rewind()?;
    if let Some(catalogue) = indexed {
        return Ok(catalogue.topics());
    }
    let mut catalogue = Catalogue::default();
    let failure = loop {
        match recording.next_record() {
            Ok(Some(record)) => catalogue.add(&record),
            Ok(None) => break None,
            Err(failure) => break Some(failure),
        }
    };
    let topics = catalogue.topics();
    let no_frames = match choose_frames(&path, &topics, selection.frames_topic.as_deref()) {
        Ok(chosen) => chosen.is_none(),
        Err(TripError::UnfitTopic { topic, .. }) => topic.n_messages == 0,
        Err(_) => false,
    };
    if no_frames {
        // Frames may have been where the recording ends too early: that, and not their absence, is to be told.
        if let Some(failure) = failure {
            return Err(failure);
        }
        if recording.end() == Some(End::CutOff) {
            return Err(no_first_frame(recording, topics));
        }
    }
    recording.rewind()?;
    Ok(topics)
}

/// What the frames of each of several topics look like, by its first.
fn layouts(
    recording: &mut Recording,
    topics: &[Topic],
    frames: &FrameTopics,
    unit: Unit,
) -> Result<Vec<Option<FrameLayout>>, TripError> {
    let path = recording.path().to_owned();
    let mut layouts = vec![None; frames.0.len()];
    let mut counts = Vec::new();
    while layouts.contains(&None) {
        let record = match recording.next_record()? {
            Some(record) => record,
            None => return Err(no_first_frame(recording, topics.to_vec())),
        };
        let Record::Message { channel_id, data, .. } = record else { continue };
        let index = frames.0.iter().position(|(topic, _)| topic.channel_ids.contains(&channel_id));
        let Some(index) = index.filter(|index| layouts[*index].is_none()) else { continue };
        let (topic, frame_type) = &frames.0[index];
        let head = read_frame(*frame_type, encoding(topic), data, unit, &mut counts);
        let fault =
            |fault| TripError::Message { path: path.clone(), topic: topic.name.clone(), number: 1, fault };
        layouts[index] = Some(head.map_err(fault)?.layout(unit));
    }
    recording.rewind()?;
    Ok(layouts)
}

/// Why there is no first frame, when the end has been reached.
fn no_first_frame(recording: &Recording, topics: Vec<Topic>) -> TripError {
    let path = recording.path().to_owned();
    match recording.end() {
        Some(End::CutOff) => TripError::CutOffBeforeFirstFrame {
            path,
            at_byte: recording.at_byte(),
            n_bytes: recording.n_bytes(),
        },
        _ => TripError::NoFrames { path, topics },
    }
}

fn truncation(recording: &Recording, n_frames: u64) -> Option<Truncation> {
    let data_is_whole = recording.end() == Some(End::Closed);
    (!data_is_whole || !recording.is_closed()).then(|| Truncation {
        at_byte: recording.at_byte(),
        n_bytes: recording.n_bytes(),
        n_frames,
        data_is_whole,
    })
}
