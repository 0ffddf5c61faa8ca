//! `kinds train`: recorded trips → model file, or model files by both methods, and a report.

mod report;

use std::path::{Path, PathBuf};

use kinds_model::evidence::{best_by_bound, of_at_least, runner_up_by_bound};
use kinds_model::neighborhood::{candidates, chosen, runner_up, short_circuits};
use kinds_model::residual_variance::TOLERANCE;
use kinds_model::{
    ComparisonTrial, FitPlan, IntrinsicDims, KindsBy, KindsTrial, Manifest, Method, MetricPlan, Model,
    NeighborsTrial, Provenance, Scale, WhiteningPlan,
};
use kinds_trainer::report::kinds_agreement;
use kinds_trainer::{Config, MethodChoice, PcaModels, Trained, kept_by_each};

use crate::cli::TrainArguments;
use crate::failure::Failure;
use crate::progress::StepBar;
use crate::say::mention;
use crate::{log, model_file, report_folder, ron_file};

pub(crate) fn run(arguments: TrainArguments) -> Result<(), Failure> {
    let flags = arguments.config();
    let config = match &arguments.config {
        Some(path) => ron_file::read::<Config>("configuration", path)?.overridden_by(flags),
        None => flags,
    };
    let paths = ModelPaths::beside(&arguments.output);
    check_writable(&paths, &arguments, &config)?;
    let trained = train(&arguments.trips, &config)?;
    for remark in &trained.remarks {
        log::notice(remark);
    }
    write_and_say(&paths.own, &trained.model)?;
    if let Some(pca) = &trained.pca {
        write_and_say(&paths.pca, &pca.own)?;
        if let Some(matched) = &pca.matched {
            write_and_say(&paths.pca_matched, matched)?;
        }
        mention(agreement(&trained.model, pca))?;
    }
    if let Some(folder) = &arguments.report {
        let page = report_folder::write(folder, &report::page(&trained))?;
        mention(format!("wrote {}", page.display()))?;
    }
    Ok(())
}

/// Where the models go. Those of principal components beside Isomap's have its name with a word in it.
struct ModelPaths {
    own: PathBuf,
    pca: PathBuf,
    pca_matched: PathBuf,
}

impl ModelPaths {
    fn beside(output: &Path) -> Self {
        let with_word = |word: &str| {
            let mut name = output.file_stem().unwrap_or_default().to_os_string();
            name.push(format!(".{word}"));
            if let Some(extension) = output.extension() {
                name.push(".");
                name.push(extension);
            }
            output.with_file_name(name)
        };
        Self { own: output.to_path_buf(), pca: with_word("pca"), pca_matched: with_word("pca-matched") }
    }
}

/// Finds out, before long work, whether all that is asked for can be written.
fn check_writable(paths: &ModelPaths, arguments: &TrainArguments, config: &Config) -> Result<(), Failure> {
    model_file::check_writable(&paths.own)?;
    if config.method == Some(MethodChoice::Both) {
        model_file::check_writable(&paths.pca)?;
        model_file::check_writable(&paths.pca_matched)?;
    }
    arguments.report.as_deref().map_or(Ok(()), report_folder::check_writable)
}

fn write_and_say(path: &Path, model: &Model) -> Result<(), Failure> {
    let n_mb = model_file::write(path, model)? as f64 / 1e6;
    mention(summary(model))?;
    for line in choices(model) {
        mention(line)?;
    }
    mention(format!("wrote {} ({n_mb:.1} MB, model {})", path.display(), model.id()))
}

/// How alike the kinds of both methods are.
fn agreement(isomap: &Model, pca: &PcaModels) -> String {
    let agreement = |model: &Model| {
        let (n_dims, n_kinds) = (model.manifest().n_dims, model.mixture().n_kinds());
        let ami = kinds_agreement(isomap, model);
        format!("{ami:.2} at {n_dims} dimensions and {n_kinds} {}", kinds_word(n_kinds))
    };
    let agreements: Vec<String> = std::iter::once(&pca.own).chain(&pca.matched).map(agreement).collect();
    format!(
        "principal components' kinds of these frames agree with Isomap's (adjusted mutual information): {}",
        agreements.join(", ")
    )
}

