//! Where trips meet: which pairs of them can be compared. Found without any model, so that nobody waits for one to be fitted
//! only to hear that two trips never meet.

use std::ops::Range;
use std::path::PathBuf;

use kinds_model::SensorLayout;

use crate::consistency::Revisits;
use crate::load::LoadedTrip;
use crate::places::{Places, SamePlace};

/// Trips through one or more spaces, and where those of a space meet.
#[derive(Debug)]
pub struct Meetings<'a> {
    pub(crate) layout: SensorLayout,
    pub(crate) same_place: SamePlace,
    pub(crate) trips: Vec<Placed<'a>>,
    pub(crate) pairs: Vec<Pair>,
    pub(crate) unmet: Vec<MeetingError>,
}

/// A trip, and the frames of it whose place is known.
#[derive(Debug)]
pub(crate) struct Placed<'a> {
    pub(crate) trip: &'a LoadedTrip,
    /// Which space it leads through, from 0.
    pub(crate) space: usize,
    /// Which frames of the trip have a place, in order of time.
    pub(crate) frames: Vec<usize>,
    pub(crate) places: Places,
}

/// Two trips that meet.
#[derive(Debug)]
pub(crate) struct Pair {
    /// Which two of the trips.
    pub(crate) trips: [usize; 2],
    /// Frames of the first that the second revisits, and the other way round.
    pub(crate) revisits: [Revisits; 2],
}

/// Why trips cannot be compared.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum MeetingError {
    /// Frames of another sensor.
    #[error("trip {path} has frames of {found}; the model understands frames of {expected}")]
    OtherSensor {
        /// The trip.
        path: PathBuf,
        /// Its frames.
        found: SensorLayout,
        /// The model's.
        expected: SensorLayout,
    },
    /// Nobody knows where the robot was.
    #[error(
        "trip {path} has no poses: consistency compares the kinds of one place, so evaluation needs \
         nav_msgs/msg/Odometry or geometry_msgs/msg/PoseStamped in both trips (training does not)"
    )]
    NoPoses {
        /// The trip.
        path: PathBuf,
    },
    /// Different places, or different origins.
    #[error(
        "{first} and {second} lie in boxes that do not overlap, within {radius_m} m: x {} and {} m, y {} and {} m; either the \
         trips are of different spaces (give those of another space to --elsewhere), or their poses have different origins \
         and must be registered first",
        InWords(&.boxes_m[0][0]), InWords(&.boxes_m[1][0]), InWords(&.boxes_m[0][1]), InWords(&.boxes_m[1][1])
    )]
    BoxesApart {
        /// One trip.
        first: PathBuf,
        /// The other.
        second: PathBuf,
        /// R, metres.
        radius_m: f64,
        /// Least and greatest x and y of each, metres.
        boxes_m: Box<[[Range<f64>; 2]; 2]>,
    },
    /// The same part of the world, but no common place.
    #[error(
        "no frame of {first} has a frame of {second} within {radius_m} m{}: the trips come no nearer to each other than {least_m:.3} m; try a \
         larger radius{}",
        if *.with_headings { " and the heading tolerance" } else { "" },
        if *.with_headings { " or tolerance" } else { "" }
    )]
    NeverMeet {
        /// One trip.
        first: PathBuf,
        /// The other.
        second: PathBuf,
        /// R, metres.
        radius_m: f64,
        /// How near they come, whatever the heading, metres.
        least_m: f64,
        /// Whether headings had to agree too.
        with_headings: bool,
    },
}

/// `0.3…12.0`
struct InWords<'a>(&'a Range<f64>);

impl std::fmt::Display for InWords<'_> {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "{:.1}…{:.1}", self.0.start, self.0.end)
    }
}

