//! The topological map of a space: regions of one kind, and how a robot went from one to another.
//!
//! Grollman, Jenkins & Wood, *Discovering Natural Kinds of Robot Sensory Experiences in Unstructured Environments*, Figure 7d.
//! Each trip is cut into *stretches* of one kind ([`stretches`]); stretches of one kind at one place are one *region*
//! ([`regions`]). A stretch is then a *visit* of its region, and an *edge* a → b stands for all visits of a that ended
//! in b.
//!
//! Regions are made of places, so frames without a pose are passed over. A robot that stands still travels no metres: what
//! it sees while it turns on the spot becomes no region of its own, however long it lasts.

pub(crate) mod attributes;
mod formats;
mod regions;
mod stretches;
#[cfg(test)]
mod tests;

use std::collections::BTreeMap;

use kinds_trips::Pose;
use serde::Serialize;

use self::stretches::Stretch;
use crate::trip_kinds::TripKinds;

/// How a space is cut into regions.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct MapPlan {
    /// Stretches smaller than this are taken for their neighbours' kind, metres; at least 0. The size of a stretch is the
    /// diagonal of the box around it.
    pub size_m_min: f64,
    /// Places no farther apart are one place, metres; above 0. Not less than frames are apart, else laps of one loop
    /// miss each other; below half of `size_m_min`, else neighbours of one kind become one where their ends touch.
    pub radius_m: f64,
}

/// The regions of a space, and how the robot went from one to another.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct TopologicalMap {
    /// How the space was cut.
    #[serde(flatten)]
    pub plan: MapPlan,
    /// In order of their first visit, trip by trip. A region's index is its number.
    pub regions: Vec<Region>,
    /// Ascending by where they begin, then by where they end.
    pub edges: Vec<Edge>,
    /// The region of each frame of each trip, `None` where its place is not known. Scripts do not read it.
    #[serde(skip)]
    pub regions_of_frames: Vec<Vec<Option<usize>>>,
}

/// A place, however large, of one kind.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Region {
    /// What kind of place.
    pub kind: usize,
    /// Where the robot was in it, nearest to the mean of the region's frames, metres. (Of a bent corridor or a loop the mean
    /// itself may lie behind a wall.)
    pub x_m: f64,
    /// See `x_m`.
    pub y_m: f64,
    /// The box around all places of the region.
    #[serde(flatten)]
    pub extent: Extent,
    /// How long the robot was there in all visits, seconds. It goes from one region to the next half way between two
    /// frames; frames without a place are nowhere.
    pub dwell_s: f64,
    /// How often it came. A trip that begins in the region begins with a visit.
    pub n_visits: usize,
    /// Frames taken there.
    pub n_frames: usize,
}

/// A box around places.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Extent {
    /// Least x, metres.
    pub x_m_min: f64,
    /// Largest x, metres.
    pub x_m_max: f64,
    /// Least y, metres.
    pub y_m_min: f64,
    /// Largest y, metres.
    pub y_m_max: f64,
}

/// All visits of one region that ended in another.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Edge {
    /// The region that was visited.
    pub from: usize,
    /// The region that followed.
    pub to: usize,
    /// How many visits there were.
    pub n_visits: usize,
    /// How long one lasted in the mean, from its own beginning (or the trip's) until the next region began, seconds.
    pub mean_duration_s: f64,
    /// Mean command over all frames of these visits whose command is known; none if there is no such frame.
    #[serde(flatten)]
    pub mean_command: Option<MeanCommand>,
}

/// What the robot was told to do, in the mean.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct MeanCommand {
    /// Forward, metres a second.
    pub mean_forward_m_s: f64,
    /// Counter-clockwise, radians a second.
    pub mean_turn_rad_s: f64,
}

impl TopologicalMap {
    /// Maps one space from all trips through it.
    ///
    /// O(n log n) in frames, and for each place as many steps as there were visits near it.
    ///
    /// # Panics
    /// If the plan is outside its limits, or a trip has not one time, pose and kind for each frame: bugs of the caller.
    pub fn of(trips: &[TripKinds], plan: &MapPlan) -> Self {
        let MapPlan { size_m_min, radius_m } = *plan;
        assert!(size_m_min >= 0.0 && radius_m > 0.0, "{plan:?} is outside its limits");
        let visits: Vec<Visit> = trips
            .iter()
            .enumerate()
            .flat_map(|(trip_index, trip)| {
                let stretches = stretches::cut(trip, size_m_min);
                let ends_s = ends_s(&stretches, trip.seconds);
                let timed = stretches.into_iter().zip(ends_s);
                timed.map(move |(stretch, (from_s, until_s))| Visit {
                    trip_index,
                    trip,
                    stretch,
                    from_s,
                    until_s,
                })
            })
            .collect();
        let region_of = regions::merged(&visits, radius_m);
        let mut regions_of_frames: Vec<Vec<Option<usize>>> =
            trips.iter().map(|trip| vec![None; trip.kinds.len()]).collect();
        for (visit, &region) in visits.iter().zip(&region_of) {
            for (frame, _) in visit.placed() {
                regions_of_frames[visit.trip_index][frame] = Some(region);
            }
        }
        let (regions, edges) = (regions_from(&visits, &region_of), edges_from(&visits, &region_of));
        Self { plan: *plan, regions, edges, regions_of_frames }
    }
}

