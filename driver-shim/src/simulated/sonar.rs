//! A sonar: the nearest audible echo in a cone.
//!
//! Walls are mirrors for ultrasound. An echo is loud where sound meets a wall square, and at a slant only its small
//! rough part returns, which is heard from near; the rest goes on, and may come back from a second or third wall, as
//! if from too far, or out of a corner of two walls, straight back to the sensor. What no echo betrays reads as the
//! largest range.

use super::angle::{direction, turned};
use super::random::Random;
use super::world::{Ray, World};

/// Least range: until then the transducer still rings, and anything nearer reads as this.
pub(crate) const RANGE_M_MIN: f64 = 0.15;
/// Largest range, which also stands for no return.
pub(crate) const RANGE_M_MAX: f64 = 6.0;

/// Half the opening of the cone.
const HALF_CONE_RAD: f64 = 12.0 * std::f64::consts::PI / 180.0;
/// Rays in the cone; odd, so that one is the axis.
const N_RAYS: u32 = 9;
/// Angle at which the beam has fallen to 1/e.
const BEAM_RAD: f64 = 10.0 * std::f64::consts::PI / 180.0;
/// Sine of the slant at which a wall's mirrored echo has fallen to 1/e.
const LOBE_SIN: f64 = 0.26;
/// Share of sound that a wall scatters everywhere.
const ROUGH: f64 = 0.05;
/// Least loudness to be heard. A wall of plaster, square, at 1 m gives 0.95; loudness falls with the square of the range.
const HEARD: f64 = 0.02;
/// Walls that sound meets before it is lost.
const N_BOUNCES: usize = 3;
/// Radius of the transducer, which has to be met by what comes out of a corner.
const TRANSDUCER_M: f64 = 0.06;

/// Standard deviation of a range: at 0 m, and its growth per metre.
const NOISE_M: f64 = 0.003;
const NOISE_PER_M: f64 = 0.002;
/// Standard deviation of the logarithm of the least loudness, from one firing to the next.
const HEARING_NOISE: f64 = 0.15;
/// Share of readings that the electronics lose.
const DROP_OUTS: f64 = 0.003;

/// One sonar.
pub(crate) struct Sonar {
    /// None for a sonar without noise.
    random: Option<Random>,
}

/// What happened to one firing.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) enum Echo {
    /// The reading was lost.
    Lost,
    /// Nothing was heard.
    None,
    /// From so far, metres.
    At(f64),
}

impl Sonar {
    pub(crate) fn new(random: Option<Random>) -> Self {
        Self { random }
    }

    /// Fires along an axis and listens.
    pub(crate) fn fire(&mut self, world: &World, axis: &Ray) -> Echo {
        let Some(random) = &mut self.random else {
            return nearest_echo_m(world, axis, HEARD).map_or(Echo::None, Echo::At);
        };
        // Always the same number of draws, whatever happens.
        let is_lost = random.chance(DROP_OUTS);
        let heard = HEARD * libm::exp(HEARING_NOISE * random.normal());
        let error = random.normal();
        if is_lost {
            return Echo::Lost;
        }
        let noisy_m = |range_m: f64| range_m + error * (NOISE_M + NOISE_PER_M * range_m);
        nearest_echo_m(world, axis, heard).map_or(Echo::None, |range_m| Echo::At(noisy_m(range_m)))
    }

    /// Whether this firing takes another sonar's echo for its own, with a probability where it comes before its own.
    pub(crate) fn is_fooled(&mut self, probability: f64) -> bool {
        self.random.as_mut().is_some_and(|random| random.chance(probability))
    }
}

/// The reading of an echo, metres; `None` where it was lost.
pub(crate) fn reading_m(echo: Echo) -> Option<f64> {
    match echo {
        Echo::Lost => None,
        Echo::None => Some(RANGE_M_MAX),
        Echo::At(range_m) => Some(range_m.clamp(RANGE_M_MIN, RANGE_M_MAX)),
    }
}

fn nearest_echo_m(world: &World, axis: &Ray, heard: f64) -> Option<f64> {
    let middle = f64::from(N_RAYS / 2);
    let echoes = (0..N_RAYS).filter_map(|ray| {
        let off_axis_rad = HALF_CONE_RAD * (f64::from(ray) - middle) / middle;
        let beam = libm::exp(-(off_axis_rad / BEAM_RAD) * (off_axis_rad / BEAM_RAD));
        let ray = Ray { direction: turned(axis.direction, direction(off_axis_rad)), ..*axis };
        follow(world, ray, beam, heard)
    });
    echoes.reduce(f64::min)
}

/// Follows one ray from wall to wall; the range of its first audible echo.
fn follow(world: &World, fired: Ray, beam: f64, heard: f64) -> Option<f64> {
    let (mut ray, mut way_m, mut loudness) = (fired, 0.0, beam);
    for bounce in 0..N_BOUNCES {
        if bounce == 2
            && let Some(range_m) = returns_from_corner_m(&fired, &ray, way_m)
            && loudness / (range_m * range_m) > heard
        {
            return Some(range_m);
        }
        let hit = world.cast(&ray, RANGE_M_MAX - way_m)?;
        way_m += hit.range_m;
        loudness *= hit.surface.acoustic;
        let cos = hit.cos_incidence(&ray);
        let lobe = libm::exp(-(1.0 - cos * cos) / (LOBE_SIN * LOBE_SIN));
        if loudness * lobe.max(ROUGH) / (way_m * way_m) > heard {
            return Some(way_m);
        }
        let mirrored = ray.direction + 2.0 * cos * hit.normal;
        // Off the wall by more than rounding, or the next ray would meet it again.
        ray = Ray { origin: ray.at(hit.range_m) + 1e-6 * hit.normal, direction: mirrored };
    }
    None
}

