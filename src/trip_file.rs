//! A sensor's frames as a trip: which topics they and what is known of them go to.

use std::io;
use std::path::Path;
use std::sync::Arc;
use std::thread::JoinHandle;

use kinds_driver_shim::Capture;
use kinds_messages::{Command, HealthReport, Pose, SensorName};
use kinds_model::ModelId;
use kinds_trips::{FrameLayout, Image, ImageEncoding, Stamp, TripWriteError, TripWriter, WriterOptions};

/// Topic of the true pose, where there is one. Odometry is what a trip is evaluated by unless this is named.
pub(crate) const TRUE_POSES: &str = "/ground_truth";

/// Where what is known of a sensor goes.
pub(crate) struct Topics {
    frames: String,
    poses: String,
    true_poses: String,
    commands: String,
    kinds: String,
    lost: String,
    health: String,
}

impl Topics {
    /// Of a trip of one sensor: `/frames`.
    pub(crate) fn of_the_only_sensor() -> Self {
        Self::within("")
    }

    /// Of one of several sensors: `/crunch/ring/frames`. ROS has no dots and dashes in the names of topics.
    pub(crate) fn of(sensor: &SensorName) -> Self {
        Self::within(&format!("/{}", sensor.as_str().replace(['.', '-'], "_")))
    }

    fn within(namespace: &str) -> Self {
        let topic = |name: &str| format!("{namespace}{name}");
        Self {
            frames: topic("/frames"),
            poses: topic("/odom"),
            true_poses: topic(TRUE_POSES),
            commands: topic("/cmd_vel"),
            kinds: topic("/kinds"),
            lost: topic("/lost"),
            health: topic("/health"),
        }
    }

    pub(crate) fn frames(&self) -> &str {
        &self.frames
    }
}

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
        topics: &Topics,
        layout: FrameLayout,
        counts: &[u16],
        capture: &Capture,
    ) -> Result<(), TripWriteError> {
        let at = capture.captured;
        // Millimetres are whole numbers in a message; every other unit goes as metres.
        let is_millimetre = layout.metres_per_count == 0.001;
        let encoding = if is_millimetre { ImageEncoding::Millimetres } else { ImageEncoding::Metres };
        if let Some(pose) = capture.pose {
            self.writer.write_odometry(&topics.poses, at, &in_trip(pose))?;
        }
        if let Some(pose) = capture.true_pose {
            self.writer.write_pose(&topics.true_poses, at, &in_trip(pose))?;
        }
        if let Some(command) = capture.command {
            let Command { forward_m_s, turn_rad_s } = command;
            let command = kinds_trips::Command { forward_m_s, turn_rad_s };
            self.writer.write_command(&topics.commands, at, &command)?;
        }
        let image = Image { counts, layout, encoding, big_endian: false, row_padding_bytes: 0 };
        self.writer.write_image(&topics.frames, at, &image)
    }

    /// Adds the probability of each kind at a frame's time.
    pub(crate) fn add_kinds(
        &mut self,
        topics: &Topics,
        at: Stamp,
        probabilities: &[f64],
    ) -> Result<(), TripWriteError> {
        self.writer.write_numbers(&topics.kinds, at, "kind", probabilities)
    }

    /// Adds how the sensor's service fares: counters since it started, and latencies over its last interval.
    pub(crate) fn add_health(
        &mut self,
        topics: &Topics,
        at: Stamp,
        health: &HealthReport,
    ) -> Result<(), TripWriteError> {
        let latency = health.last_interval.sent_to_reported;
        let values = [
            ("model", ModelId(health.model_id).to_string()),
            ("uptime_s", format!("{:.3}", health.uptime_ns as f64 / 1e9)),
            ("n_frames", health.n_frames.to_string()),
            ("n_classified", health.n_classified.to_string()),
            ("n_invalid", health.n_invalid.to_string()),
            ("n_novel", health.n_novel.to_string()),
            ("n_lost", health.n_lost.to_string()),
            ("n_repeated", health.n_repeated.to_string()),
            ("n_late", health.n_late.to_string()),
            ("n_refused", health.n_refused.to_string()),
            ("n_reloads", health.n_reloads.to_string()),
            ("n_peers_lost", health.n_peers_lost.to_string()),
            ("latency_p50_us", format!("{:.1}", latency.p50_ns as f64 / 1e3)),
            ("latency_p999_us", format!("{:.1}", latency.p999_ns as f64 / 1e3)),
        ];
        self.writer.write_diagnostics(&topics.health, at, "kinds-serve", health.has_shim(), &values)
    }

    /// Adds how many frames of the trip are missing so far: on the way here, and for want of room.
    pub(crate) fn add_losses(
        &mut self,
        topics: &Topics,
        at: Stamp,
        n_lost: u64,
        n_left_out: u64,
    ) -> Result<(), TripWriteError> {
        self.writer.write_numbers(
            &topics.lost,
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
