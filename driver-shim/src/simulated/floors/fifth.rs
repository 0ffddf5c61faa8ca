//! The fifth floor, 34 m × 20 m.
//!
//! ```text
//! y 20 ┌──────────┬──────────┬─────────┬──┬──────────────────┐
//!      │ lounge   │ office   │ office     library             │
//! 15.8 ├── ───────┴ ──────── ┤         │  ├────────── ───────┤ 15.5
//!      │  gallery            ├─────────┤  │ office │ office  │
//! 13.6 │   ┌────────────┐    │            │        │         │
//!      │   │            │    ├── ────────┘  └─ ──────┴─ ──────┤ 10.7
//!      │   │    void    │       corridor                      │
//!      │   │            │    ├─ ────┬── ─────┬─ ────┬── ──────┤ 9
//!  6.4 │   └────────────┘    │office│ office │ store│ seminar │
//!      │  gallery            ├──────┴────────┴──────┤         │ 4.2
//!  4.2 ├─ ────┬── ────┬── ───┤   plant              │         │
//!      │      │       │      │                      │         │
//!  y 0 └──────┴───────┴──────┴──────────────────────┴─────────┘
//!     x 0 2.4 4       8  9.6 12     16  19 20  21   26       34
//! ```

use super::plan::{Area, Block, Door, Partition, Pillar, Plan, Swing, doorway, passage, wall, wall_with};
use crate::simulated::world::Surface;

const NORTH: Door = Door::Either(Swing::NorthWest);
const SOUTH: Door = Door::Either(Swing::SouthEast);
const WEST: Door = Door::Either(Swing::NorthWest);

pub(super) const PLAN: Plan =
    Plan { partitions: PARTITIONS, furniture: FURNITURE, pillars: PILLARS, areas: AREAS, route: ROUTE };

const PARTITIONS: &[Partition] = &[
    // Outside: the gallery has a window to the west, the corridor and the cross corridor end in one each.
    wall([0.0, 0.0], [34.0, 0.0], Surface::BRICK),
    wall([0.0, 20.0], [19.0, 20.0], Surface::BRICK),
    wall([19.0, 20.0], [21.0, 20.0], Surface::GLASS),
    wall([21.0, 20.0], [34.0, 20.0], Surface::BRICK),
    wall([0.0, 0.0], [0.0, 4.2], Surface::BRICK),
    wall([0.0, 4.2], [0.0, 15.8], Surface::GLASS),
    wall([0.0, 15.8], [0.0, 20.0], Surface::BRICK),
    wall([34.0, 0.0], [34.0, 9.0], Surface::BRICK),
    wall([34.0, 9.0], [34.0, 10.7], Surface::GLASS),
    wall([34.0, 10.7], [34.0, 20.0], Surface::BRICK),
    // Rooms about the gallery.
    wall_with(
        [0.0, 4.2],
        [12.0, 4.2],
        Surface::PLASTER,
        &[doorway(2.0, SOUTH), doorway(6.0, Door::HeldOpen(Swing::SouthEast)), doorway(10.0, SOUTH)],
    ),
    wall([4.0, 0.0], [4.0, 4.2], Surface::PLASTER),
    wall([8.0, 0.0], [8.0, 4.2], Surface::PLASTER),
    wall([12.0, 0.0], [12.0, 4.2], Surface::PLASTER),
    wall_with([0.0, 15.8], [12.0, 15.8], Surface::PLASTER, &[doorway(3.0, NORTH), doorway(8.6, NORTH)]),
    wall([6.0, 15.8], [6.0, 20.0], Surface::PLASTER),
    wall([12.0, 15.8], [12.0, 20.0], Surface::PLASTER),
    // The void's balustrade.
    wall([2.4, 6.4], [9.6, 6.4], Surface::GLASS),
    wall([2.4, 13.6], [9.6, 13.6], Surface::GLASS),
    wall([2.4, 6.4], [2.4, 13.6], Surface::GLASS),
    wall([9.6, 6.4], [9.6, 13.6], Surface::GLASS),
    wall_with([12.0, 4.2], [12.0, 15.8], Surface::BRICK, &[passage(9.85, 1.58)]),
    // South of the corridor.
    wall_with(
        [12.0, 9.0],
        [34.0, 9.0],
        Surface::PLASTER,
        &[
            doorway(14.0, SOUTH),
            doorway(18.0, Door::HeldOpen(Swing::SouthEast)),
            doorway(23.0, SOUTH),
            doorway(29.0, Door::HeldOpen(Swing::SouthEast)),
        ],
    ),
    wall([12.0, 4.2], [26.0, 4.2], Surface::PLASTER),
    wall([16.0, 4.2], [16.0, 9.0], Surface::PLASTER),
    wall([20.0, 4.2], [20.0, 9.0], Surface::PLASTER),
    wall([26.0, 0.0], [26.0, 9.0], Surface::PLASTER),
    // North of it, either side of the cross corridor.
    wall_with([12.0, 10.7], [19.0, 10.7], Surface::PLASTER, &[doorway(15.5, NORTH)]),
    wall_with([19.0, 10.7], [19.0, 20.0], Surface::PLASTER, &[doorway(13.2, WEST), doorway(17.6, WEST)]),
    wall([12.0, 15.5], [19.0, 15.5], Surface::PLASTER),
    wall_with(
        [21.0, 10.7],
        [34.0, 10.7],
        Surface::PLASTER,
        &[doorway(24.0, NORTH), doorway(30.0, Door::HeldOpen(Swing::NorthWest))],
    ),
    wall_with(
        [21.0, 10.7],
        [21.0, 20.0],
        Surface::PLASTER,
        &[doorway(17.5, Door::HeldOpen(Swing::SouthEast))],
    ),
    wall([27.0, 10.7], [27.0, 15.5], Surface::PLASTER),
    wall_with(
        [21.0, 15.5],
        [34.0, 15.5],
        Surface::PLASTER,
        &[doorway(30.0, Door::HeldOpen(Swing::NorthWest))],
    ),
];

