//! A handle's membership of its domain, and waiting for messages as a member.

use std::ffi::c_char;
use std::path::Path;
use std::time::{Duration, Instant};

use kinds_messages::{ChannelError, Domain, Node, SensorName, Waiting, WakeUp};

use crate::call::{CallError, text};

/// The call could not do it: see `kinds_last_error`.
pub const KINDS_ERROR: i32 = -1;
/// Nothing came until the timeout.
pub const KINDS_NOTHING: i32 = 0;
/// There it is.
pub const KINDS_RECEIVED: i32 = 1;
/// A signal came while waiting: look at the flag that your handler sets, and go on if it is not. A program that was stopped and
/// continued is told so too.
pub const KINDS_INTERRUPTED: i32 = 2;

/// Sleep until there is something.
pub const KINDS_BY_EVENT: u32 = 0;
/// Look again and again instead of sleeping: quicker by the wake-up, and takes one processor core while it waits.
pub const KINDS_POLLING: u32 = 1;

/// How often what killed programs left is looked for: their places are not free, and nobody learns that they are gone, until
/// somebody does.
const CLEAN_UP_PERIOD: Duration = Duration::from_secs(2);

/// A member of a domain: one for each handle, since what shares a member must stay on one thread.
pub(crate) struct Member {
    pub(crate) node: Node,
    last_clean_up: Instant,
}

impl Member {
    /// Joins the domain of that folder, of the environment if NULL, or the default one.
    ///
    /// # Safety
    /// As for [`text`].
    pub(crate) unsafe fn join(folder: *const c_char) -> Result<Self, CallError> {
        let domain = match folder.is_null() {
            true => Domain::of_environment(),
            // SAFETY: the caller's promise is the same.
            false => Domain::in_folder(Path::new(unsafe { text(folder, "the domain") }?)),
        };
        Ok(Self { node: Node::open(&domain, "consumer")?, last_clean_up: Instant::now() })
    }

    pub(crate) fn clean_up_now_and_then(&mut self) {
        if self.last_clean_up.elapsed() >= CLEAN_UP_PERIOD {
            self.node.clean_up_dead_nodes();
            self.last_clean_up = Instant::now();
        }
    }

    /// Takes a message, for which it waits where there is none until the time is over or a signal comes.
    pub(crate) fn await_message<T>(
        &mut self,
        timeout_ms: u32,
        waiting: Waiting,
        mut receive: impl FnMut() -> Result<Option<T>, CallError>,
        wait: impl Fn(Duration) -> Result<WakeUp, ChannelError>,
    ) -> Result<Came<T>, CallError> {
        let deadline = Instant::now() + Duration::from_millis(timeout_ms.into());
        loop {
            if let Some(message) = receive()? {
                return Ok(Came::Message(message));
            }
            let left = deadline.saturating_duration_since(Instant::now());
            if left.is_zero() {
                return Ok(Came::Nothing);
            }
            self.clean_up_now_and_then();
            match waiting {
                Waiting::Polling => std::hint::spin_loop(),
                Waiting::ByEvent if wait(left.min(CLEAN_UP_PERIOD))? == WakeUp::Interrupted => {
                    return Ok(Came::Interrupted);
                }
                Waiting::ByEvent => {}
            }
        }
    }
}

/// What waiting came to.
pub(crate) enum Came<T> {
    Message(T),
    Nothing,
    Interrupted,
}

impl<T> Came<T> {
    /// What C is told of it, after a message was handed over.
    pub(crate) fn tell(self, hand_over: impl FnOnce(T)) -> i32 {
        match self {
            Self::Message(message) => {
                hand_over(message);
                KINDS_RECEIVED
            }
            Self::Nothing => KINDS_NOTHING,
            Self::Interrupted => KINDS_INTERRUPTED,
        }
    }
}

/// The name of a sensor that C hands over.
///
/// # Safety
/// As for [`text`].
pub(crate) unsafe fn sensor_name(sensor: *const c_char) -> Result<SensorName, CallError> {
    // SAFETY: the caller's promise is the same.
    Ok(unsafe { text(sensor, "the sensor's name") }?.parse()?)
}

pub(crate) fn waiting_of(waiting: u32) -> Result<Waiting, CallError> {
    match waiting {
        KINDS_BY_EVENT => Ok(Waiting::ByEvent),
        KINDS_POLLING => Ok(Waiting::Polling),
        found => Err(CallError::Waiting { found }),
    }
}
