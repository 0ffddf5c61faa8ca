//! From trips to a model, and how consistent its kinds are on further trips.
//!
//! [`train`] reads trips into a model; [`evaluate`] sends two trips through it and measures whether a place seen
//! again gets the same kind. Nothing here opens shared memory or writes a file.
#![forbid(unsafe_code)]

mod agreement;
mod config;
mod consistency;
mod evaluate;
mod landmark_number;
mod load;
mod metric_choice;
mod progress;
mod remarks;
pub mod report;
mod runs;
mod topology;
mod track;
mod train;
mod trip_kinds;

pub use agreement::adjusted_mutual_information;
pub use config::{CommandsConfig, Config, ConfigError, MethodChoice};
pub use consistency::{Consistency, Places, Revisits, kappa};
pub use evaluate::{
    EvaluateError, Evaluation, EvaluationPlan, Meeting, MethodScores, Methods, Rivals, evaluate,
};
pub use landmark_number::{LandmarkNumber, LandmarkNumberError};
pub use load::{LoadError, LoadedTrip, load};
pub use metric_choice::{MetricChoice, MetricChoiceError};
pub use progress::{Progress, Stage};
pub use runs::Runs;
pub use topology::{Edge, Extent, MapPlan, MeanCommand, Region, TopologicalMap};
pub use track::Track;
pub use train::{PcaModels, TrainError, Trained, train};
pub use trip_kinds::TripKinds;
