//! The paper's consistency: does a place seen again get the same kind?
//!
//! A frame of the first trip is *revisited* if the second trip has a frame at the same place. It is *consistent* if
//! strictly more than a given share of those frames have its kind. Consistency is 100 % with a single kind, so it means
//! nothing without the level that chance would reach ([`Consistency::chance`]) and [`kappa`].
//!
//! The frames of the second trip that are near a frame of the first mostly follow each other in time: a few stretches, one
//! for each time that the robot came by. With sums of each kind along the trip, counting the frames of one kind among
//! them takes a step for each stretch, however many frames it has, and also when the kinds are shifted in time.

use std::ops::Range;

use rayon::prelude::*;

use crate::places::{Near, Places, SamePlace};

/// Circular shifts that the chance level is averaged over, at most; more trips' worth of them change nothing.
pub(crate) const N_SHIFTS_MAX: usize = 512;

/// Frames that one thread looks at before it asks for more.
const N_FRAMES_AT_A_TIME: usize = 256;

/// Which frames of the second trip were where each frame of the first was.
#[derive(Clone, Debug)]
pub struct Revisits {
    n_first: usize,
    n_second: usize,
    /// The revisited frames of the first trip, in order of time.
    revisited: Vec<Revisited>,
    /// Frames of the second trip that follow each other.
    stretches: Vec<Range<u32>>,
}

#[derive(Clone, Debug)]
struct Revisited {
    frame_index: u32,
    /// The nearest frame of the second trip, the first of equals.
    nearest: u32,
    n_near: u32,
    /// Which stretches are near it.
    stretches: Range<usize>,
}

/// How consistent two trips' kinds are.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Consistency {
    /// C: share of the revisited frames that are consistent.
    pub consistency: f64,
    /// C₀: its mean when the second trip's kinds are shifted circularly in time.
    pub chance: f64,
}

/// Agreement corrected for chance: `κ = (C − C₀) / (1 − C₀)`. 0 where chance alone is always consistent.
pub fn kappa(consistency: Consistency) -> f64 {
    let Consistency { consistency, chance } = consistency;
    if chance < 1.0 { (consistency - chance) / (1.0 - chance) } else { 0.0 }
}

/// How often frames were consistent: counts that can be added, whichever frames they are of.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(crate) struct Counts {
    pub(crate) n_revisited: u64,
    pub(crate) n_consistent: u64,
    /// Pairs of a frame and a shift by which it is consistent.
    pub(crate) n_by_chance: u64,
}

impl Counts {
    /// * `n_shifts` — that the counts by chance are of
    ///
    /// `None` if no frame was revisited.
    pub(crate) fn consistency(&self, n_shifts: usize) -> Option<Consistency> {
        let n_revisited = self.n_revisited as f64;
        (self.n_revisited > 0).then(|| Consistency {
            consistency: self.n_consistent as f64 / n_revisited,
            chance: self.n_by_chance as f64 / (n_revisited * n_shifts as f64),
        })
    }
}

impl std::ops::AddAssign for Counts {
    fn add_assign(&mut self, other: Self) {
        self.n_revisited += other.n_revisited;
        self.n_consistent += other.n_consistent;
        self.n_by_chance += other.n_by_chance;
    }
}

impl Revisits {
    /// Finds, for each frame of the first trip, the frames of the second at the same place.
    ///
    /// O(n_first · (log n_second + m log m)), m being the frames of the second trip near one of the first, on the threads of
    /// whoever calls.
    pub fn find(first: &Places, second: &Places, same_place: &SamePlace) -> Self {
        let parts: Vec<Self> = first
            .poses()
            .par_chunks(N_FRAMES_AT_A_TIME)
            .enumerate()
            .map(|(part, poses)| {
                let mut found = Self::none(first, second);
                let mut near = Vec::new();
                for (pose, frame_index) in poses.iter().zip(part * N_FRAMES_AT_A_TIME..) {
                    second.near(pose, same_place, &mut near);
                    found.add(frame_index, &near);
                }
                found
            })
            .collect();
        parts.into_iter().fold(Self::none(first, second), Self::followed_by)
    }

    fn none(first: &Places, second: &Places) -> Self {
        let (n_first, n_second) = (first.n_frames(), second.n_frames());
        Self { n_first, n_second, revisited: Vec::new(), stretches: Vec::new() }
    }

