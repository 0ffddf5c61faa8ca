//! A floor as walls, and what a ray meets first.
//!
//! Everything that stands on a floor is made of upright flat pieces, each a segment of the floor plan: walls, doors,
//! the sides of cupboards, the facets of pillars and legs.

use nalgebra::Vector2;

use super::angle::{direction, left_of};

/// What a surface gives back of what falls on it square, 0 … 1.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Surface {
    /// Share of a sound's pressure.
    pub(crate) acoustic: f64,
    /// Share of near infrared light.
    pub(crate) infrared: f64,
}

impl Surface {
    pub(crate) const PLASTER: Self = Self { acoustic: 0.95, infrared: 0.80 };
    pub(crate) const BRICK: Self = Self { acoustic: 0.80, infrared: 0.35 };
    pub(crate) const WOOD: Self = Self { acoustic: 0.90, infrared: 0.50 };
    pub(crate) const METAL: Self = Self { acoustic: 1.00, infrared: 0.60 };
    pub(crate) const GLASS: Self = Self { acoustic: 1.00, infrared: 0.06 };
    pub(crate) const FABRIC: Self = Self { acoustic: 0.40, infrared: 0.25 };
}

/// One upright flat piece.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Wall {
    pub(crate) from: Vector2<f64>,
    pub(crate) to: Vector2<f64>,
    pub(crate) surface: Surface,
}

impl Wall {
    /// A closed outline with this many equal sides about a centre, the middle of one of them at angle 0.
    pub(crate) fn ring(
        centre: Vector2<f64>,
        apothem_m: f64,
        n_sides: u32,
        surface: Surface,
    ) -> impl Iterator<Item = Self> {
        let half_side_rad = std::f64::consts::PI / f64::from(n_sides);
        let corner_m = apothem_m / libm::cos(half_side_rad);
        let corner = move |side: u32| {
            centre + corner_m * direction(half_side_rad * f64::from(2 * (side % n_sides) + 1))
        };
        (0..n_sides).map(move |side| Self { from: corner(side), to: corner(side + 1), surface })
    }

    /// Distance of a point from the nearest point of the wall, metres.
    pub(crate) fn distance_m(&self, point: Vector2<f64>) -> f64 {
        let along = self.to - self.from;
        let share = ((point - self.from).dot(&along) / along.norm_squared()).clamp(0.0, 1.0);
        (self.from + share * along - point).norm()
    }

    /// How far along a ray the wall is met. Parallel ones are not met. Walls reach [`REACH`] beyond their ends, so that
    /// no ray slips through where two of them join.
    fn met_at_m(&self, ray: &Ray) -> Option<f64> {
        let along = self.to - self.from;
        let to_wall = self.from - ray.origin;
        let across = ray.direction.perp(&along);
        let range_m = to_wall.perp(&along) / across;
        let share = to_wall.perp(&ray.direction) / across;
        // A division by 0 gives no number in any of these comparisons.
        ((0.0..f64::INFINITY).contains(&range_m) && (-REACH..=1.0 + REACH).contains(&share))
            .then_some(range_m)
    }
}

/// Share of its length by which a wall reaches beyond its ends.
const REACH: f64 = 1e-9;

/// A half line.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Ray {
    pub(crate) origin: Vector2<f64>,
    /// Of length 1.
    pub(crate) direction: Vector2<f64>,
}

impl Ray {
    pub(crate) fn at(&self, range_m: f64) -> Vector2<f64> {
        self.origin + range_m * self.direction
    }
}

/// Where a ray meets a wall.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Hit {
    pub(crate) range_m: f64,
    /// Of length 1, towards where the ray came from.
    pub(crate) normal: Vector2<f64>,
    pub(crate) surface: Surface,
}

impl Hit {
    /// Cosine of the angle between ray and normal: 1 square, 0 grazing.
    pub(crate) fn cos_incidence(&self, ray: &Ray) -> f64 {
        -ray.direction.dot(&self.normal)
    }
}

