//! Why bytes are no model.

use super::FORMAT;
use crate::metric::MetricError;
use crate::mixture::MixtureError;

/// Why bytes are not a model.
#[derive(Debug, thiserror::Error)]
pub enum ModelFileError {
    /// Not the container, or cut off.
    #[error(
        "not a whole model file: {n_bytes} bytes do not hold what their header announces ({reason}); copy it again or train anew"
    )]
    Container {
        /// Length of what was given.
        n_bytes: usize,
        /// What the container's reader says.
        reason: String,
    },
    /// The container of something else.
    #[error("not a model of natural kinds: its metadata has no manifest")]
    NoManifest,
    /// Another version.
    #[error(
        "model file of format {found}; this program reads format {FORMAT}: train anew, or use the program that made it"
    )]
    OtherFormat {
        /// Its format.
        found: u32,
    },
    /// The manifest cannot be read.
    #[error("the model's manifest cannot be read: {reason}")]
    Manifest {
        /// Where and why.
        reason: String,
    },
    /// The register cannot be read.
    #[error("what the model's kinds are called cannot be read: {reason}")]
    Register {
        /// Where and why.
        reason: String,
    },
    /// Contents changed after they were written.
    #[error(
        "the model file is damaged: its contents have digest {found} and not {written}; copy it again or train anew"
    )]
    Digest {
        /// What the contents give.
        found: String,
        /// What the file says.
        written: String,
    },
    /// Arrays that the manifest does not announce.
    #[error("the model's array {name} is {found}; its manifest announces {expected}")]
    Array {
        /// Which.
        name: String,
        /// What is there, in words.
        found: String,
        /// What should be.
        expected: String,
    },
    /// Numbers that cannot be.
    #[error("the model's {what}; train anew")]
    Contents {
        /// What is wrong, in words.
        what: &'static str,
    },
    /// A metric that does not fit the sensor.
    #[error("the model does not fit its own sensor; train anew: {0}")]
    Metric(#[from] MetricError),
    /// Kinds that cannot be.
    #[error(transparent)]
    Mixture(#[from] MixtureError),
}