    fn add(&mut self, frame_index: usize, near: &[Near]) {
        let by_distance = |a: &&Near, b: &&Near| a.distance_m.total_cmp(&b.distance_m);
        let Some(nearest) = near.iter().min_by(by_distance) else { return };
        let start = self.stretches.len();
        let n_near = add_stretches(near, f64::INFINITY, &mut self.stretches);
        self.revisited.push(Revisited {
            frame_index: frame_index as u32,
            nearest: nearest.frame_index,
            n_near,
            stretches: start..self.stretches.len(),
        });
    }

    fn followed_by(mut self, later: Self) -> Self {
        let offset = self.stretches.len();
        self.stretches.extend(later.stretches);
        self.revisited.extend(later.revisited.into_iter().map(|mut revisited| {
            revisited.stretches = revisited.stretches.start + offset..revisited.stretches.end + offset;
            revisited
        }));
        self
    }

    /// Share of the first trip's frames that the second trip revisited.
    pub fn share_revisited(&self) -> f64 {
        self.revisited.len() as f64 / self.n_first as f64
    }

    /// Circular shifts that chance is averaged over.
    pub(crate) fn n_shifts(&self) -> usize {
        Shifts::of(self.n_second, N_SHIFTS_MAX).n()
    }

    /// Measures the consistency of two trips' kinds.
    ///
    /// * `first`, `second` — kind of each frame, in the order of the places
    /// * `share` — Z: strictly more than this share must have the same kind, 0…1
    ///
    /// `None` if no place was revisited.
    pub fn consistency(&self, first: &[usize], second: &[usize], share: f64) -> Option<Consistency> {
        let all = 0..self.n_first;
        self.counts(first, second, share, N_SHIFTS_MAX, std::slice::from_ref(&all))[0]
            .consistency(self.n_shifts())
    }

    /// Counts how often the frames of each block of the first trip are consistent, in truth and by chance.
    ///
    /// * `n_shifts_max` — circular shifts at most
    /// * `blocks` — frames of the first trip that follow each other
    ///
    /// O(n_shifts · number of stretches).
    pub(crate) fn counts(
        &self,
        first: &[usize],
        second: &[usize],
        share: f64,
        n_shifts_max: usize,
        blocks: &[Range<usize>],
    ) -> Vec<Counts> {
        assert_eq!((first.len(), second.len()), (self.n_first, self.n_second), "one kind for each place");
        let shifts = Shifts::of(self.n_second, n_shifts_max);
        let sums = KindSums::of(second, 1 + first.iter().copied().max().unwrap_or(0));
        let of_block = |block: &Range<usize>| {
            let counts = self.in_block(block).par_iter().with_min_len(N_FRAMES_AT_A_TIME).map(|revisited| {
                let (kind, near) =
                    (first[revisited.frame_index as usize], &self.stretches[revisited.stretches.clone()]);
                let enough = share * f64::from(revisited.n_near);
                let is_consistent = |shift| u64::from(f64::from(sums.count(kind, near, shift)) > enough);
                Counts {
                    n_revisited: 1,
                    n_consistent: is_consistent(0),
                    n_by_chance: shifts.iter().map(is_consistent).sum(),
                }
            });
            counts.reduce(Counts::default, |mut sum, counts| {
                sum += counts;
                sum
            })
        };
        blocks.iter().map(of_block).collect()
    }

    fn in_block(&self, block: &Range<usize>) -> &[Revisited] {
        let place = |frame: usize| {
            self.revisited.partition_point(|revisited| (revisited.frame_index as usize) < frame)
        };
        &self.revisited[place(block.start)..place(block.end)]
    }

    /// Kind of each revisited frame of a block, and kind of the second trip's frame nearest to it.
    pub(crate) fn pairs<'a>(
        &'a self,
        first: &'a [usize],
        second: &'a [usize],
        block: &Range<usize>,
    ) -> impl Iterator<Item = (usize, usize)> + 'a {
        let pair = |revisited: &Revisited| {
            (first[revisited.frame_index as usize], second[revisited.nearest as usize])
        };
        self.in_block(block).iter().map(pair)
    }
}

