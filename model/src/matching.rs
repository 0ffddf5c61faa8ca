//! Matching: which kind of one mixture is which of another, by what both say of the same frames.
//!
//! The overlap of two kinds is the sum over frames of the product of their probabilities: the frames that both claim. Of all ways
//! to give each kind at most one partner, that with the largest sum of overlaps is taken (Kuhn 1955, *The Hungarian method for the
//! assignment problem*), so that as many frames as can keep their kind. It pairs all that it can; so of its pairs only those
//! count whose kinds agree.

use pathfinding::kuhn_munkres::kuhn_munkres;
use pathfinding::matrix::Matrix;

/// Least agreement of kinds that count as one. The largest part of a kind that fell into three still is that kind.
pub(crate) const AGREEMENT_MIN: f64 = 0.25;

/// Overlaps are compared to a millionth of a frame.
const STEPS_PER_FRAME: f64 = 1e6;

/// Two kinds that are one.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Match {
    /// Index of the one.
    pub(crate) before: usize,
    /// Index of the other.
    pub(crate) after: usize,
    /// Frames that both claim, as a share of those that either claims.
    pub(crate) agreement: f64,
}

/// Frames that each two kinds both claim, shape `(n_before, n_after)`.
///
/// * `before`, `after` — probabilities of each frame's kinds, in the same order of frames
pub(crate) fn overlaps<'a>(
    (n_before, n_after): (usize, usize),
    before: impl Iterator<Item = &'a [f64]>,
    after: impl Iterator<Item = &'a [f64]>,
) -> Vec<f64> {
    let mut overlaps = vec![0.0; n_before * n_after];
    for (before, after) in before.zip(after) {
        for (row, p) in overlaps.chunks_exact_mut(n_after).zip(before) {
            row.iter_mut().zip(after).for_each(|(overlap, q)| *overlap += p * q);
        }
    }
    overlaps
}

