//! From a floor's plan to what stands on it during one trip.
//!
//! Plans are axis-aligned, in metres, x east, y north.

use nalgebra::Vector2;

use crate::simulated::angle::{direction, left_of, turned};
use crate::simulated::random::{Random, Streams};
use crate::simulated::world::{Surface, Wall};

/// A floor before anyone has come in.
pub(super) struct Plan {
    pub(super) partitions: &'static [Partition],
    pub(super) furniture: &'static [Block],
    pub(super) pillars: &'static [Pillar],
    pub(super) areas: &'static [Area],
    /// Waypoints of the route.
    pub(super) route: &'static [[f64; 2]],
}

/// A straight wall from its west or south end to the other.
pub(super) struct Partition {
    pub(super) from: [f64; 2],
    pub(super) to: [f64; 2],
    pub(super) surface: Surface,
    /// In order along the wall.
    pub(super) gaps: &'static [Gap],
}

/// A gap in a wall.
pub(super) struct Gap {
    /// Its middle: x or y, along whichever the wall runs.
    pub(super) at: f64,
    pub(super) width_m: f64,
    pub(super) door: Door,
}

/// What closes a gap.
#[derive(Clone, Copy)]
pub(super) enum Door {
    /// Nothing.
    None,
    /// A door that is held open, wide enough to drive through.
    HeldOpen(Swing),
    /// A door that is open on some trips and shut on others.
    Either(Swing),
}

/// The side to which a door opens: north or west of its wall, or south or east.
#[derive(Clone, Copy)]
pub(super) enum Swing {
    NorthWest,
    SouthEast,
}

/// A piece of furniture from its south-west to its north-east corner.
pub(super) struct Block(pub(super) [f64; 2], pub(super) [f64; 2], pub(super) Surface);

/// A round pillar or plant pot.
pub(super) struct Pillar {
    pub(super) at: [f64; 2],
    pub(super) radius_m: f64,
    pub(super) surface: Surface,
}

/// A part of the floor, from its south-west to its north-east corner, in which people stand and chairs are left.
pub(super) struct Area {
    pub(super) low: [f64; 2],
    pub(super) high: [f64; 2],
    pub(super) n_people_max: u32,
    pub(super) n_chairs_max: u32,
}

/// A plain wall.
pub(super) const fn wall(from: [f64; 2], to: [f64; 2], surface: Surface) -> Partition {
    Partition { from, to, surface, gaps: &[] }
}

/// A wall with gaps.
pub(super) const fn wall_with(
    from: [f64; 2],
    to: [f64; 2],
    surface: Surface,
    gaps: &'static [Gap],
) -> Partition {
    Partition { from, to, surface, gaps }
}

/// A doorway of the usual width.
pub(super) const fn doorway(at: f64, door: Door) -> Gap {
    Gap { at, width_m: 1.0, door }
}

/// A passage without a door.
pub(super) const fn passage(at: f64, width_m: f64) -> Gap {
    Gap { at, width_m, door: Door::None }
}

const HALF_WALL_M: f64 = 0.06;
const LEG_RADIUS_M: f64 = 0.07;
const HALF_STANCE_M: f64 = 0.12;
const CHAIR_RADIUS_M: f64 = 0.22;
/// Nothing that comes and goes has its middle nearer to the route: people see a robot coming.
const KEPT_OFF_ROUTE_M: f64 = 0.7;
/// Nor nearer to anything else.
const KEPT_OFF_WALLS_M: f64 = 0.3;
const OPEN_SHARE: f64 = 0.4;

impl Plan {
    pub(super) fn route(&self) -> Vec<Vector2<f64>> {
        self.route.iter().copied().map(Vector2::from).collect()
    }

