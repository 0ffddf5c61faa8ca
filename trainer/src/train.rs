//! From trips to a model.

use std::path::PathBuf;

use kinds_model::{FitError, Model, Origin, SensorLayout, fit};

use crate::config::{Config, ConfigError};
use crate::load::{LoadError, load};
use crate::progress::{Progress, fitting};

/// A model, and what a person should know about how it came to be.
#[derive(Debug)]
pub struct Trained {
    /// The model.
    pub model: Model,
    /// Sentences about the trips: cut off, invalid frames, islands.
    pub remarks: Vec<String>,
}

/// Why no model could be trained.
#[derive(Debug, thiserror::Error)]
pub enum TrainError {
    /// A trip could not be read.
    #[error(transparent)]
    Load(#[from] LoadError),
    /// Trips of different sensors.
    #[error(
        "trip {path} has frames of {found}; those of the trips before it are of {expected}; train one model for each sensor"
    )]
    OtherSensor {
        /// The trip that differs.
        path: PathBuf,
        /// Its frames.
        found: SensorLayout,
        /// The first trip's.
        expected: SensorLayout,
    },
    /// The configuration.
    #[error(transparent)]
    Config(#[from] ConfigError),
    /// The mathematics.
    #[error("cannot train: {0}")]
    Fit(FitError),
}

/// Trains a model on the frames of one or more trips of one sensor.
///
/// # Errors
/// If a trip cannot be read, trips differ in sensor, or their frames make no model of this configuration.
pub fn train(trips: &[PathBuf], config: &Config, progress: &mut Progress) -> Result<Trained, TrainError> {
    config.check()?;
    let selection = config.selection();
    let mut remarks = Vec::new();
    let (mut counts, mut sensor, mut n_frames_invalid) = (Vec::new(), None, 0);
    for path in trips {
        let mut trip = load(path, &selection, progress)?;
        let expected = *sensor.get_or_insert(trip.layout);
        if trip.layout != expected {
            return Err(TrainError::OtherSensor { path: path.clone(), found: trip.layout, expected });
        }
        remarks.extend(trip.truncation.take());
        n_frames_invalid += trip.n_frames_invalid;
        // The first trip's memory is kept: copying 20,000 camera frames would double it.
        if counts.is_empty() { counts = trip.counts } else { counts.append(&mut trip.counts) }
    }
    let sensor = sensor.expect("at least one trip is asked for on every way in");
    if n_frames_invalid > 0 {
        remarks.push(format!("{n_frames_invalid} frames without any valid reading were left out"));
    }
    let plan = config.plan(sensor, &counts)?;
    let names =
        trips.iter().filter_map(|path| path.file_name()).map(|name| name.to_string_lossy().into_owned());
    let origin = Origin { trips: names.collect(), n_frames_invalid };
    let model = fit(counts, &plan, origin, &mut fitting(progress)).map_err(TrainError::Fit)?;
    remarks.extend(remark_on_islands(&model));
    Ok(Trained { model, remarks })
}

fn remark_on_islands(model: &Model) -> Option<String> {
    let provenance = &model.manifest().provenance;
    let (islands, bridges) = (&provenance.islands, &provenance.bridges);
    if islands.len() < 2 {
        return None;
    }
    const N_NAMED: usize = 5;
    let list = |all: Vec<String>| {
        let more = all.len().saturating_sub(N_NAMED);
        let named = all.into_iter().take(N_NAMED).collect::<Vec<_>>().join(", ");
        if more > 0 { format!("{named} and {more} more") } else { named }
    };
    let sizes = list(islands.iter().map(usize::to_string).collect());
    let lengths = list(bridges.iter().map(|(_, _, length)| format!("{length:.0}")).collect());
    Some(format!(
        "neighbour graph has {} islands ({sizes} frames) at {} neighbours; joined by {} bridges of {lengths} counts; \
         raise the neighbours to avoid them",
        islands.len(),
        model.manifest().plan.n_neighbors,
        bridges.len(),
    ))
}
