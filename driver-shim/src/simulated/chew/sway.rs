//! How the camera leans: with the ground under the wheels, with every push, and over bumps.

use kinds_messages::{Command, Pose};
use nalgebra::Vector3;

use super::super::angle::{direction, left_of};
use super::super::random::{Streams, Wander};
use super::camera::View;
use super::ground::Ground;

/// Height of the camera over the ground.
pub(super) const CAMERA_HEIGHT_M: f64 = 0.6;
/// Half the distances between the outermost wheels, along and across.
const HALF_WHEELBASE_M: (f64, f64) = (0.40, 0.30);

/// Natural frequency of the body on its springs (1.4 Hz), and its damping as a share of the critical.
const SPRING_RAD_S: f64 = 8.8;
const DAMPING: f64 = 0.3;
/// Lean for each m/s² of the body's own acceleration.
const LEAN_RAD_PER_M_S2: f64 = 0.02;
/// Standard deviation of the lean that bumps ask for, at 1 m/s.
const BUMP_RAD: f64 = 0.015;

/// A body on springs.
pub(super) struct Sway {
    step_s: f64,
    pitch: Lean,
    roll: Lean,
    speed_m_s: f64,
}

/// A lean about one axis.
struct Lean {
    angle_rad: f64,
    rate_rad_s: f64,
    bumps: Wander,
}

impl Sway {
    /// At rest on level ground.
    pub(super) fn new(streams: &Streams, step_s: f64) -> Self {
        let lean = |source| Lean {
            angle_rad: 0.0,
            rate_rad_s: 0.0,
            bumps: Wander::new(streams.named(source), BUMP_RAD, 0.15, step_s),
        };
        Self { step_s, pitch: lean("bumps along"), roll: lean("bumps across"), speed_m_s: 0.0 }
    }

    /// Lets one step pass at a place, moving with `speed`.
    pub(super) fn advance(&mut self, pose: &Pose, speed: &Command, ground: &Ground) {
        let push_m_s2 = (speed.forward_m_s - self.speed_m_s) / self.step_s;
        self.speed_m_s = speed.forward_m_s;
        let inward_m_s2 = speed.forward_m_s * speed.turn_rad_s;
        let (pitch_rad, roll_rad) = terrain(pose, ground);
        // Speeding up lifts the nose, turning left lifts the left side.
        self.pitch.advance(pitch_rad - LEAN_RAD_PER_M_S2 * push_m_s2, self.speed_m_s, self.step_s);
        self.roll.advance(roll_rad + LEAN_RAD_PER_M_S2 * inward_m_s2, self.speed_m_s, self.step_s);
    }

    /// What the camera of a robot at `pose` sees.
    pub(super) fn view(&self, pose: &Pose, ground: &Ground) -> View {
        let height_m = ground.height_m(pose.x_m, pose.y_m) + CAMERA_HEIGHT_M;
        let eye = Vector3::new(pose.x_m, pose.y_m, height_m);
        View::new(eye, pose.yaw_rad, self.pitch.angle_rad, self.roll.angle_rad)
    }
}

impl Lean {
    /// Springs back towards where ground, push and bumps want it.
    fn advance(&mut self, wanted_rad: f64, speed_m_s: f64, step_s: f64) {
        let wanted_rad = wanted_rad + self.bumps.step() * speed_m_s;
        let pull = SPRING_RAD_S * SPRING_RAD_S * (wanted_rad - self.angle_rad)
            - 2.0 * DAMPING * SPRING_RAD_S * self.rate_rad_s;
        // The new rate moves the angle (Euler's method, semi-implicit): stable far beyond 20 ms steps.
        self.rate_rad_s += pull * step_s;
        self.angle_rad += self.rate_rad_s * step_s;
    }
}

/// Pitch (nose down) and roll (left side up) of the ground under the wheels.
fn terrain(pose: &Pose, ground: &Ground) -> (f64, f64) {
    let ahead = direction(pose.yaw_rad);
    let rise = |along: nalgebra::Vector2<f64>, half_m: f64| {
        let at = |share: f64| {
            ground.height_m(pose.x_m + share * along.x * half_m, pose.y_m + share * along.y * half_m)
        };
        libm::atan((at(1.0) - at(-1.0)) / (2.0 * half_m))
    };
    (-rise(ahead, HALF_WHEELBASE_M.0), rise(left_of(ahead), HALF_WHEELBASE_M.1))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::simulated::chew::material::Material;

    const STEP_S: f64 = 0.02;

    /// The camera after 20 s at one place, as if moving with `speed`.
    fn settled(ground: &Ground, yaw_rad: f64, speed: Command) -> View {
        let mut sway = Sway::new(&Streams::new("sway", 0, 1), STEP_S);
        let pose = Pose { x_m: 0.0, y_m: 0.0, yaw_rad };
        for _ in 0..1000 {
            sway.advance(&pose, &speed, ground);
        }
        sway.view(&pose, ground)
    }

    #[test]
    fn a_robot_at_rest_looks_along_the_ground_whichever_way_it_faces() {
        let slope =
            Ground::new((-9.0, -9.0), (18.0, 18.0), 1.0, |x, y| 0.1 * x + 0.05 * y, |_, _| Material::Grass);
        let normal = slope.normal(0.0, 0.0);
        for yaw_rad in [0.0, 1.0, 2.0, -2.5] {
            let view = settled(&slope, yaw_rad, Command::default());
            // Pitch and roll are measured one by one: their order is worth the product of both, 0.1 × 0.1.
            let forward = view.world_from_camera.column(0).dot(&normal);
            assert!(forward.abs() < 1e-9, "{forward}");
            assert!(view.world_from_camera.column(2).dot(&normal) > 1.0 - 0.01);
            assert!((view.eye.z - CAMERA_HEIGHT_M).abs() < 1e-12);
        }
    }

    #[test]
    fn a_left_turn_lifts_the_left_side_on_average() {
        let ground = Ground::level();
        let mut sway = Sway::new(&Streams::new("sway", 0, 1), STEP_S);
        let speed = Command { forward_m_s: 1.0, turn_rad_s: 0.5 };
        let n = 10_000;
        let mut total = 0.0;
        for _ in 0..n {
            sway.advance(&Pose::default(), &speed, &ground);
            total += sway.roll.angle_rad;
        }
        // 200 s of bumps that last 0.15 s leave a mean of BUMP_RAD √(2 · 0.15 / 200) = 0.0006 rad; four of these.
        assert!((total / f64::from(n) - 0.5 * LEAN_RAD_PER_M_S2).abs() < 0.0024);
    }

    #[test]
    fn pushing_off_lifts_the_nose() {
        let mut sway = Sway::new(&Streams::new("sway", 0, 1), STEP_S);
        for step in 1..=10 {
            let speed = Command { forward_m_s: 0.1 * f64::from(step), turn_rad_s: 0.0 };
            sway.advance(&Pose::default(), &speed, &Ground::level());
        }
        assert!(sway.view(&Pose::default(), &Ground::level()).world_from_camera[(2, 0)] > 0.01);
    }
}
