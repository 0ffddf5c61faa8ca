//! `kinds evaluate`: is a place seen again of the same kind?

use std::io::Write;
use std::path::Path;

use kinds_model::Model;
use kinds_trainer::{Evaluation, EvaluationPlan, Meeting, MethodScores, Rivals, Stage, load};
use kinds_trips::Selection;

use crate::cli::EvaluateArguments;
use crate::failure::Failure;
use crate::model_file;
use crate::progress::StepBar;

pub(crate) fn run(arguments: &EvaluateArguments) -> Result<(), Failure> {
    let model = model_file::open(&arguments.model)?;
    let selection = arguments.selection(model.layout().metres_per_count);
    let plan = EvaluationPlan { radius_m: arguments.radius_m, share: arguments.share, seed: arguments.seed };
    let evaluation = evaluate(model, [&arguments.trip1, &arguments.trip2], &selection, &plan)?;
    let mut out = std::io::stdout().lock();
    if arguments.json {
        let json = serde_json::to_string_pretty(&evaluation).expect("an evaluation is plain data");
        writeln!(out, "{json}")?;
    } else {
        writeln!(out, "{}\n", headline(&evaluation))?;
        for line in table(&evaluation) {
            writeln!(out, "{line}")?;
        }
    }
    Ok(())
}

/// Evaluates with a progress bar.
fn evaluate(
    model: Model,
    trips: [&Path; 2],
    selection: &Selection,
    plan: &EvaluationPlan,
) -> Result<Evaluation, Failure> {
    let mut bar = StepBar::new();
    let mut read = |path: &Path| {
        let trip = load(path, selection, &mut |stage, done, all| bar.show(stage, done, all))?;
        if let Some(remark) = &trip.truncation {
            eprintln!("kinds: {remark}");
        }
        Ok::<_, Failure>(trip)
    };
    let (first, second) = (read(trips[0])?, read(trips[1])?);
    if model.commands().is_some() {
        first.require_commands()?;
        second.require_commands()?;
    }
    let meeting = Meeting::find(model.layout(), &first, &second, plan)?;
    let mut show = |stage: Stage, done, all| bar.show(stage, done, all);
    let rivals = Rivals::of(model, &mut show)?;
    Ok(kinds_trainer::evaluate(&rivals, &meeting, &mut show))
}

/// What was measured, for a person.
pub(crate) fn headline(evaluation: &Evaluation) -> String {
    format!(
        "{:.0} % of the first trip's frames were revisited within {} m; consistent: over {:.0} % of those of the same kind",
        100.0 * evaluation.revisited,
        evaluation.radius_m,
        100.0 * evaluation.share,
    )
}

/// The methods side by side, for a person: a line each, and one of titles.
pub(crate) fn table(evaluation: &Evaluation) -> Vec<String> {
    let methods = &evaluation.methods;
    let native = methods.native.map(|native| ("native", native));
    let rows = [("Isomap", methods.isomap), ("PCA", methods.pca)].into_iter().chain(native);
    let rows = rows.chain([("random", methods.random)]);
    let line = |(name, scores): (&str, MethodScores)| {
        format!(
            "{name:6} {:>5} {:>6} {:>10.1} % {:>5.1} % {:>6.2} {:>5.2} {:>11.1} %",
            scores.n_dims,
            scores.n_kinds,
            100.0 * scores.consistency,
            100.0 * scores.chance,
            hundredths(scores.kappa),
            hundredths(scores.ami),
            100.0 * scores.largest_kind_share,
        )
    };
    let titles = "method  dims  kinds  consistency  chance  kappa   AMI  largest kind".to_string();
    std::iter::once(titles).chain(rows.map(line)).collect()
}

/// Rounded, without a minus before a zero.
fn hundredths(value: f64) -> f64 {
    (100.0 * value).round() / 100.0 + 0.0
}
