//! Where a device is, as a person writes it.

use std::fmt;
use std::str::FromStr;

use crate::v4l2::CameraAddress;
use crate::wire;

/// Where frames come from.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum DeviceAddress {
    /// What sends them as bytes.
    Wire(wire::Address),
    /// A depth camera.
    Camera(CameraAddress),
}

/// A text that names no device.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error(
    "device \"{text}\" is none of udp://ADDRESS:PORT (such as udp://127.0.0.1:4000), stdin, serial:///dev/NAME or \
     serial:///dev/NAME?baud=115200, and v4l2:///dev/NAME or v4l2:///dev/NAME?rate_hz=30"
)]
pub struct AddressError {
    /// The text as given.
    pub text: String,
}

impl FromStr for DeviceAddress {
    type Err = AddressError;

    fn from_str(text: &str) -> Result<Self, AddressError> {
        match text.strip_prefix("v4l2://") {
            None => text.parse().map(Self::Wire),
            Some(camera) => match CameraAddress::parse(camera) {
                Some(camera) => Ok(Self::Camera(camera)),
                None => Err(AddressError { text: text.to_owned() }),
            },
        }
    }
}

impl fmt::Display for DeviceAddress {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Wire(address) => address.fmt(f),
            Self::Camera(address) => address.fmt(f),
        }
    }
}
