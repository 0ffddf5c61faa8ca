//! Novelty: how unlike all that was seen in training a frame is, as one number with a known rate of false alarms.
//!
//! Five measures, since each is blind to something:
//! * the least squared Mahalanobis distance of the embedding to a kind. Alone it misses most: an embedding maps any frame onto
//!   the span of those in training;
//! * the squared distance to the nearest reference frame;
//! * geodesic stress (`stress.rs`): whether the place explains the lengths;
//! * its squared Mahalanobis distance from what frames look like from afar (`form.rs`). Of pictures with near and far exchanged the
//!   nearest frames and the stress of their place may be no farther than those of frames held out;
//! * how far its texture (`texture.rs`) is from the middle one, in ranks, since textures are spread unevenly. The others compare
//!   a frame with the nearest ones, and where those are far in any case, as in a camera's noise, take what no place looks like
//!   for one more place.
//!
//! What is usual for each is learnt from some trained frames that are *held out*: placed as if the model had never seen the
//! block of the trip around them, as long as its autocorrelation time τ. A frame whose neighbours in time are there is always
//! near one, which says nothing about a second trip. On a recorded trip of a hand-held camera, blocks of half of τ let 31 % of
//! the second trip pass for novel at a rate of 1 %, blocks of τ less than 1 %; longer ones take places that were seen once for
//! usual, however unlike all else they are, and miss more. Kinds, geodesics and projection are those of all frames: what a
//! block moves in them is small against how far a frame is from the next that looks like it.
//!
//! They are combined by the *highest rank*: the largest of a frame's ranks among held-out frames. Five tests at
//! once give more false alarms than one, so the highest rank is ranked in turn, among those of the held-out frames: that
//! rank is the novelty. Of frames like those held out, a share r has a novelty of at least 1 − r, whichever r.

use std::ops::Range;

use rayon::prelude::*;

use crate::array::Array;
use crate::features::Features;
use crate::form::Form;
use crate::half_split::{HalfSplit, HalfSplitManifest};
use crate::learnt::HeldOut;
use crate::metric::Metric;
use crate::mixture::Mixture;
use crate::out_of_sample::{Manifold, Placer};
use crate::reference::ReferenceSet;
use crate::stress::Stress;
use crate::texture::Textures;

/// Measures of how unlike other frames a frame is.
pub(crate) const N_MEASURES: usize = 5;

/// Those of them that a file holds: textures say the last.
pub(crate) const N_MEASURED: usize = 4;

/// What a frame measures: squared Mahalanobis distance, squared distance to the nearest reference frame (counts²), stress
/// (counts²), squared Mahalanobis distance of the form, distance of the texture from the middle one (ranks, twice).
pub(crate) type Measures = [f64; N_MEASURES];

/// Trained frames at random that are held out, at most: of a rate of false alarms of one in a hundred, ten are beyond.
pub(crate) const N_HELD_OUT_MAX: usize = 1000;

/// Share of frames like those seen in training that are called novel all the same.
pub const FALSE_ALARM_RATE: f64 = 0.01;

/// What is usual, to rank frames by.
#[derive(Clone, Debug)]
pub struct Novelty {
    /// Of held-out frames in order of time, all but what their textures say, shape `(n_held_out, N_MEASURED)`.
    measured: Array<f64>,
    textures: Textures,
    /// Of all trained frames; none where they have none.
    form: Option<Form>,
    /// Each measure for itself, ascending.
    sorted: [Vec<f64>; N_MEASURES],
    /// Of held-out frames, as numbers of frames below, ascending.
    highest_ranks: Vec<usize>,
}

impl Novelty {
    /// * `measured` — of held-out frames, at least one, shape `(n_held_out, N_MEASURED)`, no NaN
    /// * `textures` — theirs
    pub(crate) fn new(measured: Array<f64>, textures: Textures, form: Option<Form>) -> Self {
        let (rows, _) = measured.as_chunks::<N_MEASURED>();
        let measures = |(index, &[mahalanobis, nearest, stress, form]): (usize, &[f64; N_MEASURED])| {
            [mahalanobis, nearest, stress, form, textures.distance_from_middle(textures.of(index))]
        };
        let frames: Vec<Measures> = rows.iter().enumerate().map(measures).collect();
        let (sorted, highest_ranks) = ranked(&frames);
        Self { sorted, highest_ranks, measured, textures, form }
    }

