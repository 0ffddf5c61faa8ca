//! A robot on wheels under its driver: from a route to poses, commands and odometry.

use kinds_messages::{Command, Pose};
use nalgebra::Vector2;

use super::angle::{angle_of, left_of};
use super::odometry::{Odometry, Wheels, advance};
use super::random::Streams;
use super::teleoperator::{Manner, Teleoperator};

/// Time step of driver and wheels.
pub(crate) const TICK_S: f64 = 0.02;

/// Time in which the motors go 63 % of the way to a command.
const MOTOR_S: f64 = 0.1;

/// A robot on its way.
pub(crate) struct Drive {
    teleoperator: Teleoperator,
    odometry: Odometry,
    motion: Motion,
}

/// Where a robot is and what moves it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Motion {
    pub(crate) true_pose: Pose,
    pub(crate) odometry: Pose,
    pub(crate) command: Command,
    /// What the motors make of the command.
    pub(crate) speed: Command,
}

impl Drive {
    /// Puts a robot at the start of a route, facing along it, as exactly as a person does: within 5 cm and 3°. The
    /// robot believes that it stands exactly there.
    pub(crate) fn new(route: Vec<Vector2<f64>>, manner: Manner, wheels: Wheels, streams: &Streams) -> Self {
        let (start, ahead) = (route[0], (route[1] - route[0]).normalize());
        let mut placing = streams.named("placing");
        let mut off = |most: f64| placing.between(-most, most);
        let place = start + off(0.05) * ahead + off(0.05) * left_of(ahead);
        let believed = Pose { x_m: start.x, y_m: start.y, yaw_rad: angle_of(ahead) };
        let true_pose =
            Pose { x_m: place.x, y_m: place.y, yaw_rad: believed.yaw_rad + off(3.0_f64.to_radians()) };
        let still = Command::default();
        Self {
            teleoperator: Teleoperator::new(route, manner, TICK_S, streams),
            odometry: Odometry::new(believed, wheels, streams),
            motion: Motion { true_pose, odometry: believed, command: still, speed: still },
        }
    }

    /// Drives for some ticks; `None` once the route has ended.
    pub(crate) fn advance(&mut self, n_ticks: u32) -> Option<Motion> {
        let share = 1.0 - libm::exp(-TICK_S / MOTOR_S);
        for _ in 0..n_ticks {
            let motion = &mut self.motion;
            motion.command = self.teleoperator.command(&motion.true_pose)?;
            motion.speed.forward_m_s += share * (motion.command.forward_m_s - motion.speed.forward_m_s);
            motion.speed.turn_rad_s += share * (motion.command.turn_rad_s - motion.speed.turn_rad_s);
            let (forward_m, turn_rad) = (motion.speed.forward_m_s * TICK_S, motion.speed.turn_rad_s * TICK_S);
            advance(&mut motion.true_pose, forward_m, turn_rad);
            motion.odometry = self.odometry.update(forward_m, turn_rad);
        }
        Some(self.motion)
    }
}