/// The walls of a floor, sorted into a grid of square cells.
///
/// A ray visits the cells on its way and stops in the first one in which it meets a wall, so its cost is that of the way
/// and not of the floor.
#[derive(Clone, Debug)]
pub(crate) struct World {
    walls: Vec<Wall>,
    corner: Vector2<f64>,
    n_columns: usize,
    n_rows: usize,
    /// Of each cell, row by row, where its walls begin in `wall_indices`; and where the last ones end.
    starts: Vec<u32>,
    wall_indices: Vec<u32>,
}

/// Side of a cell: about half a doorway, so that few cells hold more than a handful of walls.
const CELL_M: f64 = 0.5;

/// By how much a cell claims walls beyond its sides, so that a rounding error on a side loses none.
const MARGIN_M: f64 = 1e-6;

impl World {
    /// A world of at least one wall.
    pub(crate) fn new(walls: Vec<Wall>) -> Self {
        assert!(!walls.is_empty(), "a world without walls has no extent");
        let ends = || walls.iter().flat_map(|wall| [wall.from, wall.to]);
        let low = ends().reduce(|a, b| a.inf(&b)).unwrap_or_default().add_scalar(-2.0 * MARGIN_M);
        let high = ends().reduce(|a, b| a.sup(&b)).unwrap_or_default().add_scalar(2.0 * MARGIN_M);
        let n_cells = |extent_m: f64| (extent_m / CELL_M).ceil() as usize;
        let (n_columns, n_rows) = (n_cells(high.x - low.x), n_cells(high.y - low.y));
        let mut world =
            Self { walls, corner: low, n_columns, n_rows, starts: vec![0], wall_indices: Vec::new() };
        for row in 0..n_rows {
            for column in 0..n_columns {
                let centre = low + CELL_M * Vector2::new(column as f64 + 0.5, row as f64 + 0.5);
                let claimed = (0u32..).zip(&world.walls).filter(|(_, wall)| touches(centre, wall));
                world.wall_indices.extend(claimed.map(|(index, _)| index));
                world.starts.push(world.wall_indices.len() as u32);
            }
        }
        world
    }

    /// The first wall on a ray within a range; of two at the same range the one named first.
    pub(crate) fn cast(&self, ray: &Ray, range_m_max: f64) -> Option<Hit> {
        let mut nearest = Nearest { range_m: range_m_max, wall_index: None };
        let mut walk = Walk::new(self, ray)?;
        loop {
            let cell = walk.row as usize * self.n_columns + walk.column as usize;
            let claimed = self.starts[cell] as usize..self.starts[cell + 1] as usize;
            for &index in &self.wall_indices[claimed] {
                nearest.consider(&self.walls, index, ray);
            }
            if nearest.range_m <= walk.leaves_at_m() || !walk.enter_next(self) {
                return nearest.hit(&self.walls, ray);
            }
        }
    }
}

#[cfg(test)]
impl World {
    /// Distance from a point to the nearest wall, metres; infinite where none is within a cell's side.
    pub(crate) fn clearance_m(&self, point: Vector2<f64>) -> f64 {
        let place = (point - self.corner) / CELL_M;
        let (column, row) = (place.x.floor() as i64, place.y.floor() as i64);
        let is_cell = |cell: &(i64, i64)| {
            cell.0.min(cell.1) >= 0 && cell.0 < self.n_columns as i64 && cell.1 < self.n_rows as i64
        };
        let about = (-1..=1).flat_map(|up| (-1..=1).map(move |right| (column + right, row + up)));
        let claimed = about.filter(is_cell).flat_map(|(column, row)| {
            let cell = row as usize * self.n_columns + column as usize;
            &self.wall_indices[self.starts[cell] as usize..self.starts[cell + 1] as usize]
        });
        let distances_m = claimed.map(|&index| self.walls[index as usize].distance_m(point));
        distances_m.filter(|distance_m| *distance_m <= CELL_M).fold(f64::INFINITY, f64::min)
    }
}

/// Whether a wall touches the cell about a centre: separating axes are the cell's two and the wall's normal.
fn touches(centre: Vector2<f64>, wall: &Wall) -> bool {
    let half = 0.5 * CELL_M + MARGIN_M;
    let (from, to) = (wall.from - centre, wall.to - centre);
    let (low, high) = (from.inf(&to), from.sup(&to));
    let normal = left_of(to - from);
    low.x <= half
        && high.x >= -half
        && low.y <= half
        && high.y >= -half
        && normal.dot(&from).abs() <= half * (normal.x.abs() + normal.y.abs())
}

