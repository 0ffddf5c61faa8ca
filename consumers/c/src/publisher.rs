//! The way in for drivers in C: a frame's memory is borrowed, filled where readers will read it, and sent.

use std::ffi::c_char;

use kinds_messages::{FrameHeader, FrameLoan, FramePublisher, ns_since_epoch};

use crate::call::{CallError, call};
use crate::handle::Handle;
use crate::member::{KINDS_ERROR, Member, sensor_name};

/// Most readings of a frame: more than any depth camera has, and few enough that no size overflows.
pub(crate) const N_READINGS_MAX: u64 = 1 << 26;

/// The publisher of a sensor's frames.
pub struct kinds_publisher {
    _is_a_handle: Handle<Publisher>,
}

/// A frame that is being filled: borrowed until it is sent or given back.
#[repr(C)]
pub struct kinds_loan {
    /// All but the counts; goes with the frame when it is sent. As lent it is numbered, captured now, and knows neither pose nor
    /// command: set those with their flags, `captured_ns` if the device says better, `sequence` to leave a gap. What the sensor is
    /// was settled by opening, and is set by sending.
    pub header: FrameHeader,
    /// The counts, row by row, all 0 (no measurement) as lent; in shared memory, where readers will read them.
    pub counts: *mut u16,
    /// How many counts there are: rows × columns.
    pub n_readings: usize,
}

struct Publisher {
    loan: Option<FrameLoan<'static>>,
    frames: Lender,
    /// Of every frame, but for its number, time, pose and command.
    header: FrameHeader,
    next_sequence: u64,
    member: Member,
}

impl Publisher {
    /// Takes back the loan that C has, if that is it.
    fn take_loan(&mut self, loan: &kinds_loan) -> Result<FrameLoan<'static>, CallError> {
        let is_it = |lent: &mut FrameLoan<'static>| std::ptr::eq(lent.counts_mut().as_ptr(), loan.counts);
        self.loan.take_if(is_it).ok_or(CallError::NotLent)
    }
}

/// A publisher at a place of its own, so that a loan can stand beside it.
struct Lender(*mut FramePublisher);

impl Lender {
    fn new(frames: FramePublisher) -> Self {
        Self(Box::into_raw(Box::new(frames)))
    }

    /// # Safety
    /// The result, and what it lends, is gone before this is dropped.
    unsafe fn frames(&self) -> &'static FramePublisher {
        // SAFETY: it stays where it is until this is dropped, and until then is only ever shared.
        unsafe { &*self.0 }
    }
}

impl Drop for Lender {
    fn drop(&mut self) {
        // SAFETY: it came from a box, and nobody has it any more.
        drop(unsafe { Box::from_raw(self.0) });
    }
}

/// Opens a sensor's frames as their publisher: the only one at a time. Takes the place of one that was killed.
///
/// `sensor` and `domain`: as for `kinds_reports_open`. `rows`: 1 for a ring. `metres_per_count`: what a count stands for. NULL if
/// it could not.
///
/// # Safety
/// Texts end with a zero.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn kinds_publisher_open(
    sensor: *const c_char,
    domain: *const c_char,
    rows: u32,
    columns: u32,
    metres_per_count: f64,
) -> *mut kinds_publisher {
    call(std::ptr::null_mut(), || {
        let n_readings = u64::from(rows) * u64::from(columns);
        let is_a_unit = metres_per_count.is_finite() && metres_per_count > 0.0;
        if !(1..=N_READINGS_MAX).contains(&n_readings) || !is_a_unit {
            return Err(CallError::Layout { rows, columns, metres_per_count });
        }
        // SAFETY: the caller's promise is the same.
        let (sensor, member) = unsafe { (sensor_name(sensor)?, Member::join(domain)?) };
        let frames = Lender::new(FramePublisher::create(&member.node, &sensor, n_readings as usize)?);
        let run = ns_since_epoch() as u64;
        let header = FrameHeader { run, rows, columns, metres_per_count, ..FrameHeader::default() };
        Ok(Handle::open(Publisher { loan: None, frames, header, next_sequence: 0, member }).cast())
    })
}

