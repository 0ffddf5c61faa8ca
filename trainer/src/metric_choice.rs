//! How a person asks for a metric: `euclidean`, `ring`, `rings:2`, or in RON also weights.

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
}

/// Not a metric that a flag can ask for.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error(
    "metric is {0}; it must be euclidean, ring (each row of the sensor is one), or a number of rings such as rings:2; weights \
     are given in a configuration file"
)]
pub struct MetricChoiceError(String);

impl MetricChoice {
    /// The plan for a sensor.
    pub fn plan(&self, sensor: SensorLayout) -> MetricPlan {
        match self {
            Self::Euclidean => MetricPlan::Euclidean,
            Self::Weighted(weights) => MetricPlan::Weighted(weights.clone()),
            Self::Ring => MetricPlan::Ring { n_rings: sensor.rows as usize },
            Self::Rings(n_rings) => MetricPlan::Ring { n_rings: *n_rings },
        }
    }
}

/// From a flag.
impl FromStr for MetricChoice {
    type Err = MetricChoiceError;

    fn from_str(text: &str) -> Result<Self, MetricChoiceError> {
        let choice = match text.strip_prefix("rings:") {
            _ if text == "euclidean" => Some(Self::Euclidean),
            _ if text == "ring" => Some(Self::Ring),
            Some(number) => number.parse().ok().filter(|n_rings| *n_rings > 0).map(Self::Rings),
            None => None,
        };
        choice.ok_or_else(|| MetricChoiceError(text.to_string()))
    }
}

#[cfg(test)]
mod tests {
    use MetricChoice::{Euclidean, Ring, Rings, Weighted};

    use super::*;

    #[test]
    fn a_metric_is_asked_for_in_the_same_words_by_flag_and_in_ron() {
        for (flag, ron, expected) in
            [("euclidean", "euclidean", Euclidean), ("ring", "ring", Ring), ("rings:3", "rings(3)", Rings(3))]
        {
            assert_eq!(flag.parse(), Ok(expected.clone()));
            assert_eq!(ron::from_str(ron), Ok(expected), "{ron}");
        }
        assert_eq!(ron::from_str("Weighted([1, 0.5, 0])"), Ok(Weighted(vec![1.0, 0.5, 0.0])));
    }

    #[test]
    fn what_is_no_metric_is_refused_with_what_would_be_one() {
        for text in
            ["Euclid", "weighted", "ring:2", "rings", "rings:", "rings:0", "rings:-1", "rings:1.5", ""]
        {
            assert_eq!(
                text.parse::<MetricChoice>().unwrap_err().to_string(),
                format!(
                    "metric is {text}; it must be euclidean, ring (each row of the sensor is one), or a number of rings such as \
                     rings:2; weights are given in a configuration file"
                )
            );
        }
    }

    #[test]
    fn each_row_of_a_sensor_is_a_ring_unless_a_number_is_given() {
        let crunch = SensorLayout { rows: 2, columns: 8, metres_per_count: 0.001 };
        assert_eq!(Ring.plan(crunch), MetricPlan::Ring { n_rings: 2 });
        assert_eq!(Rings(4).plan(crunch), MetricPlan::Ring { n_rings: 4 });
    }
}
