//! The kinds of a trip as a sequence: how often they change, how long they last, and what follows what.
//!
//! A frame's turn lasts until the next frame; the last one's as long as is usual in the trip. A kind that changes with
//! every frame says little about places, whatever its consistency.

use serde::Serialize;

use crate::places::distance_m;
use crate::runs::{Runs, runs};
use crate::trip_kinds::TripKinds;

/// One trip's kinds as a sequence.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Sequence {
    /// The trip's title.
    pub trip: String,
    /// Frames.
    pub n_frames: usize,
    /// Frames whose kind is not that of the frame before.
    pub n_switches: usize,
    /// From the first frame to the last, seconds.
    pub duration_s: f64,
    /// Length of the path through the places of the frames that have one, metres; `None` without such frames. A robot
    /// that stands still moves by the noise of its poses.
    pub distance_m: Option<f64>,
    /// Switches per second; `None` where no time passes.
    pub switches_per_s: Option<f64>,
    /// Switches per metre, among the frames whose place is known; `None` where there is no way.
    pub switches_per_m: Option<f64>,
    /// How long a kind lasts, frames.
    pub run_frames: RunLengths,
    /// How long a kind lasts, seconds.
    pub run_s: RunLengths,
    /// What the mean run would be if the same frames came in any order, frames ([`Runs::mean_length_shuffled`]).
    pub run_frames_shuffled: f64,
    /// Frames of each kind, shape `(n_kinds,)`.
    pub n_frames_of_kind: Vec<usize>,
    /// How often a frame of one kind was followed by a frame of another or the same, shape `(n_kinds, n_kinds)`: the
    /// row is the earlier one's kind.
    pub n_transitions: Vec<Vec<usize>>,
    /// The same as shares of the row: the probability of the next frame's kind, shape `(n_kinds, n_kinds)`; no row for
    /// a kind that no frame follows.
    pub transition_probabilities: Vec<Option<Vec<f64>>>,
}

/// How long runs of one kind last: frames, or seconds.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct RunLengths {
    /// Mean.
    pub mean: f64,
    /// Half of the runs are no longer.
    pub median: f64,
    /// The longest.
    pub longest: f64,
}

impl Sequence {
    /// Of a trip with at least one frame.
    pub fn of(trip: &TripKinds, n_kinds: usize) -> Self {
        let n_frames = trip.n_frames();
        assert!(n_frames > 0, "{} has no frames", trip.title);
        let mut n_transitions = vec![vec![0; n_kinds]; n_kinds];
        trip.kinds.windows(2).for_each(|pair| n_transitions[pair[0]][pair[1]] += 1);
        let mut n_frames_of_kind = vec![0; n_kinds];
        trip.kinds.iter().for_each(|&kind| n_frames_of_kind[kind] += 1);
        let n_switches = runs(trip.kinds).count() - 1;
        let duration_s = trip.seconds[n_frames - 1] - trip.seconds[0];
        let way = way(trip);
        let in_frames = runs(trip.kinds).map(|(frames, _)| frames.len() as f64);
        let in_s = runs(trip.kinds).map(|(frames, _)| trip.turn_s(frames.end) - trip.turn_s(frames.start));
        Self {
            trip: trip.title.to_string(),
            n_frames,
            n_switches,
            duration_s,
            distance_m: way.map(|(_, distance_m)| distance_m),
            switches_per_s: (duration_s > 0.0).then(|| n_switches as f64 / duration_s),
            switches_per_m: way
                .filter(|(_, distance_m)| *distance_m > 0.0)
                .map(|(n_switches, distance_m)| n_switches as f64 / distance_m),
            run_frames: RunLengths::of(in_frames.collect()),
            run_s: RunLengths::of(in_s.collect()),
            run_frames_shuffled: Runs::of(trip.kinds).mean_length_shuffled,
            n_frames_of_kind,
            transition_probabilities: n_transitions.iter().map(|row| shares(row)).collect(),
            n_transitions,
        }
    }
}

impl RunLengths {
    /// Of at least one length.
    fn of(mut lengths: Vec<f64>) -> Self {
        lengths.sort_by(f64::total_cmp);
        let n = lengths.len();
        Self {
            mean: lengths.iter().sum::<f64>() / n as f64,
            median: (lengths[(n - 1) / 2] + lengths[n / 2]) / 2.0,
            longest: lengths[n - 1],
        }
    }
}

