//! Figure and table of a topological map, as in the paper's Figure 7d.

use std::fmt::Display;

use kinds_model::Register;

use super::chart::Chart;
use super::drawing::Drawing;
use super::figure::Figure;
use super::kind_style::{KindStyle, legend, names, runs};
use super::markup::{Csv, polyline, px};
use super::page::{Column, Table};
use super::path::{bounds, space};
use crate::topology::{Edge, MapPlan, Region, TopologicalMap, attributes};
use crate::trip_kinds::TripKinds;

/// A topological map over the path of the trips that it was made from: regions as numbered circles, edges as arrows.
///
/// * `name`, `title` — of the figure; its files have the name
/// * `register` — of the model, so that every figure has the same legend
pub fn topological_map(
    name: &str,
    title: &str,
    register: &Register,
    map: &TopologicalMap,
    trips: &[TripKinds],
) -> Figure {
    let (n_regions, n_edges) = (map.regions.len(), map.edges.len());
    let MapPlan { size_m_min, radius_m } = map.plan;
    let caption = format!(
        "Each circle is a region, a place of one kind, with its number and the kind's colour and width; the larger, the longer the robot \
         was there. Where circles would cover each other they are moved, and a line leads to the place. An arrow leads to the \
         region that came next; the number on it, where there is room, says how often. Thin lines: the path. {n_regions} \
         regions, {n_edges} edges; what was smaller than {}\u{a0}m was taken for the kind around it, and what lies \
         within {}\u{a0}m for one place.",
        px(size_m_min),
        px(radius_m)
    );
    let panel = match trips {
        [trip] => drawn(trip.title, map, trips),
        _ => drawn(&format!("{} trips", trips.len()), map, trips),
    };
    Figure::new(name, title, caption, Some(legend(&names(register))), vec![panel], csv(map, register))
}

/// The regions of a map, in words.
pub fn region_table(map: &TopologicalMap, register: &Register) -> Table {
    let mut table = Table::new(vec![
        Column::number("region"),
        Column::text("kind"),
        Column::number("place x, y"),
        Column::number("extent"),
        Column::number("dwell time"),
        Column::number("visits"),
        Column::text("leads to (how often)"),
    ]);
    for (index, region) in map.regions.iter().enumerate() {
        let (width_m, height_m) = region.extent.size_m();
        let edges = map.edges.iter().filter(|edge| edge.from == index);
        let next: Vec<String> = edges.map(|edge| format!("{} ({})", edge.to, edge.n_visits)).collect();
        table.row(vec![
            index.to_string(),
            register.label(region.kind),
            format!("{}, {}\u{a0}m", metres(region.x_m), metres(region.y_m)),
            format!("{width_m:.1} × {height_m:.1}\u{a0}m"),
            format!("{:.1}\u{a0}s", region.dwell_s),
            region.n_visits.to_string(),
            if next.is_empty() { "–".to_string() } else { next.join(", ") },
        ]);
    }
    table
}

/// To a decimetre, with a true minus.
fn metres(value: f64) -> String {
    let text = format!("{value:.1}");
    if text == "-0.0" { "0.0".to_string() } else { text.replace('-', "−") }
}

/// A line for each region, whose `to_region` is empty, then one for each edge, whose kind and place are.
fn csv(map: &TopologicalMap, register: &Register) -> Csv {
    let of_edges = &attributes::EDGE[1..];
    let names = attributes::REGION.iter().chain(of_edges).map(|(name, _)| *name);
    let titles: Vec<&str> = ["region", "to_region"].into_iter().chain(names).collect();
    let mut csv = Csv::new(&titles);
    let mut line = |region: usize, to: Option<usize>, value_of: &dyn Fn(&str) -> Option<String>| {
        let to = to.map(|to| to.to_string());
        let values = titles[2..].iter().map(|title| value_of(title));
        let cells: Vec<String> =
            [Some(region.to_string()), to].into_iter().chain(values).map(Option::unwrap_or_default).collect();
        csv.line(&cells.iter().map(|cell| cell as &dyn Display).collect::<Vec<_>>());
    };
    let named = |attributes: &[attributes::Attribute], values: &[String], title: &str| {
        attributes.iter().position(|(name, _)| *name == title).map(|index| values[index].clone())
    };
    for (index, region) in map.regions.iter().enumerate() {
        let values = attributes::of_region(region, register);
        line(index, None, &|title| named(&attributes::REGION, &values, title));
    }
    for edge in &map.edges {
        let values = attributes::of_edge(edge);
        line(edge.from, Some(edge.to), &|title| named(&attributes::EDGE, &values, title));
    }
    csv
}

