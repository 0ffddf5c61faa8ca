//! Runs of one kind along a trip: where kinds fit the place, neighbouring frames share them.

use std::ops::Range;

/// How long one kind lasts.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Runs {
    /// Mean number of successive frames of one kind.
    pub mean_length: f64,
    /// What that would be if the same frames came in any order: kinds that say nothing of a place.
    pub mean_length_shuffled: f64,
}

impl Runs {
    /// Counts the runs of a trip's kinds.
    ///
    /// * `kinds` — kind of each frame, in order of time; at least one
    ///
    /// Among all orders of n frames, n_k of them of kind k, there are `n + 1 − Σ n_k² / n` runs in the mean (Wald &
    /// Wolfowitz 1940, *On a test whether two samples are from the same population*, for any number of kinds).
    pub fn of(kinds: &[usize]) -> Self {
        let n_frames = kinds.len() as f64;
        let n_runs = runs(kinds).count();
        let mut n_frames_of = vec![0.0; kinds.iter().max().map_or(0, |last| last + 1)];
        kinds.iter().for_each(|&kind| n_frames_of[kind] += 1.0);
        let squares: f64 = n_frames_of.iter().map(|n| n * n).sum();
        Self {
            mean_length: n_frames / n_runs as f64,
            mean_length_shuffled: n_frames / (n_frames + 1.0 - squares / n_frames),
        }
    }
}

/// Stretches of frames of one kind, as long as they can be: the frames, and the kind.
pub(crate) fn runs<K: Copy + PartialEq>(kinds: &[K]) -> impl Iterator<Item = (Range<usize>, K)> {
    let mut start = 0;
    kinds.chunk_by(|a, b| a == b).map(move |run| {
        let frames = start..start + run.len();
        start = frames.end;
        (frames, run[0])
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Mean number of runs over all orders of these kinds, by trying them all.
    fn n_runs_of_all_orders(kinds: &mut Vec<usize>, n_placed: usize) -> (f64, f64) {
        if n_placed == kinds.len() {
            let n_runs = 1 + kinds.windows(2).filter(|pair| pair[0] != pair[1]).count();
            return (n_runs as f64, 1.0);
        }
        let (mut sum, mut n_orders) = (0.0, 0.0);
        for index in n_placed..kinds.len() {
            kinds.swap(n_placed, index);
            let (runs, orders) = n_runs_of_all_orders(kinds, n_placed + 1);
            (sum, n_orders) = (sum + runs, n_orders + orders);
            kinds.swap(n_placed, index);
        }
        (sum, n_orders)
    }

    #[test]
    fn what_shuffling_gives_is_the_mean_over_all_orders() {
        for kinds in [vec![0], vec![0, 0, 0], vec![0, 1, 1, 0, 2], vec![3, 3, 1, 1, 3, 0, 0]] {
            let (sum, n_orders) = n_runs_of_all_orders(&mut kinds.clone(), 0);
            let expected = kinds.len() as f64 / (sum / n_orders);
            assert!((Runs::of(&kinds).mean_length_shuffled - expected).abs() < 1e-12, "{kinds:?}");
        }
    }

    #[test]
    fn a_run_is_as_long_as_the_kind_lasts() {
        assert_eq!(Runs::of(&[4, 4, 4, 1, 1, 4]).mean_length, 2.0);
        assert_eq!(Runs::of(&[2; 7]).mean_length, 7.0);
    }

    #[test]
    fn runs_are_the_longest_stretches_of_one_kind_and_leave_no_frame_out() {
        let found: Vec<_> = runs(&[4, 4, 0, 4, 4, 4]).collect();
        assert_eq!(found, [(0..2, 4), (2..3, 0), (3..6, 4)]);
        assert_eq!(runs::<usize>(&[]).count(), 0);
    }
}
