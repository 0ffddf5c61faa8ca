//! The fourth floor, 34 m × 20 m.
//!
//! ```text
//! y 20 ┌────────┬────┬────┬────┬──────────┬────┬────────┐
//!      │ offices     │    │    │ meeting  │    │        │
//! 15.8 ├───┬─ ──┴─ ──┴─ ──┴─ ──┴─── ──────┴ ───┴ ─┬─────┤
//!      │   │  north corridor                      │     │
//! 13.8 │   │  ┌── ───────┐  ┌─────────┬────────┐  │     │
//!      ├─  │  │  atrium  ┊  │ kitchen │  lab      │     │
//!      │      ·   o   o  ┊  ├─────────┤        │  ├─────┤
//!      │      ·   o   o  ┊  │ copier  │        │  │     │
//!  5.9 ├─  │  └───    ───┘  └─────────┴─ ──────┘  │     │
//!      │   │  south corridor                      │     │
//!  4.2 ├───┴─ ──┬ ───┬ ───┬── ────┬─ ──┬─ ──┬ ────┴─────┤
//!      │ conf.  │    │    │ office│    │    │            │
//!  y 0 └────────┴────┴────┴───────┴────┴────┴────────────┘
//!     x 0  4.5 6.3        14 15.8     20.5   27.7 29.5  34
//! ```

use super::plan::{Area, Block, Door, Partition, Pillar, Plan, Swing, doorway, passage, wall, wall_with};
use crate::simulated::world::Surface;

const NORTH: Door = Door::Either(Swing::NorthWest);
const SOUTH: Door = Door::Either(Swing::SouthEast);
const WEST: Door = Door::Either(Swing::NorthWest);
const EAST: Door = Door::Either(Swing::SouthEast);

pub(super) const PLAN: Plan =
    Plan { partitions: PARTITIONS, furniture: FURNITURE, pillars: PILLARS, areas: AREAS, route: ROUTE };

const PARTITIONS: &[Partition] = &[
    // Outside.
    wall([0.0, 0.0], [34.0, 0.0], Surface::BRICK),
    wall([0.0, 20.0], [34.0, 20.0], Surface::BRICK),
    wall([0.0, 0.0], [0.0, 20.0], Surface::BRICK),
    wall([34.0, 0.0], [34.0, 20.0], Surface::BRICK),
    // Southern rooms.
    wall_with(
        [0.0, 4.2],
        [34.0, 4.2],
        Surface::PLASTER,
        &[
            doorway(6.5, SOUTH),
            doorway(9.8, SOUTH),
            doorway(13.2, SOUTH),
            doorway(17.5, Door::HeldOpen(Swing::SouthEast)),
            doorway(21.5, SOUTH),
            doorway(25.2, SOUTH),
            doorway(28.4, SOUTH),
        ],
    ),
    wall([8.0, 0.0], [8.0, 4.2], Surface::PLASTER),
    wall([11.5, 0.0], [11.5, 4.2], Surface::PLASTER),
    wall([15.0, 0.0], [15.0, 4.2], Surface::PLASTER),
    wall([20.0, 0.0], [20.0, 4.2], Surface::PLASTER),
    wall([23.5, 0.0], [23.5, 4.2], Surface::PLASTER),
    wall([27.0, 0.0], [27.0, 4.2], Surface::PLASTER),
    // Northern rooms.
    wall_with(
        [0.0, 15.8],
        [34.0, 15.8],
        Surface::PLASTER,
        &[
            doorway(6.2, NORTH),
            doorway(9.2, NORTH),
            doorway(12.7, NORTH),
            doorway(16.2, NORTH),
            doorway(21.0, Door::HeldOpen(Swing::NorthWest)),
            doorway(25.7, NORTH),
            doorway(28.5, NORTH),
        ],
    ),
    wall([7.5, 15.8], [7.5, 20.0], Surface::PLASTER),
    wall([11.0, 15.8], [11.0, 20.0], Surface::PLASTER),
    wall([14.5, 15.8], [14.5, 20.0], Surface::PLASTER),
    wall([18.0, 15.8], [18.0, 20.0], Surface::PLASTER),
    wall([24.0, 15.8], [24.0, 20.0], Surface::PLASTER),
    wall([27.5, 15.8], [27.5, 20.0], Surface::PLASTER),
    // Western and eastern rooms.
    wall_with(
        [4.5, 4.2],
        [4.5, 15.8],
        Surface::PLASTER,
        &[doorway(6.5, WEST), doorway(10.0, Door::HeldOpen(Swing::NorthWest)), doorway(14.0, WEST)],
    ),
    wall([0.0, 8.0], [4.5, 8.0], Surface::PLASTER),
    wall([0.0, 12.0], [4.5, 12.0], Surface::PLASTER),
    wall_with([29.5, 4.2], [29.5, 15.8], Surface::PLASTER, &[doorway(7.0, EAST), doorway(12.5, EAST)]),
    wall([29.5, 10.0], [34.0, 10.0], Surface::PLASTER),
    // Atrium.
    wall_with([6.3, 5.9], [6.3, 13.8], Surface::BRICK, &[passage(10.0, 3.2)]),
    wall_with([6.3, 5.9], [14.0, 5.9], Surface::BRICK, &[passage(10.2, 3.6)]),
    wall_with([6.3, 13.8], [14.0, 13.8], Surface::BRICK, &[passage(8.0, 1.6)]),
    wall([14.0, 5.9], [14.0, 13.8], Surface::GLASS),
    // Kitchen, copier and laboratory.
    wall_with([15.8, 5.9], [27.7, 5.9], Surface::PLASTER, &[doorway(22.5, Door::HeldOpen(Swing::NorthWest))]),
    wall([15.8, 13.8], [27.7, 13.8], Surface::PLASTER),
    wall_with([15.8, 5.9], [15.8, 13.8], Surface::PLASTER, &[doorway(8.2, EAST), doorway(11.8, EAST)]),
    wall([15.8, 10.0], [20.5, 10.0], Surface::PLASTER),
    wall([20.5, 5.9], [20.5, 13.8], Surface::PLASTER),
    wall_with(
        [27.7, 5.9],
        [27.7, 13.8],
        Surface::PLASTER,
        &[doorway(11.5, Door::HeldOpen(Swing::NorthWest))],
    ),
];

