//! What is not as it should be, told when it begins and again when it ends, and not for every frame.

use kinds_messages::{HealthReport, SensorName};

/// A sentence about so many frames.
type Sentence = fn(u64) -> String;

/// A condition that some frames show.
struct Condition {
    /// For whoever sorts logs.
    name: &'static str,
    count: fn(&HealthReport) -> u64,
    /// Whether so many frames, of so many that came, make the condition.
    is_shown: fn(u64, u64) -> bool,
    /// Seconds with it, one after the other, that make it begin, and without that make it end.
    n_seconds: [u32; 2],
    /// Whether somebody should see to it.
    is_warning: bool,
    /// About the last second; none where it is told elsewhere, at once.
    beginning: Option<Sentence>,
    /// About all frames of the condition.
    end: Sentence,
    /// Whether it has begun.
    is_on: bool,
    /// Frames that had shown it before it began.
    n_before: u64,
    /// Seconds in a row that speak for a change.
    n_contrary: u32,
}

/// All that a service watches once a second.
pub(crate) struct Conditions {
    sensor: SensorName,
    last: HealthReport,
    conditions: [Condition; 7],
}

/// What there is to tell.
#[derive(Debug, PartialEq, Eq)]
enum News {
    Begins(String),
    Ends(String),
}

impl Condition {
    /// One that begins and ends with the first second that speaks for it.
    fn new(
        name: &'static str,
        count: fn(&HealthReport) -> u64,
        beginning: Option<Sentence>,
        end: Sentence,
    ) -> Self {
        Self {
            name,
            count,
            is_shown: |n, _| n > 0,
            n_seconds: [1, 1],
            is_warning: true,
            beginning,
            end,
            is_on: false,
            n_before: 0,
            n_contrary: 0,
        }
    }

    /// What there is to tell. Of a second without frames nobody knows anything.
    fn look(&mut self, last: &HealthReport, now: &HealthReport) -> Option<News> {
        let (before, count) = ((self.count)(last), (self.count)(now));
        let (n, n_frames) = (count.saturating_sub(before), now.n_frames.saturating_sub(last.n_frames));
        if n_frames == 0 && n == 0 {
            return None;
        }
        if (self.is_shown)(n, n_frames) == self.is_on {
            self.n_contrary = 0;
            return None;
        }
        if !self.is_on && self.n_contrary == 0 {
            self.n_before = before;
        }
        self.n_contrary += 1;
        if self.n_contrary < self.n_seconds[usize::from(self.is_on)] {
            return None;
        }
        self.n_contrary = 0;
        self.is_on = !self.is_on;
        match self.is_on {
            true => self.beginning.map(|sentence| News::Begins(sentence(n))),
            false => Some(News::Ends((self.end)(count - self.n_before))),
        }
    }
}

impl Conditions {
    pub(crate) fn new(sensor: &SensorName) -> Self {
        Self {
            sensor: sensor.clone(),
            last: HealthReport::default(),
            conditions: [lost(), repeated(), invalid(), refused(), uncommanded(), late(), novel()],
        }
    }

    /// Tells what has changed since the last look.
    pub(crate) fn tell(&mut self, now: &HealthReport) {
        let sensor = &self.sensor;
        for condition in &mut self.conditions {
            let name = condition.name;
            match condition.look(&self.last, now) {
                Some(News::Begins(sentence)) if condition.is_warning => {
                    tracing::warn!(%sensor, condition = name, "{sentence}");
                }
                Some(News::Begins(sentence) | News::Ends(sentence)) => {
                    tracing::info!(%sensor, condition = name, "{sentence}");
                }
                None => {}
            }
        }
        self.last = *now;
    }
}

fn lost() -> Condition {
    Condition::new(
        "lost",
        |health| health.n_lost,
        Some(|n| format!("frames are lost: {n} in the last second; they come faster than they are served")),
        |n| format!("no more frames are lost; {n} were"),
    )
}

fn repeated() -> Condition {
    Condition::new(
        "repeated",
        |health| health.n_repeated,
        Some(|n| format!("frames come twice or out of order, and are left alone: {n} in the last second")),
        |n| format!("frames come once and in order again; {n} did not"),
    )
}

fn invalid() -> Condition {
    Condition::new(
        "invalid",
        |health| health.n_invalid,
        Some(|n| format!("frames have no valid reading: {n} in the last second; look at the sensor")),
        |n| format!("frames have valid readings again; {n} had none"),
    )
}

