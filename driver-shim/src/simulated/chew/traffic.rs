//! What differs from trip to trip: cars that are parked or pass, people, boards and shutters.

use nalgebra::Vector2;

use super::super::random::{Random, Streams};
use super::ground::Ground;
use super::material::Material;
use super::solid::Solid;

/// The street on which cars pass goes from here…
const STREET_WEST_M: f64 = -60.0;
/// …so far to the east. A car that leaves it comes back at the other end.
const STREET_LENGTH_M: f64 = 160.0;
/// Cars in each lane.
const N_CARS_IN_LANE: usize = 3;
/// Lanes: y, and the sign of the direction along x. Traffic keeps to the right.
const LANES: [(f64, f64); 2] = [(3.2, 1.0), (4.9, -1.0)];

/// While a robot is between these y, on the street or about to be, cars stop for it.
const CROSSING_Y_M: (f64, f64) = (-0.7, 8.7);
/// Cars that are nearer to it drive on: their way is past it before it is there.
const PASSING_M: f64 = 7.0;
/// So far, between middles, cars stand from what is ahead. While it crosses, the robot comes up to 2 m nearer.
const STANDING_M: f64 = 10.0;

/// People give a robot this much room.
const ROOM_M: f64 = 1.0;
/// Where people walk: from, to; to and fro.
const WALKS: [((f64, f64), (f64, f64)); 12] = [
    ((-6.0, 10.5), (40.0, 10.6)),
    ((38.0, 10.4), (-2.0, 10.5)),
    ((10.0, 10.6), (30.0, 10.4)),
    ((-8.0, 8.7), (40.0, 8.8)),
    ((30.0, 8.7), (5.0, 8.7)),
    ((-6.0, -0.6), (42.0, -0.7)),
    ((34.0, -2.6), (-5.0, -2.7)),
    ((38.8, -2.0), (38.8, 10.0)),
    ((-4.4, 9.0), (-4.4, -2.5)),
    ((2.0, -12.6), (27.0, -11.9)),
    ((26.0, -16.0), (4.0, -15.0)),
    ((18.4, -4.0), (27.0, -20.0)),
];

/// Everything that may be elsewhere on another trip.
pub(super) struct Traffic {
    cars: Vec<Car>,
    walkers: Vec<Walker>,
    /// What stays where it is for this trip.
    n_parked: usize,
    /// First what is parked, then what moves, as of now.
    solids: Vec<Solid>,
}

/// A car that passes.
struct Car {
    lane: usize,
    /// Along the lane, from where it begins, 0…[`STREET_LENGTH_M`].
    along_m: f64,
    cruise_m_s: f64,
    speed_m_s: f64,
    paint: Material,
}

/// Somebody who walks to and fro.
struct Walker {
    from: Vector2<f64>,
    to: Vector2<f64>,
    walked_m: f64,
    speed_m_s: f64,
    height_m: f64,
    clothes: [Material; 2],
    /// Where they stand, having made room.
    place: Vector2<f64>,
}

impl Traffic {
    pub(super) fn new(streams: &Streams, ground: &Ground) -> Self {
        let mut solids = Vec::new();
        park_cars(&mut streams.named("parked cars"), ground, &mut solids);
        put_boards(&mut streams.named("boards"), ground, &mut solids);
        let mut random = streams.named("passing cars");
        let mut cars = Vec::new();
        for lane in 0..LANES.len() {
            let cruise_m_s = random.between(6.0, 9.0);
            for place in 0..N_CARS_IN_LANE {
                let spacing_m = STREET_LENGTH_M / N_CARS_IN_LANE as f64;
                let along_m = spacing_m * (place as f64 + random.between(0.0, 0.6));
                cars.push(Car {
                    lane,
                    along_m,
                    cruise_m_s,
                    speed_m_s: cruise_m_s,
                    paint: paint(&mut random),
                });
            }
        }
        let mut random = streams.named("people");
        let mut walkers = Vec::new();
        for walk in &WALKS {
            let (is_out, walker) = (random.chance(0.8), Walker::new(walk, &mut random));
            if is_out {
                walkers.push(walker);
            }
        }
        let mut traffic = Self { cars, walkers, n_parked: solids.len(), solids };
        traffic.place_all(ground);
        traffic
    }

