//! Depth cameras that Linux knows as video devices (Video4Linux), read where their driver writes.
//!
//! ```text
//! driver ─ mapped buffer ─▶ Stream ─ counts, copied once ─▶ the loan
//! ```
//!
//! Formats are those of one unsigned count of 16 bits a pixel: Z16, which is depth, or else Y16. What a count stands for the device does
//! not say; it comes with the layout. `video_device` has the calls of the system, so that all that is decided by them is tested
//! against a camera in memory; `kernel` makes them.

use crate::SensorError;

mod abi;
mod address;
mod depth_camera;
#[cfg(test)]
mod fake_camera;
mod kernel;
mod negotiation;
mod numbering;
mod stream;
#[cfg(test)]
mod tests;
mod video_device;

pub use address::CameraAddress;
pub use depth_camera::{DepthCamera, LeftOut};
pub use negotiation::CameraError;

impl From<CameraError> for SensorError {
    fn from(error: CameraError) -> Self {
        Self::Device(Box::new(error))
    }
}
