//! What frames of a device can be at all.

use kinds_trips::FrameLayout;

/// Most readings of a device's frame.
const FRAME_READINGS_MAX: u64 = 1 << 24;

/// Frames that no device has.
#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum LayoutError {
    /// No frame of it could be.
    #[error(
        "frames of {rows} × {columns} readings cannot be read; there must be 1 to {FRAME_READINGS_MAX} of them"
    )]
    Size {
        /// Rows asked for.
        rows: u32,
        /// Columns asked for.
        columns: u32,
    },
    /// No unit that could be: some are sent in whole nanometres, in 32 bits.
    #[error("one count cannot stand for {metres_per_count} m; it must be between 0.000000001 and 4 m")]
    Unit {
        /// As asked for.
        metres_per_count: f64,
    },
}

/// Refuses what no device has.
pub(crate) fn check(layout: FrameLayout) -> Result<(), LayoutError> {
    let FrameLayout { rows, columns, metres_per_count } = layout;
    if !(1..=FRAME_READINGS_MAX).contains(&(u64::from(rows) * u64::from(columns))) {
        return Err(LayoutError::Size { rows, columns });
    }
    if !(0.5e-9..=4.0).contains(&metres_per_count) {
        return Err(LayoutError::Unit { metres_per_count });
    }
    Ok(())
}
