//! A model: everything that turns a raw frame into kind probabilities, and where it came from.

use std::fmt;

use rayon::prelude::*;
use serde::{Deserialize, Serialize};

use crate::array::Array;
use crate::command::CommandScale;
use crate::comparison::Comparison;
use crate::frames::{Frames, SensorLayout};
use crate::geodesics::Geodesics;
use crate::half_split::HalfSplitManifest;
use crate::hierarchy::{self, Merge};
use crate::intrinsic_dims::IntrinsicDims;
use crate::mds::Embedding;
use crate::median::MedianFilter;
use crate::metric::AnyMetric;
use crate::mixture::Mixture;
use crate::novelty::{Novelty, Usual};
use crate::out_of_sample::Manifold;
use crate::persistence::Filter;
use crate::plan::FitPlan;
use crate::reference::ReferenceSet;
use crate::register::{NameError, Register};
use crate::response::{Response, Scale};
use crate::whitening::{Whitening, WhiteningPlan};

/// Most kinds that a model may have: what a report in shared memory holds.
pub const N_KINDS_MAX: usize = 64;

/// Most dimensions that a model may embed in: what a report in shared memory holds.
pub const N_DIMS_MAX: usize = 32;

/// What a model is, in words and numbers: everything in its file but the arrays.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Manifest {
    /// Version of the file's format.
    pub format: u32,
    /// What was fitted. Its `n_landmarks` are those that there are; in native space, those that another method would have.
    pub plan: FitPlan,
    /// How commands are compared beside readings; none where frames are compared by readings alone.
    pub commands: Option<CommandScale>,
    /// Frames that kinds were learnt from: all of the trips that had a valid reading.
    pub n_trained: usize,
    /// N: those of them that the model keeps.
    pub n_frames: usize,
    /// ns.
    pub n_neighbors: usize,
    /// d.
    pub n_dims: usize,
    /// J.
    pub n_kinds: usize,
    /// s: the probability that a frame's kind is that of the frame before, rather than drawn by the mixing weights; see
    /// [`Filter`].
    pub persistence: f64,
    /// Which kinds are most alike, in the order in which they come together: see [`crate::hierarchy`].
    pub merges: Vec<Merge>,
    /// What novelty was learnt from, and what it means.
    pub novelty: NoveltyManifest,
    /// What half-split errors mean; none without a graph, or with one neighbour.
    pub half_split: Option<HalfSplitManifest>,
    /// Where it came from, and why it is as it is. Classifying needs none of it.
    pub provenance: Provenance,
}

/// What novelty was learnt from, and what it means.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct NoveltyManifest {
    /// Trained frames that were held out of the model, one by one.
    pub n_held_out: usize,
    /// Tiles by which frames' forms are told; 0 where they are not.
    pub n_tiles: usize,
    /// Share of frames like those seen in training that are called novel all the same.
    pub false_alarm_rate: f64,
}

impl NoveltyManifest {
    /// Whether a frame of such a novelty is called novel.
    pub fn is_novel(&self, novelty: f64) -> bool {
        novelty >= 1.0 - self.false_alarm_rate
    }
}

