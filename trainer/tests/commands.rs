//! Places that look alike and are told apart by what the robot was told to do there.

use std::path::{Path, PathBuf};

use kinds_model::Model;
use kinds_trainer::report::canonical_views;
use kinds_trainer::{
    CommandsConfig, Config, EvaluationPlan, Meetings, Rivals, adjusted_mutual_information, evaluate, load,
    train,
};
use kinds_trips::{Command, Pose, Scan, Selection, Stamp, TripWriter, WriterOptions};

/// The paper's dog and wolf: a robot goes back and forth between two ends of a corridor that it cannot tell apart. At one
/// of them it is told to turn left, at the other right.
const N_FRAMES: usize = 240;

/// Along the corridor and back, −1 to 1, four times.
fn place(frame_index: usize) -> f64 {
    (8.0 * std::f64::consts::PI * frame_index as f64 / N_FRAMES as f64).cos()
}

/// Left at one end, right at the other, ahead between them.
fn command(place: f64) -> Command {
    let turn_rad_s = if place.abs() > 0.8 { 0.7 * place.signum() } else { 0.0 };
    Command { forward_m_s: 0.4 - 0.2 * place.abs(), turn_rad_s }
}

/// Which end of the corridor a frame is at, if it is at one.
fn end(frame_index: usize) -> Option<usize> {
    let place = place(frame_index);
    (place.abs() > 0.8).then_some(usize::from(place > 0.0))
}

fn write(path: &Path, seed: u64) {
    let mut writer = TripWriter::create(path, &WriterOptions::default()).unwrap();
    for frame_index in 0..N_FRAMES {
        let (at, place) = (Stamp(1_000_000_000 + 100_000_000 * frame_index as i64), place(frame_index));
        // Both ways from the middle look alike but for noise of a few millimetres.
        let range = |reading: usize| {
            let noise = (frame_index * 31 + reading * 17 + seed as usize * 7) * 2_654_435_761 % 97;
            1000.0 + 1500.0 * place.abs() * (1.0 + (reading as f64).sin()) / 2.0 + noise as f64 / 10.0
        };
        let counts: Vec<u16> = (0..8).map(|reading| range(reading) as u16).collect();
        let scan = Scan {
            counts: &counts,
            metres_per_count: 0.001,
            bearing_rad_min: 0.0,
            bearing_step_rad: 0.7,
            range_m_min: 0.02,
            range_m_max: 8.0,
        };
        writer.write_scan("/ring", at, &scan).unwrap();
        writer.write_odometry("/odom", at, &Pose { x_m: 3.0 * place, y_m: 0.0, yaw_rad: 0.0 }).unwrap();
        writer.write_command("/cmd_vel", at, &command(place)).unwrap();
    }
    writer.finish().unwrap();
}

fn trips(folder: &Path) -> [PathBuf; 2] {
    [1, 2].map(|trip| {
        let path = folder.join(format!("corridor-{trip}.mcap"));
        write(&path, trip);
        path
    })
}

fn learn(trip: &Path, kinds: usize, weight: f64) -> Model {
    let config = Config {
        neighbors: Some(8),
        dims: Some(3),
        kinds: Some(kinds),
        commands: CommandsConfig { weight: Some(weight) },
        ..Config::default()
    };
    train(&[trip.to_path_buf()], &config, &mut |_, _, _| ()).unwrap().model
}

/// How well kinds tell the ends apart: adjusted mutual information, 1 if they do wholly.
fn agreement(kinds: &[usize]) -> f64 {
    let pairs: Vec<(usize, usize)> =
        kinds.iter().enumerate().filter_map(|(index, &kind)| Some((end(index)?, kind))).collect();
    assert!(pairs.len() > N_FRAMES / 4);
    adjusted_mutual_information(&pairs)
}

#[test]
fn places_that_look_alike_are_told_apart_by_commands_and_only_by_them() {
    let folder = tempfile::tempdir().unwrap();
    let trips = trips(folder.path());
    let [first, second] =
        trips.each_ref().map(|trip| load(trip, &Selection::default(), &mut |_, _, _| ()).unwrap());
    let plan = EvaluationPlan::default();
    let trips_read = [first, second];
    let agreements = [0.0, 1.0].map(|weight| {
        let rivals = Rivals::of(learn(&trips[0], 4, weight), &mut |_, _, _| ()).unwrap();
        let meetings = Meetings::find(rivals.isomap.layout(), &[&trips_read], &plan.same_place()).unwrap();
        let evaluation = evaluate(&rivals, &meetings, &plan, &mut |_, _, _| ()).unwrap();
        [0, 1].map(|trip| agreement(&evaluation.trips[trip].kinds))
    });
    let [without, with] = agreements;
    assert!(without.iter().all(|agreement| agreement.abs() < 0.1), "{agreements:?}");
    // On the trip that was learnt, and on one that was not.
    assert!(with.iter().all(|agreement| *agreement > 0.5), "{agreements:?}");
}

#[test]
fn reference_frames_are_the_sensors_readings_and_the_commands_behind_them() {
    let folder = tempfile::tempdir().unwrap();
    let [trip, _] = trips(folder.path());
    let (with, without) = (learn(&trip, 4, 1.0), learn(&trip, 4, 0.0));
    let (with, without) = (with.frames(), without.frames());
    assert_eq!((with.n_readings(), with.n_columns(), with.n_frames()), (8, 10, N_FRAMES));
    assert_eq!(without.n_columns(), 8);
    for frame_index in 0..N_FRAMES {
        assert_eq!(with.readings(frame_index), without.row(frame_index));
        // The speed is greatest in the middle, and the turn at one end.
        let [_, turn] = with.row(frame_index)[8..] else { panic!("two columns") };
        let expected = end(frame_index).map_or(32768, |end| if end == 1 { u16::MAX } else { 0 });
        assert_eq!(turn, expected);
    }
}

#[test]
fn the_views_of_a_kind_are_of_what_the_sensor_saw() {
    let folder = tempfile::tempdir().unwrap();
    let [trip, _] = trips(folder.path());
    // One kind for all frames: whatever they are compared by, its views are those of all readings.
    let [with, without] = [1.0, 0.0].map(|weight| canonical_views(&learn(&trip, 1, weight)).csv().to_owned());
    assert_eq!(with, without);
    assert_eq!(with.lines().count(), 1 + 8);
}
