//! From trips to a model, and how consistent its kinds are on further trips.
//!
//! [`train`] reads trips into a model; [`evaluate`] sends trips through it and measures whether a place seen again gets the
//! same kind. Nothing here opens shared memory or writes a file.
#![forbid(unsafe_code)]

mod agreement;
mod bootstrap;
mod comparison_choice;
mod config;
mod consistency;
mod counts_seen;
mod drift;
mod drop_outs;
mod evaluate;
mod landmark_number;
mod load;
mod meeting;
mod metric_choice;
mod places;
mod policy;
mod progress;
mod registration;
mod remarks;
pub mod report;
mod rivals;
mod runs;
mod scores;
mod segmentation;
mod sequence;
mod surface;
mod survey;
mod surveyed_trips;
mod topology;
mod track;
mod train;
mod trip_frames;
mod trip_kinds;
mod update;
mod uses;

pub use agreement::adjusted_mutual_information;
pub use comparison_choice::{ScaleChoice, WhiteningChoice, WhiteningChoiceError, kept_by_each};
pub use config::{CommandsConfig, Config, ConfigError, MethodChoice};
pub use consistency::{Consistency, Revisits, kappa};
pub use counts_seen::CountsSeen;
pub use drift::Drift;
pub use evaluate::{
    ClassifiedTrip, EvaluateError, Evaluation, EvaluationPlan, PairScores, evaluate, evaluate_single,
};
pub use landmark_number::{LandmarkNumber, LandmarkNumberError};
pub use load::{LoadError, LoadedTrip, load};
pub use meeting::{MeetingError, Meetings};
pub use metric_choice::{MetricChoice, MetricChoiceError, PartsError};
pub use places::{Places, SamePlace};
pub use policy::{
    CommandMode, CommandSpread, KindCommands, KindPolicy, Policy, PolicyCommand, PolicyTable, Spell,
};
pub use progress::{Progress, Stage};
pub use registration::{Jittered, RegistrationScores};
pub use rivals::{Methods, RivalError, Rivals};
pub use runs::Runs;
pub use scores::{Confidence, DirectedScores, KappaLead, MethodScores, Scores};
pub use segmentation::{
    KindDiffers, NameDiffers, SegmentFormat, Segmentation, SegmentationAgreement, SegmentationError,
};
pub use sequence::{RunLengths, Sequence};
pub use surface::{Grid, Surface};
pub use survey::Survey;
pub use topology::{Edge, Extent, MapPlan, MeanCommand, Region, TopologicalMap};
pub use track::Track;
pub use train::{PcaModels, TrainError, Trained, train};
pub use trip_kinds::TripKinds;
pub use update::{LearntFurther, learn_further};
pub use uses::Uses;