/// Where a model came from, and what was seen on the way.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Provenance {
    /// Program and version.
    pub made_by: String,
    /// The frames.
    pub origin: Origin,
    /// Farthest that a trained frame is from the nearest reference frame, counts on the response's scale; 0 where the model
    /// keeps them all.
    pub covering_radius: f32,
    /// What speaks for each number of neighbours, by rising number; empty where it was given, or there is no graph.
    pub neighbors_tried: Vec<NeighborsTrial>,
    /// Dimensions that the frames fill, near each frame: of the sensor's manifold and its noise, not of the embedding.
    pub intrinsic_dims: IntrinsicDims,
    /// Frames on each island of the neighbour graph before they were joined, largest first.
    pub islands: Vec<usize>,
    /// The bridges that joined them: frame, frame, length in counts on the response's scale.
    pub bridges: Vec<(u32, u32, f32)>,
    /// Residual variance for 1, 2, … dimensions; empty in native space, as all about eigenvalues.
    pub residual_variance: Vec<f64>,
    /// Where that curve bends: dimensions. The model has two more, unless it was told how many to have.
    pub elbow: usize,
    /// Fewest dimensions that leave at most a hundredth more than the least of that curve.
    pub n_dims_within_tolerance: usize,
    /// The largest eigenvalues, counts².
    pub eigenvalues: Vec<f64>,
    /// Share of negative eigenvalues in the sum of all magnitudes.
    pub negative_share: f64,
    /// ln likelihood of the trained frames under the mixture, nats.
    pub log_likelihood: f64,
    /// Schwarz' criterion `−2 ln L + κ ln N`, nats.
    pub bic: f64,
    /// Iterations of expectation and maximisation, or of the Dirichlet process.
    pub n_iterations: usize,
    /// Whether these converged.
    pub converged: bool,
    /// Starts given up because a kind lost its frames.
    pub n_starts_collapsed: usize,
    /// N_eff: trained frames that are as good as independent of each other, their number by the integrated autocorrelation time.
    pub n_frames_effective: f64,
    /// Share of the trained frames that are most probably of the largest kind: one giant kind is consistent and useless.
    pub largest_kind_share: f64,
    /// What speaks for each number of kinds, 1, 2, …; empty where the number was given, or found by a Dirichlet process.
    pub kinds_tried: Vec<KindsTrial>,
    /// How a Dirichlet process found the kinds, where it did.
    pub dirichlet: Option<DirichletProvenance>,
}

/// A number of neighbours that was tried, and what speaks for it.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct NeighborsTrial {
    /// ns.
    pub n_neighbors: usize,
    /// Islands of the graph before they were joined.
    pub n_islands: usize,
    /// Lengths of the bridges that joined them, counts on the response's scale, shortest first.
    pub bridges: Vec<f32>,
    /// Dimensions that residual variance was compared at, the same for all numbers.
    pub n_dims: usize,
    /// Residual variance there; lower is better.
    pub residual_variance: f64,
    /// Median geodesic, counts on the response's scale. Falls suddenly at a short circuit.
    pub median_geodesic: f64,
}

/// A number of kinds that was tried, and what speaks for it.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct KindsTrial {
    /// J.
    pub n_kinds: usize,
    /// ln likelihood of the trained frames, nats.
    pub log_likelihood: f64,
    /// Schwarz' criterion `−2 ln L + κ ln N`, nats; lower is better. Overfits trips, whose frames are not independent.
    pub bic: f64,
    /// Bozdogan's criterion `−2 ln L + κ (ln N + 1)`, which the paper uses with a misprinted sign, nats.
    pub caic: f64,
    /// Schwarz' criterion for as many frames as are independent, `−2 (N_eff / N) ln L + κ ln N_eff`, nats.
    pub bic_neff: f64,
    /// ln likelihood of frames in contiguous blocks that the mixture was not fitted to, nats per frame; higher is better.
    pub held_out: f64,
    /// Starts given up because a kind lost its frames, in the fit to all frames and in those without some.
    pub n_starts_collapsed: usize,
}

/// How a Dirichlet process found a model's kinds.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct DirichletProvenance {
    /// Of the process: the higher, the more kinds are expected.
    pub concentration: f64,
    /// Independent frames of each kind, in falling order, of those that were left out because they have less than one too.
    pub n_frames_of_kinds: Vec<f64>,
    /// What came of starts of 1, 2, … kinds. That with the highest bound is the model's.
    pub trials: Vec<DirichletTrial>,
}

/// What came of one start of a Dirichlet process.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct DirichletTrial {
    /// Kinds that it began with.
    pub n_kinds_begun: usize,
    /// Kinds that stayed.
    pub n_kinds: usize,
    /// Lower bound of ln evidence of the frames, as many as are independent, nats; higher is better.
    pub lower_bound: f64,
}

