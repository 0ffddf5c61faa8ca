//! Geometry of the camera: where its pixels look, and which of them a convex thing can touch.
//!
//! The camera's frame is x forward along the optical axis, y left, z up. A pixel's ray is scaled to 1 along x, so the
//! ray parameter of a hit *is* its depth.

use std::ops::Range;

use nalgebra::{Matrix3, Vector3};

/// Pixels in a column of the image.
pub(super) const N_ROWS: usize = 124;
/// Pixels in a row of the image.
pub(super) const N_COLUMNS: usize = 160;
/// All pixels of the image, row by row from the top left.
pub(super) const N_PIXELS: usize = N_ROWS * N_COLUMNS;
/// Nothing nearer than this, along the optical axis, is seen: it would lie inside the housing.
pub(super) const NEAREST_DEPTH_M: f64 = 0.05;

/// Angle between the outer edges of the image, left to right.
const FIELD_OF_VIEW_ACROSS_DEG: f64 = 47.0;
/// The same from top to bottom.
const FIELD_OF_VIEW_UP_DEG: f64 = 39.0;

/// Where the pixels look, in the camera's own frame.
pub(super) struct Camera {
    /// `(N_COLUMNS,)`: metres to the left at a depth of 1 m.
    left_of_column: Vec<f64>,
    /// `(N_ROWS,)`: metres up at a depth of 1 m.
    up_of_row: Vec<f64>,
    /// `(N_PIXELS,)`: metres along the ray for each metre of depth.
    range_per_depth: Vec<f64>,
}

/// Pixels that something may touch: rows × columns.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) struct Window {
    pub(super) rows: Range<usize>,
    pub(super) columns: Range<usize>,
}

impl Window {
    /// The whole image.
    #[cfg(test)]
    pub(super) fn whole() -> Self {
        Self { rows: 0..N_ROWS, columns: 0..N_COLUMNS }
    }
}

/// Where the camera is and how it is turned, for one frame.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct View {
    /// The camera's centre, in the world.
    pub(super) eye: Vector3<f64>,
    /// Columns: forward, left and up of the camera, in the world.
    pub(super) world_from_camera: Matrix3<f64>,
}

impl View {
    /// A camera at `eye` with heading `yaw_rad` (counter-clockwise), nose down by `pitch_rad`, left side up by
    /// `roll_rad`: rotations about z, then y, then x of the turned frame, as ROS composes them.
    pub(super) fn new(eye: Vector3<f64>, yaw_rad: f64, pitch_rad: f64, roll_rad: f64) -> Self {
        let (sy, cy) = libm::sincos(yaw_rad);
        let (sp, cp) = libm::sincos(pitch_rad);
        let (sr, cr) = libm::sincos(roll_rad);
        #[rustfmt::skip]
        let world_from_camera = Matrix3::new(
            cy * cp, cy * sp * sr - sy * cr, cy * sp * cr + sy * sr,
            sy * cp, sy * sp * sr + cy * cr, sy * sp * cr - cy * sr,
            -sp,     cp * sr,                cp * cr,
        );
        Self { eye, world_from_camera }
    }
}

impl Camera {
    pub(super) fn new() -> Self {
        let left_of_column = tangents(N_COLUMNS, FIELD_OF_VIEW_ACROSS_DEG);
        let up_of_row = tangents(N_ROWS, FIELD_OF_VIEW_UP_DEG);
        let range_per_depth = up_of_row
            .iter()
            .flat_map(|up| left_of_column.iter().map(move |left| (1.0 + left * left + up * up).sqrt()))
            .collect();
        Self { left_of_column, up_of_row, range_per_depth }
    }

    /// Metres along each pixel's ray for each metre of depth, `(N_PIXELS,)`.
    pub(super) fn range_per_depth(&self) -> &[f64] {
        &self.range_per_depth
    }

    /// The rays of a row in the world, from `columns.start` on: `view` turned, 1 along the optical axis.
    pub(super) fn rays<'a>(
        &'a self,
        view: &'a View,
        row: usize,
        columns: Range<usize>,
    ) -> impl Iterator<Item = Vector3<f64>> + 'a {
        let [forward, left, up] = [0, 1, 2].map(|axis| view.world_from_camera.column(axis).into_owned());
        let middle = forward + up * self.up_of_row[row];
        self.left_of_column[columns].iter().map(move |share| middle + left * *share)
    }

    /// The pixels that can see into the box around a thing, given by its corners in the world; `None` if no pixel can.
    ///
    /// * `corners` — bit 0 of an index chooses the side along the box's first axis, bit 1 along the second, bit 2 along
    ///   the third.
    ///
    /// The part of a convex body in front of the camera projects to the hull of its projected corners, and of the
    /// points where its edges leave the nearest depth.
    pub(super) fn window(&self, view: &View, corners: &[Vector3<f64>; 8]) -> Option<Window> {
        let corners = corners.map(|corner| view.world_from_camera.tr_mul(&(corner - view.eye)));
        let mut hull = Hull::EMPTY;
        for (index, corner) in corners.iter().enumerate() {
            if corner.x >= NEAREST_DEPTH_M {
                hull.include(corner);
            }
            for other in [1, 2, 4].map(|bit| index | bit).into_iter().filter(|other| *other != index) {
                let other = &corners[other];
                if (corner.x < NEAREST_DEPTH_M) != (other.x < NEAREST_DEPTH_M) {
                    let share = (NEAREST_DEPTH_M - corner.x) / (other.x - corner.x);
                    let mut crossing = corner + (other - corner) * share;
                    crossing.x = NEAREST_DEPTH_M;
                    hull.include(&crossing);
                }
            }
        }
        // Left and up fall with rising column and row.
        let columns = span(&self.left_of_column, hull.left);
        let rows = span(&self.up_of_row, hull.up);
        (!columns.is_empty() && !rows.is_empty()).then_some(Window { rows, columns })
    }
}

