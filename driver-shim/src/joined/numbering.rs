//! The leader's numbers as those of joint frames, made to rise for as long as frames are joined.

/// Goes on from run to run of the leader's driver shim, though each counts anew.
#[derive(Debug, Default)]
pub(super) struct Numbering {
    /// Of the leader's run: which it is, its first number that was seen, and ours of that.
    run: Option<(u64, u64, u64)>,
    /// After all of ours.
    next: u64,
}

impl Numbering {
    /// Our number of a frame. Within a run numbers that are left out, come again or late are so in ours; a new run goes on after
    /// all before.
    pub(super) fn place(&mut self, run: u64, sequence: u64) -> u64 {
        let (_, first, first_of_ours) = match self.run {
            Some(current) if current.0 == run => current,
            _ => *self.run.insert((run, sequence, self.next)),
        };
        let ours = first_of_ours.saturating_add(sequence.saturating_sub(first));
        self.next = self.next.max(ours.saturating_add(1));
        ours
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn losses_and_repetitions_within_a_run_stay_and_a_new_run_goes_on() {
        let mut numbering = Numbering::default();
        let mut check = |run: u64, numbers: &[u64], expected: &[u64]| {
            let placed: Vec<u64> = numbers.iter().map(|number| numbering.place(run, *number)).collect();
            assert_eq!(placed, expected, "{numbers:?} of {run}");
        };
        check(7, &[100, 101, 104, 104, 103, 105], &[0, 1, 4, 4, 3, 5]);
        check(8, &[0, 1], &[6, 7]);
        check(9, &[3, 2, 4], &[8, 8, 9]);
        check(10, &[0, u64::MAX], &[10, u64::MAX]);
        check(11, &[0], &[u64::MAX]);
    }
}
