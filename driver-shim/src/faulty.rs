//! A device some of whose frames are spoilt, to see what the others make of it.

use std::collections::VecDeque;
use std::fmt;
use std::time::Duration;

use kinds_trips::FrameLayout;
use rand::RngExt;
use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::SeedableRng;

use crate::faults::Fault;
use crate::paced::{Clock, SystemClock};
use crate::{Faults, NumberedFrame, Reading, Sensor, SensorError};

/// A device with faults. What befalls which frame follows from the seed and the number of the frame alone.
///
/// Numbers its frames before they are spoilt: one that is dropped is missing in the sequence, as if it had been lost on the
/// way.
pub struct Faulty<S> {
    device: S,
    faults: Faults,
    random: ChaCha8Rng,
    clock: Box<dyn Clock>,
    injected: Injected,
    /// Comes when another frame has overtaken it.
    held: Option<Kept>,
    /// Come before the device is asked again.
    next: VecDeque<Kept>,
    /// In the counts already, and when it is to come.
    late: Option<(NumberedFrame, Duration)>,
    has_ended: bool,
}

/// A frame that comes later, or again.
struct Kept {
    frame: NumberedFrame,
    counts: Vec<u16>,
}

/// What befell a device's frames.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Injected {
    /// Frames of the device.
    pub n_frames: u64,
    /// Of these, never sent.
    pub n_dropped: u64,
    /// Of these, sent twice.
    pub n_repeated: u64,
    /// Of these, sent after their successor.
    pub n_reordered: u64,
    /// Of these, sent late.
    pub n_delayed: u64,
    /// Of these, sent with one bit flipped.
    pub n_flipped: u64,
    /// Of these, sent without any valid reading.
    pub n_invalid: u64,
    /// Of these, sent without their last reading.
    pub n_short: u64,
}

impl fmt::Display for Injected {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { n_frames, n_dropped, n_repeated, n_reordered, n_delayed, n_flipped, n_invalid, n_short } =
            self;
        write!(
            f,
            "{n_frames} frames: {n_dropped} dropped, {n_repeated} repeated, {n_reordered} reordered, {n_delayed} \
             delayed, {n_flipped} with a flipped bit, {n_invalid} invalid, {n_short} of the wrong length"
        )
    }
}

impl<S: Sensor> Faulty<S> {
    /// Lets faults befall a device.
    pub fn new(device: S, faults: Faults) -> Self {
        Self::with_clock(device, faults, Box::new(SystemClock::new()))
    }

    pub(crate) fn with_clock(device: S, faults: Faults, clock: Box<dyn Clock>) -> Self {
        Self {
            device,
            random: ChaCha8Rng::seed_from_u64(faults.seed),
            faults,
            clock,
            injected: Injected::default(),
            held: None,
            next: VecDeque::new(),
            late: None,
            has_ended: false,
        }
    }

    /// What has befallen it so far.
    pub fn injected(&self) -> Injected {
        self.injected
    }

    /// The device, for what it has to say at its end.
    pub fn device(&self) -> &S {
        &self.device
    }

    /// A fresh frame, or what a fault leaves of it.
    fn spoil(&mut self, mut frame: NumberedFrame, counts: &mut [u16]) -> Reading {
        self.injected.n_frames += 1;
        // As many draws for every frame: no fault changes what befalls those after it.
        let (chance, place): (f64, u64) = (self.random.random(), self.random.random());
        let injected = &mut self.injected;
        match self.faults.at(chance) {
            Some(Fault::Drop) => {
                injected.n_dropped += 1;
                return Reading::NotYet;
            }
            Some(Fault::Delay) => {
                injected.n_delayed += 1;
                let delay = Duration::from_secs_f64(self.faults.delay_ms / 1000.0);
                self.late = Some((frame, self.clock.now() + delay));
                return Reading::NotYet;
            }
            // Two that wait for another to overtake them would wait for each other: the second is the other.
            Some(Fault::Reorder) if self.held.is_none() => {
                self.held = Some(Kept { frame, counts: counts.to_vec() });
                return Reading::NotYet;
            }
            Some(Fault::Repeat) => {
                injected.n_repeated += 1;
                self.next.push_back(Kept { frame, counts: counts.to_vec() });
            }
            Some(Fault::FlipBit) => {
                injected.n_flipped += 1;
                let n_bits = u64::from(u16::BITS) * counts.len() as u64;
                let bit = place % n_bits;
                counts[(bit / u64::from(u16::BITS)) as usize] ^= 1 << (bit % u64::from(u16::BITS));
            }
            Some(Fault::Invalid) => {
                injected.n_invalid += 1;
                counts.fill(0);
            }
            Some(Fault::WrongLength) => {
                injected.n_short += 1;
                frame.n_readings -= 1;
                // Refused, so that it overtakes nobody.
                return Reading::Numbered(frame);
            }
            Some(Fault::Reorder) | None => {}
        }
        self.hand_over(frame)
    }

