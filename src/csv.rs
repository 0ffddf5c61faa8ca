//! Numbers in tables that people and programs compare.

/// A number with as many digits as tell it from every other: reads back bit for bit. Small ones with an exponent.
pub(crate) fn number(value: f64) -> String {
    if value != 0.0 && value.abs() < 1e-3 { format!("{value:e}") } else { value.to_string() }
}

/// A column for each probability, each with a comma before it.
pub(crate) fn probabilities(probabilities: &[f64]) -> String {
    probabilities.iter().map(|probability| format!(",{}", number(*probability))).collect()
}

/// Titles of these columns: a letter and the kind.
pub(crate) fn probability_titles(letter: char, n_kinds: usize) -> String {
    (0..n_kinds).map(|kind| format!(",{letter}{kind}")).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_read_back_bit_for_bit() {
        for value in [0.0, -0.0, 1.0, 0.1 + 0.2, 1e-3, 9.999e-4, 3.3e-310, -82.84074913273308, f64::MAX] {
            assert_eq!(number(value).parse::<f64>().unwrap().to_bits(), value.to_bits(), "{}", number(value));
        }
        assert_eq!(
            (number(1.0), number(0.25), number(2.5e-40)),
            ("1".into(), "0.25".into(), "2.5e-40".into())
        );
    }
}
