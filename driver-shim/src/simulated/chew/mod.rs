//! Chew: a six-wheeled robot with a time-of-flight camera, driven about a campus.
//!
//! The camera gives 160 × 124 depths five times a second, in millimetres along its optical axis (what ROS means by a
//! depth image), of what is up to 7.5 m away along a pixel's ray. Farther surfaces that are bright enough look nearer
//! by whole multiples of 7.5 m, dark and sunlit ones are not measured: 0. The camera is made up after the SwissRanger
//! SR-3000; its field of view is 47° × 39°, 0.6 m above the ground.
//!
//! ```text
//! drive ─┬─ pose ─▶ sway (lean) ─▶ view ─┐
//!        └─ place ─▶ traffic (makes way) ─┴─▶ picture (surfaces) ─▶ time of flight ─▶ counts
//! campus (what stays) ───────────────────────▲
//! ```
//!
//! The campus is the same for all trips and seeds. A trip differs in how it is driven, in parked and passing cars, in
//! people and boards, in sun and noise.
//!
//! A frame costs 19840 rays times the few bodies that each can touch. Nothing is allocated after the first frames.

mod camera;
mod campus;
mod ground;
mod material;
mod picture;
mod pixel_noise;
mod solid;
mod sway;
#[cfg(test)]
mod tests;
mod time_of_flight;
mod traffic;

use kinds_trips::{FrameLayout, Stamp};
use nalgebra::{Vector2, Vector3};

use self::camera::{Camera, N_COLUMNS, N_PIXELS, N_ROWS, View};
use self::campus::Campus;
use self::picture::Picture;
use self::sway::Sway;
use self::time_of_flight::{Characteristics, METRES_PER_COUNT, RANGE_M_MAX, Sun, TimeOfFlight};
use self::traffic::Traffic;
use super::drive::{Drive, Motion, TICK_S};
use super::odometry::Wheels;
use super::random::{Random, Streams, Wander};
use super::teleoperator::Manner;
use super::{Moment, Robot, first_stamp};

/// Frames are 0.2 s apart.
const TICKS_PER_FRAME: u32 = 10;
const FRAME_S: f64 = TICK_S * TICKS_PER_FRAME as f64;
const FRAME_NS: i64 = 200_000_000;

/// A walking pace over grass, by somebody who walks behind.
const MANNER: Manner =
    Manner { cruise_m_s: 1.15, turn_rad_s_max: 0.9, lookahead_m: 1.3, wander_m: 0.15, between_stops_s: 45.0 };

/// Six wheels of which four skid whenever the robot turns.
const WHEELS: Wheels = Wheels {
    track_m: 0.6,
    tick_m: 0.002,
    size_error_max: 0.02,
    difference_max: 0.001,
    slip_per_root_m: 0.003,
};

/// Which camera it is: its dead pixels.
const CAMERA_SEED: u64 = 3000;
/// Sunlight from a white surface that faces a sun without clouds.
const SUN_LIGHT_MAX: f64 = 0.05;

/// The simulated robot Chew on one trip over the campus: about three minutes, five frames a second.
///
/// Everything follows from trip and seed, bit for bit on every machine.
pub struct Chew {
    campus: Campus,
    course: Course,
    picture: Picture,
    time_of_flight: TimeOfFlight,
}

/// The trip without its pictures.
struct Course {
    first: Stamp,
    n_frames: u32,
    drive: Drive,
    sway: Sway,
    traffic: Traffic,
    sun: Sun,
    clear_light: f64,
    clouds: Wander,
}

impl Chew {
    /// Chew at the start of trip `trip`.
    pub fn new(trip: u32, seed: u64) -> Self {
        let streams = Streams::new("chew", trip, seed);
        let campus = Campus::new();
        let course = Course::new(trip, &streams, &campus);
        // 2⁵³ cameras are enough.
        let noise_seed = (streams.named("camera").uniform() * (1_u64 << 53) as f64) as u64;
        Self {
            campus,
            course,
            picture: Picture::new(Camera::new(), RANGE_M_MAX),
            time_of_flight: TimeOfFlight::new(Characteristics::SWISS_RANGER, CAMERA_SEED, noise_seed),
        }
    }
}

impl Robot for Chew {
    fn layout(&self) -> FrameLayout {
        FrameLayout { rows: N_ROWS as u32, columns: N_COLUMNS as u32, metres_per_count: METRES_PER_COUNT }
    }

    /// * `counts` — `(19840,)`, row by row from the top left; all are written
    fn step(&mut self, counts: &mut [u16]) -> Option<Moment> {
        assert_eq!(counts.len(), N_PIXELS, "a frame of Chew's camera has 124 rows of 160 pixels");
        let frame_index = u64::from(self.course.n_frames);
        let (moment, view) = self.course.advance(&self.campus)?;
        let solids = self.campus.solids.iter().chain(self.course.traffic.solids());
        self.picture.draw(&view, solids, &self.campus.ground);
        self.time_of_flight.measure(&self.picture, &self.course.sun, frame_index, counts);
        Some(moment)
    }
}

impl Course {
    fn new(trip: u32, streams: &Streams, campus: &Campus) -> Self {
        let mut weather = streams.named("weather");
        let direction = sun_direction(&mut weather);
        let clear_light = SUN_LIGHT_MAX * weather.uniform();
        Self {
            first: first_stamp(trip),
            n_frames: 0,
            drive: Drive::new(campus::route(), MANNER, WHEELS, streams),
            sway: Sway::new(streams, TICK_S),
            traffic: Traffic::new(streams, &campus.ground),
            sun: Sun { direction, light: clear_light },
            clear_light,
            clouds: Wander::new(streams.named("clouds"), 0.4, 20.0, FRAME_S),
        }
    }

    /// The next frame's moment, and what the camera sees then; `None` at the end of the route.
    fn advance(&mut self, campus: &Campus) -> Option<(Moment, View)> {
        let mut motion = None;
        for _ in 0..TICKS_PER_FRAME {
            let Motion { true_pose, speed, .. } = *motion.insert(self.drive.advance(1)?);
            self.sway.advance(&true_pose, &speed, &campus.ground);
        }
        let Motion { true_pose, odometry, command, .. } = motion?;
        self.traffic.advance(FRAME_S, Vector2::new(true_pose.x_m, true_pose.y_m), &campus.ground);
        self.sun.light = self.clear_light * (1.0 - self.clouds.step().abs()).max(0.0);
        let captured = Stamp(self.first.0 + i64::from(self.n_frames) * FRAME_NS);
        self.n_frames += 1;
        let view = self.sway.view(&true_pose, &campus.ground);
        Some((Moment { captured, odometry, true_pose, command }, view))
    }
}

/// From the ground to the sun: a day between autumn and spring, 42° north.
fn sun_direction(weather: &mut Random) -> Vector3<f64> {
    let elevation_rad = weather.between(20.0_f64, 50.0).to_radians();
    // Counter-clockwise from east: from south-east by south to south-west.
    let azimuth_rad = weather.between(-135.0_f64, -45.0).to_radians();
    let ((sin_e, cos_e), (sin_a, cos_a)) = (libm::sincos(elevation_rad), libm::sincos(azimuth_rad));
    Vector3::new(cos_e * cos_a, cos_e * sin_a, sin_e)
}