    /// Everything that stands on the floor during the trip of these streams.
    pub(super) fn walls(&self, streams: &Streams) -> Vec<Wall> {
        let mut walls = Vec::new();
        let mut n_doors = 0;
        for partition in self.partitions {
            partition.build(&mut walls, |door| {
                n_doors += 1;
                door.angle_rad(&mut streams.numbered("door", n_doors))
            });
        }
        for Block(low, high, surface) in self.furniture {
            let (low, high) = (Vector2::from(*low), Vector2::from(*high));
            build_box(&mut walls, low, Vector2::new(high.x, low.y), 0.0, high.y - low.y, *surface);
        }
        for pillar in self.pillars {
            walls.extend(Wall::ring(pillar.at.into(), pillar.radius_m, 12, pillar.surface));
        }
        for (index, area) in self.areas.iter().enumerate() {
            self.fill(&mut walls, area, &mut streams.numbered("people and chairs", index));
        }
        walls
    }

    fn fill(&self, walls: &mut Vec<Wall>, area: &Area, random: &mut Random) {
        let mut number_up_to = |most: u32| random.between(0.0, f64::from(most + 1)) as u32;
        let (n_people, n_chairs) = (number_up_to(area.n_people_max), number_up_to(area.n_chairs_max));
        for index in 0..n_people + n_chairs {
            let Some(place) = self.free_place(walls, area, random) else { continue };
            if index < n_people {
                let aside =
                    HALF_STANCE_M * direction(random.between(-std::f64::consts::PI, std::f64::consts::PI));
                for foot in [place - aside, place + aside] {
                    walls.extend(Wall::ring(foot, LEG_RADIUS_M, 8, Surface::FABRIC));
                }
            } else {
                walls.extend(Wall::ring(place, CHAIR_RADIUS_M, 8, Surface::FABRIC));
            }
        }
    }

    /// A place off the route and off everything; in a crowded area there may be none in a few tries.
    fn free_place(&self, walls: &[Wall], area: &Area, random: &mut Random) -> Option<Vector2<f64>> {
        const N_TRIES: usize = 20;
        let route = self.route();
        (0..N_TRIES).find_map(|_| {
            let [x, y] = std::array::from_fn(|axis| random.between(area.low[axis], area.high[axis]));
            let place = Vector2::new(x, y);
            let is_off_route = route.windows(2).all(|leg| {
                let leg = Wall { from: leg[0], to: leg[1], surface: Surface::PLASTER };
                leg.distance_m(place) >= KEPT_OFF_ROUTE_M
            });
            let is_within = |Block(low, high, _): &Block| {
                (low[0]..high[0]).contains(&x) && (low[1]..high[1]).contains(&y)
            };
            let is_free = || {
                !self.furniture.iter().any(is_within)
                    && walls.iter().all(|wall| wall.distance_m(place) >= KEPT_OFF_WALLS_M)
            };
            (is_off_route && is_free()).then_some(place)
        })
    }
}

impl Partition {
    /// Builds the wall between its gaps, and doors at the angles given.
    fn build(&self, walls: &mut Vec<Wall>, mut angle_rad: impl FnMut(Door) -> f64) {
        let (from, to) = (Vector2::from(self.from), Vector2::from(self.to));
        let ahead = (to - from).normalize();
        let start = from.dot(&ahead);
        let at = |along: f64| from + (along - start) * ahead;
        let mut solid_from = start;
        for gap in self.gaps {
            let (gap_from, gap_to) = (gap.at - 0.5 * gap.width_m, gap.at + 0.5 * gap.width_m);
            build_box(walls, at(solid_from), at(gap_from), -HALF_WALL_M, HALF_WALL_M, self.surface);
            solid_from = gap_to;
            if !matches!(gap.door, Door::None) {
                let leaf = gap.width_m * turned(ahead, direction(angle_rad(gap.door)));
                walls.push(Wall { from: at(gap_from), to: at(gap_from) + leaf, surface: Surface::WOOD });
            }
        }
        build_box(walls, at(solid_from), to, -HALF_WALL_M, HALF_WALL_M, self.surface);
    }
}

impl Door {
    /// Angle between the shut and the present door, counter-clockwise.
    fn angle_rad(self, random: &mut Random) -> f64 {
        let (is_open, wide, narrow) =
            (random.chance(OPEN_SHARE), random.between(95.0, 115.0), random.between(50.0, 110.0));
        let (swing, degrees) = match self {
            Self::None => return 0.0,
            Self::HeldOpen(swing) => (swing, wide),
            Self::Either(swing) => (swing, if is_open { narrow } else { 0.0 }),
        };
        let sign = match swing {
            Swing::NorthWest => 1.0,
            Swing::SouthEast => -1.0,
        };
        sign * degrees * std::f64::consts::PI / 180.0
    }
}

