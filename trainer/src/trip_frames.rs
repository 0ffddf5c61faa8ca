//! The frames of trips that are too long to hold, read anew for each pass over them, and the same in each.

use std::hash::{DefaultHasher, Hash, Hasher};
use std::path::PathBuf;

use kinds_model::{FrameSource, MedianFilter, MedianPlan, SensorLayout};
use kinds_trips::Selection;

use crate::load::LoadError;
use crate::survey::{Survey, ValidFrames};

/// The frames of one trip after the other, that have a valid reading.
pub(crate) struct TripFrames {
    selection: Selection,
    trips: Vec<Surveyed>,
    /// What they pass.
    median: MedianPlan,
    /// Which of them is being read.
    at: usize,
    reading: Option<Reading>,
}

/// What a trip's frames were when it was surveyed.
struct Surveyed {
    path: PathBuf,
    layout: SensorLayout,
    n_frames: usize,
    digest: u64,
}

/// A trip being read.
struct Reading {
    frames: ValidFrames,
    n_read: usize,
    digest: Digest,
    median: Option<MedianFilter>,
}

/// What a trip's frames are known by.
#[derive(Default)]
pub(crate) struct Digest(DefaultHasher);

impl Digest {
    /// * `counts` — raw counts of the next frame
    pub(crate) fn add(&mut self, counts: &[u16]) {
        counts.hash(&mut self.0);
    }

    fn finish(&self) -> u64 {
        self.0.finish()
    }
}

impl TripFrames {
    /// Of no trip yet.
    pub(crate) fn new(selection: Selection) -> Self {
        Self { selection, trips: Vec::new(), median: MedianPlan::Off, at: 0, reading: None }
    }

    /// From now on, has the frames of each trip pass a median over time.
    pub(crate) fn pass(&mut self, median: MedianPlan) {
        (self.median, self.at, self.reading) = (median, 0, None);
    }

    /// Adds a trip.
    ///
    /// * `digest` — of its frames that have a valid reading
    pub(crate) fn add(&mut self, survey: &Survey, digest: &Digest) {
        self.trips.push(Surveyed {
            path: survey.path.clone(),
            layout: survey.layout,
            n_frames: survey.n_frames(),
            digest: digest.finish(),
        });
    }
}

impl Surveyed {
    fn changed(&self, what: impl Into<String>) -> LoadError {
        LoadError::Changed { path: self.path.clone(), what: what.into() }
    }

    fn open(&self, selection: &Selection, median: MedianPlan) -> Result<Reading, LoadError> {
        let frames = ValidFrames::open(&self.path, selection)?;
        match frames.layout() {
            layout if layout == self.layout => {
                let median = MedianFilter::new(median, layout.n_readings());
                Ok(Reading { frames, n_read: 0, digest: Digest::default(), median })
            }
            layout => {
                Err(self.changed(format!("its frames were of {}, and now they are of {layout}", self.layout)))
            }
        }
    }

    /// Reads the next frame, and at the last one whether all were what they had been.
    fn read(&self, reading: &mut Reading, counts: &mut [u16]) -> Result<(), LoadError> {
        if reading.frames.next(counts)?.is_none() {
            let (before, now) = (self.n_frames, reading.n_read);
            return Err(
                self.changed(format!("it had {before} frames with a valid reading, and now it has {now}"))
            );
        }
        reading.n_read += 1;
        reading.digest.add(counts);
        if reading.n_read == self.n_frames && reading.digest.finish() != self.digest {
            return Err(self.changed("its frames are not what they were"));
        }
        if let Some(median) = &mut reading.median {
            counts.copy_from_slice(median.take(counts));
        }
        Ok(())
    }
}

impl FrameSource for TripFrames {
    type Error = LoadError;

    fn n_frames(&self) -> usize {
        self.trips.iter().map(|trip| trip.n_frames).sum()
    }

    fn rewind(&mut self) -> Result<(), LoadError> {
        (self.at, self.reading) = (0, None);
        Ok(())
    }

