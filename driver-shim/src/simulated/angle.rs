//! Directions and angles with the same bits on every machine.

use std::f64::consts::{PI, TAU};

use nalgebra::Vector2;

/// The unit vector at an angle.
pub(crate) fn direction(angle_rad: f64) -> Vector2<f64> {
    let (sin, cos) = libm::sincos(angle_rad);
    Vector2::new(cos, sin)
}

/// The angle of a vector, −π … π.
pub(crate) fn angle_of(vector: Vector2<f64>) -> f64 {
    libm::atan2(vector.y, vector.x)
}

/// A vector turned counter-clockwise by the angle of a unit vector.
pub(crate) fn turned(vector: Vector2<f64>, by: Vector2<f64>) -> Vector2<f64> {
    Vector2::new(vector.x * by.x - vector.y * by.y, vector.x * by.y + vector.y * by.x)
}

/// A vector turned counter-clockwise by a quarter.
pub(crate) fn left_of(vector: Vector2<f64>) -> Vector2<f64> {
    Vector2::new(-vector.y, vector.x)
}

/// The same angle between −π and π.
pub(crate) fn wrapped(angle_rad: f64) -> f64 {
    angle_rad - TAU * ((angle_rad + PI) / TAU).floor()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_angle_and_its_direction_are_inverses() {
        for degrees in -179..180 {
            let angle = f64::from(degrees).to_radians();
            // One rounding each of sine, cosine and arc tangent.
            assert!((angle_of(direction(angle)) - angle).abs() < 1e-15, "{degrees}°");
            for turns in [-2.0, -1.0, 0.0, 1.0, 2.0] {
                assert!((wrapped(angle + turns * TAU) - angle).abs() < 1e-14, "{degrees}° and {turns} turns");
            }
        }
    }

    #[test]
    fn turning_adds_angles() {
        let turned = turned(direction(0.3), direction(0.4));
        assert!((turned - direction(0.7)).norm() < 1e-15);
        assert_eq!(left_of(Vector2::new(1.0, 0.0)), Vector2::new(0.0, 1.0));
    }
}
