//! What is called novel: little of a second trip through the same place, and nearly all that is unlike any frame seen.

#![allow(clippy::print_stdout, reason = "what was measured is worth reading")]

use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::Duration;

use kinds_driver_shim::simulated::{Chew, Crunch, Floor};
use kinds_messages::{FrameHeader, FramePublisher};
use kinds_model::{Classifier, EmPlan, FitPlan, Model, Origin, ResponsePlan, Scale, SensorLayout, fit};
use kinds_trainer::{Config, load, train};
use kinds_trips::{Selection, Stamp};
use rand::RngExt;
use rand::seq::SliceRandom;
use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::SeedableRng;

use crate::consumer::Consumer;
use crate::real_trips;
use crate::robot::{Robot, SECOND, SENSOR};
use crate::world::read_trip;

/// Frames of one sensor.
struct Trip {
    layout: SensorLayout,
    /// Shape `(n_frames, n_readings)`.
    counts: Vec<u16>,
}

impl Trip {
    /// A trip of a simulated robot, as far as it goes.
    fn driven(mut robot: impl kinds_driver_shim::simulated::Robot, n_frames_max: usize) -> Self {
        let kinds_trips::FrameLayout { rows, columns, metres_per_count } = robot.layout();
        let layout = SensorLayout { rows, columns, metres_per_count };
        let (mut counts, mut frame) = (Vec::new(), vec![0; layout.n_readings()]);
        while counts.len() < n_frames_max * frame.len() && robot.step(&mut frame).is_some() {
            counts.extend_from_slice(&frame);
        }
        Self { layout, counts }
    }

    fn recorded(path: &Path) -> Self {
        let trip = load(path, &Selection::default(), &mut |_, _, _| ()).unwrap();
        Self { layout: trip.survey.layout, counts: trip.counts }
    }

    fn frames(&self) -> impl Iterator<Item = &[u16]> {
        self.counts.chunks_exact(self.layout.n_readings())
    }

    fn with(&self, change: impl FnMut(&[u16]) -> Vec<u16>) -> Self {
        Self { layout: self.layout, counts: self.frames().flat_map(change).collect() }
    }

    /// Near is far and far is near, within a range.
    fn inverted(&self, range_m_max: f64) -> Self {
        let farthest = (range_m_max / self.layout.metres_per_count) as u16;
        let inverted = |count: u16| if count == 0 { 0 } else { farthest + 1 - count.min(farthest) };
        self.with(|frame| frame.iter().map(|&count| inverted(count)).collect())
    }

    /// The readings of each frame in another order.
    fn shuffled(&self) -> Self {
        let mut random = ChaCha8Rng::seed_from_u64(5);
        self.with(|frame| {
            let mut frame = frame.to_vec();
            frame.shuffle(&mut random);
            frame
        })
    }

    /// Any readings within a range.
    fn noise(&self, range_m_max: f64) -> Self {
        let farthest = (range_m_max / self.layout.metres_per_count) as u16;
        let mut random = ChaCha8Rng::seed_from_u64(6);
        self.with(|frame| frame.iter().map(|_| random.random_range(1..=farthest)).collect())
    }

    /// Brought to another sensor's layout: the nearest reading of each, in the other's unit.
    fn as_of(&self, layout: SensorLayout) -> Self {
        let scale = self.layout.metres_per_count / layout.metres_per_count;
        let nearest = |to: u32, n_to: u32, n_from: u32| to * n_from / n_to;
        let brought = |frame: &[u16]| {
            let places =
                (0..layout.rows).flat_map(|row| (0..layout.columns).map(move |column| (row, column)));
            let place = |(row, column): (u32, u32)| {
                let row = nearest(row, layout.rows, self.layout.rows);
                frame[(row * self.layout.columns + nearest(column, layout.columns, self.layout.columns))
                    as usize]
            };
            places.map(place).map(|count| (f64::from(count) * scale).round().min(65535.0) as u16).collect()
        };
        Self { layout, counts: self.frames().flat_map(|frame| -> Vec<u16> { brought(frame) }).collect() }
    }
}

/// A model of a simulated robot's trip.
fn learnt(trip: &Trip, range_m_max: f64) -> Model {
    let plan = FitPlan {
        n_frames_max: 4000,
        n_neighbors: Some(10),
        n_landmarks: 500,
        n_dims: Some(8),
        n_kinds: Some(5),
        em: EmPlan { n_starts: 2, ..EmPlan::new(0) },
        ..FitPlan::new(trip.layout, ResponsePlan::new(Scale::Inverse, range_m_max), 0)
    };
    fit(trip.counts.clone(), &plan, Origin::default(), &mut |_, _, _| ()).unwrap()
}

