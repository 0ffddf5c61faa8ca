//! Canonical views of rings of ranges, as a robot seen from above with ahead upwards.

use std::f64::consts::TAU;

use kinds_model::SensorLayout;

use super::axis::Ticks;
use super::canonical::{DIFFERENCE_SHARE_MIN, View, Views};
use super::drawing::{Drawing, WIDTH_MAX};
use super::kind_style::KindStyle;
use super::markup::polyline;
use super::views::panel;

const HEIGHT_PX: f64 = 248.0;
const RADIUS_PX: f64 = 92.0;
const CENTRE_Y_PX: f64 = 126.0;
/// Of the mean on the left and of the difference on the right.
const CENTRES_PX: [(f64, f64); 2] = [(105.0, CENTRE_Y_PX), (WIDTH_MAX - 105.0, CENTRE_Y_PX)];

/// Lines of the rows of a sensor, so that rings of different sensors are told apart.
const ROW_DASHES: [&str; 4] =
    ["", " stroke-dasharray=\"5 3\"", " stroke-dasharray=\"1.5 3\"", " stroke-dasharray=\"9 3 2 3\""];

/// Bearing of a reading from ahead, counter-clockwise, rad: row r of R rows of C columns looks at `2π (c + r / R) / C`.
fn bearing_rad(layout: SensorLayout, reading: usize) -> f64 {
    let (rows, columns) = (f64::from(layout.rows), layout.columns as usize);
    let (row, column) = (reading / columns, reading % columns);
    TAU * (column as f64 + row as f64 / rows) / columns as f64
}

/// Legend, a panel for each kind, and how to read them.
pub(super) fn draw(layout: SensorLayout, views: &Views) -> (Drawing, Vec<Drawing>, String) {
    let longest = views
        .of_kinds
        .iter()
        .flat_map(|view| view.medoid.iter().chain(view.around.iter().map(|(_, high)| high)));
    let reach = longest.fold(0.0_f64, |longest, value| longest.max(*value)).max(f64::MIN_POSITIVE);
    let differences = views.of_kinds.iter().flat_map(|view| &view.difference);
    // Of a single kind nothing but rounding is left: that is not to fill the panel.
    let largest = differences.fold(reach * DIFFERENCE_SHARE_MIN, |largest, value| largest.max(value.abs()));
    let scales = Scales { unit: views.unit.name(), reach, largest };
    let panels = views.of_kinds.iter().enumerate();
    let panels = panels.map(|(kind, view)| rings(layout, kind, view, &scales)).collect();
    let rows = match layout.rows {
        1 => "",
        _ => "; the second row of sensors is dashed",
    };
    let how = format!(
        "Seen from above, ahead is upwards. Left: mean reading of each sensor (the kind's colour{rows}), one standard deviation \
         around it (grey), medoid (dotted). Right: mean less that of all frames, outwards from the circle where the kind sees \
         farther, inwards where it sees nearer. Drawn as if the first reading looked ahead and the others followed \
         counter-clockwise at equal angles."
    );
    (legend(), panels, how)
}

/// What is common to all panels, so that kinds can be compared.
struct Scales {
    unit: &'static str,
    /// Number at the outer end of a ray on the left.
    reach: f64,
    /// Largest difference of all.
    largest: f64,
}

/// A place on a ray. Ahead, which is x, points up; left, which is y, points left.
fn on_ray((x, y): (f64, f64), bearing_rad: f64, radius_px: f64) -> (f64, f64) {
    (x - radius_px * bearing_rad.sin(), y - radius_px * bearing_rad.cos())
}

fn rings(layout: SensorLayout, kind: usize, view: &View, scales: &Scales) -> Drawing {
    let mut drawing = panel((WIDTH_MAX, HEIGHT_PX), view);
    drawing.text((WIDTH_MAX, 13.0), "quiet end", &format!("medoid: frame {}", view.medoid_frame));
    draw_mean(&mut drawing, layout, kind, view, scales);
    draw_difference(&mut drawing, layout, view, scales);
    drawing
}

