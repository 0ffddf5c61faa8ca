//! Frames that are there before their time, such as those of a recorded trip, as a device.

use std::time::{Duration, Instant};

use kinds_messages::{Command, Pose};
use kinds_trips::{FrameLayout, TripReader};

use crate::pace::Schedule;
use crate::{Capture, Pace, Reading, Sensor, SensorError};

/// Where frames come from that know their time and need not be waited for.
pub trait Source {
    /// What all frames look like.
    fn layout(&self) -> FrameLayout;

    /// Writes the counts of the next frame, `(n_readings,)`; `None` at the end.
    fn next(&mut self, counts: &mut [u16]) -> Result<Option<Capture>, SensorError>;
}

/// A source as a device: each frame comes when it is due. Its time begins with the first frame that is read.
pub struct Paced<S> {
    source: S,
    schedule: Schedule,
    clock: Box<dyn Clock>,
    /// Written to the counts already, and not yet due.
    pending: Option<Capture>,
}

/// The rest of a recorded trip as a device.
pub type Replay = Paced<TripReader>;

impl<S: Source> Paced<S> {
    /// Gives a source's frames at a pace.
    pub fn new(source: S, pace: Pace) -> Self {
        Self::with_clock(source, pace, Box::new(SystemClock::new()))
    }

    pub(crate) fn with_clock(source: S, pace: Pace, clock: Box<dyn Clock>) -> Self {
        Self { source, schedule: Schedule::new(pace), clock, pending: None }
    }

    /// The source, for what it has to say at its end.
    pub fn source(&self) -> &S {
        &self.source
    }
}

impl<S: Source> Sensor for Paced<S> {
    fn layout(&self) -> FrameLayout {
        self.source.layout()
    }

    fn read(&mut self, counts: &mut [u16], timeout: Duration) -> Result<Reading, SensorError> {
        let next = match self.pending.take() {
            Some(pending) => Some(pending),
            None => self.source.next(counts)?,
        };
        let Some(capture) = next else { return Ok(Reading::End) };
        let wait = self.schedule.wait(capture.captured, self.clock.now());
        self.clock.sleep(wait.min(timeout));
        if wait > timeout {
            self.pending = Some(capture);
            return Ok(Reading::NotYet);
        }
        Ok(Reading::Frame(capture))
    }
}

impl Source for TripReader {
    fn layout(&self) -> FrameLayout {
        TripReader::layout(self)
    }

    fn next(&mut self, counts: &mut [u16]) -> Result<Option<Capture>, SensorError> {
        let frame = self.next_frame(counts)?;
        Ok(frame.map(|frame| {
            let pose = frame.pose.map(|pose| Pose { x_m: pose.x_m, y_m: pose.y_m, yaw_rad: pose.yaw_rad });
            let command = frame
                .command
                .map(|command| Command { forward_m_s: command.forward_m_s, turn_rad_s: command.turn_rad_s });
            Capture { captured: frame.captured, pose, command, true_pose: None }
        }))
    }
}

/// Time to replay by.
pub(crate) trait Clock {
    /// Time since some start.
    fn now(&self) -> Duration;
    /// Lets time pass.
    fn sleep(&self, duration: Duration);
}

pub(crate) struct SystemClock {
    start: Instant,
}

impl SystemClock {
    pub(crate) fn new() -> Self {
        Self { start: Instant::now() }
    }
}

impl Clock for SystemClock {
    fn now(&self) -> Duration {
        self.start.elapsed()
    }

    fn sleep(&self, duration: Duration) {
        if !duration.is_zero() {
            std::thread::sleep(duration);
        }
    }
}

#[cfg(test)]
mod tests {
    use std::path::Path;

    use kinds_trips::{
        Command as TripCommand, Pose as TripPose, Scan, Selection, Stamp, TripWriter, WriterOptions,
    };

    use super::*;
    use crate::testing::SleepClock;

    const CAPTURED_MS: [i64; 4] = [10_000, 10_100, 10_130, 10_500];

