//! Models of the simulated robots, and frames of another trip to classify with them.

use std::path::{Path, PathBuf};
use std::sync::Arc;

use kinds_driver_shim::simulated::{Chew, Crunch, Floor, Robot};
use kinds_model::{
    EmPlan, FitPlan, KindsBy, LandmarkChoice, Method, MetricPlan, Model, Origin, ResponsePlan, Scale,
    SensorLayout, file, fit,
};
use tempfile::TempDir;

/// Trip of the frames that are classified; the reference frames are of those before it.
const TRIP_CLASSIFIED: u32 = 100;
const N_QUERIES: usize = 500;

pub(crate) struct RobotSetting {
    name: &'static str,
    drive: fn(trip: u32) -> Box<dyn Robot>,
    range_m_max: f64,
    n_dims: usize,
}

pub(crate) const ROBOTS: [&RobotSetting; 2] = [
    &RobotSetting {
        name: "ring of 16 readings",
        drive: |trip| Box::new(Crunch::new(Floor::Fourth, trip, 0)),
        range_m_max: 7.0,
        n_dims: 8,
    },
    &RobotSetting {
        name: "camera of 19840 readings",
        drive: |trip| Box::new(Chew::new(trip, 0)),
        range_m_max: 7.5,
        n_dims: 15,
    },
];

/// A model, the same in a file, and frames for it.
pub(crate) struct Trained {
    pub(crate) name: &'static str,
    pub(crate) model: Arc<Model>,
    pub(crate) queries: Vec<Vec<u16>>,
    folder: TempDir,
}

impl Trained {
    pub(crate) fn on(setting: &RobotSetting, n_frames: usize) -> Self {
        let layout = (setting.drive)(0).layout();
        let sensor = SensorLayout {
            rows: layout.rows,
            columns: layout.columns,
            metres_per_count: layout.metres_per_count,
        };
        let plan = FitPlan {
            sensor,
            response: ResponsePlan::new(Scale::Inverse, setting.range_m_max),
            metric: MetricPlan::Euclidean,
            n_frames_max: n_frames,
            method: Method::Isomap,
            n_neighbors: Some(10),
            consecutive_edges: false,
            n_landmarks: 500,
            landmark_choice: LandmarkChoice::Random,
            n_dims: Some(setting.n_dims),
            n_kinds: Some(8),
            kinds_by: KindsBy::BicNeff,
            em: EmPlan { n_starts: 1, ..EmPlan::new(0) },
            seed: 0,
        };
        let counts = frames((0..TRIP_CLASSIFIED).map(setting.drive), n_frames).concat();
        let model = fit(counts, &plan, Origin::default(), &mut |_, _, _| ());
        let model = Arc::new(model.expect("a simulated trip makes a model"));
        let folder = tempfile::Builder::new().prefix("k").tempdir().expect("there is a temporary folder");
        std::fs::write(model_in(folder.path()), file::to_bytes(&model))
            .expect("a model can be written there");
        let queries = frames([(setting.drive)(TRIP_CLASSIFIED)], N_QUERIES);
        Self { name: setting.name, model, queries, folder }
    }

    /// The model's file.
    pub(crate) fn file(&self) -> PathBuf {
        model_in(self.folder.path())
    }
}

fn model_in(folder: &Path) -> PathBuf {
    folder.join("m.kinds")
}

/// As many frames of some robots, one after the other.
fn frames(robots: impl IntoIterator<Item = Box<dyn Robot>>, n_frames: usize) -> Vec<Vec<u16>> {
    let driven = robots.into_iter().flat_map(|mut robot| {
        let n_readings = (robot.layout().rows * robot.layout().columns) as usize;
        std::iter::from_fn(move || {
            let mut frame = vec![0; n_readings];
            robot.step(&mut frame).map(|_| frame)
        })
    });
    driven.take(n_frames).collect()
}