impl<'a> Meetings<'a> {
    /// Finds where trips meet: any two of the same space.
    ///
    /// Pairs that do not meet are passed over as long as others do ([`Self::unmet`]).
    ///
    /// * `layout` — of the sensor whose kinds are to be compared
    /// * `spaces` — the trips through each; a single one has nothing to be compared with
    ///
    /// # Errors
    /// If a trip is of another sensor, or if there are pairs and none of them can be compared: then why the first cannot.
    pub fn find(
        layout: SensorLayout,
        spaces: &[&'a [LoadedTrip]],
        same_place: &SamePlace,
    ) -> Result<Self, MeetingError> {
        let mut trips = Vec::new();
        for (space, of_space) in spaces.iter().enumerate() {
            for trip in *of_space {
                if trip.survey.layout != layout {
                    let (path, found) = (trip.survey.path.clone(), trip.survey.layout);
                    return Err(MeetingError::OtherSensor { path, found, expected: layout });
                }
                trips.push(Placed::of(trip, space));
            }
        }
        let (mut pairs, mut unmet) = (Vec::new(), Vec::new());
        for second in 0..trips.len() {
            for first in (0..second).filter(|&first| trips[first].space == trips[second].space) {
                match revisits([&trips[first], &trips[second]], same_place) {
                    Ok(revisits) => pairs.push(Pair { trips: [first, second], revisits }),
                    Err(why) => unmet.push(why),
                }
            }
        }
        match unmet.first() {
            Some(why) if pairs.is_empty() => Err(why.clone()),
            _ => Ok(Self { layout, same_place: *same_place, trips, pairs, unmet }),
        }
    }

    /// Whether there is nothing to compare.
    pub fn is_empty(&self) -> bool {
        self.pairs.is_empty()
    }

    /// Why pairs of trips through the same space are not compared.
    pub fn unmet(&self) -> &[MeetingError] {
        &self.unmet
    }
}

fn revisits(pair: [&Placed; 2], same_place: &SamePlace) -> Result<[Revisits; 2], MeetingError> {
    let paths = pair.map(|placed| placed.trip.survey.path.clone());
    let unplaced = pair.iter().find(|placed| placed.frames.is_empty());
    if let Some(unplaced) = unplaced {
        return Err(MeetingError::NoPoses { path: unplaced.trip.survey.path.clone() });
    }
    let [first, second] = pair.map(|placed| &placed.places);
    let forward = Revisits::find(first, second, same_place);
    if forward.share_revisited() > 0.0 {
        // Who is near is so both ways.
        return Ok([forward, Revisits::find(second, first, same_place)]);
    }
    let SamePlace { radius_m, heading_tolerance_rad } = *same_place;
    let boxes_m = [first.bounds_m(), second.bounds_m()];
    let apart = (0..2).any(|axis| {
        let [a, b] = [&boxes_m[0][axis], &boxes_m[1][axis]];
        a.start > b.end + radius_m || b.start > a.end + radius_m
    });
    let [first_path, second_path] = paths;
    Err(match apart {
        true => MeetingError::BoxesApart {
            first: first_path,
            second: second_path,
            radius_m,
            boxes_m: Box::new(boxes_m),
        },
        false => MeetingError::NeverMeet {
            first: first_path,
            second: second_path,
            radius_m,
            least_m: first.least_distance_m(second),
            with_headings: heading_tolerance_rad.is_some(),
        },
    })
}

impl<'a> Placed<'a> {
    fn of(trip: &'a LoadedTrip, space: usize) -> Self {
        let known = trip.survey.poses.iter().enumerate().filter_map(|(frame, pose)| Some((frame, (*pose)?)));
        let (frames, poses): (Vec<usize>, Vec<_>) = known.unzip();
        Self { trip, space, frames, places: Places::new(poses) }
    }

    /// What stands for the frames whose place is known, of what stands for all frames.
    pub(crate) fn of_placed<T: Copy>(&self, of_all: &[T]) -> Vec<T> {
        self.frames.iter().map(|&frame| of_all[frame]).collect()
    }
}

#[cfg(test)]
mod tests {
    use kinds_trips::{Pose, Stamp};

    use super::*;
    use crate::survey::Survey;

    const LAYOUT: SensorLayout = SensorLayout { rows: 1, columns: 1, metres_per_count: 0.001 };

