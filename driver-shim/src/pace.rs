//! How fast a trip is replayed. No clock is read here: time comes in.

use std::str::FromStr;
use std::time::Duration;

use kinds_trips::Stamp;

use crate::Flow;

/// How fast a trip is replayed.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Pace {
    /// At the recorded intervals, divided by a speed.
    Recorded(Speed),
    /// As fast as the service reports frames.
    AsFastAsFollowed,
}

impl Pace {
    /// How far a shim that replays at this pace waits for others: it never loses the first frame, nor, as fast as
    /// followed, any other.
    pub fn flow(self) -> Flow {
        match self {
            Self::Recorded(_) => Flow::FromFirstReader,
            Self::AsFastAsFollowed => Flow::Followed,
        }
    }
}

/// `1` for as recorded, `10` for ten times as fast, `max` for as fast as followed.
impl FromStr for Pace {
    type Err = PaceError;

    fn from_str(text: &str) -> Result<Self, PaceError> {
        if text == "max" {
            return Ok(Self::AsFastAsFollowed);
        }
        let speed = text.parse().ok().and_then(Speed::new);
        speed.map(Self::Recorded).ok_or_else(|| PaceError { text: text.to_owned() })
    }
}

/// A text that is no pace.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error(
    "speed \"{text}\" is neither a number above 0, such as 1 for as recorded or 10 for ten times as fast, nor \"max\""
)]
pub struct PaceError {
    /// The text as given.
    pub text: String,
}

/// Multiple of the recorded speed: finite, above 0.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Speed(f64);

impl Speed {
    /// As recorded.
    pub const AS_RECORDED: Self = Self(1.0);

    /// A multiple of the recorded speed, if it is one.
    pub fn new(factor: f64) -> Option<Self> {
        (factor.is_finite() && factor > 0.0).then_some(Self(factor))
    }
}

/// When each frame of a trip is due.
#[derive(Debug)]
pub(crate) struct Schedule {
    pace: Pace,
    /// The first frame: when it was captured, and when it was asked for.
    start: Option<(Stamp, Duration)>,
}

impl Schedule {
    pub(crate) fn new(pace: Pace) -> Self {
        Self { pace, start: None }
    }

    /// How long to wait from `now`, on any clock that runs evenly, until a frame is due. The first one is due at once.
    ///
    /// Every frame is measured from the first, so that waits that take too long do not add up.
    pub(crate) fn wait(&mut self, captured: Stamp, now: Duration) -> Duration {
        let Pace::Recorded(Speed(factor)) = self.pace else { return Duration::ZERO };
        let (first_captured, start) = *self.start.get_or_insert((captured, now));
        let after_s = captured.seconds_since(first_captured).max(0.0) / factor;
        let after = Duration::try_from_secs_f64(after_s).unwrap_or(Duration::MAX);
        start.saturating_add(after).saturating_sub(now)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn ms(ms: u64) -> Duration {
        Duration::from_millis(ms)
    }

    /// Waits of a schedule for frames (captured at ms, asked for at ms).
    fn waits(pace: &str, frames: &[(i64, u64)]) -> Vec<Duration> {
        let mut schedule = Schedule::new(pace.parse().unwrap());
        frames.iter().map(|&(captured, now)| schedule.wait(Stamp(captured * 1_000_000), ms(now))).collect()
    }

    #[test]
    fn frames_are_due_at_their_recorded_intervals_from_the_first() {
        let frames = [(5000, 100), (5200, 100), (5300, 310), (6100, 1500)];
        assert_eq!(waits("1", &frames), [ms(0), ms(200), ms(90), ms(0)]);
    }

    #[test]
    fn a_multiple_divides_the_intervals() {
        let frames = [(5000, 100), (5200, 100), (5400, 100)];
        assert_eq!(waits("10", &frames), [ms(0), ms(20), ms(40)]);
        assert_eq!(waits("0.5", &frames), [ms(0), ms(400), ms(800)]);
    }

    #[test]
    fn at_the_fastest_pace_every_frame_is_due_at_once() {
        assert_eq!(waits("max", &[(5000, 100), (6000, 100)]), [ms(0), ms(0)]);
    }

    #[test]
    fn stamps_that_go_back_or_far_ahead_do_no_harm() {
        assert_eq!(waits("1", &[(5000, 100), (4000, 100)]), [ms(0), ms(0)]);
        assert_eq!(waits("1e-300", &[(0, 100), (1, 100)])[1], Duration::MAX - ms(100));
    }

    #[test]
    fn paces_are_read_from_text_or_refused_in_words() {
        assert_eq!("max".parse(), Ok(Pace::AsFastAsFollowed));
        assert_eq!("1".parse(), Ok(Pace::Recorded(Speed::AS_RECORDED)));
        for text in ["0", "-1", "nan", "inf", "fast", ""] {
            assert_eq!(
                text.parse::<Pace>().unwrap_err().to_string(),
                format!(
                    "speed \"{text}\" is neither a number above 0, such as 1 for as recorded or 10 for ten times as \
                     fast, nor \"max\""
                )
            );
        }
    }
}
