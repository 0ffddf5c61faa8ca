//! An infrared triangulation sensor: short range, and what it reads depends on the surface.
//!
//! It sends a narrow beam and finds where the light comes back from by the angle. Dark, shiny and grazing surfaces
//! return little light, so the reading grows noisy, or nothing returns; noise grows with the square of the range, as
//! the angle changes ever less. A beam across an edge reads between the two surfaces. Nearer than its least range the
//! light leaves the detector on the other side, and readings grow again.

use super::angle::{direction, turned};
use super::random::Random;
use super::world::{Ray, World};

/// Least range, below which readings fold back.
pub(crate) const RANGE_M_MIN: f64 = 0.1;
/// Largest range, which also stands for no return.
pub(crate) const RANGE_M_MAX: f64 = 0.8;

/// Half the width of the beam.
const HALF_BEAM_RAD: f64 = 0.04;
/// Least light to find a place by; white plaster, square, at 1 m gives 0.8.
const LIGHT_MIN: f64 = 0.15;
/// Standard deviation at 1 m with light 1, metres. Falls with the root of the light.
const NOISE_M: f64 = 0.012;
/// Share of readings that the electronics lose.
const DROP_OUTS: f64 = 0.002;

/// One sensor.
pub(crate) struct Infrared {
    /// None for a sensor without noise.
    random: Option<Random>,
}

impl Infrared {
    pub(crate) fn new(random: Option<Random>) -> Self {
        Self { random }
    }

    /// Measures along a ray, metres; `None` where the reading is lost. [`RANGE_M_MAX`] stands for no return.
    pub(crate) fn range_m(&mut self, world: &World, ray: &Ray) -> Option<f64> {
        let found = look(world, ray);
        let (is_lost, error) = match &mut self.random {
            None => (false, 0.0),
            Some(random) => (random.chance(DROP_OUTS), random.normal()),
        };
        if is_lost {
            return None;
        }
        let Some(Light { range_m, light }) = found else { return Some(RANGE_M_MAX) };
        let folded_m = if range_m < RANGE_M_MIN { 2.0 * RANGE_M_MIN - range_m } else { range_m };
        let deviation_m = NOISE_M * range_m / light.sqrt();
        Some((folded_m + error * deviation_m).clamp(RANGE_M_MIN, RANGE_M_MAX))
    }
}

/// Light that came back, and the range that its angle tells.
struct Light {
    range_m: f64,
    light: f64,
}

/// The mean range over the beam, weighted by light; `None` where too little returns.
fn look(world: &World, ray: &Ray) -> Option<Light> {
    let (mut light, mut light_m) = (0.0, 0.0);
    for (share, off_axis_rad) in [(0.25, -HALF_BEAM_RAD), (0.5, 0.0), (0.25, HALF_BEAM_RAD)] {
        let beam = Ray { direction: turned(ray.direction, direction(off_axis_rad)), ..*ray };
        // A surface just beyond the range may still draw the mean of a beam across an edge.
        let Some(hit) = world.cast(&beam, 1.5 * RANGE_M_MAX) else { continue };
        // Along the axis, so that a wall across the beam reads its distance.
        let range_m = hit.range_m * beam.direction.dot(&ray.direction);
        // Nearer than the least range the light no longer grows: the lens sees less of the spot.
        let spread_m = range_m.max(RANGE_M_MIN);
        let back = share * hit.surface.infrared * hit.cos_incidence(&beam) / (spread_m * spread_m);
        light += back;
        light_m += back * range_m;
    }
    (light >= LIGHT_MIN && light_m < light * RANGE_M_MAX).then(|| Light { range_m: light_m / light, light })
}

#[cfg(test)]
mod tests {
    use nalgebra::Vector2;

    use super::super::random::Streams;
    use super::super::world::{Surface, Wall};
    use super::*;

    /// A wall across the x axis from −5 m to `top_m`.
    fn wall(x_m: f64, top_m: f64, surface: Surface) -> Wall {
        Wall { from: Vector2::new(x_m, -5.0), to: Vector2::new(x_m, top_m), surface }
    }

    fn ahead() -> Ray {
        Ray { origin: Vector2::zeros(), direction: Vector2::new(1.0, 0.0) }
    }

    fn quiet(walls: Vec<Wall>) -> f64 {
        Infrared::new(None).range_m(&World::new(walls), &ahead()).unwrap()
    }

    #[test]
    fn a_wall_within_range_reads_its_distance_on_every_surface_but_glass_and_none_beyond() {
        for surface in [Surface::PLASTER, Surface::BRICK, Surface::WOOD, Surface::METAL, Surface::FABRIC] {
            for (distance_m, expected_m) in [(0.1, 0.1), (0.3, 0.3), (0.79, 0.79), (0.81, 0.8), (3.0, 0.8)] {
                let range_m = quiet(vec![wall(distance_m, 5.0, surface)]);
                assert!((range_m - expected_m).abs() < 1e-12, "{surface:?} at {distance_m} m: {range_m}");
            }
        }
        // 0.06 / 0.15 = 0.63² m².
        assert!((quiet(vec![wall(0.62, 5.0, Surface::GLASS)]) - 0.62).abs() < 1e-12);
        assert_eq!(quiet(vec![wall(0.64, 5.0, Surface::GLASS)]), RANGE_M_MAX);
    }

    #[test]
    fn readings_fold_back_below_the_least_range() {
        assert!((quiet(vec![wall(0.04, 5.0, Surface::PLASTER)]) - 0.16).abs() < 1e-12);
    }

    #[test]
    fn a_beam_across_an_edge_reads_between_the_two_surfaces() {
        let edge = vec![wall(0.4, 0.0, Surface::PLASTER), wall(0.6, 5.0, Surface::PLASTER)];
        let range_m = quiet(edge);
        assert!((0.41..0.59).contains(&range_m), "{range_m}");
    }

    #[test]
    fn noise_grows_with_range_and_as_the_surface_darkens() {
        let deviation_m = |distance_m, surface| {
            let world = World::new(vec![wall(distance_m, 5.0, surface)]);
            let mut infrared = Infrared::new(Some(Streams::new("wall", 1, 7).named("infrared")));
            let squares: Vec<f64> = (0..4000)
                .filter_map(|_| infrared.range_m(&world, &ahead()))
                .map(|range_m| (range_m - distance_m).powi(2))
                .collect();
            (squares.iter().sum::<f64>() / squares.len() as f64).sqrt()
        };
        let (near_m, far_m) = (deviation_m(0.2, Surface::PLASTER), deviation_m(0.4, Surface::PLASTER));
        // By the square of the range; a deviation from 4000 readings is within 5.6 % (five standard errors).
        assert!((far_m / near_m / 4.0 - 1.0).abs() < 0.12, "{near_m} m, {far_m} m");
        let dark_m = deviation_m(0.4, Surface::FABRIC);
        assert!((dark_m / far_m / (0.8_f64 / 0.25).sqrt() - 1.0).abs() < 0.12, "{dark_m} m, {far_m} m");
    }
}
