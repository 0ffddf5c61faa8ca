//! Figure of the kinds on the robot's path, as in the paper's Figures 4 and 5.

use std::ops::Range;

use kinds_model::Register;
use kinds_trips::Pose;

use super::axis::{Ticks, range};
use super::chart::{Axis, Chart, MARGINS_PX, X_PX_PER_TICK, Y_PX_PER_TICK};
use super::drawing::{Drawing, WIDTH_MAX};
use super::figure::Figure;
use super::kind_style::{KindStyle, called, legend, names, runs};
use super::markup::{Csv, percent, polyline};
use crate::trip_kinds::TripKinds;

/// Tallest map, pixels.
const HEIGHT_PX_MAX: f64 = 420.0;
const HEIGHT_PX_MIN: f64 = 90.0;

/// Kinds on the path of one or more trips through one space, side by side on one scale.
///
/// Each kind has its colour and its width. Thin lines lie above thick ones, so that a place passed twice shows both.
///
/// * `name`, `title` — of the figure; its files have the name
/// * `register` — of the model, so that every figure has the same legend
pub fn kinds_on_path(name: &str, title: &str, register: &Register, trips: &[TripKinds]) -> Figure {
    let bounds = bounds(trips);
    let panels = trips.iter().map(|trip| map(trip, bounds)).collect();
    let mut csv = Csv::new(&["trip", "frame", "x_m", "y_m", "kind"]);
    for trip in trips {
        for (frame, (pose, kind)) in trip.poses.iter().zip(trip.kinds).enumerate() {
            if let Some(Pose { x_m, y_m, .. }) = pose {
                csv.line(&[&trip.title, &frame, x_m, y_m, &register.number(*kind)]);
            }
        }
    }
    let count = |trip: &TripKinds| most_frequent(&placed_kinds(trip), register);
    let counts = trips.iter().map(|trip| format!("{}: {}", trip.title, count(trip)));
    let caption = format!(
        "Each stretch of the path has the colour and the width of its kind; the circle is the start. Metres on both axes, on one \
         scale. {}.",
        counts.collect::<Vec<_>>().join("; ")
    );
    Figure::new(name, title, caption, Some(legend(&names(register))), panels, csv)
}

/// The kind of each frame whose place is known.
fn placed_kinds(trip: &TripKinds) -> Vec<Option<usize>> {
    assert_eq!(trip.poses.len(), trip.kinds.len(), "one kind for each frame");
    trip.poses.iter().zip(trip.kinds).map(|(pose, kind)| pose.map(|_| *kind)).collect()
}

/// `1382 frames in 41 stretches, 31 % of them of kind 2 (doorway)`
fn most_frequent(kinds: &[Option<usize>], register: &Register) -> String {
    let mut n_frames_of = vec![0_usize; kinds.iter().flatten().max().map_or(0, |most| most + 1)];
    kinds.iter().flatten().for_each(|&kind| n_frames_of[kind] += 1);
    let n_frames: usize = n_frames_of.iter().sum();
    let n_runs = runs(kinds).filter(|(_, kind)| kind.is_some()).count();
    let largest = (0..n_frames_of.len()).max_by_key(|&kind| (n_frames_of[kind], usize::MAX - kind));
    match largest {
        None => "no frame with a known place".to_string(),
        Some(kind) => format!(
            "{n_frames} frames in {n_runs} {}, {} of them of {}",
            if n_runs == 1 { "stretch" } else { "stretches" },
            percent(n_frames_of[kind] as f64 / n_frames as f64),
            called(register, kind)
        ),
    }
}

/// What of x and of y a map of all trips shows, metres.
pub(super) fn bounds(trips: &[TripKinds]) -> [(f64, f64); 2] {
    let poses = || trips.iter().flat_map(|trip| trip.poses).flatten();
    [range(poses().map(|pose| pose.x_m)), range(poses().map(|pose| pose.y_m))]
}

