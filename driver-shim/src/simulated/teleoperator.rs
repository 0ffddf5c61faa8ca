//! Who drives: a person at a joystick who knows the route.
//!
//! The driver looks at a point of the route some way ahead and steers towards it. What makes it a person: commands
//! answer to what was seen a reaction time ago and pass through a hand that takes time to move, so turns overshoot;
//! neither the line nor the speed is held exactly; speed drops in turns; now and then the driver stops and looks. Each
//! trip has its own temper: cruising speed, lookahead, steering gain and reaction time.

use std::collections::VecDeque;

use kinds_messages::{Command, Pose};
use nalgebra::Vector2;

use super::angle::{angle_of, left_of, wrapped};
use super::random::{Random, Streams, Wander};

/// How a robot is driven: the mean of all drivers.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Manner {
    pub(crate) cruise_m_s: f64,
    pub(crate) turn_rad_s_max: f64,
    /// How far ahead of the robot on the route the driver looks.
    pub(crate) lookahead_m: f64,
    /// Standard deviation of the point looked at, sideways. It never exceeds twice this.
    pub(crate) wander_m: f64,
    /// Mean time between two stops.
    pub(crate) between_stops_s: f64,
}

/// A driver on a route.
pub(crate) struct Teleoperator {
    route: Vec<Vector2<f64>>,
    /// The route's leg that the driver looks at, and how far along it.
    leg: usize,
    along_m: f64,
    manner: Manner,
    step_s: f64,
    cruise_m_s: f64,
    lookahead_m: f64,
    /// Turn for each radian off course, 1/s.
    gain_per_s: f64,
    /// What the driver has decided and the hand has not yet begun, oldest first.
    decided: VecDeque<Command>,
    hand: Command,
    sideways: Wander,
    haste: Wander,
    stops: Random,
    stopped_s: f64,
}

/// Time in which the hand goes 63 % of the way to what was decided.
const HAND_S: f64 = 0.15;
/// Standard deviation of the speed as a share of the cruising speed.
const HASTE: f64 = 0.12;
/// How near to its last point a route counts as driven.
const ARRIVED_M: f64 = 0.25;

impl Teleoperator {
    /// * `route` — at least two different points
    /// * `step_s` — time between two calls of [`Teleoperator::command`]
    pub(crate) fn new(route: Vec<Vector2<f64>>, manner: Manner, step_s: f64, streams: &Streams) -> Self {
        assert!(route.len() >= 2, "a route has a start and an end");
        let mut temper = streams.named("temper");
        let reaction_s = temper.between(0.15, 0.25);
        let still = Command::default();
        let wander =
            |source, deviation, memory_s| Wander::new(streams.named(source), deviation, memory_s, step_s);
        Self {
            leg: 0,
            along_m: 0.0,
            step_s,
            cruise_m_s: manner.cruise_m_s * temper.between(0.9, 1.1),
            lookahead_m: manner.lookahead_m * temper.between(0.95, 1.15),
            gain_per_s: temper.between(1.5, 2.0),
            decided: vec![still; (reaction_s / step_s).round() as usize].into(),
            hand: still,
            sideways: wander("sideways", manner.wander_m, 5.0),
            haste: wander("haste", HASTE, 3.0),
            stops: streams.named("stops"),
            stopped_s: 0.0,
            route,
            manner,
        }
    }

    /// What the driver commands one step later, seeing where the robot is; `None` once it has arrived.
    pub(crate) fn command(&mut self, pose: &Pose) -> Option<Command> {
        let place = Vector2::new(pose.x_m, pose.y_m);
        self.look_ahead(place);
        if self.leg + 2 == self.route.len() && (self.route[self.leg + 1] - place).norm() < ARRIVED_M {
            return None;
        }
        let decision = self.decide(place, pose.yaw_rad);
        self.decided.push_back(decision);
        let begun = self.decided.pop_front().unwrap_or(decision);
        let share = 1.0 - libm::exp(-self.step_s / HAND_S);
        self.hand.forward_m_s += share * (begun.forward_m_s - self.hand.forward_m_s);
        self.hand.turn_rad_s += share * (begun.turn_rad_s - self.hand.turn_rad_s);
        Some(self.hand)
    }

    /// Moves the point looked at along the route until it is the lookahead away or the route ends.
    fn look_ahead(&mut self, place: Vector2<f64>) {
        const STEP_M: f64 = 0.02;
        while (self.looked_at(0.0) - place).norm() < self.lookahead_m {
            let (_, length_m) = self.leg_direction();
            if self.along_m < length_m {
                self.along_m = (self.along_m + STEP_M).min(length_m);
            } else if self.leg + 2 < self.route.len() {
                (self.leg, self.along_m) = (self.leg + 1, 0.0);
            } else {
                return;
            }
        }
    }

    fn decide(&mut self, place: Vector2<f64>, yaw_rad: f64) -> Command {
        let (sideways, haste) = (self.sideways.step(), self.haste.step());
        let is_struck = self.stops.chance(self.step_s / self.manner.between_stops_s);
        let stop_s = self.stops.between(0.5, 2.0);
        if is_struck && self.stopped_s <= 0.0 {
            self.stopped_s = stop_s;
        }
        let bound_m = 2.0 * self.manner.wander_m;
        let target = self.looked_at(sideways.clamp(-bound_m, bound_m));
        let off_course_rad = wrapped(angle_of(target - place) - yaw_rad);
        // Half speed 30° off course, none from 60° on: a person turns on the spot before driving into a wall.
        let courage = (1.0 - off_course_rad.abs() / 60.0_f64.to_radians()).max(0.0);
        let mut forward_m_s = self.cruise_m_s * courage * (1.0 + haste).max(0.0);
        if self.stopped_s > 0.0 {
            self.stopped_s -= self.step_s;
            forward_m_s = 0.0;
        }
        let turn_rad_s = self.gain_per_s * off_course_rad;
        let most = self.manner.turn_rad_s_max;
        Command { forward_m_s, turn_rad_s: turn_rad_s.clamp(-most, most) }
    }

