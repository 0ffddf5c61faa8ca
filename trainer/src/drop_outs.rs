//! Drop-outs: readings that stand alone in time, and whether there are so many that a median over time is worth its delay.
//!
//! A reading stands alone if it is invalid and those of the frames before and after it are not, or if these agree within a tenth and it
//! is farther than three tenths from their mean. Corners that pass by look like that now and then: some 0.3 to 2.7 % of readings of
//! recorded and simulated trips without drop-outs do.
//!
//! Where these are all, a median can do harm: it made the kinds of two cameras less consistent. Where a few in a hundred of a ring's
//! readings drop out, it mends the kinds (`benches/RESULTS.md`).

use std::mem::swap;

use kinds_model::MedianPlan;
use kinds_model::response::INVALID;

/// Share of readings that stand alone from which on a median is taken: more than trips without drop-outs have.
const SHARE_MIN: f64 = 0.03;

/// How many readings stand alone, of trips that are read frame by frame.
#[derive(Debug, Default)]
pub(crate) struct DropOuts {
    /// The last two frames of the trip, the later one first; empty before they have come.
    before: [Vec<u16>; 2],
    n_alone: u64,
    n_readings: u64,
}

impl DropOuts {
    /// The frames to come are of another trip.
    pub(crate) fn begin(&mut self) {
        self.before.iter_mut().for_each(Vec::clear);
    }

    /// * `counts` — raw counts of the next frame
    pub(crate) fn add(&mut self, counts: &[u16]) {
        let [present, past] = &mut self.before;
        if !past.is_empty() {
            let all = past.iter().zip(&*present).zip(counts);
            self.n_alone +=
                all.filter(|((past, present), next)| stands_alone(**past, **present, **next)).count() as u64;
            self.n_readings += counts.len() as u64;
        }
        swap(present, past);
        present.clear();
        present.extend_from_slice(counts);
    }

    /// Share of the readings that stand alone.
    pub(crate) fn share(&self) -> f64 {
        self.n_alone as f64 / self.n_readings.max(1) as f64
    }

    /// The median that helps against so many.
    pub(crate) fn median(&self) -> MedianPlan {
        if self.share() >= SHARE_MIN { MedianPlan::Three } else { MedianPlan::Off }
    }
}

fn stands_alone(past: u16, present: u16, next: u16) -> bool {
    let [past, present, next, invalid] = [past, present, next, INVALID].map(u32::from);
    let is_near = 10 * past.abs_diff(next) <= past.min(next);
    // Against the sum of the two, which is twice their mean.
    let is_far = 20 * present.abs_diff((past + next) / 2) > 3 * (past + next);
    past != invalid && next != invalid && (present == invalid || (is_near && is_far))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn of(trips: &[&[u16]]) -> DropOuts {
        let mut found = DropOuts::default();
        for trip in trips {
            found.begin();
            trip.iter().for_each(|&count| found.add(&[count, 1000]));
        }
        found
    }

    #[test]
    fn what_is_missing_or_far_off_for_one_frame_stands_alone() {
        let n_alone = |trip: &[u16]| of(&[trip]).n_alone;
        assert_eq!(n_alone(&[1000, 0, 1000]), 1);
        assert_eq!(n_alone(&[1000, 0, 2000]), 1);
        assert_eq!(n_alone(&[1000, 1320, 1000]), 1);
        assert_eq!(n_alone(&[1000, 680, 1000]), 1);
        // A wall that nears, an edge that passes, and what is missing for longer do not.
        assert_eq!(n_alone(&[1000, 1290, 1000]), 0);
        assert_eq!(n_alone(&[1000, 3000, 2000]), 0);
        assert_eq!(n_alone(&[1000, 3000, 3000]), 0);
        assert_eq!(n_alone(&[1000, 0, 0, 1000]), 0);
        assert_eq!(n_alone(&[0, 0, 0]), 0);
        assert_eq!(n_alone(&[65535, 0, 65535]), 1);
    }

    #[test]
    fn trips_do_not_meet_and_a_share_decides() {
        assert_eq!(of(&[&[1000, 0], &[1000, 1000]]).n_alone, 0);
        let few = of(&[&[1000; 100], &[1000, 1000, 0, 1000]]);
        assert_eq!((few.n_alone, few.n_readings, few.median()), (1, 200, MedianPlan::Off));
        let many = of(&[&[1000, 0, 1000, 1000, 1000]]);
        assert_eq!((many.share(), many.median()), (1.0 / 6.0, MedianPlan::Three));
        assert_eq!((DropOuts::default().share(), DropOuts::default().median()), (0.0, MedianPlan::Off));
    }
}
