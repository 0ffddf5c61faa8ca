//! Where a camera is, as a person writes it.

use std::fmt;
use std::path::PathBuf;

const RATE_HZ_MAX: u32 = 1000;

/// A camera, and how it is to run.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct CameraAddress {
    /// Its device file.
    pub path: PathBuf,
    /// Frames a second; without it, as many as its driver likes.
    pub rate_hz: Option<u32>,
}

impl CameraAddress {
    /// From what follows `v4l2://`.
    pub(crate) fn parse(text: &str) -> Option<Self> {
        let (path, rate_hz) = match text.split_once("?rate_hz=") {
            Some((path, rate)) => {
                (path, Some(rate.parse().ok().filter(|rate| (1..=RATE_HZ_MAX).contains(rate))?))
            }
            None => (text, None),
        };
        (path.starts_with('/') && !path.contains('?')).then(|| Self { path: path.into(), rate_hz })
    }
}

impl fmt::Display for CameraAddress {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "v4l2://{}", self.path.display())?;
        self.rate_hz.map_or(Ok(()), |rate_hz| write!(f, "?rate_hz={rate_hz}"))
    }
}
