//! Hierarchy: which kinds are most alike, as a tree that merges two groups of them at a time.
//!
//! Baudry, Raftery, Celeux, Lo & Gottardo 2010, *Combining mixture components for clustering*: of all groups those two are merged
//! that lower the entropy of the responsibilities, `−Σ_i Σ_k t_ik ln t_ik`, most; what a group is responsible for is the sum of
//! what its kinds are. So kinds that share many frames come together first, however far apart their means. The mixture stays
//! as it is: a level with fewer groups is read off its probabilities, and chooses nothing.

use rayon::prelude::*;

/// Two groups become one, each called by its first kind: the second joins the first, which is the lower.
pub type Merge = (usize, usize);

/// The J − 1 merges from J kinds to one group, in their order.
///
/// * `responsibilities` — of the trained frames, shape `(n_frames, n_kinds)`
///
/// The same on any number of threads; of pairs that lower the entropy alike, the first is merged. O(n_kinds² · n_frames).
pub fn learn(responsibilities: &[f64], n_kinds: usize) -> Vec<Merge> {
    let of_kind = |kind| responsibilities.iter().copied().skip(kind).step_by(n_kinds).collect();
    let mut groups: Vec<Group> = (0..n_kinds).map(|kind| Group::new(of_kind(kind))).collect();
    let pairs: Vec<(usize, usize)> =
        (0..n_kinds).flat_map(|a| (a + 1..n_kinds).map(move |b| (a, b))).collect();
    // Places in `groups`, which stay: what merges leave changes only for pairs with the group that grew.
    let mut falls: Vec<(f64, (usize, usize))> =
        pairs.par_iter().map(|&(a, b)| (fall(&groups[a], &groups[b]), (a, b))).collect();
    let mut merges = Vec::with_capacity(n_kinds.saturating_sub(1));
    while let Some((_, (a, b))) =
        falls.iter().copied().reduce(|best, next| if next.0 > best.0 { next } else { best })
    {
        merges.push((a, b));
        let joined = std::mem::take(&mut groups[b].responsibilities);
        let sum = groups[a].responsibilities.iter().zip(&joined).map(|(a, b)| a + b).collect();
        groups[a] = Group::new(sum);
        falls.retain(|(_, (c, d))| *c != b && *d != b);
        falls.par_iter_mut().filter(|(_, (c, d))| *c == a || *d == a).for_each(|(entropy, (c, d))| {
            *entropy = fall(&groups[*c], &groups[*d]);
        });
    }
    merges
}

/// Which group each kind is of where merges have left so many, shape `(n_kinds,)`: groups are numbered from 0 in the order of
/// their first kinds.
///
/// * `n_groups` — fewer than 1 are taken for 1, and more than there are kinds for as many
pub fn groups(n_kinds: usize, merges: &[Merge], n_groups: usize) -> Vec<usize> {
    let mut first: Vec<usize> = (0..n_kinds).collect();
    for &(into, from) in merges.iter().take(n_kinds - n_groups.clamp(1, n_kinds)) {
        first.iter_mut().filter(|first| **first == from).for_each(|first| *first = into);
    }
    let firsts: Vec<usize> = (0..n_kinds).filter(|&kind| first[kind] == kind).collect();
    first.iter().map(|first| firsts.partition_point(|other| other < first)).collect()
}

/// Whether these are merges from so many kinds to one group.
pub(crate) fn are_whole(n_kinds: usize, merges: &[Merge]) -> bool {
    let mut is_there = vec![true; n_kinds];
    merges.len() + 1 == n_kinds
        && merges.iter().all(|&(into, from)| {
            into < from && from < n_kinds && is_there[into] && std::mem::replace(&mut is_there[from], false)
        })
}

/// Kinds taken together.
struct Group {
    /// Of each frame, shape `(n_frames,)`.
    responsibilities: Vec<f64>,
    /// `t ln t` of each.
    terms: Vec<f64>,
}

impl Group {
    fn new(responsibilities: Vec<f64>) -> Self {
        let terms = responsibilities.iter().map(|&t| term(t)).collect();
        Self { responsibilities, terms }
    }
}

/// By how much the entropy falls where two groups become one, nats.
fn fall(a: &Group, b: &Group) -> f64 {
    let apart = a.terms.iter().zip(&b.terms);
    let together = a.responsibilities.iter().zip(&b.responsibilities);
    together.zip(apart).map(|((t_a, t_b), (a, b))| term(t_a + t_b) - (a + b)).sum()
}

