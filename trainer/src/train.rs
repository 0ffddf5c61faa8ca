//! From trips to a model.

use std::path::PathBuf;

use kinds_model::{
    Command, CommandScale, Commands, FitError, MedianPlan, Method, Model, SensorLayout, Size, StreamError,
    fit_stream, refit,
};

use crate::comparison_choice;
use crate::config::{Config, ConfigError, MethodChoice};
use crate::drop_outs::DropOuts;
use crate::load::LoadError;
use crate::progress::{Progress, fitting};
use crate::remarks::{remark_on_islands, remarks_on_kinds};
use crate::surveyed_trips::SurveyedTrips;
use crate::track::Track;

/// A model, and what a person should know about how it came to be.
#[derive(Debug)]
pub struct Trained {
    /// The model.
    pub model: Model,
    /// The same frames by principal components, where both methods were asked for: then the model is Isomap's.
    pub pca: Option<PcaModels>,
    /// When and where the frames were taken, trip by trip.
    pub tracks: Vec<Track>,
    /// Sentences about the trips and the choices: cut off, invalid frames, islands, evidence that does not agree.
    pub remarks: Vec<String>,
}

/// What principal components make of the frames that an Isomap model was learnt from.
#[derive(Debug)]
pub struct PcaModels {
    /// With as many dimensions and kinds as were asked for, or as the evidence speaks for.
    pub own: Model,
    /// With as many as the Isomap model has, for a fair comparison. None where the frames have not as many principal
    /// components: a remark says so.
    pub matched: Option<Model>,
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
    /// A further trip of another sensor than the model's.
    #[error(
        "trip {path} has frames of {found}; those of the model are of {expected}; train one model for each sensor"
    )]
    OtherThanModel {
        /// The trip that differs.
        path: PathBuf,
        /// Its frames.
        found: SensorLayout,
        /// The model's.
        expected: SensorLayout,
    },
    /// The configuration.
    #[error(transparent)]
    Config(#[from] ConfigError),
    /// The mathematics.
    #[error("cannot train: {0}")]
    Fit(FitError),
    /// The mathematics of the second method.
    #[error("cannot train by principal components beside Isomap: {0}; ask for one method")]
    FitPca(FitError),
}

impl TrainError {
    pub(crate) fn of_fitting(error: StreamError<LoadError>) -> Self {
        match error {
            StreamError::Read(error) => Self::Load(error),
            StreamError::Fit(error) => Self::Fit(error),
        }
    }
}

/// Trains a model on the frames of one or more trips of one sensor.
///
/// Reads trips more than once and holds, of longer ones than the model keeps, four times the frames that it does: see
/// [`kinds_model::fit_stream`].
///
/// # Errors
/// If a trip cannot be read, trips differ in sensor, or their frames make no model of this configuration.
pub fn train(trips: &[PathBuf], config: &Config, progress: &mut Progress) -> Result<Trained, TrainError> {
    config.check()?;
    let need_commands = config.commands_weight().is_some();
    let surveyed = SurveyedTrips::survey(trips, &config.selection(), None, need_commands, progress)?;
    let SurveyedTrips { sensor, mut origin, seen, drop_outs, commands, tracks, mut frames, mut remarks } =
        surveyed;
    let mut plan = config.plan(sensor, &seen)?;
    if config.median.is_none() {
        plan.median = drop_outs.median();
        remarks.extend((plan.median != MedianPlan::Off).then(|| remark_on_drop_outs(&drop_outs)));
    }
    frames.pass(plan.median);
    let trips = origin.trips(seen.n_frames);
    let candidates = comparison_choice::candidates(config.response, config.whitening, &plan);
    if candidates.len() > 1
        && let Some((best, tried)) =
            comparison_choice::choose(&mut frames, &candidates, &trips, &plan, progress)?
    {
        (plan.response.scale, plan.whitening) = (best.scale, best.whitening);
        origin.comparisons_tried = tried;
    }
    let commands = config.commands_weight().map(|weight| {
        remarks.extend(remark_on_uncommanded(&commands));
        Commands { weight, of_frames: commands.into_iter().map(Option::unwrap_or_default).collect() }
    });
    let fitted = fit_stream(&mut frames, commands.as_ref(), &plan, origin, &mut fitting(progress));
    let model = fitted.map_err(TrainError::of_fitting)?;
    remarks.extend(model.commands().and_then(remark_on_commands));
    remarks.extend(remark_on_islands(&model));
    remarks.extend(remarks_on_kinds(&model));
    let pca = match config.method {
        Some(MethodChoice::Both) => Some(PcaModels::beside(&model, &mut remarks, progress)?),
        _ => None,
    };
    Ok(Trained { model, pca, tracks, remarks })
}

