//! Made-up trips: a ring of ranges in a world that changes smoothly along a loop, which is driven twice.

use std::collections::BTreeMap;
use std::f64::consts::TAU;
use std::path::Path;
use std::sync::Arc;

use bytes::Bytes;
use kinds_messages::{KindReport, ReportStatus};
use kinds_model::{Classification, Classifier, Filter, Model, Status};
use kinds_trips::{
    Command, Compression, FrameInfo, FrameLayout, Image, ImageEncoding, Pose, Scan, Selection, Stamp,
    TripReader, TripWriter, WriterOptions,
};

const METRES_PER_COUNT: f64 = 0.001;
const FRAME_PERIOD_NS: i64 = 100_000_000;
const START_NS: i64 = 1_750_000_000_000_000_000;

/// A trip to be written. Begin with [`Trip::FIRST`] and change what matters.
#[derive(Clone)]
pub(crate) struct Trip<'a> {
    pub(crate) n_frames: usize,
    pub(crate) n_readings: usize,
    /// Of the measurement noise, so that no two trips are the same.
    pub(crate) noise: u64,
    /// Where the loop's middle is.
    pub(crate) x_m: f64,
    /// Frames topics. Each gets every frame.
    pub(crate) frames_topics: &'a [&'a str],
    /// Poses topics. Each gets every pose.
    pub(crate) poses_topics: &'a [&'a str],
    /// What the robot was told at each place of the loop, 0 to 1, where somebody told it.
    pub(crate) command: fn(f64) -> Option<Command>,
    /// Frames of which no reading is valid.
    pub(crate) invalid_frames: &'a [usize],
    /// Share of the readings that are not valid, here and there.
    pub(crate) share_dropped: f64,
    /// Frames from this one on have half the readings.
    pub(crate) halved_from: usize,
    /// The robot stands still, and nothing is noisy.
    pub(crate) is_constant: bool,
    /// A row of a depth image instead of a scan: what is invalid is 0 instead of not a number.
    pub(crate) as_images: bool,
    /// Small chunks, no index: what is left of it can be read when it is cut off.
    pub(crate) in_small_chunks: bool,
}

impl Trip<'static> {
    pub(crate) const FIRST: Self = Self {
        n_frames: 160,
        n_readings: 16,
        noise: 1,
        x_m: 0.0,
        frames_topics: &["/ring"],
        poses_topics: &["/odom"],
        command: |_| None,
        invalid_frames: &[],
        share_dropped: 0.0,
        halved_from: usize::MAX,
        is_constant: false,
        as_images: false,
        in_small_chunks: false,
    };

    /// The same places, at another pace.
    pub(crate) const SECOND: Self = Self { n_frames: 130, noise: 2, ..Self::FIRST };
}

