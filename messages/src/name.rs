//! A sensor's name, from which the names of its channels are made.

use std::fmt;
use std::str::FromStr;

/// Longest name, in characters (bytes: the characters allowed are ASCII).
const LENGTH_MAX: usize = 100;
/// Most parts of a name: for instance fleet, robot, group, sensor.
const N_PARTS_MAX: usize = 4;

/// Name of one sensor of one robot, such as `crunch/ring`.
///
/// One to four parts joined by `/`, each of the characters `A-Z a-z 0-9 _ . -`, at most 100 characters in all.
#[derive(Clone, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub struct SensorName(String);

impl SensorName {
    /// The name as it was written.
    pub fn as_str(&self) -> &str {
        &self.0
    }
}

impl fmt::Display for SensorName {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&self.0)
    }
}

impl FromStr for SensorName {
    type Err = SensorNameError;

    fn from_str(name: &str) -> Result<Self, SensorNameError> {
        let owned = || name.to_owned();
        let length = name.chars().count();
        if length > LENGTH_MAX {
            return Err(SensorNameError::TooLong { length });
        }
        let n_parts = name.split('/').count();
        if n_parts > N_PARTS_MAX {
            return Err(SensorNameError::TooManyParts { name: owned(), n_parts });
        }
        if name.split('/').any(str::is_empty) {
            return Err(SensorNameError::EmptyPart { name: owned() });
        }
        let allowed = |c: char| c.is_ascii_alphanumeric() || matches!(c, '_' | '.' | '-' | '/');
        match name.chars().find(|&c| !allowed(c)) {
            Some(character) => Err(SensorNameError::Character { name: owned(), character }),
            None => Ok(Self(owned())),
        }
    }
}

/// Why a text is no sensor name.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum SensorNameError {
    /// Nothing at all, or nothing before, after or between slashes.
    #[error("sensor name \"{name}\" has an empty part; write it as in \"ring\" or \"crunch/ring\"")]
    EmptyPart {
        /// The name as given.
        name: String,
    },
    /// A character that is not allowed.
    #[error(
        "sensor name \"{name}\" has the character {character:?}; only letters A-Z and a-z, digits, '_', '.' and '-' \
         may be used, and '/' between parts"
    )]
    Character {
        /// The name as given.
        name: String,
        /// The first such character.
        character: char,
    },
    /// Too many slashes.
    #[error("sensor name \"{name}\" has {n_parts} parts; use at most {N_PARTS_MAX}")]
    TooManyParts {
        /// The name as given.
        name: String,
        /// How many parts it has.
        n_parts: usize,
    },
    /// Too long a name.
    #[error("sensor name has {length} characters; use at most {LENGTH_MAX}")]
    TooLong {
        /// How many characters it has.
        length: usize,
    },
}

#[cfg(test)]
mod tests {
    use super::*;

    fn error(name: &str) -> String {
        name.parse::<SensorName>().unwrap_err().to_string()
    }

    #[test]
    fn names_of_one_to_four_parts_are_kept_as_written() {
        for name in ["ring", "crunch/ring", "a/b/c/d", "Chew-2/tof_16.left", ".", &"x".repeat(100)] {
            assert_eq!(name.parse::<SensorName>().unwrap().to_string(), name);
        }
    }

    #[test]
    fn other_names_are_refused_in_words() {
        for (name, sentence) in [
            ("", r#"sensor name "" has an empty part; write it as in "ring" or "crunch/ring""#),
            ("/ring", r#"sensor name "/ring" has an empty part; write it as in "ring" or "crunch/ring""#),
            ("a//b", r#"sensor name "a//b" has an empty part; write it as in "ring" or "crunch/ring""#),
            ("a/", r#"sensor name "a/" has an empty part; write it as in "ring" or "crunch/ring""#),
            ("a/b/c/d/e", r#"sensor name "a/b/c/d/e" has 5 parts; use at most 4"#),
            (&"x".repeat(101), "sensor name has 101 characters; use at most 100"),
            (
                "my ring",
                r#"sensor name "my ring" has the character ' '; only letters A-Z and a-z, digits, '_', '.' and '-' may be used, and '/' between parts"#,
            ),
            (
                "crünch",
                r#"sensor name "crünch" has the character 'ü'; only letters A-Z and a-z, digits, '_', '.' and '-' may be used, and '/' between parts"#,
            ),
        ] {
            assert_eq!(error(name), sentence);
        }
    }
}
