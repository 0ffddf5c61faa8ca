//! Two floors of an office building, and the routes that are driven on them.
//!
//! A floor's plan is fixed: walls, doorways, furniture, route. What differs from trip to trip is drawn from the trip's
//! streams: which doors stand open and how wide, where chairs are left, where people stand ([`plan`]).

mod fifth;
mod fourth;
mod plan;

use std::fmt;
use std::str::FromStr;

use nalgebra::Vector2;

use super::random::Streams;
use super::world::Wall;

/// A floor of the office building.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Floor {
    /// A ring of corridors about an atrium, a glazed cross corridor and a laboratory; offices all around.
    Fourth,
    /// A gallery about the atrium's void, a long corridor with a dead end, a cross corridor, a seminar room.
    Fifth,
}

impl Floor {
    /// Both floors, from below.
    pub const ALL: [Self; 2] = [Self::Fourth, Self::Fifth];

    /// Its name, which [`str::parse`] reads back.
    pub fn name(self) -> &'static str {
        match self {
            Self::Fourth => "fourth-floor",
            Self::Fifth => "fifth-floor",
        }
    }

    /// Everything that stands on the floor during one trip, and the route.
    pub(crate) fn on_trip(self, streams: &Streams) -> (Vec<Wall>, Vec<Vector2<f64>>) {
        let plan = match self {
            Self::Fourth => &fourth::PLAN,
            Self::Fifth => &fifth::PLAN,
        };
        (plan.walls(streams), plan.route())
    }
}

impl fmt::Display for Floor {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.name())
    }
}

impl FromStr for Floor {
    type Err = FloorError;

    fn from_str(text: &str) -> Result<Self, FloorError> {
        let floor = Self::ALL.into_iter().find(|floor| floor.name() == text);
        floor.ok_or_else(|| FloorError { text: text.to_owned() })
    }
}

/// A text that names no floor.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("there is no floor \"{text}\" to drive on; choose fourth-floor or fifth-floor")]
pub struct FloorError {
    /// The text as given.
    pub text: String,
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn floors_are_read_from_their_names_or_refused_in_words() {
        for floor in Floor::ALL {
            assert_eq!(floor.to_string().parse(), Ok(floor));
        }
        assert_eq!(
            "attic".parse::<Floor>().unwrap_err().to_string(),
            "there is no floor \"attic\" to drive on; choose fourth-floor or fifth-floor"
        );
    }
}