/// Adds the stretches of those frames that are no farther than a radius, and says how many frames these are.
///
/// * `near` — in order of time
pub(crate) fn add_stretches(near: &[Near], radius_m: f64, stretches: &mut Vec<Range<u32>>) -> u32 {
    let first = stretches.len();
    let mut n_near = 0;
    for Near { frame_index, .. } in near.iter().filter(|near| near.distance_m <= radius_m) {
        n_near += 1;
        match stretches[first..].last_mut() {
            Some(last) if last.end == *frame_index => last.end += 1,
            _ => stretches.push(*frame_index..frame_index + 1),
        }
    }
    n_near
}

/// Circular shifts of a trip, evenly spread, and never the trip itself; but of a trip of one frame, which has no other.
#[derive(Clone, Debug)]
pub(crate) struct Shifts(Vec<usize>);

impl Shifts {
    pub(crate) fn of(n_frames: usize, n_max: usize) -> Self {
        let n_shifts = n_max.min(n_frames.saturating_sub(1));
        match n_shifts {
            0 => Self(vec![0]),
            _ => Self((1..=n_shifts).map(|step| (step * n_frames / (n_shifts + 1)).max(1)).collect()),
        }
    }

    pub(crate) fn n(&self) -> usize {
        self.0.len()
    }

    pub(crate) fn iter(&self) -> impl Iterator<Item = usize> + '_ {
        self.0.iter().copied()
    }
}

/// How many frames of each kind a trip has before each of its frames, twice around.
pub(crate) struct KindSums {
    /// Shape `(n_kinds, 2 · n_frames + 1)`.
    sums: Vec<u32>,
    n_sums: usize,
}

impl KindSums {
    /// * `n_kinds_min` — kinds that may be asked for, though the trip does not have them
    pub(crate) fn of(kinds: &[usize], n_kinds_min: usize) -> Self {
        let n_kinds = kinds.iter().map(|kind| kind + 1).max().unwrap_or(0).max(n_kinds_min);
        let n_sums = 2 * kinds.len() + 1;
        let mut sums = vec![0; n_kinds * n_sums];
        for (of_kind, sums) in sums.chunks_exact_mut(n_sums).enumerate() {
            for (index, kind) in kinds.iter().chain(kinds).enumerate() {
                sums[index + 1] = sums[index] + u32::from(*kind == of_kind);
            }
        }
        Self { sums, n_sums }
    }

    /// Frames of a kind in stretches, when the trip's kinds are shifted: frame i has the kind of frame i + shift.
    pub(crate) fn count(&self, kind: usize, stretches: &[Range<u32>], shift: usize) -> u32 {
        let sums = &self.sums[kind * self.n_sums + shift..];
        stretches.iter().map(|stretch| sums[stretch.end as usize] - sums[stretch.start as usize]).sum()
    }
}

#[cfg(test)]
mod tests {
    use kinds_trips::Pose;
    use proptest::prelude::*;

    use super::*;

    fn line(places_m: &[f64]) -> Places {
        Places::new(places_m.iter().map(|&x_m| Pose { x_m, y_m: 0.0, yaw_rad: 0.0 }).collect())
    }

    fn within(first: &Places, second: &Places, radius_m: f64) -> Revisits {
        Revisits::find(first, second, &SamePlace::within(radius_m))
    }

    #[test]
    fn consistency_is_the_share_of_revisited_frames_with_strictly_more_than_z_of_the_same_kind() {
        let first = line(&[0.0, 1.0, 9.0]);
        let second = line(&[0.1, -0.1, 1.1, 0.9]);
        let revisits = within(&first, &second, 0.2);
        assert_eq!(revisits.share_revisited(), 2.0 / 3.0);
        // Frame 0 sees kinds 5, 5: consistent. Frame 1 sees 5 and 6: half is not strictly more than half.
        let measured = revisits.consistency(&[5, 5, 5], &[5, 5, 5, 6], 0.5).unwrap();
        assert_eq!(measured.consistency, 0.5);
        // Shifts by 1, 2 and 3 give 5 5 6 5, 5 6 5 5 and 6 5 5 5: each once one of two frames.
        assert_eq!(measured.chance, 0.5);
        assert_eq!(kappa(measured), 0.0);
        assert_eq!(revisits.consistency(&[5, 5, 5], &[5, 5, 5, 6], 0.4).unwrap().consistency, 1.0);
    }