const FURNITURE: &[Block] = &[
    // Start office.
    Block([4.1, 0.1], [5.0, 2.2], Surface::WOOD),
    Block([7.3, 0.6], [7.9, 3.2], Surface::METAL),
    // Gallery: benches along the balustrade, a display case.
    Block([4.0, 13.7], [6.0, 14.0], Surface::FABRIC),
    Block([9.7, 11.6], [10.0, 13.2], Surface::FABRIC),
    Block([11.3, 11.4], [11.9, 13.4], Surface::WOOD),
    // The office that is visited.
    Block([16.1, 4.3], [17.2, 5.1], Surface::WOOD),
    Block([19.3, 5.0], [19.9, 8.6], Surface::METAL),
    // Library: shelves.
    Block([22.6, 15.6], [26.6, 16.0], Surface::WOOD),
    Block([22.6, 18.8], [26.6, 19.2], Surface::WOOD),
    Block([28.0, 19.4], [33.5, 19.9], Surface::WOOD),
    Block([32.0, 16.0], [33.0, 18.0], Surface::FABRIC),
    // The office between library and corridor.
    Block([32.2, 12.0], [33.9, 13.4], Surface::WOOD),
    Block([27.1, 12.6], [27.7, 15.0], Surface::METAL),
    // Seminar room: tables.
    Block([26.2, 6.2], [27.2, 8.6], Surface::WOOD),
    Block([31.6, 6.6], [33.6, 7.6], Surface::WOOD),
    Block([28.6, 0.6], [31.6, 1.2], Surface::WOOD),
    // Corridor: lockers, a water dispenser, a copier.
    Block([20.6, 9.06], [21.8, 9.3], Surface::METAL),
    Block([24.9, 9.06], [25.3, 9.3], Surface::METAL),
    Block([16.2, 10.4], [17.8, 10.64], Surface::METAL),
    Block([19.1, 14.6], [19.5, 16.2], Surface::WOOD),
];

const PILLARS: &[Pillar] = &[
    Pillar { at: [2.4, 6.4], radius_m: 0.3, surface: Surface::BRICK },
    Pillar { at: [2.4, 13.6], radius_m: 0.3, surface: Surface::BRICK },
    Pillar { at: [9.6, 6.4], radius_m: 0.3, surface: Surface::BRICK },
    Pillar { at: [9.6, 13.6], radius_m: 0.3, surface: Surface::BRICK },
    // Plant pots.
    Pillar { at: [33.5, 9.5], radius_m: 0.25, surface: Surface::WOOD },
    Pillar { at: [0.4, 15.3], radius_m: 0.25, surface: Surface::WOOD },
];

const AREAS: &[Area] = &[
    Area { low: [0.3, 4.5], high: [11.7, 6.1], n_people_max: 3, n_chairs_max: 1 },
    Area { low: [0.3, 6.4], high: [2.1, 13.6], n_people_max: 2, n_chairs_max: 2 },
    Area { low: [0.3, 13.9], high: [11.7, 15.5], n_people_max: 3, n_chairs_max: 2 },
    Area { low: [19.3, 11.3], high: [20.7, 19.7], n_people_max: 2, n_chairs_max: 0 },
    Area { low: [4.3, 0.3], high: [7.7, 3.9], n_people_max: 1, n_chairs_max: 3 },
    Area { low: [16.3, 4.5], high: [19.7, 8.7], n_people_max: 1, n_chairs_max: 3 },
    Area { low: [21.3, 15.8], high: [33.7, 19.7], n_people_max: 4, n_chairs_max: 8 },
    Area { low: [27.3, 11.3], high: [33.7, 15.2], n_people_max: 1, n_chairs_max: 3 },
    Area { low: [26.3, 0.3], high: [33.7, 8.7], n_people_max: 4, n_chairs_max: 10 },
];

const ROUTE: &[[f64; 2]] = &[
    // From the office around three sides of the gallery.
    [6.0, 1.6],
    [6.0, 5.3],
    [1.2, 5.3],
    [1.2, 14.8],
    [10.8, 14.8],
    [10.8, 9.85],
    // Along the corridor, up the cross corridor and through the library.
    [20.0, 9.85],
    [20.0, 17.5],
    [27.6, 17.5],
    [30.0, 17.4],
    // Through an office back to the corridor and to its dead end.
    [30.0, 9.85],
    [32.2, 9.85],
    // Back, around in the seminar room.
    [29.0, 9.85],
    [29.0, 7.4],
    [30.6, 5.2],
    [30.0, 2.8],
    [28.2, 3.2],
    [29.0, 7.4],
    [29.0, 9.85],
    // Back along the corridor, into an office and out again.
    [18.0, 9.85],
    [18.0, 7.6],
    [18.5, 6.6],
    [17.6, 6.2],
    [18.0, 7.6],
    [18.0, 9.85],
    // Home by the fourth side.
    [10.8, 9.85],
    [10.8, 5.3],
    [6.0, 5.3],
    [6.0, 1.6],
];
