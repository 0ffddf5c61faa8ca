//! The page that a demo leaves: what was learnt, where the kinds are, and how consistent they are.

use kinds_model::Model;
use kinds_trainer::report::{
    Page, add_evaluation, add_methods, add_model, add_trips, consistency_table, kinds_on_path,
};
use kinds_trainer::{ClassifiedTrip, Evaluation, PairScores, Runs, TripKinds};

use crate::commands::evaluate;

/// Two trips through the same places, and how consistent kinds are on them.
pub(crate) struct Visited {
    /// Where, in words.
    pub(crate) place: String,
    pub(crate) evaluation: Evaluation,
}

impl Visited {
    /// How the second trip revisits the first.
    pub(crate) fn pair(&self) -> &PairScores {
        &self.evaluation.pairs[0]
    }

    fn trips(&self) -> Vec<TripKinds<'_>> {
        self.evaluation.trips.iter().map(ClassifiedTrip::trip_kinds).collect()
    }

    /// How long one kind lasts on the second trip, for a person.
    pub(crate) fn runs(&self) -> String {
        let Runs { mean_length, mean_length_shuffled } = Runs::of(&self.evaluation.trips[1].kinds);
        format!(
            "a kind lasts {mean_length:.1} frames in the mean of the second trip; in any order it would last {mean_length_shuffled:.1}"
        )
    }
}

/// Composes the page.
///
/// * `own` — Isomap's and principal components' models of one trip, each with the dimensions and kinds that the data
///   ask for
/// * `remarks` — how the first of them was chosen and learnt, in sentences
pub(crate) fn page(
    own: [&Model; 2],
    remarks: &[String],
    home: &Visited,
    elsewhere: Option<&Visited>,
) -> Page {
    let [isomap, pca] = own;
    let register = isomap.register();
    let mut page = Page::new(&format!("Natural kinds: {}", home.place));
    add_trips(&mut page, register, &home.trips());
    add_evaluation(&mut page, register, &home.evaluation);
    if let Some(visited) = elsewhere {
        let title = format!("The same kinds elsewhere: {}", visited.place);
        page.section(&title);
        page.figure(kinds_on_path("path-elsewhere", &title, register, &visited.trips()));
        let scores = &visited.pair().forward.scores;
        page.paragraph(&format!("{}; {}.", evaluate::headline(scores), visited.runs()));
        page.table(&consistency_table(scores));
    }
    add_methods(&mut page, &[("Isomap", isomap), ("PCA", pca)]);
    add_model(&mut page, isomap, Some(pca), remarks);
    page
}
