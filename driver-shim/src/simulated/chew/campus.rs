//! The campus: what stands there on every trip, and the way that Chew is driven.
//!
//! ```text
//!   y                       shops, façades at 11.2
//!  9.5   ◀────────────────── north pavement ◀──────┐
//!  4     ┐        street, 0.3 … 7.7                │ crossing
//! -1.6   └▶ south pavement ─▶┐   hedges            │
//!        lawn with trees     ▼                     │
//! -14            start ──▶───────────────▶─────────┘   hall
//! -19            hall
//!        -3 ─────────────────────────────────── 38 ─▶ x
//! ```

use nalgebra::Vector2;

use super::super::random::{Random, Streams};
use super::ground::Ground;
use super::material::Material;
use super::solid::Solid;

/// Floor of everything built reaches this far below the ground at its middle: the ground slopes.
const SUNK_M: f64 = 0.5;
/// Where the street lies.
const STREET_Y_M: (f64, f64) = (0.3, 7.7);
/// Where the shops begin.
const FACADE_Y_M: f64 = 11.2;
/// Northern end of the lawn.
const LAWN_Y_M: f64 = -3.0;

const SHOP_WIDTH_M: f64 = 5.0;
/// Western ends of the shops.
const SHOPS_X_M: [f64; 8] = [-4.0, 1.0, 6.0, 11.0, 16.0, 21.0, 26.0, 31.0];

/// The campus, the same on every trip.
pub(super) struct Campus {
    pub(super) ground: Ground,
    pub(super) solids: Vec<Solid>,
}

impl Campus {
    pub(super) fn new() -> Self {
        let ground = Ground::new((-60.0, -50.0), (160.0, 80.0), 1.0, height_m, cover);
        let mut random = Streams::new("campus", 0, 0).named("plan");
        let mut site = Site { ground: &ground, solids: Vec::new() };
        for west_m in SHOPS_X_M {
            site.shop(west_m, &mut random);
        }
        site.halls();
        site.street_furniture();
        site.hedges();
        site.trees(&mut random);
        let solids = site.solids;
        Self { ground, solids }
    }
}

/// Where Chew is driven: about 190 m, the last 60 m of which it has been before.
pub(super) fn route() -> Vec<Vector2<f64>> {
    let lap = [
        (14.0, -14.0),
        (24.0, -13.0),
        (33.0, -9.5),
        (36.5, -3.0),
        (37.5, 1.0),
        (37.5, 7.5),
        (35.5, 9.3),
        (28.0, 9.6),
        (18.0, 9.4),
        (8.0, 9.6),
        (-0.5, 9.4),
        (-3.0, 7.5),
        (-3.0, 0.5),
        (-1.0, -1.5),
        (8.0, -1.6),
        (15.0, -1.6),
        (17.0, -3.5),
        (16.0, -9.0),
        (10.0, -13.0),
        (11.0, -15.5),
    ];
    let again = &lap[..8];
    lap.iter().chain(again).map(|&(x, y)| Vector2::new(x, y)).collect()
}

/// Along the street the ground rises evenly to the east; the lawn falls to the south, with mounds and hollows. No
/// slope exceeds 1 in 8.
fn height_m(x_m: f64, y_m: f64) -> f64 {
    let into_lawn_m = (LAWN_Y_M - y_m).max(0.0);
    let lawn_share = (into_lawn_m / 6.0).min(1.0);
    let mounds_m = 0.25 * libm::sin(x_m / 5.0) * libm::sin(y_m / 4.5);
    0.012 * x_m - 0.03 * into_lawn_m + lawn_share * mounds_m
}

fn cover(x_m: f64, y_m: f64) -> Material {
    let is_footpath = (-15.2..-12.8).contains(&y_m) && (2.0..26.0).contains(&x_m);
    if (STREET_Y_M.0..STREET_Y_M.1).contains(&y_m) {
        Material::Asphalt
    } else if y_m >= LAWN_Y_M || is_footpath {
        Material::Paving
    } else {
        Material::Grass
    }
}

/// The campus while it is built.
struct Site<'a> {
    ground: &'a Ground,
    solids: Vec<Solid>,
}

