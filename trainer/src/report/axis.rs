//! Axes: from numbers to pixels, and the round numbers that are written beside them.

/// A linear map from numbers to pixels.
#[derive(Clone, Copy, Debug)]
pub(super) struct Scale {
    low: f64,
    px_at_low: f64,
    px_per_unit: f64,
}

/// Round numbers on an axis: multiples of 1, 2 or 5 times a power of ten.
#[derive(Clone, Debug)]
pub(super) struct Ticks {
    /// Ascending, within the axis.
    pub(super) values: Vec<f64>,
    decimals: usize,
    /// Large numbers are written as multiples of this power of ten.
    exponent: i32,
}

impl Scale {
    /// The scale on which `low` … `high` fill `from_px` … `to_px`. Both ends must be finite, and differ.
    pub(super) fn new((low, high): (f64, f64), (from_px, to_px): (f64, f64)) -> Self {
        assert!(low != high, "an axis from {low} to {high} has no length");
        Self { low, px_at_low: from_px, px_per_unit: (to_px - from_px) / (high - low) }
    }

    pub(super) fn px(&self, value: f64) -> f64 {
        self.px_at_low + (value - self.low) * self.px_per_unit
    }
}

impl Ticks {
    /// About `n` round numbers (none for 0) between `low` and `high`, at least `step_min` apart.
    pub(super) fn new((low, high): (f64, f64), n: usize, step_min: f64) -> Self {
        if n == 0 {
            return Self { values: Vec::new(), decimals: 0, exponent: 0 };
        }
        let (low, high) = (low.min(high), low.max(high));
        let rough = ((high - low) / n as f64).max(step_min);
        let unit = 10_f64.powf(rough.log10().floor());
        // The nearest of 1, 2, 5 and 10 by ratio.
        let step = match rough / unit {
            ratio if ratio < 2_f64.sqrt() => unit,
            ratio if ratio < 10_f64.sqrt() => 2.0 * unit,
            ratio if ratio < 50_f64.sqrt() => 5.0 * unit,
            _ => 10.0 * unit,
        };
        let (first, last) = ((low / step - 1e-9).ceil() as i64, (high / step + 1e-9).floor() as i64);
        let values: Vec<f64> = (first..=last).map(|index| index as f64 * step).collect();
        let largest = values.iter().fold(0.0_f64, |largest, value| largest.max(value.abs()));
        let exponent = if largest >= 1e4 { largest.log10().floor() as i32 / 3 * 3 } else { 0 };
        let decimals = (f64::from(exponent) - step.log10() - 1e-9).ceil().max(0.0) as usize;
        Self { values, decimals, exponent }
    }

    /// How a number is written beside the axis.
    pub(super) fn label(&self, value: f64) -> String {
        let text = format!("{:.*}", self.decimals, value / 10_f64.powi(self.exponent));
        match text.strip_prefix('-') {
            Some(magnitude) if magnitude.contains(|digit| ('1'..='9').contains(&digit)) => {
                format!("−{magnitude}")
            }
            Some(zero) => zero.to_string(),
            None => text,
        }
    }

    /// The unit that the labels are multiples of, if that is not one: `10³ counts`.
    pub(super) fn unit(&self, unit: &str) -> String {
        let superscript = |digit: char| "⁰¹²³⁴⁵⁶⁷⁸⁹".chars().nth(digit.to_digit(10).unwrap_or(0) as usize);
        match self.exponent {
            0 => unit.to_string(),
            exponent => format!(
                "10{} {unit}",
                exponent.to_string().chars().filter_map(superscript).collect::<String>()
            ),
        }
    }
}

/// The range of numbers, somewhat widened, so that nothing is drawn on the edge; never empty. Numbers that are not finite
/// are passed over.
pub(super) fn range(values: impl IntoIterator<Item = f64>) -> (f64, f64) {
    let finite = values.into_iter().filter(|value| value.is_finite());
    let (low, high) = finite
        .fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), value| (low.min(value), high.max(value)));
    if low > high {
        return (0.0, 1.0);
    }
    let margin = 0.04 * (high - low);
    // A single number: wide enough that the ends differ whatever its size.
    let margin = if margin > 0.0 { margin } else { low.abs().mul_add(0.05, 0.5) };
    (low - margin, high + margin)
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    #[test]
    fn labels_are_round_and_have_the_digits_that_they_need() {
        let check = |range, n, expected: &[&str]| {
            let ticks = Ticks::new(range, n, 0.0);
            assert_eq!(ticks.values.iter().map(|value| ticks.label(*value)).collect::<Vec<_>>(), expected);
        };
        check((0.0, 1.0), 5, &["0.0", "0.2", "0.4", "0.6", "0.8", "1.0"]);
        check((-12.0, 31.0), 5, &["−10", "0", "10", "20", "30"]);
        check((0.001, 0.0162), 3, &["0.005", "0.010", "0.015"]);
        check((-0.3, 0.3), 2, &["−0.2", "0.0", "0.2"]);
        check((0.0, 48000.0), 5, &["0", "10", "20", "30", "40"]);
    }

    #[test]
    fn large_numbers_name_their_power_of_ten_once() {
        assert_eq!(Ticks::new((0.0, 48000.0), 5, 0.0).unit("counts"), "10³ counts");
        assert_eq!(Ticks::new((0.0, 4.8e12), 5, 0.0).unit("counts²"), "10¹² counts²");
        assert_eq!(Ticks::new((0.0, 9000.0), 5, 0.0).unit("counts"), "counts");
    }

    #[test]
    fn things_that_are_counted_have_whole_ticks() {
        assert_eq!(Ticks::new((0.9, 3.1), 8, 1.0).values, [1.0, 2.0, 3.0]);
    }

    proptest! {
        #[test]
        fn ticks_lie_within_the_axis_and_are_neither_none_nor_many(low in -1e6..1e6_f64, length in 1e-3..1e7_f64) {
            let high = low + length;
            let values = Ticks::new((low, high), 5, 0.0).values;
            prop_assert!(!values.is_empty() && values.len() <= 8, "{values:?}");
            let slack = 1e-6 * length;
            prop_assert!(values.iter().all(|value| (low - slack..=high + slack).contains(value)), "{values:?}");
        }

        #[test]
        fn a_range_has_a_length_and_holds_what_it_is_of(values in prop::collection::vec(-1e9..1e9_f64, 0..9)) {
            let (low, high) = range(values.iter().copied().chain([f64::NAN]));
            prop_assert!(low < high);
            prop_assert!(values.iter().all(|value| low < *value && *value < high));
        }
    }
}