/// A place on the drawing, pixels.
type Place = (f64, f64);

/// A region's circle.
struct Disc {
    /// Where the region is.
    place: Place,
    /// Where there is room for it.
    centre: Place,
    radius_px: f64,
}

/// An edge's arrow: a curve that bends to one side, so that the way back does not cover it.
struct Arrow {
    from: Place,
    bend: Place,
    to: Place,
}

/// Room for two digits.
const RADIUS_PX_MIN: f64 = 11.0;
const RADIUS_PX_MAX: f64 = 19.0;

fn drawn(name: &str, map: &TopologicalMap, trips: &[TripKinds]) -> Drawing {
    let mut chart = space(name, bounds(trips));
    trips.iter().for_each(|trip| draw_path(&mut chart, trip));
    let discs = discs(&chart, &map.regions);
    let drawing = &mut chart.drawing;
    for Disc { place, centre, radius_px } in &discs {
        if distance(*place, *centre) > *radius_px {
            drawing.line(*place, *centre, "mark");
        }
    }
    let arrows: Vec<Arrow> = map.edges.iter().map(|edge| Arrow::of(edge, &discs)).collect();
    arrows.iter().for_each(|arrow| arrow.draw(drawing));
    for (index, (disc, region)) in discs.iter().zip(&map.regions).enumerate() {
        let style = KindStyle::of(region.kind);
        let class = format!("{} open", style.class());
        drawing.circle(disc.centre, disc.radius_px, &class, style.width_px);
        drawing.text((disc.centre.0, disc.centre.1 + 4.5), "name middle", &index.to_string());
    }
    for (place, n_visits) in labels(&arrows, &map.edges, &discs) {
        drawing.text((place.0, place.1 + 4.5), "quiet middle halo", &n_visits.to_string());
    }
    chart.drawing
}

fn draw_path(chart: &mut Chart, trip: &TripKinds) {
    let is_placed: Vec<bool> = trip.poses.iter().map(Option::is_some).collect();
    let paths: String = runs(&is_placed)
        .map(|(frames, _)| {
            let poses = trip.poses[frames].iter().flatten();
            polyline(poses.map(|pose| chart.at((pose.x_m, pose.y_m))))
        })
        .collect();
    chart.drawing.path_with(&paths, "spread", "stroke-width=\"1\" stroke-opacity=\"0.5\"");
}

/// Circles around the regions' places, moved apart where they would cover each other.
fn discs(chart: &Chart, regions: &[Region]) -> Vec<Disc> {
    let longest_s = regions.iter().map(|region| region.dwell_s).fold(0.0, f64::max);
    let mut discs: Vec<Disc> = regions
        .iter()
        .map(|region| {
            let place = chart.at((region.x_m, region.y_m));
            // Areas grow with time.
            let share = if longest_s > 0.0 { (region.dwell_s / longest_s).sqrt() } else { 0.0 };
            let radius_px = RADIUS_PX_MIN + share * (RADIUS_PX_MAX - RADIUS_PX_MIN);
            Disc { place, centre: place, radius_px }
        })
        .collect();
    move_apart(&mut discs, (chart.drawing.width, chart.drawing.height));
    discs
}

fn move_apart(discs: &mut [Disc], (width_px, height_px): (f64, f64)) {
    const N_ROUNDS: usize = 60;
    /// Between circles, for their lines and a little air.
    const GAP_PX: f64 = 9.0;
    for _ in 0..N_ROUNDS {
        let mut is_apart = true;
        for later in 1..discs.len() {
            for earlier in 0..later {
                let (a, b) = (discs[earlier].centre, discs[later].centre);
                let overlap_px = discs[earlier].radius_px + discs[later].radius_px + GAP_PX - distance(a, b);
                if overlap_px <= 0.0 {
                    continue;
                }
                is_apart = false;
                // Two at one place part to the sides.
                let (x, y) = direction(a, b).unwrap_or((1.0, 0.0));
                let half_px = overlap_px / 2.0;
                discs[earlier].centre = (a.0 - half_px * x, a.1 - half_px * y);
                discs[later].centre = (b.0 + half_px * x, b.1 + half_px * y);
            }
        }
        for disc in discs.iter_mut() {
            let margin_px = disc.radius_px + GAP_PX / 2.0;
            disc.centre.0 = disc.centre.0.clamp(margin_px, width_px - margin_px);
            disc.centre.1 = disc.centre.1.clamp(margin_px, height_px - margin_px);
        }
        if is_apart {
            return;
        }
    }
}

