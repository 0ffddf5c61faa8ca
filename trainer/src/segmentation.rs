//! A person's own segmentation of trips, and where it and the kinds disagree.
//!
//! Grollman, Jenkins & Wood, section 5.1: by comparing human and robot segmentations of a space, disagreements and ambiguities in
//! the environment and the control policy can be discovered and dealt with.

mod agreement;
mod rows;

pub use self::agreement::{KindDiffers, NameDiffers, SegmentationAgreement};
use self::rows::{Row, rows};
use crate::trip_kinds::TripKinds;

/// How a segmentation is written down.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum SegmentFormat {
    /// Comma-separated values under the titles `trip`, `from_s`, `to_s` and `name`; `trip` may be left out.
    Csv,
    /// A list of `(trip: "hall", from_s: 0, to_s: 12.5, name: "corridor")`; `trip` may be left out.
    Ron,
}

/// Intervals of trips that a person gave names to.
#[derive(Clone, Debug, PartialEq)]
pub struct Segmentation {
    /// In order of their first appearance.
    names: Vec<String>,
    /// By trip, then by time; none overlaps another.
    segments: Vec<Segment>,
}

/// A named interval, from its start to just before its end.
#[derive(Clone, Debug, PartialEq)]
struct Segment {
    /// Which of the trips.
    trip: usize,
    from_s: f64,
    to_s: f64,
    /// Which of the names.
    name: usize,
    /// Where it is written: `line 3` or `interval 3`.
    place: String,
}

/// What is wrong with a segmentation.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum SegmentationError {
    /// No table, or a cell of it that is none.
    #[error("line {line}: {message}")]
    Csv {
        /// Where, from 1.
        line: u64,
        /// What.
        message: String,
    },
    /// No RON, or an unknown field.
    #[error("line {line}, column {column}: {message}")]
    Ron {
        /// Where, from 1.
        line: usize,
        /// Where, from 1.
        column: usize,
        /// What.
        message: String,
    },
    /// Nothing in it.
    #[error("there is no interval in it; give at least one as trip, from_s, to_s and name")]
    Empty,
    /// A name that is none.
    #[error("{place}: the interval has no name; give it one")]
    NoName {
        /// Which interval.
        place: String,
    },
    /// A time that is none.
    #[error("{place}: the interval goes from {from_s} s to {to_s} s; both must be finite")]
    NotFinite {
        /// Which interval.
        place: String,
        /// Start.
        from_s: f64,
        /// End.
        to_s: f64,
    },
    /// It ends before it begins.
    #[error("{place}: the interval goes from {from_s} s to {to_s} s; its end must come after its start")]
    EndNotAfterStart {
        /// Which interval.
        place: String,
        /// Start.
        from_s: f64,
        /// End.
        to_s: f64,
    },
    /// A trip that is not evaluated.
    #[error("{place}: there is no trip {trip}; those that are evaluated are {known}")]
    UnknownTrip {
        /// Which interval.
        place: String,
        /// What it names.
        trip: String,
        /// Titles of the trips.
        known: String,
    },
    /// Several trips, and none is named.
    #[error("{place}: the interval names no trip, and there are several; it must be one of {known}")]
    WhichTrip {
        /// Which interval.
        place: String,
        /// Titles of the trips.
        known: String,
    },
    /// Two trips of one name, in different folders.
    #[error("{place}: {n_trips} of the trips are called {trip}; give their files different names")]
    SameTitle {
        /// Which interval.
        place: String,
        /// What it names.
        trip: String,
        /// How many have that name.
        n_trips: usize,
    },
    /// Two names for one time.
    #[error(
        "{place}: the interval from {from_s} s overlaps that of {other}, which ends at {other_to_s} s; each time of a trip has one name"
    )]
    Overlap {
        /// The later interval.
        place: String,
        /// When it begins.
        from_s: f64,
        /// The earlier one.
        other: String,
        /// When that ends.
        other_to_s: f64,
    },
    /// Outside of the trip, or between two frames.
    #[error(
        "{place}: no frame of {trip} lies between {from_s} s and {to_s} s; its frames are from {first_s:.1} s to {last_s:.1} s after the \
         trip's first"
    )]
    NoFrame {
        /// Which interval.
        place: String,
        /// The trip.
        trip: String,
        /// Start.
        from_s: f64,
        /// End.
        to_s: f64,
        /// The trip's first frame.
        first_s: f64,
        /// The trip's last frame.
        last_s: f64,
    },
}