struct Nearest {
    range_m: f64,
    wall_index: Option<u32>,
}

impl Nearest {
    fn consider(&mut self, walls: &[Wall], index: u32, ray: &Ray) {
        let Some(range_m) = walls[index as usize].met_at_m(ray) else { return };
        // The second case keeps the answer free of the order of cells.
        if range_m < self.range_m
            || (range_m == self.range_m && self.wall_index.is_none_or(|found| index < found))
        {
            *self = Self { range_m, wall_index: Some(index) };
        }
    }

    fn hit(&self, walls: &[Wall], ray: &Ray) -> Option<Hit> {
        let wall = &walls[self.wall_index? as usize];
        let normal = left_of(wall.to - wall.from).normalize();
        let normal = if normal.dot(&ray.direction) > 0.0 { -normal } else { normal };
        Some(Hit { range_m: self.range_m, normal, surface: wall.surface })
    }
}

/// A ray's way from cell to cell. Amanatides & Woo 1987, *A fast voxel traversal algorithm for ray tracing*.
struct Walk {
    column: i64,
    row: i64,
    step: [i64; 2],
    /// Range at which the ray crosses the next side of each axis.
    next_m: [f64; 2],
    /// Range from one side to the next of each axis.
    per_cell_m: [f64; 2],
}

impl Walk {
    /// The first cell of a ray; `None` where it passes by the grid.
    fn new(world: &World, ray: &Ray) -> Option<Self> {
        let n_cells = [world.n_columns, world.n_rows];
        let entry_m = entry_m(world, ray)?;
        let (mut cell, mut step, mut next_m, mut per_cell_m) = ([0; 2], [0; 2], [f64::INFINITY; 2], [0.0; 2]);
        for axis in 0..2 {
            let (origin, slope) = (ray.origin[axis] - world.corner[axis], ray.direction[axis]);
            let place = (origin + entry_m * slope) / CELL_M;
            cell[axis] = (place.floor() as i64).clamp(0, n_cells[axis] as i64 - 1);
            if slope != 0.0 {
                step[axis] = if slope > 0.0 { 1 } else { -1 };
                let side = cell[axis] + i64::from(slope > 0.0);
                next_m[axis] = (side as f64 * CELL_M - origin) / slope;
                per_cell_m[axis] = CELL_M / slope.abs();
            }
        }
        Some(Self { column: cell[0], row: cell[1], step, next_m, per_cell_m })
    }

    fn leaves_at_m(&self) -> f64 {
        self.next_m[0].min(self.next_m[1])
    }

    /// False where the ray leaves the grid.
    fn enter_next(&mut self, world: &World) -> bool {
        let axis = usize::from(self.next_m[1] < self.next_m[0]);
        self.next_m[axis] += self.per_cell_m[axis];
        let (cell, n_cells) =
            if axis == 0 { (&mut self.column, world.n_columns) } else { (&mut self.row, world.n_rows) };
        *cell += self.step[axis];
        (0..n_cells as i64).contains(cell)
    }
}

