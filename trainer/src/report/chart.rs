//! A chart: a drawing with two axes.

use std::borrow::Cow;

use kinds_model::Register;

use super::axis::{Scale, Ticks};
use super::drawing::{Drawing, WIDTH_MAX};
use super::markup::{polyline, px};

/// What an axis says.
#[derive(Clone, Copy, Debug)]
pub(super) struct Axis<'a> {
    pub(super) title: &'a str,
    /// Stands after the title; empty for numbers without.
    pub(super) unit: &'a str,
    /// From left to right, from bottom to top: the first may be the larger.
    pub(super) range: (f64, f64),
    /// Least distance between ticks: 1 for what is counted, 0 for what is measured.
    pub(super) step_min: f64,
    /// About how far ticks are to be from each other; infinite for an axis without any.
    pub(super) px_per_tick: f64,
}

/// Distances of ticks that leave their labels room.
pub(super) const X_PX_PER_TICK: f64 = 60.0;
pub(super) const Y_PX_PER_TICK: f64 = 40.0;

/// A drawing with axes.
#[derive(Clone, Debug)]
pub(super) struct Chart {
    pub(super) drawing: Drawing,
    x: Scale,
    y: Scale,
    /// Left, top, right, bottom of the space between the axes, pixels.
    area: [f64; 4],
}

const LEFT_PX: f64 = 52.0;
const RIGHT_PX: f64 = 14.0;
const BOTTOM_PX: f64 = 42.0;
const NAME_PX: f64 = 20.0;
const Y_TITLE_PX: f64 = 26.0;

/// What axes and titles take of a drawing's width and height, pixels.
pub(super) const MARGINS_PX: (f64, f64) = (LEFT_PX + RIGHT_PX, NAME_PX + Y_TITLE_PX + BOTTOM_PX);

impl Axis<'_> {
    fn ticks(&self, length_px: f64) -> Ticks {
        Ticks::new(self.range, (length_px / self.px_per_tick).round() as usize, self.step_min)
    }

    /// `title, unit`, with the power of ten that the labels leave out.
    fn titled(&self, ticks: &Ticks) -> String {
        match ticks.unit(self.unit) {
            unit if unit.is_empty() => self.title.to_string(),
            unit => format!("{}, {}", self.title, unit.trim_end()),
        }
    }
}

impl Chart {
    /// Draws the axes. The y axis has its title above it, where it is read without turning one's head.
    ///
    /// * `name` — of the panel; empty where the figure has no other
    pub(super) fn new((width, height): (f64, f64), name: &str, x: Axis, y: Axis) -> Self {
        let says = [name, y.title, x.title].into_iter().filter(|text| !text.is_empty());
        let mut drawing = Drawing::new(width, height, &says.collect::<Vec<_>>().join(", "));
        let top = if name.is_empty() { Y_TITLE_PX } else { NAME_PX + Y_TITLE_PX };
        let area = [LEFT_PX, top, width - RIGHT_PX, height - BOTTOM_PX];
        let [left, top, right, bottom] = area;
        let x_scale = Scale::new(x.range, (left, right));
        let y_scale = Scale::new(y.range, (bottom, top));
        let (x_ticks, y_ticks) = (x.ticks(right - left), y.ticks(bottom - top));
        for value in &y_ticks.values {
            let y_px = y_scale.px(*value);
            drawing.line((left, y_px), (right, y_px), "grid");
            drawing.text((left - 7.0, y_px + 4.5), "quiet end", &y_ticks.label(*value));
        }
        for value in &x_ticks.values {
            let x_px = x_scale.px(*value);
            drawing.line((x_px, bottom), (x_px, bottom + 4.0), "axis");
            drawing.text((x_px, bottom + 18.0), "quiet middle", &x_ticks.label(*value));
        }
        drawing.line((left, bottom), (right, bottom), "axis");
        drawing.text((0.0, 13.0), "name", &fitted(name, width));
        drawing.text((0.0, top - Y_TITLE_PX + 13.0), "quiet", &y.titled(&y_ticks));
        drawing.text((right, bottom + 36.0), "quiet end", &x.titled(&x_ticks));
        Self { drawing, x: x_scale, y: y_scale, area }
    }

