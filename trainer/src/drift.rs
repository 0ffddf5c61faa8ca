//! Drift: how far a trip is from what a model was learnt from, without a place or a person's word.

use kinds_model::half_split::median;
use kinds_model::{Model, Status};
use serde::Serialize;

/// A trip beside the trips that a model was learnt from.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Drift {
    /// Share of the frames that are called novel.
    pub novel: f64,
    /// The same of frames like those that the model was learnt from.
    pub novel_usual: f64,
    /// Each kind's share of the frames: the mean of their probabilities, shape `(n_kinds,)`.
    pub shares: Vec<f64>,
    /// α, what it was in training, shape `(n_kinds,)`.
    pub shares_usual: Vec<f64>,
    /// Total variation between the two, `½ Σ_j |share_j − α_j|`: the share of frames that would have to be of another kind.
    pub total_variation: f64,
    /// Median half-split error of the frames, a share of the radius of all trained places ([`kinds_model::half_split`]); none by a
    /// model without a graph.
    pub half_split: Option<f64>,
    /// The same of frames like those that the model was learnt from.
    pub half_split_usual: Option<f64>,
}

/// What is counted of frames on the way to their drift.
#[derive(Clone, Debug, Default)]
pub(crate) struct Counted {
    n_frames: usize,
    n_novel: usize,
    /// Of probabilities, shape `(n_kinds,)`.
    sums: Vec<f64>,
    /// Half-split errors.
    errors: Vec<f64>,
}

impl Counted {
    /// Counts one frame more. One that told nothing does not count.
    pub(crate) fn add(
        &mut self,
        status: Status,
        probabilities: &[f64],
        is_novel: bool,
        half_split_error: Option<f64>,
    ) {
        if status == Status::Classified {
            self.sums.resize(probabilities.len(), 0.0);
            self.sums.iter_mut().zip(probabilities).for_each(|(sum, probability)| *sum += probability);
            self.n_frames += 1;
            self.n_novel += usize::from(is_novel);
            self.errors.extend(half_split_error);
        }
    }

    /// Of frames that a model classified; none if there were none.
    pub(crate) fn drift(&self, model: &Model) -> Option<Drift> {
        let n_frames = (self.n_frames > 0).then_some(self.n_frames as f64)?;
        let shares: Vec<f64> = self.sums.iter().map(|sum| sum / n_frames).collect();
        let manifest = model.manifest();
        let shares_usual = model.mixture().weights().to_vec();
        let apart = shares.iter().zip(&shares_usual).map(|(share, usual)| (share - usual).abs());
        Some(Drift {
            novel: self.n_novel as f64 / n_frames,
            novel_usual: manifest.novelty.false_alarm_rate,
            total_variation: 0.5 * apart.sum::<f64>(),
            shares,
            shares_usual,
            half_split: median(&mut self.errors.clone()),
            half_split_usual: manifest.half_split.map(|half_split| half_split.usual),
        })
    }
}
