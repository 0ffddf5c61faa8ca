//! `kinds serve`: the classifier service of one sensor.

mod metrics;

use std::path::Path;
use std::sync::Arc;

use kinds_messages::{Node, Waiting};
use kinds_model::Classifier;
use kinds_service::{Service, Summary};
use rustix::thread::CpuSet;

use crate::cli::{ServeArguments, ServePlan};
use crate::commands::serve::metrics::Metrics;
use crate::failure::Failure;
use crate::model_file::ModelFailure;
use crate::notify::{Reporter, Supervisor};
use crate::realtime::{self, Realtime};
use crate::say::mention;
use crate::{model_file, stop};

pub(crate) fn run(arguments: &ServeArguments) -> Result<(), Failure> {
    let stop = stop::on_signals()?;
    let reload = stop::reload_on_signal()?;
    let ServePlan { model: path, sensor, busy_poll, realtime, metrics } = arguments.plan()?;
    let supervisor = Supervisor::from_environment();
    let classifier = open_ready(&path)?;
    let model = classifier.model();
    let mut serving = format!(
        "serving {sensor}: {} kinds of {}, model {}",
        model.mixture().n_kinds(),
        model.layout(),
        model.id()
    );
    let domain = arguments.domain.join(&stop);
    let node = Node::open(&domain, "kinds-serve")?;
    let waiting = if busy_poll { Waiting::Polling } else { Waiting::ByEvent };
    let mut service = Service::start_with(&node, &sensor, classifier, waiting)?;
    // Where other threads are to run, whatever this one asks for.
    let processors = realtime::processors();
    let beside = realtime.clone();
    let for_opening = supervisor.clone();
    let open = Arc::new(move |path: &Path| {
        for_opening.reloading();
        open_beside(path, &beside, processors)
    });
    let path = std::path::absolute(&path).map_err(|error| Failure::file("find model", &path, &error))?;
    service.accept_reloads(&path, open, reload)?;
    let metrics = metrics.map(|address| Metrics::listen(address, &sensor)).transpose()?;
    // When all is mapped that can be before a driver shim comes, and nothing that frames do not need.
    serving += &realtime.apply();
    let mut scrapes = metrics.map(|metrics| {
        serving += &format!("; metrics at http://{}/metrics", metrics.address());
        metrics.start(processors)
    });
    let mut reporter = Reporter::new(supervisor.clone(), sensor);
    service.listen_to_health(move |health| {
        reporter.tell(health);
        scrapes.iter_mut().for_each(|tell| tell(health));
    });
    supervisor.ready(&serving);
    mention(serving)?;
    let served = service.run(&stop);
    supervisor.stopping();
    say_summary(&served?)
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
