//! What a trip's kinds are as a sequence: how often they change, how long they last, and what follows what.

use kinds_model::Register;

use super::axis::range;
use super::chart::{Axis, Chart, X_PX_PER_TICK};
use super::drawing::Drawing;
use super::evaluation::{elsewhere, file};
use super::figure::Figure;
use super::kind_style::{KindStyle, legend_of_names, runs};
use super::markup::Csv;
use super::matrix::{Cell, Matrix, columns_of_kinds, rows_of_kinds, shades_legend};
use super::page::{Column, Page, Table};
use crate::sequence::Sequence;
use crate::trip_kinds::TripKinds;

const ROW_PX: f64 = 24.0;

/// Adds the sequences of the trips through one space.
///
/// * `sequences` — of the trips, in their order
pub fn add_sequences(
    page: &mut Page,
    space: usize,
    register: &Register,
    trips: &[TripKinds],
    sequences: &[Sequence],
) {
    page.section(&elsewhere("Kinds one after the other", space));
    page.paragraph(
        "Kinds that say something of places last while the robot goes on; kinds that say nothing change from frame to frame. The \
         last two columns are how many frames they last in the mean, and how many if the same frames came in any order.",
    );
    page.table(&sequence_table(sequences));
    let title = "What follows what";
    page.figure(transitions(&file("transitions", space), title, register, sequences));
    page.figure(run_lengths(&file("run-lengths", space), "How long kinds last", register, trips));
}

/// A row for each trip.
pub fn sequence_table(sequences: &[Sequence]) -> Table {
    let numbers = [
        "frames",
        "switches",
        "per second",
        "per metre",
        "a kind lasts",
        "median",
        "longest",
        "frames",
        "in any order",
    ];
    let columns = [Column::text("trip")].into_iter().chain(numbers.map(Column::number));
    let mut table = Table::new(columns.collect());
    let rate = |rate: Option<f64>| rate.map_or("–".to_string(), |rate| format!("{rate:.2}"));
    for sequence in sequences {
        table.row(vec![
            sequence.trip.clone(),
            sequence.n_frames.to_string(),
            sequence.n_switches.to_string(),
            rate(sequence.switches_per_s),
            rate(sequence.switches_per_m),
            format!("{:.1}\u{a0}s", sequence.run_s.mean),
            format!("{:.1}\u{a0}s", sequence.run_s.median),
            format!("{:.1}\u{a0}s", sequence.run_s.longest),
            format!("{:.1}", sequence.run_frames.mean),
            format!("{:.1}", sequence.run_frames_shuffled),
        ]);
    }
    table
}

/// How often one kind is followed by another, a matrix for each trip.
///
/// * `name`, `title` — of the figure; its files have the name
pub fn transitions(name: &str, title: &str, register: &Register, sequences: &[Sequence]) -> Figure {
    let mut csv = Csv::new(&["trip", "kind", "next_kind", "n_frames"]);
    let panels = sequences.iter().map(|sequence| {
        let cells = sequence.n_transitions.iter().enumerate().map(|(kind, row)| {
            // What stays is most of everything, and would hide what changes.
            let n_left: usize =
                row.iter().enumerate().filter(|(next, _)| *next != kind).map(|(_, n)| n).sum();
            let cell = |(next, &n): (usize, &usize)| {
                csv.line(&[&sequence.trip, &register.number(kind), &register.number(next), &n]);
                let share = if next == kind { 0.0 } else { n as f64 / n_left.max(1) as f64 };
                Cell { shade: share, text: if n == 0 { String::new() } else { n.to_string() } }
            };
            row.iter().enumerate().map(cell).collect()
        });
        let matrix = Matrix {
            name: &sequence.trip,
            row_title: "kind",
            column_title: "kind of the next frame, frames",
            cells: cells.collect(),
            rows: rows_of_kinds(register),
            columns: columns_of_kinds(register),
        };
        matrix.draw()
    });
    let panels: Vec<Drawing> = panels.collect();
    let caption = "How many frames of the row's kind were followed by a frame of the column's. Shades leave the diagonal, which \
                   is where the kind stays, out: they are shares of the changes away from the row's kind."
        .to_string();
    let legend = shades_legend("share of the changes away", &[("0 %", 0.0), ("50 %", 0.5), ("100 %", 1.0)]);
    Figure::new(name, title, caption, Some(legend), panels, csv)
}

/// The length of every stretch of one kind, a row for each kind and a panel for each trip.
///
/// * `name`, `title` — of the figure; its files have the name
pub fn run_lengths(name: &str, title: &str, register: &Register, trips: &[TripKinds]) -> Figure {
    let mut csv = Csv::new(&["trip", "kind", "first_frame", "n_frames", "seconds"]);
    let panel = |trip: &TripKinds| {
        let lengths = runs(trip.kinds).map(|(frames, kind)| {
            let seconds = trip.turn_s(frames.end) - trip.turn_s(frames.start);
            csv.line(&[&trip.title, &register.number(kind), &frames.start, &frames.len(), &seconds]);
            (kind, seconds)
        });
        let lengths: Vec<(usize, f64)> = lengths.collect();
        let (_, high) = range(lengths.iter().map(|(_, seconds)| *seconds));
        let range = (0.0, high);
        let x = Axis { title: "length", unit: "s", range, step_min: 0.0, px_per_tick: X_PX_PER_TICK };
        let mut chart = Chart::of_kinds(trip.title, register, ROW_PX, x);
        for (kind, seconds) in lengths {
            let class = KindStyle::of(kind).colour_class();
            let (x, y) = chart.at((seconds, kind as f64));
            chart.drawing.circle((x, y), 4.0, &format!("line {class}"), 1.5);
        }
        chart.drawing
    };
    let panels: Vec<Drawing> = trips.iter().map(panel).collect();
    let caption = "A circle for each stretch of frames of one kind, in the row of its kind, as far to the right as it lasted.".to_string();
    Figure::new(name, title, caption, legend_of_names(register), panels, csv)
}
