//! What arrives on a sensor's channels while somebody looks.

use std::thread;
use std::time::{Duration, Instant};

use kinds_messages::{
    ChannelError, Domain, FrameHeader, FrameReader, KindReport, Node, ReportReader, SensorName, Waiting,
    monotonic_ns,
};

/// Frames and reports that are enough.
const N_ENOUGH: usize = 3;

const PAUSE: Duration = Duration::from_millis(5);

/// What has arrived.
#[derive(Debug, Default)]
pub(super) struct Arrivals {
    pub(super) frames: Vec<Arrival>,
    pub(super) reports: Vec<KindReport>,
}

/// A frame, without its counts.
#[derive(Debug)]
pub(super) struct Arrival {
    pub(super) header: FrameHeader,
    pub(super) n_readings: usize,
    /// Whether any of them is valid.
    pub(super) has_valid: bool,
    pub(super) received_monotonic_ns: u64,
}

/// Looks until enough has arrived, at most for so long.
///
/// * `frames`, `reports` — whether any are to be expected: channels that are not there are not made
pub(super) fn look(
    domain: &Domain,
    sensor: &SensorName,
    [frames, reports]: [bool; 2],
    wait: Duration,
) -> Result<Arrivals, ChannelError> {
    let node = Node::visit(domain, "kinds-doctor")?;
    let polling = Waiting::Polling;
    let frames = frames.then(|| FrameReader::open_with(&node, sensor, polling)).transpose()?;
    let reports = reports.then(|| ReportReader::open_with(&node, sensor, polling)).transpose()?;
    let (began, began_ns) = (Instant::now(), monotonic_ns());
    let mut arrivals = Arrivals::default();
    while began.elapsed() < wait {
        if let Some(reader) = &frames {
            while let Some(frame) = reader.receive()? {
                arrivals.frames.push(Arrival {
                    header: *frame.header(),
                    n_readings: frame.counts().len(),
                    has_valid: frame.counts().iter().any(|count| *count != 0),
                    received_monotonic_ns: monotonic_ns(),
                });
            }
        }
        if let Some(reader) = &reports {
            while let Some(report) = reader.receive()? {
                // Whoever joins late gets the last one, however old.
                if report.reported_monotonic_ns >= began_ns {
                    arrivals.reports.push(report);
                }
            }
        }
        let is_enough = |n: usize, expected: bool| n >= N_ENOUGH || !expected;
        if is_enough(arrivals.frames.len(), frames.is_some())
            && is_enough(arrivals.reports.len(), reports.is_some())
        {
            break;
        }
        thread::sleep(PAUSE);
    }
    Ok(arrivals)
}