impl Site<'_> {
    /// A block between two corners seen from above, from `low_m` to `high_m` over the ground at its middle. What
    /// stands on the ground reaches into it.
    fn block(&mut self, material: Material, x_m: (f64, f64), y_m: (f64, f64), (low_m, high_m): (f64, f64)) {
        let middle = ((x_m.0 + x_m.1) / 2.0, (y_m.0 + y_m.1) / 2.0);
        let low_m = if low_m == 0.0 { -SUNK_M } else { low_m };
        let floor_m = self.ground.height_m(middle.0, middle.1) + low_m;
        let size = [x_m.1 - x_m.0, y_m.1 - y_m.0, high_m - low_m];
        self.solids.push(Solid::block(material, middle, floor_m, size, 0.0));
    }

    /// A shop: two piers, a window over a sill, a door in a recess, the storey above, perhaps an awning.
    fn shop(&mut self, west_m: f64, random: &mut Random) {
        let wall = if random.chance(0.5) { Material::Brick } else { Material::Render };
        let east_m = west_m + SHOP_WIDTH_M;
        let front = |behind_m: f64| (FACADE_Y_M + behind_m, FACADE_Y_M + 4.0);
        self.block(wall, (west_m, east_m), front(0.0), (2.6, 7.0));
        self.block(wall, (west_m, west_m + 0.4), front(0.0), (0.0, 2.6));
        self.block(wall, (east_m - 0.4, east_m), front(0.0), (0.0, 2.6));
        let door_m = west_m + random.between(0.4, SHOP_WIDTH_M - 0.4 - 1.4);
        let door_m = (door_m, door_m + 1.4);
        for window_m in [(west_m + 0.4, door_m.0), (door_m.1, east_m - 0.4)] {
            self.block(Material::Wood, window_m, front(0.1), (0.0, 0.5));
            self.block(Material::Glass, window_m, front(0.2), (0.5, 2.6));
        }
        let door = if random.chance(0.5) { Material::Wood } else { Material::Glass };
        self.block(door, door_m, front(random.between(0.5, 1.1)), (0.0, 2.6));
        if random.chance(0.6) {
            let awning_m = (FACADE_Y_M - random.between(0.8, 1.3), FACADE_Y_M);
            self.block(Material::Awning, (west_m + 0.3, east_m - 0.3), awning_m, (2.2, 2.4));
        }
    }

    /// Two halls by the lawn, their walls parted by buttresses.
    fn halls(&mut self) {
        self.block(Material::Brick, (4.0, 24.0), (-28.0, -19.0), (0.0, 9.0));
        for bay in 0..6 {
            let west_m = 4.0 + 3.9 * f64::from(bay);
            self.block(Material::Render, (west_m, west_m + 0.5), (-19.0, -18.5), (0.0, 5.0));
        }
        self.block(Material::Render, (38.5, 50.0), (-22.0, -7.0), (0.0, 9.0));
        for bay in 0..4 {
            let south_m = -20.0 + 4.0 * f64::from(bay);
            self.block(Material::Brick, (38.0, 38.5), (south_m, south_m + 0.5), (0.0, 5.0));
        }
        // West of the shops and east of them the street goes on between walls.
        self.block(Material::Brick, (-12.0, -7.0), (FACADE_Y_M, FACADE_Y_M + 6.0), (0.0, 7.0));
        self.block(Material::Render, (43.0, 50.0), (8.5, FACADE_Y_M + 4.0), (0.0, 7.0));
    }

    /// Trees in the pavement, lamp posts, benches.
    fn street_furniture(&mut self) {
        for place in 0..6 {
            let x_m = 1.0 + 6.5 * f64::from(place);
            self.tree((x_m, 8.1), 0.14, 2.4, 1.8);
        }
        for place in 0..5 {
            self.post((4.2 + 6.5 * f64::from(place), -0.1));
        }
        for (x_m, y_m) in [(18.0, -11.8), (22.0, -11.4), (8.0, -16.8), (29.0, -13.2)] {
            let floor_m = self.ground.height_m(x_m, y_m);
            self.solids.push(Solid::block(
                Material::Wood,
                (x_m, y_m),
                floor_m + 0.38,
                [1.6, 0.45, 0.07],
                0.1,
            ));
            self.solids.push(Solid::block(Material::Wood, (x_m, y_m), floor_m - 0.2, [1.2, 0.10, 0.6], 0.1));
        }
    }

    fn post(&mut self, place: (f64, f64)) {
        let floor_m = self.ground.height_m(place.0, place.1) - SUNK_M;
        self.solids.push(Solid::column(Material::DarkPaint, place, floor_m, 0.07, 5.0));
    }

    /// Between lawn and south pavement, with gaps where people walk.
    fn hedges(&mut self) {
        for x_m in [(-8.0, 13.5), (20.5, 33.0)] {
            self.block(Material::Foliage, x_m, (-4.3, -3.5), (0.0, 1.2));
        }
    }

    /// Trees and shrubs on the lawn, clear of the route.
    fn trees(&mut self, random: &mut Random) {
        let route = route();
        let mut places: Vec<Vector2<f64>> = Vec::new();
        while places.len() < 46 {
            let place = Vector2::new(random.between(-8.0, 37.0), random.between(-30.0, -5.5));
            let is_in_hall = (3.0..25.0).contains(&place.x) && place.y < -17.5;
            let is_near = places.iter().any(|other| (other - place).norm() < 2.6);
            if is_in_hall || is_near || distance_to_route_m(&route, &place) < 1.6 {
                continue;
            }
            places.push(place);
            let place = (place.x, place.y);
            if random.chance(0.35) {
                let (radius_m, height_m) = (random.between(0.4, 0.9), random.between(0.8, 1.8));
                let floor_m = self.ground.height_m(place.0, place.1) - 0.1;
                self.solids.push(Solid::ellipsoid(Material::Foliage, place, floor_m, radius_m, height_m));
            } else {
                let trunk_m = random.between(0.12, 0.32);
                self.tree(place, trunk_m, random.between(1.4, 2.4), random.between(1.5, 3.0));
            }
        }
    }

    /// A trunk under a crown of three lobes.
    fn tree(&mut self, place: (f64, f64), trunk_radius_m: f64, clear_m: f64, crown_radius_m: f64) {
        let floor_m = self.ground.height_m(place.0, place.1);
        let trunk_m = SUNK_M + clear_m + crown_radius_m;
        self.solids.push(Solid::column(Material::Bark, place, floor_m - SUNK_M, trunk_radius_m, trunk_m));
        // Any turn will do, as long as neighbours differ.
        let turn_rad = 2.4 * self.solids.len() as f64;
        for (lobe, share) in [(0, 0.80), (1, 0.65), (2, 0.55)] {
            let (sin, cos) = libm::sincos(turn_rad + f64::from(lobe) * 2.1);
            let out_m = 0.5 * crown_radius_m;
            let middle = (place.0 + out_m * cos, place.1 + out_m * sin);
            let low_m = floor_m + clear_m + 0.25 * f64::from(lobe);
            let radius_m = share * crown_radius_m;
            self.solids.push(Solid::ellipsoid(Material::Foliage, middle, low_m, radius_m, 2.2 * radius_m));
        }
    }
}

