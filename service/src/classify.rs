//! What the service asks of a model.

use kinds_model::{Classification, Classifier, ModelId, SensorLayout};

/// Turns frames into kind probabilities: [`Classifier`] on a robot, a stand-in in tests.
pub trait Classify {
    /// The sensor whose frames are understood.
    fn layout(&self) -> SensorLayout;

    /// Which model this is.
    fn model_id(&self) -> ModelId;

    /// Classifies one frame of raw counts, `(n_readings,)`. The service only calls it with frames of
    /// [`layout`](Self::layout).
    fn classify(&mut self, counts: &[u16]) -> &Classification;
}

impl Classify for Classifier {
    fn layout(&self) -> SensorLayout {
        self.model().layout()
    }

    fn model_id(&self) -> ModelId {
        self.model().id()
    }

    fn classify(&mut self, counts: &[u16]) -> &Classification {
        Classifier::classify(self, counts)
    }
}
