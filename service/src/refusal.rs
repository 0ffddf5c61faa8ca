//! Frames that are not for the model.

use kinds_messages::{Frame, FrameHeader, SensorName};
use kinds_model::SensorLayout;

/// Why frames are not classified.
#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum Refusal {
    /// Written by another version of the driver shim.
    #[error(
        "frames have layout version {found}, this service reads version {}; run all programs in the same version",
        FrameHeader::VERSION
    )]
    OtherVersion {
        /// The frames' version.
        found: u32,
    },
    /// The header contradicts the counts.
    #[error("frames have {n_readings} readings but say {rows} × {columns}; their driver shim is at fault")]
    Contradiction {
        /// Counts there are.
        n_readings: usize,
        /// Rows the header says.
        rows: u32,
        /// Columns the header says.
        columns: u32,
    },
    /// Another sensor's frames.
    #[error(
        "frames have {frames}, the model is for {model}; serve a model that was trained on this sensor, or publish the \
         right sensor under this name"
    )]
    OtherSensor {
        /// What the frames are.
        frames: SensorLayout,
        /// What the model understands.
        model: SensorLayout,
    },
}

impl Refusal {
    /// Why the model cannot take this frame, if it cannot.
    pub(crate) fn of(frame: &Frame, model: SensorLayout) -> Option<Self> {
        let &FrameHeader { version, rows, columns, metres_per_count, .. } = frame.header();
        let n_readings = frame.counts().len();
        let frames = SensorLayout { rows, columns, metres_per_count };
        if version != FrameHeader::VERSION {
            return Some(Self::OtherVersion { found: version });
        }
        if u64::from(rows) * u64::from(columns) != n_readings as u64 {
            return Some(Self::Contradiction { n_readings, rows, columns });
        }
        (!is_same_sensor(frames, model)).then_some(Self::OtherSensor { frames, model })
    }
}

/// Whether frames of a sensor are for a model of the other.
pub(crate) fn is_same_sensor(frames: SensorLayout, model: SensorLayout) -> bool {
    frames.rows == model.rows && frames.columns == model.columns && frames.has_unit_of(&model)
}

/// What has been refused last, so that it is said once.
#[derive(Debug, Default)]
pub(crate) struct Refusals {
    last: Option<(u64, Refusal)>,
}

impl Refusals {
    /// Says why frames of a run are refused, unless it has just been said. Returns whether it was.
    pub(crate) fn say_once(&mut self, sensor: &SensorName, run: u64, refusal: Refusal) -> bool {
        let now = Some((run, refusal));
        let is_news = self.last != now;
        if is_news {
            tracing::warn!(%sensor, condition = "refused", "{refusal}");
            self.last = now;
        }
        is_news
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn other_sensor(columns: u32) -> Refusal {
        Refusal::OtherSensor {
            frames: SensorLayout { rows: 1, columns, metres_per_count: 0.001 },
            model: SensorLayout { rows: 124, columns: 160, metres_per_count: 0.00025 },
        }
    }

    #[test]
    fn refusals_are_sentences() {
        for (refusal, sentence) in [
            (
                Refusal::OtherVersion { found: 2 },
                "frames have layout version 2, this service reads version 1; run all programs in the same version",
            ),
            (
                Refusal::Contradiction { n_readings: 16, rows: 4, columns: 5 },
                "frames have 16 readings but say 4 × 5; their driver shim is at fault",
            ),
            (
                other_sensor(16),
                "frames have 16 readings (1 × 16) of 0.001 m a count, the model is for 19840 readings (124 × 160) of \
                 0.00025 m a count; serve a model that was trained on this sensor, or publish the right sensor under \
                 this name",
            ),
        ] {
            assert_eq!(refusal.to_string(), sentence);
        }
    }

    #[test]
    fn a_refusal_is_said_once_and_again_when_it_changes() {
        let mut refusals = Refusals::default();
        let sensor: SensorName = "ring".parse().unwrap();
        let mut say = |run, refusal| refusals.say_once(&sensor, run, refusal);
        assert!(say(7, other_sensor(16)));
        assert!(!say(7, other_sensor(16)));
        assert!(say(7, other_sensor(24)), "another layout");
        assert!(say(8, other_sensor(24)), "another run");
        assert!(!say(8, other_sensor(24)));
    }
}
