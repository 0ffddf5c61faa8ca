//! A sensor's kinds for C: one report at a time, where the service wrote it.

use std::ffi::c_char;

use kinds_messages::{HeldReport, KindReport, ReportReader, Waiting};

use crate::call::{CallError, call};
use crate::handle::Handle;
use crate::member::{KINDS_ERROR, Member, sensor_name, waiting_of};

/// A reader of a sensor's kinds.
pub struct kinds_reports {
    _is_a_handle: Handle<Reports>,
}

struct Reports {
    held: Option<HeldReport>,
    reader: ReportReader,
    waiting: Waiting,
    member: Member,
}

/// Opens a sensor's kinds, whether or not a service is there: it may come later, go, and come back.
///
/// `sensor`: such as "crunch/ring". `domain`: the folder that the robot's programs meet in; NULL for the environment's
/// `KINDS_DOMAIN`, and without one for the default. `waiting`: `KINDS_BY_EVENT` or `KINDS_POLLING`.
///
/// NULL if it could not. Who comes late gets the last report at once.
///
/// # Safety
/// Texts end with a zero.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn kinds_reports_open(
    sensor: *const c_char,
    domain: *const c_char,
    waiting: u32,
) -> *mut kinds_reports {
    call(std::ptr::null_mut(), || {
        // SAFETY: the caller's promise is the same.
        let (sensor, member) = unsafe { (sensor_name(sensor)?, Member::join(domain)?) };
        let waiting = waiting_of(waiting)?;
        let reader = ReportReader::open_with(&member.node, &sensor, waiting)?;
        Ok(Handle::open(Reports { held: None, reader, waiting, member }).cast())
    })
}

/// Takes the oldest report that waits; where there is none, waits for one until `timeout_ms` is over (0: does not wait).
///
/// `KINDS_RECEIVED`, `KINDS_NOTHING`, `KINDS_INTERRUPTED` or `KINDS_ERROR`. The report lies in shared memory, where the service
/// wrote it: read it there, or copy it. It is valid until the next call of this function, of `kinds_reports_release` or of
/// `kinds_reports_close`. Its kind and lengths are within it, whoever wrote it.
///
/// A reader that is slow finds the last 256; what it missed shows in `sequence`, within one `run`.
///
/// # Safety
/// `reports` is open, and `report` points to where the pointer belongs.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn kinds_reports_next(
    reports: *mut kinds_reports,
    timeout_ms: u32,
    report: *mut *const KindReport,
) -> i32 {
    call(KINDS_ERROR, || {
        // SAFETY: the caller says that it is open.
        let mut reports = unsafe { Handle::<Reports>::enter(reports.cast()) }?;
        // SAFETY: the caller says that it points to a place for it.
        let report =
            unsafe { report.as_mut() }.ok_or(CallError::Null { what: "the place for the report" })?;
        *report = std::ptr::null();
        let Reports { held, reader, waiting, member } = &mut *reports;
        *held = None;
        let receive = || match reader.hold()? {
            Some(report) if !report.is_sound() => Err(CallError::ReportBeyond),
            report => Ok(report),
        };
        let came = member.await_message(timeout_ms, *waiting, receive, |left| reader.wait(left))?;
        Ok(came.tell(|message| *report = &raw const **held.insert(message)))
    })
}

/// Gives the report back, before the next one is asked for. Does nothing if there is none.
///
/// # Safety
/// `reports` is open.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn kinds_reports_release(reports: *mut kinds_reports) -> i32 {
    call(KINDS_ERROR, || {
        // SAFETY: the caller says that it is open.
        unsafe { Handle::<Reports>::enter(reports.cast()) }?.held = None;
        Ok(0)
    })
}

/// The kinds of a report with those most alike taken together, until `n_kinds` are left: at least 1, and at most all.
///
/// Returns how many groups there are, in the order of their first kinds; `KINDS_ERROR` if there is no report. Each place may be
/// NULL, or has room for `KINDS_MAX_KINDS`. `probabilities`: of each group, of the frame by itself, the sum of its kinds'.
/// `filtered`: the same given all frames of the run so far. `groups`: which group each kind is of, by index.
///
/// # Safety
/// `report` is NULL or a report, and places have room.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn kinds_report_at_level(
    report: *const KindReport,
    n_kinds: u32,
    probabilities: *mut f64,
    filtered: *mut f64,
    groups: *mut u8,
) -> i32 {
    call(KINDS_ERROR, || {
        // SAFETY: the caller says that it is a report or NULL.
        let report = unsafe { report.as_ref() }.ok_or(CallError::Null { what: "the report" })?;
        let level = report.at_level(n_kinds as usize);
        // SAFETY: the caller says that each place is NULL or has room for as many as any model has.
        unsafe {
            write(level.probabilities(), probabilities);
            write(level.filtered(), filtered);
            write(level.groups(), groups);
        }
        Ok(level.probabilities().len() as i32)
    })
}

/// # Safety
/// `place` is NULL or has room for these.
unsafe fn write<T: Copy>(numbers: &[T], place: *mut T) {
    if !place.is_null() {
        // SAFETY: there is room; what a report says was copied, so that a place within the report does not matter.
        unsafe { place.copy_from(numbers.as_ptr(), numbers.len()) };
    }
}

/// Whether a service is there: 1, or 0. One that was killed is found out within seconds.
///
/// # Safety
/// `reports` is open.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn kinds_reports_is_served(reports: *mut kinds_reports) -> i32 {
    call(KINDS_ERROR, || {
        // SAFETY: the caller says that it is open.
        let reports = unsafe { Handle::<Reports>::enter(reports.cast()) }?;
        Ok(reports.reader.service().is_some().into())
    })
}

/// Closes it. NULL is nothing to close.
///
/// # Safety
/// `reports` is NULL or open, and is not used again.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn kinds_reports_close(reports: *mut kinds_reports) {
    // SAFETY: the caller's promise is the same.
    call((), || unsafe { Handle::<Reports>::close(reports.cast()) });
}