    /// Trained frames that were held out.
    pub fn n_held_out(&self) -> usize {
        self.highest_ranks.len()
    }

    /// Tiles by which forms are told; 0 where they are not.
    pub(crate) fn n_tiles(&self) -> usize {
        self.form.as_ref().map_or(0, |form| form.means().len())
    }

    /// Of held-out frames in order of time, shape `(n_held_out, N_MEASURED)`.
    pub(crate) fn measured(&self) -> &[f64] {
        &self.measured
    }

    /// Of held-out frames.
    pub(crate) fn textures(&self) -> &Textures {
        &self.textures
    }

    /// Of all trained frames.
    pub(crate) fn form(&self) -> Option<&Form> {
        self.form.as_ref()
    }

    /// How novel a frame is, 0…1: the share of held-out frames that are less so.
    ///
    /// * `place` — squared Mahalanobis distance, squared distance to the nearest reference frame, stress
    ///
    /// Allocates nothing.
    pub(crate) fn of(&self, place: [f64; 3], features: &Features) -> f64 {
        let [mahalanobis, nearest, stress] = place;
        let form = self.form.as_ref().map_or(0.0, |form| form.distance(&features.means));
        let texture = self.textures.distance_from_middle(features.texture);
        self.by(&[mahalanobis, nearest, stress, form, texture])
    }

    fn by(&self, measures: &Measures) -> f64 {
        let highest = highest_rank(&self.sorted, measures);
        let n_below = self.highest_ranks.partition_point(|rank| *rank < highest);
        n_below as f64 / self.n_held_out() as f64
    }
}

/// Each measure of some frames for itself, and the frames' highest ranks, all ascending.
fn ranked(frames: &[Measures]) -> ([Vec<f64>; N_MEASURES], Vec<usize>) {
    let sorted = std::array::from_fn(|measure| {
        let mut sorted: Vec<f64> = frames.iter().map(|frame| frame[measure]).collect();
        sorted.sort_by(f64::total_cmp);
        sorted
    });
    let mut highest_ranks: Vec<usize> = frames.iter().map(|frame| highest_rank(&sorted, frame)).collect();
    highest_ranks.sort_unstable();
    (sorted, highest_ranks)
}

/// The most frames that a frame is above in any measure. What is not a number is above all.
fn highest_rank(sorted: &[Vec<f64>; N_MEASURES], measures: &Measures) -> usize {
    let rank = |(sorted, measure): (&Vec<f64>, &f64)| match measure.is_nan() {
        true => sorted.len(),
        false => sorted.partition_point(|usual| usual < measure),
    };
    sorted.iter().zip(measures).map(rank).max().unwrap_or(0)
}

/// What a frame is measured by: parts of a model, or of one that is being fitted.
#[derive(Clone, Copy)]
pub(crate) struct Usual<'a> {
    pub(crate) manifold: Manifold<'a>,
    pub(crate) mixture: &'a Mixture,
    pub(crate) references: &'a ReferenceSet,
    /// Of the trained frames, shape `(n_trained, n_dims)`.
    pub(crate) coordinates: &'a [f64],
    pub(crate) n_neighbors: usize,
}

