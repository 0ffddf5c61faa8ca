//! What `train` and `evaluate` have to show, put on a page in the order in which a person asks.

use kinds_model::{
    Covariance, DirichletProvenance, FitPlan, Manifest, Method, MetricPlan, Model, Provenance, Register,
    Scale,
};

use super::canonical::responsibilities;
use super::page::{Column, Page, Table};
use super::{
    canonical_views, embedding, kinds_along_time, kinds_merged, kinds_on_path, kinds_tried, neighbors_tried,
    residual_variance, spectrum,
};
use crate::comparison_choice::kept_by_each;
use crate::track::Track;
use crate::trip_kinds::TripKinds;

/// Adds what a model is, how its dimensions and kinds were chosen, and what the kinds look like.
///
/// * `rival` — the same frames by the other method, for its residual variance
/// * `remarks` — sentences about how it was learnt, as [`Trained`](crate::Trained) has them
pub fn add_model(page: &mut Page, model: &Model, rival: Option<&Model>, remarks: &[String]) {
    page.section("The model");
    page.facts(&facts(model));
    if !remarks.is_empty() {
        page.paragraph("To be known about it:");
        page.list(remarks.to_vec());
    }
    if model.geodesics().is_some() {
        add_graph(page, model);
    }
    page.section("How many dimensions");
    let both = [Some(model), rival].into_iter().flatten();
    let named: Vec<(&str, &Model)> = both.map(|model| (method_name(model), model)).collect();
    if model.embedding().is_some() {
        page.figure(residual_variance(&named));
        page.figure(spectrum(model));
    } else {
        page.paragraph("One for each reading: in native space nothing is embedded.");
    }
    page.section("How many kinds");
    match (kinds_tried(model), &model.manifest().provenance.dirichlet) {
        (Some(figure), _) => page.figure(figure),
        (None, Some(process)) => add_dirichlet(page, process),
        (None, None) => page.paragraph(&format!(
            "That there are {} kinds was given; no other numbers were tried.",
            model.mixture().n_kinds()
        )),
    }
    page.section("The kinds");
    page.figure(embedding(model));
    page.figure(canonical_views(model));
    kinds_merged(model).into_iter().for_each(|figure| page.figure(figure));
}

/// Adds how the neighbour graph came about, and what had to be added to make it one.
fn add_graph(page: &mut Page, model: &Model) {
    page.section("How many neighbours");
    let Manifest { n_neighbors, provenance, .. } = model.manifest();
    match neighbors_tried(model) {
        Some(figure) => page.figure(figure),
        None => page.paragraph(&format!(
            "That each frame has {n_neighbors} neighbours was given; no other numbers were tried."
        )),
    }
    let Provenance { islands, bridges, .. } = provenance;
    if bridges.is_empty() {
        page.paragraph("All frames hang together: the graph needed no bridges.");
        return;
    }
    let radii = model.squared_radii();
    let usual = (radii[radii.len() / 2] as f64).sqrt();
    page.paragraph(&format!(
        "The graph had {} islands, joined by bridges, whose lengths are guesses about how far places are from each other. For \
         comparison: half of the frames have their {n_neighbors} nearest within {usual:.0} counts.",
        islands.len(),
    ));
    let mut table = Table::new(["frame", "frame", "length, counts"].map(Column::number).into());
    for (a, b, length) in bridges {
        table.row(vec![a.to_string(), b.to_string(), format!("{length:.0}")]);
    }
    page.table(&table);
}

fn add_dirichlet(page: &mut Page, process: &DirichletProvenance) {
    page.paragraph(&format!(
        "A Dirichlet process of concentration {} kept as many kinds as have at least one independent frame each, whatever \
         number it began with. The model is that with the highest lower bound of ln evidence.",
        process.concentration
    ));
    let columns = ["kinds begun with", "kinds kept", "lower bound, nats"];
    let mut table = Table::new(columns.map(Column::number).to_vec());
    for trial in &process.trials {
        table.row(vec![
            trial.n_kinds_begun.to_string(),
            trial.n_kinds.to_string(),
            format!("{:.1}", trial.lower_bound),
        ]);
    }
    page.table(&table);
}

