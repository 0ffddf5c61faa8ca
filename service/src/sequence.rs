//! Which frames are new, and how many were missed.

/// Where the service is in the numbering of frames.
#[derive(Debug)]
pub(crate) struct Sequence {
    run: Option<u64>,
    /// Number of the next frame of that run.
    next: u64,
    joined_midway: bool,
}

/// What a frame's number says.
#[derive(Debug, PartialEq, Eq)]
pub(crate) enum Place {
    /// New; this many before it were missed.
    New { n_lost: u64 },
    /// Seen already, or older than one that was.
    Repeated,
}

impl Sequence {
    /// `joined_midway`: a driver shim was there before us, so nobody can say what of its first run was missed.
    pub(crate) fn new(joined_midway: bool) -> Self {
        Self { run: None, next: 0, joined_midway }
    }

    /// Takes note of a frame. Runs are told apart, not ordered: the wall clock that names them may have been set back.
    pub(crate) fn take(&mut self, run: u64, sequence: u64) -> Place {
        let expected = match self.run {
            Some(known) if known == run => self.next,
            None if self.joined_midway => sequence,
            _ => 0,
        };
        if sequence < expected {
            return Place::Repeated;
        }
        self.run = Some(run);
        // The highest number of all can only come from a faulty writer; no more are new after it.
        self.next = sequence.saturating_add(1);
        Place::New { n_lost: sequence - expected }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn check(mut place_of: Sequence, frames: &[(u64, u64)], expected: &[Option<u64>]) {
        let places: Vec<Option<u64>> = frames
            .iter()
            .map(|&(run, sequence)| match place_of.take(run, sequence) {
                Place::New { n_lost } => Some(n_lost),
                Place::Repeated => None,
            })
            .collect();
        assert_eq!(places, expected);
    }

    #[test]
    fn gaps_are_counted_just_before_the_frame_after_them() {
        check(Sequence::new(false), &[(7, 0), (7, 1), (7, 4), (7, 5)], &[Some(0), Some(0), Some(2), Some(0)]);
    }

    #[test]
    fn frames_repeated_or_out_of_order_are_never_new() {
        check(
            Sequence::new(false),
            &[(7, 0), (7, 0), (7, 3), (7, 1), (7, 3), (7, 4)],
            &[Some(0), None, Some(2), None, None, Some(0)],
        );
    }

    #[test]
    fn each_run_is_counted_from_its_own_start_also_when_the_clock_was_set_back() {
        check(Sequence::new(false), &[(7, 2), (3, 0), (3, 1), (9, 1)], &[Some(2), Some(0), Some(0), Some(1)]);
    }

    #[test]
    fn what_was_before_us_is_not_missed() {
        check(Sequence::new(true), &[(7, 500), (7, 502), (8, 1)], &[Some(0), Some(1), Some(1)]);
    }

    #[test]
    fn highest_number_of_a_faulty_writer_ends_its_run() {
        check(Sequence::new(true), &[(7, u64::MAX), (7, u64::MAX - 1), (8, 0)], &[Some(0), None, Some(0)]);
    }
}