impl PcaModels {
    fn beside(
        isomap: &Model,
        remarks: &mut Vec<String>,
        progress: &mut Progress,
    ) -> Result<Self, TrainError> {
        let mut fitted = |size| refit(isomap, Method::Pca, size, &mut fitting(progress));
        let own = fitted(Size::Own).map_err(TrainError::FitPca)?;
        remarks.extend(remarks_on_kinds(&own).into_iter().map(of_pca));
        let matched = fitted(Size::Matched);
        match &matched {
            Ok(matched) => remarks.extend(remarks_on_kinds(matched).into_iter().map(of_pca)),
            Err(error) => remarks.push(of_pca(format!("none are of Isomap's size: {error}"))),
        }
        Ok(Self { own, matched: matched.ok() })
    }
}

fn remark_on_drop_outs(drop_outs: &DropOuts) -> String {
    format!(
        "{:.1} % of the readings are missing or far off for one frame alone: each reading is taken as the median of three frames, here \
         and where the model serves",
        100.0 * drop_outs.share()
    )
}

fn of_pca(remark: String) -> String {
    format!("principal components: {remark}")
}

/// That frames without a command, as before a trip's first, are of a robot that stands still.
pub(crate) fn remark_on_uncommanded(commands: &[Option<Command>]) -> Option<String> {
    let n_uncommanded = commands.iter().filter(|command| command.is_none()).count();
    (n_uncommanded > 0).then(|| {
        let n_frames = commands.len();
        format!("{n_uncommanded} of {n_frames} frames come before a trip's first command; there the robot is taken to stand still")
    })
}

/// Components that were always the same, and so tell no frames apart.
fn remark_on_commands(scale: &CommandScale) -> Option<String> {
    let (forward, turn) = (scale.forward, scale.turn);
    match (forward.varied(), turn.varied()) {
        (true, true) => None,
        (false, true) => Some(format!(
            "the commanded speed forward was always {} m/s and weighs nothing; frames are compared by the commanded turn alone",
            forward.least
        )),
        (true, false) => Some(format!(
            "the commanded turn was always {} rad/s and weighs nothing; frames are compared by the commanded speed alone",
            turn.least
        )),
        (false, false) => Some(format!(
            "the command was always {} m/s forward and {} rad/s of turn and weighs nothing; frames are compared by readings alone",
            forward.least, turn.least
        )),
    }
}

#[cfg(test)]
mod tests {
    use kinds_model::CommandColumn;

    use super::*;

    #[test]
    fn frames_without_a_command_are_told() {
        let told = Some(Command { forward_m_s: 0.5, turn_rad_s: 0.0 });
        assert_eq!(remark_on_uncommanded(&[told; 3]), None);
        assert_eq!(
            remark_on_uncommanded(&[None, None, told, told]).unwrap(),
            "2 of 4 frames come before a trip's first command; there the robot is taken to stand still"
        );
    }

    #[test]
    fn commands_that_tell_nothing_apart_are_told() {
        let remark = |forward: [f64; 2], turn: [f64; 2]| {
            let column = |[least, greatest]: [f64; 2]| CommandColumn { least, greatest, weight: 0 };
            remark_on_commands(&CommandScale { weight: 0.1, forward: column(forward), turn: column(turn) })
        };
        assert_eq!(remark([0.0, 0.5], [-1.0, 1.0]), None);
        assert_eq!(
            remark([0.5, 0.5], [-1.0, 1.0]).unwrap(),
            "the commanded speed forward was always 0.5 m/s and weighs nothing; frames are compared by the commanded turn alone"
        );
        assert_eq!(
            remark([0.0, 0.5], [0.0, 0.0]).unwrap(),
            "the commanded turn was always 0 rad/s and weighs nothing; frames are compared by the commanded speed alone"
        );
        assert_eq!(
            remark([0.5, 0.5], [-0.25, -0.25]).unwrap(),
            "the command was always 0.5 m/s forward and -0.25 rad/s of turn and weighs nothing; frames are compared by \
             readings alone"
        );
    }
}
