//! Where trips are recorded to: what they are named, which of them are kept, and how much room is left.

use std::io;
use std::path::{Path, PathBuf};

use crate::failure::Failure;
use crate::whole_file::folder_of;

/// A file for one trip, or a folder for the trips of one sensor, or of several together.
pub(crate) struct Destination {
    output: PathBuf,
    /// What the names of the trips begin with.
    prefix: String,
    is_folder: bool,
}

impl Destination {
    /// * `sensors` — the sensor's name, or those of several with commas between
    pub(crate) fn new(output: PathBuf, sensors: &str) -> Self {
        let is_folder = output.is_dir();
        let prefix = format!("{}-", sensors.replace('/', "-").replace(',', "+"));
        Self { output, prefix, is_folder }
    }

    pub(crate) fn is_folder(&self) -> bool {
        self.is_folder
    }

    /// Where a trip goes that begins at a time: a path at which nothing is yet.
    ///
    /// * `at_ns` — since the epoch
    /// * `being_recorded` — a trip that will be at its path only when it has ended, if there is one
    pub(crate) fn path_at(&self, at_ns: i64, being_recorded: Option<&Path>) -> Result<PathBuf, Failure> {
        let taken = |path: &Path| {
            Failure::CouldNot(format!(
                "cannot record into {}: it is there already; choose another name",
                path.display()
            ))
        };
        if !self.is_folder {
            return if self.output.exists() { Err(taken(&self.output)) } else { Ok(self.output.clone()) };
        }
        // A clock that was set back comes by the same second again.
        let (prefix, time) = (&self.prefix, time_at(at_ns));
        let names = std::iter::once(format!("{prefix}{time}.mcap"))
            .chain((2..1000).map(|n| format!("{prefix}{time}-{n}.mcap")));
        let mut paths = names.map(|name| self.output.join(name));
        paths
            .find(|path| !path.exists() && Some(&**path) != being_recorded)
            .ok_or_else(|| taken(&self.output))
    }

    /// Removes the sensor's oldest trips in the folder, by the times in their names, and what killed recorders left of them.
    /// Nothing else there is touched.
    ///
    /// * `n_kept` — how many stay beside the one that is being recorded
    pub(crate) fn keep_last(&self, n_kept: usize, being_recorded: &Path) -> Result<(), Failure> {
        let failed = |error: io::Error| Failure::file("remove old trips in", &self.output, &error);
        let current = being_recorded.file_name().unwrap_or_default().to_string_lossy();
        let mut trips = Vec::new();
        for entry in std::fs::read_dir(&self.output).map_err(failed)? {
            let path = entry.map_err(failed)?.path();
            let Some(name) = path.file_name().and_then(|name| name.to_str()) else { continue };
            if name.starts_with(&*current) {
                continue;
            }
            if let Some((time, number)) = began(&self.prefix, name) {
                trips.push((time.to_owned(), number, path));
            }
        }
        trips.sort();
        let n_removed = trips.len().saturating_sub(n_kept);
        for (_, _, path) in &trips[..n_removed] {
            match std::fs::remove_file(path) {
                Err(error) if error.kind() != io::ErrorKind::NotFound => return Err(failed(error)),
                _ => (),
            }
        }
        Ok(())
    }

    /// Room that is left on the disk.
    pub(crate) fn free_bytes(&self) -> Result<u64, Failure> {
        let folder = if self.is_folder { &self.output } else { folder_of(&self.output) };
        let space = rustix::fs::statvfs(folder)
            .map_err(|error| Failure::file("find out how much room is left in", folder, &error.into()))?;
        Ok(space.f_bavail.saturating_mul(space.f_frsize))
    }
}

/// When the trip of a file began, and which of that second it is; if the file is one, or what is left of one, of this
/// sensor: `crunch-ring-2026-11-27T12-30-00Z-2.mcap`, or with `.….partial` behind it.
fn began<'a>(prefix: &str, name: &'a str) -> Option<(&'a str, u32)> {
    const FORM: &str = "0000-00-00T00-00-00Z";
    let (time, rest) = name.strip_prefix(prefix)?.split_at_checked(FORM.len())?;
    let fits = |(c, form): (char, char)| if form == '0' { c.is_ascii_digit() } else { c == form };
    let (number, end) = rest.split_once(".mcap")?;
    let number = match number {
        "" => 1,
        number => number.strip_prefix('-')?.parse().ok()?,
    };
    let is_trip = end.is_empty() || (end.starts_with('.') && end.ends_with(".partial"));
    (time.chars().zip(FORM.chars()).all(fits) && is_trip).then_some((time, number))
}

