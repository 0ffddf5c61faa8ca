//! The page that an evaluation leaves: where the kinds are, whether they repeat, and what they are good for.

use kinds_model::Model;
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
    let register = model.register();
    let mut page = Page::new(&format!("What kinds are good for: {}", titles.join(", ")));
    add_classified_trips(&mut page, register, &evaluation.trips);
    add_evaluation(&mut page, register, evaluation);
    add_uses(&mut page, register, &evaluation.trips, uses);
    agreement.into_iter().for_each(|agreement| add_segmentation(&mut page, register, agreement));
    page.section("The kinds");
    page.figure(canonical_views(model));
    page.figure(embedding(model));
    page
}