    /// The point of the route looked at, moved to the left.
    fn looked_at(&self, left_m: f64) -> Vector2<f64> {
        let (direction, _) = self.leg_direction();
        self.route[self.leg] + self.along_m * direction + left_m * left_of(direction)
    }

    fn leg_direction(&self) -> (Vector2<f64>, f64) {
        let leg = self.route[self.leg + 1] - self.route[self.leg];
        let length_m = leg.norm();
        (leg / length_m, length_m)
    }
}

#[cfg(test)]
mod tests {
    use super::super::drive::TICK_S;
    use super::super::odometry::advance;
    use super::*;

    const MANNER: Manner = Manner {
        cruise_m_s: 0.7,
        turn_rad_s_max: 1.5,
        lookahead_m: 0.6,
        wander_m: 0.1,
        between_stops_s: 20.0,
    };

    /// Poses and commands of a robot that does at once as it is told, on a route with a corner to the left.
    fn drive(manner: Manner, trip: u32) -> Vec<(Pose, Command)> {
        let route = vec![Vector2::zeros(), Vector2::new(8.0, 0.0), Vector2::new(8.0, 8.0)];
        let mut teleoperator = Teleoperator::new(route, manner, TICK_S, &Streams::new("corner", trip, 7));
        let mut pose = Pose::default();
        std::iter::from_fn(|| {
            let command = teleoperator.command(&pose)?;
            advance(&mut pose, command.forward_m_s * TICK_S, command.turn_rad_s * TICK_S);
            Some((pose, command))
        })
        .take(10_000)
        .collect()
    }

    #[test]
    fn a_driver_arrives_and_drives_no_faster_than_a_driver_can() {
        for trip in 0..20 {
            let driven = drive(MANNER, trip);
            let (end, _) = driven.last().unwrap();
            assert!((end.x_m - 8.0).hypot(end.y_m - 8.0) < ARRIVED_M, "trip {trip} ended at {end:?}");
            for (_, command) in driven {
                // The cruising speed of the hastiest driver, six standard deviations of haste above.
                assert!((0.0..0.7 * 1.1 * (1.0 + 6.0 * HASTE)).contains(&command.forward_m_s), "{command:?}");
                assert!(command.turn_rad_s.abs() <= 1.5, "{command:?}");
            }
        }
    }

    #[test]
    fn commands_never_jump() {
        // A hand goes a share of the way to its aim in each step, which is at most from one limit to the other.
        let share = 1.0 - libm::exp(-TICK_S / HAND_S);
        for pair in drive(MANNER, 1).windows(2) {
            let ((_, before), (_, after)) = (pair[0], pair[1]);
            assert!((after.turn_rad_s - before.turn_rad_s).abs() <= share * 3.0);
            assert!((after.forward_m_s - before.forward_m_s).abs() <= share * 1.4);
        }
    }

    #[test]
    fn speed_varies_drops_in_turns_and_is_nought_in_stops() {
        let driven = drive(MANNER, 2);
        let speeds = |is_in: fn(&Pose) -> bool| -> Vec<f64> {
            driven.iter().filter(|(pose, _)| is_in(pose)).map(|(_, command)| command.forward_m_s).collect()
        };
        let mean = |speeds: &[f64]| speeds.iter().sum::<f64>() / speeds.len() as f64;
        let straight = speeds(|pose| (2.0..6.0).contains(&pose.x_m));
        let corner = speeds(|pose| pose.x_m > 7.4 && pose.y_m < 0.6);
        assert!(mean(&corner) < 0.8 * mean(&straight), "{} and {} m/s", mean(&corner), mean(&straight));
        assert!(straight.iter().any(|speed| *speed < 0.95 * mean(&straight)));
        let stops_often = drive(Manner { between_stops_s: 5.0, ..MANNER }, 2);
        assert!(stops_often.iter().skip(100).any(|(_, command)| command.forward_m_s < 0.01));
    }

    #[test]
    fn a_driver_overshoots_a_corner_and_comes_back() {
        let steady = Manner { wander_m: 0.0, between_stops_s: 1e9, ..MANNER };
        for trip in 0..10 {
            let driven = drive(steady, trip);
            let most_m = driven.iter().map(|(pose, _)| pose.x_m - 8.0).fold(f64::NEG_INFINITY, f64::max);
            // Whoever answered at once would near the second leg from within and never cross it.
            assert!(most_m > 0.0 && most_m < 0.3, "trip {trip}: {most_m} m beyond the second leg");
            let (end, _) = driven.last().unwrap();
            assert!((end.x_m - 8.0).abs() < 0.05, "trip {trip} ended {} m beside the leg", end.x_m - 8.0);
        }
    }

    #[test]
    fn every_trip_has_its_own_driver() {
        let places = |trip| -> Vec<(f64, f64)> {
            drive(MANNER, trip).iter().map(|(pose, _)| (pose.x_m, pose.y_m)).collect()
        };
        assert_eq!(places(1), places(1));
        assert_ne!(places(1)[..200], places(2)[..200]);
    }
}