fn kinds_word(n_kinds: usize) -> &'static str {
    if n_kinds == 1 { "kind" } else { "kinds" }
}

/// Trains with a progress bar.
pub(crate) fn train(trips: &[PathBuf], config: &Config) -> Result<Trained, Failure> {
    let mut bar = StepBar::new();
    Ok(kinds_trainer::train(trips, config, &mut |stage, done, all| bar.show(stage, done, all))?)
}

/// What was learnt, in a line.
pub(crate) fn summary(model: &Model) -> String {
    let Manifest { plan, n_trained, n_dims, n_kinds, provenance, .. } = model.manifest();
    let left = provenance.residual_variance.get(n_dims - 1);
    // What is usual need not be said.
    let compared = match plan.metric {
        MetricPlan::Euclidean => String::new(),
        _ => format!(" by {}", plan.metric),
    };
    format!(
        "learnt {n_kinds} {} from {n_trained} frames of {} readings: {} of {}{compared}{} in {n_dims} dimensions{}",
        kinds_word(*n_kinds),
        plan.sensor.n_readings(),
        method_name(plan),
        scale_name(plan.response.scale),
        if model.commands().is_some() { " and commands" } else { "" },
        left.map(|left| format!(", residual variance {left:.4}")).unwrap_or_default(),
    )
}

/// What was left out or left to the evidence, and why it came out so, in a line each.
pub(crate) fn choices(model: &Model) -> Vec<String> {
    let Manifest { plan, n_trained, n_dims, n_kinds, provenance, .. } = model.manifest();
    let mut lines: Vec<String> = reference_choice(model).into_iter().collect();
    lines.extend(comparison_choice(plan, &provenance.origin.comparisons_tried));
    lines.extend(neighbors_choice(&provenance.neighbors_tried));
    if plan.n_dims.is_none() && model.embedding().is_some() {
        let elbow = provenance.elbow;
        let beyond = match n_dims.checked_sub(elbow) {
            Some(n_more) => format!("the elbow of the residual variance at {elbow} and {n_more} more"),
            None => format!("all slow directions; the elbow of the residual variance at {elbow}"),
        };
        lines.push(format!(
            "dimensions: {n_dims}, {beyond}; within {TOLERANCE} of the least from {} on",
            provenance.n_dims_within_tolerance,
        ));
        lines.push(format!("intrinsic dimension: {}", intrinsic(&provenance.intrinsic_dims)));
    }
    if let Some(choice) = kinds_choice(plan, provenance) {
        lines.push(format!(
            "kinds: {n_kinds}, {choice}; {n_trained} frames count as {:.0} independent ones",
            provenance.n_frames_effective,
        ));
    }
    lines
}

/// By what frames are compared, where that was chosen, and what spoke for each.
fn comparison_choice(plan: &FitPlan, tried: &[ComparisonTrial]) -> Option<String> {
    let scale = scale_name(plan.response.scale);
    let chosen = match plan.whitening {
        None => scale.to_string(),
        Some(WhiteningPlan { n_directions, .. }) => format!("{scale} along {n_directions} slow directions"),
    };
    (!tried.is_empty()).then(|| format!("compared by: {chosen}; {}", kept_by_each(tried)))
}

/// How many frames were kept, where not all were.
fn reference_choice(model: &Model) -> Option<String> {
    let Manifest { n_trained, n_frames, provenance, .. } = model.manifest();
    (n_frames < n_trained).then(|| {
        format!(
            "reference frames: kept {n_frames} of {n_trained} frames, each of which is within {:.0} counts of one; kinds are \
             learnt from all",
            provenance.covering_radius
        )
    })
}

