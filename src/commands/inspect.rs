//! `kinds inspect`: what is in a model, for a person or a script.

use std::io::Write;

use kinds_model::evidence::best_by_bound;
use kinds_model::hierarchy::Merge;
use kinds_model::neighborhood::short_circuits;
use kinds_model::{
    ComparisonTrial, DirichletProvenance, FitPlan, KindRecord, KindsTrial, LandmarkChoice, Manifest,
    MedianPlan, Model, NeighborsTrial, Register, WhiteningPlan,
};
use kinds_trainer::kept_by_each;
use serde::Serialize;

use crate::cli::InspectArguments;
use crate::commands::train::{intrinsic, method_name, scale_name};
use crate::failure::Failure;
use crate::model_file;

/// What `inspect --json` prints.
#[derive(Serialize)]
struct Inspection<'a> {
    model_id: String,
    #[serde(flatten)]
    manifest: &'a Manifest,
    weights: &'a [f64],
    /// What people call the kinds, by index, and those that the model had before updates.
    #[serde(flatten)]
    register: &'a Register,
}

pub(crate) fn run(arguments: &InspectArguments) -> Result<(), Failure> {
    let model = model_file::open(&arguments.model)?;
    let mut out = std::io::stdout().lock();
    if arguments.json {
        let weights = model.mixture().weights();
        let (model_id, manifest, register) = (model.id().to_string(), model.manifest(), model.register());
        let inspection = Inspection { model_id, manifest, weights, register };
        writeln!(out, "{}", serde_json::to_string_pretty(&inspection).expect("a manifest is plain data"))?;
    } else {
        write!(out, "{}", describe(&model))?;
    }
    Ok(())
}

fn compared_by(plan: &FitPlan) -> String {
    match plan.whitening {
        None => plan.metric.to_string(),
        Some(WhiteningPlan { n_components, n_directions }) => {
            format!(
                "{}, along {n_directions} slow directions of up to {n_components} principal components",
                plan.metric
            )
        }
    }
}

fn describe(model: &Model) -> String {
    let Manifest { plan, n_trained, n_frames, n_neighbors, n_kinds, novelty, provenance, .. } =
        model.manifest();
    let response = &plan.response;
    let mut lines = vec![
        ("model", model.id().to_string()),
        ("made by", format!("{}, seed {}", provenance.made_by, plan.seed)),
        ("learnt from", provenance.origin.trips.join(", ")),
        ("sensor", plan.sensor.to_string()),
        (
            "compared as",
            format!(
                "{} up to {} m, offset {} m; invalid readings as {} m",
                scale_name(response.scale),
                response.range_m_max,
                response.offset_m,
                response.invalid_range_m
            ),
        ),
        ("chosen", comparisons_tried(&provenance.origin.comparisons_tried)),
        ("median", median(plan.median).to_string()),
        ("compared by", compared_by(plan)),
        (
            "frames",
            format!(
                "{n_frames} reference frames{}; {} without any valid reading left out",
                match n_frames == n_trained {
                    true => String::new(),
                    false => format!(
                        " of {n_trained} that it was learnt from, each within {:.0} counts of one",
                        provenance.covering_radius
                    ),
                },
                provenance.origin.n_frames_invalid
            ),
        ),
        ("method", format!("{}: {}", method_name(plan), how(model))),
    ];
    if let Some(scale) = model.commands() {
        lines.push(("commands", scale.to_string()));
    }
    if !provenance.islands.is_empty() {
        let (islands, bridges) = (provenance.islands.len(), provenance.bridges.len());
        lines.push((
            "graph",
            format!("{islands} {}, {bridges} bridges", if islands == 1 { "island" } else { "islands" }),
        ));
    }
    lines.push(("dimensions", dimensions(model)));
    lines.push(("intrinsic", intrinsic(&provenance.intrinsic_dims)));
    if model.embedding().is_some() {
        let percent = 100.0 * provenance.negative_share;
        lines.push(("negative", format!("{percent:.1} % of the eigenvalues' magnitude")));
    }
    lines.extend([
        (
            "kinds",
            format!(
                "{n_kinds}, {}; log-likelihood {:.1} nats, BIC {:.1}, {} iterations{}",
                asked_or_evidence(plan.n_kinds),
                provenance.log_likelihood,
                provenance.bic,
                provenance.n_iterations,
                if provenance.converged { "" } else { " (not converged)" }
            ),
        ),
        (
            "largest kind",
            format!(
                "has {:.1} % of the frames, by most probable kind",
                100.0 * provenance.largest_kind_share
            ),
        ),
        (
            "novelty",
            format!(
                "by {} held-out frames; from {} on called novel, which {} % of frames like those learnt from are too",
                novelty.n_held_out,
                1.0 - novelty.false_alarm_rate,
                100.0 * novelty.false_alarm_rate
            ),
        ),
        (
            "independent",
            format!("the frames count as {:.1} that are independent", provenance.n_frames_effective),
        ),
    ]);
    let mut text: String = lines.iter().map(|(name, value)| format!("{name:12} {value}\n")).collect();
    text += &kinds_table(model);
    if !provenance.neighbors_tried.is_empty() {
        text += &neighbors_table(&provenance.neighbors_tried, *n_neighbors);
    }
    if !provenance.kinds_tried.is_empty() {
        text += &curve(&provenance.kinds_tried, *n_kinds);
    }
    if let Some(process) = &provenance.dirichlet {
        text += &dirichlet_table(process);
    }
    text
}