/// Borrows the memory of the next frame. 0 or `KINDS_ERROR`. One at a time; send it, or give it back.
///
/// # Safety
/// `publisher` is open, and `loan` points to where the loan is to be described.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn kinds_publisher_borrow(
    publisher: *mut kinds_publisher,
    loan: *mut kinds_loan,
) -> i32 {
    call(KINDS_ERROR, || {
        // SAFETY: the caller says that it is open.
        let mut publisher = unsafe { Handle::<Publisher>::enter(publisher.cast()) }?;
        if loan.is_null() {
            return Err(CallError::Null { what: "the place for the loan" });
        }
        // SAFETY: loans stay in `publisher.loan`, which is dropped before `publisher.frames`, or are sent at once.
        let mut lent = unsafe { publisher.frames.frames() }.loan()?;
        let counts = lent.counts_mut();
        let header = FrameHeader {
            sequence: publisher.next_sequence,
            captured_ns: ns_since_epoch(),
            ..publisher.header
        };
        // SAFETY: the caller says that it points to a place for it, which need not hold one yet.
        unsafe { loan.write(kinds_loan { header, counts: counts.as_mut_ptr(), n_readings: counts.len() }) };
        publisher.loan = Some(lent);
        Ok(0)
    })
}

/// Sends the frame that was borrowed, and wakes its readers; waits for none of them. 0 or `KINDS_ERROR`. The loan is over either
/// way.
///
/// # Safety
/// `publisher` is open, and `loan` is as `kinds_publisher_borrow` filled it but for what its header says.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn kinds_publisher_send(
    publisher: *mut kinds_publisher,
    loan: *const kinds_loan,
) -> i32 {
    call(KINDS_ERROR, || {
        // SAFETY: the caller says that it is open.
        let mut publisher = unsafe { Handle::<Publisher>::enter(publisher.cast()) }?;
        // SAFETY: the caller says that it points to a loan.
        let loan = unsafe { loan.as_ref() }.ok_or(CallError::Null { what: "the loan" })?;
        let lent = publisher.take_loan(loan)?;
        let FrameHeader { flags, sequence, captured_ns, pose, command, true_pose, .. } = loan.header;
        let header =
            FrameHeader { flags, sequence, captured_ns, pose, command, true_pose, ..publisher.header };
        lent.send(&header)?;
        publisher.next_sequence = sequence.wrapping_add(1);
        Ok(0)
    })
}

/// Gives back what was borrowed, unsent. 0 or `KINDS_ERROR`.
///
/// # Safety
/// As for `kinds_publisher_send`.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn kinds_publisher_give_back(
    publisher: *mut kinds_publisher,
    loan: *const kinds_loan,
) -> i32 {
    call(KINDS_ERROR, || {
        // SAFETY: the caller says that it is open.
        let mut publisher = unsafe { Handle::<Publisher>::enter(publisher.cast()) }?;
        // SAFETY: the caller says that it points to a loan.
        let loan = unsafe { loan.as_ref() }.ok_or(CallError::Null { what: "the loan" })?;
        publisher.take_loan(loan)?;
        Ok(0)
    })
}

/// Lets readers that came since the last frame connect, and cleans up after those that were killed. 0 or `KINDS_ERROR`.
///
/// Call it some twenty times a second while no frames are sent, as while the device is away.
///
/// # Safety
/// `publisher` is open.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn kinds_publisher_update(publisher: *mut kinds_publisher) -> i32 {
    call(KINDS_ERROR, || {
        // SAFETY: the caller says that it is open.
        let mut publisher = unsafe { Handle::<Publisher>::enter(publisher.cast()) }?;
        publisher.member.clean_up_now_and_then();
        // SAFETY: it is used for this call alone.
        unsafe { publisher.frames.frames() }.update()?;
        Ok(0)
    })
}

/// How many programs read the frames, or `KINDS_ERROR`. One that was killed counts until it is cleaned up.
///
/// # Safety
/// `publisher` is open.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn kinds_publisher_n_readers(publisher: *mut kinds_publisher) -> i32 {
    call(KINDS_ERROR, || {
        // SAFETY: the caller says that it is open.
        let publisher = unsafe { Handle::<Publisher>::enter(publisher.cast()) }?;
        // SAFETY: it is used for this call alone.
        Ok(unsafe { publisher.frames.frames() }.n_readers() as i32)
    })
}

/// Closes it, and gives back what is borrowed. NULL is nothing to close.
///
/// Frames that no reader has looked at yet go with their publisher: linger for 100 ms after the last one.
///
/// # Safety
/// `publisher` is NULL or open, and is not used again.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn kinds_publisher_close(publisher: *mut kinds_publisher) {
    // SAFETY: the caller's promise is the same.
    call((), || unsafe { Handle::<Publisher>::close(publisher.cast()) });
}
