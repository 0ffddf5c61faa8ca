//! Figure of how much consistency suffers when poses are off.

use super::chart::{Axis, Chart, MARGINS_PX, X_PX_PER_TICK, Y_PX_PER_TICK};
use super::figure::Figure;
use super::markup::Csv;
use crate::registration::{Jittered, RegistrationScores};

const WIDTH_PX: f64 = 282.0;
const HEIGHT_PX: f64 = 170.0;

/// A way in which poses are off.
type Way = fn(&RegistrationScores) -> Option<Jittered>;

/// κ by the size of errors that were added to the second trip's poses.
///
/// * `name`, `title` — of the figure; its files have the name
/// * `kappa` — without any
pub fn registration_errors(name: &str, title: &str, kappa: f64, scores: &[RegistrationScores]) -> Figure {
    let ways: [(&str, Way); 2] =
        [("each pose by itself", |scores| scores.each_pose), ("the whole trip", |scores| scores.whole_trip)];
    let found = || ways.iter().flat_map(|(_, way)| scores.iter().filter_map(way));
    let lowest = found().map(|jittered| jittered.kappa_range[0]).fold(kappa.min(0.0), f64::min);
    let sigma_m_max = scores.iter().map(|scores| scores.sigma_m).fold(0.0, f64::max);
    let mut csv = Csv::new(&["errors", "sigma_m", "consistency", "kappa", "kappa_low", "kappa_high"]);
    let mut panel = |(name, way): &(&str, Way)| {
        let mut chart = Chart::new(
            (WIDTH_PX, HEIGHT_PX + MARGINS_PX.1),
            name,
            Axis {
                title: "deviation of the errors",
                unit: "m",
                // Errors of no size at all make an axis of no length.
                range: (0.0, if sigma_m_max > 0.0 { sigma_m_max } else { 1.0 }),
                step_min: 0.0,
                px_per_tick: X_PX_PER_TICK,
            },
            Axis { title: "κ", unit: "", range: (lowest, 1.0), step_min: 0.0, px_per_tick: Y_PX_PER_TICK },
        );
        let points: Vec<(f64, Jittered)> =
            scores.iter().filter_map(|scores| Some((scores.sigma_m, way(scores)?))).collect();
        let line = points.iter().map(|(sigma_m, jittered)| (*sigma_m, jittered.kappa));
        chart.line(&[(0.0, kappa)].into_iter().chain(line).collect::<Vec<_>>(), "c5", 2.0);
        for (sigma_m, Jittered { consistency, kappa, kappa_range: [low, high] }) in &points {
            chart.line(&[(*sigma_m, *low), (*sigma_m, *high)], "c5", 1.2);
            chart.dot((*sigma_m, *kappa), "c5", 7.0);
            csv.line(&[name, sigma_m, consistency, kappa, low, high]);
        }
        chart.drawing
    };
    let panels = ways.iter().map(&mut panel).collect();
    let caption = "Consistency beyond chance, when errors are added to the second trip's poses on purpose: to each pose by itself, as \
                   a tracker's noise is, or one and the same to the whole trip, as where two maps were laid over each other by hand. \
                   Dots are means over a few draws, upright lines reach from the least to the greatest."
        .to_string();
    Figure::new(name, title, caption, None, panels, csv)
}
