//! What the demo is shown on: trips of a simulated robot, which are driven for it, or two recorded ones.

use std::path::{Path, PathBuf};

use kinds_driver_shim::simulated::{Floor, Robot};
use kinds_driver_shim::{ShimError, Source};
use kinds_messages::SensorName;
use kinds_trainer::MeetingError;
use kinds_trips::{Selection, TripReader};

use crate::cli::RobotName;
use crate::commands::publish;
use crate::failure::Failure;
use crate::trip_file::{TRUE_POSES, Topics, TripFile};

/// Seed of the robots' worlds.
const SEED: u64 = 0;

/// The trips of a demo.
pub(crate) struct Subject {
    pub(crate) sensor: SensorName,
    /// Where the kinds are learnt, in words.
    pub(crate) home: String,
    /// The trip that they are learnt from, and another through the same places.
    pub(crate) trips: [PathBuf; 2],
    /// Two trips through places that the kinds were not learnt in, and where that is.
    pub(crate) elsewhere: Option<(String, [PathBuf; 2])>,
    /// What is read of all of them.
    pub(crate) selection: Selection,
}

/// What driving came to.
#[derive(Default)]
pub(crate) struct Driven {
    pub(crate) n_frames: u64,
    pub(crate) n_readings: usize,
    pub(crate) duration_s: f64,
}

impl Subject {
    /// Two trips that somebody has recorded. Fails where they cannot be read or evaluated: before the work on them.
    pub(crate) fn recorded(trips: [PathBuf; 2]) -> Result<Self, Failure> {
        let selection = Selection::default();
        for path in &trips {
            if TripReader::open(path, &selection)?.poses_topic().is_none() {
                return Err(MeetingError::NoPoses { path: path.clone() }.into());
            }
        }
        let home = "the recorded trips".to_string();
        Ok(Self { sensor: sensor("demo/sensor"), home, trips, elsewhere: None, selection })
    }

    /// The trips of a simulated robot, which are yet to be driven.
    pub(crate) fn simulated(robot: RobotName, folder: &Path) -> Self {
        let pair = |name: &str| [1, 2].map(|trip| folder.join(format!("{name}-{trip}.mcap")));
        // The truth is what the paper's authors registered odometry by hand for.
        let selection = Selection { poses_topic: Some(TRUE_POSES.to_string()), ..Selection::default() };
        match robot {
            RobotName::Crunch => Self {
                sensor: sensor("crunch/ring"),
                home: "the fourth floor".to_string(),
                trips: pair(Floor::Fourth.name()),
                elsewhere: Some(("the fifth floor".to_string(), pair(Floor::Fifth.name()))),
                selection,
            },
            RobotName::Chew => Self {
                sensor: sensor("chew/camera"),
                home: "the campus".to_string(),
                trips: pair("campus"),
                elsewhere: None,
                selection,
            },
        }
    }

    /// Drives and records all trips of a simulated robot, side by side.
    pub(crate) fn drive(&self, robot: RobotName) -> Result<Driven, Failure> {
        let elsewhere = self.elsewhere.as_ref().map(|(_, trips)| trips);
        let floors = [(Floor::Fourth, Some(&self.trips)), (Floor::Fifth, elsewhere)];
        let legs = floors.into_iter().flat_map(|(floor, trips)| {
            trips.into_iter().flatten().zip(1..).map(move |(path, trip)| (floor, trip, path))
        });
        std::thread::scope(|scope| {
            let threads: Vec<_> = legs
                .map(|(floor, trip, path)| {
                    scope.spawn(move || drive(publish::robot(robot, floor, trip, SEED), path))
                })
                .collect();
            let mut all = Driven::default();
            for thread in threads {
                let trip = thread.join().expect("driving does not panic")?;
                all.n_frames += trip.n_frames;
                all.n_readings = trip.n_readings;
                all.duration_s += trip.duration_s;
            }
            Ok(all)
        })
    }
}

/// Drives one trip to its end, as fast as it can be drawn.
fn drive(mut robot: Box<dyn Robot>, path: &Path) -> Result<Driven, Failure> {
    let layout = Source::layout(&robot);
    let (mut file, topics) = (TripFile::create(path)?, Topics::of_the_only_sensor());
    let mut counts = vec![0; layout.n_readings()];
    let mut driven = Driven { n_readings: layout.n_readings(), ..Driven::default() };
    let mut first = None;
    while let Some(capture) = robot.next(&mut counts).map_err(ShimError::from)? {
        file.add_frame(&topics, layout, &counts, &capture)?;
        driven.n_frames += 1;
        let first = *first.get_or_insert(capture.captured);
        driven.duration_s = (capture.captured.0 - first.0) as f64 / 1e9;
    }
    file.finish()?;
    Ok(driven)
}

fn sensor(name: &str) -> SensorName {
    name.parse().expect("the name is as it should be")
}
