//! The page that a demo leaves: what was learnt, where the kinds are, and how consistent they are.

use kinds_model::Model;
use kinds_trainer::report::{
    Column, Page, Table, TripOnPath, canonical_views, consistency, consistency_table, embedding, kinds_on_path,
    kinds_tried, residual_variance, spectrum,
};
use kinds_trainer::{Evaluation, LoadedTrip, Runs};
use kinds_trips::Pose;

use crate::commands::{evaluate, train};

/// Two trips through the same places, and how consistent kinds are on them.
pub(crate) struct Visited {
    /// Where, in words.
    pub(crate) place: String,
    pub(crate) trips: [LoadedTrip; 2],
    pub(crate) evaluation: Evaluation,
}

impl Visited {
    /// How long one kind lasts on the second trip, for a person.
    pub(crate) fn runs(&self) -> String {
        let Runs { mean_length, mean_length_shuffled } = Runs::of(&self.evaluation.isomap_kinds[1]);
        format!(
            "on its second trip a kind lasts {mean_length:.1} frames in the mean; the same kinds in any order would last {mean_length_shuffled:.1}"
        )
    }
}

/// Composes the page.
///
/// * `own` — Isomap's and principal components' models of the same trip, each with the dimensions and kinds that the
///   data ask for
pub(crate) fn page(own: [&Model; 2], home: &Visited, elsewhere: Option<&Visited>) -> Page {
    let [isomap, pca] = own;
    let mut page = Page::new(&format!("Natural kinds in {}", home.place));
    page.paragraph(&format!(
        "Learnt without labels from {}: {}.",
        isomap.manifest().provenance.origin.trips.join(", "),
        train::summary(isomap),
    ));
    kinds_in_places(&mut page, isomap, home, elsewhere);

    page.section("What each kind looks like");
    page.figure(canonical_views(isomap));

    page.section("How many dimensions and kinds the data ask for");
    page.table(&table_1(own));
    page.figure(residual_variance(&[("Isomap", isomap), ("PCA", pca)]));
    page.list(train::choices(isomap));
    if let Some(figure) = kinds_tried(isomap) {
        page.figure(figure);
    }
    page.figure(spectrum(isomap));
    page.figure(embedding(isomap));
    page
}

fn kinds_in_places(page: &mut Page, isomap: &Model, home: &Visited, elsewhere: Option<&Visited>) {
    let n_kinds = isomap.mixture().n_kinds();
    let visits = [("home", Some(home)), ("elsewhere", elsewhere)];
    for (name, visited) in visits.into_iter().filter_map(|(name, visited)| Some((name, visited?))) {
        page.section(&format!("Kinds in {}", visited.place));
        let poses = visited.trips.each_ref().map(known_poses);
        let titles = visited.trips.each_ref().map(|trip| file_name(trip));
        let trips: Vec<TripOnPath> = (0..2)
            .map(|trip| TripOnPath {
                title: &titles[trip],
                poses: &poses[trip],
                kinds: &visited.evaluation.isomap_kinds[trip],
            })
            .collect();
        page.figure(kinds_on_path(&format!("path-{name}"), &format!("Kinds in {}", visited.place), n_kinds, &trips));
        page.paragraph(&format!("{}.", evaluate::headline(&visited.evaluation)));
        page.table(&consistency_table(&visited.evaluation));
        page.figure(consistency(&visited.evaluation));
        page.paragraph(&format!("Also, {}.", visited.runs()));
    }
}

/// The paper's Table 1.
fn table_1(own: [&Model; 2]) -> Table {
    let mut table = Table::new(vec![
        Column::text("method"),
        Column::number("readings"),
        Column::number("dimensions"),
        Column::number("kinds"),
    ]);
    for (name, model) in ["Isomap", "PCA"].into_iter().zip(own) {
        let numbers = [model.layout().n_readings(), model.embedding().n_dims(), model.mixture().n_kinds()];
        table.row(std::iter::once(name.to_string()).chain(numbers.map(|number| number.to_string())).collect());
    }
    table
}

fn known_poses(trip: &LoadedTrip) -> Vec<Pose> {
    trip.poses.iter().flatten().copied().collect()
}

fn file_name(trip: &LoadedTrip) -> String {
    trip.path.file_stem().unwrap_or_default().to_string_lossy().into_owned()
}
