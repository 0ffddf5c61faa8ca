//! Figure of how consistent kinds are, by method.

use super::chart::{Axis, Chart, MARGINS_PX, X_PX_PER_TICK};
use super::drawing::WIDTH_MAX;
use super::figure::Figure;
use super::markup::Csv;
use super::page::{Column, Table};
use crate::evaluate::{Evaluation, MethodScores, Methods};

const ROW_PX: f64 = 44.0;

/// Consistency and chance of each method, with κ.
pub fn consistency(evaluation: &Evaluation) -> Figure {
    let scores = by_method(evaluation);
    let mut chart = Chart::new(
        (WIDTH_MAX, ROW_PX * scores.len() as f64 + MARGINS_PX.1),
        "",
        Axis {
            title: "revisited frames that are consistent",
            unit: "%",
            range: (0.0, 100.0),
            step_min: 0.0,
            px_per_tick: X_PX_PER_TICK,
        },
        // A row for each method, named within it: no ticks.
        Axis {
            title: "",
            unit: "",
            range: (scores.len() as f64, 0.0),
            step_min: 0.0,
            px_per_tick: f64::INFINITY,
        },
    );
    let mut csv = Csv::new(&[
        "method",
        "n_dims",
        "n_kinds",
        "consistency",
        "chance",
        "kappa",
        "ami",
        "largest_kind_share",
    ]);
    for (row, (name, score)) in scores.iter().enumerate() {
        let y = row as f64 + 0.68;
        let (chance, found) = (chart.at((100.0 * score.chance, y)), chart.at((100.0 * score.consistency, y)));
        chart.line(&[(100.0 * score.chance, y), (100.0 * score.consistency, y)], "c5", 3.0);
        chart.drawing.line((chance.0, chance.1 - 8.0), (chance.0, chance.1 + 8.0), "mark");
        chart.dot((100.0 * score.consistency, y), "c5", 10.0);
        let label = format!("{name}, κ = {}", signed(score.kappa));
        chart.drawing.text((chart.at((0.0, y)).0, found.1 - 15.0), "halo", &label);
        csv.line(&[
            name,
            &score.n_dims,
            &score.n_kinds,
            &score.consistency,
            &score.chance,
            &score.kappa,
            &score.ami,
            &score.largest_kind_share,
        ]);
    }
    let caption = format!(
        "Dot: share of the frames of the first trip, among those that the second came within {} m of, where more than \
         {:.0}\u{a0}% of the second trip's frames nearby have the same kind. Upright line: the same by chance, which is what \
         remains when the second trip's kinds are shifted in time. κ is the way from chance to perfection. {} at {} \
         dimensions and {} kinds.",
        evaluation.radius_m,
        100.0 * evaluation.share,
        if evaluation.methods.native.is_some() { "Isomap and PCA" } else { "All" },
        evaluation.methods.isomap.n_dims,
        evaluation.methods.isomap.n_kinds
    );
    Figure::new("consistency", "Consistency by method", caption, None, vec![chart.drawing], csv)
}

/// The same numbers as a table, with adjusted mutual information and the share of the largest kind.
pub fn consistency_table(evaluation: &Evaluation) -> Table {
    let numbers = ["dimensions", "kinds", "consistency", "chance", "κ", "AMI", "largest kind"];
    let columns = numbers.iter().map(|title| Column::number(title));
    let mut table = Table::new([Column::text("method")].into_iter().chain(columns).collect());
    for (name, score) in by_method(evaluation) {
        table.row(vec![
            name.to_string(),
            // Kinds drawn at random have no dimensions.
            if score.n_dims > 0 { score.n_dims.to_string() } else { "–".to_string() },
            score.n_kinds.to_string(),
            tenths(score.consistency),
            tenths(score.chance),
            signed(score.kappa),
            signed(score.ami),
            tenths(score.largest_kind_share),
        ]);
    }
    table
}

fn by_method(evaluation: &Evaluation) -> Vec<(&'static str, MethodScores)> {
    let Methods { isomap, pca, native, random } = evaluation.methods;
    let native = native.map(|native| ("native space", native));
    [("Isomap", isomap), ("PCA", pca)].into_iter().chain(native).chain([("random", random)]).collect()
}

/// A share in percent, to a tenth.
fn tenths(share: f64) -> String {
    format!("{:.1}\u{a0}%", 100.0 * share)
}

/// With the sign that typesetters use, and two decimals.
fn signed(value: f64) -> String {
    let text = format!("{value:.2}");
    match text.strip_prefix('-') {
        Some("0.00") => "0.00".to_string(),
        Some(magnitude) => format!("−{magnitude}"),
        None => text,
    }
}
