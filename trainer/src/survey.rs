//! Surveys a trip: everything that is known of it but its frames, which are looked at one by one.

use std::path::{Path, PathBuf};

use kinds_model::SensorLayout;
use kinds_model::response::INVALID;
use kinds_trips::{Command, FrameInfo, Pose, Role, Selection, Stamp, TripError, TripReader};

use crate::load::LoadError;
use crate::progress::{Progress, Stage};

/// What is known of a trip's frames that have a valid reading, beside their counts.
#[derive(Clone, Debug)]
pub struct Survey {
    /// The file.
    pub path: PathBuf,
    /// What its frames look like.
    pub layout: SensorLayout,
    /// When the sensor captured each, shape `(n_frames,)`.
    pub captured: Vec<Stamp>,
    /// Where the robot was, shape `(n_frames,)`.
    pub poses: Vec<Option<Pose>>,
    /// What it had been told to do, shape `(n_frames,)`.
    pub commands: Vec<Option<Command>>,
    /// Frames left out because no reading was valid.
    pub n_frames_invalid: usize,
    /// That the recording was cut off, or that readings are missing, in words.
    pub remarks: Vec<String>,
}

impl Survey {
    /// Number of frames that have a valid reading.
    pub fn n_frames(&self) -> usize {
        self.captured.len()
    }

    /// For a model that compares commands.
    ///
    /// # Errors
    /// If no frame has one.
    pub fn require_commands(&self) -> Result<(), LoadError> {
        if self.commands.iter().any(Option::is_some) {
            return Ok(());
        }
        let (path, n_frames) = (self.path.clone(), self.n_frames());
        Err(LoadError::NoCommands { path, types: Role::Commands.types(), n_frames })
    }

    /// What to call the trip: its file's name, without folder and extension.
    pub(crate) fn title(&self) -> String {
        self.path.file_stem().unwrap_or_default().to_string_lossy().into_owned()
    }
}

/// Reads a trip, of which it holds one frame.
///
/// * `look` — at the raw counts of each frame that has a valid reading, shape `(n_readings,)`
///
/// # Errors
/// If the recording cannot be read, or no frame has a valid reading.
pub(crate) fn survey(
    path: &Path,
    selection: &Selection,
    progress: &mut Progress,
    mut look: impl FnMut(&[u16]),
) -> Result<Survey, LoadError> {
    let mut frames = ValidFrames::open(path, selection)?;
    let layout = frames.layout();
    let mut counts = vec![INVALID; layout.n_readings()];
    let (mut captured, mut poses, mut commands) = (Vec::new(), Vec::new(), Vec::new());
    while let Some(frame) = frames.next(&mut counts)? {
        look(&counts);
        captured.push(frame.captured);
        poses.push(frame.pose);
        commands.push(frame.command);
        let (read, all) = frames.reader.progress();
        progress(Stage::Reading(path), read, all);
    }
    let n_frames_invalid = frames.n_invalid;
    if captured.is_empty() {
        return Err(LoadError::AllInvalid { path: path.to_path_buf(), n_frames: n_frames_invalid });
    }
    let said = |remark| format!("trip {} {remark}", path.display());
    let remarks = frames.reader.remarks().into_iter().map(said).collect();
    Ok(Survey { path: path.to_path_buf(), layout, captured, poses, commands, n_frames_invalid, remarks })
}

/// The frames of a trip that have a valid reading.
pub(crate) struct ValidFrames {
    reader: TripReader,
    /// Frames passed over so far.
    n_invalid: usize,
}

impl ValidFrames {
    pub(crate) fn open(path: &Path, selection: &Selection) -> Result<Self, TripError> {
        Ok(Self { reader: TripReader::open(path, selection)?, n_invalid: 0 })
    }

    pub(crate) fn layout(&self) -> SensorLayout {
        let layout = self.reader.layout();
        SensorLayout { rows: layout.rows, columns: layout.columns, metres_per_count: layout.metres_per_count }
    }

    /// The next one; none at the end.
    ///
    /// * `counts` — raw counts, shape `(n_readings,)`; overwritten
    pub(crate) fn next(&mut self, counts: &mut [u16]) -> Result<Option<FrameInfo>, TripError> {
        loop {
            let frame = self.reader.next_frame(counts)?;
            if frame.is_none() || counts.iter().any(|&count| count != INVALID) {
                return Ok(frame);
            }
            self.n_invalid += 1;
        }
    }
}