const FURNITURE: &[Block] = &[
    // Start office: desk and cupboard.
    Block([0.1, 8.1], [1.6, 8.9], Surface::WOOD),
    Block([0.1, 11.3], [2.4, 11.9], Surface::METAL),
    // Conference room.
    Block([2.0, 1.4], [5.6, 2.7], Surface::WOOD),
    // The office that is visited: desk, shelves.
    Block([18.9, 2.4], [19.9, 4.0], Surface::WOOD),
    Block([15.1, 3.0], [15.5, 4.1], Surface::METAL),
    // Meeting room.
    Block([18.1, 19.0], [23.9, 19.9], Surface::WOOD),
    Block([23.3, 16.2], [23.9, 18.0], Surface::FABRIC),
    // Copier and kitchen.
    Block([16.0, 6.3], [18.0, 7.1], Surface::METAL),
    Block([17.0, 13.1], [20.4, 13.7], Surface::WOOD),
    // Laboratory: benches, racks.
    Block([20.7, 9.9], [23.2, 10.8], Surface::METAL),
    Block([20.7, 12.6], [24.6, 13.6], Surface::METAL),
    Block([25.2, 6.4], [27.5, 7.4], Surface::WOOD),
    // Atrium: a bench. Corridors: lockers, a vending machine, a copier.
    Block([12.9, 7.0], [13.6, 11.6], Surface::FABRIC),
    Block([8.6, 4.26], [9.2, 4.5], Surface::METAL),
    Block([17.0, 15.2], [18.2, 15.7], Surface::METAL),
    Block([29.0, 4.6], [29.4, 6.0], Surface::WOOD),
];

const PILLARS: &[Pillar] = &[
    Pillar { at: [8.2, 8.2], radius_m: 0.3, surface: Surface::BRICK },
    Pillar { at: [11.8, 8.2], radius_m: 0.3, surface: Surface::BRICK },
    Pillar { at: [8.2, 12.0], radius_m: 0.3, surface: Surface::BRICK },
    Pillar { at: [11.8, 12.0], radius_m: 0.3, surface: Surface::BRICK },
    // Plant pots.
    Pillar { at: [6.8, 6.8], radius_m: 0.25, surface: Surface::WOOD },
    Pillar { at: [13.3, 13.1], radius_m: 0.25, surface: Surface::WOOD },
];

const AREAS: &[Area] = &[
    Area { low: [6.6, 6.5], high: [13.7, 13.5], n_people_max: 5, n_chairs_max: 6 },
    Area { low: [5.0, 14.1], high: [29.0, 15.5], n_people_max: 4, n_chairs_max: 1 },
    Area { low: [27.9, 6.4], high: [29.2, 13.6], n_people_max: 2, n_chairs_max: 0 },
    Area { low: [0.3, 8.3], high: [4.2, 11.7], n_people_max: 1, n_chairs_max: 3 },
    Area { low: [15.3, 0.3], high: [19.7, 3.9], n_people_max: 1, n_chairs_max: 3 },
    Area { low: [18.3, 16.1], high: [23.7, 19.7], n_people_max: 3, n_chairs_max: 6 },
    Area { low: [20.8, 6.5], high: [27.4, 13.5], n_people_max: 3, n_chairs_max: 6 },
];

const ROUTE: &[[f64; 2]] = &[
    // From the office through the western corridor and the southern one.
    [1.2, 10.0],
    [5.3, 10.0],
    [5.4, 5.05],
    [14.9, 5.05],
    // Through the glazed cross corridor, into the meeting room and around in it.
    [14.9, 14.7],
    [21.0, 14.7],
    [21.0, 17.1],
    [22.3, 17.8],
    [21.0, 18.4],
    [19.7, 17.9],
    [21.0, 17.1],
    [21.0, 14.7],
    // Down the eastern corridor and through the laboratory.
    [28.6, 14.7],
    [28.6, 11.5],
    [26.2, 11.5],
    [24.4, 9.4],
    [22.5, 8.4],
    [22.5, 5.05],
    // Into an office and out again, into the atrium, between its pillars and out to the west.
    [17.5, 5.05],
    [17.5, 2.8],
    [18.1, 1.5],
    [16.7, 1.3],
    [17.5, 2.8],
    [17.5, 5.05],
    [10.2, 5.05],
    [10.2, 10.0],
    [5.4, 10.0],
    // Around by the north, back through the cross corridor, and home the way it came.
    [5.4, 14.7],
    [14.9, 14.7],
    [14.9, 5.05],
    [5.4, 5.05],
    [5.4, 10.0],
    [1.2, 10.0],
];
