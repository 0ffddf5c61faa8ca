//! Reads a whole trip into memory: what fitting and evaluation need of it.

use std::path::{Path, PathBuf};

use kinds_model::SensorLayout;
use kinds_model::response::INVALID;
use kinds_trips::{Command, Pose, Role, Selection, Stamp, TripError, TripReader};

use crate::progress::{Progress, Stage};

/// The frames of a trip that have a valid reading.
#[derive(Clone, Debug)]
pub struct LoadedTrip {
    /// The file.
    pub path: PathBuf,
    /// What its frames look like.
    pub layout: SensorLayout,
    /// Raw counts, shape `(n_frames, n_readings)`.
    pub counts: Vec<u16>,
    /// When the sensor captured each, shape `(n_frames,)`.
    pub captured: Vec<Stamp>,
    /// Where the robot was, shape `(n_frames,)`.
    pub poses: Vec<Option<Pose>>,
    /// What it had been told to do, shape `(n_frames,)`.
    pub commands: Vec<Option<Command>>,
    /// Frames left out because no reading was valid.
    pub n_frames_invalid: usize,
    /// That the recording was cut off, in words.
    pub truncation: Option<String>,
}

/// Why a trip cannot be read.
#[derive(Debug, thiserror::Error)]
pub enum LoadError {
    /// The recording.
    #[error(transparent)]
    Trip(#[from] TripError),
    /// Nothing to learn from.
    #[error("trip {path}: none of its {n_frames} frames has a valid reading")]
    AllInvalid {
        /// The file.
        path: PathBuf,
        /// Frames in it.
        n_frames: usize,
    },
    /// Nothing to compare beside readings.
    #[error(
        "trip {path} has no commands to compare frames by: no message of type {types} came at or before any of its {n_frames} \
         frames, or there are several such topics; name one with --commands-topic, record what the robot is told, or train with \
         a commands weight of 0"
    )]
    NoCommands {
        /// The file.
        path: PathBuf,
        /// The types of message that give commands.
        types: String,
        /// Frames in it.
        n_frames: usize,
    },
}

impl LoadedTrip {
    /// Number of frames kept.
    pub fn n_frames(&self) -> usize {
        self.poses.len()
    }

    /// The kept frames' raw counts, each of shape `(n_readings,)`.
    pub fn frames(&self) -> impl Iterator<Item = &[u16]> {
        self.counts.chunks_exact(self.layout.n_readings())
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
}

/// A trip's command as models compare it.
pub(crate) fn of_model(command: Command) -> kinds_model::Command {
    let Command { forward_m_s, turn_rad_s } = command;
    kinds_model::Command { forward_m_s, turn_rad_s }
}

/// Reads a trip.
///
/// Holds all frames: 40 MB for 1000 frames of 19840 readings.
///
/// # Errors
/// If the recording cannot be read, or no frame has a valid reading.
pub fn load(path: &Path, selection: &Selection, progress: &mut Progress) -> Result<LoadedTrip, LoadError> {
    let mut reader = TripReader::open(path, selection)?;
    let layout = reader.layout();
    let layout = SensorLayout {
        rows: layout.rows,
        columns: layout.columns,
        metres_per_count: layout.metres_per_count,
    };
    let n_readings = layout.n_readings();
    let (mut counts, mut poses, mut n_frames_invalid) = (Vec::new(), Vec::new(), 0);
    let (mut captured, mut commands) = (Vec::new(), Vec::new());
    loop {
        let start = counts.len();
        counts.resize(start + n_readings, INVALID);
        let Some(frame) = reader.next_frame(&mut counts[start..])? else {
            counts.truncate(start);
            break;
        };
        if counts[start..].iter().all(|&count| count == INVALID) {
            counts.truncate(start);
            n_frames_invalid += 1;
        } else {
            captured.push(frame.captured);
            poses.push(frame.pose);
            commands.push(frame.command);
        }
        let (read, all) = reader.progress();
        progress(Stage::Reading(path), read, all);
    }
    if poses.is_empty() {
        return Err(LoadError::AllInvalid { path: path.to_path_buf(), n_frames: n_frames_invalid });
    }
    let truncation = reader.truncation().map(|truncation| format!("trip {} {truncation}", path.display()));
    Ok(LoadedTrip {
        path: path.to_path_buf(),
        layout,
        counts,
        captured,
        poses,
        commands,
        n_frames_invalid,
        truncation,
    })
}
