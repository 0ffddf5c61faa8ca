//! Persistence: a robot that was in a place is most likely still there a frame later.
//!
//! The kinds as a hidden Markov model (Rabiner 1989, *A tutorial on hidden Markov models and selected applications in speech
//! recognition*): the kind of a frame is with probability s that of the frame before, and is otherwise drawn by the mixing weights,
//! `A = s I + (1 − s) 1 αᵀ`. So α stays what kinds are without looking, and a frame by itself says of them what it does without
//! time; what is learnt is one number. The *filter* is that model's answer given all frames so far (ibid., eq. 19 and 20, scaled):
//!
//! ```text
//! f_t(j) ∝ p(e_t | j) (s f_{t−1}(j) + (1 − s) α_j),   p(e_t | j) ∝ P(j | e_t) / α_j
//! ```
//!
//! It has no delay: a frame that speaks clearly for another kind is believed at once, one that does not is taken for more of the same.
//! After k frames that nobody saw, s becomes s^(k+1).

use crate::mixture::most_probable;

/// Fewest kinds that can change.
const N_KINDS_MIN: usize = 2;
/// Where learning begins: a change every ten frames.
const BEGIN: f64 = 0.9;
const N_ITERATIONS_MAX: usize = 200;
/// Change of s that ends learning.
const TOLERANCE: f64 = 1e-7;

/// What the kinds of the frames so far say of the kind of the last.
#[derive(Clone, Debug)]
pub struct Filter {
    /// s.
    persistence: f64,
    /// α, shape `(n_kinds,)`.
    weights: Vec<f64>,
    /// f, shape `(n_kinds,)`.
    probabilities: Vec<f64>,
}

impl Filter {
    /// * `persistence` — s, at least 0 and less than 1
    /// * `weights` — α, shape `(n_kinds,)`; sum to 1
    pub fn new(persistence: f64, weights: &[f64]) -> Self {
        Self { persistence, weights: weights.to_vec(), probabilities: weights.to_vec() }
    }

    /// Forgets all frames: those to come are of another trip.
    pub fn begin(&mut self) {
        self.probabilities.copy_from_slice(&self.weights);
    }

    /// Takes one more frame into account.
    ///
    /// * `posterior` — P(j | e) of the frame by itself, shape `(n_kinds,)`; none for a frame that told nothing
    /// * `n_missed` — frames between the last one and this, that nobody saw
    ///
    /// Returns f, shape `(n_kinds,)`: finite, sums to 1. Allocates nothing; the same bits on every machine.
    ///
    /// # Panics
    /// If the posterior is not of as many kinds.
    pub fn take(&mut self, posterior: Option<&[f64]>, n_missed: u64) -> &[f64] {
        let kept = match n_missed {
            0 => self.persistence,
            _ => libm::pow(self.persistence, n_missed as f64 + 1.0),
        };
        for (probability, weight) in self.probabilities.iter_mut().zip(&self.weights) {
            *probability = kept * *probability + (1.0 - kept) * weight;
        }
        if let Some(posterior) = posterior {
            weigh(&mut self.probabilities, posterior, &self.weights);
        }
        &self.probabilities
    }

    /// f, shape `(n_kinds,)`.
    pub fn probabilities(&self) -> &[f64] {
        &self.probabilities
    }

    /// The most probable kind; the first of equals.
    pub fn kind(&self) -> usize {
        most_probable(&self.probabilities)
    }
}

/// What a frame says, at any scale: `P(j | e) / α_j`. Nothing is known of a kind that has no weight.
fn evidence(posterior: f64, weight: f64) -> f64 {
    if weight > 0.0 { posterior / weight } else { 0.0 }
}

/// Weighs probabilities by what a frame says.
fn weigh(probabilities: &mut [f64], posterior: &[f64], weights: &[f64]) {
    assert_eq!(probabilities.len(), posterior.len(), "one probability for each kind");
    let mut sum = 0.0;
    for ((probability, &posterior), &weight) in probabilities.iter_mut().zip(posterior).zip(weights) {
        *probability *= evidence(posterior, weight);
        sum += *probability;
    }
    // What was certain of one kind until a frame is certain of another: the frame is the news.
    if sum > 0.0 && sum.is_finite() {
        probabilities.iter_mut().for_each(|probability| *probability /= sum);
    } else {
        probabilities.copy_from_slice(posterior);
    }
}

