//! What kinds are good for, on the page: sequences, maps and policies, space by space.

use kinds_model::Register;

use super::evaluation::{elsewhere, file};
use super::page::{Column, Page, ReportFile, Table};
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
        add_drift(page, uses);
        add_map(page, register, &trips, uses);
        add_policy(page, uses.space, register, &trips, &uses.policy);
    }
}

fn add_drift(page: &mut Page, uses: &Uses) {
    let percent = |share: f64| format!("{:.1} %", 100.0 * share);
    let numbers = ["novel", "usual", "of other kinds", "halves apart", "usual"].map(Column::number);
    let mut table = Table::new([vec![Column::text("trip")], numbers.into()].concat());
    let trips = uses.sequences.iter().zip(&uses.drift);
    let measured: Vec<_> = trips.filter_map(|(sequence, drift)| Some((sequence, drift.as_ref()?))).collect();
    if measured.is_empty() {
        return;
    }
    for (sequence, drift) in measured {
        let apart =
            [drift.half_split, drift.half_split_usual].map(|share| share.map_or(String::new(), percent));
        let shares = [drift.novel, drift.novel_usual, drift.total_variation].map(percent);
        table.row([vec![sequence.trip.clone()], shares.into(), apart.into()].concat());
    }
    page.section(&elsewhere("Drift since training", uses.space));
    page.paragraph(
        "How many frames are novel; of how many the kind would have to be another for kinds to have the shares that they had in \
         training; and how far apart two halves of its nearest reference frames place a frame, the median as a share of the radius of all \
         trained places. Usual is what frames like those learnt from come to.",
    );
    page.table(&table);
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
