//! The ground: a field of heights, and what covers it.

use nalgebra::Vector3;

use super::material::Material;

/// A ray has met the ground when it is this close above it. One count is 1 mm.
const CLOSE_M: f64 = 1e-4;
/// A ray that has not met the ground after so many steps runs almost along it, returns next to no light, and is taken
/// to miss it.
const MAX_STEPS: usize = 200;

/// Heights at the corners of a grid, bilinear in between, level outside.
pub(super) struct Ground {
    origin_m: (f64, f64),
    spacing_m: f64,
    n_columns: usize,
    /// `(n_rows, n_columns)`: rows along y, columns along x; metres.
    heights_m: Vec<f64>,
    /// Steepest rise of any cell, metres per metre.
    max_slope: f64,
    /// What covers the ground at x, y.
    cover: fn(f64, f64) -> Material,
}

impl Ground {
    /// Level ground at height 0.
    #[cfg(test)]
    pub(super) fn level() -> Self {
        Self::new((0.0, 0.0), (2.0, 2.0), 1.0, |_, _| 0.0, |_, _| Material::Paving)
    }

    /// Ground over `size_m` (along x, along y) from `origin_m` on, with the heights of `height_m`.
    pub(super) fn new(
        origin_m: (f64, f64),
        size_m: (f64, f64),
        spacing_m: f64,
        height_m: impl Fn(f64, f64) -> f64,
        cover: fn(f64, f64) -> Material,
    ) -> Self {
        let n_columns = (size_m.0 / spacing_m) as usize + 1;
        let n_rows = (size_m.1 / spacing_m) as usize + 1;
        let place = |start: f64, index: usize| start + index as f64 * spacing_m;
        let heights_m: Vec<f64> = (0..n_rows * n_columns)
            .map(|index| (place(origin_m.0, index % n_columns), place(origin_m.1, index / n_columns)))
            .map(|(x_m, y_m)| height_m(x_m, y_m))
            .collect();
        let steepest = |most: f64, slope: f64| most.max(slope.abs());
        let along_x = heights_m
            .chunks_exact(n_columns)
            .flat_map(|row| row.windows(2))
            .map(|pair| (pair[1] - pair[0]) / spacing_m)
            .fold(0.0, steepest);
        let along_y = heights_m
            .iter()
            .zip(&heights_m[n_columns..])
            .map(|(south, north)| (north - south) / spacing_m)
            .fold(0.0, steepest);
        let max_slope = (along_x * along_x + along_y * along_y).sqrt();
        Self { origin_m, spacing_m, n_columns, heights_m, max_slope, cover }
    }

    /// Height at a place.
    pub(super) fn height_m(&self, x_m: f64, y_m: f64) -> f64 {
        let (corner, _, along_x, along_y) = self.cell(x_m, y_m);
        let (low, high) = self.edges(corner, along_x);
        low + (high - low) * along_y
    }

    /// Upward normal, of length 1.
    pub(super) fn normal(&self, x_m: f64, y_m: f64) -> Vector3<f64> {
        let (corner, inside, along_x, along_y) = self.cell(x_m, y_m);
        if !inside {
            return Vector3::z();
        }
        let [a, b] = [self.heights_m[corner], self.heights_m[corner + 1]];
        let [c, d] = [self.heights_m[corner + self.n_columns], self.heights_m[corner + self.n_columns + 1]];
        let rise_x = (b - a) + ((d - c) - (b - a)) * along_y;
        let rise_y = (c - a) + ((d - b) - (c - a)) * along_x;
        Vector3::new(-rise_x, -rise_y, self.spacing_m).normalize()
    }

    /// What covers a place.
    pub(super) fn cover(&self, x_m: f64, y_m: f64) -> Material {
        (self.cover)(x_m, y_m)
    }

