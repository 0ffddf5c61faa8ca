//! Reads a whole trip into memory: what evaluation needs of it.

use std::path::{Path, PathBuf};

use kinds_trips::{Command, Selection, TripError};

use crate::progress::Progress;
use crate::survey::{Survey, survey};

/// The frames of a trip that have a valid reading.
#[derive(Clone, Debug)]
pub struct LoadedTrip {
    /// What is known of them.
    pub survey: Survey,
    /// Raw counts, shape `(n_frames, n_readings)`.
    pub counts: Vec<u16>,
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
    /// Another trip where one had been.
    #[error("trip {path} changed while it was read: {what}; train again once nothing writes to it")]
    Changed {
        /// The file.
        path: PathBuf,
        /// In what, in words.
        what: String,
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
    /// The frames' raw counts, each of shape `(n_readings,)`.
    pub fn frames(&self) -> impl Iterator<Item = &[u16]> {
        self.counts.chunks_exact(self.survey.layout.n_readings())
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
    let mut counts = Vec::new();
    let survey = survey(path, selection, progress, |frame| counts.extend_from_slice(frame))?;
    Ok(LoadedTrip { survey, counts })
}
