//! A model learnt anew from what it has kept and from further trips, whose kinds keep their numbers.
//!
//! Of the trips that a model was learnt from it has its reference frames, on the response's scale. Nothing is mapped back to raw
//! counts: what was clipped has none. Fitting starts from frames as they are compared, and so the old trips pass again, frame by
//! frame in their order of time, each as the reference frame that stands for it; the further trips follow, mapped as the model
//! maps what it is served. So scale, directions and weights of commands stay the model's, every old frame counts for one, and
//! all that depends on time (independent frames, persistence) sees the old trips as far as the model covers them.
//!
//! Kinds begin as the model has them: each frame is of the kind that the model says, and those that it calls novel may make new ones.
//! Fitted afresh, more frames make more kinds, and few of them those that somebody has named.
//!
//! All else is the model's plan again: what it was told stays, and what it left to the evidence is left to that of all trips.

use std::sync::Arc;

use rayon::prelude::*;

use super::{
    FitError, Known, Progress, Step, check_counts, check_room, extractor_of, fit_source, made_here,
    posteriors,
};
use crate::classify::{Classification, Classifier};
use crate::command::Command;
use crate::features::ManyFeatures;
use crate::hierarchy;
use crate::learnt::Source;
use crate::matching::{Match, matches, overlaps};
use crate::model::{Model, Origin, Provenance};
use crate::plan::FitPlan;
use crate::register::{KindRecord, Register};
use crate::response::INVALID;
use crate::stream::{FrameSource, N_FRAMES_AT_ONCE, N_FRAMES_IN_BATCH, Stream, StreamError};

/// A model that was learnt further.
#[derive(Clone, Debug)]
pub struct Updated {
    /// The model.
    pub model: Model,
    /// What became of its kinds: those that it has by rising number, then those that it has no more.
    pub changes: Vec<KindChange>,
}

/// What became of a kind.
#[derive(Clone, Debug, PartialEq)]
pub struct KindChange {
    /// What it is called.
    pub record: KindRecord,
    /// α before, its share of the frames; none of a new kind.
    pub share_before: Option<f64>,
    /// α now; none of a kind that is retired.
    pub share_after: Option<f64>,
    /// Frames that it has and had, as a share of those that it has or had; none of one that is new or retired.
    pub agreement: Option<f64>,
}

/// Learns a model further from frames that are read.
///
/// * `commands` — shape `(n_frames,)`, of the further frames, if the model compares commands
/// * `origin` — where the further frames came from
/// * `n_landmarks_usual` — landmarks at least, where all of the model's reference frames are
///
/// Deterministic for a model and frames on one machine. Holds what [`fit_stream`](super::fit_stream) does, and reads the frames once
/// more, for what the model says of them.
///
/// # Errors
/// If frames cannot be read, or are too much alike for the model's plan.
///
/// # Panics
/// If there are more or fewer commands than frames, or none for a model that compares them: a bug of the caller.
pub fn update<E: Send>(
    model: &Model,
    source: &mut dyn FrameSource<Error = E>,
    commands: Option<&[Command]>,
    origin: Origin,
    n_landmarks_usual: usize,
    progress: &mut Progress,
) -> Result<Updated, StreamError<E>> {
    assert_eq!(
        commands.map(<[Command]>::len),
        model.commands().map(|_| source.n_frames()),
        "a command for each frame"
    );
    let n_trained = model.references().n_trained() + source.n_frames();
    let manifest = model.manifest();
    let n_landmarks = match manifest.plan.n_landmarks == manifest.n_frames {
        true => manifest.plan.n_landmarks.max(n_landmarks_usual),
        false => manifest.plan.n_landmarks,
    };
    let plan = FitPlan { n_landmarks, ..manifest.plan.clone() };
    check_counts(&plan, n_trained)?;
    check_room(&plan, n_trained, model.frames().n_columns())?;
    let provenance = Provenance { origin: joined(model, origin, source.n_frames()), ..made_here() };
    let (comparison, scale) = (model.comparison.clone(), model.commands().copied());
    let known = Known {
        n_kinds: model.mixture().n_kinds(),
        probabilities: known(model, source, commands, progress).map_err(StreamError::Read)?,
    };
    let stream = Source::Stream(after(model, source, commands)?);
    let mut updated = fit_source(stream, comparison, scale, &plan, provenance, Some(&known), progress)?;
    let changes = renumber(&mut updated, model, &known.probabilities);
    updated.id = crate::file::id_of(&updated);
    Ok(Updated { model: updated, changes })
}

/// The trips of a model, and further ones.
fn joined(model: &Model, further: Origin, n_further: usize) -> Origin {
    let mut origin = model.manifest().provenance.origin.clone();
    origin.n_frames = [origin.trips(model.references().n_trained()), further.trips(n_further)].concat();
    origin.trips.extend(further.trips);
    origin.n_frames_invalid += further.n_frames_invalid;
    origin
}

