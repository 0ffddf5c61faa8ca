//! Figure of which kinds are taken for which where one trip revisits another.

use kinds_model::Register;

use super::figure::Figure;
use super::kind_style::called;
use super::markup::{Csv, percent};
use super::matrix::{Cell, Matrix, columns_of_kinds, rows_of_kinds, shades_legend};

/// Kinds of one trip's frames against the kinds of the other's frames nearest to them.
///
/// * `name`, `title` — of the figure; its files have the name
/// * `trips` — names of the trip revisited and of the one that revisits it
/// * `met` — frames of the first trip of which the nearest of the second has which kind, shape `(n_kinds, n_kinds)`
pub fn kinds_met(
    name: &str,
    title: &str,
    register: &Register,
    trips: [&str; 2],
    met: &[Vec<usize>],
) -> Figure {
    let mut csv = Csv::new(&["kind", "kind_met", "n_frames"]);
    let cells = met.iter().enumerate().map(|(kind, row)| {
        let n_frames: usize = row.iter().sum();
        let cell = |(other, &n): (usize, &usize)| {
            csv.line(&[&register.number(kind), &register.number(other), &n]);
            let share = n as f64 / n_frames.max(1) as f64;
            Cell { shade: share, text: if n == 0 { String::new() } else { format!("{:.0}", 100.0 * share) } }
        };
        row.iter().enumerate().map(cell).collect()
    });
    let (first, second) = (trips[0], trips[1]);
    let matrix = Matrix {
        name: first,
        row_title: "kind",
        column_title: "kind of the nearest frame, % of the row",
        rows: rows_of_kinds(register),
        columns: columns_of_kinds(register),
        cells: cells.collect(),
    };
    let caption = format!(
        "A row for each kind of {first}: of its frames that {second} revisited, the share of which the nearest frame of {second} has \
         which kind. {}",
        most_confused(register, met)
    );
    let legend = shades_legend("share of the row", &[("0 %", 0.0), ("50 %", 0.5), ("100 %", 1.0)]);
    Figure::new(name, title, caption, Some(legend), vec![matrix.draw()], csv)
}

/// `Kind 2 is most often taken for another, kind 0: 31 % of its frames.`
fn most_confused(register: &Register, met: &[Vec<usize>]) -> String {
    let shares = met.iter().enumerate().flat_map(|(kind, row)| {
        let n_frames: usize = row.iter().sum();
        let others = row.iter().enumerate().filter(move |(other, n)| *other != kind && **n > 0);
        others.map(move |(other, &n)| (n as f64 / n_frames as f64, kind, other))
    });
    // The first of equals.
    match shares.reduce(|most, next| if next.0 > most.0 { next } else { most }) {
        None => "No kind is taken for another.".to_string(),
        Some((share, kind, other)) => format!(
            "Kind {} is most often taken for another, {}: {} of its frames.",
            register.label(kind),
            called(register, other),
            percent(share)
        ),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_most_confused_kind_is_named_by_its_share_and_not_by_its_size() {
        assert_eq!(
            most_confused(&Register::new(3), &[vec![900, 100, 0], vec![3, 4, 3], vec![0, 0, 0]])
                .replace('\u{a0}', " "),
            "Kind 1 is most often taken for another, kind 0: 30 % of its frames."
        );
        let none = most_confused(&Register::new(2), &[vec![5, 0], vec![0, 9]]);
        assert_eq!(none, "No kind is taken for another.");
    }
}
