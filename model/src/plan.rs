//! What is to be fitted: every choice that a model follows from, but the frames.

use serde::{Deserialize, Serialize};

use crate::em::EmPlan;
use crate::frames::SensorLayout;
use crate::median::MedianPlan;
use crate::metric::MetricPlan;
use crate::response::ResponsePlan;
use crate::whitening::WhiteningPlan;

/// How distances between frames become coordinates.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum Method {
    /// Geodesics in the neighbour graph (Tenenbaum, de Silva & Langford 2000; landmarks: de Silva & Tenenbaum 2004).
    #[serde(alias = "isomap")]
    Isomap,
    /// Straight distances. Of the Euclidean metric: principal component analysis, the paper's baseline, with weights
    /// that of readings multiplied by their roots. Of another metric, whose distances need not fit into any space:
    /// classical scaling (Torgerson 1952), the same computation.
    #[serde(alias = "pca")]
    Pca,
    /// None: the counts of the readings themselves are coordinates, as the paper tried.
    #[serde(alias = "native")]
    Native,
}

/// Which reference frames are landmarks, where not all of them are.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub enum LandmarkChoice {
    /// Any, each as likely.
    #[default]
    #[serde(alias = "random")]
    Random,
    /// The one farthest from those chosen before, again and again (MaxMin: de Silva & Tenenbaum 2004). Covers all that the
    /// trip saw with few landmarks, frames unlike all others first.
    #[serde(alias = "farthest")]
    Farthest,
    /// The frames nearest to the centres of k-means: as many where the robot was for long, but evenly spread.
    #[serde(alias = "k_means")]
    KMeans,
}

/// What the number of kinds is chosen by, where none is asked for.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub enum KindsBy {
    /// The least BIC_neff of 1 to 20: see [`crate::evidence`].
    #[default]
    #[serde(alias = "bic_neff")]
    BicNeff,
    /// The highest likelihood of contiguous blocks that were held out, of 1 to 20.
    #[serde(alias = "held_out")]
    HeldOut,
    /// How many a Dirichlet process keeps, whose mixture is then the model's: see [`crate::em::dirichlet`].
    #[serde(alias = "dirichlet")]
    Dirichlet,
}

/// What to fit: what was asked for. What came of it, a model's manifest says.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct FitPlan {
    /// The sensor that took the frames.
    pub sensor: SensorLayout,
    /// The scale on which frames are compared.
    pub response: ResponsePlan,
    /// Of how many frames each reading is the median. Whoever fits and whoever classifies has frames pass it first: see
    /// [`MedianFilter`](crate::MedianFilter).
    #[serde(default)]
    pub median: MedianPlan,
    /// Slow directions of readings that frames are compared by. None: by the readings themselves.
    #[serde(default)]
    pub whitening: Option<WhiteningPlan>,
    /// How far apart two frames are by what is compared.
    pub metric: MetricPlan,
    /// Most frames that the model keeps. Of longer trips it keeps as many that cover them.
    pub n_frames_max: usize,
    /// Along the manifold or straight.
    pub method: Method,
    /// ns. None: by evidence, the fewest from ten on that leave few frames beyond bridges and nearly the least residual
    /// variance; fewer than ten only where so many make a short circuit.
    pub n_neighbors: Option<usize>,
    /// Whether frames that follow each other in a trip are neighbours in the graph, however far apart.
    pub consecutive_edges: bool,
    /// n; all reference frames if there are no more.
    pub n_landmarks: usize,
    /// How these are chosen.
    pub landmark_choice: LandmarkChoice,
    /// d. None: by evidence, two more than where the residual variance bends.
    pub n_dims: Option<usize>,
    /// J. None: by evidence.
    pub n_kinds: Option<usize>,
    /// Fewest kinds that evidence may speak for, of those that frames can make. Means nothing where J is given, or chosen by a
    /// Dirichlet process.
    pub n_kinds_min: usize,
    /// Which evidence. Means nothing where J is given.
    pub kinds_by: KindsBy,
    /// How kinds are found.
    pub em: EmPlan,
    /// Seed of the landmarks.
    pub seed: u64,
}

impl FitPlan {
    /// The plainest plan: Isomap of all readings by Euclidean distances, that keeps all frames and takes each for a landmark, and
    /// leaves neighbours, dimensions and kinds to the evidence.
    ///
    /// * `seed` — of the landmarks and of the mixture
    pub fn new(sensor: SensorLayout, response: ResponsePlan, seed: u64) -> Self {
        Self {
            sensor,
            response,
            median: MedianPlan::Off,
            whitening: None,
            metric: MetricPlan::Euclidean,
            n_frames_max: usize::MAX,
            method: Method::Isomap,
            n_neighbors: None,
            consecutive_edges: false,
            n_landmarks: usize::MAX,
            landmark_choice: LandmarkChoice::Random,
            n_dims: None,
            n_kinds: None,
            n_kinds_min: 1,
            kinds_by: KindsBy::BicNeff,
            em: EmPlan::new(seed),
            seed,
        }
    }
}