impl Extent {
    fn of(pose: &Pose) -> Self {
        Self { x_m_min: pose.x_m, x_m_max: pose.x_m, y_m_min: pose.y_m, y_m_max: pose.y_m }
    }

    /// The box around both.
    fn and(self, other: Self) -> Self {
        Self {
            x_m_min: self.x_m_min.min(other.x_m_min),
            x_m_max: self.x_m_max.max(other.x_m_max),
            y_m_min: self.y_m_min.min(other.y_m_min),
            y_m_max: self.y_m_max.max(other.y_m_max),
        }
    }

    /// From x and y: its width and height, metres.
    pub fn size_m(&self) -> (f64, f64) {
        (self.x_m_max - self.x_m_min, self.y_m_max - self.y_m_min)
    }
}

/// A stretch of a trip, and when it was.
struct Visit<'a> {
    trip_index: usize,
    trip: &'a TripKinds<'a>,
    stretch: Stretch,
    from_s: f64,
    until_s: f64,
}

impl Visit<'_> {
    /// Its frames whose place is known, and the places.
    fn placed(&self) -> impl Iterator<Item = (usize, &Pose)> {
        let frames = self.stretch.first..=self.stretch.last;
        frames.filter_map(|frame| Some((frame, self.trip.poses[frame].as_ref()?)))
    }

    fn duration_s(&self) -> f64 {
        self.until_s - self.from_s
    }
}

/// When each stretch began and ended: the first and the last where the trip does, all others half way between frames.
fn ends_s(stretches: &[Stretch], seconds: &[f64]) -> Vec<(f64, f64)> {
    let half_way = |a: &Stretch, b: &Stretch| (seconds[a.last] + seconds[b.first]) / 2.0;
    let within = stretches.windows(2).map(|pair| half_way(&pair[0], &pair[1]));
    let from_s = stretches.first().map(|first| seconds[first.first]).into_iter().chain(within.clone());
    let until_s = within.chain(stretches.last().map(|last| seconds[last.last]));
    from_s.zip(until_s).collect()
}

/// * `region_of` — of each visit
fn regions_from(visits: &[Visit], region_of: &[usize]) -> Vec<Region> {
    let n_regions = region_of.iter().max().map_or(0, |last| last + 1);
    let mut visits_of: Vec<Vec<&Visit>> = vec![Vec::new(); n_regions];
    visits.iter().zip(region_of).for_each(|(visit, &region)| visits_of[region].push(visit));
    visits_of.iter().map(|visits| region_from(visits)).collect()
}

/// * `visits` — at least one
fn region_from(visits: &[&Visit]) -> Region {
    let poses = || visits.iter().flat_map(|visit| visit.placed()).map(|(_, pose)| pose);
    let n_frames = poses().count();
    let mean = |of: fn(&Pose) -> f64| poses().map(of).sum::<f64>() / n_frames as f64;
    let (x_m, y_m) = (mean(|pose| pose.x_m), mean(|pose| pose.y_m));
    let from_mean_m = |pose: &Pose| (pose.x_m - x_m).hypot(pose.y_m - y_m);
    let middle = poses().min_by(|a, b| from_mean_m(a).total_cmp(&from_mean_m(b)));
    let middle = middle.expect("a stretch has a frame with a place");
    let extents = visits.iter().map(|visit| visit.stretch.extent);
    Region {
        kind: visits[0].stretch.kind,
        x_m: middle.x_m,
        y_m: middle.y_m,
        extent: extents.reduce(Extent::and).expect("a region was visited"),
        dwell_s: visits.iter().map(|visit| visit.duration_s()).sum(),
        n_visits: visits.len(),
        n_frames,
    }
}

/// * `region_of` — of each visit
fn edges_from(visits: &[Visit], region_of: &[usize]) -> Vec<Edge> {
    let mut visits_along: BTreeMap<(usize, usize), Vec<&Visit>> = BTreeMap::new();
    for (pair, regions) in visits.windows(2).zip(region_of.windows(2)) {
        if pair[0].trip_index == pair[1].trip_index {
            visits_along.entry((regions[0], regions[1])).or_default().push(&pair[0]);
        }
    }
    let edge = |((from, to), visits): ((usize, usize), Vec<&Visit>)| Edge {
        from,
        to,
        n_visits: visits.len(),
        mean_duration_s: visits.iter().map(|visit| visit.duration_s()).sum::<f64>() / visits.len() as f64,
        mean_command: mean_command(&visits),
    };
    visits_along.into_iter().map(edge).collect()
}

fn mean_command(visits: &[&Visit]) -> Option<MeanCommand> {
    let command = |visit: &Visit, frame: usize| visit.trip.commands.get(frame).copied().flatten();
    let known =
        || visits.iter().flat_map(|visit| visit.placed().filter_map(|(frame, _)| command(visit, frame)));
    let n_known = known().count();
    (n_known > 0).then(|| MeanCommand {
        mean_forward_m_s: known().map(|command| command.forward_m_s).sum::<f64>() / n_known as f64,
        mean_turn_rad_s: known().map(|command| command.turn_rad_s).sum::<f64>() / n_known as f64,
    })
}
