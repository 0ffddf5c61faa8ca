//! One picture: marks on a sheet of given size, as SVG.

use std::fmt::Write;

use super::markup::{escaped, px};

/// A sheet to draw on. Marks name classes of `figure.css`, never colours, so that light and dark are one picture.
///
/// Text is 13 px and a sheet at most [`WIDTH_MAX`] wide: a narrow telephone shows it at about its size.
#[derive(Clone, Debug)]
pub(super) struct Drawing {
    pub(super) width: f64,
    pub(super) height: f64,
    /// What a screen reader says.
    label: String,
    body: String,
}

/// Widest sheet, pixels. On a page 400 px wide its text is still above 11 px.
pub(super) const WIDTH_MAX: f64 = 420.0;

impl Drawing {
    pub(super) fn new(width: f64, height: f64, label: &str) -> Self {
        assert!(width <= WIDTH_MAX, "a sheet {width} px wide would be shrunk until its text is too small");
        Self { width, height, label: label.to_string(), body: String::new() }
    }

    /// Writes text with its base line at a place.
    pub(super) fn text(&mut self, (x, y): (f64, f64), class: &str, text: &str) {
        if text.is_empty() {
            return;
        }
        let class = if class.is_empty() { String::new() } else { format!(" class=\"{class}\"") };
        self.add(format_args!("<text x=\"{}\" y=\"{}\"{class}>{}</text>", px(x), px(y), escaped(text)));
    }

    /// Draws a path (`d` as SVG has it).
    pub(super) fn path(&mut self, d: &str, class: &str, stroke_px: f64) {
        self.add(format_args!("<path d=\"{d}\" class=\"{class}\" stroke-width=\"{}\"/>", px(stroke_px)));
    }

    /// Draws a path with more attributes.
    pub(super) fn path_with(&mut self, d: &str, class: &str, attributes: &str) {
        self.add(format_args!("<path d=\"{d}\" class=\"{class}\" {attributes}/>"));
    }

    pub(super) fn line(&mut self, (x1, y1): (f64, f64), (x2, y2): (f64, f64), class: &str) {
        self.path(&format!("M{} {}L{} {}", px(x1), px(y1), px(x2), px(y2)), class, 1.0);
    }

    pub(super) fn circle(&mut self, (x, y): (f64, f64), radius: f64, class: &str, stroke_px: f64) {
        self.add(format_args!(
            "<circle cx=\"{}\" cy=\"{}\" r=\"{}\" class=\"{class}\" stroke-width=\"{}\"/>",
            px(x),
            px(y),
            px(radius),
            px(stroke_px)
        ));
    }

    pub(super) fn frame(&mut self, (x, y): (f64, f64), (width, height): (f64, f64)) {
        self.path(
            &format!("M{} {}h{}v{}h-{}z", px(x), px(y), px(width), px(height), px(width)),
            "frame",
            1.0,
        );
    }

    /// Places an image, whose address is data.
    pub(super) fn image(&mut self, (x, y): (f64, f64), (width, height): (f64, f64), data: &str) {
        self.add(format_args!(
            "<image x=\"{}\" y=\"{}\" width=\"{}\" height=\"{}\" preserveAspectRatio=\"none\" href=\"{data}\"/>",
            px(x),
            px(y),
            px(width),
            px(height)
        ));
    }

    /// The marks alone.
    pub(super) fn body(&self) -> &str {
        &self.body
    }

    /// As a part of a page.
    pub(super) fn to_svg(&self) -> String {
        let (width, height, label) = (px(self.width), px(self.height), escaped(&self.label));
        format!(
            "<svg xmlns=\"http://www.w3.org/2000/svg\" class=\"picture\" role=\"img\" aria-label=\"{label}\" \
             width=\"{width}\" height=\"{height}\" viewBox=\"0 0 {width} {height}\"><title>{label}</title>{}</svg>",
            self.body
        )
    }

    fn add(&mut self, mark: std::fmt::Arguments<'_>) {
        self.body.write_fmt(mark).expect("a string takes all that is written");
        self.body.push('\n');
    }
}
