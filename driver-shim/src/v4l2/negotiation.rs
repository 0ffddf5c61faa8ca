//! What is agreed on with a video device before frames come.

use std::fmt;
use std::io;
use std::path::{Path, PathBuf};

use kinds_trips::FrameLayout;
use rustix::io::Errno;

use super::abi::{
    CAN_CAPTURE, CAN_SET_RATE, CAN_STREAM, CAPTURE, Format, FormatDescription, FrameSize, ONE_SIZE,
    PixelFormat, SAYS_OF_DEVICE, StreamParameters,
};
use super::video_device::VideoDevice;

/// Formats that can be read, the first one that a device has.
const READABLE: [FourCc; 2] = [FourCc(*b"Z16 "), FourCc(*b"Y16 ")];
/// Most formats, or sizes, that are asked for: no driver keeps us here.
const LIST_MAX: u32 = 100;

/// Why a camera's frames cannot be read.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum CameraError {
    /// Another of a camera's device files, or none at all.
    #[error("{} sends no pictures; name the device file of a camera that does (v4l2-ctl --list-devices shows them)", path.display())]
    NoPictures {
        /// Its device file.
        path: PathBuf,
    },
    /// Pictures that are no counts.
    #[error("{} sends {}; only Z16 and Y16 can be read (a camera may have another device file for depth)", path.display(), listed(formats))]
    Format {
        /// Its device file.
        path: PathBuf,
        /// All formats that it has.
        formats: Vec<String>,
    },
    /// Another size.
    #[error("{} has no frames of {rows} × {columns} readings; it has {}", path.display(), listed(sizes))]
    Size {
        /// Its device file.
        path: PathBuf,
        /// Rows asked for.
        rows: u32,
        /// Columns asked for.
        columns: u32,
        /// Sizes that it has, rows first.
        sizes: Vec<String>,
    },
    /// It is not there, or the system does not let us: this may change.
    #[error("{} cannot be read: {}", path.display(), why(error))]
    Io {
        /// Its device file.
        path: PathBuf,
        /// What the system says.
        error: io::Error,
    },
}

impl CameraError {
    /// Whether it may be over without anybody changing what is asked for.
    pub(crate) fn may_pass(&self) -> bool {
        matches!(self, Self::Io { .. })
    }
}

fn listed(items: &[String]) -> String {
    if items.is_empty() { "none".to_string() } else { items.join(", ") }
}

/// What the system says of a device file, in words that help.
fn why(error: &io::Error) -> String {
    match Errno::from_io_error(error) {
        Some(Errno::NOENT | Errno::NODEV | Errno::NXIO) => "it is not there".to_string(),
        Some(Errno::ACCESS | Errno::PERM) => "this user may not; it must be in the group video".to_string(),
        Some(Errno::BUSY) => "another program reads it".to_string(),
        _ => error.to_string(),
    }
}

/// What a pixel is, in four letters.
#[derive(Clone, Copy, PartialEq, Eq)]
struct FourCc([u8; 4]);

impl FourCc {
    fn from_number(number: u32) -> Self {
        Self(number.to_le_bytes())
    }

    fn number(self) -> u32 {
        u32::from_le_bytes(self.0)
    }
}

impl fmt::Display for FourCc {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(String::from_utf8_lossy(&self.0).trim_end())
    }
}

/// What was agreed on.
pub(crate) struct Agreement {
    /// Bytes from a row to the next.
    pub(crate) stride: usize,
    /// What else a person should know.
    pub(crate) remark: Option<String>,
}

