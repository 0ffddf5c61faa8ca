//! Models of the simulated robots, and frames of another trip to classify with them.

use std::path::{Path, PathBuf};
use std::sync::Arc;

use kinds_model::{Model, Origin, file, fit};
use tempfile::TempDir;

use crate::simulated::{CLASSIFIED, LEARNT, Simulated};

const N_QUERIES: usize = 500;

/// A model, the same in a file, and frames for it.
pub(crate) struct Trained {
    pub(crate) title: String,
    pub(crate) model: Arc<Model>,
    pub(crate) queries: Vec<Vec<u16>>,
    folder: TempDir,
}

impl Trained {
    pub(crate) fn on(robot: &Simulated, n_frames: usize) -> Self {
        let plan = robot.plan(n_frames);
        let model = fit(robot.frames(LEARNT, n_frames), &plan, Origin::default(), &mut |_, _, _| ());
        let model = Arc::new(model.expect("a simulated trip makes a model"));
        let folder = tempfile::Builder::new().prefix("k").tempdir().expect("there is a temporary folder");
        std::fs::write(model_in(folder.path()), file::to_bytes(&model))
            .expect("a model can be written there");
        let queries = robot.frames(CLASSIFIED, N_QUERIES);
        let queries = queries.chunks_exact(plan.sensor.n_readings()).map(<[u16]>::to_vec).collect();
        Self { title: robot.title(), model, queries, folder }
    }

    /// The model's file.
    pub(crate) fn file(&self) -> PathBuf {
        model_in(self.folder.path())
    }
}

fn model_in(folder: &Path) -> PathBuf {
    folder.join("m.kinds")
}
