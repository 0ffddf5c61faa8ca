//! What an evaluation has to show: scores by method, whatever counts as a place, both ways, and how sure they are.

use kinds_model::Register;

use super::page::{Column, Page, Table};
use super::scores::{range, signed, tenths};
use super::{
    add_trips, consistency, consistency_surfaces, consistency_table, kinds_along_time, kinds_met,
    kinds_on_path, registration_errors,
};
use crate::evaluate::{ClassifiedTrip, Evaluation, PairScores};
use crate::runs::Runs;
use crate::scores::{DirectedScores, KappaLead, MethodScores};
use crate::trip_kinds::TripKinds;

/// Adds whether a place seen again gets the same kind: the first pair of trips of each space in full, and all pairs in a
/// table.
///
/// * `register` — of the model that was evaluated
pub fn add_evaluation(page: &mut Page, register: &Register, evaluation: &Evaluation) {
    let mut spaces: Vec<usize> = evaluation.pairs.iter().map(|pair| pair.space).collect();
    spaces.dedup();
    for space in &spaces {
        let first = evaluation.pairs.iter().find(|pair| pair.space == *space);
        first.into_iter().for_each(|pair| add_pair(page, register, evaluation, pair));
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

/// Adds where and when the robot saw which kind: first where the kinds were learnt, then elsewhere.
///
/// * `trips` — space by space
pub fn add_classified_trips(page: &mut Page, register: &Register, trips: &[ClassifiedTrip]) {
    for of_space in trips.chunk_by(|a, b| a.space == b.space) {
        let space = of_space[0].space;
        let of_space: Vec<TripKinds> = of_space.iter().map(ClassifiedTrip::trip_kinds).collect();
        if space == 0 {
            add_trips(page, register, &of_space);
            continue;
        }
        let title = elsewhere("The trips", space);
        page.section(&title);
        page.paragraph(
            "Do the kinds hold where they were not learnt? Where they say nothing of a place, they change from frame to frame.",
        );
        page.list(of_space.iter().map(|trip| {
            let Runs { mean_length, mean_length_shuffled } = Runs::of(trip.kinds);
            format!(
                "{}: a kind lasts {mean_length:.1} frames in the mean; in any order it would last {mean_length_shuffled:.1}",
                trip.title
            )
        }));
        page.figure(kinds_on_path(&file("path", space), "Kinds on the path, elsewhere", register, &of_space));
        page.figure(kinds_along_time(
            &file("time", space),
            "Kinds along time, elsewhere",
            register,
            &of_space,
        ));
    }
}

/// What is said of a space: nothing of that where the kinds were learnt.
pub(super) fn elsewhere(heading: &str, space: usize) -> String {
    match space {
        0 => heading.to_string(),
        1 => format!("{heading} elsewhere"),
        space => format!("{heading} elsewhere, space {space}"),
    }
}

/// The name of a figure's files.
pub(super) fn file(name: &str, space: usize) -> String {
    match space {
        0 => name.to_string(),
        1 => format!("{name}-elsewhere"),
        space => format!("{name}-elsewhere-{space}"),
    }
}

fn add_pair(page: &mut Page, register: &Register, evaluation: &Evaluation, pair: &PairScores) {
    let PairScores { space, trips: [first, second], forward, registration, .. } = pair;
    let named = |name: &str| file(name, *space);
    page.section(&elsewhere("Consistency", *space));
    let DirectedScores { scores, never_revisited, .. } = forward;
    page.paragraph(&format!(
        "{} of the frames of {first} were revisited by {second} within {} m, {} never. One kind for everything would always be \
         consistent: read consistency beside chance, κ, adjusted mutual information (AMI) and the share of the largest kind.",
        tenths(scores.revisited),
        scores.radius_m,
        tenths(*never_revisited),
    ));
    page.table(&consistency_table(scores));
    match &forward.kappa_lead {
        Some(lead) => page.paragraph(&lead_in_words(lead, forward)),
        None => page.list(&evaluation.remarks),
    }
    page.figure(consistency(&named("consistency"), "Consistency by method", scores));
    let title = "Consistency, whatever counts as a place";
    page.figure(consistency_surfaces(&named("surfaces"), title, &evaluation.grid, &forward.surfaces));
    let own = own_scores(evaluation, forward);
    let title = "Which kinds are taken for which";
    page.figure(kinds_met(&named("kinds-met"), title, register, [first, second], &forward.kinds_met));
    let title = "When poses are off";
    page.figure(registration_errors(&named("registration"), title, own.kappa, registration));
}

/// The scores of the model's own method.
fn own_scores<'a>(evaluation: &Evaluation, directed: &'a DirectedScores) -> &'a MethodScores {
    let methods = &directed.scores.methods;
    let own = match evaluation.method {
        "native" => methods.native.as_ref(),
        "pca" => methods.pca.as_ref(),
        _ => Some(&methods.isomap),
    };
    own.expect("the model that is evaluated is among those compared")
}

/// Which of Isomap and principal components is ahead, if one is.
fn lead_in_words(lead: &KappaLead, directed: &DirectedScores) -> String {
    let &KappaLead { isomap_over_pca, confidence } = lead;
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
