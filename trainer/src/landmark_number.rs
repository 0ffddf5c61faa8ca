//! How many landmarks a person asks for: all frames, a count, or a share of the frames.

use std::str::FromStr;

use ron::value::RawValue;
use serde::{Deserialize, Deserializer, de::Error};

/// All frames, a count of them, or a share: `all`, `500`, `25%`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum LandmarkNumber {
    /// Every reference frame.
    All,
    /// So many, or all if there are no more.
    Count(usize),
    /// A share of the reference frames, above 0, at most 1.
    Share(f64),
}

/// Not a number of landmarks.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error(
    "landmarks are {0}; they must be all, a count such as 500, or a share above 0% and at most 100% such as 25%"
)]
pub struct LandmarkNumberError(String);

impl LandmarkNumber {
    /// n, where there are so many reference frames: at least 1, and no more than there are.
    pub fn of(self, n_frames: usize) -> usize {
        match self {
            Self::All => n_frames,
            Self::Count(count) => count.min(n_frames),
            Self::Share(share) => ((share * n_frames as f64).round() as usize).clamp(1, n_frames),
        }
    }
}

impl FromStr for LandmarkNumber {
    type Err = LandmarkNumberError;

    fn from_str(text: &str) -> Result<Self, LandmarkNumberError> {
        let number = match text.strip_suffix('%') {
            _ if text == "all" => Some(Self::All),
            Some(percent) => {
                let share = percent.trim_end().parse().map(|percent: f64| percent / 100.0).ok();
                share.filter(|share| *share > 0.0 && *share <= 1.0).map(Self::Share)
            }
            None => text.parse().ok().filter(|count| *count > 0).map(Self::Count),
        };
        number.ok_or_else(|| LandmarkNumberError(text.to_string()))
    }
}

/// From RON: `all`, `500`, or `"25%"`, which is no word of RON and therefore stands in quotes.
impl<'de> Deserialize<'de> for LandmarkNumber {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        let raw = <&RawValue>::deserialize(deserializer)?;
        let text = raw.get_ron().trim();
        let unquoted = text.strip_prefix('"').and_then(|text| text.strip_suffix('"'));
        unquoted.unwrap_or(text).parse().map_err(D::Error::custom)
    }
}

#[cfg(test)]
mod tests {
    use LandmarkNumber::{All, Count, Share};

    use super::*;

    #[test]
    fn all_a_count_and_a_share_are_read_alike_from_flags_and_ron() {
        for (flag, ron, expected) in [
            ("all", "all", All),
            ("500", "500", Count(500)),
            ("25%", "\"25%\"", Share(0.25)),
            ("12.5%", "\"12.5%\"", Share(0.125)),
            ("100%", "\"100%\"", Share(1.0)),
        ] {
            assert_eq!(flag.parse(), Ok(expected));
            assert_eq!(ron::from_str(ron), Ok(expected), "{ron}");
        }
        assert_eq!(ron::from_str("\"all\""), Ok(All));
    }

    #[test]
    fn what_is_no_number_of_landmarks_is_refused_with_what_would_be_one() {
        for text in ["0", "-3", "2.5", "0%", "101%", "-1%", "NaN%", "%", "some", ""] {
            assert_eq!(
                text.parse::<LandmarkNumber>().unwrap_err().to_string(),
                format!(
                    "landmarks are {text}; they must be all, a count such as 500, or a share above 0% and at most 100% \
                     such as 25%"
                )
            );
        }
        let message = ron::from_str::<LandmarkNumber>("some").unwrap_err().to_string();
        assert!(message.contains("landmarks are some; they must be all, a count"), "{message}");
    }

    #[test]
    fn a_share_is_of_the_frames_and_at_least_one() {
        assert_eq!(
            [All, Count(5), Count(50), Share(0.25), Share(0.001), Share(1.0)].map(|n| n.of(18)),
            [18, 5, 18, 5, 1, 18]
        );
    }
}