/// Where the trained frames came from.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Origin {
    /// Names of the trips' files, without their folders: the same trip makes the same model wherever it lies.
    pub trips: Vec<String>,
    /// Frames of each trip that were kept. What follows each other in a trip is alike; where the next begins, it is not.
    /// Empty: all frames are of one trip.
    pub n_frames: Vec<usize>,
    /// Frames of the trips that were left out because no reading was valid.
    pub n_frames_invalid: usize,
    /// By what some of these frames were compared to see how long kinds last, the usual first, where the trips were to decide; empty
    /// where it was given.
    #[serde(default)]
    pub comparisons_tried: Vec<ComparisonTrial>,
}

/// By what frames were compared, and what speaks for it.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ComparisonTrial {
    /// The scale.
    pub scale: Scale,
    /// Slow directions of readings on it; none: the readings themselves.
    pub whitening: Option<WhiteningPlan>,
    /// s: how seldom kinds of a model by it change, on the frames that they were learnt from; higher is better.
    pub persistence: f64,
    /// The same on frames that they were not learnt from.
    pub persistence_held_out: f64,
}

impl ComparisonTrial {
    /// Frames that kinds last: the geometric mean of what they do on frames that they were learnt from and on others.
    pub fn n_frames_lasting(&self) -> f64 {
        1.0 / ((1.0 - self.persistence) * (1.0 - self.persistence_held_out)).sqrt()
    }
}

impl Origin {
    /// Frames of each trip.
    ///
    /// * `n_trained` — of all trips
    pub fn trips(&self, n_trained: usize) -> Vec<usize> {
        if self.n_frames.is_empty() { vec![n_trained] } else { self.n_frames.clone() }
    }
}

/// Which model: the first 16 bytes of its contents' SHA-256.
#[derive(Clone, Copy, PartialEq, Eq, Hash)]
pub struct ModelId(pub [u8; 16]);

/// A whole model, ready to classify with. Its large arrays may lie in a mapped file.
#[derive(Clone, Debug)]
pub struct Model {
    pub(crate) id: ModelId,
    pub(crate) manifest: Manifest,
    pub(crate) comparison: Comparison,
    /// The plan's, for its sensor.
    pub(crate) metric: AnyMetric,
    pub(crate) frames: Frames,
    pub(crate) references: ReferenceSet,
    /// Frame indices, shape `(n_landmarks,)`; none in native space.
    pub(crate) landmarks: Array<u32>,
    /// Only Isomap has them: straight distances are taken from the frames.
    pub(crate) geodesics: Option<Geodesics>,
    /// None in native space, where a frame's counts are its coordinates.
    pub(crate) embedding: Option<Embedding>,
    /// Of the trained frames, shape `(n_trained, n_dims)`, counts.
    pub(crate) coordinates: Array<f64>,
    pub(crate) mixture: Mixture,
    /// What people call the kinds. No part of what the model is: its id does not depend on it.
    pub(crate) register: Register,
    /// Squared distance of each reference frame to its ns-th neighbour, ascending, shape `(n_frames,)`, counts².
    pub(crate) squared_radii: Array<u64>,
    pub(crate) novelty: Novelty,
}

impl Model {
    /// Which model this is: equal contents, equal id.
    pub fn id(&self) -> ModelId {
        self.id
    }

    /// What it is and where it came from.
    pub fn manifest(&self) -> &Manifest {
        &self.manifest
    }

    /// The sensor whose frames it understands.
    pub fn layout(&self) -> SensorLayout {
        self.manifest.plan.sensor
    }

    /// How commands are compared beside readings, where they are.
    pub fn commands(&self) -> Option<&CommandScale> {
        self.manifest.commands.as_ref()
    }

    /// Raw counts → the scale on which frames are compared.
    pub fn response(&self) -> &Response {
        &self.comparison.response
    }

    /// What makes slow directions of a frame's readings on that scale, if these are compared.
    pub fn whitening(&self) -> Option<&Whitening> {
        self.comparison.whitening.as_deref()
    }

    /// How far apart frames are.
    pub fn metric(&self) -> &AnyMetric {
        &self.metric
    }

    /// The reference frames, as they are compared.
    pub fn frames(&self) -> &Frames {
        &self.frames
    }

