//! The response: raw counts → the scale on which frames are compared.
//!
//! Euclidean distance on raw ranges lets far, noisy readings dominate. A response maps every raw count to a count on
//! another scale (range, log range or inverse range); clipping at the largest useful range and the place of invalid
//! readings are entries of the same table. Fitting and serving use this one table, so they cannot disagree, and
//! everything after it is integer arithmetic.

use serde::{Deserialize, Serialize};

use crate::array::Array;

/// The raw count that means: no measurement.
pub const INVALID: u16 = 0;

/// Entries of a response table: one for every raw count.
pub const TABLE_LEN: usize = 1 << 16;

/// The scale on which ranges are compared.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum Scale {
    /// The range itself.
    #[serde(alias = "range")]
    Range,
    /// `ln(1 + range / offset)`: equal ratios of range are equally far apart.
    #[serde(alias = "log")]
    Log,
    /// `1 / (range + offset)`: near things count, far things hardly.
    #[serde(alias = "inverse")]
    Inverse,
}

/// How a response table is made.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ResponsePlan {
    /// The scale.
    pub scale: Scale,
    /// Largest useful range, metres: longer ranges, and no return, are taken for this one.
    pub range_m_max: f64,
    /// Range that an invalid reading is taken for, metres.
    pub invalid_range_m: f64,
    /// Offset of the logarithmic and the inverse scale, metres: ranges well below it are hardly told apart on the
    /// logarithmic scale, ranges well above it hardly on the inverse one.
    pub offset_m: f64,
}

/// Why a response table cannot be made.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum ResponseError {
    /// A length is not usable.
    #[error("response: {what} is {value} m; it must be {limit}")]
    Length {
        /// Which one, in words.
        what: &'static str,
        /// What was given, metres.
        value: f64,
        /// What is allowed, in words.
        limit: String,
    },
}

/// The table: raw count → count on the response's scale, shape `(65536,)`.
#[derive(Clone, Debug)]
pub struct Response {
    table: Array<u16>,
}

impl ResponsePlan {
    /// The usual plan for a scale: an invalid reading counts as the largest useful range, offset 0.3 m.
    pub fn new(scale: Scale, range_m_max: f64) -> Self {
        Self { scale, range_m_max, invalid_range_m: range_m_max, offset_m: 0.3 }
    }

    fn check(&self) -> Result<(), ResponseError> {
        let positive = |what, value: f64| match value.is_finite() && value > 0.0 {
            true => Ok(()),
            false => Err(ResponseError::Length { what, value, limit: "positive".to_string() }),
        };
        positive("the largest useful range", self.range_m_max)?;
        positive("the offset of the scale", self.offset_m)?;
        match (0.0..=self.range_m_max).contains(&self.invalid_range_m) {
            true => Ok(()),
            false => Err(ResponseError::Length {
                what: "the range that invalid readings are taken for",
                value: self.invalid_range_m,
                limit: format!("between 0 and the largest useful range, {} m", self.range_m_max),
            }),
        }
    }

    /// Place of a range on the scale, in counts that fill `u16` as well as the scale allows.
    fn place(&self, range_m: f64, metres_per_count: f64) -> f64 {
        let range_m = range_m.min(self.range_m_max);
        let full = f64::from(u16::MAX);
        match self.scale {
            // One count stays one count, so that distances keep their plain meaning.
            Scale::Range => range_m / metres_per_count,
            Scale::Log => {
                full * libm::log1p(range_m / self.offset_m) / libm::log1p(self.range_m_max / self.offset_m)
            }
            Scale::Inverse => full * self.offset_m / (range_m + self.offset_m),
        }
    }
}

impl Response {
    /// Computes the table.
    ///
    /// * `metres_per_count` — what one raw count stands for, metres
    ///
    /// # Errors
    /// If a length of the plan is not positive, or invalid readings would lie outside the scale.
    pub fn new(plan: &ResponsePlan, metres_per_count: f64) -> Result<Self, ResponseError> {
        plan.check()?;
        let range_m = |raw: usize| match raw as u16 {
            INVALID => plan.invalid_range_m,
            raw => f64::from(raw) * metres_per_count,
        };
        // `as` saturates: a range scale longer than u16 counts ends at the last count.
        let table: Vec<u16> =
            (0..TABLE_LEN).map(|raw| plan.place(range_m(raw), metres_per_count).round() as u16).collect();
        Ok(Self { table: table.into() })
    }