/// What the projected points span at a depth of 1 m.
struct Hull {
    left: (f64, f64),
    up: (f64, f64),
}

impl Hull {
    const EMPTY: Self =
        Self { left: (f64::INFINITY, f64::NEG_INFINITY), up: (f64::INFINITY, f64::NEG_INFINITY) };

    fn include(&mut self, point: &Vector3<f64>) {
        let (left, up) = (point.y / point.x, point.z / point.x);
        self.left = (self.left.0.min(left), self.left.1.max(left));
        self.up = (self.up.0.min(up), self.up.1.max(up));
    }
}

/// Where the centres of `n` pixels look, from the positive side to the negative.
fn tangents(n: usize, field_of_view_deg: f64) -> Vec<f64> {
    let edge = libm::tan((field_of_view_deg / 2.0).to_radians());
    (0..n).map(|index| edge * (1.0 - (2 * index + 1) as f64 / n as f64)).collect()
}

/// The pixels whose falling `tangents` lie between `low` and `high`, and one more on either side, which rounding could
/// have let in.
fn span(tangents: &[f64], (low, high): (f64, f64)) -> Range<usize> {
    if low > high {
        return 0..0;
    }
    let first = tangents.partition_point(|tangent| *tangent > high);
    let end = tangents.partition_point(|tangent| *tangent >= low);
    if first == end && (first == 0 || end == tangents.len()) {
        return 0..0;
    }
    first.saturating_sub(1)..(end + 1).min(tangents.len())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_outermost_pixels_look_half_a_pixel_inside_the_field_of_view() {
        let camera = Camera::new();
        let edge_deg = |tangent: f64, pixel: f64| libm::atan(tangent + pixel / 2.0).to_degrees();
        let across = camera.left_of_column[0] - camera.left_of_column[1];
        let up = camera.up_of_row[0] - camera.up_of_row[1];
        assert!((edge_deg(camera.left_of_column[0], across) - 23.5).abs() < 1e-9);
        assert!((edge_deg(camera.up_of_row[0], up) - 19.5).abs() < 1e-9);
    }

    #[test]
    fn a_turned_camera_looks_where_it_is_turned() {
        let quarter = std::f64::consts::FRAC_PI_2;
        for (yaw, pitch, roll, forward, up) in [
            (0.0, 0.0, 0.0, Vector3::x(), Vector3::z()),
            (quarter, 0.0, 0.0, Vector3::y(), Vector3::z()),
            (0.0, quarter, 0.0, -Vector3::z(), Vector3::x()),
            (0.0, 0.0, quarter, Vector3::x(), -Vector3::y()),
        ] {
            let view = View::new(Vector3::zeros(), yaw, pitch, roll);
            assert!((view.world_from_camera.column(0) - forward).norm() < 1e-12, "{yaw} {pitch} {roll}");
            assert!((view.world_from_camera.column(2) - up).norm() < 1e-12, "{yaw} {pitch} {roll}");
        }
    }

    #[test]
    fn nothing_behind_or_beside_the_camera_has_a_window() {
        let camera = Camera::new();
        let view = View::new(Vector3::zeros(), 0.0, 0.0, 0.0);
        let cube = |x: f64, y: f64| {
            std::array::from_fn(|corner| {
                let side = |bit: usize| if corner & bit == 0 { -0.5 } else { 0.5 };
                Vector3::new(x + side(1), y + side(2), side(4))
            })
        };
        assert_eq!(camera.window(&view, &cube(-2.0, 0.0)), None);
        assert_eq!(camera.window(&view, &cube(2.0, 4.0)), None);
        assert_eq!(camera.window(&view, &cube(0.0, 0.0)), Some(Window::whole()));
        let ahead = camera.window(&view, &cube(10.0, 0.0)).expect("straight ahead");
        assert!(ahead.columns.contains(&79) && ahead.columns.len() < 40, "{ahead:?}");
    }
}
