//! A sensor's frames for C: up to two at a time, where the driver shim wrote them.

use std::ffi::c_char;

use kinds_messages::{Frame, FrameHeader, FrameReader, Waiting};

use crate::call::{CallError, call};
use crate::handle::Handle;
use crate::member::{KINDS_ERROR, Member, sensor_name, waiting_of};

/// A reader of a sensor's frames.
pub struct kinds_frames {
    _is_a_handle: Handle<Frames>,
}

/// A frame in shared memory, where the driver shim wrote it.
#[repr(C)]
pub struct kinds_frame {
    /// All but the counts.
    pub header: *const FrameHeader,
    /// The counts, row by row; 0 for a reading without measurement.
    pub counts: *const u16,
    /// How many counts there are: the header's rows × columns.
    pub n_readings: usize,
}

struct Frames {
    held: Vec<Frame>,
    reader: FrameReader,
    waiting: Waiting,
    member: Member,
}

/// Opens a sensor's frames, whether or not a driver shim is there. As `kinds_reports_open`; but who comes late gets none of the
/// frames before.
///
/// # Safety
/// Texts end with a zero.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn kinds_frames_open(
    sensor: *const c_char,
    domain: *const c_char,
    waiting: u32,
) -> *mut kinds_frames {
    call(std::ptr::null_mut(), || {
        // SAFETY: the caller's promise is the same.
        let (sensor, member) = unsafe { (sensor_name(sensor)?, Member::join(domain)?) };
        let waiting = waiting_of(waiting)?;
        let reader = FrameReader::open_with(&member.node, &sensor, waiting)?;
        Ok(Handle::open(Frames { held: Vec::with_capacity(2), reader, waiting, member }).cast())
    })
}

/// Takes the oldest frame that waits; where there is none, waits for one until `timeout_ms` is over (0: does not wait).
///
/// `KINDS_RECEIVED`, `KINDS_NOTHING`, `KINDS_INTERRUPTED` or `KINDS_ERROR`. The frame is valid until it is released with
/// `kinds_frames_release`, which the driver shim does not wait for; two can be held at a time.
///
/// A reader that is slow finds the last 16; what it missed shows in `sequence`, within one `run`.
///
/// # Safety
/// `frames` is open, and `frame` points to where it is to be described.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn kinds_frames_next(
    frames: *mut kinds_frames,
    timeout_ms: u32,
    frame: *mut kinds_frame,
) -> i32 {
    call(KINDS_ERROR, || {
        // SAFETY: the caller says that it is open.
        let mut frames = unsafe { Handle::<Frames>::enter(frames.cast()) }?;
        if frame.is_null() {
            return Err(CallError::Null { what: "the place for the frame" });
        }
        let Frames { held, reader, waiting, member } = &mut *frames;
        let receive = || reader.receive()?.map(checked).transpose();
        let came = member.await_message(timeout_ms, *waiting, receive, |left| reader.wait(left))?;
        Ok(came.tell(|received| {
            let (header, counts) = (&raw const *received.header(), received.counts());
            let received_frame = kinds_frame { header, counts: counts.as_ptr(), n_readings: counts.len() };
            // SAFETY: the caller says that it points to a place for it, which need not hold one yet.
            unsafe { frame.write(received_frame) };
            held.push(received);
        }))
    })
}

/// A frame that is what its header says.
fn checked(frame: Frame) -> Result<Frame, CallError> {
    let &FrameHeader { version, rows, columns, .. } = frame.header();
    let n_readings = frame.counts().len();
    if version != FrameHeader::VERSION {
        return Err(CallError::FrameVersion { found: version });
    }
    if u64::from(rows) * u64::from(columns) != n_readings as u64 {
        return Err(CallError::FrameContradiction { n_readings, rows, columns });
    }
    Ok(frame)
}

/// Gives a frame back. 0, or `KINDS_ERROR` if this handle does not hold it.
///
/// # Safety
/// `frames` is open, and `frame` is as `kinds_frames_next` filled it, or a copy of that.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn kinds_frames_release(frames: *mut kinds_frames, frame: *const kinds_frame) -> i32 {
    call(KINDS_ERROR, || {
        // SAFETY: the caller says that it is open.
        let mut frames = unsafe { Handle::<Frames>::enter(frames.cast()) }?;
        // SAFETY: the caller says that it points to a frame.
        let frame = unsafe { frame.as_ref() }.ok_or(CallError::Null { what: "the frame" })?;
        let index = frames.held.iter().position(|held| std::ptr::eq(held.header(), frame.header));
        frames.held.remove(index.ok_or(CallError::NotHeld)?);
        Ok(0)
    })
}

/// Closes it, and gives back what it holds. NULL is nothing to close.
///
/// # Safety
/// `frames` is NULL or open, and is not used again.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn kinds_frames_close(frames: *mut kinds_frames) {
    // SAFETY: the caller's promise is the same.
    call((), || unsafe { Handle::<Frames>::close(frames.cast()) });
}
