//! Crunch: a small round robot with two rings of range sensors, driven through an office building.
//!
//! | readings | sensors | bearings, counter-clockwise from ahead | range |
//! |---|---|---|---|
//! | 0–7, row 0 | sonars | 0°, 45°, 90°, … | 0.15–6 m |
//! | 8–15, row 1 | infrared | 22.5°, 67.5°, 112.5°, … | 0.1–0.8 m |
//!
//! A frame every 100 ms, in counts of 1 mm from the sensor's face: 0 is a lost reading, and a sensor's largest range
//! stands for no return.

use kinds_messages::Pose;
use kinds_trips::{FrameLayout, Stamp};
use nalgebra::Vector2;

use super::angle::{direction, turned};
use super::drive::{Drive, TICK_S};
use super::floors::Floor;
use super::infrared::Infrared;
use super::odometry::Wheels;
use super::random::{Random, Streams};
use super::sonar::{Echo, Sonar, reading_m};
use super::teleoperator::Manner;
use super::world::{Ray, World};
use super::{Moment, Robot, first_stamp};

/// Crunch on one trip over one floor.
pub struct Crunch {
    world: World,
    drive: Drive,
    rings: Rings,
    captured: Stamp,
}

const METRES_PER_COUNT: f64 = 0.001;
const FRAME_TICKS: u32 = 5;
const FRAME_NS: i64 = (TICK_S * 1e9) as i64 * FRAME_TICKS as i64;

/// The robot is a cylinder; its sensors sit on its side.
const RADIUS_M: f64 = 0.15;

const MANNER: Manner =
    Manner { cruise_m_s: 0.7, turn_rad_s_max: 1.5, lookahead_m: 0.6, wander_m: 0.09, between_stops_s: 30.0 };

const WHEELS: Wheels = Wheels {
    track_m: 0.25,
    tick_m: 0.0005,
    size_error_max: 0.005,
    difference_max: 0.0001,
    slip_per_root_m: 0.0008,
};

impl Crunch {
    /// Crunch at the start of a trip.
    ///
    /// Trips over one floor with one seed share its plan and route; what stands open or in the way, the driver, the
    /// wheels and every sensor's noise are those of the trip.
    pub fn new(floor: Floor, trip: u32, seed: u64) -> Self {
        let streams = Streams::new(floor.name(), trip, seed);
        let (walls, route) = floor.on_trip(&streams);
        Self {
            world: World::new(walls),
            drive: Drive::new(route, MANNER, WHEELS, &streams),
            rings: Rings::new(Some(&streams)),
            captured: first_stamp(trip),
        }
    }
}

impl Robot for Crunch {
    fn layout(&self) -> FrameLayout {
        FrameLayout { rows: 2, columns: N_PER_RING as u32, metres_per_count: METRES_PER_COUNT }
    }

    fn step(&mut self, counts: &mut [u16]) -> Option<Moment> {
        let motion = self.drive.advance(FRAME_TICKS)?;
        let captured = self.captured;
        self.captured = Stamp(captured.0.saturating_add(FRAME_NS));
        self.rings.read(&self.world, &motion.true_pose, counts);
        Some(Moment {
            captured,
            odometry: motion.odometry,
            true_pose: motion.true_pose,
            command: motion.command,
        })
    }
}

const N_PER_RING: usize = 8;

/// Probability that a sonar takes the echo of one that fires at the same time for its own, where it comes first.
const CROSS_TALK: f64 = 0.01;

/// The two rings of sensors.
struct Rings {
    sonars: [Sonar; N_PER_RING],
    infrared: [Infrared; N_PER_RING],
}

impl Rings {
    /// Sensors with the noise of these streams, or without.
    fn new(streams: Option<&Streams>) -> Self {
        let random =
            |source, index| -> Option<Random> { streams.map(|streams| streams.numbered(source, index)) };
        Self {
            sonars: std::array::from_fn(|index| Sonar::new(random("sonar", index))),
            infrared: std::array::from_fn(|index| Infrared::new(random("infrared", index))),
        }
    }

    /// Reads all sensors of a robot at a place.
    ///
    /// * `counts` — `(16,)`; all are written
    fn read(&mut self, world: &World, pose: &Pose, counts: &mut [u16]) {
        let bearing_rad = |eighths: f64| eighths * std::f64::consts::FRAC_PI_4;
        let mut echoes = [Echo::None; N_PER_RING];
        for (index, sonar) in self.sonars.iter_mut().enumerate() {
            echoes[index] = sonar.fire(world, &sensor_ray(pose, bearing_rad(index as f64)));
        }
        let (sonar_counts, infrared_counts) = counts.split_at_mut(N_PER_RING);
        for (index, reading) in sonar_counts.iter_mut().enumerate() {
            *reading = count(reading_m(self.heard(index, &echoes)));
        }
        for (index, infrared) in self.infrared.iter_mut().enumerate() {
            let ray = sensor_ray(pose, bearing_rad(index as f64 + 0.5));
            infrared_counts[index] = count(infrared.range_m(world, &ray));
        }
    }

    /// What a sonar takes for its own echo. The even ones fire together, then the odd ones: a quarter turn to either
    /// side another one fires, whose echo may come first.
    fn heard(&mut self, index: usize, echoes: &[Echo; N_PER_RING]) -> Echo {
        let is_fooled = self.sonars[index].is_fooled(CROSS_TALK);
        let range_m = |echo| match echo {
            Echo::At(range_m) => range_m,
            Echo::None => f64::INFINITY,
            Echo::Lost => f64::NAN,
        };
        let others = [2, N_PER_RING - 2].map(|apart| echoes[(index + apart) % N_PER_RING]);
        let first = others.into_iter().find(|&other| range_m(other) < range_m(echoes[index]));
        first.filter(|_| is_fooled).unwrap_or(echoes[index])
    }
}

/// From a sensor's face outwards.
fn sensor_ray(pose: &Pose, bearing_rad: f64) -> Ray {
    let outwards = turned(direction(bearing_rad), direction(pose.yaw_rad));
    Ray { origin: Vector2::new(pose.x_m, pose.y_m) + RADIUS_M * outwards, direction: outwards }
}

/// The count of a reading; 0 for a lost one.
fn count(range_m: Option<f64>) -> u16 {
    range_m.map_or(0, |range_m| (range_m / METRES_PER_COUNT).round() as u16)
}

#[cfg(test)]
mod tests;
