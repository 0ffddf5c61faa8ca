//! A video device that sends frames.

use std::io;
use std::path::Path;
use std::time::Duration;

use kinds_messages::{monotonic_ns, ns_since_epoch};
use kinds_trips::{FrameLayout, Stamp};
use rustix::io::Errno;

use super::abi::{Buffer, CAPTURE, CLOCK, CLOCK_MONOTONIC, DAMAGED, MAPPED, RequestBuffers};
use super::negotiation::{Agreement, CameraError, negotiate};
use super::video_device::VideoDevice;

/// Buffers asked for: one that is written to, one that waits, and two for when we are late.
const N_BUFFERS: u32 = 4;

/// Frames as they come. Ends when dropped.
pub(crate) struct Stream {
    device: Box<dyn VideoDevice>,
    n_columns: usize,
    agreement: Agreement,
    epoch_from_monotonic_ns: i64,
}

/// A frame as the driver hands it over.
pub(crate) struct Picture {
    /// The driver's number.
    pub(crate) number: u32,
    pub(crate) captured: Stamp,
    pub(crate) state: State,
}

/// Whether the counts of a frame are there.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum State {
    Whole,
    /// The driver says that they may be wrong.
    Damaged,
    /// Fewer bytes than its rows take.
    Short {
        n_bytes: usize,
        n_bytes_expected: usize,
    },
}

impl Stream {
    /// Agrees with a device on a layout, and has it send frames.
    pub(crate) fn start(
        mut device: Box<dyn VideoDevice>,
        path: &Path,
        layout: FrameLayout,
        rate_hz: Option<u32>,
    ) -> Result<Self, CameraError> {
        let agreement = negotiate(&mut *device, path, layout, rate_hz)?;
        begin(&mut *device).map_err(|error| CameraError::Io { path: path.to_path_buf(), error })?;
        let n_columns = layout.columns as usize;
        Ok(Self { device, n_columns, agreement, epoch_from_monotonic_ns: epoch_from_monotonic_ns() })
    }

    /// What a person should know of what was agreed on. Once.
    pub(crate) fn take_remark(&mut self) -> Option<String> {
        self.agreement.remark.take()
    }

    /// Waits for a frame and copies its counts, if they are whole. An error means that no more will come.
    ///
    /// * `counts` — `(n_readings,)`
    pub(crate) fn next(&mut self, counts: &mut [u16], timeout: Duration) -> io::Result<Option<Picture>> {
        if !self.device.wait(timeout)? {
            return Ok(None);
        }
        let wanted = Buffer { buffer_type: CAPTURE, memory: MAPPED, ..Buffer::default() };
        let (buffer, bytes) = match self.device.dequeue(wanted) {
            Err(error) if is_passing(&error) => return Ok(None),
            dequeued => dequeued?,
        };
        let state = match buffer.flags & DAMAGED {
            0 => copy(bytes, self.agreement.stride, self.n_columns, counts),
            _ => State::Damaged,
        };
        let captured = captured(&buffer, self.epoch_from_monotonic_ns);
        self.device.queue(Buffer { index: buffer.index, ..wanted })?;
        Ok(Some(Picture { number: buffer.sequence, captured, state }))
    }
}

impl Drop for Stream {
    fn drop(&mut self) {
        // Closing it would end it too; of a device that is gone there is nothing to end.
        let _ = self.device.stream(false);
    }
}

fn begin(device: &mut dyn VideoDevice) -> io::Result<()> {
    let wanted = RequestBuffers {
        count: N_BUFFERS,
        buffer_type: CAPTURE,
        memory: MAPPED,
        ..RequestBuffers::default()
    };
    let n_buffers = device.request_buffers(wanted)?.count;
    if n_buffers == 0 {
        return Err(io::Error::other("its driver has no memory for frames"));
    }
    let buffers = (0..n_buffers).map(|index| Buffer {
        index,
        buffer_type: CAPTURE,
        memory: MAPPED,
        ..Buffer::default()
    });
    for buffer in buffers {
        device.map(buffer)?;
        device.queue(buffer)?;
    }
    device.stream(true)
}

/// Copies rows that may have a margin, whole or not at all.
fn copy(bytes: &[u8], stride: usize, n_columns: usize, counts: &mut [u16]) -> State {
    let n_rows = counts.len() / n_columns;
    // The last row may lack its margin.
    let n_bytes_expected = (n_rows - 1) * stride + n_columns * 2;
    if bytes.len() < n_bytes_expected {
        return State::Short { n_bytes: bytes.len(), n_bytes_expected };
    }
    for (row, bytes) in counts.chunks_exact_mut(n_columns).zip(bytes.chunks(stride)) {
        for (count, bytes) in row.iter_mut().zip(bytes.chunks_exact(2)) {
            *count = u16::from_le_bytes([bytes[0], bytes[1]]);
        }
    }
    State::Whole
}

/// When a frame was captured, by the wall clock as it stood when the stream began; now, if its driver has another clock.
fn captured(buffer: &Buffer, epoch_from_monotonic_ns: i64) -> Stamp {
    if buffer.flags & CLOCK != CLOCK_MONOTONIC {
        return Stamp(ns_since_epoch());
    }
    let Buffer { timestamp_s, timestamp_us, .. } = *buffer;
    let monotonic_ns =
        timestamp_s.saturating_mul(1_000_000_000).saturating_add(timestamp_us.saturating_mul(1000));
    Stamp(monotonic_ns.saturating_add(epoch_from_monotonic_ns))
}

/// What is added to a monotonic time for the wall clock's. Of a few measurements the one that took least: whoever is interrupted
/// between two looks at clocks would be wrong by as much for as long as the stream lasts.
fn epoch_from_monotonic_ns() -> i64 {
    let measure = || {
        let before_ns = monotonic_ns();
        let epoch_ns = ns_since_epoch();
        let took_ns = monotonic_ns() - before_ns;
        (took_ns, epoch_ns - (before_ns + took_ns / 2) as i64)
    };
    let (_, offset_ns) = (0..5).map(|_| measure()).min().expect("five of them");
    offset_ns
}

fn is_passing(error: &io::Error) -> bool {
    matches!(Errno::from_io_error(error), Some(Errno::AGAIN | Errno::INTR))
}