    fn trip(name: &str, places: &[(f64, f64)], yaw_rad: f64) -> LoadedTrip {
        let counts = vec![1; places.len()];
        let survey = Survey {
            path: name.into(),
            layout: LAYOUT,
            captured: (0..places.len() as i64).map(Stamp).collect(),
            poses: places.iter().map(|&(x_m, y_m)| Some(Pose { x_m, y_m, yaw_rad })).collect(),
            commands: vec![None; places.len()],
            n_frames_invalid: 0,
            remarks: Vec::new(),
        };
        LoadedTrip { survey, counts }
    }

    fn find<'a>(spaces: &[&'a [LoadedTrip]], radius_m: f64) -> Result<Meetings<'a>, String> {
        Meetings::find(LAYOUT, spaces, &SamePlace::within(radius_m)).map_err(|why| why.to_string())
    }

    #[test]
    fn any_two_trips_of_a_space_are_a_pair_and_those_of_different_spaces_are_none() {
        let here = [0, 1, 2].map(|index| trip(&format!("{index}"), &[(0.0, 0.0)], 0.0));
        let there = [3, 4].map(|index| trip(&format!("{index}"), &[(0.0, 0.0)], 0.0));
        let found = find(&[&here, &there], 1.0).unwrap();
        let pairs: Vec<_> = found.pairs.iter().map(|pair| pair.trips).collect();
        assert_eq!(pairs, [[0, 1], [0, 2], [1, 2], [3, 4]]);
        assert!(find(&[&here[..1], &[]], 1.0).unwrap().pairs.is_empty());
    }

    #[test]
    fn what_does_not_meet_is_said_and_passed_over_while_anything_does() {
        let trips = [
            trip("a", &[(0.0, 0.0), (2.0, 2.0)], 0.0),
            trip("b", &[(1.0, 1.5)], 0.0),
            trip("c", &[(9.0, 7.0)], 0.0),
            trip("lost", &[], 0.0),
            trip("d", &[(0.0, 0.1)], 3.0),
        ];
        let two = |a: usize, b: usize| find(&[&[trips[a].clone(), trips[b].clone()]], 0.25).unwrap_err();
        assert_eq!(
            two(0, 1),
            "no frame of a has a frame of b within 0.25 m: the trips come no nearer to each other than 1.118 m; try a larger radius"
        );
        assert_eq!(
            two(0, 2),
            "a and c lie in boxes that do not overlap, within 0.25 m: x 0.0…2.0 and 9.0…9.0 m, y 0.0…2.0 and 7.0…7.0 m; either the \
             trips are of different spaces (give those of another space to --elsewhere), or their poses have different \
             origins and must be registered first"
        );
        assert_eq!(
            two(0, 3),
            "trip lost has no poses: consistency compares the kinds of one place, so evaluation needs nav_msgs/msg/Odometry or \
             geometry_msgs/msg/PoseStamped in both trips (training does not)"
        );
        let all = find(&[&trips], 0.25).unwrap();
        assert_eq!(all.pairs.iter().map(|pair| pair.trips).collect::<Vec<_>>(), [[0, 4]]);
        assert_eq!(all.unmet().len(), 9);
        let facing = SamePlace { radius_m: 0.25, heading_tolerance_rad: Some(0.5) };
        let pair = [trips[0].clone(), trips[4].clone()];
        assert_eq!(
            Meetings::find(LAYOUT, &[&pair], &facing).unwrap_err().to_string(),
            "no frame of a has a frame of d within 0.25 m and the heading tolerance: the trips come no nearer to each other than \
             0.100 m; try a larger radius or tolerance"
        );
    }

    #[test]
    fn frames_without_a_place_are_left_out_of_what_is_compared() {
        let mut one = trip("a", &[(0.0, 0.0), (1.0, 0.0), (2.0, 0.0)], 0.0);
        one.survey.poses[1] = None;
        let placed = Placed::of(&one, 0);
        assert_eq!(placed.of_placed(&['a', 'b', 'c']), ['a', 'c']);
        assert_eq!(placed.places.n_frames(), 2);
    }
}