    fn write_trip(path: &Path) {
        let mut writer = TripWriter::create(path, &WriterOptions::default()).unwrap();
        for (index, ms) in CAPTURED_MS.into_iter().enumerate() {
            let at = Stamp(ms * 1_000_000);
            let count = index as u16 * 10;
            let scan = Scan {
                counts: &[count + 1000, count + 2000, count + 3000],
                metres_per_count: 0.001,
                bearing_rad_min: 0.0,
                bearing_step_rad: 1.0,
                range_m_min: 0.05,
                range_m_max: 8.0,
            };
            let pose = TripPose { x_m: index as f64, y_m: 0.5, yaw_rad: 0.25 };
            writer.write_odometry("/odom", at, &pose).unwrap();
            let command = TripCommand { forward_m_s: 0.1 * index as f64, turn_rad_s: -0.5 };
            writer.write_command("/cmd_vel", at, &command).unwrap();
            writer.write_scan("/scan", at, &scan).unwrap();
        }
        writer.finish().unwrap();
    }

    /// Reads a trip to its end: when each frame came, its counts, and what was said of it.
    fn replay(pace: &str, timeout: Duration) -> (Vec<(Duration, Vec<u16>, Capture)>, usize) {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("trip.mcap");
        write_trip(&path);
        let trip = TripReader::open(&path, &Selection::default()).unwrap();
        let clock = SleepClock::default();
        let mut replay = Replay::with_clock(trip, pace.parse().unwrap(), Box::new(clock.clone()));
        assert_eq!(replay.layout(), FrameLayout { rows: 1, columns: 3, metres_per_count: 0.001 });
        let (mut frames, mut n_not_yet) = (Vec::new(), 0);
        let mut counts = vec![0; 3];
        loop {
            match replay.read(&mut counts, timeout).unwrap() {
                Reading::End => return (frames, n_not_yet),
                Reading::NotYet => n_not_yet += 1,
                Reading::Numbered(_) => panic!("a replay leaves numbering to the shim"),
                Reading::Frame(capture) => {
                    frames.push((clock.now(), std::mem::replace(&mut counts, vec![0; 3]), capture));
                }
            }
        }
    }

    #[test]
    fn frames_come_in_order_at_a_multiple_of_the_recorded_pace() {
        for (pace, due_ms) in [("1", [0, 100, 130, 500]), ("10", [0, 10, 13, 50]), ("max", [0; 4])] {
            let (frames, _) = replay(pace, Duration::from_secs(1));
            let due: Vec<Duration> = frames.iter().map(|frame| frame.0).collect();
            assert_eq!(due, due_ms.map(Duration::from_millis), "at {pace}");
        }
    }

    #[test]
    fn frames_keep_their_counts_stamps_poses_and_commands() {
        let (frames, _) = replay("1", Duration::from_secs(1));
        let (_, counts, capture) = &frames[2];
        assert_eq!(counts, &[1020, 2020, 3020]);
        let pose = Pose { x_m: 2.0, y_m: 0.5, yaw_rad: 0.25 };
        let &Capture { captured, pose: Some(found), command: Some(told), true_pose: None } = capture else {
            panic!("{capture:?}")
        };
        assert_eq!(told, Command { forward_m_s: 0.2, turn_rad_s: -0.5 });
        assert_eq!(captured, Stamp(10_130_000_000));
        // The heading has been through a quaternion and back.
        assert_eq!((found.x_m, found.y_m), (pose.x_m, pose.y_m));
        assert!((found.yaw_rad - pose.yaw_rad).abs() < 1e-12);
    }

    #[test]
    fn waits_longer_than_the_timeout_are_broken_up_and_change_nothing() {
        let (whole, none) = replay("1", Duration::from_secs(1));
        let (broken, n_not_yet) = replay("1", Duration::from_millis(50));
        assert_eq!(none, 0);
        // 100 ms = 50 and 50, 30 ms, 370 ms = 7 × 50 and 20.
        assert_eq!(n_not_yet, 8);
        assert_eq!(broken, whole);
    }
}
