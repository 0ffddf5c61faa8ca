//! What kinds are good for beside being consistent: sequences, maps and policies of the trips that were evaluated.

use serde::Serialize;

use crate::drift::Drift;
use crate::evaluate::ClassifiedTrip;
use crate::policy::Policy;
use crate::sequence::Sequence;
use crate::topology::{MapPlan, TopologicalMap};
use crate::trip_kinds::TripKinds;

/// What the kinds of trips through one space make, as scripts read it.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Uses {
    /// Which space, from 0.
    pub space: usize,
    /// Each trip's kinds as a sequence.
    pub sequences: Vec<Sequence>,
    /// How far each trip is from those that the model was learnt from.
    pub drift: Vec<Option<Drift>>,
    /// One map of all trips; none where no place is known.
    pub map: Option<TopologicalMap>,
    /// What the robot was told to do in each kind, over all trips.
    pub policy: Policy,
}

impl Uses {
    /// Of classified trips, space by space.
    ///
    /// * `seed` — of the fits that tell whether a kind's commands are of two sorts
    pub fn of(trips: &[ClassifiedTrip], n_kinds: usize, map: &MapPlan, seed: u64) -> Vec<Self> {
        trips
            .chunk_by(|a, b| a.space == b.space)
            .map(|of_space| Self::of_space(of_space, n_kinds, map, seed))
            .collect()
    }

    fn of_space(trips: &[ClassifiedTrip], n_kinds: usize, map: &MapPlan, seed: u64) -> Self {
        let space = trips[0].space;
        let drift = trips.iter().map(|trip| trip.drift.clone()).collect();
        let trips: Vec<TripKinds> = trips.iter().map(ClassifiedTrip::trip_kinds).collect();
        let has_places = trips.iter().any(|trip| trip.poses.iter().any(Option::is_some));
        Self {
            space,
            sequences: trips.iter().map(|trip| Sequence::of(trip, n_kinds)).collect(),
            drift,
            map: has_places.then(|| TopologicalMap::of(&trips, map)),
            policy: Policy::of(&trips, n_kinds, seed),
        }
    }
}