fn draw_mean(drawing: &mut Drawing, layout: SensorLayout, kind: usize, view: &View, scales: &Scales) {
    let centre = CENTRES_PX[0];
    let px = |value: f64| RADIUS_PX * value / scales.reach;
    let ticks = Ticks::new((0.0, scales.reach), 3, 0.0);
    for value in ticks.values.iter().filter(|value| **value > 0.0) {
        drawing.circle(centre, px(*value), "frame", 1.0);
    }
    let at = |reading: usize, value: f64| on_ray(centre, bearing_rad(layout, reading), px(value));
    for (reading, (low, high)) in view.around.iter().enumerate() {
        drawing.path(&polyline([at(reading, *low), at(reading, *high)]), "spread", 1.4);
    }
    let columns = layout.columns as usize;
    for (row, readings) in (0..layout.n_readings()).collect::<Vec<_>>().chunks(columns).enumerate() {
        let outline =
            |values: &[f64]| polyline(readings.iter().map(|&reading| at(reading, values[reading]))) + "z";
        let dashes = ROW_DASHES[row % ROW_DASHES.len()];
        drawing.path(&outline(&view.medoid), "dotted", 1.2);
        let class = format!("line {}", KindStyle::of(kind).colour_class());
        drawing.path_with(&outline(&view.mean), &class, &format!("stroke-width=\"2.6\"{dashes}"));
    }
    write_step(drawing, centre.0, &ticks, scales.unit, "");
}

fn draw_difference(drawing: &mut Drawing, layout: SensorLayout, view: &View, scales: &Scales) {
    let centre = CENTRES_PX[1];
    let zero_px = 0.55 * RADIUS_PX;
    let px = |value: f64| zero_px + (RADIUS_PX - zero_px) * value / scales.largest;
    let ticks = Ticks::new((-scales.largest, scales.largest), 5, 0.0);
    for value in &ticks.values {
        let class = if *value == 0.0 { "axis" } else { "frame" };
        drawing.circle(centre, px(*value), class, 1.0);
    }
    for (reading, value) in view.difference.iter().enumerate() {
        let at = |value: f64| on_ray(centre, bearing_rad(layout, reading), px(value));
        let class = if *value < 0.0 { "nearer" } else { "farther" };
        // Many narrow rays of a laser scanner must not lie on each other.
        let width_px = (TAU * zero_px / layout.n_readings() as f64 * 0.6).clamp(0.8, 7.0);
        drawing.path(&polyline([at(0.0), at(*value)]), class, width_px);
    }
    write_step(drawing, centre.0, &ticks, scales.unit, "; the strong one is 0");
}

/// Says below the rings how far they are apart: numbers on them would lie on the rays.
fn write_step(drawing: &mut Drawing, x: f64, ticks: &Ticks, unit: &str, more: &str) {
    if let [first, second, ..] = ticks.values[..] {
        let step = format!("rings: {} {}{more}", ticks.label(second - first), ticks.unit(unit));
        drawing.text((x, HEIGHT_PX - 6.0), "quiet middle", &step);
    }
}

fn legend() -> Drawing {
    let mut drawing = Drawing::new(WIDTH_MAX, 44.0, "legend: mean, spread, medoid, farther, nearer");
    let entries = [
        ("mean", "line c0", 2.6),
        ("spread", "spread", 1.4),
        ("medoid", "dotted", 1.2),
        ("farther", "farther", 7.0),
        ("nearer", "nearer", 7.0),
    ];
    for (index, (name, class, width_px)) in entries.into_iter().enumerate() {
        let (x, y) = ((index % 3) as f64 * 110.0, 11.0 + (index / 3) as f64 * 22.0);
        drawing.path(&format!("M{} {y}h22", x + 2.0), class, width_px);
        drawing.text((x + 30.0, y + 4.5), "", name);
    }
    drawing
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn two_rings_of_eight_look_between_each_other_and_the_left_is_drawn_left() {
        let layout = SensorLayout { rows: 2, columns: 8, metres_per_count: 0.001 };
        let degrees: Vec<f64> =
            [0, 1, 7, 8, 9].map(|reading| bearing_rad(layout, reading).to_degrees()).into();
        for (found, expected) in degrees.iter().zip([0.0, 45.0, 315.0, 22.5, 67.5]) {
            assert!((found - expected).abs() < 1e-9, "{degrees:?}");
        }
        let (ahead, left) = (on_ray((0.0, 0.0), 0.0, 10.0), on_ray((0.0, 0.0), TAU / 4.0, 10.0));
        assert!(ahead.0.abs() < 1e-9 && (ahead.1 + 10.0).abs() < 1e-9, "{ahead:?}");
        assert!((left.0 + 10.0).abs() < 1e-9 && left.1.abs() < 1e-9, "{left:?}");
    }
}
