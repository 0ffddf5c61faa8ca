//! From the frames channel through a model to the kinds channel.
//!
//! ```text
//! [frames channel] ─ Frame, where it lies ─▶ Classify ─ KindReport ─▶ [kinds channel]
//! ```
//!
//! One [`Service`] serves one sensor with one model, in one thread. Every frame that it gets is classified at most once
//! and reported at once, in order. It reads frames where they lie in shared memory and copies none; per frame, the
//! transport's loan for the report is the only allocation, and we lock, log and open nothing.
//!
//! Once a second it says how it fares on a third channel. Another model is opened beside the one in use, on a thread of its
//! own, and taken into use between two frames.
//!
//! It waits by event; [`Waiting::Polling`](kinds_messages::Waiting::Polling) spares the wake-up and costs one core.
//!
//! It outlives its driver shim: it waits, says so once, and goes on with the next run. Frames that are not for the model
//! are refused in words, once, and the service stays up.
#![forbid(unsafe_code)]

mod classify;
mod conditions;
mod drift;
mod health;
mod refusal;
mod reload;
mod sequence;
mod service;
#[cfg(test)]
mod tests;

pub use classify::Classify;
pub use drift::DriftWindow;
pub use refusal::Refusal;
pub use reload::OpenModel;
pub use service::{Service, Summary};
