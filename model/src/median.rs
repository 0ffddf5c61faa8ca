//! A median over time, of each reading by itself: what a sensor that drops readings now and then saw a moment ago stands in for them.
//!
//! Causal: of the last frames, the present one among them, so a change is believed half of the frames later. Of those of the last
//! readings that are valid the median is taken, of an even number the lower, which is the nearer; where none is, the reading stays
//! invalid. With no drop-outs nothing is gained, and a frame's delay lost.

use serde::{Deserialize, Serialize};

use crate::response::INVALID;
use crate::simd::Instructions;

/// Over how many frames the median of each reading is taken.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub enum MedianPlan {
    /// Readings are taken as they are.
    #[default]
    Off,
    /// The last three: what is missing or wrong for one frame is not seen.
    Three,
    /// The last five: nor is what is so for two.
    Five,
}

/// Readings that are taken at once.
const N_LANES: usize = 32;

/// Takes the median of each reading over the last frames. Holds these.
#[derive(Clone, Debug)]
pub struct MedianFilter {
    /// The last frames, in whatever order; as if there had been invalid ones before the first.
    recent: Recent,
    /// Which of them is the oldest.
    oldest: usize,
    /// Shape `(n_readings,)`.
    medians: Vec<u16>,
}

/// Frames, each shifted so that invalid readings are greater than all others.
#[derive(Clone, Debug)]
enum Recent {
    Three([Vec<u16>; 3]),
    Five([Vec<u16>; 5]),
}

impl MedianFilter {
    /// None where readings are taken as they are.
    ///
    /// * `n_readings` — of a frame
    pub fn new(plan: MedianPlan, n_readings: usize) -> Option<Self> {
        let none = || vec![shifted(INVALID); n_readings];
        let recent = match plan {
            MedianPlan::Off => return None,
            MedianPlan::Three => Recent::Three(std::array::from_fn(|_| none())),
            MedianPlan::Five => Recent::Five(std::array::from_fn(|_| none())),
        };
        Some(Self { recent, oldest: 0, medians: vec![INVALID; n_readings] })
    }

    /// Forgets all frames: those to come are of another trip.
    pub fn begin(&mut self) {
        self.frames_mut().iter_mut().for_each(|frame| frame.fill(shifted(INVALID)));
    }

    /// Takes one more frame, and returns the medians, both raw counts of shape `(n_readings,)`.
    ///
    /// Frames without any valid reading are left to the caller: they tell nothing, and in training there are none. Allocates nothing.
    ///
    /// # Panics
    /// If the frame has another number of readings.
    pub fn take(&mut self, counts: &[u16]) -> &[u16] {
        let oldest = self.oldest;
        let frames = self.frames_mut();
        let n_frames = frames.len();
        assert_eq!(counts.len(), frames[oldest].len(), "frames of one sensor");
        frames[oldest].iter_mut().zip(counts).for_each(|(to, &count)| *to = shifted(count));
        self.oldest = (oldest + 1) % n_frames;
        let Self { recent, medians, .. } = self;
        Instructions::widest().run(
            #[inline(always)]
            || match recent {
                Recent::Three(frames) => write(frames, medians, of_three),
                Recent::Five(frames) => write(frames, medians, of_five),
            },
        );
        medians
    }

    fn frames_mut(&mut self) -> &mut [Vec<u16>] {
        match &mut self.recent {
            Recent::Three(frames) => frames,
            Recent::Five(frames) => frames,
        }
    }
}

/// One less, so that an invalid reading becomes the greatest number.
fn shifted(count: u16) -> u16 {
    count.wrapping_sub(1)
}

