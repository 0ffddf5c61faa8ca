//! RON files that a person writes, and what is wrong with one in words: file, line, column, and what was perhaps meant.

use std::fmt;
use std::path::{Path, PathBuf};
use std::str::FromStr;

use ron::error::SpannedError;
use ron::extensions::Extensions;
use serde::de::{DeserializeOwned, Error, Visitor};
use serde::{Deserialize, Deserializer};

use crate::failure::Failure;

/// Reads a file.
///
/// * `what` — what it is to whoever is told of a failure, such as "configuration"
pub(crate) fn read<T: DeserializeOwned>(what: &str, path: &Path) -> Result<T, Failure> {
    parse(&text(what, path)?).map_err(|words| wrong(what, path, words))
}

pub(crate) fn text(what: &str, path: &Path) -> Result<String, Failure> {
    std::fs::read_to_string(path).map_err(|error| Failure::file(&format!("read {what}"), path, &error))
}

/// A file that says what cannot be.
pub(crate) fn wrong(what: &str, path: &Path, words: impl fmt::Display) -> Failure {
    Failure::AskedWrongly(format!("{what} {}: {words}", path.display()))
}

/// Reads what a file says, or says with line and column why it cannot.
pub(crate) fn parse<T: DeserializeOwned>(text: &str) -> Result<T, String> {
    let options = ron::Options::default().with_default_extension(Extensions::IMPLICIT_SOME);
    options.from_str(text).map_err(|error: SpannedError| {
        let place = error.span.start;
        format!("line {}, column {}: {}", place.line, place.col, reason(&error.code))
    })
}

fn reason(code: &ron::Error) -> String {
    match code {
        ron::Error::NoSuchStructField { expected, found, .. } => {
            format!("there is no field {found}; {}", instead("fields", found, expected))
        }
        ron::Error::NoSuchEnumVariant { expected, found, .. } => {
            format!("there is no choice {found}; {}", instead("choices", found, expected))
        }
        ron::Error::ExpectedDifferentStructName { expected, found } => {
            format!("it begins with {found}, and is read as {expected}")
        }
        ron::Error::DuplicateStructField { field, .. } => format!("field {field} stands there twice"),
        ron::Error::MissingStructField { field, .. } => format!("field {field} is missing"),
        other => other.to_string(),
    }
}

/// What was perhaps meant, or else all that could be.
fn instead(what: &str, found: &str, expected: &[&str]) -> String {
    let distance = |name: &&&str| strsim::damerau_levenshtein(&found.to_lowercase(), &name.to_lowercase());
    let nearest = expected.iter().min_by_key(distance);
    match nearest {
        // A letter too many, too few, other or in the wrong place in each three.
        Some(name) if distance(&name) <= name.len().div_ceil(3) => format!("did you mean {name}?"),
        _ => format!("the {what} are {}", expected.join(", ")),
    }
}

/// What stands in a file of its own, as a flag says it, or here, as another file does.
#[derive(Clone, Debug, PartialEq)]
pub(crate) enum Given<T> {
    InFile(PathBuf),
    Here(T),
}

impl<T> Given<T> {
    /// The file of its own.
    pub(crate) fn path(&self) -> Option<&Path> {
        match self {
            Self::InFile(path) => Some(path),
            Self::Here(_) => None,
        }
    }
}

impl<T: DeserializeOwned> Given<T> {
    /// * `what` — as for [`read`]
    pub(crate) fn read(self, what: &str) -> Result<T, Failure> {
        match self {
            Self::InFile(path) => read(what, &path),
            Self::Here(value) => Ok(value),
        }
    }
}

impl<T> FromStr for Given<T> {
    type Err = std::convert::Infallible;

    fn from_str(path: &str) -> Result<Self, Self::Err> {
        Ok(Self::InFile(path.into()))
    }
}

impl<'de, T: Deserialize<'de>> Deserialize<'de> for Given<T> {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        T::deserialize(deserializer).map(Self::Here)
    }
}

/// A field that is written as its flag is, in quotes. A number need not be.
pub(crate) fn as_flag<'de, D, T>(deserializer: D) -> Result<Option<T>, D::Error>
where
    D: Deserializer<'de>,
    T: FromStr<Err: fmt::Display>,
{
    struct Text;

    impl Visitor<'_> for Text {
        type Value = String;

        fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
            f.write_str("a text in quotes")
        }

        fn visit_str<E: Error>(self, text: &str) -> Result<String, E> {
            Ok(text.to_owned())
        }

        fn visit_i64<E: Error>(self, number: i64) -> Result<String, E> {
            Ok(number.to_string())
        }

        fn visit_u64<E: Error>(self, number: u64) -> Result<String, E> {
            Ok(number.to_string())
        }

        fn visit_f64<E: Error>(self, number: f64) -> Result<String, E> {
            Ok(number.to_string())
        }
    }

    let text = deserializer.deserialize_any(Text)?;
    text.parse().map(Some).map_err(Error::custom)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[derive(Debug, Default, PartialEq, Deserialize)]
    #[serde(default, deny_unknown_fields, rename = "Ride")]
    struct Ride {
        vehicle: Option<Vehicle>,
        n_wheels: Option<u8>,
        #[serde(deserialize_with = "as_flag")]
        to: Option<std::net::SocketAddr>,
        pace: Option<Given<Pace>>,
    }

    #[derive(Debug, PartialEq, Deserialize)]
    #[serde(rename_all = "lowercase")]
    enum Vehicle {
        Bicycle,
        Rover,
    }

    #[derive(Debug, PartialEq, Deserialize)]
    #[serde(deny_unknown_fields)]
    struct Pace {
        m_s: f64,
    }

    #[test]
    fn a_file_may_leave_out_its_name_and_some_and_every_field() {
        assert_eq!(parse("()"), Ok(Ride::default()));
        let whole: Ride =
            parse("Ride(vehicle: rover, n_wheels: 6, to: \"[::1]:80\", pace: (m_s: 2.5))").unwrap();
        assert_eq!(whole.pace, Some(Given::Here(Pace { m_s: 2.5 })));
        assert_eq!((whole.vehicle, whole.n_wheels), (Some(Vehicle::Rover), Some(6)));
    }

    #[test]
    fn what_is_wrong_is_said_with_its_place_and_what_was_perhaps_meant() {
        for (text, words) in [
            ("(\n  n_whels: 3)", "line 2, column 3: there is no field n_whels; did you mean n_wheels?"),
            ("(wheels: 3)", "line 1, column 2: there is no field wheels; did you mean n_wheels?"),
            (
                "(depth: 3)",
                "line 1, column 2: there is no field depth; the fields are vehicle, n_wheels, to, pace",
            ),
            ("(vehicle: Rovr)", "line 1, column 11: there is no choice Rovr; did you mean rover?"),
            ("(vehicle: boat)", "line 1, column 11: there is no choice boat; the choices are bicycle, rover"),
            ("(pace: (ms: 3))", "line 1, column 9: there is no field ms; did you mean m_s?"),
            ("(pace: ())", "line 1, column 9: field m_s is missing"),
            ("(n_wheels: 1, n_wheels: 2)", "line 1, column 15: field n_wheels stands there twice"),
            ("Rid(n_wheels: 1)", "line 1, column 1: it begins with Rid, and is read as Ride"),
            ("(to: \"here\")", "line 1, column 7: invalid socket address syntax"),
        ] {
            assert_eq!(parse::<Ride>(text), Err(words.to_string()), "{text}");
        }
    }
}
