//! `kinds serve`: the classifier service of one sensor.

use std::sync::Arc;

use kinds_messages::{Node, Waiting};
use kinds_model::Classifier;
use kinds_service::Service;

use crate::cli::ServeArguments;
use crate::failure::Failure;
use crate::say::mention;
use crate::{locked_memory, model_file, stop};

pub(crate) fn run(arguments: &ServeArguments) -> Result<(), Failure> {
    let stop = stop::on_signals()?;
    let model = Arc::new(model_file::open(&arguments.model)?);
    let domain = arguments.domain.join(&stop);
    let node = Node::open(&domain, "kinds-serve")?;
    let sensor = &arguments.sensor;
    let waiting = if arguments.busy_poll { Waiting::Polling } else { Waiting::ByEvent };
    let mut classifier = Classifier::new(Arc::clone(&model));
    classifier.warm_up();
    let mut service = Service::start_with(&node, sensor, classifier, waiting)?;
    // Last, when all is mapped that can be before a driver shim comes.
    let memory = match arguments.lock_memory.then(locked_memory::lock) {
        None => "",
        Some(Ok(())) => "; memory is locked",
        Some(Err(not_locked)) => {
            tracing::warn!("{not_locked}");
            "; memory is not locked"
        }
    };
    mention(format!(
        "serving {sensor}: {} kinds of {}, model {}{memory}",
        model.mixture().n_kinds(),
        model.layout(),
        model.id()
    ))?;
    let summary = service.run(&stop)?;
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
