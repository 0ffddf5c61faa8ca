//! A heat matrix: numbers of rows and columns as shades, with the numbers written where they fit.

use kinds_model::Register;

use super::chart::fitted;
use super::drawing::{Drawing, WIDTH_MAX};
use super::markup::px;

/// What a heat matrix says.
#[derive(Clone, Debug)]
pub(super) struct Matrix<'a> {
    /// Of the panel.
    pub(super) name: &'a str,
    /// Stands above the names of the rows.
    pub(super) row_title: &'a str,
    /// Stands above the names of the columns.
    pub(super) column_title: &'a str,
    pub(super) rows: Vec<String>,
    pub(super) columns: Vec<String>,
    /// Shape `(n_rows, n_columns)`.
    pub(super) cells: Vec<Vec<Cell>>,
}

/// A cell of a heat matrix.
#[derive(Clone, Debug)]
pub(super) struct Cell {
    /// From 0, nothing, to 1, everything.
    pub(super) shade: f64,
    /// The number; empty for a cell that is to stay so.
    pub(super) text: String,
}

const CELL_PX_MAX: f64 = 46.0;
const ROW_PX_MAX: f64 = 26.0;
/// Least height of a row that has a name or numbers.
const TEXT_ROW_PX: f64 = 17.0;
const LETTER_PX: f64 = 7.5;
const NAMES_PX_MAX: f64 = 130.0;
const TOP_PX: f64 = 68.0;

/// Opacity of the darkest shade: on it, the colour of text has a contrast of 4.5 still, in light and in dark.
const OPACITY_MAX: f64 = 0.5;

impl Matrix<'_> {
    /// Draws it. Where cells are too small for their numbers, shades alone are left, and only some rows and columns are named.
    pub(super) fn draw(&self) -> Drawing {
        let letters = |names: &[String]| names.iter().map(|name| name.chars().count()).max().unwrap_or(0);
        let names_px = (LETTER_PX * letters(&self.rows).max(self.row_title.chars().count()) as f64 + 10.0)
            .min(NAMES_PX_MAX);
        let (n_rows, n_columns) = (self.rows.len().max(1) as f64, self.columns.len().max(1) as f64);
        let cell_px = ((WIDTH_MAX - names_px) / n_columns).min(CELL_PX_MAX);
        let row_px = if cell_px >= TEXT_ROW_PX { cell_px.min(ROW_PX_MAX) } else { cell_px };
        let label = format!("{}, {} by {}", self.name, self.row_title, self.column_title);
        let mut drawing = Drawing::new(WIDTH_MAX, TOP_PX + row_px * n_rows + 4.0, &label);
        drawing.text((0.0, 13.0), "name", self.name);
        drawing.text((names_px, 38.0), "quiet", self.column_title);
        drawing.text((0.0, TOP_PX - 8.0), "quiet", self.row_title);
        let step = |needed_px: f64, given_px: f64| (needed_px / given_px).ceil().max(1.0) as usize;
        let column_letters = letters(&self.columns);
        for (index, name) in self.columns.iter().enumerate() {
            if index % step(LETTER_PX * column_letters as f64 + 4.0, cell_px) == 0 {
                let x = names_px + cell_px * (index as f64 + 0.5);
                drawing.text((x, TOP_PX - 8.0), "middle", name);
            }
        }
        for (index, (name, cells)) in self.rows.iter().zip(&self.cells).enumerate() {
            let y = TOP_PX + row_px * index as f64;
            let base = y + row_px / 2.0 + 4.5;
            if index % step(TEXT_ROW_PX, row_px) == 0 {
                drawing.text((names_px - 8.0, base), "end", &fitted(name, names_px - 8.0));
            }
            for (column, cell) in cells.iter().enumerate() {
                let x = names_px + cell_px * column as f64;
                shade(&mut drawing, (x, y), (cell_px, row_px), cell.shade);
                let fits = LETTER_PX * cell.text.chars().count() as f64 + 2.0 <= cell_px;
                if fits && row_px >= TEXT_ROW_PX {
                    drawing.text((x + cell_px / 2.0, base), "middle", &cell.text);
                }
            }
        }
        drawing.frame((names_px, TOP_PX), (cell_px * n_columns, row_px * n_rows));
        drawing
    }
}

/// Names of rows that are kinds.
pub(super) fn rows_of_kinds(register: &Register) -> Vec<String> {
    (0..register.kinds().len()).map(|kind| register.label(kind)).collect()
}

/// Names of columns that are kinds: a cell is as wide as a number.
pub(super) fn columns_of_kinds(register: &Register) -> Vec<String> {
    register.kinds().iter().map(|record| record.number.to_string()).collect()
}

/// Says what shades mean.
///
/// * `shades` — of which number, and how dark
pub(super) fn shades_legend(title: &str, shades: &[(&str, f64)]) -> Drawing {
    const BOX_PX: f64 = 62.0;
    let width = BOX_PX * shades.len() as f64;
    let mut drawing = Drawing::new(width.max(200.0), 46.0, title);
    drawing.text((0.0, 13.0), "quiet", title);
    for (index, (text, of)) in shades.iter().enumerate() {
        let x = BOX_PX * index as f64;
        shade(&mut drawing, (x, 20.0), (BOX_PX, 22.0), *of);
        drawing.text((x + BOX_PX / 2.0, 35.5), "middle", text);
    }
    drawing.frame((0.0, 20.0), (width, 22.0));
    drawing
}

fn shade(drawing: &mut Drawing, (x, y): (f64, f64), (width, height): (f64, f64), shade: f64) {
    let opacity = OPACITY_MAX * shade.clamp(0.0, 1.0);
    if opacity > 0.0 {
        let path = format!("M{} {}h{}v{}h-{}z", px(x), px(y), px(width), px(height), px(width));
        drawing.path_with(&path, "heat", &format!("fill-opacity=\"{opacity:.3}\""));
    }
}
