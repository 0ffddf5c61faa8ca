//! Which frames of several sensors belong together. One rule, for recorded trips and for sensors that are running.
//!
//! One of the sensors *leads*: each of its frames makes one joint frame. The others are its *partners*: of each the newest
//! frame is taken that was captured when the leader's was, or before, at most a tolerance before. What a partner sees later,
//! however soon, is left to the leader's next frame: nobody has to wait for it, so a running robot pairs as its trips are paired.
//! The rule looks at times of capture alone, in whatever order frames come; of two of one partner with the same time the later
//! to come is taken.
//!
//! Where a partner has no such frame, the joint frame is invalid as a whole, unless that partner is a single reading, which then is
//! invalid like any other reading of a ring. Readings of a whole sensor that are taken for invalid look like open space, which
//! kinds are made of too: without Crunch's sonars all places became one kind, and 0.2 % of the frames were novel.
//!
//! A partner's frame that was captured more than the tolerance before one that came earlier shows that its clock was set back:
//! what is later than that is of another time, and is forgotten.

use std::collections::VecDeque;
use std::time::Duration;

use crate::Stamp;
use crate::counts::{INVALID, Unit};

/// How much older than the leader's a partner's frame may be, unless something else is asked for.
///
/// Rings of sonars take a quarter of a second and more to fire all around, and of a partner at 5 Hz the newest frame is up to
/// 200 ms old.
pub const USUAL_TOLERANCE: Duration = Duration::from_millis(250);

/// Frames of a partner that are remembered at most: four seconds at 1 kHz, which is more than frames are ever logged late.
const N_FRAMES_MAX: usize = 4096;
/// Their readings at most, 8 MiB of them: 7 s of a camera of 19840 readings at 30 Hz.
const N_READINGS_MAX: usize = 4 << 20;
/// Frames that are remembered however large they are.
const N_FRAMES_MIN: usize = 8;

/// The last frames of a partner, looked up by time of capture. Knows no channel and no file.
///
/// After [`Self::new`] nothing is allocated.
#[derive(Clone, Debug)]
pub struct Partner {
    tolerance_ns: i64,
    n_readings: usize,
    /// Room for so many frames, one after the other.
    counts: Vec<u16>,
    /// In order of capture, of equal times the later to come behind: when, and in which place.
    frames: VecDeque<(Stamp, usize)>,
    /// Places without a frame.
    free: Vec<usize>,
    latest: Option<Stamp>,
}

impl Partner {
    /// One whose frames have `n_readings` readings each. Remembers as many as [`Self::n_frames_max`] says.
    pub fn new(n_readings: usize, tolerance: Duration) -> Self {
        let n_frames = Self::n_frames_max(n_readings);
        Self {
            tolerance_ns: i64::try_from(tolerance.as_nanos()).unwrap_or(i64::MAX),
            n_readings,
            counts: vec![INVALID; n_frames * n_readings],
            frames: VecDeque::with_capacity(n_frames),
            free: (0..n_frames).rev().collect(),
            latest: None,
        }
    }

    /// How many frames of so many readings are remembered; of more the oldest are forgotten.
    pub fn n_frames_max(n_readings: usize) -> usize {
        (N_READINGS_MAX / n_readings.max(1)).clamp(N_FRAMES_MIN, N_FRAMES_MAX)
    }

    /// Readings of each frame.
    pub fn n_readings(&self) -> usize {
        self.n_readings
    }

    /// Takes in a frame, in whatever order.
    ///
    /// # Panics
    /// If `counts` is not `(n_readings,)`.
    pub fn insert(&mut self, captured: Stamp, counts: &[u16]) {
        assert_eq!(counts.len(), self.n_readings, "a partner's frames are of one length");
        self.latest = Some(captured);
        let horizon = Stamp(captured.0.saturating_add(self.tolerance_ns));
        while let Some((_, place)) = self.frames.pop_back_if(|(at, _)| *at > horizon) {
            self.free.push(place);
        }
        // Without a free place the oldest goes, which this one may be itself.
        let oldest = || self.frames.pop_front_if(|(at, _)| *at <= captured).map(|(_, place)| place);
        let Some(place) = self.free.pop().or_else(oldest) else { return };
        self.counts[place * self.n_readings..][..self.n_readings].copy_from_slice(counts);
        let index = self.frames.partition_point(|(at, _)| *at <= captured);
        self.frames.insert(index, (captured, place));
    }

    /// Whether what belongs to a leader's frame is settled: a frame as late as that has come, so none that is nearer will.
    pub fn reaches(&self, led: Stamp) -> bool {
        self.frames.back().is_some_and(|(newest, _)| *newest >= led)
    }

