//! `kinds serve`: the classifier service of one sensor.

use std::io::Write;
use std::sync::Arc;

use kinds_messages::Node;
use kinds_model::Classifier;
use kinds_service::Service;

use crate::cli::ServeArguments;
use crate::failure::Failure;
use crate::{model_file, stop};

pub(crate) fn run(arguments: &ServeArguments) -> Result<(), Failure> {
    let stop = stop::on_signals()?;
    let model = Arc::new(model_file::open(&arguments.model)?);
    let node = Node::open(&arguments.domain.domain(), "kinds-serve")?;
    let sensor = &arguments.sensor;
    let mut service = Service::start(&node, sensor, Classifier::new(Arc::clone(&model)))?;
    say(&format!(
        "serving {sensor}: {} kinds of {}, model {}",
        model.mixture().n_kinds(),
        model.layout(),
        model.id()
    ))?;
    let summary = service.run(&stop)?;
    say(&format!(
        "served {} frames: {} classified, {} invalid, {} repeated, {} refused; {} lost",
        summary.n_frames,
        summary.n_classified,
        summary.n_invalid,
        summary.n_repeated,
        summary.n_refused,
        summary.n_lost,
    ))
}

/// A line for whoever started the service. That nobody reads it is no reason to stop serving.
fn say(line: &str) -> Result<(), Failure> {
    let mut out = std::io::stdout().lock();
    match writeln!(out, "{line}").and_then(|()| out.flush()) {
        Err(error) if error.kind() != std::io::ErrorKind::BrokenPipe => Err(error.into()),
        _ => Ok(()),
    }
}
