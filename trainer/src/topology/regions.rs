//! Which stretches are visits of one region: those of one kind at one place.

use std::collections::BTreeMap;

use kinds_trips::Pose;

use super::Visit;

/// The region of each visit, numbered in order of their first visits.
///
/// Two visits of one kind are of one region if at least half of the *middle half* of either's way lies within the radius of
/// the other, and so are visits that are of one region with a third. Not half of the whole way: two ways that cross at
/// a right angle are then one place up to a length of eight radii, while corridors whose ends touch stay two from a
/// length of two radii on, either way. A corridor seen first in part and later whole is one.
pub(super) fn merged(visits: &[Visit], radius_m: f64) -> Vec<usize> {
    let ways: Vec<Vec<Place>> = visits.iter().map(|visit| way(visit, radius_m)).collect();
    let grid = Grid::new(visits, &ways, radius_m);
    // Each visit points to an earlier one of its region or to itself.
    let mut earlier: Vec<usize> = (0..visits.len()).collect();
    for (index, way) in ways.iter().enumerate() {
        let middle = middle_half(way);
        let mut n_places_at: BTreeMap<usize, usize> = BTreeMap::new();
        for place in &middle {
            for other in grid.visits_near(visits[index].stretch.kind, place) {
                *n_places_at.entry(other).or_default() += 1;
            }
        }
        for (other, n_places) in n_places_at {
            if 2 * n_places >= middle.len() {
                let (a, b) = (first_of(&earlier, index), first_of(&earlier, other));
                earlier[a.max(b)] = a.min(b);
            }
        }
    }
    let mut number_of = BTreeMap::new();
    (0..visits.len())
        .map(|index| {
            let n_regions = number_of.len();
            *number_of.entry(first_of(&earlier, index)).or_insert(n_regions)
        })
        .collect()
}

fn first_of(earlier: &[usize], mut visit: usize) -> usize {
    while earlier[visit] != visit {
        visit = earlier[visit];
    }
    visit
}

/// The places between the quarters of a way. Those that come neither before nor after a quarter are in.
fn middle_half(way: &[Place]) -> Vec<&Place> {
    let quarter = way.len() / 4;
    let (from, until) = (way[quarter].frame, way[way.len() - 1 - quarter].frame);
    way.iter().filter(|place| (from..=until).contains(&place.frame)).collect()
}

/// A place on a visit's way: the mean of its frames in one cell of the grid, so that a place counts once however long the
/// robot stood there.
struct Place {
    cell: Cell,
    /// Mean index of these frames.
    frame: f64,
    x_m: f64,
    y_m: f64,
}

/// Column and row of a square of half a radius.
type Cell = (i64, i64);

/// A visit's places in the order of their mean frames, which is the opposite order on the way back.
fn way(visit: &Visit, radius_m: f64) -> Vec<Place> {
    let cell = |coordinate_m: f64| (coordinate_m / (radius_m / 2.0)).floor() as i64;
    let mut frames_in: BTreeMap<Cell, Vec<(usize, &Pose)>> = BTreeMap::new();
    for (frame, pose) in visit.placed() {
        frames_in.entry((cell(pose.x_m), cell(pose.y_m))).or_default().push((frame, pose));
    }
    let place = |(cell, frames): (Cell, Vec<(usize, &Pose)>)| {
        let n_frames = frames.len() as f64;
        // A sum of whole numbers: means that are equal are equal to the last bit.
        let frame = frames.iter().map(|(frame, _)| frame).sum::<usize>() as f64 / n_frames;
        let x_m = frames.iter().map(|(_, pose)| pose.x_m).sum::<f64>() / n_frames;
        let y_m = frames.iter().map(|(_, pose)| pose.y_m).sum::<f64>() / n_frames;
        Place { cell, frame, x_m, y_m }
    };
    let mut way: Vec<Place> = frames_in.into_iter().map(place).collect();
    way.sort_by(|a, b| a.frame.total_cmp(&b.frame));
    way
}

/// All places of all visits, by kind and cell.
struct Grid<'a> {
    places: BTreeMap<(usize, Cell), Vec<(usize, &'a Place)>>,
    radius_m: f64,
}

impl<'a> Grid<'a> {
    fn new(visits: &[Visit], ways: &'a [Vec<Place>], radius_m: f64) -> Self {
        let mut places: BTreeMap<(usize, Cell), Vec<(usize, &Place)>> = BTreeMap::new();
        for (index, way) in ways.iter().enumerate() {
            for place in way {
                places.entry((visits[index].stretch.kind, place.cell)).or_default().push((index, place));
            }
        }
        Self { places, radius_m }
    }

    /// The visits of a kind that have a place within the radius of this one, ascending.
    fn visits_near(&self, kind: usize, place: &Place) -> Vec<usize> {
        let (column, row) = place.cell;
        let is_near = |other: &Place| (other.x_m - place.x_m).hypot(other.y_m - place.y_m) <= self.radius_m;
        // A radius is two cells.
        let cells = (column - 2..=column + 2)
            .flat_map(|column| self.places.range((kind, (column, row - 2))..=(kind, (column, row + 2))));
        let mut near: Vec<usize> = cells
            .flat_map(|(_, places)| places)
            .filter(|(_, other)| is_near(other))
            .map(|(visit, _)| *visit)
            .collect();
        near.sort_unstable();
        near.dedup();
        near
    }
}
