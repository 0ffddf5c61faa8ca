//! Figure of what speaks for each number of neighbours.

use kinds_model::neighborhood::{candidates, short_circuits};
use kinds_model::residual_variance::TOLERANCE;
use kinds_model::{Model, NeighborsTrial};

use super::axis::range;
use super::chart::{Axis, Chart, X_PX_PER_TICK, Y_PX_PER_TICK};
use super::drawing::{Drawing, WIDTH_MAX};
use super::figure::Figure;
use super::markup::Csv;

const SIZE_PX: (f64, f64) = (WIDTH_MAX, 300.0);

/// Class of both curves, and of the dots where there may be a short circuit.
const LINE: &str = "c5";
const FLAG: &str = "c6";

/// Residual variance and median geodesic over the number of neighbours, with the number chosen.
///
/// `None` if no numbers were compared, because one was given or there is no graph.
pub fn neighbors_tried(model: &Model) -> Option<Figure> {
    draw(&model.manifest().provenance.neighbors_tried, model.manifest().n_neighbors)
}

fn draw(trials: &[NeighborsTrial], n_neighbors: usize) -> Option<Figure> {
    let n_dims = trials.first()?.n_dims;
    let circuits = short_circuits(trials);
    let from = candidates(trials);
    let (first, last) = (from[0].n_neighbors, from[from.len() - 1].n_neighbors);
    let panels = vec![
        panel(trials, &circuits, n_neighbors, "Residual variance", "1 − R²", "", |trial| {
            trial.residual_variance
        }),
        panel(trials, &circuits, n_neighbors, "Median geodesic", "length", "counts", |trial| {
            trial.median_geodesic
        }),
    ];
    let mut csv = Csv::new(&[
        "n_neighbors",
        "n_islands",
        "longest_bridge_counts",
        "residual_variance",
        "median_geodesic_counts",
        "is_candidate",
        "may_be_short_circuit",
        "is_chosen",
    ]);
    for (index, trial) in trials.iter().enumerate() {
        let NeighborsTrial { n_neighbors: n, n_islands, bridges, residual_variance, median_geodesic, .. } =
            trial;
        let longest = bridges.last().map_or(String::new(), f32::to_string);
        let is_candidate = (first..=last).contains(n);
        let is_flagged = circuits.contains(&index);
        csv.line(&[
            n,
            n_islands,
            &longest,
            residual_variance,
            median_geodesic,
            &is_candidate,
            &is_flagged,
            &(*n == n_neighbors),
        ]);
    }
    let flags = match circuits.is_empty() {
        true => "",
        false => {
            " Large dots: neighbours that may reach from one place into another (the median geodesic falls by more \
                  than a tenth, or the residual variance doubles)."
        }
    };
    let caption = format!(
        "Graphs of more and more neighbours, compared in {n_dims} dimensions. Of {first} to {last} the fewest were taken that \
         leave at most {TOLERANCE} more unexplained than the best of them. Right: how long the way is from one frame to \
         another.{flags} Dotted: the {n_neighbors} neighbours of this model."
    );
    Some(Figure::new(
        "neighbors-tried",
        "What speaks for each number of neighbours",
        caption,
        None,
        panels,
        csv,
    ))
}

fn panel(
    trials: &[NeighborsTrial],
    circuits: &[usize],
    n_neighbors: usize,
    name: &str,
    title: &str,
    unit: &str,
    value: fn(&NeighborsTrial) -> f64,
) -> Drawing {
    let curve: Vec<(f64, f64)> =
        trials.iter().map(|trial| (trial.n_neighbors as f64, value(trial))).collect();
    let (_, highest) = range(curve.iter().map(|(_, value)| *value));
    let x = Axis {
        title: "neighbours",
        unit: "",
        range: range(curve.iter().map(|(n, _)| *n)),
        step_min: 1.0,
        px_per_tick: X_PX_PER_TICK,
    };
    let y = Axis { title, unit, range: (0.0, highest), step_min: 0.0, px_per_tick: Y_PX_PER_TICK };
    let mut chart = Chart::new(SIZE_PX, name, x, y);
    chart.line(&curve, LINE, 2.0);
    for (index, &pair) in curve.iter().enumerate() {
        let (class, diameter_px) = if circuits.contains(&index) { (FLAG, 9.0) } else { (LINE, 4.5) };
        chart.dot(pair, class, diameter_px);
    }
    chart.mark_x(n_neighbors as f64, &format!("{n_neighbors} neighbours"));
    chart.drawing
}

#[cfg(test)]
pub(super) mod tests {
    use super::*;

    /// From 8 to 14 neighbours: falling, and a short circuit at 13. The model has 11.
    pub(in super::super) fn figure() -> Option<Figure> {
        let shares = [0.02, 0.03, 0.05, 0.031, 0.03, 0.3, 0.31];
        let trial = |(index, &residual_variance): (usize, &f64)| NeighborsTrial {
            n_neighbors: 8 + index,
            n_islands: if index < 2 { 2 } else { 1 },
            bridges: if index < 2 { vec![120.5] } else { vec![] },
            n_dims: 4,
            residual_variance,
            median_geodesic: 900.0 - 10.0 * index as f64,
        };
        draw(&shares.iter().enumerate().map(trial).collect::<Vec<_>>(), 11)
    }

    #[test]
    fn the_chosen_number_is_marked_and_short_circuits_stand_out() {
        let svg = figure().unwrap().to_svg();
        let document = roxmltree::Document::parse(&svg).unwrap();
        let marks =
            document.descendants().filter(|node| node.is_text() && node.text() == Some("11 neighbours"));
        assert_eq!(marks.count(), 2);
        let with_class = |class: &str| {
            document.descendants().filter(|node| node.attribute("class") == Some(class)).count()
        };
        // One of seven dots in each of two panels.
        assert_eq!((with_class("line round c6"), with_class("line round c5")), (2, 12));
        assert_eq!(with_class("dotted"), 2);
    }

    #[test]
    fn its_words_and_numbers_are_those_of_the_trials() {
        let figure = figure().unwrap();
        assert_eq!(
            figure.caption(),
            "Graphs of more and more neighbours, compared in 4 dimensions. Of 10 to 12 the fewest were taken that leave at most 0.01 more unexplained than the best of them. Right: how long the way is from one frame to another. Large dots: neighbours that may reach from one place into another (the median geodesic falls by more than a tenth, or the residual variance doubles). Dotted: the 11 neighbours of this model."
        );
        let lines: Vec<&str> = figure.csv().lines().collect();
        assert_eq!(lines.len(), 1 + 7);
        assert_eq!(lines[1], "8,2,120.5,0.02,900,false,false,false");
        assert_eq!(lines[4], "11,1,,0.031,870,true,false,true");
        assert_eq!(lines[6], "13,1,,0.3,850,false,true,false");
    }

    #[test]
    fn where_no_numbers_were_compared_there_is_no_figure() {
        assert!(draw(&[], 3).is_none());
    }
}