/// Range at which a ray enters the grid: 0 from within.
fn entry_m(world: &World, ray: &Ray) -> Option<f64> {
    let extent = CELL_M * Vector2::new(world.n_columns as f64, world.n_rows as f64);
    let (mut entry_m, mut exit_m) = (0.0_f64, f64::INFINITY);
    for axis in 0..2 {
        let (origin, slope) = (ray.origin[axis] - world.corner[axis], ray.direction[axis]);
        if slope == 0.0 {
            if !(0.0..=extent[axis]).contains(&origin) {
                return None;
            }
            continue;
        }
        let (a, b) = (-origin / slope, (extent[axis] - origin) / slope);
        entry_m = entry_m.max(a.min(b));
        exit_m = exit_m.min(a.max(b));
    }
    (entry_m <= exit_m).then_some(entry_m)
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    fn wall(from: (f64, f64), to: (f64, f64)) -> Wall {
        Wall { from: Vector2::new(from.0, from.1), to: Vector2::new(to.0, to.1), surface: Surface::PLASTER }
    }

    /// The plain version: every wall is tested.
    fn cast_over_all(world: &World, ray: &Ray, range_m_max: f64) -> Option<Hit> {
        let mut nearest = Nearest { range_m: range_m_max, wall_index: None };
        (0..world.walls.len() as u32).for_each(|index| nearest.consider(&world.walls, index, ray));
        nearest.hit(&world.walls, ray)
    }

    /// Coordinates on and off the sides of cells, so that rays run along sides and through corners.
    fn coordinate() -> impl Strategy<Value = f64> {
        prop_oneof![-8.0..8.0_f64, (-16..16_i32).prop_map(|half_metres| f64::from(half_metres) * 0.5)]
    }

    fn walls() -> impl Strategy<Value = Vec<Wall>> {
        let point = || (coordinate(), coordinate());
        let long_enough = |(from, to): &((f64, f64), (f64, f64))| from != to;
        let one = (point(), point()).prop_filter("has a length", long_enough);
        proptest::collection::vec(one.prop_map(|(from, to)| wall(from, to)), 1..40)
    }

    proptest! {
        #[test]
        fn casting_by_the_grid_equals_casting_over_all_walls(
            walls in walls(), x in coordinate(), y in coordinate(), eighths in 0..16_u32, turn in 0.0..0.8_f64,
            is_straight: bool, range_m_max in prop_oneof![Just(f64::INFINITY), 0.1..20.0_f64],
        ) {
            let world = World::new(walls);
            let angle = f64::from(eighths) * std::f64::consts::FRAC_PI_8 + if is_straight { 0.0 } else { turn };
            let ray = Ray { origin: Vector2::new(x, y), direction: direction(angle) };
            prop_assert_eq!(world.cast(&ray, range_m_max), cast_over_all(&world, &ray, range_m_max));
        }
    }

    #[test]
    fn a_ray_meets_the_nearer_of_two_walls_and_sees_it_square() {
        let world = World::new(vec![wall((5.0, -1.0), (5.0, 1.0)), wall((2.0, 1.0), (2.0, -1.0))]);
        let ray = Ray { origin: Vector2::zeros(), direction: Vector2::new(1.0, 0.0) };
        let hit = world.cast(&ray, 10.0).unwrap();
        assert_eq!((hit.range_m, hit.normal, hit.cos_incidence(&ray)), (2.0, Vector2::new(-1.0, 0.0), 1.0));
        assert_eq!(world.cast(&ray, 1.9), None);
        let away = Ray { direction: Vector2::new(-1.0, 0.0), ..ray };
        assert_eq!(world.cast(&away, 10.0), None);
    }

    #[test]
    fn no_ray_leaves_a_closed_ring() {
        let centre = Vector2::new(0.25, -0.4);
        let world = World::new(Wall::ring(centre, 3.0, 48, Surface::BRICK).collect());
        for step in 0..10_000 {
            let ray = Ray { origin: centre, direction: direction(f64::from(step) * 0.001) };
            let range_m = world.cast(&ray, f64::INFINITY).unwrap().range_m;
            // Between the middle of a side and a corner.
            let corner_m = 3.0 / (std::f64::consts::PI / 48.0).cos();
            assert!((3.0 - 1e-9..corner_m + 1e-9).contains(&range_m), "{range_m}");
        }
    }

    #[test]
    fn clearance_is_the_distance_to_the_nearest_point_of_any_wall() {
        let world = World::new(vec![wall((0.0, 0.0), (4.0, 0.0)), wall((10.0, 0.0), (10.0, 4.0))]);
        assert_eq!(world.clearance_m(Vector2::new(2.0, 0.375)), 0.375);
        assert!((world.clearance_m(Vector2::new(-0.3, 0.4)) - 0.5).abs() < 1e-15);
        assert_eq!(world.clearance_m(Vector2::new(9.75, 2.0)), 0.25);
        assert_eq!(world.clearance_m(Vector2::new(6.0, 2.0)), f64::INFINITY);
    }
}
