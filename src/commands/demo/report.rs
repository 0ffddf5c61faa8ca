//! The page that a demo leaves: what was learnt, where the kinds are, and how consistent they are.

use kinds_model::Model;
use kinds_trainer::report::{
    Column, Page, Table, TripKinds, add_evaluation, add_model, add_trips, consistency_table, kinds_on_path,
};
use kinds_trainer::{Evaluation, LoadedTrip, Runs};
use kinds_trips::Pose;

use crate::commands::evaluate;

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
    let n_kinds = isomap.mixture().n_kinds();
    let mut page = Page::new(&format!("Natural kinds: {}", home.place));
    let placed = home.trips.each_ref().map(Placed::of);
    add_trips(&mut page, n_kinds, &[placed[0].kinds(home, 0), placed[1].kinds(home, 1)]);
    add_evaluation(&mut page, &home.evaluation);
    if let Some(visited) = elsewhere {
        let title = format!("The same kinds elsewhere: {}", visited.place);
        page.section(&title);
        let placed = visited.trips.each_ref().map(Placed::of);
        let trips = [placed[0].kinds(visited, 0), placed[1].kinds(visited, 1)];
        page.figure(kinds_on_path("path-elsewhere", &title, n_kinds, &trips));
        page.paragraph(&format!("{}; {}.", evaluate::headline(&visited.evaluation), visited.runs()));
        page.table(&consistency_table(&visited.evaluation));
    }
    page.section("What the frames ask for");
    page.table(&table_1(own));
    add_model(&mut page, isomap, Some(pca), remarks);
    page
}

/// The frames of a trip whose place is known, which are those that are evaluated.
struct Placed {
    title: String,
    seconds: Vec<f64>,
    poses: Vec<Option<Pose>>,
}

impl Placed {
    fn of(trip: &LoadedTrip) -> Self {
        let title = trip.path.file_stem().unwrap_or_default().to_string_lossy().into_owned();
        let start_ns = trip.captured.first().map_or(0, |captured| captured.0);
        let known = trip.captured.iter().zip(&trip.poses).filter(|(_, pose)| pose.is_some());
        let (seconds, poses) =
            known.map(|(captured, &pose)| ((captured.0 - start_ns) as f64 / 1e9, pose)).unzip();
        Self { title, seconds, poses }
    }

    fn kinds<'a>(&'a self, visited: &'a Visited, trip: usize) -> TripKinds<'a> {
        let kinds = &visited.evaluation.isomap_kinds[trip];
        TripKinds { title: &self.title, seconds: &self.seconds, poses: &self.poses, kinds }
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
        table
            .row(std::iter::once(name.to_string()).chain(numbers.map(|number| number.to_string())).collect());
    }
    table
}