    /// Gives a frame away, and after it the one that it has overtaken.
    fn hand_over(&mut self, frame: NumberedFrame) -> Reading {
        if let Some(overtaken) = self.held.take() {
            self.injected.n_reordered += 1;
            self.next.push_back(overtaken);
        }
        Reading::Numbered(frame)
    }

    /// Waits for a frame that comes late.
    fn await_late(&mut self, timeout: Duration) -> Option<Reading> {
        let (frame, due) = self.late?;
        let wait = due.saturating_sub(self.clock.now());
        self.clock.sleep(wait.min(timeout));
        if wait > timeout {
            return Some(Reading::NotYet);
        }
        self.late = None;
        Some(self.hand_over(frame))
    }
}

impl<S: Sensor> Sensor for Faulty<S> {
    fn layout(&self) -> FrameLayout {
        self.device.layout()
    }

    fn read(&mut self, counts: &mut [u16], timeout: Duration) -> Result<Reading, SensorError> {
        let give = |kept: Kept, counts: &mut [u16]| {
            counts.copy_from_slice(&kept.counts);
            Ok(Reading::Numbered(kept.frame))
        };
        if let Some(kept) = self.next.pop_front() {
            return give(kept, counts);
        }
        if let Some(reading) = self.await_late(timeout) {
            return Ok(reading);
        }
        if self.has_ended {
            return Ok(Reading::End);
        }
        match self.device.read(counts, timeout)? {
            Reading::NotYet => Ok(Reading::NotYet),
            Reading::Numbered(frame) => Ok(self.spoil(frame, counts)),
            Reading::Frame(capture) => {
                let sequence = self.injected.n_frames;
                Ok(self.spoil(NumberedFrame { capture, sequence, n_readings: counts.len() }, counts))
            }
            Reading::End => {
                self.has_ended = true;
                // Nobody is left to overtake it.
                self.held.take().map_or(Ok(Reading::End), |kept| give(kept, counts))
            }
        }
    }

    fn news(&mut self) -> Option<String> {
        self.device.news()
    }
}

#[cfg(test)]
mod tests {

    use kinds_trips::Stamp;
    use proptest::prelude::*;

    use super::*;
    use crate::Capture;
    use crate::testing::SleepClock;

    const N_READINGS: usize = 3;

    /// Gives frames whose readings are their number and more than 0, and ends.
    struct Counter {
        n_frames: u64,
        next: u64,
    }

    impl Sensor for Counter {
        fn layout(&self) -> FrameLayout {
            FrameLayout { rows: 1, columns: N_READINGS as u32, metres_per_count: 0.001 }
        }

        fn read(&mut self, counts: &mut [u16], _timeout: Duration) -> Result<Reading, SensorError> {
            assert!(self.next <= self.n_frames, "asked again after its end");
            self.next += 1;
            if self.next > self.n_frames {
                return Ok(Reading::End);
            }
            counts.fill(self.next as u16);
            let captured = Stamp(self.next as i64);
            Ok(Reading::Frame(Capture::at(captured)))
        }
    }

    /// Number, counts and length of every frame that comes, when it comes, and what was injected.
    struct Ran {
        frames: Vec<(NumberedFrame, Vec<u16>, Duration)>,
        injected: Injected,
    }

    fn run(faults: Faults, n_frames: u64) -> Ran {
        let clock = SleepClock::default();
        let device = Counter { n_frames, next: 0 };
        let mut faulty = Faulty::with_clock(device, faults, Box::new(clock.clone()));
        let (mut frames, mut counts) = (Vec::new(), vec![0; N_READINGS]);
        loop {
            // After a frame comes another slice; after "not yet" the same.
            match faulty.read(&mut counts, Duration::from_millis(50)).unwrap() {
                Reading::NotYet => {}
                Reading::Frame(frame) => panic!("{frame:?} without a number"),
                Reading::End => return Ran { frames, injected: faulty.injected() },
                Reading::Numbered(frame) => {
                    frames.push((frame, std::mem::replace(&mut counts, vec![9; N_READINGS]), clock.now()));
                }
            }
        }
    }