    /// A world of five places, one metre apart, and what a person counts there with a pencil:
    ///
    /// | place | first trip | second trip | same of near | consistent |
    /// |---|---|---|---|---|
    /// | 0 m | 0 | 0, 0 | 2 of 2 | yes |
    /// | 1 m | 0 | 0, 1 | 1 of 2 | no: half is not more |
    /// | 2 m | 1 | 1, 1 | 2 of 2 | yes |
    /// | 3 m | 1 | 0, 1 | 1 of 2 | no |
    /// | 4 m | 2 | nobody came by | | |
    ///
    /// The second trip goes there and back: 0 1 2 3 3 2 1 0 m, with kinds 0 0 1 0 1 1 1 0.
    #[test]
    fn a_world_of_points_has_the_consistency_chance_and_kappa_that_are_counted_by_hand() {
        let (first, kinds) = (line(&[0.0, 1.0, 2.0, 3.0, 4.0]), [0, 0, 1, 1, 2]);
        let (second, second_kinds) =
            (line(&[0.0, 1.0, 2.0, 3.0, 3.0, 2.0, 1.0, 0.0]), [0, 0, 1, 0, 1, 1, 1, 0]);
        let revisits = within(&first, &second, 0.25);
        assert_eq!(revisits.share_revisited(), 0.8);
        let measured = revisits.consistency(&kinds, &second_kinds, 0.5).unwrap();
        assert_eq!(measured.consistency, 0.5);
        // Shifted by s, frames 0 to 3 see kinds (s, s + 7), (s + 1, s + 6), (s + 2, s + 5), (s + 3, s + 4), counted around 8:
        // s = 1: 00 10 01 11, frames 0 and 3; s = 2: 10 00 10 11, frames 1 and 3; s = 3: 01 10 10 10; s = 4: 10 11 10 00;
        // s = 5: 11 10 01 00; s = 6: 11 01 00 01; s = 7: 01 01 01 10, none. That is 4 of 7 · 4.
        assert_eq!(measured.chance, 4.0 / 28.0);
        assert_eq!(kappa(measured), (0.5 - 4.0 / 28.0) / (1.0 - 4.0 / 28.0));
        // Exactly Z is not more than Z; just below it is.
        assert_eq!(revisits.consistency(&kinds, &second_kinds, 0.49).unwrap().consistency, 1.0);
        assert_eq!(revisits.consistency(&kinds, &second_kinds, 0.99).unwrap().consistency, 0.5);
        // A place seen from the other side does not count when headings matter.
        let turned = Places::new(vec![
            Pose { x_m: 0.0, y_m: 0.0, yaw_rad: 3.0 },
            Pose { x_m: 1.0, y_m: 0.0, yaw_rad: 0.2 },
        ]);
        let same_place = SamePlace { radius_m: 0.25, heading_tolerance_rad: Some(0.5) };
        assert_eq!(Revisits::find(&first, &turned, &same_place).share_revisited(), 0.2);
    }

    #[test]
    fn one_kind_everywhere_is_consistent_and_worth_nothing() {
        let places = line(&[0.0, 1.0, 2.0]);
        let measured = within(&places, &places, 0.1).consistency(&[0; 3], &[0; 3], 0.5).unwrap();
        assert_eq!((measured.consistency, measured.chance, kappa(measured)), (1.0, 1.0, 0.0));
    }

    #[test]
    fn trips_that_never_meet_have_no_consistency() {
        assert!(within(&line(&[0.0]), &line(&[5.0]), 1.0).consistency(&[0], &[0], 0.5).is_none());
    }

    #[test]
    fn at_radius_0_only_the_very_same_place_counts() {
        let (first, second) = (line(&[0.0, 1.0]), line(&[1e-12, 1.0]));
        let revisits = within(&first, &second, 0.0);
        assert_eq!(revisits.share_revisited(), 0.5);
        assert_eq!(revisits.consistency(&[4, 3], &[4, 3], 0.0).unwrap().consistency, 1.0);
    }

    #[test]
    fn a_frame_exactly_at_the_radius_is_near() {
        let revisits = |radius_m| within(&line(&[0.0]), &line(&[0.3, 7.0]), radius_m).share_revisited();
        assert_eq!((revisits(0.3), revisits(0.299_999_999)), (1.0, 0.0));
    }

