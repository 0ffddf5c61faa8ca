//! How far a person's names and the kinds agree, and where they do not.

use std::cmp::Reverse;

use serde::Serialize;

use super::Segmentation;
use crate::agreement::adjusted_mutual_information;
use crate::runs::runs;
use crate::trip_kinds::TripKinds;

/// A person's segmentation beside the kinds.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct SegmentationAgreement {
    /// Frames of all trips.
    pub n_frames: usize,
    /// Frames that have a name.
    pub n_frames_named: usize,
    /// Adjusted mutual information between names and kinds.
    pub ami: f64,
    /// In order of their first appearance.
    pub names: Vec<String>,
    /// Frames of each name and kind, shape `(n_names, n_kinds)`.
    pub n_frames_of: Vec<Vec<usize>>,
    /// The kind that most frames of each name have, the first of equals, shape `(n_names,)`.
    pub usual_kinds: Vec<usize>,
    /// The name that most named frames of each kind have, the first of equals, shape `(n_kinds,)`; none without such frames.
    pub usual_names: Vec<Option<String>>,
    /// Where the person says the same as elsewhere and the robot does not, longest first.
    pub kinds_differ: Vec<KindDiffers>,
    /// Where the robot says the same as elsewhere and the person does not, longest first.
    pub names_differ: Vec<NameDiffers>,
}

/// Frames of a name that are not of its usual kind.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct KindDiffers {
    /// The trip's title.
    pub trip: String,
    /// When they begin, seconds.
    pub from_s: f64,
    /// When the turn of the last is over, seconds.
    pub to_s: f64,
    /// How many.
    pub n_frames: usize,
    /// What the person calls the place.
    pub name: String,
    /// Which kind such places usually have.
    pub usual_kind: usize,
    /// Which kind these have.
    pub kind: usize,
}

/// Frames of a kind that do not have its usual name.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct NameDiffers {
    /// The trip's title.
    pub trip: String,
    /// When they begin, seconds.
    pub from_s: f64,
    /// When the turn of the last is over, seconds.
    pub to_s: f64,
    /// How many.
    pub n_frames: usize,
    /// Which kind the robot sees.
    pub kind: usize,
    /// What such places are usually called.
    pub usual_name: String,
    /// What these are called.
    pub name: String,
}

impl Segmentation {
    /// Compares the segmentation with the kinds.
    ///
    /// * `trips` — those that it was read for
    pub fn compare(&self, trips: &[TripKinds], n_kinds: usize) -> SegmentationAgreement {
        let names: Vec<Vec<Option<usize>>> =
            trips.iter().enumerate().map(|(index, trip)| self.names_of_frames(index, trip.seconds)).collect();
        let named = |(trip, names): (&TripKinds, &Vec<Option<usize>>)| -> Vec<(usize, usize)> {
            names.iter().zip(trip.kinds).filter_map(|(name, kind)| Some(((*name)?, *kind))).collect()
        };
        let pairs: Vec<(usize, usize)> = trips.iter().zip(&names).flat_map(named).collect();
        let mut n_frames_of = vec![vec![0; n_kinds]; self.names.len()];
        pairs.iter().for_each(|&(name, kind)| n_frames_of[name][kind] += 1);
        let usual_kinds: Vec<usize> =
            n_frames_of.iter().map(|row| first_largest(row.iter().copied()).unwrap_or(0)).collect();
        let usual_names: Vec<Option<usize>> =
            (0..n_kinds).map(|kind| first_largest(n_frames_of.iter().map(|row| row[kind]))).collect();
        let (mut kinds_differ, mut names_differ) = (Vec::new(), Vec::new());
        for (trip, names) in trips.iter().zip(&names) {
            let both: Vec<_> =
                names.iter().zip(trip.kinds).map(|(name, kind)| name.map(|name| (name, *kind))).collect();
            let stretches = runs(&both).filter_map(|(frames, of)| Some((frames, of?)));
            for (frames, (name, kind)) in stretches {
                let (from_s, to_s) = (trip.turn_s(frames.start), trip.turn_s(frames.end));
                let (title, n_frames) = (trip.title.to_string(), frames.len());
                let usual_kind = usual_kinds[name];
                if kind != usual_kind {
                    let (trip, name) = (title.clone(), self.names[name].clone());
                    kinds_differ.push(KindDiffers { trip, from_s, to_s, n_frames, name, usual_kind, kind });
                }
                if let Some(usual) = usual_names[kind].filter(|usual| *usual != name) {
                    let (usual_name, name) = (self.names[usual].clone(), self.names[name].clone());
                    names_differ.push(NameDiffers {
                        trip: title,
                        from_s,
                        to_s,
                        n_frames,
                        kind,
                        usual_name,
                        name,
                    });
                }
            }
        }
        // Stable: of equals the earlier trip and time first.
        kinds_differ.sort_by_key(|differs| Reverse(differs.n_frames));
        names_differ.sort_by_key(|differs| Reverse(differs.n_frames));
        SegmentationAgreement {
            n_frames: trips.iter().map(TripKinds::n_frames).sum(),
            n_frames_named: pairs.len(),
            ami: adjusted_mutual_information(&pairs),
            names: self.names.clone(),
            n_frames_of,
            usual_kinds,
            usual_names: usual_names.into_iter().map(|name| Some(self.names[name?].clone())).collect(),
            kinds_differ,
            names_differ,
        }
    }
}

/// Place of the largest count, the first of equals; none if all are 0.
fn first_largest(counts: impl Iterator<Item = usize>) -> Option<usize> {
    let largest = counts.enumerate().max_by_key(|(place, count)| (*count, Reverse(*place)));
    largest.filter(|(_, count)| *count > 0).map(|(place, _)| place)
}
