//! The map as other programs read it: GraphML for those that compute, DOT for those that draw.
//!
//! Written here and not by `petgraph`, whose writers make every number a string.

use std::fmt::Write;

use kinds_model::Register;

use super::attributes::{Attribute, EDGE, REGION, of_edge, of_region};
use super::{Edge, Region, TopologicalMap};
use crate::report::escaped;

impl TopologicalMap {
    /// The map as GraphML, for instance for `networkx.read_graphml`: typed numbers whose names end in their units.
    ///
    /// * `title` — of the graph, any text
    /// * `register` — by which kinds have their numbers
    pub fn to_graphml(&self, title: &str, register: &Register) -> String {
        let key = |of: &str, (name, kind): &Attribute| {
            format!("  <key id=\"{of}_{name}\" for=\"{of}\" attr.name=\"{name}\" attr.type=\"{kind}\"/>\n")
        };
        let graph = [("title", "string"), ("size_m_min", "double"), ("radius_m", "double")];
        let keys = graph.iter().map(|attribute| key("graph", attribute));
        let keys = keys.chain(REGION.iter().map(|attribute| key("node", attribute)));
        let keys: String = keys.chain(EDGE.iter().map(|attribute| key("edge", attribute))).collect();
        let data = |of: &str, attributes: &[Attribute], values: &[String]| -> String {
            let known = attributes.iter().zip(values).filter(|(_, value)| !value.is_empty());
            known
                .map(|((name, _), value)| format!("<data key=\"{of}_{name}\">{}</data>", escaped(value)))
                .collect()
        };
        let plan = [title.to_string(), self.plan.size_m_min.to_string(), self.plan.radius_m.to_string()];
        let mut text = format!(
            "<?xml version=\"1.0\" encoding=\"UTF-8\"?>\n<graphml xmlns=\"http://graphml.graphdrawing.org/xmlns\">\n{keys}  \
             <graph edgedefault=\"directed\">\n    {}\n",
            data("graph", &graph, &plan)
        );
        for (index, region) in self.regions.iter().enumerate() {
            let data = data("node", &REGION, &of_region(region, register));
            writeln!(text, "    <node id=\"{index}\">{data}</node>")
                .expect("a string takes all that is written");
        }
        for edge in &self.edges {
            let (from, to) = (edge.from, edge.to);
            let data = data("edge", &EDGE, &of_edge(edge));
            writeln!(text, "    <edge source=\"{from}\" target=\"{to}\">{data}</edge>")
                .expect("a string takes all that is written");
        }
        text + "  </graph>\n</graphml>\n"
    }

    /// The map in the language of Graphviz: regions with number and kind, at their places if drawn by `neato -n`; edges
    /// with the number of visits.
    ///
    /// * `title` — of the graph, any text
    /// * `register` — by which kinds have their numbers and names
    pub fn to_dot(&self, title: &str, register: &Register) -> String {
        let quoted = |text: &str| text.replace('\\', "\\\\").replace('"', "\\\"");
        let title = quoted(title);
        let mut text = format!("digraph \"{title}\" {{\n  node [shape=circle];\n");
        for (index, region) in self.regions.iter().enumerate() {
            let Region { kind, x_m, y_m, .. } = region;
            // An inch, 72 points, for a metre.
            let (x_pt, y_pt) = (72.0 * x_m, 72.0 * y_m);
            let kind = quoted(&register.label(*kind));
            let rest = attributes(&REGION, &of_region(region, register));
            writeln!(text, "  {index} [label=\"{index}\\nkind {kind}\", pos=\"{x_pt:.1},{y_pt:.1}\"{rest}];")
                .expect("a string takes all that is written");
        }
        for edge in &self.edges {
            let Edge { from, to, n_visits, .. } = edge;
            let rest = attributes(&EDGE, &of_edge(edge));
            writeln!(text, "  {from} -> {to} [label=\"{n_visits}\"{rest}];")
                .expect("a string takes all that is written");
        }
        text + "}\n"
    }
}

/// `, kind=1, x_m=0.25, …`: what Graphviz hands through to whoever reads on. Unknown ones are left out.
fn attributes(attributes: &[Attribute], values: &[String]) -> String {
    let known = attributes.iter().zip(values).filter(|(_, value)| !value.is_empty());
    known.map(|((name, _), value)| format!(", {name}={value}")).collect()
}
