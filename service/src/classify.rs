//! What the service asks of a model.

use kinds_messages::KindReport;
use kinds_model::{Classification, Classifier, Command, Filter, MedianFilter, ModelId, SensorLayout};

use crate::DriftWindow;

/// Turns frames into kind probabilities: [`Classifier`] on a robot, a stand-in in tests.
pub trait Classify {
    /// The sensor whose frames are understood.
    fn layout(&self) -> SensorLayout;

    /// Which model this is.
    fn model_id(&self) -> ModelId;

    /// Says in a report what follows from the model alone: its id, its kinds' numbers, and which are most alike.
    fn introduce(&self, report: &mut KindReport);

    /// Whether frames are compared by commands beside their readings.
    fn compares_commands(&self) -> bool;

    /// Whether a frame of such a novelty is called unlike what the model has seen.
    fn is_novel(&self, novelty: f64) -> bool;

    /// What frames pass in their order before they are classified, if anything.
    fn median(&self) -> Option<MedianFilter>;

    /// Takes kinds of frames in their order into account, beginning with none.
    fn filter(&self) -> Filter;

    /// Takes note of how far frames are from those that the model was learnt from, beginning with none.
    fn drift(&self) -> DriftWindow;

    /// Half-split error of the frame that was classified last, a share of the radius of all trained places.
    fn half_split_error(&mut self) -> Option<f64>;

    /// Classifies one frame of raw counts, `(n_readings,)`. The service only calls it with frames of
    /// [`layout`](Self::layout).
    ///
    /// * `command` — what the robot had been told, where the frame says so
    fn classify(&mut self, counts: &[u16], command: Option<Command>) -> &Classification;
}

impl Classify for Classifier {
    fn layout(&self) -> SensorLayout {
        self.model().layout()
    }

    fn model_id(&self) -> ModelId {
        self.model().id()
    }

    fn introduce(&self, report: &mut KindReport) {
        let numbers = self.model().register().kinds().iter().map(|record| record.number);
        report.model_id = self.model().id().0;
        report.set_kinds(numbers, self.model().manifest().merges.iter().copied());
    }

    fn compares_commands(&self) -> bool {
        self.model().commands().is_some()
    }

    fn is_novel(&self, novelty: f64) -> bool {
        self.model().manifest().novelty.is_novel(novelty)
    }

    fn median(&self) -> Option<MedianFilter> {
        self.model().median()
    }

    fn filter(&self) -> Filter {
        self.model().filter()
    }

    fn drift(&self) -> DriftWindow {
        let manifest = self.model().manifest();
        DriftWindow::new(
            self.model().mixture().weights(),
            manifest.novelty.false_alarm_rate,
            manifest.half_split.map(|half_split| half_split.usual),
        )
    }

    fn half_split_error(&mut self) -> Option<f64> {
        Self::half_split_error(self)
    }

    fn classify(&mut self, counts: &[u16], command: Option<Command>) -> &Classification {
        self.classify_commanded(counts, command)
    }
}
