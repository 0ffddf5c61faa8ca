//! A figure: pictures that belong together, what they show, and the numbers drawn.

use super::drawing::{Drawing, WIDTH_MAX};
use super::markup::{Csv, escaped, px};
use super::theme;

/// One figure of a report, complete in itself.
///
/// On a page its panels wrap to the width that there is; as a file of its own they stand side by side.
#[derive(Clone, Debug)]
pub struct Figure {
    name: String,
    title: String,
    caption: String,
    legend: Option<Drawing>,
    panels: Vec<Drawing>,
    csv: String,
}

const GAP_PX: f64 = 24.0;

/// Width of what is drawn in a file of its own, pixels, at most: two of the widest panels.
const SHEET_PX: f64 = 2.0 * WIDTH_MAX + GAP_PX;

impl Figure {
    pub(super) fn new(
        name: &str,
        title: &str,
        caption: String,
        legend: Option<Drawing>,
        panels: Vec<Drawing>,
        csv: Csv,
    ) -> Self {
        Self { name: name.into(), title: title.into(), caption, legend, panels, csv: csv.into_text() }
    }

    /// What its files are called, without their extension.
    pub fn name(&self) -> &str {
        &self.name
    }

    /// What it shows, in a few words.
    pub fn title(&self) -> &str {
        &self.title
    }

    /// How to read it.
    pub fn caption(&self) -> &str {
        &self.caption
    }

    /// The numbers drawn: comma-separated values with titles that name their units.
    pub fn csv(&self) -> &str {
        &self.csv
    }

    /// The figure for a file of its own, with title, style sheet and paper: light, or dark where the viewer is.
    pub fn to_svg(&self) -> String {
        let parts = self.placed();
        let ends = |end: fn(&Placed) -> f64| parts.iter().map(end).fold(0.0, f64::max);
        // Bold letters of 16 px are about 10 px wide.
        let title_px = 10.0 * self.title.chars().count() as f64;
        let width = ends(|part| part.x + part.drawing.width).max(GAP_PX + title_px) + GAP_PX;
        let height = ends(|part| part.y + part.drawing.height) + GAP_PX;
        let (width, height, title) = (px(width), px(height), escaped(&self.title));
        let drawn: String = parts.iter().map(Placed::to_svg).collect();
        format!(
            "<svg xmlns=\"http://www.w3.org/2000/svg\" class=\"picture\" role=\"img\" width=\"{width}\" height=\"{height}\" \
             viewBox=\"0 0 {width} {height}\">\n<title>{title}</title>\n<desc>{}</desc>\n<style>\n{}</style>\n\
             <rect class=\"paper\" width=\"100%\" height=\"100%\"/>\n\
             <text x=\"{GAP_PX}\" y=\"36\" class=\"name\" font-size=\"16\">{title}</text>\n{drawn}</svg>\n",
            escaped(&self.caption),
            theme::of_figure()
        )
    }

    /// As a part of a page, whose style sheet it needs.
    pub(super) fn to_html(&self) -> String {
        let legend =
            self.legend.as_ref().map(|legend| format!("<div class=\"legend\">{}</div>", legend.to_svg()));
        let panels: String = self.panels.iter().map(Drawing::to_svg).collect();
        format!(
            "<figure id=\"{}\">\n<h3>{}</h3>\n<div class=\"panels\">{}{panels}</div>\n<figcaption>{}</figcaption>\n</figure>\n",
            escaped(&self.name),
            escaped(&self.title),
            legend.unwrap_or_default(),
            escaped(&self.caption)
        )
    }

    /// Legend and panels on a sheet of their own, row by row.
    fn placed(&self) -> Vec<Placed<'_>> {
        let mut placed = Vec::new();
        // Below the title.
        let (mut x, mut y, mut row_px) = (GAP_PX, 60.0, 0.0_f64);
        if let Some(drawing) = &self.legend {
            placed.push(Placed { x, y, drawing });
            y += drawing.height + GAP_PX;
        }
        for drawing in &self.panels {
            if x > GAP_PX && x + drawing.width > GAP_PX + SHEET_PX {
                (x, y, row_px) = (GAP_PX, y + row_px + GAP_PX, 0.0);
            }
            placed.push(Placed { x, y, drawing });
            x += drawing.width + GAP_PX;
            row_px = row_px.max(drawing.height);
        }
        placed
    }
}

/// A drawing on a larger sheet: its left upper corner, pixels.
struct Placed<'a> {
    x: f64,
    y: f64,
    drawing: &'a Drawing,
}

impl Placed<'_> {
    fn to_svg(&self) -> String {
        format!("<g transform=\"translate({} {})\">\n{}</g>\n", px(self.x), px(self.y), self.drawing.body())
    }
}
