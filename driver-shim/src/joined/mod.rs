//! Several sensors of one robot as one: a device whose frames are those of others, read from their channels.
//!
//! ```text
//! [frames of crunch/sonar] ──────┐ leads
//! [frames of crunch/infrared] ───┴─ Joined ─ Shim ─▶ [frames of crunch/joint]
//! ```
//!
//! Each frame of the leader makes one joint frame, at once, with the newest frame of each partner that belongs to it by the rule
//! of [`Partner`], which is also that of trips; so a model that was trained on trips of these sensors is served
//! what it was trained on. Where a partner has none the joint frame is invalid, and the service says so of each.
//! Time of capture, pose, command, and number are the leader's, so what was lost, or comes again, before the join is so behind it.
//!
//! At once means with what has come. Where a partner's frames take longer to come than the leader's, [`JoinPlan::wait`] gives them
//! time; without it, those that come too late are counted. As long as none does, joint frames are those of the trip.

mod joining;
mod numbering;

use std::collections::VecDeque;
use std::time::{Duration, Instant};

use kinds_messages::{ChannelError, Frame, FrameHeader, FrameReader, Node, SensorName, Spell};
use kinds_trips::{FrameLayout, Partner, Stamp, USUAL_TOLERANCE};

use self::joining::{Joining, Part};
use crate::layout::{self, LayoutError};
use crate::{Reading, Sensor, SensorError};

/// Longest time between two looks at what waits of the others: only one sensor wakes us, and sixteen frames of another have room.
const TICK: Duration = Duration::from_millis(5);

/// How frames are joined.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct JoinPlan {
    /// How much older than the leader's frame a partner's may be.
    pub tolerance: Duration,
    /// How long a joint frame may wait for frames of partners that are on their way.
    pub wait: Duration,
}

/// The tolerance of trips, and no wait.
impl Default for JoinPlan {
    fn default() -> Self {
        Self { tolerance: USUAL_TOLERANCE, wait: Duration::ZERO }
    }
}

/// Why sensors cannot be joined.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum JoinError {
    /// A frames channel.
    #[error(transparent)]
    Channel(#[from] ChannelError),
    /// Together they have more readings than a frame can have.
    #[error(transparent)]
    Layout(#[from] LayoutError),
    /// One sensor, or none.
    #[error("it takes two sensors to join; name more than one, with commas between them")]
    TooFew,
}

/// What has come before joining begins is joined if it is no older: sensors that start together lose nothing, and one that has
/// waited for another does not begin with frames of long ago.
const RECENT: Duration = Duration::from_secs(2);

/// Sensors that are to be joined, until each has sent a frame: what theirs look like is not known before.
pub struct Gathering {
    members: Vec<(Member, VecDeque<Recent>)>,
}

/// A frame that came before joining began.
struct Recent {
    came: Instant,
    layout: FrameLayout,
    header: FrameHeader,
    counts: Vec<u16>,
}

/// A sensor whose frames are read.
struct Member {
    sensor: SensorName,
    reader: FrameReader,
    /// Frames that are not what they were when joining began.
    refused: Spell,
}

impl Gathering {
    /// Opens the frames channels, whether or not anybody publishes.
    ///
    /// * `sensors` — in the order of a joint frame's readings; the first leads
    pub fn open<'a>(
        node: &Node,
        sensors: impl IntoIterator<Item = &'a SensorName>,
    ) -> Result<Self, JoinError> {
        let member = |sensor: &SensorName| {
            let reader = FrameReader::open(node, sensor)?;
            let member = Member { sensor: sensor.clone(), reader, refused: Spell::default() };
            Ok((member, VecDeque::new()))
        };
        let members: Vec<_> = sensors.into_iter().map(member).collect::<Result<_, ChannelError>>()?;
        if members.len() < 2 {
            return Err(JoinError::TooFew);
        }
        Ok(Self { members })
    }

    /// The sensors of which no frame has come yet.
    pub fn missing(&self) -> impl Iterator<Item = &SensorName> {
        self.members.iter().filter(|(_, recent)| recent.is_empty()).map(|(member, _)| &member.sensor)
    }

    /// Takes what has come, or waits for it for a moment: 5 ms at most.
    pub fn look(&mut self) -> Result<(), JoinError> {
        for (member, recent) in &mut self.members {
            while let Some(frame) = member.reader.receive()? {
                let Some(layout) = layout_of(&frame) else { continue };
                // What it sent before it was another is of no use.
                recent.retain(|before| before.layout == layout);
                if recent.len() == Partner::n_frames_max(layout.n_readings()) {
                    recent.pop_front();
                }
                let (header, counts) = (*frame.header(), frame.counts().to_vec());
                recent.push_back(Recent { came: Instant::now(), layout, header, counts });
            }
            // The newest says what they look like, however old it is.
            while recent.len() > 1 && recent.pop_front_if(|frame| !frame.is_recent()).is_some() {}
        }
        if let Some((member, _)) = self.members.iter().find(|(_, recent)| recent.is_empty()) {
            member.reader.wait(TICK)?;
        }
        Ok(())
    }

    /// Begins, with the frames that came lately.
    ///
    /// # Errors
    /// If they have too many readings together.
    ///
    /// # Panics
    /// If some are [`missing`](Self::missing).
    pub fn begin(self, plan: JoinPlan) -> Result<Joined, JoinError> {
        let part = |(member, recent): &(Member, VecDeque<Recent>)| Part {
            sensor: member.sensor.clone(),
            layout: recent.back().expect("of each sensor a frame has come").layout,
        };
        let parts: Vec<Part> = self.members.iter().map(part).collect();
        let joining = Joining::new(plan, &parts);
        layout::check(joining.layout())?;
        let (members, recent): (Vec<_>, Vec<_>) = self.members.into_iter().unzip();
        let mut joined = Joined { members, parts, joining, start: Instant::now() };
        // Of the leader last: what came with its frames, or before, is then here.
        for (index, frames) in recent.into_iter().enumerate().rev() {
            for Recent { layout, header, counts, .. } in frames.iter().filter(|frame| frame.is_recent()) {
                joined.take(index, Some(*layout), header, counts);
            }
        }
        Ok(joined)
    }
}

