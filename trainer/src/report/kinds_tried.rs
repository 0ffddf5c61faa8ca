//! Figure of what speaks for each number of kinds.

use kinds_model::{KindsTrial, Model};

use super::axis::range;
use super::chart::{Axis, Chart, X_PX_PER_TICK, Y_PX_PER_TICK};
use super::drawing::{Drawing, WIDTH_MAX};
use super::figure::Figure;
use super::markup::Csv;

const SIZE_PX: (f64, f64) = (WIDTH_MAX, 300.0);

/// A curve: name, class, width, and how it is read off a trial.
type Curve = (&'static str, &'static str, f64, fn(&KindsTrial) -> f64);

const CRITERIA: [Curve; 3] = [
    ("BIC", "c5", 1.6, |trial| trial.bic),
    ("CAIC", "c7", 3.0, |trial| trial.caic),
    ("BIC, effective frames", "c6", 2.2, |trial| trial.bic_neff),
];

const HELD_OUT: Curve = ("held out", "c3", 2.2, |trial| trial.held_out);

/// Information criteria and held-out likelihood over the number of kinds, with the number chosen.
///
/// `None` if no numbers were compared, because one was given.
pub fn kinds_tried(model: &Model) -> Option<Figure> {
    let provenance = &model.manifest().provenance;
    draw(&provenance.kinds_tried, model.mixture().n_kinds(), provenance.n_frames_effective)
}

fn draw(trials: &[KindsTrial], n_kinds: usize, n_frames_effective: f64) -> Option<Figure> {
    if trials.is_empty() {
        return None;
    }
    let panels = vec![criteria(trials, n_kinds), held_out(trials, n_kinds)];
    let mut csv = Csv::new(&[
        "n_kinds",
        "log_likelihood_nats",
        "bic_nats",
        "caic_nats",
        "bic_neff_nats",
        "held_out_nats_per_frame",
        "is_chosen",
    ]);
    for trial in trials {
        let KindsTrial { n_kinds: n, log_likelihood, bic, caic, bic_neff, held_out, .. } = trial;
        csv.line(&[n, log_likelihood, bic, caic, bic_neff, held_out, &(*n == n_kinds)]);
    }
    let caption = format!(
        "Left: information criteria, lower is better, each above its own least value (circle). Consecutive frames of a trip \
         repeat each other, so BIC and CAIC (which the paper uses) ask for too many kinds; the third counts a trip as {n_frames_effective:.0} \
         independent frames. Right: likelihood of contiguous stretches of the trip that the mixture had not seen, higher is \
         better. Dotted: the {} of this model.",
        counted(n_kinds)
    );
    Some(Figure::new("kinds-tried", "What speaks for each number of kinds", caption, None, panels, csv))
}

/// `1 kind`, `3 kinds`
fn counted(n_kinds: usize) -> String {
    format!("{n_kinds} {}", if n_kinds == 1 { "kind" } else { "kinds" })
}

fn criteria(trials: &[KindsTrial], n_kinds: usize) -> Drawing {
    let above_least = |(_, _, _, value): &Curve| -> Vec<(f64, f64)> {
        let least = trials.iter().map(value).fold(f64::INFINITY, f64::min);
        trials.iter().map(|trial| (trial.n_kinds as f64, value(trial) - least)).collect()
    };
    let curves = CRITERIA.map(|curve| above_least(&curve));
    let (low, high) = range(curves.iter().flatten().map(|(_, above)| *above));
    let mut chart = chart(trials, "Information criteria", "above the least", "nats", (low, high));
    for (row, ((name, class, width_px, _), curve)) in CRITERIA.iter().zip(&curves).enumerate() {
        chart.line(curve, class, *width_px);
        circle_best(&mut chart, class, curve.iter().copied().min_by(|a, b| a.1.total_cmp(&b.1)));
        chart.name_line(row, name, class, *width_px);
    }
    chart.mark_x(n_kinds as f64, &counted(n_kinds));
    chart.drawing
}

fn held_out(trials: &[KindsTrial], n_kinds: usize) -> Drawing {
    let (_, class, width_px, value) = HELD_OUT;
    let curve: Vec<(f64, f64)> = trials.iter().map(|trial| (trial.n_kinds as f64, value(trial))).collect();
    let bounds = range(curve.iter().map(|(_, held_out)| *held_out));
    let mut chart = chart(trials, "Held-out log-likelihood", "per frame", "nats", bounds);
    chart.line(&curve, class, width_px);
    let finite = curve.iter().copied().filter(|(_, held_out)| held_out.is_finite());
    circle_best(&mut chart, class, finite.max_by(|a, b| a.1.total_cmp(&b.1)));
    chart.mark_x(n_kinds as f64, &counted(n_kinds));
    chart.drawing
}