impl Segmentation {
    /// Reads a segmentation.
    ///
    /// * `trips` — that it may be of: times are seconds as in [`TripKinds::seconds`]. Their kinds are not looked at
    ///
    /// # Errors
    /// If the text is not in the format, or an interval is none, overlaps another, has no frame or is of another trip.
    pub fn parse(text: &str, format: SegmentFormat, trips: &[TripKinds]) -> Result<Self, SegmentationError> {
        let rows = rows(text, format)?;
        if rows.is_empty() {
            return Err(SegmentationError::Empty);
        }
        let mut names: Vec<String> = Vec::new();
        let mut segments = Vec::new();
        for Row { place, trip, from_s, to_s, name } in rows {
            if name.is_empty() {
                return Err(SegmentationError::NoName { place });
            }
            if !(from_s.is_finite() && to_s.is_finite()) {
                return Err(SegmentationError::NotFinite { place, from_s, to_s });
            }
            if from_s >= to_s {
                return Err(SegmentationError::EndNotAfterStart { place, from_s, to_s });
            }
            let trip = find(&trip, trips, &place)?;
            let index = names.iter().position(|known| *known == name).unwrap_or_else(|| {
                names.push(name);
                names.len() - 1
            });
            segments.push(Segment { trip, from_s, to_s, name: index, place });
        }
        segments.sort_by(|a, b| a.trip.cmp(&b.trip).then(a.from_s.total_cmp(&b.from_s)));
        for pair in segments.windows(2) {
            let [earlier, later] = pair else { unreachable!("windows of two") };
            if earlier.trip == later.trip && later.from_s < earlier.to_s {
                return Err(SegmentationError::Overlap {
                    place: later.place.clone(),
                    from_s: later.from_s,
                    other: earlier.place.clone(),
                    other_to_s: earlier.to_s,
                });
            }
        }
        let segmentation = Self { names, segments };
        segmentation.segments.iter().try_for_each(|segment| check_frames(segment, &trips[segment.trip]))?;
        Ok(segmentation)
    }

    /// Which name each frame of a trip has, if any.
    ///
    /// * `seconds` — of the frames, ascending
    fn names_of_frames(&self, trip: usize, seconds: &[f64]) -> Vec<Option<usize>> {
        let mut of_frames = vec![None; seconds.len()];
        for segment in self.segments.iter().filter(|segment| segment.trip == trip) {
            of_frames[segment.frames(seconds)].fill(Some(segment.name));
        }
        of_frames
    }
}

impl Segment {
    fn frames(&self, seconds: &[f64]) -> std::ops::Range<usize> {
        let place = |time_s: f64| seconds.partition_point(|second| *second < time_s);
        place(self.from_s)..place(self.to_s)
    }
}

fn find(title: &str, trips: &[TripKinds], place: &str) -> Result<usize, SegmentationError> {
    let known = || trips.iter().map(|trip| trip.title).collect::<Vec<_>>().join(", ");
    let place = place.to_string();
    match (title, trips) {
        ("", [_]) => Ok(0),
        ("", _) => Err(SegmentationError::WhichTrip { place, known: known() }),
        _ => {
            let trip = title.to_string();
            let mut named = (0..trips.len()).filter(|index| trips[*index].title == title);
            match (named.next(), named.count()) {
                (None, _) => Err(SegmentationError::UnknownTrip { place, trip, known: known() }),
                (Some(index), 0) => Ok(index),
                (Some(_), n_others) => {
                    Err(SegmentationError::SameTitle { place, trip, n_trips: n_others + 1 })
                }
            }
        }
    }
}

fn check_frames(segment: &Segment, trip: &TripKinds) -> Result<(), SegmentationError> {
    if !segment.frames(trip.seconds).is_empty() {
        return Ok(());
    }
    let end = |second: Option<&f64>| second.copied().unwrap_or(0.0);
    Err(SegmentationError::NoFrame {
        place: segment.place.clone(),
        trip: trip.title.to_string(),
        from_s: segment.from_s,
        to_s: segment.to_s,
        first_s: end(trip.seconds.first()),
        last_s: end(trip.seconds.last()),
    })
}

#[cfg(test)]
mod tests;