    /// What belongs to a leader's frame among what has come: when it was captured, and its counts.
    pub fn at(&self, led: Stamp) -> Option<(Stamp, &[u16])> {
        let index = self.frames.partition_point(|(at, _)| *at <= led).checked_sub(1)?;
        let (captured, place) = self.frames[index];
        self.is_near(captured, led)
            .then(|| (captured, &self.counts[place * self.n_readings..][..self.n_readings]))
    }

    /// Whether a joint frame without one of this partner's says nothing.
    pub fn is_indispensable(&self) -> bool {
        self.n_readings > 1
    }

    /// Whether a frame might belong to a leader's: captured as that was or before, within the tolerance.
    pub fn is_near(&self, captured: Stamp, led: Stamp) -> bool {
        captured <= led && led.0.saturating_sub(captured.0) <= self.tolerance_ns
    }

    /// When the last frame that came was captured.
    pub fn latest(&self) -> Option<Stamp> {
        self.latest
    }
}

/// Makes a joint frame of a leader's: writes what belongs to it behind its readings, or that all is invalid.
///
/// * `led` — when the leader's frame was captured
/// * `counts` — the leader's `n_led` readings, and room for those of the partners, which is overwritten
///
/// # Panics
/// If `counts` has not room for all.
pub fn join<'a>(led: Stamp, n_led: usize, partners: impl Iterator<Item = &'a Partner>, counts: &mut [u16]) {
    let mut is_valid = true;
    let mut rest = &mut counts[n_led..];
    for partner in partners {
        let (part, others) = rest.split_at_mut(partner.n_readings);
        match partner.at(led) {
            Some((_, own)) => part.copy_from_slice(own),
            None => {
                part.fill(INVALID);
                is_valid &= !partner.is_indispensable();
            }
        }
        rest = others;
    }
    if !is_valid {
        counts.fill(INVALID);
    }
}