/// The range of sound that comes back from its second wall straight to the transducer: half of its way.
fn returns_from_corner_m(fired: &Ray, last: &Ray, way_m: f64) -> Option<f64> {
    let back = fired.origin - last.origin;
    let back_m = back.dot(&last.direction);
    let misses_m = back.perp(&last.direction).abs();
    let is_parallel = last.direction.dot(&fired.direction) < -0.99;
    (is_parallel && back_m > 0.0 && misses_m < TRANSDUCER_M).then_some(0.5 * (way_m + back_m))
}

#[cfg(test)]
mod tests {
    use nalgebra::Vector2;

    use super::super::random::Streams;
    use super::super::world::{Surface, Wall};
    use super::*;

    fn wall(from: (f64, f64), to: (f64, f64), surface: Surface) -> Wall {
        Wall { from: Vector2::new(from.0, from.1), to: Vector2::new(to.0, to.1), surface }
    }

    /// What a sonar without noise at the origin hears along an angle.
    fn fire(walls: &[Wall], degrees: f64) -> Echo {
        let axis = Ray { origin: Vector2::zeros(), direction: direction(degrees.to_radians()) };
        Sonar::new(None).fire(&World::new(walls.to_vec()), &axis)
    }

    fn check(walls: &[Wall], degrees: f64, expected_m: f64, tolerance_m: f64) {
        let Echo::At(range_m) = fire(walls, degrees) else { panic!("no echo at {degrees}°") };
        assert!((range_m - expected_m).abs() <= tolerance_m, "{degrees}°: {range_m} m, not {expected_m} m");
    }

    #[test]
    fn a_wall_across_the_cone_reads_its_distance() {
        for distance_m in [0.2, 1.0, 2.0, 5.9] {
            check(&[wall((distance_m, -9.0), (distance_m, 9.0), Surface::PLASTER)], 0.0, distance_m, 1e-12);
        }
    }

    #[test]
    fn a_slanted_wall_reads_its_nearest_point_in_the_cone() {
        let walls = [wall((2.0, -9.0), (2.0, 9.0), Surface::PLASTER)];
        check(&walls, 9.0, 2.0, 1e-12);
        // Square is outside the cone: the ray nearest to it is heard, 8° off.
        check(&walls, 20.0, 2.0 / 8.0_f64.to_radians().cos(), 1e-12);
    }

    #[test]
    fn a_grazed_wall_is_heard_from_near_and_not_from_far() {
        let at = |distance_m| [wall((distance_m, -9.0), (distance_m, 9.0), Surface::PLASTER)];
        assert_eq!(fire(&at(2.0), 50.0), Echo::None);
        // Loudest and nearest of the audible rays: the rough share 0.0475 / r² is above 0.02 up to 1.54 m on the axis.
        assert!(
            matches!(fire(&at(0.4), 50.0), Echo::At(range_m) if range_m < 0.4 / 50.0_f64.to_radians().cos())
        );
    }

    #[test]
    fn a_corner_of_two_walls_sends_sound_straight_back() {
        let corner = [
            wall((2.0, -9.0), (2.0, 2.0), Surface::PLASTER),
            wall((-9.0, 2.0), (2.0, 2.0), Surface::PLASTER),
        ];
        check(&corner, 45.0, 2.0 * 2.0_f64.sqrt(), 0.01);
        // Without the second wall nothing comes back.
        assert_eq!(fire(&corner[..1], 45.0), Echo::None);
    }

    #[test]
    fn sound_off_a_slanted_mirror_reads_too_far() {
        let walls = [
            wall((1.0, -1.0), (3.0, 1.0), Surface::PLASTER),
            wall((1.0, -0.9), (3.0, -0.9), Surface::PLASTER),
            wall((-1.0, 3.0), (5.0, 3.0), Surface::PLASTER),
        ];
        // 2 m to the mirror at 45°, then 3 m up to the wall that it meets square.
        check(&walls, 0.0, 5.0, 0.15);
    }

    #[test]
    fn soft_surfaces_are_lost_sooner_than_hard_ones() {
        let at =
            |distance_m: f64, surface| fire(&[wall((distance_m, -9.0), (distance_m, 9.0), surface)], 0.0);
        // √(0.40 / 0.02) = 4.47 m.
        assert!(matches!(at(4.4, Surface::FABRIC), Echo::At(_)));
        assert_eq!(at(4.6, Surface::FABRIC), Echo::None);
        assert!(matches!(at(4.6, Surface::PLASTER), Echo::At(_)));
    }

    #[test]
    fn readings_are_the_echo_within_limits() {
        for (echo, expected_m) in [
            (Echo::Lost, None),
            (Echo::None, Some(6.0)),
            (Echo::At(0.03), Some(0.15)),
            (Echo::At(2.5), Some(2.5)),
            (Echo::At(6.01), Some(6.0)),
        ] {
            assert_eq!(reading_m(echo), expected_m);
        }
    }

    #[test]
    fn drop_outs_come_at_their_share() {
        let world = World::new(vec![wall((2.0, -9.0), (2.0, 9.0), Surface::PLASTER)]);
        let axis = Ray { origin: Vector2::zeros(), direction: Vector2::new(1.0, 0.0) };
        let mut sonar = Sonar::new(Some(Streams::new("wall", 1, 7).named("sonar")));
        let n = 20_000;
        let n_lost = (0..n).filter(|_| sonar.fire(&world, &axis) == Echo::Lost).count() as f64;
        // Five standard errors of a binomial.
        let expected = f64::from(n) * DROP_OUTS;
        assert!((n_lost - expected).abs() < 5.0 * expected.sqrt(), "{n_lost} of {n}");
    }
}
