//! Half-split error: how far apart two halves of a frame's nearest reference frames place it.
//!
//! A place that neighbours agree about is known, whatever it looks like; where they disagree the manifold that was learnt does not go
//! through the frame. The ns nearest reference frames are dealt by turns to two halves, the 1st, 3rd, … and the 2nd, 4th, …. Each
//! places the frame by itself, by the one formula `e = P (δ̄ − δ)` with δ through that half alone, and the error is `‖e_A − e_B‖`, as
//! a share of the radius of all trained places. No frame is searched for that was not found already.
//!
//! What is usual is the median of the frames that novelty is learnt from, with the part of the trip around them hidden
//! ([`novelty`](crate::novelty)), as places are that a second trip comes by. Over six pairs of trips, two recorded and four simulated, the
//! second trip's median was .94 to 1.09 times that, on a made-up loop whose two trips are more alike .5 times. It says what novelty is
//! blind to: of a simulated Crunch's ring that is turned by one reading 5 % are novel, with two readings dead 6 %, and the error is 1.9 and
//! 1.8 times the usual one. Of the simulated Chew's camera with another gain or dead pixels, or in another world of the same sort, it says
//! nothing: .9 to 1.0.
//!
//! It depends on the place, and says little of a robot that stays at one: .6 to 2.3 times the usual.

use serde::{Deserialize, Serialize};

use crate::neighbors::Neighbor;
use crate::out_of_sample::Manifold;

/// What half-split errors mean.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct HalfSplitManifest {
    /// Root mean square distance of the trained frames from their mean, counts: what errors are a share of.
    pub radius: f64,
    /// Median error of the frames that were held out, a share of the radius.
    pub usual: f64,
}

impl HalfSplitManifest {
    /// * `coordinates` — of the trained frames, shape `(n_trained, n_dims)`, counts
    /// * `errors` — of the frames that were held out, counts; without any there is nothing to say
    pub(crate) fn learn(coordinates: &[f64], n_dims: usize, mut errors: Vec<f64>) -> Option<Self> {
        let radius = radius(coordinates, n_dims);
        let usual = median(&mut errors)? / radius;
        (radius > 0.0).then_some(Self { radius, usual })
    }

    /// Whether it can be.
    pub(crate) fn is_sound(&self) -> bool {
        let Self { radius, usual } = *self;
        radius.is_finite() && radius > 0.0 && usual.is_finite() && usual >= 0.0
    }
}

/// Root mean square distance from the mean.
fn radius(coordinates: &[f64], n_dims: usize) -> f64 {
    let n_frames = (coordinates.len() / n_dims) as f64;
    let variance = |dim: usize| {
        let along = coordinates.iter().skip(dim).step_by(n_dims);
        let mean = along.clone().sum::<f64>() / n_frames;
        along.map(|place| (place - mean) * (place - mean)).sum::<f64>() / n_frames
    };
    (0..n_dims).map(variance).sum::<f64>().sqrt()
}

/// The middle one, of an even number the upper of the two; none of none.
///
/// * `numbers` — left in another order
pub fn median(numbers: &mut [f64]) -> Option<f64> {
    let middle = numbers.len() / 2;
    (!numbers.is_empty()).then(|| *numbers.select_nth_unstable_by(middle, f64::total_cmp).1)
}

/// Memory that measuring takes.
pub(crate) struct HalfSplit {
    /// Shortest lengths to the landmarks through a half, shape `(n_landmarks,)`, counts.
    lengths: Vec<f32>,
    /// δ, shape `(n_landmarks,)`, counts².
    squared_geodesics: Vec<f64>,
    /// Where each half places the frame, shape `(n_dims,)`, counts.
    places: [Vec<f64>; 2],
}

impl HalfSplit {
    pub(crate) fn new(manifold: Manifold) -> Self {
        let (n_landmarks, n_dims) =
            manifold.embedding.map_or((0, 0), |embedding| (embedding.n_landmarks(), embedding.n_dims()));
        Self {
            lengths: vec![0.0; n_landmarks],
            squared_geodesics: vec![0.0; n_landmarks],
            places: [vec![0.0; n_dims], vec![0.0; n_dims]],
        }
    }

    /// `‖e_A − e_B‖`, counts; none without geodesics, or where one neighbour has no other half.
    ///
    /// * `nearest` — reference frames nearest to the frame, nearest first
    ///
    /// Allocates nothing. O(n_landmarks · (ns + n_dims)).
    pub(crate) fn error(&mut self, manifold: Manifold, nearest: &[Neighbor]) -> Option<f64> {
        let (geodesics, embedding) = manifold.geodesics.zip(manifold.embedding)?;
        let Self { lengths, squared_geodesics, places } = self;
        if nearest.len() < 2 {
            return None;
        }
        for (first, place) in places.iter_mut().enumerate() {
            let half = nearest.iter().skip(first).step_by(2);
            geodesics.through(half.map(|near| (near.frame_index, near.distance())), lengths);
            for (squared, &length) in squared_geodesics.iter_mut().zip(&*lengths) {
                *squared = f64::from(length) * f64::from(length);
            }
            embedding.embed(squared_geodesics, place);
        }
        let [a, b] = places;
        Some(a.iter().zip(&*b).map(|(a, b)| (a - b) * (a - b)).sum::<f64>().sqrt())
    }
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use proptest::prelude::*;

    use super::*;
    use crate::metric::{Euclidean, Metric};
    use crate::testing::{Sort, frames_of, layout};
    use crate::{Classifier, FitPlan, Method, Model, Origin, ResponsePlan, Scale, fit};

    const N_FRAMES: usize = 90;