    /// Lets `elapsed_s` pass, with a robot at `robot` that all take care of.
    pub(super) fn advance(&mut self, elapsed_s: f64, robot: Vector2<f64>, ground: &Ground) {
        for index in 0..self.cars.len() {
            let clear_m = self.clear_m(index, robot);
            let car = &mut self.cars[index];
            // Means to brake at 4 m/s², and brakes harder for a robot that it sees late.
            let safe_m_s = (2.0 * 4.0 * (clear_m - STANDING_M).max(0.0)).sqrt();
            car.speed_m_s = (car.speed_m_s + 2.0 * elapsed_s).min(car.cruise_m_s).min(safe_m_s);
            car.along_m = (car.along_m + car.speed_m_s * elapsed_s) % STREET_LENGTH_M;
        }
        for walker in &mut self.walkers {
            walker.advance(elapsed_s, robot);
        }
        self.place_all(ground);
    }

    /// What stands and moves about, as of now.
    pub(super) fn solids(&self) -> &[Solid] {
        &self.solids
    }

    /// How far it is to the next thing ahead in a car's lane.
    fn clear_m(&self, index: usize, robot: Vector2<f64>) -> f64 {
        let car = &self.cars[index];
        let (_, sign) = LANES[car.lane];
        let others = self.cars.iter().enumerate().filter(|(other, _)| *other != index);
        let ahead = others.filter(|(_, other)| other.lane == car.lane).map(|(_, other)| other.along_m);
        let to = |along_m: f64| (along_m - car.along_m + STREET_LENGTH_M) % STREET_LENGTH_M;
        let is_crossing = (CROSSING_Y_M.0..CROSSING_Y_M.1).contains(&robot.y);
        let to_robot_m = is_crossing.then(|| to(along_m(sign, robot.x))).filter(|to_m| *to_m > PASSING_M);
        ahead.map(to).chain(to_robot_m).fold(STREET_LENGTH_M, f64::min)
    }

    fn place_all(&mut self, ground: &Ground) {
        self.solids.truncate(self.n_parked);
        for car in &self.cars {
            let (y_m, sign) = LANES[car.lane];
            place_car((x_m(sign, car.along_m), y_m), sign, car.paint, ground, &mut self.solids);
        }
        for walker in &self.walkers {
            walker.place_body(ground, &mut self.solids);
        }
    }
}

/// How far along a lane in direction `sign` a place is.
fn along_m(sign: f64, x_m: f64) -> f64 {
    let from_west_m = x_m - STREET_WEST_M;
    if sign > 0.0 { from_west_m } else { STREET_LENGTH_M - from_west_m }
}

/// Where a place along a lane is: the same formula.
fn x_m(sign: f64, along_m: f64) -> f64 {
    let from_west_m = if sign > 0.0 { along_m } else { STREET_LENGTH_M - along_m };
    STREET_WEST_M + from_west_m
}

impl Walker {
    fn new((from, to): &((f64, f64), (f64, f64)), random: &mut Random) -> Self {
        let mut sideways = || random.between(-0.15, 0.15);
        let from = Vector2::new(from.0, from.1 + sideways());
        let to = Vector2::new(to.0, to.1 + sideways());
        let walked_m = random.between(0.0, 2.0 * (to - from).norm());
        let mut cloth = || if random.chance(0.5) { Material::DarkCloth } else { Material::LightCloth };
        let clothes = [cloth(), cloth()];
        let (speed_m_s, height_m) = (random.between(0.9, 1.6), random.between(1.55, 1.9));
        Self { from, to, walked_m, speed_m_s, height_m, clothes, place: from }
    }