/// Among the frames whose place is known: switches, and the length of the path through them, metres.
fn way(trip: &TripKinds) -> Option<(usize, f64)> {
    let placed: Vec<_> =
        trip.poses.iter().zip(trip.kinds).filter_map(|(pose, kind)| Some(((*pose)?, kind))).collect();
    let n_switches = placed.windows(2).filter(|pair| pair[0].1 != pair[1].1).count();
    (!placed.is_empty())
        .then(|| (n_switches, placed.windows(2).map(|pair| distance_m(&pair[0].0, &pair[1].0)).sum()))
}

fn shares(counts: &[usize]) -> Option<Vec<f64>> {
    let n: usize = counts.iter().sum();
    (n > 0).then(|| counts.iter().map(|&count| count as f64 / n as f64).collect())
}

#[cfg(test)]
mod tests {
    use kinds_trips::Pose;

    use super::*;

    fn at(x_m: f64, y_m: f64) -> Option<Pose> {
        Some(Pose { x_m, y_m, yaw_rad: 0.0 })
    }

    const PLAIN: TripKinds = TripKinds {
        title: "hall",
        seconds: &[0.0, 1.0, 2.0, 3.0, 5.0, 6.0],
        poses: &[None; 6],
        commands: &[],
        kinds: &[0, 0, 2, 2, 2, 0],
    };

    #[test]
    fn a_trip_written_down_by_hand() {
        let poses = [at(0.0, 0.0), at(3.0, 4.0), None, at(3.0, 5.0), at(3.0, 5.0), at(1.0, 5.0)];
        let sequence = Sequence::of(&TripKinds { poses: &poses, ..PLAIN }, 3);
        let expected = Sequence {
            trip: "hall".to_string(),
            n_frames: 6,
            n_switches: 2,
            duration_s: 6.0,
            // 5 m, 1 m across the frame without a place, nothing, and 2 m.
            distance_m: Some(8.0),
            switches_per_s: Some(2.0 / 6.0),
            switches_per_m: Some(2.0 / 8.0),
            run_frames: RunLengths { mean: 2.0, median: 2.0, longest: 3.0 },
            // 0 to 2 s, 2 to 6 s, and the last frame for the usual second.
            run_s: RunLengths { mean: 7.0 / 3.0, median: 2.0, longest: 4.0 },
            run_frames_shuffled: 6.0 / (7.0 - 18.0 / 6.0),
            n_frames_of_kind: vec![3, 0, 3],
            n_transitions: vec![vec![1, 0, 1], vec![0, 0, 0], vec![1, 0, 2]],
            transition_probabilities: vec![
                Some(vec![0.5, 0.0, 0.5]),
                None,
                Some(vec![1.0 / 3.0, 0.0, 2.0 / 3.0]),
            ],
        };
        assert_eq!(sequence, expected);
    }

    #[test]
    fn switches_where_nobody_knows_the_place_are_not_put_down_to_the_metres_elsewhere() {
        let poses = [at(0.0, 0.0), at(2.0, 0.0), None, None, None, None];
        let sequence = Sequence::of(&TripKinds { poses: &poses, ..PLAIN }, 3);
        assert_eq!((sequence.distance_m, sequence.switches_per_m), (Some(2.0), Some(0.0)));
    }

    #[test]
    fn without_poses_way_or_time_there_is_no_rate() {
        let rates = |trip: &TripKinds| {
            let sequence = Sequence::of(trip, 3);
            (sequence.distance_m, sequence.switches_per_m, sequence.switches_per_s)
        };
        assert_eq!(rates(&PLAIN), (None, None, Some(2.0 / 6.0)));
        assert_eq!(
            rates(&TripKinds { poses: &[at(1.0, 1.0); 6], ..PLAIN }),
            (Some(0.0), None, Some(1.0 / 3.0))
        );
        let single = TripKinds { seconds: &[0.0], poses: &[at(1.0, 1.0)], kinds: &[1], ..PLAIN };
        assert_eq!(rates(&single), (Some(0.0), None, None));
    }

    #[test]
    fn the_median_of_an_even_number_of_runs_lies_half_way() {
        assert_eq!(RunLengths::of(vec![4.0, 1.0, 2.0, 9.0]).median, 3.0);
    }
}
