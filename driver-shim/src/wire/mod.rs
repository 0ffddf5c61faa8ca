//! Devices that send their frames as bytes: over UDP, on standard input, or on a serial line, all in one form.
//!
//! ```text
//! link ─ bytes ─▶ Decoder ─ parts ─▶ Assembly ─▶ frame, in the loan
//! ```
//!
//! # What is sent
//!
#![doc = include_str!("../../../docs/wire.md")]
//!
//! The header has a check of its own so that its lengths can be trusted: a flipped bit in one would otherwise hold a slow
//! line's frames back until as many bytes have come as it claims. After anything that is no part, the next one is looked
//! for byte by byte.

use crate::SensorError;

mod address;
mod assembly;
mod decoder;
mod link;
mod part;
mod serial;
#[cfg(test)]
mod tests;
mod troubles;
mod wired;

pub use address::Address;
pub use part::{Part, READINGS_MAX};
pub use troubles::LeftOut;
pub use wired::{WireError, Wired};

impl From<WireError> for SensorError {
    fn from(error: WireError) -> Self {
        Self::Device(Box::new(error))
    }
}