impl Arrow {
    fn of(edge: &Edge, discs: &[Disc]) -> Self {
        let (a, b) = (&discs[edge.from], &discs[edge.to]);
        let (x, y) = direction(a.centre, b.centre).unwrap_or((1.0, 0.0));
        let middle = half_way(a.centre, b.centre);
        let aside_px = (0.2 * distance(a.centre, b.centre)).clamp(12.0, 40.0);
        let bend = (middle.0 - aside_px * y, middle.1 + aside_px * x);
        let edge_of = |disc: &Disc, air_px: f64| {
            let (x, y) = direction(disc.centre, bend).unwrap_or((1.0, 0.0));
            let far_px = disc.radius_px + air_px;
            (disc.centre.0 + far_px * x, disc.centre.1 + far_px * y)
        };
        // The head ends before the widest line of a circle begins.
        Self { from: edge_of(a, 0.0), bend, to: edge_of(b, 4.0) }
    }

    fn draw(&self, drawing: &mut Drawing) {
        const HEAD_PX: f64 = 6.0;
        let Self { from, bend, to } = *self;
        let (x, y) = direction(bend, to).unwrap_or((1.0, 0.0));
        let barb =
            |aside: f64| (to.0 - HEAD_PX * (x + 0.5 * aside * y), to.1 - HEAD_PX * (y - 0.5 * aside * x));
        let curve =
            format!("M{} {}Q{} {} {} {}", px(from.0), px(from.1), px(bend.0), px(bend.1), px(to.0), px(to.1));
        drawing.path(&(curve + &polyline([barb(1.0), to, barb(-1.0)])), "mark", 1.2);
    }

    /// The middle of the curve.
    fn middle(&self) -> Place {
        half_way(half_way(self.from, self.bend), half_way(self.bend, self.to))
    }
}

/// How often each edge was gone, where that can be read: the most frequent first, none on a circle or another.
fn labels(arrows: &[Arrow], edges: &[Edge], discs: &[Disc]) -> Vec<(Place, usize)> {
    let mut by_visits: Vec<(&Arrow, usize)> =
        arrows.iter().zip(edges).map(|(arrow, edge)| (arrow, edge.n_visits)).collect();
    by_visits.sort_by_key(|(_, n_visits)| usize::MAX - n_visits);
    let mut labels: Vec<(Place, usize)> = Vec::new();
    for (arrow, n_visits) in by_visits {
        let place = arrow.middle();
        // Digits of 13 px are about 8 px wide.
        let half_px = |n_visits: usize| 4.0 * n_visits.to_string().len() as f64;
        let is_free = |(other, n): &(Place, usize)| {
            (other.1 - place.1).abs() >= 13.0
                || (other.0 - place.0).abs() >= half_px(*n) + half_px(n_visits) + 2.0
        };
        let is_beside =
            |disc: &Disc| distance(disc.centre, place) >= disc.radius_px + half_px(n_visits) + 2.0;
        if discs.iter().all(is_beside) && labels.iter().all(is_free) {
            labels.push((place, n_visits));
        }
    }
    labels
}

fn distance(a: Place, b: Place) -> f64 {
    (b.0 - a.0).hypot(b.1 - a.1)
}

fn half_way(a: Place, b: Place) -> Place {
    ((a.0 + b.0) / 2.0, (a.1 + b.1) / 2.0)
}

/// From one place to another, of length 1; none if they are one.
fn direction(a: Place, b: Place) -> Option<(f64, f64)> {
    let length_px = distance(a, b);
    (length_px > 0.0).then(|| ((b.0 - a.0) / length_px, (b.1 - a.1) / length_px))
}
