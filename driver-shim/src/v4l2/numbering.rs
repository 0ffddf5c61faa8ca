//! A camera's numbers, made to rise for as long as the shim runs.

/// How many frames may be lost at once; a number further ahead is of no use, as of a driver that does not count.
const LOST_MAX: u32 = 1_000_000;

/// Goes on from stream to stream, though each counts anew.
#[derive(Default)]
pub(crate) struct Numbering {
    /// The newest frame: the driver's number, of this stream, and ours.
    newest: Option<(Option<u32>, u64)>,
}

impl Numbering {
    /// The next frame is a new stream's: its number says nothing of frames that were lost.
    pub(crate) fn start_anew(&mut self) {
        self.newest = self.newest.map(|(_, ours)| (None, ours));
    }

    /// Our number of the next frame. Numbers that are left out are frames that the driver lost.
    pub(crate) fn place(&mut self, number: u32) -> u64 {
        let ours = match self.newest {
            None => 0,
            Some((newest, ours)) => {
                let n_ahead = newest.map_or(1, |newest| number.wrapping_sub(newest));
                ours + u64::from(if (1..=LOST_MAX).contains(&n_ahead) { n_ahead } else { 1 })
            }
        };
        self.newest = Some((Some(number), ours));
        ours
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_rise_whatever_the_driver_counts() {
        let mut numbering = Numbering::default();
        let mut check = |numbers: &[u32], expected: &[u64]| {
            numbering.start_anew();
            let placed: Vec<u64> = numbers.iter().map(|number| numbering.place(*number)).collect();
            assert_eq!(placed, expected, "{numbers:?}");
        };
        check(&[7, 8, 11], &[0, 1, 4]);
        // Another stream, which lost its first frame.
        check(&[1, 2], &[5, 6]);
        // It wraps.
        check(&[u32::MAX - 1, 1], &[7, 10]);
        // It does not count, or counts backwards.
        check(&[0, 0, 0], &[11, 12, 13]);
        check(&[9, 3, 4], &[14, 15, 16]);
    }
}