    /// What the reference frames saw, readings on the response's scale: as it was, or where slow directions are compared, as far
    /// as these say it.
    pub fn seen(&self) -> Frames {
        let Some(whitening) = self.whitening() else { return self.frames.clone() };
        let frames = (0..self.frames.n_frames()).into_par_iter();
        let seen: Vec<u16> =
            frames.flat_map_iter(|index| whitening.frame_of(self.frames.readings(index))).collect();
        Frames::new(whitening.n_readings(), seen)
    }

    /// Which of the trained frames the reference frames are, and which of these is nearest to each.
    pub fn references(&self) -> &ReferenceSet {
        &self.references
    }

    /// Frame indices of the landmarks, ascending; none in native space.
    pub fn landmarks(&self) -> &[u32] {
        &self.landmarks
    }

    /// Geodesics to the landmarks, if the method is Isomap.
    pub fn geodesics(&self) -> Option<&Geodesics> {
        self.geodesics.as_ref()
    }

    /// What embeds a frame; none in native space, where its counts on the response's scale are its coordinates.
    pub fn embedding(&self) -> Option<&Embedding> {
        self.embedding.as_ref()
    }

    /// Coordinates of the trained frames in order of time, shape `(n_trained, n_dims)`, counts. Those of the reference
    /// frames stand where [`ReferenceSet::indices`] says.
    pub fn coordinates(&self) -> &[f64] {
        &self.coordinates
    }

    /// What a frame is placed by.
    pub(crate) fn manifold(&self) -> Manifold<'_> {
        Manifold {
            frames: &self.frames,
            landmarks: &self.landmarks,
            geodesics: self.geodesics.as_ref(),
            embedding: self.embedding.as_ref(),
        }
    }

    /// The kinds.
    pub fn mixture(&self) -> &Mixture {
        &self.mixture
    }

    /// What people call the kinds, by index.
    pub fn register(&self) -> &Register {
        &self.register
    }

    /// Calls a kind by a name, or gives it a note; what is not given stays.
    ///
    /// * `number` — the kind's in the register, which an update does not change
    ///
    /// # Errors
    /// If there is no such kind, or no table could show the words.
    pub fn name_kind(
        &mut self,
        number: u32,
        name: Option<&str>,
        note: Option<&str>,
    ) -> Result<(), NameError> {
        self.register.name(number, name, note)
    }

    /// Takes name and note from a kind.
    ///
    /// # Errors
    /// If there is no such kind.
    pub fn clear_kind(&mut self, number: u32) -> Result<(), NameError> {
        self.register.clear(number)
    }

    /// Which group each kind is of where those most alike are taken together until so many groups are left, shape `(n_kinds,)`:
    /// groups are numbered from 0 in the order of their first kinds. A group's probability is the sum of those of its kinds.
    ///
    /// * `n_groups` — fewer than 1 are taken for 1, and more than there are kinds for as many
    pub fn merged(&self, n_groups: usize) -> Vec<usize> {
        hierarchy::groups(self.manifest.n_kinds, &self.manifest.merges, n_groups)
    }

    /// What frames pass in their order before they are classified; none where they are classified as they are.
    pub fn median(&self) -> Option<MedianFilter> {
        MedianFilter::new(self.manifest.plan.median, self.layout().n_readings())
    }

    /// Takes frames in their order into account, beginning with none.
    pub fn filter(&self) -> Filter {
        Filter::new(self.manifest.persistence, self.mixture.weights())
    }

    /// What is usual, to rank frames by.
    pub fn novelty(&self) -> &Novelty {
        &self.novelty
    }

    /// What a frame's novelty is measured by.
    pub(crate) fn usual(&self) -> Usual<'_> {
        Usual {
            manifold: self.manifold(),
            mixture: &self.mixture,
            references: &self.references,
            coordinates: &self.coordinates,
            n_neighbors: self.manifest.n_neighbors,
        }
    }

    /// Squared distances of the reference frames to their ns-th neighbour, ascending, counts².
    pub fn squared_radii(&self) -> &[u64] {
        &self.squared_radii
    }
}

impl fmt::Display for ModelId {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        self.0.iter().try_for_each(|byte| write!(f, "{byte:02x}"))
    }
}

impl fmt::Debug for ModelId {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        fmt::Display::fmt(self, f)
    }
}
