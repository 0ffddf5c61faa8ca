//! Where a robot believes itself to be by the turns of its two wheels.
//!
//! Encoders count whole ticks. What the robot does not know: its wheels are a little larger or smaller than it was
//! told, both alike and one against the other, and on every stretch each wheel slips. So position and heading drift
//! without bound.

use kinds_messages::Pose;

use super::angle::direction;
use super::random::{Random, Streams};

/// Two wheels and how well the robot knows them.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Wheels {
    /// Between the wheels.
    pub(crate) track_m: f64,
    pub(crate) tick_m: f64,
    /// Largest error of both wheels' size, as a share.
    pub(crate) size_error_max: f64,
    /// Largest error of one wheel's size against the other's, as a share.
    pub(crate) difference_max: f64,
    /// Standard deviation of one wheel's slip after one metre; grows with the square root of the way.
    pub(crate) slip_per_root_m: f64,
}

/// Dead reckoning of one trip.
pub(crate) struct Odometry {
    wheels: Wheels,
    /// Way counted for way rolled, left and right.
    scale: [f64; 2],
    slip: [Random; 2],
    /// Way rolled and not yet counted, in parts of a tick.
    rest_ticks: [f64; 2],
    believed: Pose,
}

impl Odometry {
    /// Begins where the robot is told that it is.
    pub(crate) fn new(start: Pose, wheels: Wheels, streams: &Streams) -> Self {
        let mut sizes = streams.named("wheel sizes");
        let mut error = |largest: f64| sizes.between(-largest, largest);
        let (both, difference) = (error(wheels.size_error_max), error(wheels.difference_max));
        Self {
            wheels,
            scale: [1.0 + both - 0.5 * difference, 1.0 + both + 0.5 * difference],
            slip: [0, 1].map(|wheel| streams.numbered("wheel slip", wheel)),
            rest_ticks: [0.0; 2],
            believed: start,
        }
    }

    /// Where the robot believes itself to be after one more stretch, which is short: its arc is taken for a chord.
    pub(crate) fn update(&mut self, forward_m: f64, turn_rad: f64) -> Pose {
        let half_turn_m = 0.5 * turn_rad * self.wheels.track_m;
        let counted_m = [forward_m - half_turn_m, forward_m + half_turn_m];
        let [left_m, right_m] = std::array::from_fn(|wheel| self.counted_m(wheel, counted_m[wheel]));
        advance(&mut self.believed, 0.5 * (left_m + right_m), (right_m - left_m) / self.wheels.track_m);
        self.believed
    }

    /// What the encoder of one wheel counts of a way, metres in whole ticks.
    fn counted_m(&mut self, wheel: usize, way_m: f64) -> f64 {
        let slip_m = self.wheels.slip_per_root_m * way_m.abs().sqrt() * self.slip[wheel].normal();
        let ticks = self.rest_ticks[wheel] + (self.scale[wheel] * way_m + slip_m) / self.wheels.tick_m;
        let whole = ticks.floor();
        self.rest_ticks[wheel] = ticks - whole;
        whole * self.wheels.tick_m
    }
}

/// Moves a pose along an arc, taken for its chord: exact to the third order in the turn.
pub(crate) fn advance(pose: &mut Pose, forward_m: f64, turn_rad: f64) {
    let chord = forward_m * direction(pose.yaw_rad + 0.5 * turn_rad);
    pose.x_m += chord.x;
    pose.y_m += chord.y;
    pose.yaw_rad = super::angle::wrapped(pose.yaw_rad + turn_rad);
}

#[cfg(test)]
mod tests {
    use super::*;

    const PERFECT: Wheels = Wheels {
        track_m: 0.3,
        tick_m: 0.0005,
        size_error_max: 0.0,
        difference_max: 0.0,
        slip_per_root_m: 0.0,
    };

    /// Truth and belief after a circle of 2 m radius and so many metres, in stretches of 10 mm.
    fn circle(wheels: Wheels, trip: u32, way_m: f64) -> (Pose, Pose) {
        let mut odometry = Odometry::new(Pose::default(), wheels, &Streams::new("wheels", trip, 7));
        let (mut truth, mut believed) = (Pose::default(), Pose::default());
        for _ in 0..(way_m / 0.01).round() as usize {
            advance(&mut truth, 0.01, 0.005);
            believed = odometry.update(0.01, 0.005);
        }
        (truth, believed)
    }

    #[test]
    fn wheels_that_are_known_and_never_slip_lose_only_parts_of_ticks() {
        let (truth, believed) = circle(PERFECT, 1, 20.0);
        // A heading is never off by more than a tick of one wheel against the other.
        let heading_max = 0.0005 / 0.3;
        assert!((truth.yaw_rad - believed.yaw_rad).abs() <= heading_max + 1e-9);
        assert!((truth.x_m - believed.x_m).hypot(truth.y_m - believed.y_m) <= 0.0005 + 20.0 * heading_max);
    }

    #[test]
    fn wheels_of_another_size_count_another_way() {
        let wheels = Wheels { size_error_max: 0.02, ..PERFECT };
        let straight = |trip| {
            let mut odometry = Odometry::new(Pose::default(), wheels, &Streams::new("wheels", trip, 7));
            (0..1000).map(|_| odometry.update(0.01, 0.0).x_m).last().unwrap_or_default()
        };
        for trip in 0..20 {
            let counted_m = straight(trip);
            assert!((9.799..10.2).contains(&counted_m), "{counted_m}");
        }
        assert_ne!(straight(1), straight(2));
    }

    #[test]
    fn slip_spreads_the_heading_with_the_root_of_the_way() {
        let wheels = Wheels { slip_per_root_m: 0.002, ..PERFECT };
        let spread = |way_m: f64| {
            let errors = (0..200).map(|trip| {
                let (truth, believed) = circle(wheels, trip, way_m);
                super::super::angle::wrapped(truth.yaw_rad - believed.yaw_rad).powi(2)
            });
            (errors.sum::<f64>() / 200.0).sqrt()
        };
        for way_m in [1.0_f64, 9.0] {
            // Both wheels slip; a quarter is five standard errors of a deviation from 200 trips.
            let expected = 2.0_f64.sqrt() * 0.002 * way_m.sqrt() / 0.3;
            assert!((spread(way_m) / expected - 1.0).abs() < 0.25, "after {way_m} m");
        }
    }
}
