//! How a person asks for a metric: `euclidean`, `ring`, `rings:2`, `parts:16,19840`, or in RON also weights.

use std::str::FromStr;

use kinds_model::{MetricPlan, SensorLayout};
use serde::Deserialize;

/// By what frames are to be compared.
#[derive(Clone, Debug, PartialEq, Deserialize)]
pub enum MetricChoice {
    /// Every reading counts alike.
    #[serde(alias = "euclidean")]
    Euclidean,
    /// Each reading counts by its weight.
    #[serde(alias = "weighted")]
    Weighted(Vec<f64>),
    /// At the nearest turn, where each row of the sensor is a ring.
    #[serde(alias = "ring")]
    Ring,
    /// At the nearest turn, where the readings are so many rings.
    #[serde(alias = "rings")]
    Rings(usize),
    /// Each part as much as any other, however many readings it has: those of sensors that are joined, by how many each has, in
    /// their order. Weights of `1 / n` for the readings of a part of n.
    #[serde(alias = "parts")]
    Parts(Vec<usize>),
}

/// Not a metric that a flag can ask for.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error(
    "metric is {0}; it must be euclidean, ring (each row of the sensor is one), a number of rings such as rings:2, or the readings \
     of each part such as parts:16,19840; weights are given in a configuration file"
)]
pub struct MetricChoiceError(String);

/// Parts that are not what the sensor consists of.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error(
    "metric: parts of {} readings are not the sensor's {n_readings}; give how many readings each of the joined sensors has",
    .parts.iter().map(usize::to_string).collect::<Vec<_>>().join(" and ")
)]
pub struct PartsError {
    /// Readings of each, as given.
    pub parts: Vec<usize>,
    /// Readings of the sensor.
    pub n_readings: usize,
}

impl MetricChoice {
    /// The plan for a sensor.
    ///
    /// # Errors
    /// If parts are not what it consists of.
    pub fn plan(&self, sensor: SensorLayout) -> Result<MetricPlan, PartsError> {
        Ok(match self {
            Self::Euclidean => MetricPlan::Euclidean,
            Self::Weighted(weights) => MetricPlan::Weighted(weights.clone()),
            Self::Ring => MetricPlan::Ring { n_rings: sensor.rows as usize },
            Self::Rings(n_rings) => MetricPlan::Ring { n_rings: *n_rings },
            Self::Parts(parts) => MetricPlan::Weighted(weights(parts, sensor.n_readings())?),
        })
    }
}

/// A weight for each reading, by which every part has the same in all.
fn weights(parts: &[usize], n_readings: usize) -> Result<Vec<f64>, PartsError> {
    let sum = parts.iter().try_fold(0_usize, |sum, part| sum.checked_add(*part));
    if sum != Some(n_readings) || parts.contains(&0) {
        return Err(PartsError { parts: parts.to_vec(), n_readings });
    }
    Ok(parts.iter().flat_map(|&part| std::iter::repeat_n(1.0 / part as f64, part)).collect())
}

/// From a flag.
impl FromStr for MetricChoice {
    type Err = MetricChoiceError;

    fn from_str(text: &str) -> Result<Self, MetricChoiceError> {
        let numbers = |text: &str| {
            let numbers: Option<Vec<usize>> = text.split(',').map(|number| number.parse().ok()).collect();
            numbers.filter(|numbers| !numbers.contains(&0))
        };
        let choice = match text.split_once(':') {
            None if text == "euclidean" => Some(Self::Euclidean),
            None if text == "ring" => Some(Self::Ring),
            Some(("rings", number)) => match numbers(number).as_deref() {
                Some([n_rings]) => Some(Self::Rings(*n_rings)),
                _ => None,
            },
            Some(("parts", parts)) => numbers(parts).map(Self::Parts),
            _ => None,
        };
        choice.ok_or_else(|| MetricChoiceError(text.to_string()))
    }
}

#[cfg(test)]
mod tests {
    use MetricChoice::{Euclidean, Parts, Ring, Rings, Weighted};

    use super::*;

    #[test]
    fn a_metric_is_asked_for_in_the_same_words_by_flag_and_in_ron() {
        for (flag, ron, expected) in [
            ("euclidean", "euclidean", Euclidean),
            ("ring", "ring", Ring),
            ("rings:3", "rings(3)", Rings(3)),
            ("parts:16,19840", "parts([16, 19840])", Parts(vec![16, 19840])),
        ] {
            assert_eq!(flag.parse(), Ok(expected.clone()));
            assert_eq!(ron::from_str(ron), Ok(expected), "{ron}");
        }
        assert_eq!(ron::from_str("Weighted([1, 0.5, 0])"), Ok(Weighted(vec![1.0, 0.5, 0.0])));
    }

    #[test]
    fn what_is_no_metric_is_refused_with_what_would_be_one() {
        for text in [
            "Euclid",
            "weighted",
            "ring:2",
            "rings",
            "rings:",
            "rings:0",
            "rings:-1",
            "rings:1.5",
            "rings:1,2",
            "parts",
            "parts:8,",
            "parts:0,8",
            "",
        ] {
            assert_eq!(
                text.parse::<MetricChoice>().unwrap_err().to_string(),
                format!(
                    "metric is {text}; it must be euclidean, ring (each row of the sensor is one), a number of rings such as \
                     rings:2, or the readings of each part such as parts:16,19840; weights are given in a configuration file"
                )
            );
        }
    }

    #[test]
    fn each_row_of_a_sensor_is_a_ring_unless_a_number_is_given() {
        let crunch = SensorLayout { rows: 2, columns: 8, metres_per_count: 0.001 };
        assert_eq!(Ring.plan(crunch), Ok(MetricPlan::Ring { n_rings: 2 }));
        assert_eq!(Rings(4).plan(crunch), Ok(MetricPlan::Ring { n_rings: 4 }));
    }

    #[test]
    fn each_part_counts_as_much_as_any_other() {
        let joint = SensorLayout { rows: 1, columns: 20, metres_per_count: 0.001 };
        let MetricPlan::Weighted(weights) = Parts(vec![16, 1, 3]).plan(joint).unwrap() else { panic!() };
        for part in [0..16, 16..17, 17..20] {
            let sum: f64 = weights[part.clone()].iter().sum();
            assert!((sum - 1.0).abs() < 1e-15, "{part:?}: {sum}");
            assert!(weights[part].windows(2).all(|pair| pair[0] == pair[1]));
        }
        for parts in [vec![16, 3], vec![16, 5], vec![20, 0], vec![usize::MAX, 21]] {
            let words = Parts(parts.clone()).plan(joint).unwrap_err().to_string();
            let given = parts.iter().map(usize::to_string).collect::<Vec<_>>().join(" and ");
            assert_eq!(
                words,
                format!(
                    "metric: parts of {given} readings are not the sensor's 20; give how many readings each of the joined sensors has"
                )
            );
        }
    }
}