impl Usual<'_> {
    /// The landmarks, by whose places stress is measured.
    pub(crate) fn stress(&self) -> Stress {
        let Self { manifold, references, coordinates, .. } = *self;
        let n_dims = self.mixture.n_dims();
        Stress::new(manifold.landmarks.len(), n_dims, |landmark| {
            let trained = references.indices()[manifold.landmarks[landmark] as usize];
            &coordinates[trained as usize * n_dims..][..n_dims]
        })
    }

    /// Learns what is usual from frames that are held out: novelty, and half-split errors.
    ///
    /// * `row` — what such a frame is compared by, by its place among them, shape `(n_columns,)`
    /// * `trips` — trained frames of each trip
    /// * `n_frames_effective` — N_eff: how many of the trained frames are as good as independent
    ///
    /// The same on any number of threads. O(n_frames) distances for each frame at worst.
    pub(crate) fn learn<'r>(
        &self,
        metric: &impl Metric,
        held_out: &HeldOut,
        row: impl Fn(usize) -> &'r [u16] + Sync,
        trips: &[usize],
        n_frames_effective: f64,
    ) -> (Novelty, Option<HalfSplitManifest>) {
        let n_around = (0.5 * self.references.n_trained() as f64 / n_frames_effective).ceil() as usize;
        let stress = self.stress();
        let n_kinds = self.mixture.n_kinds();
        let memory = || {
            let placer = Placer::new(self.manifold, self.n_neighbors);
            let half_split = HalfSplit::new(self.manifold);
            (placer, half_split, vec![0.0; self.mixture.n_dims()], vec![0.0; n_kinds])
        };
        let measured = held_out.trained.par_iter().zip(&held_out.distances).enumerate().map_init(
            memory,
            |(placer, half_split, coordinates, probabilities), (index, (&trained, &form))| {
                let hidden = self.around(trained, trips, n_around);
                let nearest = placer.place_without(metric, self.manifold, row(index), hidden, coordinates);
                let density = self.mixture.density(coordinates, probabilities);
                let stress = stress.of(placer.lengths(), coordinates);
                let measured = [density.squared_mahalanobis, nearest.squared_distance as f64, stress, form];
                (measured, half_split.error(self.manifold, placer.nearest()))
            },
        );
        let (measured, errors): (Vec<[f64; N_MEASURED]>, Vec<Option<f64>>) = measured.unzip();
        let errors = errors.into_iter().flatten().collect();
        let half_split = HalfSplitManifest::learn(self.coordinates, self.mixture.n_dims(), errors);
        let textures = Textures::new(held_out.textures.as_flattened().to_vec().into());
        let novelty = Novelty::new(measured.into_flattened().into(), textures, held_out.form.clone());
        (novelty, half_split)
    }

    /// Reference frames of the part of a trip around a trained frame, but so few that neighbours enough are left.
    ///
    /// * `n_around` — trained frames before it and after it
    fn around(&self, trained: u32, trips: &[usize], n_around: usize) -> Range<u32> {
        let indices = self.references.indices();
        let trained = trained as usize;
        let trip = trip_of(trained, trips);
        let first = trained.saturating_sub(n_around).max(trip.start);
        let end = (trained + n_around + 1).min(trip.end);
        let place = |trained: usize| indices.partition_point(|&index| (index as usize) < trained);
        let (mut hidden, middle) = (place(first)..place(end), place(trained));
        let n_hidden_max = indices.len().saturating_sub(self.n_neighbors);
        while hidden.len() > n_hidden_max {
            match middle - hidden.start >= hidden.end - middle {
                true => hidden.start += 1,
                false => hidden.end -= 1,
            }
        }
        hidden.start as u32..hidden.end as u32
    }
}

