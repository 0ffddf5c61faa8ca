//! What is to be fitted: every choice that a model follows from, but the frames.

use serde::{Deserialize, Serialize};

use crate::em::EmPlan;
use crate::frames::SensorLayout;
use crate::response::ResponsePlan;

/// How distances between frames become coordinates.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum Method {
    /// Geodesics in the neighbour graph (Tenenbaum, de Silva & Langford 2000; landmarks: de Silva & Tenenbaum 2004).
    #[serde(alias = "isomap")]
    Isomap,
    /// Euclidean distances: principal component analysis, the paper's baseline.
    #[serde(alias = "pca")]
    Pca,
}

/// What to fit: what was asked for. What came of it, a model's manifest says.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct FitPlan {
    /// The sensor that took the frames.
    pub sensor: SensorLayout,
    /// The scale on which frames are compared.
    pub response: ResponsePlan,
    /// Geodesic or Euclidean.
    pub method: Method,
    /// ns.
    pub n_neighbors: usize,
    /// n; all frames if there are no more.
    pub n_landmarks: usize,
    /// d. None: by evidence, two more than where the residual variance bends.
    pub n_dims: Option<usize>,
    /// J. None: by evidence, the number with the least BIC_neff.
    pub n_kinds: Option<usize>,
    /// How kinds are found.
    pub em: EmPlan,
    /// Seed of the landmarks.
    pub seed: u64,
}