    /// A table that was computed before. `None` if it has not 65,536 entries.
    pub fn from_table(table: Array<u16>) -> Option<Self> {
        (table.len() == TABLE_LEN).then_some(Self { table })
    }

    /// The table, shape `(65536,)`.
    pub fn table(&self) -> &[u16] {
        &self.table
    }

    /// Maps a frame and returns the number of invalid readings in it.
    ///
    /// * `raw` — raw counts, shape `(n_readings,)`
    /// * `mapped` — overwritten; same shape
    pub fn map(&self, raw: &[u16], mapped: &mut [u16]) -> usize {
        assert_eq!(raw.len(), mapped.len(), "a frame and its place must have the same number of readings");
        // Of a length that is known here, every raw count is within it: nothing is left to be checked for each reading.
        let table: &[u16; TABLE_LEN] = self.table().try_into().expect("checked when it was made");
        for (&raw, mapped) in raw.iter().zip(mapped) {
            *mapped = table[usize::from(raw)];
        }
        raw.iter().filter(|&&raw| raw == INVALID).count()
    }

    /// Maps counts of any number of frames where they stand.
    pub fn map_in_place(&self, counts: &mut [u16]) {
        let table = self.table();
        counts.iter_mut().for_each(|count| *count = table[usize::from(*count)]);
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    const MM: f64 = 0.001;

    fn response(scale: Scale) -> Response {
        Response::new(&ResponsePlan::new(scale, 4.0), MM).unwrap()
    }

    #[test]
    fn range_is_the_identity_up_to_the_largest_useful_range() {
        let response = response(Scale::Range);
        for raw in 1..=4000_u16 {
            assert_eq!(response.table()[usize::from(raw)], raw);
        }
        assert!(response.table()[4000..].iter().all(|&mapped| mapped == 4000));
    }

    #[test]
    fn invalid_and_no_return_share_the_place_of_the_largest_useful_range_by_default() {
        for scale in [Scale::Range, Scale::Log, Scale::Inverse] {
            let response = response(scale);
            assert_eq!(response.table()[usize::from(INVALID)], response.table()[4000], "{scale:?}");
            assert_eq!(response.table()[usize::from(u16::MAX)], response.table()[4000], "{scale:?}");
        }
    }

    #[test]
    fn inverse_follows_its_formula_at_hand_computed_ranges() {
        // 65535 · 0.3 / (r + 0.3): r = 0.3 m → half, r = 2.7 m → a tenth.
        let response = response(Scale::Inverse);
        assert_eq!(response.table()[300], 32768);
        assert_eq!(response.table()[2700], 6554);
    }

    #[test]
    fn log_gives_equal_steps_to_equal_ratios_of_range_plus_offset() {
        let response = response(Scale::Log);
        let step = |a: usize, b: usize| i32::from(response.table()[b]) - i32::from(response.table()[a]);
        // 0.3 + r doubles from 0.3 → 0.9 (0.6 → 1.2) and from 0.9 → 2.1 (1.2 → 2.4).
        assert!((step(300, 900) - step(900, 2100)).abs() <= 1);
    }

    #[test]
    fn lengths_that_make_no_scale_are_refused_in_words() {
        let plan = ResponsePlan { range_m_max: 0.0, ..ResponsePlan::new(Scale::Log, 4.0) };
        let message = Response::new(&plan, MM).unwrap_err().to_string();
        assert_eq!(message, "response: the largest useful range is 0 m; it must be positive");
        let plan = ResponsePlan { invalid_range_m: 5.0, ..ResponsePlan::new(Scale::Log, 4.0) };
        let message = Response::new(&plan, MM).unwrap_err().to_string();
        assert_eq!(
            message,
            "response: the range that invalid readings are taken for is 5 m; it must be between 0 and the largest useful range, 4 m"
        );
    }

    proptest! {
        #[test]
        fn every_scale_is_monotone(a in 1..=u16::MAX, b in 1..=u16::MAX, clip_m in 0.1..60.0_f64) {
            let (near, far) = (usize::from(a.min(b)), usize::from(a.max(b)));
            for scale in [Scale::Range, Scale::Log] {
                let response = Response::new(&ResponsePlan::new(scale, clip_m), MM).unwrap();
                prop_assert!(response.table()[near] <= response.table()[far]);
            }
            let inverse = Response::new(&ResponsePlan::new(Scale::Inverse, clip_m), MM).unwrap();
            prop_assert!(inverse.table()[near] >= inverse.table()[far]);
        }
    }
}