/// Learns s from the frames that kinds were learnt from, by Baum–Welch for this one number: s is the expected share of frames whose
/// kind was kept.
///
/// * `posteriors` — of each frame by itself, shape `(n_frames, n_kinds)`
/// * `weights` — α, shape `(n_kinds,)`
/// * `trips` — frames of each trip, in order
///
/// At most such that one change is expected in as many frames; 0 where there is nothing to change. O(n_frames · n_kinds) for some
/// tens of passes.
pub(crate) fn learn(posteriors: &[f64], weights: &[f64], trips: &[usize]) -> f64 {
    let n_kinds = weights.len();
    let n_frames = posteriors.len() / n_kinds;
    if n_kinds < N_KINDS_MIN || n_frames <= trips.len() {
        return 0.0;
    }
    let highest = 1.0 - 1.0 / n_frames as f64;
    let (mut persistence, mut forward) = (BEGIN.min(highest), vec![0.0; posteriors.len()]);
    for _ in 0..N_ITERATIONS_MAX {
        let mut begin = 0;
        let (mut n_kept, mut n_steps) = (0.0, 0);
        for n_in_trip in trips {
            let range = begin * n_kinds..(begin + n_in_trip) * n_kinds;
            n_kept += n_kept_in(&posteriors[range.clone()], weights, persistence, &mut forward[range]);
            n_steps += n_in_trip.saturating_sub(1);
            begin += n_in_trip;
        }
        let learnt = (n_kept / n_steps as f64).min(highest);
        let change = (learnt - persistence).abs();
        persistence = learnt;
        if change < TOLERANCE {
            break;
        }
    }
    persistence
}

