//! From one raw frame to kind probabilities. What serving does for every frame.

use std::hint::black_box;
use std::sync::Arc;

use crate::command::{Command, with_metric};
use crate::features::{Extractor, Features};
use crate::half_split::HalfSplit;
use crate::mixture::most_probable;
use crate::model::Model;
use crate::out_of_sample::Placer;
use crate::stress::Stress;

/// Whether a frame could be classified.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Status {
    /// It was.
    Classified,
    /// It had no valid reading. The probabilities are the mixing weights: what is known without looking.
    Invalid,
}

/// What is known of one frame.
#[derive(Clone, Debug, PartialEq)]
pub struct Classification {
    /// Whether the frame could be classified.
    pub status: Status,
    /// The most probable kind; the first of equals.
    pub kind: usize,
    /// Invalid readings in the frame.
    pub n_invalid: usize,
    /// Posterior of every kind, shape `(n_kinds,)`; finite, sums to 1.
    pub probabilities: Vec<f64>,
    /// Embedding, shape `(n_dims,)`, counts. Zeros for an invalid frame.
    pub coordinates: Vec<f64>,
    /// `ln p(e)`, nats. Not a number for an invalid frame.
    pub log_likelihood: f64,
    /// How unlike all that was seen in training the frame is, 0…1: the share of trained frames that are less so, held out of
    /// the model one by one. Of frames like those, a share r has a novelty of at least 1 − r: see [`crate::novelty`]. 1 for an
    /// invalid frame.
    pub novelty: f64,
}

/// Frames that warm a classifier up: they measure some ten reference frames each, spread over all of a model.
const N_WARM_UP: usize = 64;

/// Classifies frames with one model. Holds all memory that it needs: classifying allocates nothing.
pub struct Classifier {
    model: Arc<Model>,
    /// What is compared of the frame and its command, shape `(n_columns,)`.
    mapped: Vec<u16>,
    /// Where the frame is mapped.
    scratch: Vec<u16>,
    placer: Placer,
    stress: Stress,
    half_split: HalfSplit,
    extractor: Extractor,
    features: Features,
    classification: Classification,
}

impl Classifier {
    /// Prepares to classify with a model.
    pub fn new(model: Arc<Model>) -> Self {
        let extractor = Extractor::new(model.layout(), model.metric());
        Self {
            mapped: vec![0; model.frames().n_columns()],
            scratch: model.comparison.scratch(),
            placer: Placer::new(model.manifold(), model.manifest().n_neighbors),
            stress: model.usual().stress(),
            half_split: HalfSplit::new(model.manifold()),
            extractor,
            features: extractor.memory(),
            classification: Classification {
                status: Status::Invalid,
                kind: 0,
                n_invalid: 0,
                probabilities: vec![0.0; model.mixture().n_kinds()],
                coordinates: vec![0.0; model.manifest().n_dims],
                log_likelihood: f64::NAN,
                novelty: 1.0,
            },
            model,
        }
    }

    /// The model in use.
    pub fn model(&self) -> &Model {
        &self.model
    }

    /// Makes the first frame as quick as the others: classifies some of the model's own frames, which brings the model, the
    /// scratch and the code to where the processor has them at hand. No frame's answer depends on it.
    pub fn warm_up(&mut self) {
        let n_frames = self.model.frames().n_frames();
        for index in (0..n_frames).step_by(n_frames.div_ceil(N_WARM_UP)) {
            self.mapped.copy_from_slice(self.model.frames().row(index));
            self.locate();
        }
        // A frame of raw counts would touch only some entries of the response.
        black_box(self.model.response().table().iter().fold(0, |all, entry| all ^ entry));
        self.know_nothing();
    }

    /// Classifies one frame of which nobody says what the robot had been told.
    ///
    /// See [`Self::classify_commanded`].
    pub fn classify(&mut self, counts: &[u16]) -> &Classification {
        self.classify_commanded(counts, None)
    }

    /// Classifies one frame. The raw counts are read once; everything else is derived from that pass.
    ///
    /// * `counts` — raw counts, shape `(n_readings,)`
    /// * `command` — what the robot had been told by then. A model that compares commands takes a robot that nobody has told
    ///   anything to stand still; to any other model it does not matter.
    ///
    /// Equal counts and models give equal bits on every machine. Allocates nothing. O(n_frames) distances.
    ///
    /// # Panics
    /// If the number of readings is not the model's: whoever receives frames compares layouts before.
    pub fn classify_commanded(&mut self, counts: &[u16], command: Option<Command>) -> &Classification {
        let (compared, columns) = self.mapped.split_at_mut(self.model.frames().n_readings());
        let n_invalid = self.model.comparison.map(counts, &mut self.scratch, compared);
        if let Some(scale) = self.model.commands() {
            columns.copy_from_slice(&scale.counts(&command.unwrap_or_default()));
        }
        self.classification.n_invalid = n_invalid;
        if n_invalid == counts.len() {
            self.know_nothing();
        } else {
            let compared = &self.mapped[..self.model.frames().n_readings()];
            let readings = self.model.comparison.readings(&self.scratch, compared);
            self.extractor.extract(readings, &mut self.features);
            self.locate();
        }
        self.classification.kind = most_probable(&self.classification.probabilities);
        &self.classification
    }

    /// How far apart two halves of its nearest reference frames place the frame that was classified last, as a share of the radius of
    /// all trained places: see [`crate::half_split`]. None for an invalid frame, and by a model without a graph.
    ///
    /// Allocates nothing. O(n_landmarks · (ns + n_dims)).
    pub fn half_split_error(&mut self) -> Option<f64> {
        let manifest = self.model.manifest().half_split?;
        match self.classification.status {
            Status::Classified => {
                let apart = self.half_split.error(self.model.manifold(), self.placer.nearest())?;
                Some(apart / manifest.radius)
            }
            Status::Invalid => None,
        }
    }

    fn know_nothing(&mut self) {
        let classification = &mut self.classification;
        classification.status = Status::Invalid;
        classification.probabilities.copy_from_slice(self.model.mixture().weights());
        classification.coordinates.fill(0.0);
        classification.log_likelihood = f64::NAN;
        classification.novelty = 1.0;
    }

    /// Finds coordinates, probabilities and novelty.
    fn locate(&mut self) {
        let Self { model, mapped, placer, stress, features, classification, .. } = self;
        classification.status = Status::Classified;
        let nearest = with_metric!(model.metric(), model.commands(), |metric| {
            placer.place(metric, model.manifold(), mapped, &mut classification.coordinates)
        });
        let density = model.mixture().density(&classification.coordinates, &mut classification.probabilities);
        classification.log_likelihood = density.log_likelihood;
        let measured = [
            density.squared_mahalanobis,
            nearest.squared_distance as f64,
            stress.of(placer.lengths(), &classification.coordinates),
        ];
        classification.novelty = model.novelty().of(measured, features);
    }
}
