//! Progress bars on standard error, for steps that take over a second.

use std::time::{Duration, Instant};

use indicatif::{ProgressBar, ProgressDrawTarget, ProgressStyle};
use kinds_model::Step;
use kinds_trainer::Stage;

/// A step that ends sooner is not worth a bar.
const PATIENCE: Duration = Duration::from_secs(1);

/// Shows one step after the other, until it goes out of scope. Shows nothing when standard error is not a terminal.
pub(crate) struct StepBar {
    name: String,
    started: Instant,
    bar: Option<ProgressBar>,
}

impl StepBar {
    pub(crate) fn new() -> Self {
        Self { name: String::new(), started: Instant::now(), bar: None }
    }

    /// Told how much of a stage is done.
    pub(crate) fn show(&mut self, stage: Stage, done: u64, all: u64) {
        let name = match stage {
            Stage::Reading(path) => {
                format!("reading {}", path.file_name().unwrap_or(path.as_os_str()).to_string_lossy())
            }
            Stage::Fitting(Step::References) => "reference frames".to_string(),
            Stage::Fitting(Step::Neighbors) => "nearest neighbours".to_string(),
            Stage::Fitting(Step::Neighborhood) => "number of neighbours".to_string(),
            Stage::Fitting(Step::Geodesics) => "geodesics".to_string(),
            Stage::Fitting(Step::Embedding) => "embedding".to_string(),
            Stage::Fitting(Step::Kinds) => "kinds".to_string(),
            Stage::Classifying => "classifying".to_string(),
            Stage::Comparing => "comparing".to_string(),
        };
        if self.name != name {
            self.clear();
            self.name = name;
            self.started = Instant::now();
        }
        if self.bar.is_none() && self.started.elapsed() >= PATIENCE && done < all {
            let style = ProgressStyle::with_template("{msg:24} {bar:40} {percent:>3} %  {eta} left");
            let bar = ProgressBar::with_draw_target(Some(all), ProgressDrawTarget::stderr());
            bar.set_style(style.expect("the template is as it should be"));
            self.bar = Some(bar.with_message(self.name.clone()).with_elapsed(self.started.elapsed()));
        }
        if let Some(bar) = &self.bar {
            bar.set_length(all);
            bar.set_position(done);
        }
    }

    /// Takes the bar off the terminal.
    fn clear(&mut self) {
        if let Some(bar) = self.bar.take() {
            bar.finish_and_clear();
        }
    }
}

/// Also where the work fails.
impl Drop for StepBar {
    fn drop(&mut self) {
        self.clear();
    }
}
