//! Simulated robots: worlds, drivers, wheels and range sensors, so that anyone can try the kinds, and tests have trips
//! whose truth is known.
//!
//! ```text
//! route ─ teleoperator ─ command ─▶ drive ─┬─ true pose ─▶ world ─▶ sensors ─▶ counts
//!                                          └─ wheels ─▶ odometry
//! ```
//!
//! A [`Robot`] is pure: it has no clock and opens no channel. Everything it does follows, bit for bit and on every
//! machine, from the place it drives in, the number of the trip and a seed: random numbers come from one named stream
//! per source, so that a change to one leaves the others as they were, and `libm` stands for the system's
//! sine and exponential, whose last bits differ between machines. Square roots are exact everywhere.
//!
//! Axes: x forward (on a floor plan: east), y left (north); angles counter-clockwise; metres, radians, seconds.

use kinds_messages::{Command, Pose};
use kinds_trips::{FrameLayout, Stamp};

use crate::{Capture, SensorError, Source};

mod angle;
mod chew;
mod crunch;
mod drive;
mod floors;
mod infrared;
mod odometry;
mod random;
mod sonar;
mod teleoperator;
mod world;

pub use chew::Chew;
pub use crunch::Crunch;
pub use floors::Floor;

/// A robot that is driven along a route, one frame after the other.
pub trait Robot {
    /// What all of its frames look like.
    fn layout(&self) -> FrameLayout;

    /// Drives on to the next frame and reads its counts; `None` at the end of the route, where counts are left alone.
    ///
    /// * `counts` — `(n_readings,)`; all are written
    fn step(&mut self, counts: &mut [u16]) -> Option<Moment>;
}

/// What holds at the moment of a frame.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Moment {
    /// When the frame is captured, on a calendar that the trip's number sets.
    pub captured: Stamp,
    /// Where the robot believes itself to be by its wheels: drifts.
    pub odometry: Pose,
    /// Where the robot is.
    pub true_pose: Pose,
    /// What its driver tells it to do.
    pub command: Command,
}

/// A simulated robot's pose is where it believes itself to be, as a real one's; where it is stands beside it.
impl<R: Robot + ?Sized> Source for Box<R> {
    fn layout(&self) -> FrameLayout {
        Robot::layout(&**self)
    }

    fn next(&mut self, counts: &mut [u16]) -> Result<Option<Capture>, SensorError> {
        let moment = self.step(counts);
        Ok(moment.map(|Moment { captured, odometry, true_pose, command }| Capture {
            captured,
            pose: Some(odometry),
            command: Some(command),
            true_pose: Some(true_pose),
        }))
    }
}

/// When a trip begins: trip 0 on 2 January 2007 at 09:00 UTC, each further one a day later.
fn first_stamp(trip: u32) -> Stamp {
    const TRIP_0_S: i64 = 1_167_728_400;
    const DAY_S: i64 = 86_400;
    Stamp((TRIP_0_S + i64::from(trip) * DAY_S).saturating_mul(1_000_000_000))
}