    fn model(method: Method, n_neighbors: usize) -> Model {
        let plan = FitPlan {
            method,
            n_neighbors: Some(n_neighbors),
            n_landmarks: 30,
            n_dims: if method == Method::Native { None } else { Some(3) },
            n_kinds: Some(2),
            ..FitPlan::new(layout(1, 6), ResponsePlan::new(Scale::Range, 60.0), 1)
        };
        let frames = frames_of(Sort::Noisy, layout(1, 6), N_FRAMES, 3);
        fit(frames, &plan, Origin::default(), &mut |_, _, _| ()).unwrap()
    }

    /// By the definition: all frames sorted, dealt, and each half's shortest lengths looked up one by one; counts.
    fn plainly(model: &Model, row: &[u16], is_there: impl Fn(usize) -> bool) -> f64 {
        let frames = model.frames();
        let mut sorted: Vec<usize> = (0..frames.n_frames()).filter(|index| is_there(*index)).collect();
        sorted.sort_by_key(|&index| Euclidean.squared_distance(row, frames.row(index)));
        sorted.truncate(model.manifest().n_neighbors);
        let geodesics = model.geodesics().unwrap();
        let places = [0, 1].map(|first| {
            let through = |landmark: usize| {
                let half = sorted.iter().skip(first).step_by(2).map(|&index| {
                    let distance = (Euclidean.squared_distance(row, frames.row(index)) as f64).sqrt() as f32;
                    distance + geodesics.row(index)[landmark]
                });
                f64::from(half.fold(f32::INFINITY, f32::min)).powi(2)
            };
            let delta: Vec<f64> = (0..geodesics.n_landmarks()).map(through).collect();
            let mut place = vec![0.0; model.manifest().n_dims];
            model.embedding().unwrap().embed(&delta, &mut place);
            place
        });
        let squares = places[0].iter().zip(&places[1]).map(|(a, b)| (a - b).powi(2));
        squares.sum::<f64>().sqrt()
    }

    #[test]
    fn the_error_is_how_far_apart_the_halves_place_a_frame_as_if_each_were_all_neighbours() {
        for n_neighbors in [2, 3, 8, 15] {
            let model = Arc::new(model(Method::Isomap, n_neighbors));
            let mut classifier = Classifier::new(Arc::clone(&model));
            let radius = model.manifest().half_split.unwrap().radius;
            for frame in frames_of(Sort::Noisy, layout(1, 6), 40, 9).chunks_exact(6) {
                classifier.classify(frame);
                let mut row = frame.to_vec();
                model.response().map_in_place(&mut row);
                let expected = plainly(&model, &row, |_| true) / radius;
                assert_eq!(classifier.half_split_error(), Some(expected), "{n_neighbors} neighbours");
                assert!(expected > 0.0);
            }
        }
    }

    #[test]
    fn what_is_usual_is_the_median_of_trained_frames_with_the_part_of_the_trip_around_them_hidden() {
        let model = model(Method::Isomap, 8);
        let HalfSplitManifest { radius, usual } = model.manifest().half_split.unwrap();
        let places: Vec<&[f64]> = model.coordinates().chunks_exact(3).collect();
        // Half of the mean square of all distances between two is that from the mean.
        let squares = places
            .iter()
            .flat_map(|a| places.iter().map(|b| a.iter().zip(*b).map(|(a, b)| (a - b).powi(2)).sum::<f64>()));
        let expected = (squares.sum::<f64>() / 2.0).sqrt() / N_FRAMES as f64;
        assert!((radius / expected - 1.0).abs() < 1e-12, "{radius} {expected}");

        // So few frames are all held out, and all of one trip.
        assert_eq!(model.manifest().novelty.n_held_out, N_FRAMES);
        let n_around =
            (0.5 * N_FRAMES as f64 / model.manifest().provenance.n_frames_effective).ceil() as usize;
        let error =
            |held: usize| plainly(&model, model.frames().row(held), |index| index.abs_diff(held) > n_around);
        let mut errors: Vec<f64> = (0..N_FRAMES).map(error).collect();
        errors.sort_by(f64::total_cmp);
        assert_eq!(usual, errors[N_FRAMES / 2] / radius);
        let beside_themselves = plainly(&model, model.frames().row(40), |_| true);
        assert!(beside_themselves < error(40), "frames beside their neighbours in time say nothing");
    }

    #[test]
    fn there_is_none_of_one_neighbour_without_a_graph_or_of_an_invalid_frame() {
        for (method, n_neighbors) in [(Method::Isomap, 1), (Method::Pca, 8), (Method::Native, 8)] {
            let model = model(method, n_neighbors);
            assert_eq!(model.manifest().half_split, None, "{method:?}");
            let mut classifier = Classifier::new(Arc::new(model));
            classifier.classify(&[1000; 6]);
            assert_eq!(classifier.half_split_error(), None, "{method:?}");
        }
        let mut classifier = Classifier::new(Arc::new(model(Method::Isomap, 8)));
        classifier.classify(&[1000; 6]);
        assert!(classifier.half_split_error().is_some());
        classifier.classify(&[0; 6]);
        assert_eq!(classifier.half_split_error(), None);
    }

    proptest! {
        #[test]
        fn as_many_numbers_are_below_the_median_as_above_it_or_one_more(
            numbers in prop::collection::vec(prop_oneof![0.0..1.0_f64, Just(0.5)], 1..50),
        ) {
            prop_assert_eq!(median(&mut []), None);
            let median = median(&mut numbers.clone()).unwrap();
            let below = numbers.iter().filter(|number| **number < median).count();
            let above = numbers.iter().filter(|number| **number > median).count();
            prop_assert!(below <= numbers.len() / 2 && above <= (numbers.len() - 1) / 2, "{} {}", below, above);
        }
    }
}
