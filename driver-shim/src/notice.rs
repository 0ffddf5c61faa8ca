//! What a shim has to tell the person who started it.

use std::fmt;

use kinds_messages::SensorName;

/// News of a shim, for whoever started it: each is told once when it comes to be.
#[derive(Clone, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub enum Notice {
    /// Nobody reads the frames yet, and the first one is held back.
    WaitingForReader {
        /// The sensor.
        sensor: SensorName,
    },
    /// No service reports on the frames, and they are held back.
    WaitingForService {
        /// The sensor.
        sensor: SensorName,
    },
    /// Waiting is over.
    Publishing {
        /// The sensor.
        sensor: SensorName,
    },
    /// The service went while frames were on their way.
    ServiceGone {
        /// The sensor.
        sensor: SensorName,
        /// Frames that it had been sent and did not report on.
        n_unreported: u64,
    },
    /// The service is there and does not report.
    ServiceSilent {
        /// The sensor.
        sensor: SensorName,
        /// The oldest frame that it has not reported on.
        sequence: u64,
    },
    /// The device has something to tell.
    Device {
        /// The sensor.
        sensor: SensorName,
        /// Its words.
        news: String,
    },
}

impl fmt::Display for Notice {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::WaitingForReader { sensor } => {
                write!(f, "waiting for a program that reads the frames of {sensor}")
            }
            Self::WaitingForService { sensor } => write!(f, "waiting for a service for {sensor}"),
            Self::Publishing { sensor } => write!(f, "publishing {sensor}"),
            Self::ServiceGone { sensor, n_unreported } => {
                write!(f, "the service for {sensor} is gone and left {n_unreported} frames unreported")
            }
            Self::ServiceSilent { sensor, sequence } => write!(
                f,
                "the service for {sensor} has not reported on frame {sequence}; waiting (does it have a model of \
                 this sensor?)"
            ),
            Self::Device { sensor, news } => write!(f, "{sensor}: {news}"),
        }
    }
}
