//! `kinds train`: recorded trips → model file.

use std::io::Write;
use std::path::Path;

use kinds_model::{Method, Model, Scale};
use kinds_trainer::{Config, Trained};

use crate::cli::TrainArguments;
use crate::failure::Failure;
use crate::model_file;
use crate::progress::StepBar;

pub(crate) fn run(arguments: TrainArguments) -> Result<(), Failure> {
    let flags = arguments.config();
    let config = match &arguments.config {
        Some(path) => read_config(path)?.overridden_by(flags),
        None => flags,
    };
    model_file::check_writable(&arguments.output)?;
    let Trained { model, remarks } = train(&arguments.trips, &config)?;
    for remark in remarks {
        eprintln!("kinds: {remark}");
    }
    let n_bytes = model_file::write(&arguments.output, &model)?;
    let (path, n_mb) = (arguments.output.display(), n_bytes as f64 / 1e6);
    let mut out = std::io::stdout().lock();
    writeln!(out, "{}", summary(&model))?;
    writeln!(out, "wrote {path} ({n_mb:.1} MB, model {})", model.id())?;
    Ok(())
}

/// Trains with a progress bar.
pub(crate) fn train(trips: &[std::path::PathBuf], config: &Config) -> Result<Trained, Failure> {
    let mut bar = StepBar::new();
    let trained = kinds_trainer::train(trips, config, &mut |stage, done, all| bar.show(stage, done, all));
    bar.clear();
    Ok(trained?)
}

fn read_config(path: &Path) -> Result<Config, Failure> {
    let text =
        std::fs::read_to_string(path).map_err(|error| Failure::file("read configuration", path, &error))?;
    Config::from_ron(&text)
        .map_err(|error| Failure::AskedWrongly(format!("configuration {}: {error}", path.display())))
}

/// What was learnt, in a line.
pub(crate) fn summary(model: &Model) -> String {
    let (plan, provenance) = (&model.manifest().plan, &model.manifest().provenance);
    format!(
        "learnt {} kinds from {} frames of {} readings: {} of {} in {} dimensions, residual variance {:.4}",
        plan.em.n_kinds,
        model.manifest().n_frames,
        plan.sensor.n_readings(),
        method_name(plan.method),
        scale_name(plan.response.scale),
        plan.n_dims,
        provenance.residual_variance[plan.n_dims - 1],
    )
}

pub(crate) fn method_name(method: Method) -> &'static str {
    match method {
        Method::Isomap => "Isomap",
        Method::Pca => "principal components",
    }
}

pub(crate) fn scale_name(scale: Scale) -> &'static str {
    match scale {
        Scale::Range => "ranges",
        Scale::Log => "log ranges",
        Scale::Inverse => "inverse ranges",
    }
}