/// The kinds with their shares and names, a line each; which of them are most alike, as brackets that join them, the most alike
/// first; and those that the model has no more.
fn kinds_table(model: &Model) -> String {
    let mut text = "\nkind  weight\n".to_string();
    let brackets = brackets(model.mixture().n_kinds(), &model.manifest().merges);
    let kinds = model.mixture().weights().iter().zip(model.register().kinds());
    for ((weight, KindRecord { number, name, note }), bracket) in kinds.zip(brackets) {
        let bar = "█".repeat((40.0 * weight).round() as usize);
        let words = [name, note].into_iter().filter(|words| !words.is_empty());
        let words = words.map(String::as_str).collect::<Vec<_>>().join(": ");
        let line = format!("{number:4} {:6.1} %  {bracket}  {bar:40}  {words}", 100.0 * weight);
        text += &format!("{}\n", line.trim_end());
    }
    for KindRecord { number, name, .. } in model.register().retired() {
        let line = format!("{number:4}  retired  {name}");
        text += &format!("{}\n", line.trim_end());
    }
    text
}

/// The tree of merges beside a column of kinds, a row for each kind: in each column two groups come together, at the rows of
/// their first kinds.
fn brackets(n_kinds: usize, merges: &[Merge]) -> Vec<String> {
    let mut rows = vec![String::new(); n_kinds];
    let mut is_there = vec![true; n_kinds];
    for &(into, from) in merges {
        for (kind, row) in rows.iter_mut().enumerate() {
            let is_between = into < kind && kind < from;
            row.push_str(match is_there[kind] {
                true if kind == into => "─┬",
                true if kind == from => "─┘",
                true if is_between => "─┼",
                true => "──",
                false if is_between => " │",
                false => "  ",
            });
        }
        is_there[from] = false;
    }
    rows
}

fn median(plan: MedianPlan) -> &'static str {
    match plan {
        MedianPlan::Off => "none; readings are taken as they are",
        MedianPlan::Three => "each reading is that of the last three frames",
        MedianPlan::Five => "each reading is that of the last five frames",
    }
}

fn comparisons_tried(tried: &[ComparisonTrial]) -> String {
    if tried.is_empty() {
        "as asked for".to_string()
    } else {
        format!("by evidence: {}", kept_by_each(tried))
    }
}

/// Neighbours and landmarks.
fn how(model: &Model) -> String {
    let Manifest { plan, n_frames, n_neighbors, .. } = model.manifest();
    match model.landmarks().len() {
        0 => format!("{n_neighbors} neighbours, no landmarks"),
        n_landmarks => {
            let choice = match plan.landmark_choice {
                _ if n_landmarks == *n_frames => "",
                LandmarkChoice::Random => " at random",
                LandmarkChoice::Farthest => " by farthest point",
                LandmarkChoice::KMeans => " by k-means",
            };
            let in_time = if plan.consecutive_edges { " and those before and after in time" } else { "" };
            format!("{n_neighbors} neighbours{in_time}, {n_landmarks} landmarks{choice}")
        }
    }
}