/// Distance of a place from the nearest leg of a route.
fn distance_to_route_m(route: &[Vector2<f64>], place: &Vector2<f64>) -> f64 {
    let to_leg = |leg: &[Vector2<f64>]| {
        let along = leg[1] - leg[0];
        let share = ((place - leg[0]).dot(&along) / along.norm_squared()).clamp(0.0, 1.0);
        (leg[0] + along * share - place).norm()
    };
    route.windows(2).map(to_leg).fold(f64::INFINITY, f64::min)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn nothing_that_stays_stands_in_the_way() {
        let campus = Campus::new();
        let way: Vec<Vector2<f64>> = route()
            .windows(2)
            .flat_map(|leg| {
                (0..100).map(|share| leg[0].lerp(&leg[1], f64::from(share) / 100.0)).collect::<Vec<_>>()
            })
            .collect();
        for solid in &campus.solids {
            let corners = solid.body.corners();
            let ground_m = campus.ground.height_m(corners[0].x, corners[0].y);
            // Crowns and awnings are overhead.
            if corners[0].z - ground_m > 1.3 {
                continue;
            }
            let (low, high) = corners
                .iter()
                .fold((corners[0], corners[0]), |(low, high), corner| (low.inf(corner), high.sup(corner)));
            let apart_m = |place: &Vector2<f64>| (place - place.sup(&low.xy()).inf(&high.xy())).norm();
            let nearest_m = way.iter().map(apart_m).fold(f64::INFINITY, f64::min);
            assert!(nearest_m > 0.6, "{nearest_m} m: {solid:?}");
        }
    }

    #[test]
    fn the_ground_is_never_steeper_than_one_in_eight() {
        let ground = Campus::new().ground;
        for (x, y) in (-10..50).flat_map(|x| (-30..20).map(move |y| (f64::from(x) + 0.3, f64::from(y) + 0.7)))
        {
            let normal = ground.normal(x, y);
            let slope = normal.xy().norm() / normal.z;
            assert!(slope < 0.125, "{slope} at {x}, {y}");
        }
    }
}