#[inline(always)]
fn write<const N: usize>(frames: &[Vec<u16>; N], medians: &mut [u16], median: impl Fn([u16; N]) -> u16) {
    let (whole, rest) = medians.as_chunks_mut::<N_LANES>();
    let n_whole = whole.len() * N_LANES;
    let chunks = frames.each_ref().map(|frame| frame.as_chunks::<N_LANES>().0);
    for (index, medians) in whole.iter_mut().enumerate() {
        let chunks = chunks.map(|chunks| &chunks[index]);
        for lane in 0..N_LANES {
            medians[lane] = median(chunks.map(|chunk| chunk[lane])).wrapping_add(1);
        }
    }
    for (index, to) in (n_whole..).zip(rest) {
        *to = median(frames.each_ref().map(|frame| frame[index])).wrapping_add(1);
    }
}

/// The least of two, and the greatest.
#[inline(always)]
fn sorted(a: u16, b: u16) -> (u16, u16) {
    (a.min(b), a.max(b))
}

#[inline(always)]
fn of_three([a, b, c]: [u16; 3]) -> u16 {
    let (a, b) = sorted(a, b);
    let (b, greatest) = sorted(b, c);
    let (least, middle) = sorted(a, b);
    // Of one or two that are valid, the least.
    if greatest == shifted(INVALID) { least } else { middle }
}

#[inline(always)]
fn of_five([a, b, c, d, e]: [u16; 5]) -> u16 {
    // The least number of comparisons that sorts five (Knuth 1998, *The Art of Computer Programming* 3, 5.3.4).
    let ((a, d), (b, e)) = (sorted(a, d), sorted(b, e));
    let ((a, c), (b, d)) = (sorted(a, c), sorted(b, d));
    let ((a, b), (c, e)) = (sorted(a, b), sorted(c, e));
    let ((b, c), (d, greatest)) = (sorted(b, c), sorted(d, e));
    let (c, _) = sorted(c, d);
    let invalid = shifted(INVALID);
    // Of five the third, of four and three the second, of two and one the first.
    let few = if c == invalid { a } else { b };
    if greatest == invalid { few } else { c }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    /// By sorting what is valid.
    fn plain(readings: &[u16]) -> u16 {
        let mut valid: Vec<u16> = readings.iter().copied().filter(|&reading| reading != INVALID).collect();
        valid.sort_unstable();
        if valid.is_empty() { INVALID } else { valid[(valid.len() - 1) / 2] }
    }

    proptest! {
        #[test]
        fn every_reading_is_the_median_of_those_of_the_last_frames_that_are_valid(
            (plan, n_frames) in prop_oneof![Just((MedianPlan::Three, 3)), Just((MedianPlan::Five, 5))],
            frames in (1..70_usize).prop_flat_map(|n_readings| {
                let reading = prop_oneof![2 => Just(INVALID), 3 => 1..4_u16, 1 => Just(u16::MAX), 1 => any::<u16>()];
                prop::collection::vec(prop::collection::vec(reading, n_readings), 1..12)
            }),
        ) {
            let mut filter = MedianFilter::new(plan, frames[0].len()).unwrap();
            for _ in 0..2 {
                for index in 0..frames.len() {
                    let last = &frames[(index + 1).saturating_sub(n_frames)..=index];
                    let expected: Vec<u16> = (0..frames[0].len())
                        .map(|reading| plain(&last.iter().map(|frame| frame[reading]).collect::<Vec<_>>()))
                        .collect();
                    prop_assert_eq!(filter.take(&frames[index]), &expected[..]);
                }
                // Another trip begins as the first did.
                filter.begin();
            }
        }
    }

    #[test]
    fn a_reading_that_is_missing_or_beside_all_others_once_is_not_seen() {
        let mut filter = MedianFilter::new(MedianPlan::Three, 1).unwrap();
        let found: Vec<u16> =
            [50, 51, 0, 52, 9999, 53, 54, 80, 81, 82].map(|reading| filter.take(&[reading])[0]).to_vec();
        assert_eq!(found, [50, 50, 50, 51, 52, 53, 54, 54, 80, 81]);
        assert!(MedianFilter::new(MedianPlan::Off, 1).is_none());
    }
}
