//! How the program ends when it does not succeed.

use std::io;
use std::path::Path;
use std::process::ExitCode;

use kinds_driver_shim::ShimError;
use kinds_messages::ChannelError;
use kinds_model::FitError;
use kinds_trainer::{EvaluateError, LoadError, MeetingError, RivalError, TrainError};
use kinds_trips::{SalvageError, TripError, TripWriteError};

use crate::model_file::ModelFailure;

/// Why a command did not do what it was asked to.
#[derive(Debug, thiserror::Error)]
pub(crate) enum Failure {
    /// It could not: exit code 1.
    #[error("{0}")]
    CouldNot(String),
    /// It was asked for what cannot be: exit code 2, as for flags that there are not.
    #[error("{0}")]
    AskedWrongly(String),
    /// Whoever read our output closed it: no failure of ours.
    #[error("output closed")]
    OutputClosed,
}

impl Failure {
    pub(crate) fn exit_code(&self) -> ExitCode {
        match self {
            Self::OutputClosed => ExitCode::SUCCESS,
            Self::CouldNot(_) => ExitCode::from(1),
            Self::AskedWrongly(_) => ExitCode::from(2),
        }
    }

    /// A file that could not be used.
    pub(crate) fn file(attempt: &str, path: &Path, error: &io::Error) -> Self {
        match error.kind() {
            io::ErrorKind::NotFound => Self::CouldNot(format!(
                "cannot {attempt} {}: there is no such file or folder",
                path.display()
            )),
            _ => Self::CouldNot(format!("cannot {attempt} {}: {error}", path.display())),
        }
    }
}

/// Printing failed.
impl From<io::Error> for Failure {
    fn from(error: io::Error) -> Self {
        match error.kind() {
            io::ErrorKind::BrokenPipe => Self::OutputClosed,
            _ => Self::CouldNot(format!("cannot print: {error}")),
        }
    }
}

macro_rules! could_not {
    ($($error:ty),*) => {$(
        impl From<$error> for Failure {
            fn from(error: $error) -> Self {
                Self::CouldNot(error.to_string())
            }
        }
    )*};
}

could_not!(ChannelError, MeetingError, ModelFailure, RivalError, ShimError, TripWriteError);
#[cfg(feature = "bridge")]
could_not!(kinds_bridge::BridgeError);

impl From<TripError> for Failure {
    fn from(error: TripError) -> Self {
        match error {
            TripError::Unit { .. } => Self::AskedWrongly(error.to_string()),
            TripError::Damaged { .. } => {
                Self::CouldNot(format!("{error}; `kinds trips recover` saves what is whole of it"))
            }
            _ => Self::CouldNot(error.to_string()),
        }
    }
}

impl From<SalvageError> for Failure {
    fn from(error: SalvageError) -> Self {
        match error {
            SalvageError::Read(error) => error.into(),
            _ => Self::CouldNot(error.to_string()),
        }
    }
}

impl From<LoadError> for Failure {
    fn from(error: LoadError) -> Self {
        match error {
            LoadError::Trip(error) => error.into(),
            _ => Self::CouldNot(error.to_string()),
        }
    }
}

impl From<TrainError> for Failure {
    fn from(error: TrainError) -> Self {
        match error {
            TrainError::Load(error) => error.into(),
            TrainError::Config(_) | TrainError::Fit(FitError::Response(_)) => {
                Self::AskedWrongly(error.to_string())
            }
            TrainError::OtherSensor { .. }
            | TrainError::OtherThanModel { .. }
            | TrainError::Fit(_)
            | TrainError::FitPca(_) => Self::CouldNot(error.to_string()),
        }
    }
}

impl From<EvaluateError> for Failure {
    fn from(error: EvaluateError) -> Self {
        match error {
            EvaluateError::Limit { .. } => Self::AskedWrongly(error.to_string()),
            _ => Self::CouldNot(error.to_string()),
        }
    }
}