    #[test]
    fn of_a_trip_of_one_frame_there_is_no_other_order() {
        let measured = within(&line(&[0.0]), &line(&[0.0]), 0.1).consistency(&[2], &[2], 0.5).unwrap();
        assert_eq!((measured.consistency, measured.chance), (1.0, 1.0));
    }

    /// The definition, word for word: no tree, no stretches, no sums.
    fn by_definition(
        first: (&[f64], &[usize]),
        second: (&[f64], &[usize]),
        radius_m: f64,
        share: f64,
    ) -> Option<Consistency> {
        let n_second = second.0.len();
        let share_consistent = |shift: usize| {
            let (mut n_revisited, mut n_consistent) = (0.0, 0.0);
            for (here, kind) in first.0.iter().zip(first.1) {
                let near: Vec<usize> =
                    (0..n_second).filter(|&there| (second.0[there] - here).abs() <= radius_m).collect();
                let n_same =
                    near.iter().filter(|&&there| second.1[(there + shift) % n_second] == *kind).count();
                n_revisited += f64::from(u8::from(!near.is_empty()));
                n_consistent += f64::from(u8::from(n_same as f64 > share * near.len() as f64));
            }
            (n_revisited > 0.0).then_some(n_consistent / n_revisited)
        };
        let chance: Vec<f64> = (1..n_second).map(share_consistent).collect::<Option<_>>()?;
        let chance = if chance.is_empty() {
            share_consistent(0)?
        } else {
            chance.iter().sum::<f64>() / chance.len() as f64
        };
        Some(Consistency { consistency: share_consistent(0)?, chance })
    }

    fn trip() -> impl Strategy<Value = (Vec<f64>, Vec<usize>)> {
        prop::collection::vec((0..20_u32, 0..4_usize), 1..40)
            .prop_map(|frames| frames.into_iter().map(|(place, kind)| (f64::from(place) / 4.0, kind)).unzip())
    }

    proptest! {
        #[test]
        fn sums_along_stretches_count_as_the_definition_does(
            first in trip(),
            second in trip(),
            radius_m in prop_oneof![Just(0.0), Just(0.25), 0.0..2.0_f64],
            share in prop_oneof![Just(0.5), 0.0..1.0_f64],
        ) {
            let found = within(&line(&first.0), &line(&second.0), radius_m).consistency(&first.1, &second.1, share);
            let expected = by_definition((&first.0, &first.1), (&second.0, &second.1), radius_m, share);
            match (found, expected) {
                (Some(found), Some(expected)) => {
                    prop_assert_eq!(found.consistency, expected.consistency);
                    prop_assert!((found.chance - expected.chance).abs() < 1e-12);
                }
                (found, expected) => prop_assert_eq!(found, expected),
            }
        }

        #[test]
        fn a_trip_against_itself_is_wholly_consistent_and_kappa_is_one_or_zero(
            kinds in prop::collection::vec(0..4_usize, 2..40),
            radius_m in prop_oneof![Just(0.0), Just(0.5)],
        ) {
            let places_m: Vec<f64> = (0..kinds.len()).map(|index| index as f64).collect();
            let revisits = within(&line(&places_m), &line(&places_m), radius_m);
            let measured = revisits.consistency(&kinds, &kinds, 0.5).unwrap();
            prop_assert_eq!(measured.consistency, 1.0);
            prop_assert!((0.0..=1.0).contains(&measured.chance));
            prop_assert_eq!(kappa(measured), f64::from(u8::from(measured.chance < 1.0)));
        }

        #[test]
        fn blocks_count_together_what_the_whole_counts(first in trip(), second in trip(), cut in 0.0..1.0_f64) {
            let revisits = within(&line(&first.0), &line(&second.0), 0.3);
            let n_first = first.0.len();
            let cut = (cut * n_first as f64) as usize;
            let counts = |blocks: &[Range<usize>]| revisits.counts(&first.1, &second.1, 0.5, 20, blocks);
            let mut sum = Counts::default();
            counts(&[0..cut, cut..n_first]).into_iter().for_each(|counts| sum += counts);
            let whole = 0..n_first;
            prop_assert_eq!(vec![sum], counts(std::slice::from_ref(&whole)));
        }
    }
}
