//! Frames of a simulated robot in files that a program in another language reads as well.
//!
//! `frames.npy` holds raw counts, `response.npy` the table that maps them to the scale on which frames are compared,
//! `trip.mcap` the first frames as a robot records them, and `coordinates.npy` what an embedding makes of them.

use std::io::Write;
use std::path::{Path, PathBuf};
use std::thread;

use kinds_driver_shim::simulated::{Chew, Robot};
use kinds_model::{Response, ResponsePlan, Scale, SensorLayout};
use kinds_trips::{FrameLayout, Image, ImageEncoding, Stamp, TripWriter, WriterOptions};

use crate::npy::{create, read, write_counts};

/// Drives side by side.
const N_DRIVES: u32 = 2;

/// Where the data is, and how much of it.
pub(crate) struct Data {
    folder: PathBuf,
    /// For Isomap.
    pub(crate) n_frames: usize,
    /// For a training of which everything is chosen by the trainer.
    pub(crate) n_trained: usize,
    /// For mixtures.
    pub(crate) n_points: usize,
}

impl Data {
    /// As much as the environment asks for.
    pub(crate) fn of_environment() -> Self {
        let number = |name, usual| match std::env::var(name) {
            Ok(text) => text.parse().unwrap_or_else(|_| panic!("{name} is {text}; it must be a number")),
            Err(_) => usual,
        };
        let n_frames = number("KINDS_BENCH_FRAMES", 6000);
        let n_trained = number("KINDS_BENCH_TRAINED", 2000);
        let n_points = number("KINDS_BENCH_POINTS", 20_000);
        let name = format!("fit-{n_frames}-{n_trained}-{n_points}");
        let usual = || Path::new(env!("CARGO_TARGET_TMPDIR")).join(name);
        let folder = std::env::var_os("KINDS_BENCH_FOLDER").map_or_else(usual, PathBuf::from);
        Self { folder, n_frames, n_trained, n_points }
    }

    /// The sensor that took the frames.
    pub(crate) fn sensor() -> SensorLayout {
        let FrameLayout { rows, columns, metres_per_count } = Chew::new(0, 0).layout();
        SensorLayout { rows, columns, metres_per_count }
    }

    /// The scale on which frames are compared.
    pub(crate) fn response() -> ResponsePlan {
        ResponsePlan::new(Scale::Inverse, 7.5)
    }

    /// The first frames, as a robot records them.
    pub(crate) fn trip(&self) -> PathBuf {
        self.folder.join("trip.mcap")
    }

    /// Drives as many frames as are asked for, unless that was done before.
    pub(crate) fn prepare(&self) {
        let frames = self.folder.join("frames.npy");
        if frames.exists() {
            return;
        }
        std::fs::create_dir_all(&self.folder).expect("the data's folder can be made");
        let response = Response::new(&Self::response(), Self::sensor().metres_per_count).expect("a scale");
        let table = response.table();
        write_counts(&mut create(&self.folder.join("response.npy"), "<u2", &[table.len()]), table);

        let n_wanted = self.n_frames.max(self.n_trained).max(self.n_points);
        let partial = frames.with_extension("partial");
        let mut file = create(&partial, "<u2", &[n_wanted, Self::sensor().n_readings()]);
        let mut trip =
            TripWriter::create(&self.trip(), &WriterOptions::default()).expect("a trip can be made");
        for (index, (captured, counts)) in drives().take(n_wanted).enumerate() {
            write_counts(&mut file, &counts);
            if index < self.n_trained {
                write_frame(&mut trip, captured, &counts);
            }
        }
        trip.finish().expect("the trip can be written");
        drop(file);
        std::fs::rename(partial, frames).expect("the frames can be named");
    }

    /// The first frames' raw counts, shape `(n, n_readings)`.
    pub(crate) fn counts(&self, n: usize) -> Vec<u16> {
        let of_bytes = |bytes: [u8; 2]| u16::from_le_bytes(bytes);
        read(&self.folder.join("frames.npy"), n * Self::sensor().n_readings(), of_bytes)
    }

    /// Embedded frames, shape `(n_points, n_dims)`; none before they were kept.
    pub(crate) fn coordinates(&self, n_dims: usize) -> Option<Vec<f64>> {
        let path = self.folder.join("coordinates.npy");
        path.exists().then(|| read(&path, self.n_points * n_dims, f64::from_le_bytes))
    }

    /// Keeps embedded frames.
    pub(crate) fn keep_coordinates(&self, coordinates: &[f64], n_dims: usize) {
        let path = self.folder.join("coordinates.npy");
        let mut file = create(&path, "<f8", &[coordinates.len() / n_dims, n_dims]);
        for place in coordinates {
            file.write_all(&place.to_le_bytes()).expect("coordinates can be written");
        }
    }
}

/// Frames of one trip after the other.
fn drives() -> impl Iterator<Item = (Stamp, Vec<u16>)> {
    (0..).step_by(N_DRIVES as usize).flat_map(|first| {
        thread::scope(|scope| {
            let some = (first..first + N_DRIVES).map(|trip| scope.spawn(move || drive(trip)));
            let some: Vec<_> = some.collect();
            some.into_iter().flat_map(|drive| drive.join().expect("a robot drives")).collect::<Vec<_>>()
        })
    })
}

fn drive(trip: u32) -> Vec<(Stamp, Vec<u16>)> {
    let mut robot = Chew::new(trip, 0);
    let mut counts = vec![0; Data::sensor().n_readings()];
    std::iter::from_fn(|| robot.step(&mut counts).map(|moment| (moment.captured, counts.clone()))).collect()
}

fn write_frame(trip: &mut TripWriter, captured: Stamp, counts: &[u16]) {
    let layout = Chew::new(0, 0).layout();
    let encoding = ImageEncoding::Millimetres;
    let image = Image { counts, layout, encoding, big_endian: false, row_padding_bytes: 0 };
    trip.write_image("/frames", captured, &image).expect("the trip can be written");
}
