//! Figure of how consistent kinds are, by method.

use super::chart::{Axis, Chart, MARGINS_PX, X_PX_PER_TICK};
use super::drawing::WIDTH_MAX;
use super::figure::Figure;
use super::markup::{Csv, px};
use super::page::{Column, Table};
use crate::scores::{Confidence, MethodScores, Scores};

const ROW_PX: f64 = 44.0;

/// Consistency and chance of each method, with κ.
///
/// * `name`, `title` — of the figure; its files have the name
pub fn consistency(name: &str, title: &str, scores: &Scores) -> Figure {
    let by_method = scores.methods.named();
    let mut chart = Chart::new(
        (WIDTH_MAX, ROW_PX * by_method.len() as f64 + MARGINS_PX.1),
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
            range: (by_method.len() as f64, 0.0),
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
        "area",
        "chance_area",
        "consistency_low",
        "consistency_high",
        "kappa_low",
        "kappa_high",
        "ami_low",
        "ami_high",
    ]);
    for (row, (name, score)) in by_method.iter().enumerate() {
        let y = row as f64 + 0.68;
        let (chance, found) = (chart.at((100.0 * score.chance, y)), chart.at((100.0 * score.consistency, y)));
        chart.line(&[(100.0 * score.chance, y), (100.0 * score.consistency, y)], "c5", 3.0);
        chart.drawing.line((chance.0, chance.1 - 8.0), (chance.0, chance.1 + 8.0), "mark");
        if let Some(Confidence { consistency: [low, high], .. }) = score.confidence {
            let [low, high] = [low, high].map(|end| chart.at((100.0 * end, y)));
            chart.drawing.path(&format!("M{} {}H{}", px(low.0), px(low.1 + 9.0), px(high.0)), "mark", 1.5);
        }
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
            &unless_none(score.area),
            &unless_none(score.chance_area),
            &end(score, |confidence| confidence.consistency[0]),
            &end(score, |confidence| confidence.consistency[1]),
            &end(score, |confidence| confidence.kappa[0]),
            &end(score, |confidence| confidence.kappa[1]),
            &end(score, |confidence| confidence.ami[0]),
            &end(score, |confidence| confidence.ami[1]),
        ]);
    }
    let caption = format!(
        "Dot: share of the frames of the first trip, among those that the second came within {} m of, where more than \
         {:.0}\u{a0}% of the second trip's frames nearby have the same kind. Upright line: the same by chance, which is what \
         remains when the second trip's kinds are shifted in time. Line below the dot: how far it could have come out \
         otherwise (the middle 95\u{a0}% over resampled blocks of the path). κ is the way from chance to perfection. {} at {} \
         dimensions and {} kinds.",
        scores.radius_m,
        100.0 * scores.share,
        if scores.methods.native.is_some() { "Isomap and PCA" } else { "All" },
        scores.methods.isomap.n_dims,
        scores.methods.isomap.n_kinds
    );
    Figure::new(name, title, caption, None, vec![chart.drawing], csv)
}

fn unless_none(value: Option<f64>) -> String {
    value.map_or_else(String::new, |value| value.to_string())
}

fn end(score: &MethodScores, end: fn(&Confidence) -> f64) -> String {
    unless_none(score.confidence.as_ref().map(end))
}

/// The same numbers as a table, with adjusted mutual information and the share of the largest kind.
pub fn consistency_table(scores: &Scores) -> Table {
    let numbers =
        ["dimensions", "kinds", "consistency", "chance", "κ", "95 % of κ", "AMI", "area", "largest kind"];
    let columns = numbers.iter().map(|title| Column::number(title));
    let mut table = Table::new([Column::text("method")].into_iter().chain(columns).collect());
    for (name, score) in scores.methods.named() {
        table.row(vec![
            name.to_string(),
            // Kinds drawn at random have no dimensions.
            if score.n_dims > 0 { score.n_dims.to_string() } else { "–".to_string() },
            score.n_kinds.to_string(),
            tenths(score.consistency),
            tenths(score.chance),
            signed(score.kappa),
            score.confidence.map_or("–".to_string(), |confidence| range(confidence.kappa)),
            signed(score.ami),
            score.area.map_or("–".to_string(), tenths),
            tenths(score.largest_kind_share),
        ]);
    }
    table
}

/// `0.42 … 0.61`
pub(super) fn range([low, high]: [f64; 2]) -> String {
    format!("{}\u{a0}…\u{a0}{}", signed(low), signed(high))
}

/// A share in percent, to a tenth.
pub(super) fn tenths(share: f64) -> String {
    format!("{:.1}\u{a0}%", 100.0 * share)
}

/// With the sign that typesetters use, and two decimals.
pub(super) fn signed(value: f64) -> String {
    let text = format!("{value:.2}");
    match text.strip_prefix('-') {
        Some("0.00") => "0.00".to_string(),
        Some(magnitude) => format!("−{magnitude}"),
        None => text,
    }
}
