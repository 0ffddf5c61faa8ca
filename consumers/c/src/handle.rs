//! What C holds a pointer to: it can tell when two threads use it at once.

use std::cell::UnsafeCell;
use std::ops::{Deref, DerefMut};
use std::sync::atomic::{AtomicBool, Ordering};

use crate::call::CallError;

/// Something of C's, for one thread at a time.
pub(crate) struct Handle<T> {
    in_use: AtomicBool,
    inner: UnsafeCell<T>,
}

impl<T> Handle<T> {
    /// Hands it over to C.
    pub(crate) fn open(inner: T) -> *mut Self {
        Box::into_raw(Box::new(Self { in_use: AtomicBool::new(false), inner: UnsafeCell::new(inner) }))
    }

    /// Uses it, until the result is dropped.
    ///
    /// # Safety
    /// `handle` is NULL, or came from [`Self::open`] and has not been closed.
    pub(crate) unsafe fn enter<'a>(handle: *mut Self) -> Result<Inside<'a, T>, CallError> {
        // SAFETY: the caller says that it is there.
        let handle = unsafe { handle.as_ref() }.ok_or(CallError::Null { what: "the handle" })?;
        if handle.in_use.swap(true, Ordering::Acquire) {
            return Err(CallError::Busy);
        }
        Ok(Inside { handle })
    }

    /// Takes it back from C, and drops it. NULL is nothing to close.
    ///
    /// # Safety
    /// As for [`Self::enter`]; and it is not used again.
    pub(crate) unsafe fn close(handle: *mut Self) -> Result<(), CallError> {
        if handle.is_null() {
            return Ok(());
        }
        // SAFETY: the caller's promise is the same. Nobody leaves in between: whoever is inside would have to be another thread,
        // and then this one does not get in.
        std::mem::forget(unsafe { Self::enter(handle) }?);
        // SAFETY: it came from a box, nobody is inside and nobody will be.
        drop(unsafe { Box::from_raw(handle) });
        Ok(())
    }
}

/// The only user of a handle.
pub(crate) struct Inside<'a, T> {
    handle: &'a Handle<T>,
}

impl<T> Deref for Inside<'_, T> {
    type Target = T;

    fn deref(&self) -> &T {
        // SAFETY: `in_use` lets one in at a time, and `&self` allows no other `&mut`.
        unsafe { &*self.handle.inner.get() }
    }
}

impl<T> DerefMut for Inside<'_, T> {
    fn deref_mut(&mut self) -> &mut T {
        // SAFETY: `in_use` lets one in at a time, and `&mut self` allows no other reference.
        unsafe { &mut *self.handle.inner.get() }
    }
}

impl<T> Drop for Inside<'_, T> {
    fn drop(&mut self) {
        self.handle.in_use.store(false, Ordering::Release);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn one_at_a_time_is_inside_and_who_closes_meanwhile_is_refused() {
        let handle = Handle::open(7);
        // SAFETY: it has just been opened, and is closed once, last.
        unsafe {
            let mut inside = Handle::enter(handle).ok().unwrap();
            *inside += 1;
            assert!(matches!(Handle::enter(handle).err(), Some(CallError::Busy)));
            assert!(matches!(Handle::close(handle), Err(CallError::Busy)));
            drop(inside);
            assert_eq!(*Handle::enter(handle).ok().unwrap(), 8);
            Handle::close(handle).unwrap();
        }
    }

    #[test]
    fn nothing_cannot_be_entered_and_can_be_closed() {
        let nothing = std::ptr::null_mut::<Handle<u8>>();
        // SAFETY: NULL is allowed.
        unsafe {
            assert!(matches!(Handle::enter(nothing).err(), Some(CallError::Null { .. })));
            Handle::close(nothing).unwrap();
        }
    }
}
