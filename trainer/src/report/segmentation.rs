//! A person's own segmentation beside the kinds: agreement, and where there is none.

use kinds_model::Register;

use super::figure::Figure;
use super::kind_style::called;
use super::markup::Csv;
use super::matrix::{Cell, Matrix, columns_of_kinds, shades_legend};
use super::page::{Column, Page, Table};
use super::scores::{signed, tenths};
use crate::segmentation::SegmentationAgreement;

/// Disagreements of each direction that the page lists.
const N_LISTED_MAX: usize = 20;

/// Adds how far names and kinds agree, and where they do not.
pub fn add_segmentation(page: &mut Page, register: &Register, agreement: &SegmentationAgreement) {
    page.section("A person's own segmentation");
    let share = agreement.n_frames_named as f64 / agreement.n_frames.max(1) as f64;
    page.paragraph(&format!(
        "{} of the frames have one of {} names. Adjusted mutual information between names and kinds: {}.",
        tenths(share),
        agreement.names.len(),
        signed(agreement.ami)
    ));
    page.figure(names_and_kinds("segmentation", "Names and kinds", register, agreement));
    page.paragraph("To the person the same place as elsewhere, to the robot another:");
    let rows = agreement.kinds_differ.iter().map(|differs| {
        let [usual, here] = [differs.usual_kind, differs.kind].map(|kind| called(register, kind));
        let what = [differs.name.clone(), usual, here];
        (differs.trip.clone(), differs.from_s, differs.to_s, differs.n_frames, what)
    });
    add_list(page, ["name", "usually", "here"], rows.collect());
    page.paragraph("To the robot the same place as elsewhere, to the person another:");
    let rows = agreement.names_differ.iter().map(|differs| {
        let what = [called(register, differs.kind), differs.usual_name.clone(), differs.name.clone()];
        (differs.trip.clone(), differs.from_s, differs.to_s, differs.n_frames, what)
    });
    add_list(page, ["kind", "usually", "here"], rows.collect());
}

type Differs = (String, f64, f64, usize, [String; 3]);

fn add_list(page: &mut Page, titles: [&str; 3], rows: Vec<Differs>) {
    if rows.is_empty() {
        page.paragraph("Nowhere.");
        return;
    }
    let texts = [titles[0], titles[1], titles[2], "trip"].map(Column::text);
    let mut table =
        Table::new(texts.into_iter().chain(["from", "to", "frames"].map(Column::number)).collect());
    for (trip, from_s, to_s, n_frames, [of, usual, here]) in rows.iter().take(N_LISTED_MAX).cloned() {
        let seconds = |time_s: f64| format!("{time_s:.1}\u{a0}s");
        table.row(vec![of, usual, here, trip, seconds(from_s), seconds(to_s), n_frames.to_string()]);
    }
    page.table(&table);
    if rows.len() > N_LISTED_MAX {
        page.paragraph(&format!("And {} shorter stretches.", rows.len() - N_LISTED_MAX));
    }
}

/// Frames of each name and kind.
///
/// * `name`, `title` — of the figure; its files have the name
pub fn names_and_kinds(
    name: &str,
    title: &str,
    register: &Register,
    agreement: &SegmentationAgreement,
) -> Figure {
    let mut csv = Csv::new(&["name", "kind", "n_frames"]);
    let cells = agreement.names.iter().zip(&agreement.n_frames_of).map(|(name, row)| {
        let n_frames: usize = row.iter().sum();
        let cell = |(kind, &n): (usize, &usize)| {
            csv.line(&[name, &register.number(kind), &n]);
            let share = n as f64 / n_frames.max(1) as f64;
            Cell { shade: share, text: if n == 0 { String::new() } else { n.to_string() } }
        };
        row.iter().enumerate().map(cell).collect()
    });
    let matrix = Matrix {
        name: "",
        row_title: "name",
        column_title: "kind, frames",
        cells: cells.collect(),
        rows: agreement.names.clone(),
        columns: columns_of_kinds(register),
    };
    let panels = vec![matrix.draw()];
    let caption = "How many frames of each name have which kind; shades are shares of the row. A name with one dark cell is one place \
                   to the robot, too; a kind dark under two names is two places that it cannot tell apart."
        .to_string();
    let legend = shades_legend("share of the row", &[("0 %", 0.0), ("50 %", 0.5), ("100 %", 1.0)]);
    Figure::new(name, title, caption, Some(legend), panels, csv)
}
