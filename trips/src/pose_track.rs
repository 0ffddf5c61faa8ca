//! Where the robot was at a moment, by the poses around it.

use crate::history::History;
use crate::{Pose, Stamp};

/// The longest time between two poses that are interpolated between, in seconds.
///
/// A robot at walking pace moves about a metre in it; odometry comes ten to a thousand times as often.
pub const MAX_POSE_GAP_S: f64 = 1.0;

/// How far from a pose in time, in seconds, a frame may be that has no pose on its other side (within
/// [`MAX_POSE_GAP_S`] of the first) and still take it.
pub const MAX_POSE_REACH_S: f64 = 0.2;

/// The pose at a moment, by the rule in the crate's documentation.
pub(crate) fn pose_at(poses: &History<Pose>, at: Stamp) -> Option<Pose> {
    let [before, after] = poses.around(at);
    if let (Some((t_before, a)), Some((t_after, b))) = (before, after) {
        let gap_s = t_after.seconds_since(t_before);
        if gap_s <= MAX_POSE_GAP_S {
            // The gap is not 0: before ≤ at < after.
            return Some(Pose::interpolate(&a, &b, at.seconds_since(t_before) / gap_s));
        }
    }
    let distance_s = |stamp: Stamp| at.seconds_since(stamp).abs();
    [before, after]
        .into_iter()
        .flatten()
        .min_by(|(a, _), (b, _)| distance_s(*a).total_cmp(&distance_s(*b)))
        .filter(|(stamp, _)| distance_s(*stamp) <= MAX_POSE_REACH_S)
        .map(|(_, pose)| pose)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn at_ms(ms: i64) -> Stamp {
        Stamp(ms * 1_000_000)
    }

    /// A pose at each of these times, x_m the time in seconds.
    fn poses(times_ms: &[i64]) -> History<Pose> {
        let mut poses = History::default();
        for &ms in times_ms {
            poses.insert(at_ms(ms), Pose { x_m: ms as f64 * 1e-3, y_m: 0.0, yaw_rad: 0.0 });
        }
        poses
    }

    #[test]
    fn the_pose_at_a_moment_follows_the_stated_rule() {
        let check = |times_ms: &[i64], asked_ms: i64, expected_x_m: Option<f64>| {
            let x_m = pose_at(&poses(times_ms), at_ms(asked_ms)).map(|pose| pose.x_m);
            match (x_m, expected_x_m) {
                (Some(x_m), Some(expected)) => {
                    assert!((x_m - expected).abs() < 1e-9, "{times_ms:?} at {asked_ms}: {x_m}");
                }
                _ => assert_eq!(x_m, expected_x_m, "{times_ms:?} at {asked_ms}"),
            }
        };
        check(&[], 0, None);
        // Between two poses, on one, and out of the order they came in.
        check(&[0, 1000], 250, Some(0.25));
        check(&[0, 1000], 0, Some(0.0));
        check(&[0, 1000], 1000, Some(1.0));
        check(&[1000, 0, 500], 750, Some(0.75));
        // Before the first, after the last: as far as the reach.
        check(&[1000], 800, Some(1.0));
        check(&[1000], 799, None);
        check(&[1000], 1200, Some(1.0));
        check(&[1000], 1201, None);
        // A gap longer than what is interpolated across: the nearer end, as far as the reach.
        check(&[0, 1001], 200, Some(0.0));
        check(&[0, 1001], 201, None);
        check(&[0, 1001], 801, Some(1.001));
        check(&[0, 1001], 800, None);
        // Two poses of one moment.
        check(&[500, 500], 500, Some(0.5));
    }
}
