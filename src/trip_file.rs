//! A sensor's frames as a trip: which topics they and what is known of them go to.

use std::io;
use std::path::Path;
use std::sync::Arc;
use std::thread::JoinHandle;

use kinds_driver_shim::Capture;
use kinds_messages::{Command, Pose};
use kinds_trips::{FrameLayout, Image, ImageEncoding, Stamp, TripWriteError, TripWriter, WriterOptions};

/// Topic of the true pose, where there is one. Odometry is what a trip is evaluated by unless this is named.
pub(crate) const TRUE_POSES: &str = "/ground_truth";

/// A trip being written. Dropped before its end, it leaves nothing behind.
pub(crate) struct TripFile {
    writer: TripWriter,
    /// Waits until the disk has what was flushed, so that whoever writes need not.
    syncing: Option<JoinHandle<io::Result<()>>>,
}

impl TripFile {
    pub(crate) fn create(path: &Path) -> Result<Self, TripWriteError> {
        Ok(Self { writer: TripWriter::create(path, &WriterOptions::default())?, syncing: None })
    }

    /// Adds a frame as a depth image, which keeps counts as they are: a ring is an image of few rows.
    ///
    /// * `counts` — `(rows, columns)` as the layout has them
    pub(crate) fn add_frame(
        &mut self,
        layout: FrameLayout,
        counts: &[u16],
        capture: &Capture,
    ) -> Result<(), TripWriteError> {
        let at = capture.captured;
        // Millimetres are whole numbers in a message; every other unit goes as metres.
        let is_millimetre = layout.metres_per_count == 0.001;
        let encoding = if is_millimetre { ImageEncoding::Millimetres } else { ImageEncoding::Metres };
        if let Some(pose) = capture.pose {
            self.writer.write_odometry("/odom", at, &in_trip(pose))?;
        }
        if let Some(pose) = capture.true_pose {
            self.writer.write_pose(TRUE_POSES, at, &in_trip(pose))?;
        }
        if let Some(command) = capture.command {
            let Command { forward_m_s, turn_rad_s } = command;
            self.writer.write_command("/cmd_vel", at, &kinds_trips::Command { forward_m_s, turn_rad_s })?;
        }
        let image = Image { counts, layout, encoding, big_endian: false, row_padding_bytes: 0 };
        self.writer.write_image("/frames", at, &image)
    }

    /// Adds the probability of each kind at a frame's time.
    pub(crate) fn add_kinds(&mut self, at: Stamp, probabilities: &[f64]) -> Result<(), TripWriteError> {
        self.writer.write_numbers("/kinds", at, "kind", probabilities)
    }

    /// Adds how many frames of the trip are missing so far: on the way here, and for want of room.
    pub(crate) fn add_losses(
        &mut self,
        at: Stamp,
        n_lost: u64,
        n_left_out: u64,
    ) -> Result<(), TripWriteError> {
        self.writer.write_numbers(
            "/lost",
            at,
            "lost, left out for want of room",
            &[n_lost as f64, n_left_out as f64],
        )
    }

    /// Bytes that the system has been handed.
    pub(crate) fn n_bytes(&self) -> io::Result<u64> {
        Ok(self.writer.file().metadata()?.len())
    }

    /// Hands everything to the system: what a crash of this program from here on cannot take.
    pub(crate) fn flush(&mut self) -> Result<(), TripWriteError> {
        self.writer.flush()
    }

    /// Has what was flushed brought to the disk, beside whatever is done next: a power cut then cannot take it either.
    ///
    /// A slow disk that is still at it is left alone until the next time.
    ///
    /// # Errors
    ///
    /// The disk failed the last time.
    pub(crate) fn sync(&mut self) -> io::Result<()> {
        match self.syncing.take() {
            Some(syncing) if !syncing.is_finished() => self.syncing = Some(syncing),
            ended => {
                ended.map_or(Ok(()), |syncing| syncing.join().expect("it does nothing that panics"))?;
                let file = Arc::clone(self.writer.file());
                self.syncing = Some(std::thread::Builder::new().spawn(move || file.sync_data())?);
            }
        }
        Ok(())
    }

    /// Closes the trip and gives it its name.
    pub(crate) fn finish(self) -> Result<(), TripWriteError> {
        self.writer.finish()
    }
}

fn in_trip(pose: Pose) -> kinds_trips::Pose {
    kinds_trips::Pose { x_m: pose.x_m, y_m: pose.y_m, yaw_rad: pose.yaw_rad }
}