/// Sets format, size and, if one is given, rate.
pub(crate) fn negotiate(
    device: &mut dyn VideoDevice,
    path: &Path,
    layout: FrameLayout,
    rate_hz: Option<u32>,
) -> Result<Agreement, CameraError> {
    let failed = |error| CameraError::Io { path: path.to_path_buf(), error };
    if !sends_pictures(device).map_err(failed)? {
        return Err(CameraError::NoPictures { path: path.to_path_buf() });
    }
    let formats = formats(device).map_err(failed)?;
    let refused = || CameraError::Format {
        path: path.to_path_buf(),
        formats: formats.iter().map(FourCc::to_string).collect(),
    };
    let format = READABLE.into_iter().find(|readable| formats.contains(readable)).ok_or_else(refused)?;
    let FrameLayout { rows, columns, .. } = layout;
    let pixels =
        PixelFormat { width: columns, height: rows, pixel_format: format.number(), ..PixelFormat::default() };
    let wanted = Format { buffer_type: CAPTURE, pixels, ..Format::default() };
    let pixels = device.set_format(wanted).map_err(failed)?.pixels;
    if pixels.pixel_format != format.number() {
        return Err(refused());
    }
    if (pixels.height, pixels.width) != (rows, columns) {
        let mut sizes = sizes(device, format).map_err(failed)?;
        if sizes.is_empty() {
            sizes.push(format!("{} × {}", pixels.height, pixels.width));
        }
        return Err(CameraError::Size { path: path.to_path_buf(), rows, columns, sizes });
    }
    let remark = match rate_hz {
        Some(rate_hz) => set_rate(device, path, rate_hz).map_err(failed)?,
        None => None,
    };
    let stride = (pixels.bytes_per_line as usize).max(columns as usize * 2);
    Ok(Agreement { stride, remark })
}

fn sends_pictures(device: &mut dyn VideoDevice) -> io::Result<bool> {
    let capability = match device.capability() {
        Err(error) if is_no_such_call(&error) => return Ok(false),
        capability => capability?,
    };
    let can = match capability.capabilities & SAYS_OF_DEVICE {
        0 => capability.capabilities,
        _ => capability.device_capabilities,
    };
    Ok(can & CAN_CAPTURE != 0 && can & CAN_STREAM != 0)
}

fn formats(device: &mut dyn VideoDevice) -> io::Result<Vec<FourCc>> {
    let format_at = |index| {
        device.format(FormatDescription { index, buffer_type: CAPTURE, ..FormatDescription::default() })
    };
    let formats = all(format_at)?;
    Ok(formats.into_iter().map(|format| FourCc::from_number(format.pixel_format)).collect())
}

/// Sizes in words, rows first as everywhere here.
fn sizes(device: &mut dyn VideoDevice, format: FourCc) -> io::Result<Vec<String>> {
    let size_at =
        |index| device.size(FrameSize { index, pixel_format: format.number(), ..FrameSize::default() });
    let words = |FrameSize {
                     size_type,
                     size: [width, height, width_step, height_min, height_max, height_step],
                     ..
                 }| {
        if size_type == ONE_SIZE {
            return format!("{height} × {width}");
        }
        // Of a range, least, most and step: the height of one size is the most of the width here.
        let (width_min, width_max) = (width, height);
        format!(
            "{height_min} to {height_max} × {width_min} to {width_max}, in steps of {height_step} × {width_step}"
        )
    };
    Ok(all(size_at)?.into_iter().map(words).collect())
}

/// All that a driver lists, up to where it has no more.
fn all<T>(mut at: impl FnMut(u32) -> io::Result<T>) -> io::Result<Vec<T>> {
    let mut items = Vec::new();
    for index in 0..LIST_MAX {
        match at(index) {
            Err(error) if is_no_such_call(&error) => break,
            item => items.push(item?),
        }
    }
    Ok(items)
}

/// Returns what there is to say if frames will not come at this rate.
fn set_rate(device: &mut dyn VideoDevice, path: &Path, rate_hz: u32) -> io::Result<Option<String>> {
    let wanted = StreamParameters {
        buffer_type: CAPTURE,
        numerator: 1,
        denominator: rate_hz,
        ..StreamParameters::default()
    };
    let given = match device.set_parameters(wanted) {
        Err(error) if is_no_such_call(&error) => None,
        given => Some(given?).filter(|given| given.capability & CAN_SET_RATE != 0 && given.numerator > 0),
    };
    let given_hz = given.map(|given| f64::from(given.denominator) / f64::from(given.numerator));
    // Drivers count in units of their own, such as 333333 of 100 ns.
    let is_as_wanted = given_hz.is_some_and(|given_hz| (given_hz / f64::from(rate_hz) - 1.0).abs() < 0.01);
    let sent =
        given_hz.map_or("as many as its driver likes".to_string(), |given_hz| format!("{given_hz:.1}"));
    Ok((!is_as_wanted)
        .then(|| format!("{} does not send {rate_hz} frames a second, but {sent}", path.display())))
}

/// There is no such call for this device, or no such item in its list.
fn is_no_such_call(error: &io::Error) -> bool {
    matches!(Errno::from_io_error(error), Some(Errno::INVAL | Errno::NOTTY))
}