fn refused() -> Condition {
    Condition::new(
        "refused",
        |health| health.n_refused,
        None,
        |n| format!("frames are for the model again; {n} were refused"),
    )
}

fn uncommanded() -> Condition {
    Condition::new(
        "uncommanded",
        |health| health.n_uncommanded,
        None,
        |n| format!("frames have a command again; {n} had none"),
    )
}

/// A machine that does something else now and then makes a report late now and then. Where a driver shim goes as fast as its
/// frames are reported, most are, and nothing is wrong.
fn late() -> Condition {
    Condition {
        n_seconds: [3, 10],
        is_warning: false,
        ..Condition::new(
            "late",
            |health| health.n_late,
            Some(|n| format!("reports are late: {n} in the last second came when the next frame was due")),
            |n| format!("reports are in time again; {n} were late"),
        )
    }
}

/// One frame in a hundred is novel where all is as it was learnt: an episode is when most are.
fn novel() -> Condition {
    Condition {
        is_shown: |n, n_frames| 2 * n > n_frames,
        n_seconds: [3, 3],
        ..Condition::new(
            "novel",
            |health| health.n_novel,
            Some(|n| {
                format!(
                    "frames are unlike what the model has seen: {n} in the last second; train on trips through such places"
                )
            }),
            |n| format!("frames are like what the model has seen again; {n} were not"),
        )
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// What a condition tells at each look, by frames that came and frames that show it until then.
    fn told(
        mut condition: Condition,
        set: fn(&mut HealthReport, u64),
        looks: &[[u64; 2]],
    ) -> Vec<Option<News>> {
        let mut last = HealthReport::default();
        let look = |&[n_frames, n]: &[u64; 2]| {
            let mut now = HealthReport { n_frames, ..HealthReport::default() };
            set(&mut now, n);
            let news = condition.look(&last, &now);
            last = now;
            news
        };
        looks.iter().map(look).collect()
    }

    fn begins(sentence: &str) -> Option<News> {
        Some(News::Begins(sentence.to_string()))
    }

    fn ends(sentence: &str) -> Option<News> {
        Some(News::Ends(sentence.to_string()))
    }

    #[test]
    fn a_condition_is_told_when_it_begins_and_when_frames_come_without_it() {
        let lost_in =
            |n| format!("frames are lost: {n} in the last second; they come faster than they are served");
        for (look, expected) in std::iter::zip(
            told(
                lost(),
                |health, n| health.n_lost = n,
                &[[10, 0], [20, 3], [30, 5], [30, 5], [40, 5], [50, 5], [60, 6]],
            ),
            [
                None,
                begins(&lost_in(3)),
                // It goes on; then nothing comes, and nobody knows.
                None,
                None,
                ends("no more frames are lost; 5 were"),
                None,
                begins(&lost_in(1)),
            ],
        ) {
            assert_eq!(look, expected);
        }
    }

    #[test]
    fn an_episode_is_novel_when_most_frames_are_for_three_seconds() {
        let set = |health: &mut HealthReport, n| health.n_novel = n;
        // One frame in a hundred, and a second of a frame that is.
        let usual = told(novel(), set, &[[100, 1], [200, 2], [201, 3], [301, 4]]);
        assert_eq!(usual, [None, None, None, None]);
        let episode = told(novel(), set, &[[5, 0], [10, 3], [15, 8], [20, 11], [25, 12], [30, 12], [35, 14]]);
        let beginning = "frames are unlike what the model has seen: 3 in the last second; train on trips through such places";
        let end = "frames are like what the model has seen again; 14 were not";
        assert_eq!(episode, [None, None, None, begins(beginning), None, None, ends(end)]);
    }

    #[test]
    fn a_report_that_is_late_now_and_then_is_not_told() {
        let set = |health: &mut HealthReport, n| health.n_late = n;
        let now_and_then = told(late(), set, &[[5, 1], [10, 2], [15, 2], [20, 3]]);
        assert_eq!(now_and_then, [None, None, None, None]);
        let mut looks = vec![[5, 1], [10, 2], [15, 3]];
        looks.extend((4..14).map(|second| [5 * second, 3]));
        let told = told(late(), set, &looks);
        let beginning = "reports are late: 1 in the last second came when the next frame was due";
        assert_eq!(told[2], begins(beginning));
        assert_eq!(told[12], ends("reports are in time again; 3 were late"));
        assert_eq!(told.iter().flatten().count(), 2);
    }
}