impl Recent {
    fn is_recent(&self) -> bool {
        self.came.elapsed() <= RECENT
    }
}

/// Several sensors as a device.
pub struct Joined {
    /// The leader first.
    members: Vec<Member>,
    parts: Vec<Part>,
    joining: Joining,
    start: Instant,
}

impl Joined {
    /// What there is to say at the end, each a sentence: of each partner of which frames were missing, or came too late.
    pub fn remarks(&self) -> Vec<String> {
        self.joining.remarks()
    }

    fn take_what_waits(&mut self) -> Result<(), ChannelError> {
        // The leader first: whatever was sent before its frame is here when that is.
        for index in 0..self.members.len() {
            while let Some(frame) = self.members[index].reader.receive()? {
                self.take(index, layout_of(&frame), frame.header(), frame.counts());
            }
        }
        Ok(())
    }

    /// Takes in a frame.
    ///
    /// * `index` — of which sensor
    /// * `found` — what it looks like; none of one that is of no use
    fn take(&mut self, index: usize, found: Option<FrameLayout>, header: &FrameHeader, counts: &[u16]) {
        let expected = self.parts[index].layout;
        let member = &mut self.members[index];
        let sensor = &member.sensor;
        if found != Some(expected) {
            if member.refused.count(1) {
                let found = found
                    .map_or("contradict themselves".to_string(), |found| format!("have {}", words(found)));
                self.joining.tell(format!(
                    "frames of {sensor} {found}, and had {} when joining began; they are left out. If they are to stay so, start this \
                     program anew",
                    words(expected)
                ));
            }
            return;
        }
        if let Some(n_refused) = member.refused.calm() {
            self.joining
                .tell(format!("frames of {sensor} are as they were again; {n_refused} were left out"));
        }
        match index.checked_sub(1) {
            None => self.joining.lead(header, counts, self.start.elapsed()),
            Some(partner) => self.joining.accompany(partner, Stamp(header.captured_ns), counts),
        }
    }
}

impl Sensor for Joined {
    fn layout(&self) -> FrameLayout {
        self.joining.layout()
    }

    fn read(&mut self, counts: &mut [u16], timeout: Duration) -> Result<Reading, SensorError> {
        let deadline = Instant::now() + timeout;
        loop {
            self.take_what_waits().map_err(of_channel)?;
            if let Some(frame) = self.joining.next(self.start.elapsed(), counts) {
                return Ok(Reading::Numbered(frame));
            }
            let left = deadline.saturating_duration_since(Instant::now());
            if left.is_zero() {
                return Ok(Reading::NotYet);
            }
            let awaited = self.joining.awaited().map_or(0, |partner| 1 + partner);
            self.members[awaited].reader.wait(left.min(TICK)).map_err(of_channel)?;
        }
    }

    fn news(&mut self) -> Option<String> {
        self.joining.news()
    }
}

fn of_channel(error: ChannelError) -> SensorError {
    SensorError::Device(Box::new(error))
}

/// What a frame looks like, if it is one that this program knows and that does not contradict itself.
fn layout_of(frame: &Frame) -> Option<FrameLayout> {
    let &FrameHeader { version, rows, columns, metres_per_count, .. } = frame.header();
    let layout = FrameLayout { rows, columns, metres_per_count };
    let n_readings = u64::from(rows) * u64::from(columns);
    let is_whole = version == FrameHeader::VERSION && n_readings == frame.counts().len() as u64;
    (is_whole && layout::check(layout).is_ok()).then_some(layout)
}

/// `16 readings (2 × 8) of 0.001 m a count`
fn words(layout: FrameLayout) -> String {
    format!("{layout} of {} m a count", layout.metres_per_count)
}
