//! What is not as it should be, told when it begins and again when it ends, and not for every frame.

use kinds_messages::SensorName;

use crate::Summary;

/// A sentence about so many frames.
type Sentence = fn(u64) -> String;

/// A condition that some frames show.
struct Condition {
    count: fn(&Summary) -> u64,
    /// About the last second; none where it is told elsewhere, at once.
    beginning: Option<Sentence>,
    /// About all frames of the condition.
    end: Sentence,
    /// Frames before it began; none while all is well.
    began_at: Option<u64>,
}

/// All that a service watches once a second.
pub(crate) struct Conditions {
    sensor: SensorName,
    last: Summary,
    conditions: [Condition; 5],
}

impl Condition {
    /// What there is to tell. A condition ends with a second in which frames came and none showed it.
    fn look(&mut self, last: &Summary, now: &Summary) -> Option<News> {
        let (before, count) = ((self.count)(last), (self.count)(now));
        match self.began_at {
            None if count > before => {
                self.began_at = Some(before);
                self.beginning.map(|sentence| News::Begins(sentence(count - before)))
            }
            Some(began_at) if count == before && now.n_frames > last.n_frames => {
                self.began_at = None;
                Some(News::Ends((self.end)(count - began_at)))
            }
            _ => None,
        }
    }
}

#[derive(Debug, PartialEq, Eq)]
enum News {
    Begins(String),
    Ends(String),
}

impl Conditions {
    pub(crate) fn new(sensor: &SensorName) -> Self {
        let condition = |count, beginning, end| Condition { count, beginning, end, began_at: None };
        Self {
            sensor: sensor.clone(),
            last: Summary::default(),
            conditions: [
                condition(
                    |summary| summary.n_lost,
                    Some(|n| {
                        format!(
                            "frames are lost: {n} in the last second; they come faster than they are served"
                        )
                    }),
                    |n| format!("no more frames are lost; {n} were"),
                ),
                condition(
                    |summary| summary.n_repeated,
                    Some(|n| {
                        format!(
                            "frames come twice or out of order, and are left alone: {n} in the last second"
                        )
                    }),
                    |n| format!("frames come once and in order again; {n} did not"),
                ),
                condition(
                    |summary| summary.n_invalid,
                    Some(|n| {
                        format!("frames have no valid reading: {n} in the last second; look at the sensor")
                    }),
                    |n| format!("frames have valid readings again; {n} had none"),
                ),
                condition(
                    |summary| summary.n_refused,
                    None,
                    |n| format!("frames are for the model again; {n} were refused"),
                ),
                condition(
                    |summary| summary.n_uncommanded,
                    None,
                    |n| format!("frames have a command again; {n} had none"),
                ),
            ],
        }
    }

    /// Tells what has changed since the last look.
    pub(crate) fn tell(&mut self, now: &Summary) {
        for condition in &mut self.conditions {
            match condition.look(&self.last, now) {
                Some(News::Begins(sentence)) => tracing::warn!(sensor = %self.sensor, "{sentence}"),
                Some(News::Ends(sentence)) => tracing::info!(sensor = %self.sensor, "{sentence}"),
                None => {}
            }
        }
        self.last = *now;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_condition_is_told_when_it_begins_and_when_frames_come_without_it() {
        let mut conditions = Conditions::new(&"ring".parse().unwrap());
        let mut last = Summary::default();
        let mut look = |n_frames, n_lost| {
            let now = Summary { n_frames, n_lost, ..Summary::default() };
            let news = conditions.conditions[0].look(&last, &now);
            last = now;
            news
        };
        let begins = |n| {
            Some(News::Begins(format!(
                "frames are lost: {n} in the last second; they come faster than they are served"
            )))
        };
        let ends = |n| Some(News::Ends(format!("no more frames are lost; {n} were")));
        assert_eq!(look(10, 0), None);
        assert_eq!(look(20, 3), begins(3));
        assert_eq!(look(30, 5), None, "it goes on");
        assert_eq!(look(30, 5), None, "nothing came: nobody knows");
        assert_eq!(look(40, 5), ends(5));
        assert_eq!(look(50, 5), None);
        assert_eq!(look(60, 6), begins(1));
    }
}
