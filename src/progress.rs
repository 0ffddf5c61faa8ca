//! Progress bars on standard error, for steps that take over a second.

use std::path::Path;
use std::time::{Duration, Instant};

use indicatif::{ProgressBar, ProgressDrawTarget, ProgressStyle};
use kinds_model::Step;

/// A step that ends sooner is not worth a bar.
const PATIENCE: Duration = Duration::from_secs(1);

/// Shows one step after the other. Shows nothing when standard error is not a terminal.
pub(crate) struct StepBar {
    name: String,
    started: Instant,
    bar: Option<ProgressBar>,
}

impl StepBar {
    pub(crate) fn new() -> Self {
        Self { name: String::new(), started: Instant::now(), bar: None }
    }

    /// Told bytes read of a trip.
    pub(crate) fn reading(&mut self, path: &Path, read: u64, all: u64) {
        let name = path.file_name().unwrap_or(path.as_os_str()).to_string_lossy();
        self.show(&format!("reading {name}"), read, all);
    }

    /// Told a step of fitting.
    pub(crate) fn fitting(&mut self, step: Step, done: usize, all: usize) {
        let name = match step {
            Step::Neighbors => "nearest neighbours",
            Step::Geodesics => "geodesics",
            Step::Embedding => "embedding",
            Step::Kinds => "kinds",
        };
        self.show(name, done as u64, all as u64);
    }

    fn show(&mut self, name: &str, done: u64, all: u64) {
        if self.name != name {
            self.clear();
            self.name = name.to_string();
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
    pub(crate) fn clear(&mut self) {
        if let Some(bar) = self.bar.take() {
            bar.finish_and_clear();
        }
    }
}
