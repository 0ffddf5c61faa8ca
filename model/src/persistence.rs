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
//! [`smooth`] is its answer given the frames after one as well, for learning: that of s, and of kinds
//! that are fitted with the knowledge that trips are slow ([`crate::em::fit_over_time`]).
//!
//! The filter has no delay: a frame that speaks clearly for another kind is believed at once, one that does not is taken for more of the same.
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
        self.pass(n_missed);
        if let Some(posterior) = posterior {
            weigh(&mut self.probabilities, posterior, &self.weights);
        }
        &self.probabilities
    }

    /// From the last frame to the next, before that is looked at.
    fn pass(&mut self, n_missed: u64) {
        let kept = match n_missed {
            0 => self.persistence,
            _ => libm::pow(self.persistence, n_missed as f64 + 1.0),
        };
        for (probability, weight) in self.probabilities.iter_mut().zip(&self.weights) {
            *probability = kept * *probability + (1.0 - kept) * weight;
        }
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

/// Weighs probabilities by what a frame says, and returns how likely that was, at any scale.
fn weigh(probabilities: &mut [f64], posterior: &[f64], weights: &[f64]) -> f64 {
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
    sum
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
pub fn learn(posteriors: &[f64], weights: &[f64], trips: &[usize]) -> f64 {
    let n_kinds = weights.len();
    let n_frames = posteriors.len() / n_kinds;
    if n_kinds < N_KINDS_MIN || n_frames <= trips.len() {
        return 0.0;
    }
    let mut persistence = BEGIN;
    for _ in 0..N_ITERATIONS_MAX {
        let mut smoothed = posteriors.to_vec();
        let learnt = smooth(persistence, weights, &mut smoothed, trips).persistence();
        let change = (learnt - persistence).abs();
        persistence = learnt;
        if change < TOLERANCE {
            break;
        }
    }
    persistence
}

/// What is expected of frames, given all of them.
#[derive(Clone, Debug)]
pub(crate) struct Expected {
    n_frames: usize,
    /// Frames that one of the same trip follows.
    n_steps: usize,
    /// Of those that follow one, how many kept its kind.
    n_kept: f64,
    /// Of all, how many had theirs drawn, for each kind, shape `(n_kinds,)`.
    n_drawn: Vec<f64>,
    /// ln likelihood, beyond that of the frames without time.
    pub(crate) log_gain: f64,
}

impl Expected {
    /// The likeliest s, at most such that one change is expected in all frames.
    pub(crate) fn persistence(&self) -> f64 {
        (self.n_kept / self.n_steps as f64).min(1.0 - 1.0 / self.n_frames as f64)
    }

    /// The likeliest α, shape `(n_kinds,)`.
    pub(crate) fn weights(&self) -> Vec<f64> {
        let sum: f64 = self.n_drawn.iter().sum();
        self.n_drawn.iter().map(|n| n / sum).collect()
    }
}

/// Turns what each frame says by itself into what all frames of its trip say of it (Rabiner 1989, eq. 27).
///
/// * `persistence` — s
/// * `weights` — α, shape `(n_kinds,)`
/// * `posteriors` — of each frame by itself, shape `(n_frames, n_kinds)`; overwritten
/// * `trips` — frames of each trip, in order
pub(crate) fn smooth(persistence: f64, weights: &[f64], posteriors: &mut [f64], trips: &[usize]) -> Expected {
    let n_kinds = weights.len();
    let mut expected = Expected {
        n_frames: posteriors.len() / n_kinds,
        n_steps: trips.iter().map(|n_in_trip| n_in_trip.saturating_sub(1)).sum(),
        n_kept: 0.0,
        n_drawn: vec![0.0; n_kinds],
        log_gain: 0.0,
    };
    let mut filter = Filter::new(persistence, weights);
    let mut rest = posteriors;
    for n_in_trip in trips {
        let (trip, after) = rest.split_at_mut(n_in_trip * n_kinds);
        filter.begin();
        smooth_trip(&mut filter, trip, &mut expected);
        rest = after;
    }
    expected
}

/// The same of one trip.
fn smooth_trip(filter: &mut Filter, posteriors: &mut [f64], expected: &mut Expected) {
    let n_kinds = filter.weights.len();
    let mut forward = Vec::with_capacity(posteriors.len());
    for posterior in posteriors.chunks_exact(n_kinds) {
        filter.pass(0);
        expected.log_gain += libm::log(weigh(&mut filter.probabilities, posterior, &filter.weights));
        forward.extend_from_slice(&filter.probabilities);
    }
    let Filter { persistence, ref weights, .. } = *filter;
    // What all frames after one say of its kind, and what they and the one itself say.
    let (mut backward, mut said) = (vec![1.0; n_kinds], vec![0.0; n_kinds]);
    let mut before = forward.chunks_exact(n_kinds).rev();
    let mut of_frame = before.next();
    for posterior in posteriors.chunks_exact_mut(n_kinds).rev() {
        for (kind, said) in said.iter_mut().enumerate() {
            *said = backward[kind] * evidence(posterior[kind], weights[kind]);
        }
        posterior.copy_from_slice(of_frame.expect("as many frames forward as backward"));
        posterior.iter_mut().zip(&backward).for_each(|(all, after)| *all *= after);
        scale_to_one(posterior);
        of_frame = before.next();
        let Some(before) = of_frame else {
            expected.n_drawn.iter_mut().zip(&*posterior).for_each(|(n, all)| *n += all);
            return;
        };
        let along = |probabilities: &[f64]| -> f64 {
            probabilities.iter().zip(&said).map(|(p, said)| p * said).sum()
        };
        let (kept, drawn) = (persistence * along(before), (1.0 - persistence) * along(weights));
        if kept + drawn > 0.0 {
            expected.n_kept += kept / (kept + drawn);
            for ((n, weight), said) in expected.n_drawn.iter_mut().zip(weights).zip(&said) {
                *n += (1.0 - persistence) * weight * said / (kept + drawn);
            }
        }
        backward.iter_mut().zip(&said).for_each(|(backward, said)| *backward = persistence * said + drawn);
        scale_to_one(&mut backward);
    }
}

fn scale_to_one(numbers: &mut [f64]) {
    let sum: f64 = numbers.iter().sum();
    numbers.iter_mut().for_each(|number| *number /= sum);
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
        fn what_is_expected_given_all_frames_is_the_sum_over_all_sequences_of_kinds(
            (weights, frames) in frames(), persistence in 0.01..0.99_f64,
        ) {
            let mut smoothed = frames.concat();
            let found = smooth(persistence, &weights, &mut smoothed, &[frames.len()]);
            let all = sequences(&weights, &frames, persistence);
            let sum: f64 = all.iter().map(|(_, probability)| probability).sum();
            prop_assert!((found.log_gain - sum.ln()).abs() < 1e-10);
            let mean = |of_sequence: &dyn Fn(&[usize]) -> f64| -> f64 {
                all.iter().map(|(kinds, probability)| probability * of_sequence(kinds)).sum::<f64>() / sum
            };
            for (index, smoothed) in smoothed.chunks_exact(weights.len()).enumerate() {
                for (kind, smoothed) in smoothed.iter().enumerate() {
                    let expected = mean(&|kinds| f64::from(u8::from(kinds[index] == kind)));
                    prop_assert!((smoothed - expected).abs() < 1e-12, "{} and {}", smoothed, expected);
                }
            }
            // Of two equal kinds that follow each other, the second was kept or drawn again.
            let kept = |kind: usize| persistence / (persistence + (1.0 - persistence) * weights[kind]);
            let n_kept = mean(&|kinds| {
                kinds.windows(2).filter(|pair| pair[0] == pair[1]).map(|pair| kept(pair[1])).sum()
            });
            prop_assert!((found.n_kept - n_kept).abs() < 1e-10, "{} and {}", found.n_kept, n_kept);
            for (drawn, n_found) in found.n_drawn.iter().enumerate() {
                let n_drawn = mean(&|kinds| {
                    let of_pair = |pair: &[usize]| match (pair[1] == drawn, pair[0] == pair[1]) {
                        (false, _) => 0.0,
                        (true, false) => 1.0,
                        (true, true) => 1.0 - kept(drawn),
                    };
                    f64::from(u8::from(kinds[0] == drawn)) + kinds.windows(2).map(of_pair).sum::<f64>()
                });
                prop_assert!((n_found - n_drawn).abs() < 1e-10, "{} and {}", n_found, n_drawn);
            }
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