/// What each count of one unit is in another, shape `(65536,)`: as if it had been recorded and read in the other unit.
///
/// The nearest count; between units of one size the count itself. Invalid stays invalid, as does what comes to more than 65535
/// counts, and what comes to less than half a count. 65535, where it stands for no return (in units that are not a millimetre, as
/// messages have it), stands for it in the other unit too.
///
/// # Panics
/// If a unit is not a finite number of metres above 0.
pub fn counts_in_unit(from_metres_per_count: f64, to_metres_per_count: f64) -> Vec<u16> {
    let unit =
        |metres_per_count| Unit::new(metres_per_count).expect("a unit is a finite number of metres above 0");
    let (from, to) = (unit(from_metres_per_count), unit(to_metres_per_count));
    let convert = |count: u16| match count {
        count if from == to => count,
        INVALID => INVALID,
        millimetres if from.metres_per_count() == 0.001 => to.count_of_millimetres(millimetres),
        u16::MAX => u16::MAX,
        count => to.count_of_metres(from.to_metres(count) as f32, u16::MAX),
    };
    (0..=u16::MAX).map(convert).collect()
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    const MS: i64 = 1_000_000;

    fn partner(tolerance_ms: u64) -> Partner {
        Partner::new(1, Duration::from_millis(tolerance_ms))
    }

    /// What belongs to a leader's frame by the rule itself, over all frames that came: when they were captured, ms, in the order
    /// in which they came. Which of them.
    fn by_definition(came_ms: &[i64], led_ms: i64, tolerance_ms: i64) -> Option<usize> {
        let is_of_another_time =
            |index: usize| came_ms[index + 1..].iter().any(|later| *later < came_ms[index] - tolerance_ms);
        (0..came_ms.len())
            .filter(|&index| (led_ms - tolerance_ms..=led_ms).contains(&came_ms[index]))
            .filter(|&index| !is_of_another_time(index))
            .max_by_key(|&index| (came_ms[index], index))
    }

    proptest! {
        #[test]
        fn frames_are_paired_as_the_rule_says_over_all_pairs(
            came_ms in proptest::collection::vec(-50_i64..50, 0..40),
            led_ms in proptest::collection::vec(-60_i64..60, 1..20),
            tolerance_ms in 0_i64..30,
        ) {
            let mut partner = partner(tolerance_ms as u64);
            for n_came in 0..=came_ms.len() {
                for &led in &led_ms {
                    let expected = by_definition(&came_ms[..n_came], led, tolerance_ms);
                    let found = partner.at(Stamp(led * MS));
                    let expected = expected.map(|index| (Stamp(came_ms[index] * MS), index as u16));
                    prop_assert_eq!(found.map(|(at, counts)| (at, counts[0])), expected);
                }
                if let Some(captured) = came_ms.get(n_came) {
                    partner.insert(Stamp(captured * MS), &[n_came as u16]);
                }
            }
        }

        #[test]
        fn what_is_settled_is_not_changed_by_later_frames_of_a_clock_that_runs_on(
            mut came_ms in proptest::collection::vec(0_i64..1000, 1..60),
            led_ms in 0_i64..1000,
            tolerance_ms in 0_u64..300,
        ) {
            came_ms.sort_unstable();
            came_ms.dedup();
            let mut partner = partner(tolerance_ms);
            let mut settled = None;
            for (index, captured) in came_ms.iter().enumerate() {
                partner.insert(Stamp(captured * MS), &[index as u16]);
                let found = partner.at(Stamp(led_ms * MS)).map(|(at, counts)| (at, counts[0]));
                if partner.reaches(Stamp(led_ms * MS)) {
                    prop_assert_eq!(*settled.get_or_insert(found), found);
                }
            }
        }
    }

    #[test]
    fn a_clock_that_is_set_back_leaves_nothing_of_before() {
        let mut partner = partner(100);
        let captured = |partner: &Partner, led: i64| partner.at(Stamp(led * MS)).map(|(at, _)| at.0 / MS);
        for at in [1000, 1050, 1020] {
            partner.insert(Stamp(at * MS), &[1]);
        }
        assert_eq!(captured(&partner, 1060), Some(1050), "one that comes late is no clock that was set");
        partner.insert(Stamp(500 * MS), &[1]);
        assert_eq!(captured(&partner, 1060), None);
        assert!(!partner.reaches(Stamp(501 * MS)));
        assert_eq!(captured(&partner, 560), Some(500));
        assert_eq!(partner.latest(), Some(Stamp(500 * MS)));
    }

    #[test]
    fn the_last_frames_are_remembered_and_no_more() {
        for n_readings in [1, 19840, 4 << 20, 1 << 24] {
            let n_frames = Partner::n_frames_max(n_readings);
            assert!((8..=4096).contains(&n_frames), "{n_frames}");
        }
        let n_readings = 1 << 20;
        let mut partner = Partner::new(n_readings, Duration::MAX);
        let n_frames = Partner::n_frames_max(n_readings);
        assert_eq!(n_frames, 8);
        for index in 0..3 * n_frames {
            partner.insert(Stamp(index as i64), &vec![index as u16; n_readings]);
        }
        assert_eq!(partner.at(Stamp(2 * n_frames as i64 - 1)), None);
        // Older than all that are remembered.
        partner.insert(Stamp(3), &vec![99; n_readings]);
        assert_eq!(partner.at(Stamp(2 * n_frames as i64 - 1)), None);
        for index in 2 * n_frames..3 * n_frames {
            let (at, counts) = partner.at(Stamp(index as i64)).unwrap();
            assert_eq!((at, counts[n_readings - 1]), (Stamp(index as i64), index as u16));
        }
    }

    #[test]
    fn times_at_the_ends_of_all_time_do_no_harm() {
        let mut partner = Partner::new(1, Duration::MAX);
        for at in [i64::MAX, i64::MIN, 0] {
            partner.insert(Stamp(at), &[7]);
            assert!(partner.at(Stamp(at)).is_some());
        }
        assert!(partner.at(Stamp(i64::MAX)).is_some());
    }

    #[test]
    fn counts_become_those_of_another_unit_by_the_nearest() {
        let check = |from: f64, to: f64, counts: &[u16], expected: &[u16]| {
            let table = counts_in_unit(from, to);
            let found: Vec<u16> = counts.iter().map(|&count| table[usize::from(count)]).collect();
            assert_eq!(found, expected, "{from} to {to}");
        };
        check(0.001, 0.001, &[0, 1, 65535], &[0, 1, 65535]);
        check(0.00025, 0.00025, &[0, 1, 65535], &[0, 1, 65535]);
        // A whole ratio is exact towards the finer unit.
        check(0.001, 0.00025, &[0, 1, 16383, 16384, 65535], &[0, 4, 65532, 0, 0]);
        check(0.00025, 0.001, &[0, 1, 3, 4, 5, 65533, 65535], &[0, 0, 1, 1, 1, 16383, 65535]);
        check(0.01, 0.001, &[1, 6553, 6554, 65535], &[10, 65530, 0, 65535]);
    }
}
