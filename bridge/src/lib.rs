//! Kinds of one robot on another machine: what a sensor's kinds channel carries here, over a network, into the channel of that
//! name there.
//!
//! ```text
//! robot:     service ─▶ [kinds channel] ─▶ NearEnd ═══ TCP ═══▶ FarEnd ─▶ [kinds channel] ─▶ consumers     :another machine
//! ```
//!
//! The *near end* is one more reader of the robot's channel, so that nobody there waits for it; the *far end* stands in the
//! place of the service on its own machine, so that consumers there are those of a robot. Reports go as they are. Either end
//! may come first, leave, be killed and come back, and several far ends may share a near one.
//!
//! A link that takes less than there is loses the oldest reports first: what waits at the near end is at most
//! [`AGE_MAX`] old, but for the last report of all, and the newest are sent whatever was lost before them. The far end counts
//! what is missing by the reports' sequence, passes no report on twice, and refuses what is no report of its own version.
//!
//! Only this crate knows zenoh, which carries the reports (`link.rs`).
#![forbid(unsafe_code)]

mod arrivals;
mod endpoint;
mod error;
mod far;
mod held;
mod link;
mod near;
mod outbox;
#[cfg(test)]
mod tests;

pub use arrivals::Arrived;
pub use endpoint::{Endpoint, EndpointError};
pub use error::BridgeError;
pub use far::FarEnd;
pub use near::{NearEnd, Sent};
pub use outbox::AGE_MAX;

use std::time::Duration;

/// Longest time between two looks at the stop flag, and at who has come and gone.
const TICK: Duration = Duration::from_millis(50);

/// How often it is told that a loop turns, and what killed programs left is looked for.
const TURN_PERIOD: Duration = Duration::from_secs(1);
