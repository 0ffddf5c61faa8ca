//! The paper's consistency: does a place seen again get the same kind?
//!
//! A frame of the first trip is *revisited* if the second trip has a frame within a radius of it. It is *consistent* if
//! strictly more than a given share of those frames have its kind. Consistency is 100 % with a single kind, so it means
//! nothing without the level that chance would reach ([`Consistency::chance`]) and [`kappa`].

use kinds_trips::Pose;

/// Circular shifts that the chance level is averaged over, at most; more trips' worth of them change nothing.
const N_SHIFTS_MAX: usize = 512;

/// Where and what the frames of a trip were, in order of time.
#[derive(Clone, Debug, Default)]
pub struct Places {
    /// Where, metres.
    pub poses: Vec<Pose>,
}

/// Which frames of the second trip are near each frame of the first.
#[derive(Clone, Debug)]
pub struct Revisits {
    /// For each revisited frame of the first trip: its index, and the frames of the second within the radius.
    near: Vec<(usize, Vec<u32>)>,
    /// For each of them, the nearest frame of the second trip.
    nearest: Vec<u32>,
    n_first: usize,
    n_second: usize,
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

impl Revisits {
    /// Finds, for each frame of the first trip, the frames of the second within `radius_m`.
    ///
    /// O(n_first · n_second).
    pub fn find(first: &Places, second: &Places, radius_m: f64) -> Self {
        let (mut near, mut nearest) = (Vec::new(), Vec::new());
        for (index, here) in first.poses.iter().enumerate() {
            let distances =
                second.poses.iter().map(|there| (there.x_m - here.x_m).hypot(there.y_m - here.y_m));
            let mut within: Vec<(f64, u32)> =
                distances.zip(0..).filter(|(distance, _)| *distance <= radius_m).collect();
            within.sort_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
            if let Some(&(_, closest)) = within.first() {
                nearest.push(closest);
                near.push((index, within.into_iter().map(|(_, other)| other).collect()));
            }
        }
        Self { near, nearest, n_first: first.poses.len(), n_second: second.poses.len() }
    }

    /// Share of the first trip's frames that have a frame of the second within the radius.
    pub fn share_revisited(&self) -> f64 {
        self.near.len() as f64 / self.n_first as f64
    }

    /// Measures the consistency of two trips' kinds.
    ///
    /// * `first`, `second` — kind of each frame, in the order of the places
    /// * `share` — Z: strictly more than this share must have the same kind, 0…1
    ///
    /// `None` if no place was revisited.
    pub fn consistency(&self, first: &[usize], second: &[usize], share: f64) -> Option<Consistency> {
        assert_eq!((first.len(), second.len()), (self.n_first, self.n_second), "one kind for each place");
        if self.near.is_empty() {
            return None;
        }
        let n_shifts = N_SHIFTS_MAX.min(self.n_second - 1);
        // Evenly spread, and never the trip itself.
        let shifts = (1..=n_shifts).map(|step| (step * self.n_second / (n_shifts + 1)).max(1));
        let chance = match n_shifts {
            0 => self.share_consistent(first, second, share, 0),
            _ => {
                shifts.map(|shift| self.share_consistent(first, second, share, shift)).sum::<f64>()
                    / n_shifts as f64
            }
        };
        Some(Consistency { consistency: self.share_consistent(first, second, share, 0), chance })
    }

    /// Kind of each revisited frame, and kind of the second trip's frame nearest to it.
    pub fn pairs<'a>(
        &'a self,
        first: &'a [usize],
        second: &'a [usize],
    ) -> impl Iterator<Item = (usize, usize)> + 'a {
        self.near
            .iter()
            .zip(&self.nearest)
            .map(|((index, _), &nearest)| (first[*index], second[nearest as usize]))
    }

    fn share_consistent(&self, first: &[usize], second: &[usize], share: f64, shift: usize) -> f64 {
        let kind_at = |other: u32| second[(other as usize + shift) % self.n_second];
        let is_consistent = |(index, near): &&(usize, Vec<u32>)| {
            let n_same = near.iter().filter(|&&other| kind_at(other) == first[*index]).count();
            n_same as f64 > share * near.len() as f64
        };
        self.near.iter().filter(is_consistent).count() as f64 / self.near.len() as f64
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    fn line(places_m: &[f64]) -> Places {
        Places { poses: places_m.iter().map(|&x_m| Pose { x_m, y_m: 0.0, yaw_rad: 0.0 }).collect() }
    }

    #[test]
    fn consistency_is_the_share_of_revisited_frames_with_strictly_more_than_z_of_the_same_kind() {
        let first = line(&[0.0, 1.0, 9.0]);
        let second = line(&[0.1, -0.1, 1.1, 0.9]);
        let revisits = Revisits::find(&first, &second, 0.2);
        assert_eq!(revisits.share_revisited(), 2.0 / 3.0);
        // Frame 0 sees kinds 5, 5: consistent. Frame 1 sees 5 and 6: half is not strictly more than half.
        let measured = revisits.consistency(&[5, 5, 5], &[5, 5, 5, 6], 0.5).unwrap();
        assert_eq!(measured.consistency, 0.5);
        // Shifts by 1, 2 and 3 give 5 5 6 5, 5 6 5 5 and 6 5 5 5: each once one of two frames.
        assert_eq!(measured.chance, 0.5);
        assert_eq!(kappa(measured), 0.0);
        assert_eq!(revisits.consistency(&[5, 5, 5], &[5, 5, 5, 6], 0.4).unwrap().consistency, 1.0);
    }

    #[test]
    fn one_kind_everywhere_is_consistent_and_worth_nothing() {
        let places = line(&[0.0, 1.0, 2.0]);
        let revisits = Revisits::find(&places, &places, 0.1);
        let measured = revisits.consistency(&[0; 3], &[0; 3], 0.5).unwrap();
        assert_eq!((measured.consistency, measured.chance, kappa(measured)), (1.0, 1.0, 0.0));
    }

    #[test]
    fn trips_that_never_meet_have_no_consistency() {
        assert!(Revisits::find(&line(&[0.0]), &line(&[5.0]), 1.0).consistency(&[0], &[0], 0.5).is_none());
    }

    proptest! {
        #[test]
        fn a_trip_against_itself_is_wholly_consistent_and_kappa_is_one_or_zero(
            kinds in prop::collection::vec(0..4_usize, 2..40),
        ) {
            let places_m: Vec<f64> = (0..kinds.len()).map(|index| index as f64).collect();
            let revisits = Revisits::find(&line(&places_m), &line(&places_m), 0.5);
            let measured = revisits.consistency(&kinds, &kinds, 0.5).unwrap();
            prop_assert_eq!(measured.consistency, 1.0);
            prop_assert!((0.0..=1.0).contains(&measured.chance));
            prop_assert_eq!(kappa(measured), f64::from(u8::from(measured.chance < 1.0)));
        }
    }
}
