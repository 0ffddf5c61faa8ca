//! What an evaluation has to show: scores by method, whatever counts as a place, both ways, and how sure they are.

use super::page::{Column, Page, Table};
use super::scores::{range, signed, tenths};
use super::{consistency, consistency_surfaces, consistency_table, kinds_met, registration_errors};
use crate::evaluate::{Evaluation, PairScores};
use crate::scores::{DirectedScores, KappaLead, MethodScores};

/// Adds whether a place seen again gets the same kind: the first pair of trips of each space in full, and all pairs in a
/// table.
pub fn add_evaluation(page: &mut Page, evaluation: &Evaluation) {
    let mut spaces: Vec<usize> = evaluation.pairs.iter().map(|pair| pair.space).collect();
    spaces.dedup();
    for space in &spaces {
        let first = evaluation.pairs.iter().find(|pair| pair.space == *space);
        first.into_iter().for_each(|pair| add_pair(page, evaluation, pair));
    }
    if evaluation.pairs.is_empty() {
        page.section("Consistency");
        page.paragraph("There is a single trip: whether a place seen again gets the same kind takes two.");
        return;
    }
    page.section("Every pair of trips, both ways");
    page.paragraph(
        "Is each frame of one trip consistent with the frames of the other? The answer differs by the direction, since what one \
         trip saw only once the other may have passed often.",
    );
    page.table(&pair_table(evaluation));
    if !evaluation.not_compared.is_empty() {
        page.paragraph("Not compared:");
        page.list(&evaluation.not_compared);
    }
}

fn add_pair(page: &mut Page, evaluation: &Evaluation, pair: &PairScores) {
    let PairScores { space, trips: [first, second], forward, registration, .. } = pair;
    // Names of the figures of the first space are those that scripts know.
    let (heading, suffix) = match space {
        0 => ("Consistency".to_string(), String::new()),
        1 => ("Consistency elsewhere".to_string(), "-elsewhere".to_string()),
        space => (format!("Consistency elsewhere, space {space}"), format!("-elsewhere-{space}")),
    };
    let named = |name: &str| format!("{name}{suffix}");
    page.section(&heading);
    let DirectedScores { scores, never_revisited, .. } = forward;
    page.paragraph(&format!(
        "{} of the frames of {first} were revisited by {second} within {} m, {} never. One kind for everything would always be \
         consistent: read consistency beside chance, κ, adjusted mutual information (AMI) and the share of the largest kind.",
        tenths(scores.revisited),
        scores.radius_m,
        tenths(*never_revisited),
    ));
    page.table(&consistency_table(scores));
    page.paragraph(&lead_in_words(forward));
    page.figure(consistency(&named("consistency"), "Consistency by method", scores));
    let title = "Consistency, whatever counts as a place";
    page.figure(consistency_surfaces(&named("surfaces"), title, &evaluation.grid, &forward.surfaces));
    let own = own_scores(evaluation, forward);
    let title = "Which kinds are taken for which";
    page.figure(kinds_met(&named("kinds-met"), title, [first, second], &forward.kinds_met));
    let title = "When poses are off";
    page.figure(registration_errors(&named("registration"), title, own.kappa, registration));
}

/// The scores of the model's own method.
fn own_scores<'a>(evaluation: &Evaluation, directed: &'a DirectedScores) -> &'a MethodScores {
    let methods = &directed.scores.methods;
    match (evaluation.method, &methods.native) {
        ("native", Some(native)) => native,
        ("pca", _) => &methods.pca,
        _ => &methods.isomap,
    }
}

/// Which of Isomap and principal components is ahead, if one is.
fn lead_in_words(directed: &DirectedScores) -> String {
    let KappaLead { isomap_over_pca, confidence } = directed.kappa_lead;
    let blocks = format!("{} blocks of the path of {:.1} m each", directed.n_blocks, directed.block_m);
    let Some([low, high]) = confidence else {
        return format!(
            "The path has {blocks}: too few to say how far the scores could have come out otherwise."
        );
    };
    let verdict = match (low > 0.0, high < 0.0) {
        (true, _) => "Isomap's kinds are the more consistent",
        (_, true) => "those of principal components are the more consistent",
        _ => "neither method is ahead for sure",
    };
    format!(
        "κ of Isomap less κ of principal components is {} ({} over {blocks}, drawn anew): {verdict}.",
        signed(isomap_over_pca),
        range([low, high])
    )
}

/// A row for each pair and direction.
fn pair_table(evaluation: &Evaluation) -> Table {
    let numbers = ["revisited", "consistency", "chance", "κ", "95 % of κ", "AMI", "area"];
    let texts = ["frames of", "revisited by"].map(Column::text);
    let mut table = Table::new(texts.into_iter().chain(numbers.map(Column::number)).collect());
    for PairScores { trips: [first, second], forward, backward, .. } in &evaluation.pairs {
        for (from, to, directed) in [(first, second, forward), (second, first, backward)] {
            let own = own_scores(evaluation, directed);
            table.row(vec![
                from.clone(),
                to.clone(),
                tenths(directed.scores.revisited),
                tenths(own.consistency),
                tenths(own.chance),
                signed(own.kappa),
                own.confidence.map_or("–".to_string(), |confidence| range(confidence.kappa)),
                signed(own.ami),
                own.area.map_or("–".to_string(), tenths),
            ]);
        }
    }
    table
}
