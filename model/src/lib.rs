//! The mathematics: from frames to kinds, fitting and inference.
//!
//! This crate knows neither clock, file, log nor shared memory. Time does not occur in it, randomness comes in as a
//! seed, a model comes and goes as bytes. Fits that do not depend on each other run side by side on the threads of
//! whoever calls (rayon's, of which the crate makes none), and what comes out does not depend on how many these are.
//! Everything in it follows Grollman, Jenkins & Wood, *Discovering Natural
//! Kinds of Robot Sensory Experiences in Unstructured Environments*, corrected where it misprints (see
//! [`mds`] and [`mixture`]).
//!
//! Data walks through the modules in this order:
//!
//! ```text
//! counts ─ response ─▶ frames ─ neighbors ─▶ graph ─ geodesics ─▶ mds ─▶ coordinates ─ mixture ─▶ kinds      (fit)
//! counts ─ response ─▶ frame  ─ neighbors + geodesics ─▶ mds ─▶ coordinates ─ mixture ─▶ probabilities       (classify)
//! ```
//!
//! # Notation
//!
//! | symbol | in code | shape | meaning |
//! |---|---|---|---|
//! | D | `n_readings` | | readings in one frame |
//! | | `n_trained` | | trained frames: all that kinds are learnt from |
//! | N | `n_frames` | | reference frames, all of the trained ones or those that cover them: the vertices of the graph |
//! | ns | `n_neighbors` | | neighbours in the graph, and of a new frame |
//! | n | `n_landmarks` | | reference frames that geodesics are measured from |
//! | G | `geodesics` | (N, n) | shortest path length from frame to landmark |
//! | Δ | `squared_geodesics` | (n, n) | landmark block of G, squared |
//! | δ | `squared_geodesics` | (n) | of one frame to each landmark |
//! | δ̄ | `mean_squared_geodesics` | (n) | column means of Δ |
//! | λ, V | `eigenvalues`, `eigenvectors` | (d), (n, d) | of B = −½ H Δ H, H = I − 11ᵀ/n; positive, descending |
//! | P | `projection` | (n, d) | ½ V Λ^(−½), landmark by landmark |
//! | e(p) | `coordinates` | (d) | embedding of a frame p: P (δ̄ − δ(p)) |
//! | τ, N_eff | `n_frames_effective` | | integrated autocorrelation time of the embedded trip, and `n_trained` / τ |
//! | J, α, μ, Σ | `n_kinds`, `weights`, `means`, `covariances` | | Gaussian mixture; one component is one kind |
//!
//! Lengths are in counts of the response's scale (see [`response`]) by the model's [`metric`], squared lengths in counts².

pub mod array;
pub mod autocorrelation;
mod blocks;
pub mod classify;
pub mod command;
mod comparison;
mod eigen;
pub mod em;
pub mod evidence;
mod features;
pub mod file;
pub mod fit;
mod form;
pub mod frames;
pub mod geodesics;
pub mod graph;
pub mod half_split;
pub mod hierarchy;
pub mod intrinsic_dims;
pub mod landmarks;
mod learnt;
mod lengths;
mod locate;
mod matching;
pub mod mds;
mod median;
pub mod metric;
pub mod mixture;
mod model;
pub mod neighborhood;
pub mod neighbors;
pub mod novelty;
mod out_of_sample;
mod persistence;
pub mod plan;
mod reference;
mod register;
pub mod residual_variance;
pub mod response;
mod search;
mod simd;
mod squares;
mod stream;
mod stress;
mod symmetric;
mod tally;
#[cfg(test)]
mod testing;
mod texture;
pub mod whitening;

pub use classify::{Classification, Classifier, Status};
pub use command::{Command, CommandColumn, CommandScale, Commands};
pub use em::{Covariance, EmPlan, StartsOn};
pub use file::ModelFileError;
pub use fit::{FitError, KindChange, Size, Step, Updated, fit, fit_stream, fit_with_commands, refit, update};
pub use frames::{Frames, SensorLayout};
pub use half_split::HalfSplitManifest;
pub use intrinsic_dims::IntrinsicDims;
pub use median::{MedianFilter, MedianPlan};
pub use metric::{MetricError, MetricPlan};
pub use model::{
    ComparisonTrial, DirichletProvenance, DirichletTrial, KindsTrial, Manifest, Model, ModelId, N_DIMS_MAX,
    N_KINDS_MAX, NeighborsTrial, NoveltyManifest, Origin, Provenance,
};
pub use persistence::{Filter, learn as learn_persistence};
pub use plan::{FitPlan, KindsBy, LandmarkChoice, Method};
pub use reference::ReferenceSet;
pub use register::{KindRecord, NameError, Register};
pub use response::{Response, ResponsePlan, Scale};
pub use stream::{FrameSource, StreamError};
pub use whitening::{Whitening, WhiteningPlan};