    fn read(&mut self, counts: &mut [u16]) -> Result<(), LoadError> {
        let trip = &self.trips[self.at];
        let reading = match &mut self.reading {
            Some(reading) => reading,
            none => none.insert(trip.open(&self.selection, self.median)?),
        };
        trip.read(reading, counts)?;
        if reading.n_read == trip.n_frames {
            self.at += 1;
            self.reading = None;
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use std::path::Path;

    use kinds_trips::{Scan, Stamp, TripWriter, WriterOptions};

    use super::*;
    use crate::survey::survey;

    /// A trip of a ring of readings; a frame without a valid one comes first.
    fn write(path: &Path, n_readings: usize, frames: &[u16]) {
        let mut writer = TripWriter::create(path, &WriterOptions::default()).unwrap();
        for (index, &count) in [0].iter().chain(frames).enumerate() {
            let scan = Scan {
                counts: &vec![count; n_readings],
                metres_per_count: 0.001,
                bearing_rad_min: 0.0,
                bearing_step_rad: 0.5,
                range_m_min: 0.0,
                range_m_max: 9.0,
            };
            writer.write_scan("/ring", Stamp(1 + index as i64), &scan).unwrap();
        }
        writer.finish().unwrap();
    }

    fn surveyed(paths: &[PathBuf]) -> TripFrames {
        let mut frames = TripFrames::new(Selection::default());
        for path in paths {
            let mut digest = Digest::default();
            let found = survey(path, &Selection::default(), &mut |_, _, _| (), |counts| digest.add(counts));
            frames.add(&found.unwrap(), &digest);
        }
        frames
    }

    fn read_all(frames: &mut TripFrames) -> Result<Vec<u16>, String> {
        frames.rewind().unwrap();
        let mut counts = [0; 2];
        (0..frames.n_frames())
            .map(|_| frames.read(&mut counts).map(|()| counts[0]).map_err(|error| error.to_string()))
            .collect()
    }

    #[test]
    fn every_pass_reads_the_valid_frames_of_all_trips_in_order() {
        let folder = tempfile::tempdir().unwrap();
        let paths = ["a.mcap", "b.mcap"].map(|name| folder.path().join(name));
        write(&paths[0], 2, &[7, 0, 8]);
        write(&paths[1], 2, &[9]);
        let mut frames = surveyed(&paths);
        assert_eq!(frames.n_frames(), 3);
        for _ in 0..2 {
            assert_eq!(read_all(&mut frames), Ok(vec![7, 8, 9]));
            // A pass that ends early leaves nothing behind.
            frames.rewind().unwrap();
            frames.read(&mut [0; 2]).unwrap();
        }
    }

    #[test]
    fn a_trip_that_changes_between_two_passes_is_refused_in_words() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("trip.mcap");
        write(&path, 2, &[7, 8, 9]);
        let mut frames = surveyed(std::slice::from_ref(&path));
        assert_eq!(read_all(&mut frames), Ok(vec![7, 8, 9]));
        let mut refusal = |n_readings, counts: &[u16]| {
            write(&path, n_readings, counts);
            let words = read_all(&mut frames).unwrap_err();
            let changed = format!("trip {} changed while it was read: ", path.display());
            words.strip_prefix(&changed).unwrap_or_else(|| panic!("{words}")).to_string()
        };
        let advice = "; train again once nothing writes to it";
        assert_eq!(
            refusal(2, &[7, 8]),
            format!("it had 3 frames with a valid reading, and now it has 2{advice}")
        );
        assert_eq!(refusal(2, &[7, 8, 5]), format!("its frames are not what they were{advice}"));
        assert_eq!(
            refusal(3, &[7, 8, 9]),
            format!(
                "its frames were of 2 readings (1 × 2) of 0.001 m a count, and now they are of 3 readings (1 × 3) of 0.001 m \
                 a count{advice}"
            )
        );
        std::fs::remove_file(&path).unwrap();
        assert!(read_all(&mut frames).is_err());
    }
}