    /// Ray parameter at which a ray from `eye` first meets the ground, if before `end`; else infinite.
    ///
    /// No cell is steeper than the steepest, so a step that could not meet the ground even there cannot miss it.
    pub(super) fn depth(&self, eye: &Vector3<f64>, ray: &Vector3<f64>, end: f64) -> f64 {
        let closing = self.max_slope * (ray.x * ray.x + ray.y * ray.y).sqrt() - ray.z;
        if closing <= 0.0 {
            return f64::INFINITY;
        }
        let mut depth = 0.0;
        for _ in 0..MAX_STEPS {
            let point = eye + ray * depth;
            let above_m = point.z - self.height_m(point.x, point.y);
            if above_m < CLOSE_M {
                return depth;
            }
            depth += above_m / closing;
            if depth >= end {
                break;
            }
        }
        f64::INFINITY
    }

    /// Index of the cell's lower left corner, whether the place lies on the grid, and how far into the cell it is
    /// along x and y (0 to 1).
    #[inline]
    fn cell(&self, x_m: f64, y_m: f64) -> (usize, bool, f64, f64) {
        let n_rows = self.heights_m.len() / self.n_columns;
        let (column, inside_x, along_x) = index((x_m - self.origin_m.0) / self.spacing_m, self.n_columns);
        let (row, inside_y, along_y) = index((y_m - self.origin_m.1) / self.spacing_m, n_rows);
        (row * self.n_columns + column, inside_x && inside_y, along_x, along_y)
    }

    /// Heights where the cell's lower and upper edge are crossed.
    #[inline]
    fn edges(&self, corner: usize, along_x: f64) -> (f64, f64) {
        let at = |corner: usize| {
            let [left, right] = [self.heights_m[corner], self.heights_m[corner + 1]];
            left + (right - left) * along_x
        };
        (at(corner), at(corner + self.n_columns))
    }
}

/// The cell of a coordinate in units of the spacing, whether it lies on the grid, and the share of the cell before it.
#[inline]
fn index(place: f64, n_corners: usize) -> (usize, bool, f64) {
    let clamped = place.clamp(0.0, (n_corners - 1) as f64);
    let cell = (clamped as usize).min(n_corners - 2);
    (cell, clamped == place, clamped - cell as f64)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn slope() -> Ground {
        Ground::new((-20.0, -20.0), (40.0, 40.0), 1.0, |x, y| 0.05 * x - 0.02 * y, |_, _| Material::Grass)
    }

    #[test]
    fn a_plane_is_met_where_geometry_says() {
        let ground = slope();
        let eye = Vector3::new(1.3, -2.1, 1.0);
        for ray in [[1.0, 0.0, -0.2], [-1.0, 0.4, -0.3], [0.2, 1.0, -0.1], [1.0, 0.0, 0.0]] {
            let ray = Vector3::from(ray);
            let above_m = eye.z - (0.05 * eye.x - 0.02 * eye.y);
            let expected = above_m / (0.05 * ray.x - 0.02 * ray.y - ray.z);
            // A ray stops up to CLOSE_M above the ground, which is farther along the ray by its inverse grazing slope.
            let tolerance = CLOSE_M * expected / above_m + 1e-9;
            let depth = ground.depth(&eye, &ray, 1e3);
            let on_grid = (eye + ray * expected).amax() < 20.0;
            assert!(!on_grid || (depth - expected).abs() <= tolerance, "{ray}: {depth}, not {expected}");
        }
    }

    #[test]
    fn rays_that_rise_faster_than_the_ground_never_meet_it() {
        let eye = Vector3::new(0.0, 0.0, 0.6);
        assert_eq!(slope().depth(&eye, &Vector3::new(1.0, 0.0, 0.06), 1e3), f64::INFINITY);
        assert_eq!(Ground::level().depth(&eye, &Vector3::x(), 1e3), f64::INFINITY);
    }

    #[test]
    fn the_normal_is_across_the_ground() {
        let expected = Vector3::new(-0.05, 0.02, 1.0).normalize();
        assert!((slope().normal(3.3, 4.4) - expected).norm() < 1e-12);
        assert_eq!(slope().normal(300.0, 4.4), Vector3::z());
    }
}
