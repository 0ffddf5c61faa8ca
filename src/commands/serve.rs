//! `kinds serve`: the classifier service of one sensor.

mod metrics;

use std::path::Path;
use std::sync::Arc;

use kinds_messages::{Node, Waiting};
use kinds_model::Classifier;
use kinds_service::{Service, Summary};
use rustix::thread::CpuSet;

use crate::cli::ServeArguments;
use crate::commands::serve::metrics::Metrics;
use crate::failure::Failure;
use crate::model_file::ModelFailure;
use crate::realtime::{self, Realtime};
use crate::say::mention;
use crate::{model_file, stop};

pub(crate) fn run(arguments: &ServeArguments) -> Result<(), Failure> {
    let stop = stop::on_signals()?;
    let reload = stop::reload_on_signal()?;
    let realtime = realtime(arguments)?;
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
    // Where other threads are to run, whatever this one asks for.
    let processors = realtime::processors();
    let beside = realtime.clone();
    let open = Arc::new(move |path: &Path| open_beside(path, &beside, processors));
    let path = std::path::absolute(&arguments.model)
        .map_err(|error| Failure::file("find model", &arguments.model, &error))?;
    service.accept_reloads(&path, open, reload)?;
    let metrics = arguments.metrics.map(|address| Metrics::listen(address, &arguments.sensor)).transpose()?;
    // When all is mapped that can be before a driver shim comes, and nothing that frames do not need.
    serving += &realtime.apply();
    if let Some(metrics) = metrics {
        serving += &format!("; metrics at http://{}/metrics", metrics.address());
        service.listen_to_health(metrics.start(processors));
    }
    mention(serving)?;
    say_summary(&service.run(&stop)?)
}

/// What is asked of the system, by file and flag.
fn realtime(arguments: &ServeArguments) -> Result<Realtime, Failure> {
    let mut realtime = Realtime::default();
    if let Some(path) = &arguments.realtime {
        let text = std::fs::read_to_string(path)
            .map_err(|error| Failure::file("read real-time settings", path, &error))?;
        realtime = Realtime::from_ron(&text).map_err(|error| {
            Failure::AskedWrongly(format!("real-time settings {}: {error}", path.display()))
        })?;
    }
    realtime.lock_memory |= arguments.lock_memory;
    Ok(realtime)
}

/// Opens a model, warm for the first frame.
fn open_ready(path: &Path) -> Result<Classifier, ModelFailure> {
    let mut classifier = Classifier::new(Arc::new(model_file::open(path)?));
    classifier.warm_up();
    Ok(classifier)
}

/// The same on another thread while a model is served.
fn open_beside(path: &Path, realtime: &Realtime, processors: Option<CpuSet>) -> Result<Classifier, String> {
    realtime::return_to(processors);
    let classifier = open_ready(path).map_err(|failure| failure.to_string())?;
    realtime.lock_what_came();
    Ok(classifier)
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
