//! Where the frames of a trip were, and which of them were near a place.

use std::f64::consts::{PI, TAU};
use std::ops::Range;

use kinds_trips::Pose;
use rstar::RTree;
use rstar::primitives::GeomWithData;

/// What counts as the same place.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SamePlace {
    /// R: no farther apart than this, metres.
    pub radius_m: f64,
    /// Headings that differ by no more than this, radians; None where a place is the same from every side.
    pub heading_tolerance_rad: Option<f64>,
}

impl SamePlace {
    /// Within a radius, whatever the heading.
    pub fn within(radius_m: f64) -> Self {
        Self { radius_m, heading_tolerance_rad: None }
    }

    fn allows(&self, here: &Pose, there: &Pose) -> bool {
        let turned_rad = (there.yaw_rad - here.yaw_rad + PI).rem_euclid(TAU) - PI;
        self.heading_tolerance_rad.is_none_or(|tolerance_rad| turned_rad.abs() <= tolerance_rad)
    }
}

/// Where the frames of a trip were, in order of time.
#[derive(Clone, Debug)]
pub struct Places {
    poses: Vec<Pose>,
    tree: RTree<GeomWithData<[f64; 2], u32>>,
}

/// A frame near a place.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Near {
    pub(crate) frame_index: u32,
    pub(crate) distance_m: f64,
}

impl Places {
    /// Finds its way among poses; in order of time. O(n log n).
    pub fn new(poses: Vec<Pose>) -> Self {
        let places =
            poses.iter().zip(0..).map(|(pose, index)| GeomWithData::new([pose.x_m, pose.y_m], index));
        let tree = RTree::bulk_load(places.collect());
        Self { poses, tree }
    }

    /// Where, in order of time.
    pub fn poses(&self) -> &[Pose] {
        &self.poses
    }

    /// Number of frames.
    pub fn n_frames(&self) -> usize {
        self.poses.len()
    }

    /// Length of the way from each frame to the next, summed: metres travelled when each was taken, shape `(n_frames,)`.
    pub(crate) fn travelled_m(&self) -> Vec<f64> {
        let steps_m = self.poses.windows(2).map(|pair| distance_m(&pair[0], &pair[1]));
        let mut sum_m = 0.0;
        let later = steps_m.map(|step_m| {
            sum_m += step_m;
            sum_m
        });
        std::iter::once(0.0).chain(later).take(self.poses.len()).collect()
    }

    /// The frames that were at the same place as a pose, in order of time.
    ///
    /// * `near` — overwritten
    pub(crate) fn near(&self, here: &Pose, same_place: &SamePlace, near: &mut Vec<Near>) {
        // The tree compares squares, which are rounded: asked for a little more, then decided by the distance itself.
        let reach_m = same_place.radius_m * (1.0 + 1e-9) + f64::MIN_POSITIVE.sqrt();
        let candidates = self.tree.locate_within_distance([here.x_m, here.y_m], reach_m * reach_m);
        near.clear();
        near.extend(candidates.filter_map(|found| {
            let there = &self.poses[found.data as usize];
            let distance_m = distance_m(here, there);
            let is_same = distance_m <= same_place.radius_m && same_place.allows(here, there);
            is_same.then_some(Near { frame_index: found.data, distance_m })
        }));
        near.sort_unstable_by_key(|near| near.frame_index);
    }

    /// How near the two trips come to each other, metres; infinite if one has no frames.
    pub(crate) fn least_distance_m(&self, other: &Places) -> f64 {
        let to_nearest = other.poses.iter().filter_map(|pose| {
            let nearest = self.tree.nearest_neighbor([pose.x_m, pose.y_m])?;
            Some(distance_m(pose, &self.poses[nearest.data as usize]))
        });
        to_nearest.fold(f64::INFINITY, f64::min)
    }

    /// The box that all places lie in: least and greatest x and y, metres.
    pub(crate) fn bounds_m(&self) -> [Range<f64>; 2] {
        let of = |place: fn(&Pose) -> f64| {
            let places = self.poses.iter().map(place);
            places.fold(f64::INFINITY..f64::NEG_INFINITY, |range, place| {
                range.start.min(place)..range.end.max(place)
            })
        };
        [of(|pose| pose.x_m), of(|pose| pose.y_m)]
    }
}

/// Straight way between two places, metres.
pub(crate) fn distance_m(here: &Pose, there: &Pose) -> f64 {
    (there.x_m - here.x_m).hypot(there.y_m - here.y_m)
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    fn poses() -> impl Strategy<Value = Vec<Pose>> {
        // Places on a small grid, so that many frames share one and many distances are exactly the radius.
        let pose = (0..6_i32, 0..6_i32, -8..9_i32).prop_map(|(x, y, yaw)| Pose {
            x_m: f64::from(x) / 10.0,
            y_m: f64::from(y) / 10.0,
            yaw_rad: f64::from(yaw) * PI / 4.0,
        });
        prop::collection::vec(pose, 0..60)
    }

    proptest! {
        #[test]
        fn the_frames_near_a_place_are_those_that_a_look_at_every_frame_finds(
            poses in poses(),
            radius_m in prop_oneof![Just(0.0), Just(0.1), Just(0.2), 0.0..0.5_f64],
            heading_tolerance_rad in prop_oneof![Just(None), Just(Some(PI / 4.0)), Just(Some(0.0))],
        ) {
            let same_place = SamePlace { radius_m, heading_tolerance_rad };
            let (places, mut near) = (Places::new(poses.clone()), Vec::new());
            for here in &poses {
                places.near(here, &same_place, &mut near);
                let looked: Vec<Near> = poses
                    .iter()
                    .zip(0..)
                    .map(|(there, frame_index)| (there, Near { frame_index, distance_m: distance_m(here, there) }))
                    .filter(|(there, near)| near.distance_m <= radius_m && same_place.allows(here, there))
                    .map(|(_, near)| near)
                    .collect();
                prop_assert_eq!(&near, &looked);
            }
        }
    }

    #[test]
    fn headings_are_compared_the_short_way_round() {
        let heading = |yaw_rad| Pose { x_m: 0.0, y_m: 0.0, yaw_rad };
        let within = |tolerance_rad| SamePlace { radius_m: 1.0, heading_tolerance_rad: Some(tolerance_rad) };
        assert!(within(0.3).allows(&heading(3.1), &heading(-3.1)));
        assert!(!within(0.3).allows(&heading(0.0), &heading(0.31)));
        assert!(within(0.3).allows(&heading(0.1), &heading(0.1 + 3.0 * TAU)));
        assert!(SamePlace::within(1.0).allows(&heading(0.0), &heading(3.0)));
    }

    #[test]
    fn a_trip_is_as_long_as_its_steps_and_its_box_as_wide_as_its_places() {
        let at = |x_m, y_m| Pose { x_m, y_m, yaw_rad: 0.0 };
        let places = Places::new(vec![at(0.0, 0.0), at(3.0, 4.0), at(3.0, 4.0), at(3.0, -1.0)]);
        assert_eq!(places.travelled_m(), [0.0, 5.0, 5.0, 10.0]);
        assert_eq!(places.bounds_m(), [0.0..3.0, -1.0..4.0]);
        assert_eq!(places.least_distance_m(&Places::new(vec![at(9.0, -1.0), at(3.0, -3.5)])), 2.5);
        assert_eq!(Places::new(Vec::new()).travelled_m(), [0.0; 0]);
    }
}
