//! The loop that publishes one device.

use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

use kinds_messages::{
    ChannelError, FrameHeader, FramePublisher, Node, SensorName, SensorNameError, ns_since_epoch,
};
use kinds_trips::FrameLayout;

use crate::flow::{TICK, Traffic};
use crate::{Capture, Flow, Notice, NumberedFrame, Reading, Sensor, SensorError};

/// Publishes one device under a sensor's name.
pub struct Shim<S> {
    device: S,
    /// Of every frame, but for its number, time, pose and command.
    header: FrameHeader,
    frames: FramePublisher,
    traffic: Traffic,
    n_frames: u64,
    /// Number of the frame after all that were sent.
    next_sequence: u64,
}

/// What a shim did.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Summary {
    /// Frames sent.
    pub n_frames: u64,
    /// Of these, left unreported by services that went or fell silent. Only counted when services are followed.
    pub n_unreported: u64,
    /// From the first frame to the end.
    pub duration: Duration,
}

/// Why a shim cannot go on.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum ShimError {
    /// The frames channel, or the kinds channel that is followed.
    #[error(transparent)]
    Channel(#[from] ChannelError),
    /// The sensor's name is none.
    #[error(transparent)]
    Name(#[from] SensorNameError),
    /// The device.
    #[error(transparent)]
    Sensor(#[from] SensorError),
}

impl<S: Sensor> Shim<S> {
    /// Opens the frames channel of a sensor. Fails when another shim publishes it.
    pub fn new(node: &Node, sensor: &SensorName, device: S, flow: Flow) -> Result<Self, ChannelError> {
        let FrameLayout { rows, columns, metres_per_count } = device.layout();
        let run = ns_since_epoch() as u64;
        let header = FrameHeader { run, rows, columns, metres_per_count, ..FrameHeader::default() };
        let frames = FramePublisher::create(node, sensor, device.layout().n_readings())?;
        let traffic = Traffic::open(node, sensor, flow, run)?;
        Ok(Self { device, header, frames, traffic, n_frames: 0, next_sequence: 0 })
    }

    /// Publishes until the device ends or `stop` is set; returns what was done, and tells on the way what it waits for.
    ///
    /// Sees the flag after 50 ms at most. When the device ends, or fails, stays until its last frames have been
    /// reported, and 100 ms more: frames that no reader has looked at go with their publisher.
    pub fn run(&mut self, stop: &AtomicBool, notice: &mut dyn FnMut(Notice)) -> Result<Summary, ShimError> {
        if !self.traffic.await_reader(&self.frames, stop, notice)? {
            return Ok(Summary::default());
        }
        let start = Instant::now();
        loop {
            match self.publish_next(stop, notice) {
                Ok(Published::Frame) => {}
                Ok(Published::Stopped) => break,
                Ok(Published::All) => {
                    self.traffic.linger(self.next_sequence, stop)?;
                    break;
                }
                Err(ShimError::Sensor(error)) => {
                    // What came before is good: let it be read.
                    self.traffic.linger(self.next_sequence, stop)?;
                    return Err(error.into());
                }
                Err(error) => return Err(error),
            }
        }
        Ok(Summary {
            n_frames: self.n_frames,
            n_unreported: self.traffic.n_unreported(),
            duration: start.elapsed(),
        })
    }

    /// Tells a function about once a second that the loop turns: in the loop, so it must not wait. A device that hangs keeps it
    /// from being told, one that only has no frame does not.
    pub fn listen_to_turns(&mut self, listener: impl FnMut() + 'static) {
        self.traffic.listen_to_turns(Box::new(listener));
    }

    /// The device, for what it has to say at its end.
    pub fn device(&self) -> &S {
        &self.device
    }

    /// Publishes the device's next frame, however long it takes.
    fn publish_next(
        &mut self,
        stop: &AtomicBool,
        notice: &mut dyn FnMut(Notice),
    ) -> Result<Published, ShimError> {
        let mut loan = self.frames.loan()?;
        let n_readings = loan.counts_mut().len();
        let frame = loop {
            let reading = self.device.read(loan.counts_mut(), TICK)?;
            while let Some(news) = self.device.news() {
                notice(Notice::Device { sensor: self.traffic.sensor().clone(), news });
            }
            match reading {
                Reading::Frame(capture) => {
                    break NumberedFrame { capture, sequence: self.next_sequence, n_readings };
                }
                Reading::Numbered(frame) => break frame,
                Reading::NotYet if stop.load(Ordering::Relaxed) => return Ok(Published::Stopped),
                Reading::NotYet => {
                    self.frames.update()?;
                    self.traffic.clean_up();
                }
                Reading::End => return Ok(Published::All),
            }
        };
        // Only now, with the frame ready: a device that has ended does not wait for room that it has no use for.
        if !self.traffic.await_room(self.next_sequence, stop, notice)? {
            return Ok(Published::Stopped);
        }
        let header = self.header_of(&frame);
        if frame.n_readings == n_readings {
            loan.send(&header)?;
        } else {
            loan.send_first(frame.n_readings, &header)?;
        }
        self.n_frames += 1;
        self.next_sequence = self.next_sequence.max(frame.sequence.saturating_add(1));
        Ok(Published::Frame)
    }

    fn header_of(&self, frame: &NumberedFrame) -> FrameHeader {
        let Capture { captured, pose, command, true_pose } = frame.capture;
        let header = FrameHeader { sequence: frame.sequence, captured_ns: captured.0, ..self.header };
        header.with_pose(pose).with_command(command).with_true_pose(true_pose)
    }
}

/// What became of publishing the next frame.
enum Published {
    Frame,
    Stopped,
    All,
}
