//! `kinds train`: recorded trips → model file.

use std::io::Write;
use std::path::Path;

use kinds_model::{KindsTrial, Manifest, Method, Model, Scale};
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
    for line in choices(&model) {
        writeln!(out, "{line}")?;
    }
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
    let Manifest { plan, n_frames, n_dims, n_kinds, provenance, .. } = model.manifest();
    format!(
        "learnt {n_kinds} {} from {n_frames} frames of {} readings: {} of {} in {n_dims} dimensions, residual variance \
         {:.4}",
        if *n_kinds == 1 { "kind" } else { "kinds" },
        plan.sensor.n_readings(),
        method_name(plan.method),
        scale_name(plan.response.scale),
        provenance.residual_variance[n_dims - 1],
    )
}

/// What was left to the evidence, and why it came out so, in a line each.
pub(crate) fn choices(model: &Model) -> Vec<String> {
    let Manifest { plan, n_frames, n_dims, n_kinds, provenance, .. } = model.manifest();
    let mut lines = Vec::new();
    if plan.n_dims.is_none() {
        let elbow = provenance.elbow;
        lines.push(format!(
            "dimensions: {n_dims}, the elbow of the residual variance at {elbow} and {} more",
            n_dims - elbow
        ));
    }
    let mut tried: Vec<&KindsTrial> = provenance.kinds_tried.iter().collect();
    tried.sort_by(|a, b| a.bic_neff.total_cmp(&b.bic_neff));
    if let [best, second, ..] = tried[..] {
        lines.push(format!(
            "kinds: {n_kinds}, the least BIC_neff of 1 to {}: {:.1} nats, {:.1} less than {} kinds; {n_frames} frames \
             count as {:.0} independent ones",
            tried.len(),
            best.bic_neff,
            second.bic_neff - best.bic_neff,
            second.n_kinds,
            provenance.n_frames_effective,
        ));
    }
    lines
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
