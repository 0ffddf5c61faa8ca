//! The page that an evaluation leaves: where the kinds are, whether they repeat, and what they are good for.

use kinds_model::{KindRecord, Model, Register};
use kinds_trainer::report::{
    Page, add_classified_trips, add_evaluation, add_segmentation, add_uses, canonical_views, embedding,
};
use kinds_trainer::{Evaluation, SegmentationAgreement, Uses};

pub(super) fn page(
    model: &Model,
    evaluation: &Evaluation,
    uses: &[Uses],
    agreement: Option<&SegmentationAgreement>,
) -> Page {
    let titles: Vec<&str> = evaluation.trips.iter().map(|trip| trip.track.title.as_str()).collect();
    let n_kinds = model.mixture().n_kinds();
    let mut page = Page::new(&format!("What kinds are good for: {}", titles.join(", ")));
    add_classified_trips(&mut page, n_kinds, &evaluation.trips);
    add_evaluation(&mut page, evaluation);
    add_uses(&mut page, n_kinds, &evaluation.trips, uses);
    agreement.into_iter().for_each(|agreement| add_segmentation(&mut page, agreement));
    page.section("The kinds");
    called(model.register()).into_iter().for_each(|words| page.paragraph(&words));
    page.figure(canonical_views(model));
    page.figure(embedding(model));
    page
}

/// What people call the kinds, which stand on the page by their places in the model.
fn called(register: &Register) -> Option<String> {
    let is_told =
        |(index, record): &(usize, &KindRecord)| record.number as usize != *index || !record.name.is_empty();
    let told = register.kinds().iter().enumerate().filter(is_told);
    let told: Vec<String> = told.map(|(index, _)| format!("{index} is {}", register.label(index))).collect();
    (!told.is_empty()).then(|| {
        format!(
            "On this page kinds are called by their places in the model. By number and name, {}.",
            told.join(", ")
        )
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn who_has_named_no_kind_is_told_nothing() {
        assert_eq!(called(&Register::new(3)), None);
    }
}