impl Trip<'_> {
    pub(crate) fn write(&self, path: &Path) {
        let chunk_bytes = if self.in_small_chunks { 2048 } else { 1 << 20 };
        let options = WriterOptions {
            chunk_bytes: Some(chunk_bytes),
            indexed: !self.in_small_chunks,
            compression: Compression::Zstd,
        };
        let mut writer = TripWriter::create(path, &options).unwrap();
        for frame_index in 0..self.n_frames {
            let at = Stamp(START_NS + frame_index as i64 * FRAME_PERIOD_NS);
            let place = 2.0 * frame_index as f64 / self.n_frames as f64;
            let (sin, cos) = (TAU * place).sin_cos();
            let pose = Pose { x_m: self.x_m + 3.0 * cos, y_m: 3.0 * sin, yaw_rad: TAU * place };
            for topic in self.poses_topics {
                writer.write_odometry(topic, at, &pose).unwrap();
            }
            if let Some(command) = (self.command)(place) {
                writer.write_command("/cmd_vel", at, &command).unwrap();
            }
            let counts = self.counts(frame_index, place);
            for topic in self.frames_topics {
                self.write_frame(&mut writer, topic, at, &counts);
            }
        }
        writer.finish().unwrap();
    }

    fn write_frame(&self, writer: &mut TripWriter, topic: &str, at: Stamp, counts: &[u16]) {
        if self.as_images {
            let layout =
                FrameLayout { rows: 1, columns: counts.len() as u32, metres_per_count: METRES_PER_COUNT };
            let encoding = ImageEncoding::Millimetres;
            let image = Image { counts, layout, encoding, big_endian: false, row_padding_bytes: 0 };
            return writer.write_image(topic, at, &image).unwrap();
        }
        let scan = Scan {
            counts,
            metres_per_count: METRES_PER_COUNT,
            bearing_rad_min: 0.0,
            bearing_step_rad: (TAU / counts.len() as f64) as f32,
            range_m_min: 0.02,
            range_m_max: 8.0,
        };
        writer.write_scan(topic, at, &scan).unwrap();
    }

    fn counts(&self, frame_index: usize, place: f64) -> Vec<u16> {
        let n_readings = if frame_index >= self.halved_from { self.n_readings / 2 } else { self.n_readings };
        if self.invalid_frames.contains(&frame_index) {
            return vec![0; n_readings];
        }
        if self.is_constant {
            return vec![1500; n_readings];
        }
        let reading = |reading_index: usize| {
            let bearing = TAU * reading_index as f64 / n_readings as f64;
            let noise_index = (self.noise << 32) + (frame_index * self.n_readings + reading_index) as u64;
            if 0.5 + 0.5 * noise(!noise_index) < self.share_dropped {
                return 0;
            }
            let range_m = range_m(place, bearing) + 0.02 * noise(noise_index);
            (range_m / METRES_PER_COUNT) as u16
        };
        (0..n_readings).map(reading).collect()
    }
}

/// Driven by somebody who slows down and turns along the loop, and first takes the stick in hand a little way into it.
pub(crate) fn told_along_the_loop(place: f64) -> Option<Command> {
    let (sin, cos) = (TAU * place).sin_cos();
    (place > 0.05).then_some(Command { forward_m_s: 0.4 + 0.2 * sin, turn_rad_s: 0.8 * cos })
}

/// Distance to the wall: a room that widens and narrows along the loop, with a corner that comes and goes.
fn range_m(place: f64, bearing_rad: f64) -> f64 {
    let along = TAU * place;
    let width = 1.8 + along.sin();
    let corner = (-2.0 * (1.0 - (bearing_rad - 2.0 * along).cos())).exp();
    width * (1.0 + 0.3 * (2.0 * bearing_rad).cos()) + 1.5 * corner * (1.0 + (3.0 * along).cos())
}