    fn sequences(ran: &Ran) -> Vec<u64> {
        ran.frames.iter().map(|(frame, ..)| frame.sequence).collect()
    }

    #[test]
    fn without_faults_every_frame_comes_once_as_it_was() {
        let ran = run(Faults::default(), 5);
        assert_eq!(sequences(&ran), [0, 1, 2, 3, 4]);
        for (frame, counts, _) in &ran.frames {
            assert_eq!((counts, frame.n_readings), (&vec![frame.sequence as u16 + 1; 3], 3));
        }
        assert_eq!(ran.injected, Injected { n_frames: 5, ..Injected::default() });
    }

    #[test]
    fn each_fault_alone_does_to_every_frame_what_it_says() {
        let all = |set: fn(&mut Faults)| {
            let mut faults = Faults::default();
            set(&mut faults);
            run(faults, 4)
        };
        assert_eq!(sequences(&all(|faults| faults.drop = 1.0)), [0; 0]);
        assert_eq!(sequences(&all(|faults| faults.repeat = 1.0)), [0, 0, 1, 1, 2, 2, 3, 3]);
        let reordered = all(|faults| faults.reorder = 1.0);
        assert_eq!((sequences(&reordered), reordered.injected.n_reordered), (vec![1, 0, 3, 2], 2));
        let delayed = all(|faults| (faults.delay, faults.delay_ms) = (1.0, 120.0));
        let came: Vec<_> = delayed.frames.iter().map(|(_, _, at)| at.as_millis()).collect();
        assert_eq!((sequences(&delayed), came), (vec![0, 1, 2, 3], vec![120, 240, 360, 480]));
        for (frame, counts, _) in all(|faults| faults.flip_bit = 1.0).frames {
            let n_flipped: u32 =
                counts.iter().map(|count| (count ^ (frame.sequence as u16 + 1)).count_ones()).sum();
            assert_eq!(n_flipped, 1);
        }
        assert!(all(|faults| faults.invalid = 1.0).frames.iter().all(|(_, counts, _)| *counts == [0; 3]));
        let short = all(|faults| faults.wrong_length = 1.0);
        assert!(short.frames.iter().all(|(frame, ..)| frame.n_readings == 2));
        assert_eq!(short.injected.n_short, 4);
    }

    #[test]
    fn a_frame_that_nobody_is_left_to_overtake_comes_last() {
        let ran = run(Faults { reorder: 1.0, ..Faults::default() }, 3);
        assert_eq!((sequences(&ran), ran.injected.n_reordered), (vec![1, 0, 2], 1));
    }

    proptest! {
        #[test]
        fn whatever_befalls_them_frames_are_accounted_for_and_alike_for_equal_seeds(
            seed: u64,
            shares in proptest::array::uniform7(0.0..0.14),
            n_frames in 0..200_u64,
        ) {
            let [drop, repeat, reorder, delay, flip_bit, invalid, wrong_length] = shares;
            let delay_ms = 70.0;
            let faults =
                Faults { seed, drop, repeat, reorder, delay, delay_ms, flip_bit, invalid, wrong_length };
            let ran = run(faults.clone(), n_frames);
            let Injected { n_dropped, n_repeated, n_reordered, n_flipped, n_invalid, n_short, .. } = ran.injected;
            prop_assert_eq!(ran.injected.n_frames, n_frames);
            prop_assert_eq!(ran.frames.len() as u64, n_frames - n_dropped + n_repeated);
            // As the service counts them.
            let (mut next, mut n_late, mut n_missed) = (0, 0, 0);
            for (frame, ..) in ran.frames.iter().filter(|(frame, ..)| frame.n_readings == N_READINGS) {
                if frame.sequence < next {
                    n_late += 1;
                } else {
                    n_missed += frame.sequence - next;
                    next = frame.sequence + 1;
                }
            }
            prop_assert_eq!(n_late, n_repeated + n_reordered);
            prop_assert_eq!(n_missed + (n_frames - next), n_dropped + n_short + n_reordered);
            let was = |frame: &NumberedFrame| [frame.sequence as u16 + 1; N_READINGS];
            let n_changed = ran.frames.iter().filter(|(frame, counts, _)| counts[..] != was(frame)).count();
            prop_assert_eq!(n_changed as u64, n_flipped + n_invalid);
            prop_assert_eq!(run(faults, n_frames).frames, ran.frames);
        }
    }
}