/// Sends the first frames of [`SECOND`] as a robot's come, every twentieth of them unlike all, and returns those that the service calls
/// novel: when they were captured, and their counts.
pub(crate) fn send_with_novel(robot: &Robot, consumer: &mut Consumer) -> Vec<(Stamp, Vec<u16>)> {
    let publisher = FramePublisher::create(&robot.node(), &SENSOR.parse().unwrap(), 16).unwrap();
    let (mut novel, mut is_novel) = (Vec::new(), false);
    for (sequence, (frame, mut counts)) in (0..).zip(read_trip(&robot.path(SECOND)).into_iter().take(58)) {
        // Whoever looks seldom finds sixteen at most.
        std::thread::sleep(Duration::from_millis(10));
        if sequence % 20 == 9 {
            // Nothing but walls right ahead and far away.
            counts.iter_mut().step_by(2).for_each(|count| *count = 60);
            counts.iter_mut().skip(1).step_by(2).for_each(|count| *count = 60_000);
        }
        let mut loan = publisher.loan().unwrap();
        loan.counts_mut().copy_from_slice(&counts);
        let header = FrameHeader {
            sequence,
            captured_ns: frame.captured.0,
            metres_per_count: 0.001,
            rows: 1,
            columns: 16,
            ..FrameHeader::default()
        };
        loan.send(&header).unwrap();
        is_novel = consumer.await_frame(sequence).last().unwrap().novelty >= 0.99;
        if is_novel {
            novel.push((frame.captured, counts));
        }
    }
    // A report comes to one reader after the other: when a later one is here, those before it are everywhere.
    assert!(!is_novel, "the last frame is a usual one");
    assert!((3..30).contains(&novel.len()), "{}", novel.len());
    novel
}

/// Share of a trip's frames that a model calls novel.
fn novel_share(model: &Arc<Model>, trip: &Trip) -> f64 {
    assert_eq!(model.layout().n_readings(), trip.layout.n_readings());
    let mut classifier = Classifier::new(Arc::clone(model));
    let novelty = model.manifest().novelty;
    let n_novel = trip.frames().filter(|frame| novelty.is_novel(classifier.classify(frame).novelty)).count();
    n_novel as f64 / trip.frames().count() as f64
}

/// Of the second trip as many as are stated at most, and of what is unlike any frame seen nearly all.
fn check(name: &str, model: &Arc<Model>, second: &Trip, unlike: &[(&str, Trip)]) {
    let rate = model.manifest().novelty.false_alarm_rate;
    let of_second = novel_share(model, second);
    let shares: Vec<_> = unlike.iter().map(|(what, trip)| (*what, novel_share(model, trip))).collect();
    let all = format!("{name}: {of_second:.4} of the second trip are novel, {shares:.4?}");
    assert!(of_second <= rate + 0.05, "{all}");
    assert!(shares.iter().all(|(_, share)| *share >= 0.99), "{all}");
}

#[test]
fn crunch_knows_its_building_again_and_calls_what_is_unlike_it_novel() {
    let [first, second] = [1, 2].map(|trip| Trip::driven(Crunch::new(Floor::Fourth, trip, 0), usize::MAX));
    let camera = Trip::driven(Chew::new(1, 0), 100).as_of(first.layout);
    let model = Arc::new(learnt(&first, 7.0));
    let unlike = [
        ("another sensor's frames", camera),
        ("inverted frames", second.inverted(7.0)),
        ("noise", second.noise(7.0)),
    ];
    check("crunch", &model, &second, &unlike);
}

#[test]
fn chew_knows_its_campus_again_and_calls_what_is_unlike_it_novel() {
    let [first, second] = [1, 2].map(|trip| Trip::driven(Chew::new(trip, 0), usize::MAX));
    let model = Arc::new(learnt(&first, 7.5));
    let unlike = [
        ("inverted frames", second.inverted(7.5)),
        ("shuffled frames", second.shuffled()),
        ("noise", second.noise(7.5)),
    ];
    check("chew", &model, &second, &unlike);
}

#[test]
fn recorded_trips_know_their_place_again_and_call_what_is_unlike_it_novel() {
    let trips = |sensor: &str| -> Option<[PathBuf; 2]> {
        let [first, second] = [1, 2].map(|trip| real_trips::trip(&format!("{sensor}-trip{trip}.mcap")));
        Some([first?, second?])
    };
    let (Some(maze), Some(chess)) = (trips("maze-tof16"), trips("chess-depth19840")) else { return };
    let learnt = |trip: &PathBuf| {
        let trained = train(std::slice::from_ref(trip), &Config::default(), &mut |_, _, _| ());
        let model = trained.unwrap().model;
        let range_m_max = model.manifest().plan.response.range_m_max;
        (Arc::new(model), range_m_max)
    };
    let ((model, range_m_max), second) = (learnt(&chess[0]), Trip::recorded(&chess[1]));
    let unlike = [
        ("another sensor's frames", Trip::recorded(&maze[0]).as_of(second.layout)),
        ("inverted frames", second.inverted(range_m_max)),
        ("shuffled frames", second.shuffled()),
        ("noise", second.noise(range_m_max)),
    ];
    check("chess", &model, &second, &unlike);
    let ((model, range_m_max), second) = (learnt(&maze[0]), Trip::recorded(&maze[1]));
    check("maze", &model, &second, &[("inverted frames", second.inverted(range_m_max))]);
}