/// A time in a name: `2026-11-27T12-30-00Z`.
///
/// * `at_ns` — since the epoch
fn time_at(at_ns: i64) -> String {
    const DAY_S: i64 = 24 * 60 * 60;
    let at_s = at_ns.div_euclid(1_000_000_000);
    let (day, second) = (at_s.div_euclid(DAY_S), at_s.rem_euclid(DAY_S));
    let (year, month, day) = date(day);
    let [hour, minute, second] = [second / 3600, second / 60 % 60, second % 60];
    format!("{year:04}-{month:02}-{day:02}T{hour:02}-{minute:02}-{second:02}Z")
}

/// Year, month and day, from days since the epoch.
///
/// Hinnant 2021, *chrono-Compatible Low-Level Date Algorithms*, `civil_from_days`: years begin in March, so that the leap day is
/// a year's last.
fn date(days: i64) -> (i64, i64, i64) {
    const ERA: i64 = 146_097;
    let days = days + 719_468;
    let (era, day_of_era) = (days.div_euclid(ERA), days.rem_euclid(ERA));
    let year_of_era = (day_of_era - day_of_era / 1460 + day_of_era / 36_524 - day_of_era / 146_096) / 365;
    let day_of_year = day_of_era - (365 * year_of_era + year_of_era / 4 - year_of_era / 100);
    let month_from_march = (5 * day_of_year + 2) / 153;
    let day = day_of_year - (153 * month_from_march + 2) / 5 + 1;
    let month = if month_from_march < 10 { month_from_march + 3 } else { month_from_march - 9 };
    (400 * era + year_of_era + i64::from(month <= 2), month, day)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn trips_are_named_by_sensor_and_time_and_never_by_a_name_that_is_taken() {
        let folder = tempfile::tempdir().unwrap();
        let trips = Destination::new(folder.path().into(), "crunch/ring");
        // By `date --utc --date @… +%FT%H-%M-%SZ`.
        for (at_s, time) in [
            (0, "1970-01-01T00-00-00Z"),
            (-1, "1969-12-31T23-59-59Z"),
            (951_782_400, "2000-02-29T00-00-00Z"),
            (1_709_251_199, "2024-02-29T23-59-59Z"),
            (1_795_782_600, "2026-11-27T12-30-00Z"),
            (4_107_542_400, "2100-03-01T00-00-00Z"),
        ] {
            for number in ["", "-2", "-3"] {
                let path = trips.path_at(at_s * 1_000_000_000, None).unwrap();
                assert_eq!(path, folder.path().join(format!("crunch-ring-{time}{number}.mcap")));
                // Until it has ended, a trip that is being recorded is not at its path.
                let next = trips.path_at(at_s * 1_000_000_000, Some(&path)).unwrap();
                assert!(next != path && !next.exists());
                std::fs::write(path, "").unwrap();
            }
        }
    }

    #[test]
    fn the_oldest_trips_of_a_sensor_are_removed_and_nothing_else() {
        let others = [
            "crunch-ring.mcap",
            "crunch-ring-2020-01-01T00-00-00Z.txt",
            "crunch-ring-2020-01-01T00-00-00Z.mcap.copy",
            "crunch-ring-2020-01-01.mcap",
            "crunch-ring-x-2020-01-01T00-00-00Z.mcap",
            "crunch-ring-2020-01-01T00-00-00Zé.mcap",
            "chew-camera-2020-01-01T00-00-00Z.mcap",
            "crunch-ring+chew-camera-2020-01-01T00-00-00Z.mcap",
        ];
        // From the oldest on.
        let trips = [
            "crunch-ring-2026-11-27T12-30-00Z.mcap",
            "crunch-ring-2026-11-27T12-30-00Z-2.mcap",
            "crunch-ring-2026-11-27T12-30-00Z-10.mcap",
            "crunch-ring-2026-11-27T12-31-00Z.mcap.aB3.partial",
            "crunch-ring-2027-01-01T00-00-00Z.mcap",
        ];
        // Recorded by a clock that has been set back.
        let current = "crunch-ring-2026-11-27T12-00-00Z.mcap";
        let partial = format!("{current}.Xy1.partial");
        for n_kept in 0..=trips.len() + 1 {
            let folder = tempfile::tempdir().unwrap();
            for name in others.iter().chain(&trips).chain([&&*partial]) {
                std::fs::write(folder.path().join(name), "").unwrap();
            }
            let destination = Destination::new(folder.path().into(), "crunch/ring");
            destination.keep_last(n_kept, Path::new(current)).unwrap();
            let entries = std::fs::read_dir(folder.path()).unwrap();
            let mut found: Vec<_> =
                entries.map(|entry| entry.unwrap().file_name().into_string().unwrap()).collect();
            let kept = &trips[trips.len().saturating_sub(n_kept)..];
            let mut expected: Vec<_> =
                others.iter().chain(kept).chain([&&*partial]).map(ToString::to_string).collect();
            found.sort();
            expected.sort();
            assert_eq!(found, expected);
        }
    }
}
