//! Where the robot was: planar poses, and the way between two of them.

use std::f64::consts::{PI, TAU};

use nalgebra::{Quaternion, UnitQuaternion};

/// A place in the plane and a heading (REP-103: x forward, y left, yaw counter-clockwise).
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Pose {
    /// Metres along the world's x axis.
    pub x_m: f64,
    /// Metres along the world's y axis.
    pub y_m: f64,
    /// Heading, counter-clockwise from the x axis.
    pub yaw_rad: f64,
}

impl Pose {
    /// The pose at `share` of the way from `a` (0) to `b` (1): straight in the plane, the yaw by the short way round.
    ///
    /// The yaw of the result is in [−π, π].
    pub fn interpolate(a: &Pose, b: &Pose, share: f64) -> Pose {
        let turn_rad = wrapped(b.yaw_rad - a.yaw_rad);
        Pose {
            x_m: a.x_m + share * (b.x_m - a.x_m),
            y_m: a.y_m + share * (b.y_m - a.y_m),
            yaw_rad: wrapped(a.yaw_rad + share * turn_rad),
        }
    }

    /// As a position and an orientation quaternion (x, y, z, w).
    pub(crate) fn position_orientation(&self) -> ([f64; 3], [f64; 4]) {
        let orientation = UnitQuaternion::from_euler_angles(0.0, 0.0, self.yaw_rad);
        ([self.x_m, self.y_m, 0.0], [orientation.i, orientation.j, orientation.k, orientation.w])
    }

    /// From a position and an orientation quaternion (x, y, z, w) of any length.
    ///
    /// `None` where these are no pose: a number that is not finite, or a quaternion of length zero (which is what an
    /// orientation that nobody filled in looks like).
    pub(crate) fn from_position_orientation(
        position_m: [f64; 3],
        orientation_xyzw: [f64; 4],
    ) -> Option<Pose> {
        let [x_m, y_m, _z_m] = position_m;
        let [x, y, z, w] = orientation_xyzw;
        // Looked at first: on the way to angles a NaN can turn into a number.
        if ![x_m, y_m, x, y, z, w].iter().all(|number| number.is_finite()) {
            return None;
        }
        let orientation = UnitQuaternion::try_new(Quaternion::new(w, x, y, z), 1e-9)?;
        let (_roll, _pitch, yaw_rad) = orientation.euler_angles();
        Some(Pose { x_m, y_m, yaw_rad })
    }
}

/// The same angle in [−π, π]; angles already there are returned to the bit.
fn wrapped(angle_rad: f64) -> f64 {
    if angle_rad.abs() <= PI { angle_rad } else { (angle_rad + PI).rem_euclid(TAU) - PI }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    fn pose() -> impl Strategy<Value = Pose> {
        (-1e3..1e3, -1e3..1e3, -PI..PI).prop_map(|(x_m, y_m, yaw_rad)| Pose { x_m, y_m, yaw_rad })
    }

    /// Distance between two headings, whatever turn they are written in.
    fn apart(a_rad: f64, b_rad: f64) -> f64 {
        let (sin, cos) = (a_rad - b_rad).sin_cos();
        sin.atan2(cos).abs()
    }

    proptest! {
        #[test]
        fn interpolation_begins_at_a_and_ends_at_b(a in pose(), b in pose()) {
            prop_assert_eq!(Pose::interpolate(&a, &b, 0.0), a);
            let end = Pose::interpolate(&a, &b, 1.0);
            // A few roundings of numbers up to 1e3, respectively of angles up to 2π.
            prop_assert!((end.x_m - b.x_m).abs() < 1e-12 * 1e3);
            prop_assert!((end.y_m - b.y_m).abs() < 1e-12 * 1e3);
            prop_assert!(apart(end.yaw_rad, b.yaw_rad) < 1e-14);
        }

        #[test]
        fn yaw_turns_steadily_and_never_further_than_half_a_turn(a in pose(), b in pose(), share in 0.0..1.0) {
            let between = Pose::interpolate(&a, &b, share);
            prop_assert!(between.yaw_rad.abs() <= PI);
            prop_assert!((apart(between.yaw_rad, a.yaw_rad) - share * apart(a.yaw_rad, b.yaw_rad)).abs() < 1e-13);
        }

        #[test]
        fn yaw_is_read_back_from_a_quaternion_of_any_length(yaw_rad in -PI..PI, length in 0.1..10.0) {
            let (sin, cos) = (yaw_rad / 2.0).sin_cos();
            let pose = Pose::from_position_orientation([1.0, 2.0, 3.0], [0.0, 0.0, length * sin, length * cos]).unwrap();
            prop_assert_eq!((pose.x_m, pose.y_m), (1.0, 2.0));
            prop_assert!(apart(pose.yaw_rad, yaw_rad) < 1e-14);
        }
    }

    #[test]
    fn yaw_crosses_the_half_turn_by_the_short_way() {
        let a = Pose { x_m: 0.0, y_m: 0.0, yaw_rad: PI - 0.1 };
        let b = Pose { x_m: 0.0, y_m: 0.0, yaw_rad: -PI + 0.3 };
        let between = Pose::interpolate(&a, &b, 0.5);
        assert!((between.yaw_rad - (-PI + 0.1)).abs() < 1e-14, "{}", between.yaw_rad);
    }

    #[test]
    fn what_is_no_pose_gives_none() {
        let level = [0.0, 0.0, 0.0, 1.0];
        assert!(Pose::from_position_orientation([0.0; 3], level).is_some());
        assert_eq!(Pose::from_position_orientation([0.0; 3], [0.0; 4]), None);
        assert_eq!(Pose::from_position_orientation([0.0; 3], [0.0, f64::NAN, 0.0, 1.0]), None);
        assert_eq!(Pose::from_position_orientation([0.0; 3], [0.0, 0.0, f64::INFINITY, 1.0]), None);
        assert_eq!(Pose::from_position_orientation([f64::NAN, 0.0, 0.0], level), None);
        assert_eq!(Pose::from_position_orientation([0.0, f64::INFINITY, 0.0], level), None);
    }
}
