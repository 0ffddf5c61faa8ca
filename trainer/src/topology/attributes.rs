//! The numbers of regions and edges, by the names that they have in files and tables.

use kinds_model::Register;

use super::{Edge, Region};

/// A number that a region or an edge has: its name, and its type in GraphML.
pub(crate) type Attribute = (&'static str, &'static str);

/// What a region is in files and tables, in the order of [`of_region`].
pub(crate) const REGION: [Attribute; 10] = [
    ("kind", "int"),
    ("x_m", "double"),
    ("y_m", "double"),
    ("x_m_min", "double"),
    ("x_m_max", "double"),
    ("y_m_min", "double"),
    ("y_m_max", "double"),
    ("dwell_s", "double"),
    ("n_visits", "int"),
    ("n_frames", "int"),
];

/// What an edge is in files and tables, in the order of [`of_edge`].
pub(crate) const EDGE: [Attribute; 4] = [
    ("n_visits", "int"),
    ("mean_duration_s", "double"),
    ("mean_forward_m_s", "double"),
    ("mean_turn_rad_s", "double"),
];

pub(crate) fn of_region(region: &Region, register: &Register) -> [String; REGION.len()] {
    let Region { kind, x_m, y_m, extent, dwell_s, n_visits, n_frames } = region;
    [
        register.number(*kind).to_string(),
        x_m.to_string(),
        y_m.to_string(),
        extent.x_m_min.to_string(),
        extent.x_m_max.to_string(),
        extent.y_m_min.to_string(),
        extent.y_m_max.to_string(),
        dwell_s.to_string(),
        n_visits.to_string(),
        n_frames.to_string(),
    ]
}

/// Commands are empty where none are known.
pub(crate) fn of_edge(edge: &Edge) -> [String; EDGE.len()] {
    let Edge { n_visits, mean_duration_s, mean_command, .. } = edge;
    [
        n_visits.to_string(),
        mean_duration_s.to_string(),
        mean_command.map_or(String::new(), |command| command.mean_forward_m_s.to_string()),
        mean_command.map_or(String::new(), |command| command.mean_turn_rad_s.to_string()),
    ]
}
