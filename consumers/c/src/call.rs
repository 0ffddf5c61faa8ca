//! What every call from C has in common: its errors become words, and panics stay here.

use std::any::Any;
use std::cell::RefCell;
use std::ffi::{CStr, CString, c_char};
use std::panic::{AssertUnwindSafe, catch_unwind};

use kinds_messages::{ChannelError, FrameHeader, SensorNameError};

use crate::publisher::N_READINGS_MAX;

/// Why a call could not do what it was asked for.
#[derive(Debug, thiserror::Error)]
pub(crate) enum CallError {
    #[error(transparent)]
    Channel(#[from] ChannelError),
    #[error(transparent)]
    Name(#[from] SensorNameError),
    #[error("{what} is NULL; give one")]
    Null { what: &'static str },
    #[error("{what} is not text in UTF-8")]
    NotText { what: &'static str },
    #[error("waiting is {found}; give 0 (by event) or 1 (polling)")]
    Waiting { found: u32 },
    #[error(
        "a sensor of {rows} × {columns} readings of {metres_per_count} m each count cannot be; all must be above 0, and the \
         readings at most {N_READINGS_MAX}"
    )]
    Layout { rows: u32, columns: u32, metres_per_count: f64 },
    #[error("the handle is in use by another thread; let one thread at a time use it, or open another one")]
    Busy,
    #[error(
        "a service sent a report whose kind or lengths reach beyond its end; run all programs in the same version"
    )]
    ReportBeyond,
    #[error(
        "a driver shim sent a frame of layout version {found}, this program reads version {}; run all programs in the same \
         version",
        FrameHeader::VERSION
    )]
    FrameVersion { found: u32 },
    #[error(
        "a driver shim sent a frame of {n_readings} readings that says it has {rows} × {columns}; it is at fault"
    )]
    FrameContradiction { n_readings: usize, rows: u32, columns: u32 },
    #[error("the frame was not received through this handle, or is released already")]
    NotHeld,
    #[error("the frame was not borrowed through this handle, or is sent or given back already")]
    NotLent,
}

/// Runs a call. If it cannot, or panics, remembers why and returns what says so.
pub(crate) fn call<T>(failed: T, body: impl FnOnce() -> Result<T, CallError>) -> T {
    let reason = match catch_unwind(AssertUnwindSafe(body)) {
        Ok(Ok(done)) => return done,
        Ok(Err(error)) => error.to_string(),
        Err(panic) => format!("a bug in natural kinds: {}", words_of(&*panic)),
    };
    // At a thread's very end there is nowhere to remember it, and nobody to ask.
    let _ = LAST_ERROR.try_with(|last| *last.borrow_mut() = c_text(&reason));
    failed
}

fn words_of(panic: &(dyn Any + Send)) -> &str {
    let text = panic.downcast_ref::<&str>().copied();
    text.or_else(|| panic.downcast_ref::<String>().map(String::as_str)).unwrap_or("it panicked")
}

fn c_text(text: &str) -> CString {
    CString::new(text.replace('\0', "␀")).expect("zeros have been replaced")
}

/// Reads a text that C hands over.
///
/// # Safety
/// `text` is NULL or ends with a zero, and stays as it is for as long as the result is used.
pub(crate) unsafe fn text<'a>(text: *const c_char, what: &'static str) -> Result<&'a str, CallError> {
    if text.is_null() {
        return Err(CallError::Null { what });
    }
    // SAFETY: the caller says that it ends with a zero and stays.
    let text = unsafe { CStr::from_ptr(text) };
    text.to_str().map_err(|_| CallError::NotText { what })
}

thread_local! {
    static LAST_ERROR: RefCell<CString> = RefCell::default();
}

/// Why the last call that failed on this thread did so: a sentence in UTF-8. Empty if none has failed.
///
/// Valid until the next call that fails on this thread.
#[unsafe(no_mangle)]
pub extern "C" fn kinds_last_error() -> *const c_char {
    let text = LAST_ERROR.try_with(|last| last.borrow().as_ptr());
    text.unwrap_or(c"".as_ptr())
}

/// The version of this library, such as "0.1.0". Programs on one machine should all have the same.
#[unsafe(no_mangle)]
pub extern "C" fn kinds_version() -> *const c_char {
    const VERSION: &CStr =
        match CStr::from_bytes_with_nul(concat!(env!("CARGO_PKG_VERSION"), "\0").as_bytes()) {
            Ok(version) => version,
            Err(_) => panic!("a version has no zeros"),
        };
    VERSION.as_ptr()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn last_error() -> String {
        // SAFETY: it ends with a zero, and no call fails meanwhile.
        unsafe { CStr::from_ptr(kinds_last_error()) }.to_str().unwrap().to_owned()
    }

    #[test]
    fn errors_and_panics_become_the_words_of_their_thread_and_nothing_else() {
        assert_eq!(call(-1, || Ok(7)), 7);
        assert_eq!(last_error(), "");
        assert_eq!(call(-1, || Err(CallError::NotHeld)), -1);
        assert_eq!(last_error(), "the frame was not received through this handle, or is released already");
        std::thread::spawn(|| assert_eq!(last_error(), "")).join().unwrap();
        assert_eq!(call(-1, || panic!("two and two are {}", 5)), -1);
        assert_eq!(last_error(), "a bug in natural kinds: two and two are 5");
        assert_eq!(call(-1, || Ok(0)), 0);
        assert_eq!(last_error(), "a bug in natural kinds: two and two are 5");
    }
}
