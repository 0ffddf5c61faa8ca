//! `kinds update`: a model and further trips → a model that has seen them all, and what became of its kinds.

use kinds_model::{KindChange, Model};
use kinds_trainer::learn_further;
use serde::Serialize;

use crate::cli::UpdateArguments;
use crate::commands::train::{choices, summary};
use crate::failure::Failure;
use crate::progress::StepBar;
use crate::say::{mention, say};
use crate::{log, model_file};

/// What `update --json` prints.
#[derive(Serialize)]
struct Output<'a> {
    before: String,
    after: String,
    kinds: Vec<Row<'a>>,
}

/// What became of a kind.
#[derive(Serialize)]
struct Row<'a> {
    number: u32,
    name: &'a str,
    /// Kept, new or retired.
    became: &'static str,
    share_before: Option<f64>,
    share_after: Option<f64>,
    agreement: Option<f64>,
}

pub(crate) fn run(arguments: &UpdateArguments) -> Result<(), Failure> {
    let model = model_file::open(&arguments.model)?;
    model_file::check_writable(&arguments.output)?;
    let selection = arguments.selection(model.layout().metres_per_count);
    let mut bar = StepBar::new();
    let learnt = learn_further(&model, &arguments.trips, &selection, &mut |stage, done, all| {
        bar.show(stage, done, all);
    })?;
    drop(bar);
    for remark in &learnt.remarks {
        log::notice(remark);
    }
    let (updated, changes) = (&learnt.updated.model, &learnt.updated.changes);
    let n_mb = model_file::write(&arguments.output, updated)? as f64 / 1e6;
    if arguments.json {
        return say(json(&model, updated, changes));
    }
    mention(summary(updated))?;
    choices(updated).into_iter().try_for_each(mention)?;
    mention(format!("\n{}", table(changes)))?;
    mention(format!("wrote {} ({n_mb:.1} MB, model {})", arguments.output.display(), updated.id()))
}

fn became(change: &KindChange) -> &'static str {
    match (change.share_before, change.share_after) {
        (Some(_), Some(_)) => "kept",
        (None, _) => "new",
        (Some(_), None) => "retired",
    }
}

fn row(change: &KindChange) -> Row<'_> {
    let KindChange { record, share_before, share_after, agreement } = change;
    let (number, name, became) = (record.number, &*record.name, became(change));
    let [share_before, share_after, agreement] = [*share_before, *share_after, *agreement];
    Row { number, name, became, share_before, share_after, agreement }
}

fn json(before: &Model, after: &Model, changes: &[KindChange]) -> String {
    let kinds = changes.iter().map(row).collect();
    let output = Output { before: before.id().to_string(), after: after.id().to_string(), kinds };
    serde_json::to_string_pretty(&output).expect("changes are plain data")
}

/// What became of the kinds, a line each, under a line of titles.
fn table(changes: &[KindChange]) -> String {
    let percent =
        |share: Option<f64>| share.map_or("-".to_string(), |share| format!("{:.1} %", 100.0 * share));
    let mut text = "kind  became    before     after  agreement  name\n".to_string();
    for change in changes {
        let [before, after, agreement] =
            [change.share_before, change.share_after, change.agreement].map(percent);
        let (number, name, became) = (change.record.number, &change.record.name, became(change));
        let line = format!("{number:4}  {became:7}  {before:>8}  {after:>8}  {agreement:>9}  {name}");
        text += &format!("{}\n", line.trim_end());
    }
    text
}

#[cfg(test)]
mod tests {
    use kinds_model::KindRecord;

    use super::*;

    #[test]
    fn what_became_of_kinds_is_a_table() {
        let change = |number, name: &str, [share_before, share_after, agreement]: [Option<f64>; 3]| {
            let record = KindRecord { number, name: name.to_string(), note: String::new() };
            KindChange { record, share_before, share_after, agreement }
        };
        let changes = [
            change(0, "corridor", [Some(0.625), Some(0.5), Some(0.75)]),
            change(7, "", [None, Some(0.125), None]),
            change(2, "doorway", [Some(0.0625), None, None]),
        ];
        assert_eq!(
            table(&changes),
            "kind  became    before     after  agreement  name\n\
             \u{20}  0  kept       62.5 %    50.0 %     75.0 %  corridor\n\
             \u{20}  7  new             -    12.5 %          -\n\
             \u{20}  2  retired     6.2 %         -          -  doorway\n"
        );
    }
}