/// Evenly distributed between −1 and 1, by the mixing function of Steele, Lea & Flood 2014 (SplitMix64).
fn noise(index: u64) -> f64 {
    let mut bits = index.wrapping_mul(0x9e37_79b9_7f4a_7c15);
    bits = (bits ^ (bits >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    bits = (bits ^ (bits >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    ((bits ^ (bits >> 31)) >> 11) as f64 / (1_u64 << 52) as f64 - 1.0
}

/// A trip's frames: what is known of each, and its counts.
pub(crate) fn read_trip(path: &Path) -> Vec<(FrameInfo, Vec<u16>)> {
    read_trip_by(path, None)
}

/// The same with poses from a topic that is named.
pub(crate) fn read_trip_by(path: &Path, poses_topic: Option<&str>) -> Vec<(FrameInfo, Vec<u16>)> {
    read_trip_with(path, &Selection { poses_topic: poses_topic.map(str::to_owned), ..Selection::default() })
}

/// The same with any topics.
pub(crate) fn read_trip_with(path: &Path, selection: &Selection) -> Vec<(FrameInfo, Vec<u16>)> {
    let mut trip = TripReader::open(path, selection).unwrap();
    let mut counts = vec![0; trip.layout().n_readings()];
    std::iter::from_fn(|| trip.next_frame(&mut counts).unwrap().map(|info| (info, counts.clone()))).collect()
}

/// Opens a model in this process.
pub(crate) fn open_model(path: &Path) -> Model {
    kinds_model::file::from_bytes(&Bytes::from(std::fs::read(path).unwrap())).unwrap()
}

/// Asserts that there is one report for every frame of a trip, in order, and that each says bit for bit what the model
/// says of the frame in this process.
pub(crate) fn assert_reports_equal_classifying_here(reports: &[KindReport], model: &Path, trip: &Path) {
    assert_eq!(reports.len(), read_trip(trip).len());
    assert_reports_equal_classifying_by(&[open_model(model)], reports, trip);
}

/// The same for the reports on a trip's first frames, each by one of several models: the one that it names.
pub(crate) fn assert_reports_equal_classifying_by(models: &[Model], reports: &[KindReport], trip: &Path) {
    let frames = read_trip(trip);
    let sequences: Vec<u64> = reports.iter().map(|report| report.sequence).collect();
    assert_eq!(sequences, (0..reports.len() as u64).collect::<Vec<_>>());
    let models =
        models.iter().map(|model| (model.id().0, (Classifier::new(Arc::new(model.clone())), model.median())));
    let mut classifiers = BTreeMap::from_iter(models);
    // Of the model that the last report named, and the frames that it has had.
    let mut filtered: Option<([u8; 16], Filter, u32)> = None;
    for (report, (frame, counts)) in reports.iter().zip(&frames) {
        let (classifier, median) =
            classifiers.get_mut(&report.model_id).expect("no report names another model");
        let counts = match median {
            Some(median) if counts.iter().any(|&count| count != 0) => median.take(counts),
            _ => counts,
        };
        let command = frame.command.map(|command| kinds_model::Command {
            forward_m_s: command.forward_m_s,
            turn_rad_s: command.turn_rad_s,
        });
        let (filter, n_filtered) = match filtered.take() {
            Some((id, filter, n_filtered)) if id == report.model_id => (filter, n_filtered),
            _ => (classifier.model().filter(), 0),
        };
        let here = classifier.classify_commanded(counts, command);
        assert_equal_bits(report, here);
        let (_, filter, n_filtered) = filtered.insert((report.model_id, filter, n_filtered + 1));
        filter.take((here.status == Status::Classified).then_some(&here.probabilities), 0);
        assert_eq!(bits(report.filtered()), bits(filter.probabilities()), "frame {}", report.sequence);
        let told = (report.filtered_kind as usize, report.n_filtered);
        assert_eq!(told, (filter.kind(), *n_filtered), "frame {}", report.sequence);
        assert_eq!(report.captured_ns, frame.captured.0);
        assert_eq!((report.run, report.n_lost), (reports[0].run, 0));
        let times = [report.sent_monotonic_ns, report.received_monotonic_ns, report.reported_monotonic_ns];
        assert!(times.is_sorted(), "{times:?}");
    }
}

fn bits(numbers: &[f64]) -> Vec<u64> {
    numbers.iter().map(|number| number.to_bits()).collect()
}

fn assert_equal_bits(report: &KindReport, here: &Classification) {
    let sequence = report.sequence;
    let status = match here.status {
        Status::Classified => ReportStatus::Classified,
        Status::Invalid => ReportStatus::Invalid,
    };
    assert_eq!(report.status(), status, "frame {sequence}");
    assert_eq!(report.kind as usize, here.kind, "frame {sequence}");
    assert_eq!(report.n_invalid as usize, here.n_invalid, "frame {sequence}");
    assert_eq!(bits(report.probabilities()), bits(&here.probabilities), "frame {sequence}");
    assert_eq!(bits(report.coordinates()), bits(&here.coordinates), "frame {sequence}");
    let numbers = |log_likelihood, novelty| bits(&[log_likelihood, novelty]);
    assert_eq!(
        numbers(report.log_likelihood, report.novelty),
        numbers(here.log_likelihood, here.novelty),
        "frame {sequence}"
    );
}
