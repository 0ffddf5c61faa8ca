//! Sensors to the frames channel: the trait [`Sensor`], one module per device, and the [`Shim`] that publishes one, or [`publish()`] alone.
//!
//! ```text
//! device ─ Sensor::read, into a loan ─▶ Shim ─▶ [frames channel]
//! ```
//!
//! A device writes its counts where readers will read them. It decides when a frame is there; the shim numbers frames,
//! sends them, and looks after who comes and goes. How far it waits for others is its [`Flow`]: a robot's sensor waits
//! for nobody, a replayed trip can wait for every report.
//!
//! Devices: [`Paced`] frames of a [`Source`], such as the [`Replay`] of a recorded trip or a
//! [`simulated`] robot; whatever sends frames as bytes ([`wire::Wired`]); depth cameras ([`v4l2::DepthCamera`]); other sensors
//! of the robot, joined ([`joined::Joined`]). [`Faulty`] wraps any of them and spoils some of its frames, to see what the others make of it.

mod address;
mod faults;
mod faulty;
mod flow;
pub mod joined;
mod layout;
mod notice;
mod pace;
mod paced;
mod publish;
mod sensor;
mod shim;
pub mod simulated;
#[cfg(test)]
mod testing;
#[cfg(test)]
mod tests;
pub mod v4l2;
pub mod wire;

// What a device of one's own is written with.
pub use kinds_messages::{Command, Pose};
pub use kinds_trips::{FrameLayout, Stamp};

pub use address::{AddressError, DeviceAddress};
pub use faults::{Faults, FaultsError};
pub use faulty::{Faulty, Injected};
pub use flow::{FOLLOW_WINDOW, Flow};
pub use layout::LayoutError;
pub use notice::Notice;
pub use pace::{Pace, PaceError, Speed};
pub use paced::{Paced, Replay, Source};
pub use publish::publish;
pub use sensor::{Capture, NumberedFrame, Reading, Sensor, SensorError};
pub use shim::{Shim, ShimError, Summary};
