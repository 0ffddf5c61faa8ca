//! Geodesic stress: how badly a place fits the lengths that it was embedded by.
//!
//! The embedding alone is blind to frames unlike any seen, since it maps anything onto the training span. But where a
//! frame lies off the manifold, its lengths to the landmarks are not the distances from its place to theirs:
//! `mean_i (√δ_i − ‖e − e_i‖)²`, i over the landmarks.
//!
//! In `f32`: it is only compared with others, computed alike. Landmarks stand side by side in lanes, so that each lane adds
//! in one order whatever the instructions.

use crate::model::N_DIMS_MAX;
use crate::simd::Instructions;

/// Landmarks that are taken side by side.
const N_LANES: usize = 16;

/// One number for each of some landmarks.
type Lanes = [f32; N_LANES];

/// The landmarks' places, ready to be measured from.
pub(crate) struct Stress {
    n_dims: usize,
    n_landmarks: usize,
    /// Shape `(n_landmarks / N_LANES, n_dims, N_LANES)`, counts; 0 beyond the last landmark.
    places: Vec<Lanes>,
}

impl Stress {
    /// * `place_of` — the place of a landmark, by its place among them, shape `(n_dims,)`, counts
    pub(crate) fn new<'a>(n_landmarks: usize, n_dims: usize, place_of: impl Fn(usize) -> &'a [f64]) -> Self {
        let mut places = vec![[0.0; N_LANES]; n_landmarks.div_ceil(N_LANES) * n_dims];
        for landmark in 0..n_landmarks {
            let lanes = &mut places[landmark / N_LANES * n_dims..][..n_dims];
            for (lanes, &coordinate) in lanes.iter_mut().zip(place_of(landmark)) {
                lanes[landmark % N_LANES] = coordinate as f32;
            }
        }
        Self { n_dims, n_landmarks, places }
    }

    /// Measures one place, counts²; 0 where there are no landmarks.
    ///
    /// * `lengths` — √δ, shape `(n_landmarks,)`, counts
    /// * `coordinates` — e, shape `(n_dims,)`, counts
    ///
    /// Allocates nothing. O(n_landmarks · n_dims).
    pub(crate) fn of(&self, lengths: &[f32], coordinates: &[f64]) -> f64 {
        self.of_with(Instructions::widest(), lengths, coordinates)
    }

    fn of_with(&self, instructions: Instructions, lengths: &[f32], coordinates: &[f64]) -> f64 {
        assert_eq!(lengths.len(), self.n_landmarks, "one length for each landmark");
        if self.n_landmarks == 0 {
            return 0.0;
        }
        let mut place = [0.0; N_DIMS_MAX];
        place.iter_mut().zip(coordinates).for_each(|(to, &from)| *to = from as f32);
        let sums = instructions.run(
            #[inline(always)]
            || self.sums(lengths, &place[..self.n_dims]),
        );
        sums.iter().map(|&sum| f64::from(sum)).sum::<f64>() / self.n_landmarks as f64
    }

    /// Squared residuals, summed lane by lane.
    #[inline(always)]
    fn sums(&self, lengths: &[f32], place: &[f32]) -> Lanes {
        let (whole, rest) = lengths.as_chunks::<N_LANES>();
        let mut sums = [0.0; N_LANES];
        let mut chunks = self.places.chunks_exact(self.n_dims);
        for (lengths, places) in whole.iter().zip(&mut chunks) {
            let squared = squared_residuals(lengths, places, place);
            for lane in 0..N_LANES {
                sums[lane] += squared[lane];
            }
        }
        if let Some(places) = chunks.next() {
            let mut lengths = [0.0; N_LANES];
            lengths[..rest.len()].copy_from_slice(rest);
            let squared = squared_residuals(&lengths, places, place);
            for lane in 0..rest.len() {
                sums[lane] += squared[lane];
            }
        }
        sums
    }
}

/// `(√δ − ‖e − e_i‖)²` of some landmarks.
#[inline(always)]
fn squared_residuals(lengths: &Lanes, places: &[Lanes], place: &[f32]) -> Lanes {
    let mut squared = [0.0; N_LANES];
    for (places, &coordinate) in places.iter().zip(place) {
        for lane in 0..N_LANES {
            let difference = coordinate - places[lane];
            squared[lane] += difference * difference;
        }
    }
    let mut residuals = [0.0; N_LANES];
    for lane in 0..N_LANES {
        let residual = lengths[lane] - squared[lane].sqrt();
        residuals[lane] = residual * residual;
    }
    residuals
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    /// The formula, in f64, one landmark after the other.
    fn by_formula(places: &[Vec<f64>], lengths: &[f32], place: &[f64]) -> f64 {
        let squared_residual = |of: &[f64], length: f32| -> f64 {
            let squared: f64 = of.iter().zip(place).map(|(a, b)| (a - b) * (a - b)).sum();
            (f64::from(length) - squared.sqrt()).powi(2)
        };
        let terms = places.iter().zip(lengths).map(|(of, &length)| squared_residual(of, length));
        terms.sum::<f64>() / lengths.len() as f64
    }

    proptest! {
        #[test]
        fn stress_is_the_formula_but_for_rounding_and_the_same_bits_by_every_set_of_instructions(
            (places, place) in (1..70_usize, 1..=N_DIMS_MAX).prop_flat_map(|(n_landmarks, n_dims)| {
                let place = prop::collection::vec(-1e5..1e5_f64, n_dims);
                (prop::collection::vec((place.clone(), 0.0..1e6_f32), n_landmarks), place)
            }),
        ) {
            let (places, lengths): (Vec<Vec<f64>>, Vec<f32>) = places.into_iter().unzip();
            let stress = Stress::new(places.len(), place.len(), |landmark| &places[landmark]);
            let found = stress.of(&lengths, &place);
            for instructions in Instructions::all() {
                let again = stress.of_with(instructions, &lengths, &place);
                prop_assert_eq!(again.to_bits(), found.to_bits(), "{:?}", instructions);
            }
            // A residual is of lengths below 2·10⁶, each of some tens of roundings of 2⁻²⁴: it is off by less than 10, and its
            // square by less than 10 times twice itself and 10 more.
            let expected = by_formula(&places, &lengths, &place);
            let tolerance = 20.0 * expected.sqrt() + 100.0 + 1e-5 * expected;
            prop_assert!((found - expected).abs() <= tolerance, "{} {}", found, expected);
        }
    }

    #[test]
    fn a_place_whose_lengths_are_its_distances_is_under_no_stress_and_without_landmarks_nothing_is() {
        let places = [[0.0, 0.0], [3.0, 4.0], [-6.0, 8.0]];
        let stress = Stress::new(3, 2, |landmark| &places[landmark]);
        assert_eq!(stress.of(&[0.0, 5.0, 10.0], &[0.0, 0.0]), 0.0);
        assert_eq!(stress.of(&[3.0, 5.0, 10.0], &[0.0, 0.0]), 3.0);
        assert_eq!(Stress::new(0, 2, |_| &[]).of(&[], &[0.0, 0.0]), 0.0);
    }
}