/// Expected number of frames in a trip whose kind was kept from the frame before.
///
/// * `posteriors` — shape `(n_frames, n_kinds)`
/// * `forward` — of the same shape; overwritten
fn n_kept_in(posteriors: &[f64], weights: &[f64], persistence: f64, forward: &mut [f64]) -> f64 {
    let n_kinds = weights.len();
    let mut filter = Filter::new(persistence, weights);
    for (posterior, forward) in posteriors.chunks_exact(n_kinds).zip(forward.chunks_exact_mut(n_kinds)) {
        forward.copy_from_slice(filter.take(Some(posterior), 0));
    }
    let (mut n_kept, mut backward) = (0.0, vec![1.0; n_kinds]);
    let before = forward.chunks_exact(n_kinds);
    let steps = before.zip(posteriors.chunks_exact(n_kinds).skip(1));
    for (before, posterior) in steps.rev() {
        // What this frame and all after it say of a kind.
        for ((backward, &posterior), &weight) in backward.iter_mut().zip(posterior).zip(weights) {
            *backward *= evidence(posterior, weight);
        }
        let along = |probabilities: &[f64]| -> f64 {
            probabilities.iter().zip(&backward).map(|(probability, backward)| probability * backward).sum()
        };
        let (kept, drawn) = (persistence * along(before), (1.0 - persistence) * along(weights));
        if kept + drawn > 0.0 {
            n_kept += kept / (kept + drawn);
        }
        let sum: f64 = backward
            .iter_mut()
            .map(|backward| {
                *backward = persistence * *backward + drawn;
                *backward
            })
            .sum();
        backward.iter_mut().for_each(|backward| *backward /= sum);
    }
    n_kept
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;
    use rand::RngExt;
    use rand_chacha::ChaCha8Rng;
    use rand_chacha::rand_core::SeedableRng;

    use super::*;
    use crate::mixture::Mixture;

    fn distribution(n_kinds: usize) -> impl Strategy<Value = Vec<f64>> {
        prop::collection::vec(0.01..1.0_f64, n_kinds).prop_map(|numbers| {
            let sum: f64 = numbers.iter().sum();
            numbers.iter().map(|number| number / sum).collect()
        })
    }

    /// Weights, and posteriors of some frames.
    fn frames() -> impl Strategy<Value = (Vec<f64>, Vec<Vec<f64>>)> {
        (1..5_usize).prop_flat_map(|n_kinds| {
            (distribution(n_kinds), prop::collection::vec(distribution(n_kinds), 1..6))
        })
    }

    /// Probability of every sequence of kinds together with what frames say, by the definition.
    fn sequences(weights: &[f64], frames: &[Vec<f64>], persistence: f64) -> Vec<(Vec<usize>, f64)> {
        let n_kinds = weights.len();
        let mut all = vec![(Vec::new(), 1.0)];
        for posterior in frames {
            let further = |(kinds, probability): &(Vec<usize>, f64)| {
                let (kinds, probability) = (kinds.clone(), *probability);
                (0..n_kinds)
                    .map(move |kind| {
                        let drawn = match kinds.last() {
                            None => 1.0,
                            Some(_) => 1.0 - persistence,
                        };
                        let kept = if kinds.last() == Some(&kind) { persistence } else { 0.0 };
                        let step = kept + drawn * weights[kind];
                        ([&kinds[..], &[kind]].concat(), probability * step * posterior[kind] / weights[kind])
                    })
                    .collect::<Vec<_>>()
            };
            all = all.iter().flat_map(further).collect();
        }
        all
    }

    proptest! {
        #[test]
        fn the_filter_is_the_sum_over_all_sequences_of_kinds(
            (weights, frames) in frames(), persistence in 0.0..0.999_f64,
        ) {
            let mut filter = Filter::new(persistence, &weights);
            frames.iter().for_each(|posterior| { filter.take(Some(posterior), 0); });
            let all = sequences(&weights, &frames, persistence);
            let sum: f64 = all.iter().map(|(_, probability)| probability).sum();
            for (kind, found) in filter.probabilities().iter().enumerate() {
                let ending = all.iter().filter(|(kinds, _)| kinds.last() == Some(&kind));
                let expected = ending.map(|(_, probability)| probability).sum::<f64>() / sum;
                prop_assert!((found - expected).abs() < 1e-12, "{} and {}", found, expected);
            }
        }

        #[test]
        fn frames_that_nobody_saw_are_as_many_that_told_nothing(
            (weights, frames) in frames(), persistence in 0.0..0.999_f64, n_missed in 0..40_u64,
        ) {
            let mut filter = Filter::new(persistence, &weights);
            frames.iter().for_each(|posterior| { filter.take(Some(posterior), 0); });
            let mut other = filter.clone();
            filter.take(Some(&frames[0]), n_missed);
            (0..n_missed).for_each(|_| { other.take(None, 0); });
            other.take(Some(&frames[0]), 0);
            for (found, expected) in filter.probabilities().iter().zip(other.probabilities()) {
                prop_assert!((found - expected).abs() < 1e-12);
            }
        }

        #[test]
        fn without_persistence_a_frame_stands_by_itself(
            (weights, frames) in frames(),
        ) {
            let mut filter = Filter::new(0.0, &weights);
            for posterior in &frames {
                for (found, expected) in filter.take(Some(posterior), 0).iter().zip(posterior) {
                    prop_assert!((found - expected).abs() < 1e-12);
                }
            }
        }

        #[test]
        fn kept_kinds_are_counted_as_the_sum_over_all_sequences_says(
            (weights, frames) in frames(), persistence in 0.01..0.99_f64,
        ) {
            let posteriors = frames.concat();
            let found = n_kept_in(&posteriors, &weights, persistence, &mut vec![0.0; posteriors.len()]);
            let all = sequences(&weights, &frames, persistence);
            let sum: f64 = all.iter().map(|(_, probability)| probability).sum();
            // Of two equal kinds that follow each other, the second was kept or drawn again.
            let n_kept = |kinds: &[usize]| -> f64 {
                let kept = |kind: usize| persistence / (persistence + (1.0 - persistence) * weights[kind]);
                kinds.windows(2).filter(|pair| pair[0] == pair[1]).map(|pair| kept(pair[1])).sum()
            };
            let expected = all.iter().map(|(kinds, probability)| probability * n_kept(kinds)).sum::<f64>() / sum;
            prop_assert!((found - expected).abs() < 1e-10, "{} and {}", found, expected);
        }
    }

    #[test]
    fn what_is_certain_gives_way_to_what_is_certain_of_another_kind() {
        let mut filter = Filter::new(1.0 - 1e-9, &[0.5, 0.5]);
        (0..1000).for_each(|_| {
            filter.take(Some(&[1.0, 0.0]), 0);
        });
        assert_eq!((filter.kind(), filter.take(Some(&[0.0, 1.0]), 0)), (0, &[0.0, 1.0][..]));
        let mut never = Filter::new(0.5, &[1.0, 0.0]);
        assert_eq!(never.take(Some(&[0.0, 1.0]), 0), [0.0, 1.0]);
        never.begin();
        assert_eq!(never.probabilities(), [1.0, 0.0]);
    }

    #[test]
    fn the_persistence_that_made_a_trip_is_learnt_from_it() {
        let mut random = ChaCha8Rng::seed_from_u64(3);
        let mixture = Mixture::new(1, vec![0.3, 0.7], vec![0.0, 4.0], vec![1.0, 1.0]).unwrap();
        let mut kind = 0;
        let mut place = || {
            if random.random_bool(0.05) {
                kind = usize::from(random.random_bool(0.7));
            }
            // The sum of twelve uniform numbers has a variance of 1.
            4.0 * kind as f64 + (0..12).map(|_| random.random_range(-0.5..0.5)).sum::<f64>()
        };
        let posterior = |place: f64| {
            let mut posterior = [0.0; 2];
            mixture.posterior(&[place], &mut posterior);
            posterior
        };
        let posteriors: Vec<[f64; 2]> = (0..20_000).map(|_| posterior(place())).collect();
        let posteriors = posteriors.as_flattened();
        // A thousand changes are drawn, give or take thirty or so.
        let found = learn(posteriors, mixture.weights(), &[15_000, 5000]);
        assert!((found - 0.95).abs() < 0.005, "{found}");
        assert_eq!(learn(&[1.0; 20_000], &[1.0], &[20_000]), 0.0);
        assert_eq!(learn(&posteriors[..4], mixture.weights(), &[1, 1]), 0.0);
        assert_eq!(learn([posterior(0.0); 100].as_flattened(), mixture.weights(), &[100]), 0.99);
    }
}