fn dimensions(model: &Model) -> String {
    let Manifest { plan, n_dims, provenance, .. } = model.manifest();
    if model.embedding().is_none() {
        return format!("{n_dims}, one for each reading");
    }
    let residual: Vec<String> =
        provenance.residual_variance.iter().take(15).map(|share| format!("{share:.3}")).collect();
    format!(
        "{n_dims}, {}: elbow at {}, within the tolerance from {}; residual variance of 1, 2, …: {}",
        asked_or_evidence(plan.n_dims),
        provenance.elbow,
        provenance.n_dims_within_tolerance,
        residual.join(" ")
    )
}

fn asked_or_evidence(asked: Option<usize>) -> &'static str {
    if asked.is_some() { "as asked for" } else { "by evidence" }
}

/// What speaks for each number of neighbours that was tried, a line each: a star at the least residual variance, an
/// arrow at the number that the model has.
fn neighbors_table(tried: &[NeighborsTrial], n_neighbors: usize) -> String {
    let least = tried.iter().map(|trial| trial.residual_variance).fold(f64::INFINITY, f64::min);
    let circuits = short_circuits(tried);
    let mut text = format!(
        "\nneighbours tried   islands   longest bridge   residual variance in {} dimensions   median geodesic\n",
        tried[0].n_dims
    );
    for (index, trial) in tried.iter().enumerate() {
        text += &format!(
            "{:16} {:9} {:>16} {:33.4}{} {:16.0}{}{}\n",
            trial.n_neighbors,
            trial.n_islands,
            trial.bridges.last().map_or("-".to_string(), |length| format!("{length:.0}")),
            trial.residual_variance,
            if trial.residual_variance == least { '*' } else { ' ' },
            trial.median_geodesic,
            if circuits.contains(&index) { " short circuit?" } else { "" },
            if trial.n_neighbors == n_neighbors { " ←" } else { "" },
        );
    }
    text
}

/// What speaks for each number of kinds that was tried, a line each: a star at the best of each column, an arrow at the
/// number that the model has.
fn curve(tried: &[KindsTrial], n_kinds: usize) -> String {
    let stars = |best: fn(&KindsTrial) -> f64| {
        let least = tried.iter().map(best).fold(f64::INFINITY, f64::min);
        move |trial: &KindsTrial| if best(trial) == least { '*' } else { ' ' }
    };
    let (bic, caic) = (stars(|trial| trial.bic), stars(|trial| trial.caic));
    let (bic_neff, held_out) = (stars(|trial| trial.bic_neff), stars(|trial| -trial.held_out));
    let mut text =
        "\nkinds tried        BIC         CAIC     BIC_neff   held out   starts given up\n".to_string();
    for trial in tried {
        text += &format!(
            "{:11} {:10.1}{} {:11.1}{} {:11.1}{} {:9.3}{} {:16}{}\n",
            trial.n_kinds,
            trial.bic,
            bic(trial),
            trial.caic,
            caic(trial),
            trial.bic_neff,
            bic_neff(trial),
            trial.held_out,
            held_out(trial),
            trial.n_starts_collapsed,
            if trial.n_kinds == n_kinds { " ←" } else { "" },
        );
    }
    text
}

/// What came of each start of a Dirichlet process, a line each, with an arrow at the model's. The kinds of that one have as
/// many independent frames as the last line says; those with less than one were left out.
fn dirichlet_table(process: &DirichletProvenance) -> String {
    let best = best_by_bound(&process.trials);
    let mut text = "\nkinds begun with   kinds kept   lower bound\n".to_string();
    for trial in &process.trials {
        text += &format!(
            "{:16} {:12} {:13.1}{}\n",
            trial.n_kinds_begun,
            trial.n_kinds,
            trial.lower_bound,
            if Some(trial) == best { " ←" } else { "" },
        );
    }
    let n_frames: Vec<String> =
        process.n_frames_of_kinds.iter().map(|n_frames| format!("{n_frames:.1}")).collect();
    text + &format!("independent frames of each kind: {}\n", n_frames.join(" "))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn kinds_that_are_most_alike_are_joined_first() {
        assert_eq!(brackets(1, &[]), [""]);
        assert_eq!(
            brackets(4, &[(1, 3), (0, 2), (0, 1)]),
            [
                "───┬─┬", //
                "─┬─┼─┘",
                "─┼─┘  ",
                "─┘    ",
            ]
        );
    }
}