/// The kinds that are one, by rising index of the first.
///
/// * `overlaps` — shape `(n_before, n_after)`, both at least 1
pub(crate) fn matches(overlaps: &[f64], n_after: usize) -> Vec<Match> {
    let n_before = overlaps.len() / n_after;
    let steps = overlaps.iter().map(|overlap| (overlap * STEPS_PER_FRAME).round() as i64).collect();
    let weights = Matrix::from_vec(n_before, n_after, steps).expect("a row for each kind");
    // It wants no more rows than columns.
    let pairs: Vec<(usize, usize)> = match n_before <= n_after {
        true => kuhn_munkres(&weights).1.into_iter().enumerate().collect(),
        false => {
            let (_, partners) = kuhn_munkres(&weights.transposed());
            partners.into_iter().enumerate().map(|(after, before)| (before, after)).collect()
        }
    };
    let of_before = |before: usize| overlaps[before * n_after..][..n_after].iter().sum::<f64>();
    let of_after = |after: usize| overlaps.iter().skip(after).step_by(n_after).sum::<f64>();
    let agreement = |(before, after): (usize, usize)| {
        let both = overlaps[before * n_after + after];
        Match { before, after, agreement: both / (of_before(before) + of_after(after) - both) }
    };
    let mut matches: Vec<Match> =
        pairs.into_iter().map(agreement).filter(|pair| pair.agreement >= AGREEMENT_MIN).collect();
    matches.sort_by_key(|pair| pair.before);
    matches
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    /// The largest sum of overlaps, by trying everything: each kind with every partner that is left, or with none.
    fn largest(overlaps: &[f64], n_after: usize, taken: &mut Vec<usize>) -> f64 {
        let Some((row, others)) = overlaps.split_at_checked(n_after) else { return 0.0 };
        let mut best = largest(others, n_after, taken);
        for (after, overlap) in row.iter().enumerate() {
            if !taken.contains(&after) {
                taken.push(after);
                best = best.max(overlap + largest(others, n_after, taken));
                taken.pop();
            }
        }
        best
    }

    fn overlaps_of_any() -> impl Strategy<Value = (usize, Vec<f64>)> {
        (1..6_usize, 1..6_usize).prop_flat_map(|(n_before, n_after)| {
            let overlaps = prop::collection::vec(0.5..100.0_f64, n_before * n_after);
            overlaps.prop_map(move |overlaps| (n_after, overlaps))
        })
    }

    proptest! {
        #[test]
        fn pairs_have_the_largest_sum_of_overlaps_and_none_that_agree_too_little_counts((n_after, overlaps) in overlaps_of_any()) {
            let n_before = overlaps.len() / n_after;
            let matches = matches(&overlaps, n_after);
            let overlap = |pair: &Match| overlaps[pair.before * n_after + pair.after];
            let sum: f64 = matches.iter().map(overlap).sum();
            let best = largest(&overlaps, n_after, &mut Vec::new());
            // A pair that does not count shares less than a quarter of what either claims, so less than a fifth of both sums; each
            // overlap is rounded once.
            let left_out = |is_left_out: &dyn Fn(usize, usize) -> bool| -> f64 {
                let cells = (0..n_before).flat_map(|before| (0..n_after).map(move |after| (before, after)));
                cells.filter(|&(before, after)| is_left_out(before, after)).map(|(before, after)| overlaps[before * n_after + after]).sum()
            };
            let most_left_out = 0.2 * (left_out(&|before, _| matches.iter().all(|pair| pair.before != before))
                + left_out(&|_, after| matches.iter().all(|pair| pair.after != after)));
            prop_assert!(sum <= best + 1e-5 && best <= sum + most_left_out + 1e-5, "{} + {} < {}", sum, most_left_out, best);
            prop_assert!(matches.iter().all(|pair| (AGREEMENT_MIN..=1.0 + 1e-12).contains(&pair.agreement)));
            prop_assert!(matches.windows(2).all(|pairs| pairs[0].before < pairs[1].before));
            let mut after: Vec<usize> = matches.iter().map(|pair| pair.after).collect();
            after.sort_unstable();
            after.dedup();
            prop_assert_eq!(after.len(), matches.len());
        }

        #[test]
        fn in_which_order_kinds_stand_does_not_matter((n_after, overlaps) in overlaps_of_any(), seed in any::<u64>()) {
            let n_before = overlaps.len() / n_after;
            let turn = |n: usize| move |kind: usize| (kind + seed as usize % n) % n;
            let (row, column) = (turn(n_before), turn(n_after));
            let mut turned = vec![0.0; overlaps.len()];
            for (before, after) in (0..n_before).flat_map(|before| (0..n_after).map(move |after| (before, after))) {
                turned[row(before) * n_after + column(after)] = overlaps[before * n_after + after];
            }
            let pairs = |overlaps: &[f64]| matches(overlaps, n_after);
            let mut expected: Vec<(usize, usize)> =
                pairs(&overlaps).iter().map(|pair| (row(pair.before), column(pair.after))).collect();
            expected.sort_unstable();
            let found: Vec<(usize, usize)> = pairs(&turned).iter().map(|pair| (pair.before, pair.after)).collect();
            prop_assert_eq!(found, expected);
        }
    }

    #[test]
    fn kinds_that_fell_apart_came_together_or_share_nothing() {
        let pairs = |overlaps: &[f64], n_after| {
            let pair = |pair: &Match| (pair.before, pair.after, (100.0 * pair.agreement).round());
            matches(overlaps, n_after).iter().map(pair).collect::<Vec<_>>()
        };
        // The larger part keeps its kind.
        assert_eq!(pairs(&[40.0, 60.0], 2), [(0, 1, 60.0)]);
        // Of two that came together the larger one stays.
        assert_eq!(pairs(&[40.0, 60.0], 1), [(1, 0, 60.0)]);
        // What is left over is not a pair for that reason alone.
        assert_eq!(pairs(&[90.0, 0.0, 10.0, 0.0, 0.0, 50.0], 3), [(0, 0, 90.0), (1, 2, 83.0)]);
        assert_eq!(pairs(&[0.0, 0.0], 2), []);
    }

    #[test]
    fn an_overlap_is_the_frames_that_both_kinds_claim() {
        let (before, after) = ([1.0, 0.0, 0.5, 0.5], [0.25, 0.75, 1.0, 0.0]);
        let found = overlaps((2, 2), before.chunks_exact(2), after.chunks_exact(2));
        assert_eq!(found, [0.75, 0.75, 0.5, 0.0]);
    }
}