/// The trained frames of the trip that one of them is of.
fn trip_of(trained: usize, trips: &[usize]) -> Range<usize> {
    let mut begin = 0;
    for n_frames in trips {
        if trained < begin + n_frames {
            return begin..begin + n_frames;
        }
        begin += n_frames;
    }
    unreachable!("every trained frame is of a trip")
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    fn measures(frames: &[Measures]) -> Novelty {
        let (sorted, highest_ranks) = ranked(frames);
        let none = || Vec::new().into();
        Novelty { sorted, highest_ranks, measured: none(), textures: Textures::new(none()), form: None }
    }

    proptest! {
        #[test]
        fn of_held_out_frames_themselves_no_more_than_any_rate_are_that_novel(
            frames in prop::collection::vec(prop::array::uniform5(prop_oneof![0.0..3.0_f64, Just(1.0), Just(2.0)]), 1..200),
            rate in 0.0..1.0_f64,
        ) {
            let novelty = measures(&frames);
            let n_flagged = frames.iter().filter(|frame| novelty.by(frame) >= 1.0 - rate).count();
            // Novelties are multiples of 1 / n, and 1 − (1 − rate) is rounded.
            prop_assert!(n_flagged as f64 <= rate * frames.len() as f64 + 1e-9, "{} of {}", n_flagged, frames.len());
        }

        #[test]
        fn novelty_is_the_rank_of_the_highest_of_five_ranks_and_never_falls_as_a_measure_rises(
            frames in prop::collection::vec(prop::array::uniform5(0.0..3.0_f64), 1..50),
            frame in prop::array::uniform5(0.0..4.0_f64),
            more in 0.0..1.0_f64,
            measure in 0..N_MEASURES,
        ) {
            let highest = |frame: &Measures| {
                let below = |measure: usize| frames.iter().filter(|usual| usual[measure] < frame[measure]).count();
                (0..N_MEASURES).map(below).max().unwrap()
            };
            let novelty = measures(&frames);
            let n_below = frames.iter().filter(|usual| highest(usual) < highest(&frame)).count();
            prop_assert_eq!(novelty.by(&frame), n_below as f64 / frames.len() as f64);
            let mut farther = frame;
            farther[measure] += more;
            prop_assert!(novelty.by(&farther) >= novelty.by(&frame));
        }
    }

    #[test]
    fn a_frame_beyond_all_in_one_measure_or_that_cannot_be_measured_is_as_novel_as_can_be() {
        let novelty = measures(&[[1.0; 5], [2.0; 5], [3.0; 5]]);
        assert_eq!(novelty.by(&[0.0, 0.0, 0.0, 3.5, 0.0]), 1.0);
        assert_eq!(novelty.by(&[0.0, f64::NAN, 0.0, 0.0, 0.0]), 1.0);
        assert_eq!(novelty.by(&[0.0, 0.0, 0.0, 0.0, -f64::NAN]), 1.0);
        assert_eq!(novelty.by(&[0.0; 5]), 0.0);
        assert_eq!(novelty.by(&[2.5, 0.0, 0.0, 0.0, 0.0]), 2.0 / 3.0);
    }

    #[test]
    fn what_is_hidden_is_the_part_of_the_trip_around_a_frame_and_never_too_much() {
        let mixture = Mixture::new(1, vec![1.0], vec![0.0], vec![1.0]).unwrap();
        let frames = crate::frames::Frames::new(1, vec![0; 100]);
        let manifold = Manifold { frames: &frames, landmarks: &[], geodesics: None, embedding: None };
        let hidden = |references: &ReferenceSet, n_neighbors, trained, trips: &[usize]| {
            let usual = Usual { manifold, mixture: &mixture, references, coordinates: &[], n_neighbors };
            usual.around(trained, trips, 3)
        };
        let all = ReferenceSet::all(100);
        assert_eq!(hidden(&all, 10, 50, &[100]), 47..54);
        assert_eq!(hidden(&all, 10, 0, &[100]), 0..4);
        assert_eq!(hidden(&all, 10, 99, &[100]), 96..100);
        // Another trip's frames are no neighbours in time.
        assert_eq!(hidden(&all, 10, 49, &[50, 50]), 46..50);
        assert_eq!(hidden(&all, 10, 50, &[50, 50]), 50..54);
        assert_eq!(hidden(&all, 95, 50, &[100]), 48..53);
        assert_eq!(hidden(&all, 99, 50, &[100]), 50..51);
        // Every tenth is kept: at most one of them is near.
        let indices: Vec<u32> = (0..10).map(|index| 10 * index).collect();
        let nearest: Vec<u32> = (0..100).map(|index| index / 10).collect();
        let thinned = ReferenceSet::from_parts(indices.into(), nearest.into());
        assert_eq!(hidden(&thinned, 4, 50, &[100]), 5..6);
        assert_eq!(hidden(&thinned, 4, 55, &[100]), 6..6);
    }
}
