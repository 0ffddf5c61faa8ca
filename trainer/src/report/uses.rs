//! What kinds are good for, on the page: sequences, maps and policies, space by space.

use kinds_model::Register;

use super::evaluation::{elsewhere, file};
use super::page::{Page, ReportFile};
use super::{add_policy, add_sequences, region_table, topological_map};
use crate::evaluate::ClassifiedTrip;
use crate::trip_kinds::TripKinds;
use crate::uses::Uses;

/// Adds what the kinds of each space make. Maps come as GraphML and DOT beside the page, too.
///
/// * `trips` — space by space, as [`Uses::of`] took them
pub fn add_uses(page: &mut Page, register: &Register, trips: &[ClassifiedTrip], uses: &[Uses]) {
    for (of_space, uses) in trips.chunk_by(|a, b| a.space == b.space).zip(uses) {
        let trips: Vec<TripKinds> = of_space.iter().map(ClassifiedTrip::trip_kinds).collect();
        add_sequences(page, uses.space, register, &trips, &uses.sequences);
        add_map(page, register, &trips, uses);
        add_policy(page, uses.space, register, &trips, &uses.policy);
    }
}

fn add_map(page: &mut Page, register: &Register, trips: &[TripKinds], uses: &Uses) {
    page.section(&elsewhere("Topological map", uses.space));
    let Some(map) = &uses.map else {
        page.paragraph(
            "Nobody knows where the robot was: there is no map without nav_msgs/msg/Odometry or geometry_msgs/msg/PoseStamped.",
        );
        return;
    };
    let name = file("map", uses.space);
    page.figure(topological_map(&name, "Regions, and the ways between them", register, map, trips));
    page.table(&region_table(map, register));
    let titles: Vec<&str> = trips.iter().map(|trip| trip.title).collect();
    let title = titles.join(", ");
    page.attach(ReportFile { name: format!("{name}.graphml"), contents: map.to_graphml(&title, register) });
    page.attach(ReportFile { name: format!("{name}.dot"), contents: map.to_dot(&title, register) });
}