/// Adds where and when the robot saw which kind.
///
/// The figures are named `path` and `time`.
pub fn add_trips(page: &mut Page, register: &Register, trips: &[TripKinds]) {
    page.section("The trips");
    if trips.iter().any(|trip| trip.poses.iter().any(Option::is_some)) {
        page.figure(kinds_on_path("path", "Kinds on the path", register, trips));
    } else {
        page.paragraph(
            "Nobody knows where the robot was: there is no map without nav_msgs/msg/Odometry or \
                        geometry_msgs/msg/PoseStamped.",
        );
    }
    page.figure(kinds_along_time("time", "Kinds along time", register, trips));
}

/// Adds where and when the robot saw which kind on the trips that a model was learnt from.
///
/// * `tracks` — of the trained frames, in their order
///
/// # Panics
/// If the tracks have more or fewer frames than the model was learnt from: a bug of the caller.
pub fn add_learnt_trips(page: &mut Page, model: &Model, tracks: &[Track]) {
    let (_, kinds) = responsibilities(model);
    let mut left = &kinds[..];
    let trips: Vec<TripKinds> = tracks
        .iter()
        .map(|track| {
            let (of_trip, of_others) = left.split_at(track.n_frames());
            left = of_others;
            track.with_kinds(of_trip)
        })
        .collect();
    assert!(left.is_empty(), "every trained frame is of one of the trips");
    add_trips(page, model.register(), &trips);
}

/// What a model's coordinates are made by, as tables and figures name it.
pub fn method_name(model: &Model) -> &'static str {
    let FitPlan { method, metric, .. } = &model.manifest().plan;
    match (method, metric) {
        (Method::Isomap, _) => "Isomap",
        (Method::Pca, MetricPlan::Euclidean | MetricPlan::Weighted(_)) => "PCA",
        (Method::Pca, MetricPlan::Ring { .. }) => "classical scaling",
        (Method::Native, _) => "native space",
    }
}

fn facts(model: &Model) -> Vec<(&'static str, String)> {
    let FitPlan { sensor, response, metric, method, consecutive_edges, n_landmarks, em, seed, .. } =
        &model.manifest().plan;
    let n_neighbors = model.manifest().n_neighbors;
    let n_dims = model.manifest().n_dims;
    let Provenance { made_by, origin, .. } = &model.manifest().provenance;
    let scale = match response.scale {
        Scale::Range => "range".to_string(),
        Scale::Log => format!("ln(1 + range / {} m)", response.offset_m),
        Scale::Inverse => format!("1 / (range + {} m)", response.offset_m),
    };
    let how = match method {
        Method::Isomap if *consecutive_edges => format!(
            "{n_neighbors} neighbours and those before and after in time, {n_landmarks} landmarks, {n_dims} dimensions"
        ),
        Method::Isomap => format!("{n_neighbors} neighbours, {n_landmarks} landmarks, {n_dims} dimensions"),
        Method::Pca => format!("{n_landmarks} landmarks, {n_dims} dimensions"),
        Method::Native => format!("the readings as they are, {n_dims} dimensions"),
    };
    let trips = match origin.trips.is_empty() {
        true => "frames of unknown trips".to_string(),
        false => origin.trips.join(", "),
    };
    let mut facts = vec![
        ("model", model.id().to_string()),
        ("learnt from", trips),
        ("frames", frames_in_words(model)),
        ("sensor", sensor.to_string()),
        ("compared on", format!("{scale}, up to {:.2} m", response.range_m_max)),
        ("compared by", metric.to_string()),
        ("method", format!("{}: {how}", method_name(model))),
        ("kinds", format!("{}, {}", model.mixture().n_kinds(), shape_in_words(em.covariance))),
        ("made by", format!("{made_by}, seed {seed}")),
    ];
    if !origin.comparisons_tried.is_empty() {
        facts.push(("comparisons tried", kept_by_each(&origin.comparisons_tried)));
    }
    facts.extend(model.commands().map(|scale| ("commands", scale.to_string())));
    facts
}

fn frames_in_words(model: &Model) -> String {
    let Manifest { n_trained, n_frames, provenance, .. } = model.manifest();
    match model.references().is_all() {
        true => n_trained.to_string(),
        false => format!(
            "{n_trained}; the model keeps {n_frames} that cover them: none is farther than {:.0} counts from the nearest",
            provenance.covering_radius
        ),
    }
}

fn shape_in_words(covariance: Covariance) -> &'static str {
    match covariance {
        Covariance::Full => "each any ellipsoid (full covariances)",
        Covariance::Tied => "all one ellipsoid (tied covariances)",
        Covariance::Diagonal => "each an ellipsoid along the dimensions (diagonal covariances)",
        Covariance::Spherical => "each a ball (spherical covariances)",
    }
}
