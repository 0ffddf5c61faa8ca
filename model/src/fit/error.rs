//! Why fitting ends without a model.

use crate::em::EmError;
use crate::mds::MdsError;
use crate::metric::MetricError;
use crate::response::ResponseError;

/// Why no model could be fitted.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum FitError {
    /// Too few frames for the neighbours.
    #[error(
        "{n_frames} frames are too few for {n_neighbors} neighbours each; ask for fewer neighbours or record a longer trip"
    )]
    TooFewFrames {
        /// Frames.
        n_frames: usize,
        /// Neighbours asked for.
        n_neighbors: usize,
    },
    /// Too few reference frames for the neighbours.
    #[error(
        "{n_frames} reference frames are too few for {n_neighbors} neighbours each; ask for fewer neighbours or keep more of \
         the {n_trained} frames"
    )]
    TooFewReferences {
        /// Reference frames asked for.
        n_frames: usize,
        /// Frames that these are chosen of.
        n_trained: usize,
        /// Neighbours asked for.
        n_neighbors: usize,
    },
    /// Something that must be at least one, or has a limit.
    #[error("{n} {what} were asked for; there must be between 1 and {limit}")]
    Count {
        /// What, in words.
        what: &'static str,
        /// How many.
        n: usize,
        /// How many at most.
        limit: usize,
    },
    /// Nothing to tell frames apart by.
    #[error("all {n_frames} frames are equal on the response's scale; there is nothing to tell kinds by")]
    AllEqual {
        /// Frames.
        n_frames: usize,
    },
    /// More than there is memory for.
    #[error(
        "{n_frames} reference frames of {n_columns} counts each, with {n_landmarks} landmarks, take {:.1} GB to fit, which this \
         machine does not have; ask for fewer reference frames or fewer landmarks",
        *n_bytes as f64 / 1e9
    )]
    NoRoom {
        /// Reference frames asked for, or all that there are.
        n_frames: usize,
        /// Counts in one.
        n_columns: usize,
        /// Landmarks among them.
        n_landmarks: usize,
        /// Bytes for both.
        n_bytes: usize,
    },
    /// Landmarks by means where there are none.
    #[error(
        "landmarks by k-means need means of frames, and frames that are compared at their nearest turn have none; choose \
         random landmarks or the farthest"
    )]
    NoMeans,
    /// Too many readings for a mixture over them.
    #[error(
        "native space is for sensors of at most {limit} readings and this one has {n_readings}: the full covariance of one kind \
         would have {n_readings}·{}/2 = {} parameters, and there are {n_frames} frames; use isomap",
        n_readings + 1,
        n_readings * (n_readings + 1) / 2
    )]
    NativeReadings {
        /// D.
        n_readings: usize,
        /// How many at most.
        limit: usize,
        /// Frames.
        n_frames: usize,
    },
    /// Another number of dimensions than readings.
    #[error(
        "native space has a dimension for each of the {n_readings} readings and {n_dims} were asked for; ask for no number, or use \
         isomap"
    )]
    NativeDims {
        /// D.
        n_readings: usize,
        /// Dimensions asked for.
        n_dims: usize,
    },
    /// A metric that would not be asked.
    #[error(
        "native space has no distances, so that kinds would not follow the metric: {metric}; use isomap or the euclidean metric"
    )]
    NativeMetric {
        /// The metric in words.
        metric: String,
    },
    /// Commands where there are no distances to weigh them by.
    #[error(
        "native space has no distances, so that kinds would not follow commands of weight {weight}; use isomap or pca, or a \
         commands weight of 0"
    )]
    NativeCommands {
        /// What was asked for.
        weight: f64,
    },
    /// No distances.
    #[error(transparent)]
    Metric(#[from] MetricError),
    /// Directions where distances are of another kind, or none.
    #[error(
        "slow directions have no rings and no weights, and native space no distances; use isomap or pca by the euclidean metric, or \
         no whitening"
    )]
    Whitened,
    /// Frames that do not span so many directions.
    #[error(
        "{n_directions} slow directions were asked for and the trip has fewer: its frames are too much alike, or too few follow \
         each other; ask for fewer"
    )]
    NoDirections {
        /// Directions asked for.
        n_directions: usize,
    },
    /// No scale.
    #[error(transparent)]
    Response(#[from] ResponseError),
    /// No coordinates.
    #[error(transparent)]
    Mds(#[from] MdsError),
    /// No kinds.
    #[error(transparent)]
    Em(#[from] EmError),
}