/// The frames of a model, and further ones after them.
fn after<'a, E>(
    model: &'a Model,
    source: &'a mut dyn FrameSource<Error = E>,
    commands: Option<&'a [Command]>,
) -> Result<Stream<'a, E>, FitError> {
    Ok(Stream {
        before: Some(model),
        source,
        n_readings: model.layout().n_readings(),
        comparison: model.comparison.clone(),
        extractor: extractor_of(&model.manifest().plan)?,
        features: ManyFeatures::default(),
        commands: model.commands().copied().zip(commands),
    })
}

/// What a model says of the kinds of frames, its own before those that are read, shape `(n_trained, n_kinds)`: probabilities, and
/// zeros of frames that it calls novel, since these are of none of its kinds.
fn known<E: Send>(
    model: &Model,
    source: &mut dyn FrameSource<Error = E>,
    commands: Option<&[Command]>,
    progress: &mut Progress,
) -> Result<Vec<f64>, E> {
    let (references, n_dims, n_readings) =
        (model.references(), model.manifest().n_dims, model.layout().n_readings());
    let (n_before, n_further) = (references.n_trained(), source.n_frames());
    let place = |&nearest: &u32| {
        &model.coordinates()[references.indices()[nearest as usize] as usize * n_dims..][..n_dims]
    };
    let places: Vec<f64> = references.nearest().iter().flat_map(place).copied().collect();
    let mut known = posteriors(model.mixture(), &places);
    let model = Arc::new(model.clone());
    source.rewind()?;
    for first in (0..n_further).step_by(N_FRAMES_IN_BATCH) {
        let last = n_further.min(first + N_FRAMES_IN_BATCH);
        let mut counts = vec![INVALID; (last - first) * n_readings];
        counts.chunks_exact_mut(n_readings).try_for_each(|frame| source.read(frame))?;
        let of_frame = |classifier: &mut Classifier, (index, frame): (usize, &[u16])| {
            let command = commands.map(|commands| commands[first + index]);
            let Classification { probabilities, novelty, .. } = classifier.classify_commanded(frame, command);
            match model.manifest().novelty.is_novel(*novelty) {
                true => vec![0.0; probabilities.len()],
                false => probabilities.clone(),
            }
        };
        let frames = counts.par_chunks_exact(n_readings).enumerate().with_min_len(N_FRAMES_AT_ONCE);
        let found: Vec<Vec<f64>> = frames.map_init(|| Classifier::new(model.clone()), of_frame).collect();
        known.extend(found.iter().flatten());
        progress(Step::Kinds, n_before + last, n_before + n_further);
    }
    Ok(known)
}

/// Gives kinds that a model knew their numbers and names, and others numbers that none has had; and puts them in the order of
/// their numbers.
///
/// * `before` — what the model says of the kinds of the frames
fn renumber(updated: &mut Model, model: &Model, before: &[f64]) -> Vec<KindChange> {
    let (old, new) = (model.mixture(), updated.mixture());
    let n_kinds = (old.n_kinds(), new.n_kinds());
    let after = posteriors(new, updated.coordinates());
    let overlaps = overlaps(n_kinds, before.chunks_exact(n_kinds.0), after.chunks_exact(n_kinds.1));
    let matches = matches(&overlaps, n_kinds.1);

    let change = |record: KindRecord, before: Option<usize>, after: Option<usize>, agreement| KindChange {
        record,
        share_before: before.map(|kind| old.weights()[kind]),
        share_after: after.map(|kind| new.weights()[kind]),
        agreement,
    };
    let record = |kind: usize| model.register().kinds()[kind].clone();
    let known = matches.iter().map(|pair| {
        let Match { before, after, agreement } = *pair;
        (after, change(record(before), Some(before), Some(after), Some(agreement)))
    });
    let mut unknown: Vec<usize> =
        (0..n_kinds.1).filter(|kind| matches.iter().all(|pair| pair.after != *kind)).collect();
    // The largest first.
    unknown.sort_by(|a, b| new.weights()[*b].total_cmp(&new.weights()[*a]));
    let unknown = (model.register().next_number()..).zip(unknown).map(|(number, kind)| {
        (kind, change(KindRecord { number, ..KindRecord::default() }, None, Some(kind), None))
    });
    let mut changes: Vec<(usize, KindChange)> = known.chain(unknown).collect();
    changes.sort_by_key(|(_, change)| change.record.number);
    let lost = (0..n_kinds.0).filter(|kind| matches.iter().all(|pair| pair.before != *kind));
    let lost: Vec<KindChange> = lost.map(|kind| change(record(kind), Some(kind), None, None)).collect();

    let (order, kept): (Vec<usize>, Vec<KindChange>) = changes.into_iter().unzip();
    updated.mixture = updated.mixture.in_order(&order);
    updated.manifest.merges =
        hierarchy::learn(&posteriors(&updated.mixture, &updated.coordinates), n_kinds.1);
    let records =
        |changes: &[KindChange]| changes.iter().map(|change| change.record.clone()).collect::<Vec<_>>();
    let retired = [model.register().retired(), &records(&lost)].concat();
    updated.register = Register { kinds: records(&kept), retired };
    [kept, lost].concat()
}

#[cfg(test)]
mod tests;
