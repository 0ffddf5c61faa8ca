//! Frames from their parts.

use kinds_trips::Stamp;

use super::part::Part;
use super::troubles::{Trouble, Troubles};
use crate::{Capture, NumberedFrame};

/// How far behind the newest frame one may come and still be taken for late: what lies further back is a device that has
/// started anew.
const LATE_MOST: u32 = 16;
/// How many frames may be lost at once: a number further ahead is a device that has started anew.
const LOST_MOST: u32 = 1_000_000;

/// Writes parts, in any order, to where the frame is wanted. A frame that another overtakes is given up.
pub(crate) struct Assembly {
    /// Per reading, whether it has come.
    has_come: Vec<bool>,
    n_come: usize,
    frame: Option<NumberedFrame>,
    /// The newest frame that has begun: the device's number, and ours.
    newest: Option<(u32, u64)>,
    is_anew: bool,
}

impl Assembly {
    pub(crate) fn new(n_readings: usize) -> Self {
        Self { has_come: vec![false; n_readings], n_come: 0, frame: None, newest: None, is_anew: false }
    }

    /// The device may have started anew: whatever number comes next is the next frame's.
    pub(crate) fn start_anew(&mut self) {
        self.is_anew = true;
    }

    /// Adds a part; returns the frame if it is whole now.
    ///
    /// * `sent` — its counts as they were sent
    /// * `counts` — `(n_readings,)`, the same until a frame is whole
    /// * `now` — for frames that do not say when they were captured
    pub(crate) fn add(
        &mut self,
        part: &Part,
        sent: &[u8],
        counts: &mut [u16],
        now: Stamp,
        troubles: &mut Troubles,
    ) -> Option<NumberedFrame> {
        let goes_on = self.frame.is_some()
            && !self.is_anew
            && self.newest.is_some_and(|(number, _)| number == part.sequence);
        if !goes_on {
            let Some(sequence) = self.place(part.sequence) else {
                troubles.count(Trouble::Late, 1);
                return None;
            };
            if self.frame.is_some() {
                troubles.count(Trouble::Incomplete, 1);
            }
            self.begin(part, sequence, now);
        }
        let first = part.first_reading as usize;
        for (index, sent) in sent.chunks_exact(2).enumerate() {
            counts[first + index] = u16::from_le_bytes([sent[0], sent[1]]);
            let has_come = &mut self.has_come[first + index];
            self.n_come += usize::from(!std::mem::replace(has_come, true));
        }
        if self.n_come < self.has_come.len() {
            return None;
        }
        self.frame.take()
    }

    /// Our number of a frame that begins; `None` if it is late, or comes again.
    fn place(&self, number: u32) -> Option<u64> {
        let Some((newest, ours)) = self.newest else { return Some(0) };
        let (ahead, behind) = (number.wrapping_sub(newest), newest.wrapping_sub(number));
        match () {
            () if self.is_anew => Some(ours + 1),
            () if behind <= LATE_MOST => None,
            () if ahead <= LOST_MOST => Some(ours + u64::from(ahead)),
            () => Some(ours + 1),
        }
    }

    fn begin(&mut self, part: &Part, sequence: u64, now: Stamp) {
        let captured = if part.captured_ns == 0 { now } else { Stamp(part.captured_ns) };
        let capture = Capture::at(captured);
        self.frame = Some(NumberedFrame { capture, sequence, n_readings: self.has_come.len() });
        self.newest = Some((part.sequence, sequence));
        self.is_anew = false;
        self.has_come.fill(false);
        self.n_come = 0;
    }
}
