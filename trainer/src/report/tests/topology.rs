//! The topological map: its marks, its numbers and its table.

use super::*;
use crate::topology::{MapPlan, TopologicalMap};

/// [`TRIP`], there and back, and there again: kind 0 at 0–1 m, kind 1 at 2–3 m, kind 0 at 4 m and beyond.
fn trip() -> Track {
    let x_m = [0.0, 1.0, 2.0, 3.0, 4.0, 5.0, 4.0, 3.0, 2.0, 1.0, 0.0, 1.0, 2.0, 3.0];
    Track {
        title: "trip <1>".to_string(),
        seconds: (0..x_m.len()).map(|index| index as f64).collect(),
        poses: x_m.map(|x_m| at(x_m, 2.0)).to_vec(),
        commands: vec![None; x_m.len()],
    }
}

const KINDS: [usize; 14] = [0, 0, 1, 1, 0, 0, 0, 1, 1, 0, 0, 0, 1, 1];

fn map() -> TopologicalMap {
    TopologicalMap::of(&[trip().with_kinds(&KINDS)], &MapPlan { size_m_min: 1.0, radius_m: 0.4 })
}

pub(super) fn figure() -> Figure {
    topological_map("map", "Topological <map>", &Register::new(2), &map(), &[trip().with_kinds(&KINDS)])
}

#[test]
fn every_region_is_a_numbered_circle_with_the_look_of_its_kind_and_every_edge_an_arrow() {
    let figure = figure();
    let svg = figure.to_svg();
    let document = parse(&svg);
    let circles: Vec<Node> =
        document.descendants().filter(|node| node.has_tag_name((SVG, "circle"))).collect();
    let looks: Vec<(&str, &str)> = circles
        .iter()
        .map(|circle| (circle.attribute("class").unwrap(), circle.attribute("stroke-width").unwrap()))
        .collect();
    let look = |kind| {
        let style = KindStyle::of(kind);
        (format!("{} open", style.class()), style.width_px.to_string())
    };
    let expected = [look(0), look(1), look(0)];
    assert_eq!(looks, expected.each_ref().map(|(class, width)| (class.as_str(), width.as_str())));
    let number = |circle: &Node, name: &str| circle.attribute(name).unwrap().parse::<f64>().unwrap();
    // The longest visited is the largest: region 0 for 1.5 + 3 s, region 1 for 2 + 2 + 1.5 s, region 2 for 3 s.
    let radii: Vec<f64> = circles.iter().map(|circle| number(circle, "r")).collect();
    assert!(radii[1] > radii[0] && radii[0] > radii[2], "{radii:?}");
    let named = document
        .descendants()
        .filter(|node| node.has_tag_name((SVG, "text")) && node.attribute("class") == Some("name middle"));
    let names: Vec<(&str, f64)> = named.map(|name| (name.text().unwrap(), number(&name, "x"))).collect();
    let centres: Vec<f64> = circles.iter().map(|circle| number(circle, "cx")).collect();
    assert_eq!(names, [("0", centres[0]), ("1", centres[1]), ("2", centres[2])]);
    let curves = |node: &Node| node.attribute("d").is_some_and(|d| d.contains('Q'));
    assert_eq!(document.descendants().filter(curves).count(), 4);
    // Twice from 0 to 1, once from 1 to 2 and back, once from 1 to 0.
    let counts = with_class(&document, "halo");
    let mut counts: Vec<&str> = counts.iter().filter_map(|count| count.text()).collect();
    counts.sort_unstable();
    assert_eq!(counts, ["1", "1", "1", "2"]);
    assert!(figure.caption().contains("3 regions, 4 edges"));
}

#[test]
fn the_table_of_numbers_has_regions_and_then_edges() {
    assert_eq!(
        figure().csv(),
        "region,to_region,kind,x_m,y_m,x_m_min,x_m_max,y_m_min,y_m_max,dwell_s,n_visits,n_frames,mean_duration_s,mean_forward_m_s,mean_turn_rad_s\n\
         0,,0,1,2,0,1,2,2,4.5,2,5,,,\n\
         1,,1,2,2,2,3,2,2,5.5,3,6,,,\n\
         2,,0,4,2,4,5,2,2,3,1,3,,,\n\
         0,1,,,,,,,,,2,,2.25,,\n\
         1,0,,,,,,,,,1,,2,,\n\
         1,2,,,,,,,,,1,,2,,\n\
         2,1,,,,,,,,,1,,3,,\n"
    );
}

#[test]
fn regions_are_told_with_what_they_lead_to() {
    let mut page = Page::new("Kinds");
    page.table(&region_table(&map(), &Register::new(2)));
    let html = page.to_html();
    let document = parse(&html);
    let row = |row: Node| -> String {
        let cells: Vec<&str> = row.children().filter_map(|cell| cell.text()).collect();
        cells.join(" | ").replace('\u{a0}', " ")
    };
    let rows: Vec<String> = document.descendants().filter(|node| node.has_tag_name("tr")).map(row).collect();
    assert_eq!(
        rows,
        [
            "region | kind | place x, y | extent | dwell time | visits | leads to (how often)",
            "0 | 0 | 1.0, 2.0 m | 1.0 × 0.0 m | 4.5 s | 2 | 1 (2)",
            "1 | 1 | 2.0, 2.0 m | 1.0 × 0.0 m | 5.5 s | 3 | 0 (1), 2 (1)",
            "2 | 0 | 4.0, 2.0 m | 1.0 × 0.0 m | 3.0 s | 1 | 1 (1)",
        ]
    );
}

#[test]
fn circles_of_regions_that_are_close_together_are_moved_until_all_can_be_read() {
    // Six regions within a metre, and one far away, so that the metre is short.
    let x_m = [0.0, 0.2, 0.2, 0.4, 0.4, 0.6, 0.6, 0.8, 0.8, 1.0, 1.0, 1.2, 1.2, 60.0];
    let kinds = [0, 0, 1, 1, 2, 2, 3, 3, 4, 4, 5, 5, 6, 6];
    let poses: Vec<Option<Pose>> = x_m.iter().map(|&x_m| at(x_m, 0.0)).collect();
    let seconds: Vec<f64> = (0..14).map(f64::from).collect();
    let trip = TripKinds { title: "trip", seconds: &seconds, poses: &poses, commands: &[], kinds: &kinds };
    let map = TopologicalMap::of(&[trip], &MapPlan { size_m_min: 0.1, radius_m: 0.05 });
    assert_eq!(map.regions.len(), 7);
    let svg = topological_map("map", "Map", &Register::new(7), &map, &[trip]).to_svg();
    let document = parse(&svg);
    let circles: Vec<[f64; 3]> = document
        .descendants()
        .filter(|node| node.has_tag_name((SVG, "circle")))
        .map(|circle| ["cx", "cy", "r"].map(|name| circle.attribute(name).unwrap().parse().unwrap()))
        .collect();
    for (index, [x, y, radius]) in circles.iter().enumerate() {
        for [other_x, other_y, other_radius] in &circles[..index] {
            let distance = (x - other_x).hypot(y - other_y);
            assert!(distance >= radius + other_radius, "{circles:?}");
        }
    }
    // Lines lead from circles to places that they no longer cover.
    let leaders =
        with_class(&document, "mark").into_iter().filter(|mark| mark.attribute("stroke-width") == Some("1"));
    assert!(leaders.count() >= 2);
}
