//! Trips of one sensor, surveyed before they are learnt from.

use std::path::PathBuf;

use kinds_model::{Command, Origin, SensorLayout};
use kinds_trips::Selection;

use crate::counts_seen::CountsSeen;
use crate::drop_outs::DropOuts;
use crate::load::of_model;
use crate::progress::Progress;
use crate::survey::survey;
use crate::track::Track;
use crate::train::TrainError;
use crate::trip_frames::{Digest, TripFrames};

/// What is known of trips, and their frames to be read.
pub(crate) struct SurveyedTrips {
    pub(crate) sensor: SensorLayout,
    pub(crate) origin: Origin,
    pub(crate) seen: CountsSeen,
    pub(crate) drop_outs: DropOuts,
    /// Of each frame.
    pub(crate) commands: Vec<Option<Command>>,
    pub(crate) tracks: Vec<Track>,
    pub(crate) frames: TripFrames,
    pub(crate) remarks: Vec<String>,
}

impl SurveyedTrips {
    /// Surveys at least one trip.
    ///
    /// * `model_sensor` — the sensor that they must be of, where a model is there
    /// * `need_commands` — whether frames are compared by them
    ///
    /// # Errors
    /// If a trip cannot be read, is of another sensor, or has no commands.
    pub(crate) fn survey(
        trips: &[PathBuf],
        selection: &Selection,
        model_sensor: Option<SensorLayout>,
        need_commands: bool,
        progress: &mut Progress,
    ) -> Result<Self, TrainError> {
        let mut remarks = Vec::new();
        let (mut sensor, mut origin) = (None, Origin::default());
        let (mut seen, mut commands, mut tracks) = (CountsSeen::default(), Vec::new(), Vec::new());
        let (mut drop_outs, mut frames) = (DropOuts::default(), TripFrames::new(selection.clone()));
        for path in trips {
            let mut digest = Digest::default();
            drop_outs.begin();
            let trip = survey(path, selection, progress, |frame| {
                seen.add(frame);
                digest.add(frame);
                drop_outs.add(frame);
            })?;
            frames.add(&trip, &digest);
            let found = trip.layout;
            if let Some(expected) = model_sensor.filter(|expected| *expected != found) {
                return Err(TrainError::OtherThanModel { path: path.clone(), found, expected });
            }
            let expected = *sensor.get_or_insert(found);
            if found != expected {
                return Err(TrainError::OtherSensor { path: path.clone(), found, expected });
            }
            if need_commands {
                trip.require_commands()?;
            }
            let name = path.file_name().unwrap_or(path.as_os_str());
            origin.trips.push(name.to_string_lossy().into_owned());
            origin.n_frames.push(trip.n_frames());
            origin.n_frames_invalid += trip.n_frames_invalid;
            tracks.push(Track::of(&trip));
            commands.extend(trip.commands.iter().map(|command| command.map(of_model)));
            remarks.extend(trip.remarks);
        }
        let sensor = sensor.expect("at least one trip is asked for on every way in");
        if origin.n_frames_invalid > 0 {
            remarks
                .push(format!("{} frames without any valid reading were left out", origin.n_frames_invalid));
        }
        Ok(Self { sensor, origin, seen, drop_outs, commands, tracks, frames, remarks })
    }
}