fn chart(trials: &[KindsTrial], name: &str, title: &str, unit: &str, y: (f64, f64)) -> Chart {
    let x = range(trials.iter().map(|trial| trial.n_kinds as f64));
    let x = Axis { title: "kinds", unit: "", range: x, step_min: 1.0, px_per_tick: X_PX_PER_TICK };
    Chart::new(SIZE_PX, name, x, Axis { title, unit, range: y, step_min: 0.0, px_per_tick: Y_PX_PER_TICK })
}

fn circle_best(chart: &mut Chart, class: &str, best: Option<(f64, f64)>) {
    if let Some(best) = best.filter(|(_, value)| value.is_finite()) {
        let place = chart.at(best);
        chart.drawing.circle(place, 5.0, &format!("line {class}"), 2.0);
    }
}

#[cfg(test)]
pub(super) mod tests {
    use super::*;

    /// BIC and CAIC are least at 4 kinds, for effective frames at 3, held out is highest at 2; the model has 3.
    pub(in super::super) fn figure() -> Option<Figure> {
        let trial = |n_kinds: usize| KindsTrial {
            n_kinds,
            log_likelihood: -5000.0 + 10.0 * n_kinds as f64,
            bic: 9000.0 + (n_kinds as f64 - 4.0).powi(2),
            caic: 9100.0 + (n_kinds as f64 - 4.0).powi(2),
            bic_neff: 800.0 + (n_kinds as f64 - 3.0).powi(2),
            held_out: -30.0 - (n_kinds as f64 - 2.0).abs(),
            n_starts_collapsed: 0,
        };
        draw(&(1..=6).map(trial).collect::<Vec<_>>(), 3, 47.6)
    }

    #[test]
    fn the_best_number_of_each_curve_is_circled_and_the_chosen_one_marked() {
        let svg = figure().unwrap().to_svg();
        let document = roxmltree::Document::parse(&svg).unwrap();
        let attribute =
            |node: roxmltree::Node, name: &str| node.attribute(name).unwrap().parse::<f64>().unwrap();
        // From 1 to 6 with a twenty-fifth of that on either side, between the axes.
        let (left, right) = (52.0, WIDTH_MAX - 14.0);
        let n_kinds_at = |x: f64| (0.8 + (x - left) / (right - left) * 5.4).round();
        let circles: Vec<f64> = document
            .descendants()
            .filter(|node| node.tag_name().name() == "circle")
            .map(|node| n_kinds_at(attribute(node, "cx")))
            .collect();
        assert_eq!(circles, [4.0, 4.0, 3.0, 2.0]);
        let marks = document.descendants().filter(|node| node.attribute("class") == Some("dotted"));
        let marked: Vec<f64> = marks
            .map(|node| {
                n_kinds_at(node.attribute("d").unwrap()[1..].split(' ').next().unwrap().parse().unwrap())
            })
            .collect();
        assert_eq!(marked, [3.0, 3.0]);
    }

    #[test]
    fn its_words_and_numbers_are_those_of_the_trials() {
        let figure = figure().unwrap();
        assert_eq!(
            figure.caption(),
            "Left: information criteria, lower is better, each above its own least value (circle). Consecutive frames of a trip repeat each other, so BIC and CAIC (which the paper uses) ask for too many kinds; the third counts a trip as 48 independent frames. Right: likelihood of contiguous stretches of the trip that the mixture had not seen, higher is better. Dotted: the 3 kinds of this model."
        );
        let lines: Vec<&str> = figure.csv().lines().collect();
        assert_eq!(lines.len(), 1 + 6);
        assert_eq!(lines[3], "3,-4970,9001,9101,800,-31,true");
    }

    #[test]
    fn a_single_kind_is_one_kind() {
        let trial = KindsTrial {
            n_kinds: 1,
            log_likelihood: -9.0,
            bic: 20.0,
            caic: 21.0,
            bic_neff: 4.0,
            held_out: -3.0,
            n_starts_collapsed: 0,
        };
        let caption = draw(&[trial], 1, 12.0).unwrap().caption().to_string();
        assert!(caption.ends_with("Dotted: the 1 kind of this model."), "{caption}");
    }

    #[test]
    fn where_no_numbers_were_compared_there_is_no_figure() {
        assert!(draw(&[], 3, 0.0).is_none());
    }
}
