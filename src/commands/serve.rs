//! `kinds serve`: the classifier service of one sensor.

mod metrics;

use std::path::Path;
use std::sync::Arc;

use kinds_messages::{Node, Waiting};
use kinds_model::Classifier;
use kinds_service::{Service, Summary};

use crate::cli::ServeArguments;
use crate::commands::serve::metrics::Metrics;
use crate::failure::Failure;
use crate::model_file::ModelFailure;
use crate::say::mention;
use crate::{locked_memory, model_file, stop};

pub(crate) fn run(arguments: &ServeArguments) -> Result<(), Failure> {
    let stop = stop::on_signals()?;
    let reload = stop::reload_on_signal()?;
    let classifier = open_ready(&arguments.model)?;
    let model = classifier.model();
    let mut serving = format!(
        "serving {}: {} kinds of {}, model {}",
        arguments.sensor,
        model.mixture().n_kinds(),
        model.layout(),
        model.id()
    );
    let domain = arguments.domain.join(&stop);
    let node = Node::open(&domain, "kinds-serve")?;
    let waiting = if arguments.busy_poll { Waiting::Polling } else { Waiting::ByEvent };
    let mut service = Service::start_with(&node, &arguments.sensor, classifier, waiting)?;
    let lock_memory = arguments.lock_memory;
    let open = Arc::new(move |path: &Path| open_beside(path, lock_memory));
    let path = std::path::absolute(&arguments.model)
        .map_err(|error| Failure::file("find model", &arguments.model, &error))?;
    service.accept_reloads(&path, open, reload)?;
    let metrics = arguments.metrics.map(|address| Metrics::listen(address, &arguments.sensor)).transpose()?;
    // When all is mapped that can be before a driver shim comes, and nothing that frames do not need.
    if lock_memory {
        serving += if lock() { "; memory is locked" } else { "; memory is not locked" };
    }
    if let Some(metrics) = metrics {
        serving += &format!("; metrics at http://{}/metrics", metrics.address());
        service.listen_to_health(metrics.start());
    }
    mention(serving)?;
    say_summary(&service.run(&stop)?)
}

/// Opens a model, warm for the first frame.
fn open_ready(path: &Path) -> Result<Classifier, ModelFailure> {
    let mut classifier = Classifier::new(Arc::new(model_file::open(path)?));
    classifier.warm_up();
    Ok(classifier)
}

/// The same while another model is served.
fn open_beside(path: &Path, lock_memory: bool) -> Result<Classifier, String> {
    let classifier = open_ready(path).map_err(|failure| failure.to_string())?;
    if lock_memory {
        lock();
    }
    Ok(classifier)
}

/// Locks all memory, or says why not. Returns whether it is locked.
fn lock() -> bool {
    let locked = locked_memory::lock();
    if let Err(not_locked) = &locked {
        tracing::warn!("{not_locked}");
    }
    locked.is_ok()
}

fn say_summary(summary: &Summary) -> Result<(), Failure> {
    mention(format!(
        "served {} frames: {} classified, {} invalid, {} repeated, {} refused; {} lost{}",
        summary.n_frames,
        summary.n_classified,
        summary.n_invalid,
        summary.n_repeated,
        summary.n_refused,
        summary.n_lost,
        match summary.n_uncommanded {
            0 => String::new(),
            n => format!("; {n} without a command, taken as standing still"),
        },
    ))
}
