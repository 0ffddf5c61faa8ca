//! Figure of the kinds along time.

use std::fmt::Write;

use kinds_model::Register;

use super::axis::range;
use super::chart::{Axis, Chart, X_PX_PER_TICK};
use super::drawing::Drawing;
use super::figure::Figure;
use super::kind_style::{KindStyle, legend_of_names, runs};
use super::markup::{Csv, px};
use crate::trip_kinds::TripKinds;

const ROW_PX: f64 = 17.0;

/// Kinds along time: a row for each kind, time from left to right.
///
/// * `name`, `title` — of the figure; its files have the name
pub fn kinds_along_time(name: &str, title: &str, register: &Register, trips: &[TripKinds]) -> Figure {
    let panels = trips.iter().map(|trip| strip(trip, register)).collect();
    let mut csv = Csv::new(&["trip", "frame", "time_s", "kind"]);
    let mut sentences = Vec::new();
    for trip in trips {
        for (frame, (time_s, kind)) in trip.seconds.iter().zip(trip.kinds).enumerate() {
            csv.line(&[&trip.title, &frame, time_s, &register.number(*kind)]);
        }
        sentences.push(sentence(trip));
    }
    let caption = format!("When the robot saw which kind: a row for each kind. {}.", sentences.join("; "));
    Figure::new(name, title, caption, legend_of_names(register), panels, csv)
}

fn sentence(trip: &TripKinds) -> String {
    let n_changes = runs(trip.kinds).count().saturating_sub(1);
    let often = if n_changes == 1 { "once".to_string() } else { format!("{n_changes} times") };
    let length_s = trip.seconds.last().zip(trip.seconds.first()).map_or(0.0, |(last, first)| last - first);
    format!("{}: the kind changed {often} in {length_s:.0}\u{a0}s", trip.title)
}

fn strip(trip: &TripKinds, register: &Register) -> Drawing {
    assert_eq!(trip.seconds.len(), trip.kinds.len(), "one kind for each frame");
    let end_s = trip.end_s();
    let (low, high) = range(trip.seconds.iter().copied().chain([end_s]));
    let range = (low, high);
    let x = Axis { title: "time", unit: "s", range, step_min: 0.0, px_per_tick: X_PX_PER_TICK };
    let mut chart = Chart::of_kinds(trip.title, register, ROW_PX, x);
    for kind in 0..register.kinds().len() {
        let mut path = String::new();
        for (frames, _) in runs(trip.kinds).filter(|(_, of)| *of == kind) {
            let until_s = trip.seconds.get(frames.end).copied().unwrap_or(end_s);
            let (from, until) =
                (chart.at((trip.seconds[frames.start], kind as f64)), chart.at((until_s, kind as f64)));
            // A stretch of a single frame of a long trip would be too thin to be seen.
            write!(path, "M{} {}h{}", px(from.0), px(from.1), px((until.0 - from.0).max(0.6)))
                .expect("a string takes all that is written");
        }
        if !path.is_empty() {
            let class = format!("line {}", KindStyle::of(kind).colour_class());
            chart.drawing.path(&path, &class, ROW_PX - 5.0);
        }
    }
    chart.drawing
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn changes_are_counted_and_one_is_once() {
        let check = |seconds: &[f64], kinds: &[usize], expected: &str| {
            assert_eq!(
                sentence(&TripKinds { title: "trip", seconds, poses: &[], commands: &[], kinds })
                    .replace('\u{a0}', " "),
                expected
            );
        };
        check(&[0.0, 1.0, 2.0], &[0, 1, 0], "trip: the kind changed 2 times in 2 s");
        check(&[0.0, 1.0, 2.0], &[0, 1, 1], "trip: the kind changed once in 2 s");
        check(&[], &[], "trip: the kind changed 0 times in 0 s");
    }
}