    fn advance(&mut self, elapsed_s: f64, robot: Vector2<f64>) {
        self.walked_m += self.speed_m_s * elapsed_s;
        let length_m = (self.to - self.from).norm();
        let share = (self.walked_m / length_m) % 2.0;
        let share = if share > 1.0 { 2.0 - share } else { share };
        let place = self.from + (self.to - self.from) * share;
        let apart = place - robot;
        let apart_m = apart.norm();
        self.place =
            if apart_m < ROOM_M && apart_m > 0.0 { robot + apart * (ROOM_M / apart_m) } else { place };
    }

    /// Two legs that swing as they walk, a trunk and a head.
    fn place_body(&self, ground: &Ground, solids: &mut Vec<Solid>) {
        let forward = (self.to - self.from).normalize();
        let (step, _) = libm::sincos(self.walked_m * (std::f64::consts::TAU / 1.4));
        let floor_m = ground.height_m(self.place.x, self.place.y);
        let (hip_m, shoulder_m) = (0.5 * self.height_m, 0.85 * self.height_m);
        for side in [-1.0, 1.0] {
            let across = Vector2::new(-forward.y, forward.x) * (0.1 * side);
            let foot = self.place + across + forward * (0.22 * step * side);
            solids.push(Solid::column(self.clothes[0], (foot.x, foot.y), floor_m - 0.1, 0.08, hip_m + 0.1));
        }
        let place = (self.place.x, self.place.y);
        let trunk_m = shoulder_m - hip_m;
        solids.push(Solid::column(self.clothes[1], place, floor_m + hip_m, 0.19, trunk_m));
        let head_m = self.height_m - shoulder_m;
        solids.push(Solid::ellipsoid(Material::LightCloth, place, floor_m + shoulder_m, 0.1, head_m));
    }
}

/// Cars along both kerbs, two places in three taken, clear of the crossings.
fn park_cars(random: &mut Random, ground: &Ground, solids: &mut Vec<Solid>) {
    for (y_m, sign) in [(1.4, 1.0), (6.7, -1.0)] {
        for place in 0..5 {
            let x_m = 3.5 + 6.3 * f64::from(place) + random.between(-0.5, 0.5);
            let (paint, is_taken) = (paint(random), random.chance(0.67));
            if is_taken {
                place_car((x_m, y_m), sign, paint, ground, solids);
            }
        }
    }
}

/// Boards before some of the shops.
fn put_boards(random: &mut Random, ground: &Ground, solids: &mut Vec<Solid>) {
    for place in 0..8 {
        let x_m = -3.0 + 5.0 * f64::from(place) + random.between(0.0, 3.0);
        let yaw_rad = random.between(-0.4, 0.4);
        if random.chance(0.4) {
            let floor_m = ground.height_m(x_m, 10.8);
            solids.push(Solid::block(Material::Wood, (x_m, 10.8), floor_m, [0.3, 0.6, 1.0], yaw_rad));
        }
    }
}

fn paint(random: &mut Random) -> Material {
    if random.chance(0.5) { Material::DarkPaint } else { Material::LightPaint }
}

/// A car: body and cabin on four wheels, facing along x in direction `sign`.
fn place_car(place: (f64, f64), sign: f64, paint: Material, ground: &Ground, solids: &mut Vec<Solid>) {
    let floor_m = ground.height_m(place.0, place.1);
    let behind = |back_m: f64, left_m: f64| (place.0 - sign * back_m, place.1 + left_m);
    solids.push(Solid::block(paint, place, floor_m + 0.25, [4.3, 1.75, 0.6], 0.0));
    solids.push(Solid::block(Material::Glass, behind(0.3, 0.0), floor_m + 0.85, [2.3, 1.5, 0.5], 0.0));
    solids.push(Solid::block(paint, behind(0.3, 0.0), floor_m + 1.35, [2.1, 1.5, 0.08], 0.0));
    for (back_m, left_m) in [(-1.4, -0.8), (-1.4, 0.8), (1.4, -0.8), (1.4, 0.8)] {
        solids.push(Solid::block(Material::Tyre, behind(back_m, left_m), floor_m, [0.55, 0.18, 0.55], 0.0));
    }
}