/// The four sides of a box about a line, so far to its right (below 0) and left.
fn build_box(
    walls: &mut Vec<Wall>,
    from: Vector2<f64>,
    to: Vector2<f64>,
    right_m: f64,
    left_m: f64,
    surface: Surface,
) {
    let left = left_of((to - from).normalize());
    let corners = [from + right_m * left, to + right_m * left, to + left_m * left, from + left_m * left];
    walls.extend((0..4).map(|side| Wall { from: corners[side], to: corners[(side + 1) % 4], surface }));
}

#[cfg(test)]
mod tests {
    use super::*;

    fn streams(trip: u32) -> Streams {
        Streams::new("plan", trip, 7)
    }

    static PARTITIONS: [Partition; 1] = [wall_with(
        [1.0, 2.0],
        [9.0, 2.0],
        Surface::PLASTER,
        &[passage(4.0, 2.0), doorway(7.5, Door::Either(Swing::SouthEast))],
    )];
    static AREAS: [Area; 1] = [Area { low: [0.0, 3.0], high: [9.0, 9.0], n_people_max: 6, n_chairs_max: 6 }];
    static PLAN: Plan = Plan {
        partitions: &PARTITIONS,
        furniture: &[],
        pillars: &[],
        areas: &AREAS,
        route: &[[0.0, 6.0], [9.0, 6.0]],
    };

    #[test]
    fn a_wall_is_solid_but_for_its_gaps() {
        let walls = PLAN.walls(&streams(1));
        let on_line = |x: f64| {
            let distance = |wall: &Wall| wall.distance_m(Vector2::new(x, 2.0));
            walls
                .iter()
                .filter(|wall| wall.surface == Surface::PLASTER)
                .map(distance)
                .fold(f64::INFINITY, f64::min)
        };
        // Within a wall its faces are half its thickness away, in the middle of a gap its jambs half the gap.
        for (x, expected_m) in [(2.0, 0.06), (4.0, 1.0), (6.0, 0.06), (7.5, 0.5), (8.5, 0.06)] {
            assert!((on_line(x) - expected_m).abs() < 1e-12, "at {x} m: {} m", on_line(x));
        }
    }

    #[test]
    fn doors_are_shut_on_some_trips_and_open_to_their_side_on_others() {
        let doors: Vec<Wall> = (0..200)
            .filter_map(|trip| {
                PLAN.walls(&streams(trip)).into_iter().find(|wall| wall.surface == Surface::WOOD)
            })
            .collect();
        assert_eq!(doors.len(), 200);
        let n_shut = doors.iter().filter(|door| door.to == Vector2::new(8.0, 2.0)).count();
        // Five standard errors of 200 draws at 0.6.
        assert!((85..=155).contains(&n_shut), "{n_shut}");
        for door in doors {
            assert_eq!(door.from, Vector2::new(7.0, 2.0));
            assert!(door.to.y <= 2.0, "opens to the south");
            assert!(((door.to - door.from).norm() - 1.0).abs() < 1e-12);
        }
    }

    #[test]
    fn people_and_chairs_keep_off_the_route_and_differ_between_trips() {
        let soft = |trip| -> Vec<Wall> {
            PLAN.walls(&streams(trip)).into_iter().filter(|wall| wall.surface == Surface::FABRIC).collect()
        };
        for trip in 0..50 {
            for piece in soft(trip) {
                // A middle keeps off by 0.7 m; a corner of a chair reaches 0.22 m / cos 22.5° from it.
                let off_m = (piece.from.y - 6.0).abs();
                assert!(off_m >= KEPT_OFF_ROUTE_M - 0.2382, "trip {trip}: {off_m} m off the route");
            }
        }
        assert_ne!(soft(1), soft(2));
    }
}