/// `t ln t`, 0 at 0.
fn term(t: f64) -> f64 {
    if t > 0.0 { t * libm::log(t) } else { 0.0 }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    /// Responsibilities of as many frames as there are rows.
    fn responsibilities() -> impl Strategy<Value = (usize, Vec<f64>)> {
        (1..8_usize, 1..30_usize).prop_flat_map(|(n_kinds, n_frames)| {
            let shares = prop::collection::vec(prop_oneof![0.0..1.0_f64, Just(0.0)], n_kinds * n_frames);
            shares.prop_map(move |mut shares| {
                for row in shares.chunks_exact_mut(n_kinds) {
                    row[0] += 1e-3;
                    let sum: f64 = row.iter().sum();
                    row.iter_mut().for_each(|share| *share /= sum);
                }
                (n_kinds, shares)
            })
        })
    }

    /// Sums over groups of the responsibilities of each frame, shape `(n_frames, n_groups)`.
    fn merged(responsibilities: &[f64], of_kind: &[usize]) -> Vec<f64> {
        let n_groups = of_kind.iter().max().unwrap() + 1;
        let rows = responsibilities.chunks_exact(of_kind.len());
        rows.flat_map(|row| {
            let mut sums = vec![0.0; n_groups];
            row.iter().zip(of_kind).for_each(|(share, &group)| sums[group] += share);
            sums
        })
        .collect()
    }

    fn entropy(responsibilities: &[f64]) -> f64 {
        responsibilities.iter().filter(|t| **t > 0.0).map(|t| -t * t.ln()).sum()
    }

    proptest! {
        #[test]
        fn every_merge_lowers_the_entropy_as_much_as_any_would((n_kinds, all) in responsibilities()) {
            let merges = learn(&all, n_kinds);
            prop_assert!(are_whole(n_kinds, &merges));
            for n_groups in (2..=n_kinds).rev() {
                let here = groups(n_kinds, &merges, n_groups);
                let with = |a: usize, b: usize| {
                    let joined: Vec<usize> = here.iter().map(|&group| if group == b { a } else { group }).collect();
                    entropy(&merged(&all, &joined))
                };
                let pairs = (0..n_groups).flat_map(|a| (a + 1..n_groups).map(move |b| (a, b)));
                let least = pairs.map(|(a, b)| with(a, b)).fold(f64::INFINITY, f64::min);
                let chosen = entropy(&merged(&all, &groups(n_kinds, &merges, n_groups - 1)));
                // Sums of at most 240 terms of at most 1, in another order.
                prop_assert!(chosen <= least + 1e-12, "{} kinds: {} > {}", n_groups, chosen, least);
            }
        }

        #[test]
        fn levels_are_nested_from_the_kinds_themselves_to_all_in_one((n_kinds, all) in responsibilities()) {
            let merges = learn(&all, n_kinds);
            let at = |n_groups| groups(n_kinds, &merges, n_groups);
            prop_assert_eq!(at(n_kinds), (0..n_kinds).collect::<Vec<_>>());
            prop_assert_eq!(at(1), vec![0; n_kinds]);
            prop_assert_eq!((at(0), at(n_kinds + 3)), (at(1), at(n_kinds)));
            for n_groups in 1..n_kinds {
                let (coarse, fine) = (at(n_groups), at(n_groups + 1));
                prop_assert_eq!(coarse.iter().max(), Some(&(n_groups - 1)));
                for (a, b) in (0..n_kinds).flat_map(|a| (0..n_kinds).map(move |b| (a, b))) {
                    prop_assert!(fine[a] != fine[b] || coarse[a] == coarse[b]);
                }
                // In the order of their first kinds: each number but the first comes after the one before.
                let first = |group: usize| coarse.iter().position(|other| *other == group);
                prop_assert!((1..n_groups).all(|group| first(group - 1) < first(group)));
            }
        }
    }

    #[test]
    fn kinds_that_share_frames_come_together_first() {
        // Kinds 0 and 2 are of the same frames, 1 and 3 nearly so, and no frame is of both pairs.
        let all = [0.5, 0.0, 0.5, 0.0, 0.5, 0.0, 0.5, 0.0, 0.0, 0.8, 0.0, 0.2, 0.0, 0.9, 0.0, 0.1];
        let merges = learn(&all, 4);
        assert_eq!(merges, [(0, 2), (1, 3), (0, 1)]);
        assert_eq!(
            [4, 3, 2, 1].map(|n| groups(4, &merges, n)),
            [[0, 1, 2, 3], [0, 1, 0, 2], [0, 1, 0, 1], [0; 4]]
        );
    }

    #[test]
    fn what_are_no_merges_is_seen() {
        assert!(are_whole(1, &[]) && are_whole(3, &[(1, 2), (0, 1)]));
        assert!(!are_whole(3, &[(1, 2)]), "too few");
        assert!(!are_whole(3, &[(1, 2), (0, 2)]), "joined twice");
        assert!(!are_whole(3, &[(0, 1), (1, 2)]), "joins what is gone");
        assert!(!are_whole(3, &[(2, 1), (0, 2)]), "not by its first kind");
        assert!(!are_whole(3, &[(1, 3), (0, 1)]), "beyond the kinds");
    }
}
