//! From a model and further trips to a model that has seen them all.

use std::path::PathBuf;

use kinds_model::{Command, Model, Updated, update};
use kinds_trips::Selection;

use crate::config::N_LANDMARKS_USUAL;
use crate::progress::{Progress, fitting};
use crate::remarks::{remark_on_islands, remarks_on_kinds};
use crate::surveyed_trips::SurveyedTrips;
use crate::train::{TrainError, remark_on_uncommanded};

/// A model that was learnt further, and what a person should know about it.
#[derive(Debug)]
pub struct LearntFurther {
    /// The model, and what became of its kinds.
    pub updated: Updated,
    /// Sentences about the trips and the choices.
    pub remarks: Vec<String>,
}

/// Learns a model further from the frames of one or more trips of its sensor: see [`kinds_model::update`].
///
/// * `selection` — what to read of the trips, in the unit of the model's sensor
///
/// # Errors
/// If a trip cannot be read, is of another sensor, or the frames make no model of its plan.
pub fn learn_further(
    model: &Model,
    trips: &[PathBuf],
    selection: &Selection,
    progress: &mut Progress,
) -> Result<LearntFurther, TrainError> {
    let compares_commands = model.commands().is_some();
    let surveyed =
        SurveyedTrips::survey(trips, selection, Some(model.layout()), compares_commands, progress)?;
    let SurveyedTrips { origin, commands, mut frames, mut remarks, .. } = surveyed;
    frames.pass(model.manifest().plan.median);
    let known = &model.manifest().provenance.origin.trips;
    remarks.extend(origin.trips.iter().filter(|name| known.contains(name)).map(|name| remark_on_known(name)));
    let commands: Option<Vec<Command>> = compares_commands.then(|| {
        remarks.extend(remark_on_uncommanded(&commands));
        commands.into_iter().map(Option::unwrap_or_default).collect()
    });
    let updated =
        update(model, &mut frames, commands.as_deref(), origin, N_LANDMARKS_USUAL, &mut fitting(progress));
    let updated = updated.map_err(TrainError::of_fitting)?;
    remarks.extend(remark_on_islands(&updated.model));
    remarks.extend(remarks_on_kinds(&updated.model));
    Ok(LearntFurther { updated, remarks })
}

/// That a trip may be learnt from a second time.
fn remark_on_known(name: &str) -> String {
    format!(
        "the model was learnt from a trip called {name} already; frames that are learnt twice count twice, and others are sooner \
         called novel"
    )
}