/// An empty map, on which a metre is as long across as up.
pub(super) fn space(name: &str, bounds: [(f64, f64); 2]) -> Chart {
    let [x, y] = same_scale(bounds, WIDTH_MAX - MARGINS_PX.0);
    let height_px = (WIDTH_MAX - MARGINS_PX.0) * (y.1 - y.0) / (x.1 - x.0);
    // Ticks of the shorter axis are no closer than those of the longer.
    let step = Ticks::new(if height_px < WIDTH_MAX - MARGINS_PX.0 { x } else { y }, 6, 0.0);
    let step_min = step.values.windows(2).map(|pair| pair[1] - pair[0]).next().unwrap_or(0.0);
    Chart::new(
        (WIDTH_MAX, height_px + MARGINS_PX.1),
        name,
        Axis { title: "x", unit: "m", range: x, step_min, px_per_tick: X_PX_PER_TICK },
        Axis { title: "y", unit: "m", range: y, step_min, px_per_tick: Y_PX_PER_TICK },
    )
}

fn map(trip: &TripKinds, bounds: [(f64, f64); 2]) -> Drawing {
    let mut chart = space(trip.title, bounds);
    let places: Vec<Option<Place>> =
        trip.poses.iter().map(|pose| pose.map(|pose| chart.at((pose.x_m, pose.y_m)))).collect();
    let kinds = placed_kinds(trip);
    let mut stretches: Vec<(Range<usize>, usize)> =
        runs(&kinds).filter_map(|(frames, kind)| Some((frames, kind?))).collect();
    // Stable: of equal widths the later stretch lies above.
    let width_px = |kind: usize| KindStyle::of(kind).width_px;
    stretches.sort_by(|a, b| width_px(b.1).total_cmp(&width_px(a.1)));
    for (frames, kind) in stretches {
        let style = KindStyle::of(kind);
        let mut path = polyline(stretch(&places, frames));
        if !path.contains('L') {
            // The robot stood still: a dot.
            path.push_str("h0.01");
        }
        chart.drawing.path_with(&path, &style.class(), &style.attributes());
    }
    if let Some(start) = places.iter().flatten().next() {
        chart.drawing.circle(*start, 4.5, "mark open", 1.5);
    }
    chart.drawing
}

/// A place on the map, pixels.
type Place = (f64, f64);

/// The places of a stretch of frames, from half way to the frame before it to half way to the frame after, where these
/// have a place.
fn stretch(places: &[Option<Place>], frames: Range<usize>) -> impl Iterator<Item = Place> {
    let half_way = |a: usize, b: usize| {
        let ((ax, ay), (bx, by)) = ((*places.get(a)?)?, (*places.get(b)?)?);
        Some(((ax + bx) / 2.0, (ay + by) / 2.0))
    };
    let before = frames.start.checked_sub(1).and_then(|previous| half_way(previous, frames.start));
    let after = half_way(frames.end - 1, frames.end);
    before.into_iter().chain(places[frames].iter().copied().flatten()).chain(after)
}

/// Widens the shorter range until a metre is as long on both axes, for a map of given width and at most a given height.
fn same_scale([x, y]: [(f64, f64); 2], width_px: f64) -> [(f64, f64); 2] {
    let m_per_px = ((x.1 - x.0) / width_px).max((y.1 - y.0) / HEIGHT_PX_MAX);
    let widen = |(low, high): (f64, f64), length: f64| {
        let more = (length - (high - low)).max(0.0) / 2.0;
        (low - more, high + more)
    };
    [widen(x, width_px * m_per_px), widen(y, HEIGHT_PX_MIN * m_per_px)]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_most_frequent_kind_is_named_the_first_of_equals_and_frames_without_a_place_are_not_counted() {
        let check = |kinds: &[Option<usize>], expected: &str| {
            assert_eq!(most_frequent(kinds, &Register::new(4)).replace('\u{a0}', " "), expected);
        };
        check(&[Some(3), Some(1), Some(1), Some(3)], "4 frames in 3 stretches, 50 % of them of kind 1");
        check(&[None, Some(0), Some(0)], "2 frames in 1 stretch, 100 % of them of kind 0");
        check(&[None], "no frame with a known place");
    }

    #[test]
    fn stretches_meet_half_way_and_end_where_no_place_is_known() {
        let places = [Some((0.0, 0.0)), Some((2.0, 0.0)), Some((4.0, 6.0)), None, Some((9.0, 9.0))];
        let check = |frames, expected: &[Place]| {
            assert_eq!(stretch(&places, frames).collect::<Vec<_>>(), expected);
        };
        check(0..1, &[(0.0, 0.0), (1.0, 0.0)]);
        check(1..3, &[(1.0, 0.0), (2.0, 0.0), (4.0, 6.0)]);
        check(4..5, &[(9.0, 9.0)]);
    }
}