    /// Draws the axes, and a row for each kind, the first on top, where reading begins.
    pub(super) fn of_kinds(name: &str, register: &Register, row_px: f64, x: Axis) -> Self {
        let n_kinds = register.kinds().len() as f64;
        let range = (n_kinds - 0.5, -0.5);
        // Numbers of kinds are not those of rows: no ticks.
        let y = Axis { title: "kind", unit: "", range, step_min: 0.0, px_per_tick: f64::INFINITY };
        let mut chart = Self::new((WIDTH_MAX, row_px * n_kinds + MARGINS_PX.1), name, x, y);
        let [left, _, right, _] = chart.area;
        for (row, record) in register.kinds().iter().enumerate() {
            let y_px = chart.y.px(row as f64);
            chart.drawing.line((left, y_px), (right, y_px), "grid");
            chart.drawing.text((left - 7.0, y_px + 4.5), "quiet end", &record.number.to_string());
        }
        chart
    }

    /// Where a pair of numbers is, pixels.
    pub(super) fn at(&self, (x, y): (f64, f64)) -> (f64, f64) {
        (self.x.px(x), self.y.px(y))
    }

    /// Draws a line through pairs of numbers, passing over those that are not finite.
    pub(super) fn line(&mut self, pairs: &[(f64, f64)], class: &str, stroke_px: f64) {
        let finite = pairs.iter().filter(|(x, y)| x.is_finite() && y.is_finite());
        let path = polyline(finite.map(|pair| self.at(*pair)));
        self.drawing.path(&path, &format!("line {class}"), stroke_px);
    }

    /// Draws a dot: a line of no length with round ends, which has its colour from the same classes as lines.
    pub(super) fn dot(&mut self, pair: (f64, f64), class: &str, diameter_px: f64) {
        let (x, y) = self.at(pair);
        self.drawing.path(&format!("M{} {}h0", px(x), px(y)), &format!("line round {class}"), diameter_px);
    }

    /// Names a line of the chart at the top right.
    ///
    /// * `row` — which of the names, from the top
    pub(super) fn name_line(&mut self, row: usize, name: &str, class: &str, stroke_px: f64) {
        const SAMPLE_PX: f64 = 26.0;
        let [_, top, right, _] = self.area;
        // Below the words of a mark, which may stand on this side too.
        let y = top + 22.0 + 19.0 * row as f64;
        self.drawing.text((right - SAMPLE_PX - 8.0, y + 4.5), "end halo", name);
        let sample = polyline([(right - SAMPLE_PX, y), (right, y)]);
        self.drawing.path(&sample, &format!("line {class}"), stroke_px);
    }

    /// Marks a number on the x axis from top to bottom.
    pub(super) fn mark_x(&mut self, x: f64, text: &str) {
        let [left, top, right, bottom] = self.area;
        let x_px = self.x.px(x);
        self.drawing.line((x_px, top - 6.0), (x_px, bottom), "dotted");
        // Beside the line, on the side that has room.
        let (place, class) =
            if x_px < (left + right) / 2.0 { (x_px + 5.0, "halo") } else { (x_px - 5.0, "end halo") };
        self.drawing.text((place, top + 4.0), class, text);
    }
}

/// A name that a drawing has room for: cut if it is too long. What a screen reader says stays whole.
pub(super) fn fitted(name: &str, width_px: f64) -> Cow<'_, str> {
    // Bold letters of 13 px are about 8 px wide.
    let n_letters = (width_px / 8.0) as usize;
    match name.char_indices().nth(n_letters) {
        None => Cow::Borrowed(name),
        Some(_) => Cow::Owned(name.chars().take(n_letters - 1).chain(['…']).collect()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_name_longer_than_its_drawing_is_cut_and_says_so() {
        assert_eq!(fitted("trip 1", 80.0), "trip 1");
        assert_eq!(fitted("0123456789", 80.0), "0123456789");
        assert_eq!(fitted("κ0123456789", 80.0), "κ01234567…");
    }
}
