//! The kinds of one report at a level of their hierarchy: those most alike taken together.

use crate::kind_report::MAX_KINDS;

/// Fewer kinds than the model has, each a group of the model's. A group's probability is the sum of its kinds'.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Level {
    n_kinds: usize,
    n_groups: usize,
    groups: [u8; MAX_KINDS],
    probabilities: [f64; MAX_KINDS],
    filtered: [f64; MAX_KINDS],
}

impl Level {
    /// * `merges` — in their order; those that cannot be, of a faulty writer, are left out
    /// * `probabilities`, `filtered` — of the model's kinds, `(n_kinds,)`
    pub(crate) fn new(merges: &[[u8; 2]], n_groups: usize, probabilities: &[f64], filtered: &[f64]) -> Self {
        let n_kinds = probabilities.len();
        // Each kind's group, as its first kind.
        let mut first: [u8; MAX_KINDS] = std::array::from_fn(|kind| kind as u8);
        for &[into, from] in merges.iter().take(n_kinds.saturating_sub(n_groups.max(1))) {
            if into < from {
                first[..n_kinds].iter_mut().filter(|first| **first == from).for_each(|first| *first = into);
            }
        }
        let mut level = Self {
            n_kinds,
            n_groups: 0,
            groups: [0; MAX_KINDS],
            probabilities: [0.0; MAX_KINDS],
            filtered: [0.0; MAX_KINDS],
        };
        for kind in 0..n_kinds {
            let first = usize::from(first[kind]);
            level.groups[kind] = if first == kind { level.n_groups as u8 } else { level.groups[first] };
            level.n_groups += usize::from(first == kind);
            let group = usize::from(level.groups[kind]);
            level.probabilities[group] += probabilities[kind];
            level.filtered[group] += filtered[kind];
        }
        level
    }

    /// Which group each of the model's kinds is of, by index, `(n_kinds,)`. Groups are numbered from 0 in the order of their
    /// first kinds.
    pub fn groups(&self) -> &[u8] {
        &self.groups[..self.n_kinds]
    }

    /// Probability of each group, of the frame by itself, `(n_groups,)`.
    pub fn probabilities(&self) -> &[f64] {
        &self.probabilities[..self.n_groups]
    }

    /// Probability of each group given all frames of the run so far, `(n_groups,)`.
    pub fn filtered(&self) -> &[f64] {
        &self.filtered[..self.n_groups]
    }
}

#[cfg(test)]
mod tests {
    use crate::KindReport;

    fn report() -> KindReport {
        let mut report = KindReport::default();
        report.set_kinds([0, 1, 4, 6].into_iter(), [(1, 3), (0, 1), (0, 2)].into_iter());
        report.set_probabilities(&[0.5, 0.125, 0.25, 0.125], &[0.25, 0.0625, 0.5, 0.1875]);
        report
    }

    #[test]
    fn probabilities_of_a_level_are_sums_from_the_kinds_themselves_to_all_in_one() {
        let report = report();
        let check = |n_kinds: usize, groups: [u8; 4], probabilities: &[f64], filtered: &[f64]| {
            let level = report.at_level(n_kinds);
            assert_eq!(level.groups(), groups);
            assert_eq!((level.probabilities(), level.filtered()), (probabilities, filtered));
        };
        check(4, [0, 1, 2, 3], report.probabilities(), report.filtered());
        check(3, [0, 1, 2, 1], &[0.5, 0.25, 0.25], &[0.25, 0.25, 0.5]);
        check(2, [0, 0, 1, 0], &[0.75, 0.25], &[0.5, 0.5]);
        check(1, [0; 4], &[1.0], &[1.0]);
        assert_eq!((report.at_level(0), report.at_level(9)), (report.at_level(1), report.at_level(4)));
    }

    #[test]
    fn a_report_without_kinds_or_with_merges_that_cannot_be_has_levels_too() {
        let level = KindReport::default().at_level(3);
        assert_eq!((level.groups().len(), level.probabilities().len()), (0, 0));
        let mut report = report();
        report.set_kinds([0, 1, 4, 6].into_iter(), [(255, 0), (3, 3), (2, 255)].into_iter());
        report.set_probabilities(&[0.25; 4], &[0.25; 4]);
        assert_eq!(report.at_level(1).probabilities(), [0.25; 4]);
    }
}