/// What chose the number of kinds, and its runner-up.
fn kinds_choice(plan: &FitPlan, provenance: &Provenance) -> Option<String> {
    if let Some(process) = &provenance.dirichlet {
        let best = best_by_bound(&process.trials)?;
        let mut choice = format!(
            "kept by a Dirichlet process of concentration {}: lower bound of ln evidence {:.1} nats",
            process.concentration, best.lower_bound
        );
        if let Some(second) = runner_up_by_bound(&process.trials) {
            let (more, n_kinds) = (best.lower_bound - second.lower_bound, second.n_kinds);
            choice += &format!(", {more:.1} more than {n_kinds} {}", kinds_word(n_kinds));
        }
        return Some(choice);
    }
    // Lower is better.
    let cost = |trial: &KindsTrial| match plan.kinds_by {
        KindsBy::HeldOut => -trial.held_out,
        _ => trial.bic_neff,
    };
    let (least, most) = (plan.n_kinds_min, provenance.kinds_tried.len());
    let mut tried: Vec<&KindsTrial> = of_at_least(&provenance.kinds_tried, least).iter().collect();
    tried.sort_by(|a, b| cost(a).total_cmp(&cost(b)));
    let [best, second, ..] = tried[..] else { return None };
    let (worse, n_kinds) = (cost(second) - cost(best), second.n_kinds);
    let word = kinds_word(n_kinds);
    Some(match plan.kinds_by {
        KindsBy::HeldOut => format!(
            "of {least} to {most} the likeliest for blocks that were held out: {:.3} nats per frame, {worse:.3} more than \
             {n_kinds} {word}",
            best.held_out
        ),
        _ => format!(
            "the least BIC_neff of {least} to {most}: {:.1} nats, {worse:.1} less than {n_kinds} {word}",
            best.bic_neff
        ),
    })
}

/// The number of neighbours that was chosen, its runner-up, and where there may be short circuits.
fn neighbors_choice(tried: &[NeighborsTrial]) -> Option<String> {
    let (best, candidates) = (chosen(tried)?, candidates(tried));
    let mut line = format!(
        "neighbours: {}, the fewest of {} to {} whose residual variance is within {TOLERANCE} of the least: {:.4} in {} \
         dimensions",
        best.n_neighbors,
        candidates[0].n_neighbors,
        candidates[candidates.len() - 1].n_neighbors,
        best.residual_variance,
        best.n_dims,
    );
    if let Some(second) = runner_up(tried) {
        line += &format!("; {:.4} with {}", second.residual_variance, second.n_neighbors);
    }
    let circuits: Vec<String> =
        short_circuits(tried).iter().map(|&index| tried[index].n_neighbors.to_string()).collect();
    if !circuits.is_empty() {
        line += &format!("; perhaps short circuits at {}", circuits.join(", "));
    }
    Some(line)
}

/// Both estimates of the intrinsic dimension.
pub(crate) fn intrinsic(dims: &IntrinsicDims) -> String {
    let number = |dims: Option<f64>| dims.map_or("unknown".to_string(), |dims| format!("{dims:.1}"));
    format!(
        "{} by two nearest neighbours, {} by maximum likelihood",
        number(dims.two_nn),
        number(dims.maximum_likelihood)
    )
}

pub(crate) fn method_name(plan: &FitPlan) -> &'static str {
    match (plan.method, &plan.metric) {
        (Method::Isomap, _) => "Isomap",
        (Method::Pca, MetricPlan::Euclidean | MetricPlan::Weighted(_)) => "principal components",
        (Method::Pca, MetricPlan::Ring { .. }) => "classical scaling",
        (Method::Native, _) => "native space",
    }
}

pub(crate) fn scale_name(scale: Scale) -> &'static str {
    match scale {
        Scale::Range => "ranges",
        Scale::Log => "log ranges",
        Scale::Inverse => "inverse ranges",
    }
}
