//! Figure of how consistent kinds are whatever counts as a place: the surfaces of the paper's Figure 6, seen from above.

use super::chart::{Axis, Chart, MARGINS_PX, X_PX_PER_TICK, Y_PX_PER_TICK};
use super::drawing::Drawing;
use super::figure::Figure;
use super::markup::{Csv, px};
use super::scores::tenths;
use crate::consistency::{Consistency, kappa};
use crate::rivals::Methods;
use crate::surface::{Grid, Surface};

/// Steps in which colour grows: finer ones are not told apart.
const N_LEVELS: usize = 20;

/// How much colour a value of 0 has, so that it is told from no value.
const OPACITY_MIN: f64 = 0.06;

/// Three stand side by side on a wide page.
const WIDTH_PX: f64 = 282.0;
const HEIGHT_PX: f64 = 180.0;

/// Consistency over radius and share, a panel for each method.
///
/// * `name`, `title` — of the figure; its files have the name
pub fn consistency_surfaces(name: &str, title: &str, grid: &Grid, surfaces: &Methods<Surface>) -> Figure {
    let mut csv = Csv::new(&["method", "radius_m", "share", "consistency", "chance", "kappa"]);
    let mut panels = Vec::new();
    for (method, surface) in surfaces.named() {
        let area =
            surface.area.map_or("never revisited".to_string(), |area| format!("area {}", tenths(area)));
        panels.push(draw(&format!("{method}, {area}"), grid, &surface.consistency));
        for (radius, radius_m) in grid.radii_m.iter().enumerate() {
            for (place, share) in grid.shares.iter().enumerate() {
                let (consistency, chance) =
                    (surface.consistency[radius][place], surface.chance[radius][place]);
                let kappa = consistency
                    .zip(chance)
                    .map(|(consistency, chance)| kappa(Consistency { consistency, chance }));
                let [consistency, chance, kappa] = [consistency, chance, kappa]
                    .map(|value| value.map_or_else(String::new, |value| value.to_string()));
                csv.line(&[&method, radius_m, share, &consistency, &chance, &kappa]);
            }
        }
    }
    let caption = "Share of the revisited frames that are consistent, by how far frames of the same place may be apart and by how \
                   many of those nearby must have the same kind: at least that share, and more. The line is where half of the \
                   frames are. The area is the mean over the panel. Large areas are worth something only beside that of random \
                   kinds; one kind for everything would fill its panel."
        .to_string();
    Figure::new(name, title, caption, Some(legend()), panels, csv)
}

/// Draws a surface from above: the higher, the more colour; a line where it crosses one half.
///
/// * `values` — 0…1, shape `(n_radii, n_shares)`; no colour where there is none
fn draw(name: &str, grid: &Grid, values: &[Vec<Option<f64>>]) -> Drawing {
    let Grid { radii_m, shares } = grid;
    let (x, y) = (Cells::around(radii_m, 1.0), Cells::around(shares, 100.0));
    let mut chart = Chart::new(
        (WIDTH_PX, HEIGHT_PX + MARGINS_PX.1),
        name,
        Axis { title: "radius", unit: "m", range: x.range(), step_min: 0.0, px_per_tick: X_PX_PER_TICK },
        Axis {
            title: "share asked for",
            unit: "%",
            range: y.range(),
            step_min: 0.0,
            px_per_tick: Y_PX_PER_TICK,
        },
    );
    let value = |radius: usize, share: usize| values.get(radius)?.get(share).copied().flatten();
    // One path for all cells of a level keeps the page small.
    let mut of_levels = vec![String::new(); N_LEVELS + 1];
    let mut half = String::new();
    for radius in 0..radii_m.len() {
        for share in 0..shares.len() {
            let Some(here) = value(radius, share) else { continue };
            let (left, bottom) = chart.at((x.edge(radius), y.edge(share)));
            let (right, top) = chart.at((x.edge(radius + 1), y.edge(share + 1)));
            let level = (here.clamp(0.0, 1.0) * N_LEVELS as f64).round() as usize;
            of_levels[level] +=
                &format!("M{} {}H{}V{}H{}z", px(left), px(bottom), px(right), px(top), px(left));
            let parted = |other: Option<f64>| other.is_some_and(|other| (other < 0.5) != (here < 0.5));
            if parted(value(radius + 1, share)) {
                half += &format!("M{} {}V{}", px(right), px(bottom), px(top));
            }
            if parted(value(radius, share + 1)) {
                half += &format!("M{} {}H{}", px(left), px(top), px(right));
            }
        }
    }
    for (level, cells) in of_levels.iter().enumerate().filter(|(_, cells)| !cells.is_empty()) {
        chart.drawing.path_with(cells, "heat", &opacity(level as f64 / N_LEVELS as f64));
    }
    if !half.is_empty() {
        chart.drawing.path(&half, "mark", 1.5);
    }
    chart.drawing
}

/// What the colours mean: from 0 to 100 %, and the line at one half.
fn legend() -> Drawing {
    const STEP_PX: f64 = 11.0;
    const TOP_PX: f64 = 2.0;
    const SIZE_PX: f64 = 14.0;
    let ramp_px = STEP_PX * (N_LEVELS + 1) as f64;
    let mut drawing = Drawing::new(ramp_px + 36.0, 38.0, "legend: colour from 0 % to 100 %, a line at 50 %");
    for level in 0..=N_LEVELS {
        let cell = format!("M{} {TOP_PX}h{STEP_PX}v{SIZE_PX}h-{STEP_PX}z", px(12.0 + STEP_PX * level as f64));
        drawing.path_with(&cell, "heat", &opacity(level as f64 / N_LEVELS as f64));
    }
    let middle_px = 12.0 + ramp_px / 2.0;
    drawing.path(&format!("M{} 0v{}", px(middle_px), SIZE_PX + 2.0 * TOP_PX), "mark", 1.5);
    for (x_px, text) in [(12.0, "0 %"), (middle_px, "50 %"), (12.0 + ramp_px, "100 %")] {
        drawing.text((x_px, 34.0), "quiet middle", text);
    }
    drawing
}

fn opacity(value: f64) -> String {
    format!("fill-opacity=\"{:.2}\"", OPACITY_MIN + (1.0 - OPACITY_MIN) * value)
}

/// Evenly spread cells, each around its number.
struct Cells {
    first: f64,
    step: f64,
    n: usize,
}

impl Cells {
    /// * `scale` — from the numbers to those of the axis
    fn around(numbers: &[f64], scale: f64) -> Self {
        let (first, last) = (numbers[0], numbers[numbers.len() - 1]);
        let n_steps = (numbers.len() - 1).max(1) as f64;
        // A single number: a cell as wide as it is large.
        let step = if last > first { (last - first) / n_steps } else { first.abs().max(1.0) };
        Self { first: scale * (first - step / 2.0), step: scale * step, n: numbers.len() }
    }

    fn edge(&self, index: usize) -> f64 {
        self.first + self.step * index as f64
    }

    fn range(&self) -> (f64, f64) {
        (self.edge(0), self.edge(self.n))
    }
}
