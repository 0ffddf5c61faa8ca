//! Which faults are to befall a device's frames, as a RON file says it.

use serde::Deserialize;

/// How often each fault befalls a frame. Every field may be left out: then that fault does not happen.
///
/// At most one fault befalls a frame, so that what the others count can be held against what was injected.
///
/// ```
/// let faults = kinds_driver_shim::Faults::from_ron("(seed: 7, drop: 0.01, delay: 0.02, delay_ms: 300)").unwrap();
/// assert_eq!((faults.drop, faults.repeat), (0.01, 0.0));
/// ```
#[derive(Clone, Debug, PartialEq, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Faults {
    /// Seed of all chance here. Default: 0.
    pub seed: u64,
    /// Share of frames that never come, 0 to 1.
    pub drop: f64,
    /// Share of frames that come twice, 0 to 1.
    pub repeat: f64,
    /// Share of frames that the next one overtakes, 0 to 1.
    pub reorder: f64,
    /// Share of frames that come late, and all after them, until the device has caught up, 0 to 1.
    pub delay: f64,
    /// How late, milliseconds, 0 to 60000. Default: 250.
    pub delay_ms: f64,
    /// Share of frames in one of whose counts one bit is flipped, 0 to 1.
    pub flip_bit: f64,
    /// Share of frames without any valid reading, 0 to 1.
    pub invalid: f64,
    /// Share of frames that lack their last reading, 0 to 1.
    pub wrong_length: f64,
}

impl Default for Faults {
    fn default() -> Self {
        Self {
            seed: 0,
            drop: 0.0,
            repeat: 0.0,
            reorder: 0.0,
            delay: 0.0,
            delay_ms: 250.0,
            flip_bit: 0.0,
            invalid: 0.0,
            wrong_length: 0.0,
        }
    }
}

/// Why a text says no faults.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum FaultsError {
    /// Not RON, or not these fields.
    #[error("line {line}, column {column}: {reason}")]
    Ron {
        /// Line, from 1.
        line: usize,
        /// Column, from 1.
        column: usize,
        /// What is wrong there.
        reason: String,
    },
    /// A number beyond its limits.
    #[error("{field} is {value}; it must be between 0 and {most}")]
    Limit {
        /// Its name.
        field: &'static str,
        /// As given.
        value: f64,
        /// The greatest that can be.
        most: f64,
    },
    /// More faults than frames.
    #[error(
        "the shares of all faults add up to {sum}; at most one befalls a frame, so they must add up to at most 1"
    )]
    TooMany {
        /// What they add up to.
        sum: f64,
    },
}

/// What may befall a frame.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Fault {
    Drop,
    Repeat,
    Reorder,
    Delay,
    FlipBit,
    Invalid,
    WrongLength,
}

impl Faults {
    /// Reads what a file says.
    ///
    /// # Errors
    /// If the text is not RON or has a field that there is not, with line and column; if a number is beyond its limits.
    pub fn from_ron(text: &str) -> Result<Self, FaultsError> {
        let faults: Self = ron::from_str(text).map_err(|error| FaultsError::Ron {
            line: error.span.start.line,
            column: error.span.start.col,
            reason: error.code.to_string(),
        })?;
        faults.check()?;
        Ok(faults)
    }

    /// Checks every number against its limits.
    ///
    /// # Errors
    /// With field, value and limit.
    pub fn check(&self) -> Result<(), FaultsError> {
        const DELAY_MS_MAX: f64 = 60_000.0;
        let shares = self.shares().map(|(_, field, share)| (field, share, 1.0));
        for (field, value, most) in shares.into_iter().chain([("delay_ms", self.delay_ms, DELAY_MS_MAX)]) {
            if !(0.0..=most).contains(&value) {
                return Err(FaultsError::Limit { field, value, most });
            }
        }
        let sum: f64 = self.shares().iter().map(|(_, _, share)| share).sum();
        // Ten shares of a tenth are one, whatever they come to in binary.
        if sum > 1.0 + 1e-9 { Err(FaultsError::TooMany { sum }) } else { Ok(()) }
    }

    /// Each fault with its field and its share.
    fn shares(&self) -> [(Fault, &'static str, f64); 7] {
        [
            (Fault::Drop, "drop", self.drop),
            (Fault::Repeat, "repeat", self.repeat),
            (Fault::Reorder, "reorder", self.reorder),
            (Fault::Delay, "delay", self.delay),
            (Fault::FlipBit, "flip_bit", self.flip_bit),
            (Fault::Invalid, "invalid", self.invalid),
            (Fault::WrongLength, "wrong_length", self.wrong_length),
        ]
    }

    /// Which fault befalls a frame, if any.
    ///
    /// * `chance` — uniform from 0 to below 1
    pub(crate) fn at(&self, chance: f64) -> Option<Fault> {
        let mut below = 0.0;
        let befalls = |&(_, _, share): &(Fault, &str, f64)| {
            below += share;
            chance < below
        };
        self.shares().into_iter().find(befalls).map(|(fault, _, _)| fault)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn refuse(text: &str) -> String {
        Faults::from_ron(text).unwrap_err().to_string()
    }

    #[test]
    fn wrong_fields_and_numbers_are_refused_with_place_value_and_limit() {
        let unknown = refuse("(\n  drop: 0.1,\n  dorp: 0.1,\n)");
        assert!(unknown.starts_with("line 3, column ") && unknown.contains("dorp"), "{unknown}");
        assert_eq!(refuse("(drop: 1.5)"), "drop is 1.5; it must be between 0 and 1");
        assert_eq!(refuse("(repeat: -0.1)"), "repeat is -0.1; it must be between 0 and 1");
        assert_eq!(refuse("(invalid: NaN)"), "invalid is NaN; it must be between 0 and 1");
        assert_eq!(refuse("(delay_ms: 1e6)"), "delay_ms is 1000000; it must be between 0 and 60000");
        assert_eq!(
            refuse("(drop: 0.75, repeat: 0.5)"),
            "the shares of all faults add up to 1.25; at most one befalls a frame, so they must add up to at most 1"
        );
    }

    #[test]
    fn an_empty_file_lets_everything_through() {
        let faults = Faults::from_ron("()").unwrap();
        assert_eq!(faults, Faults::default());
        assert_eq!(faults.at(0.0), None);
    }

    #[test]
    fn faults_have_the_shares_of_chance_that_they_are_given() {
        let faults = Faults { drop: 0.25, flip_bit: 0.5, ..Faults::default() };
        let drawn = [0.0, 0.2499, 0.25, 0.7499, 0.75, 0.9999].map(|chance| faults.at(chance));
        let (drop, flip) = (Some(Fault::Drop), Some(Fault::FlipBit));
        assert_eq!(drawn, [drop, drop, flip, flip, None, None]);
    }
}
