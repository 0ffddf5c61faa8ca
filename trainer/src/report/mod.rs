//! The report that a person opens: one page of text, tables and figures, and each figure in files of its own.
//!
//! Pure: data in, text out. A [`Page`] is one file of HTML without network or script; every [`Figure`] on it is drawn in
//! SVG whose colours follow the page from light to dark, and comes with the numbers drawn. Functions of this module make
//! the figures: of a model ([`neighbors_tried`], [`residual_variance`], [`spectrum`], [`kinds_tried`], [`kinds_merged`], [`embedding`], [`canonical_views`]), of
//! trips whose frames have been classified ([`kinds_on_path`], [`kinds_along_time`]) and of an evaluation
//! ([`consistency`], [`consistency_surfaces`], [`kinds_met`], [`registration_errors`]), and of what kinds are good for
//! ([`transitions`], [`run_lengths`], [`topological_map`], [`commands`]). [`add_model`], [`add_methods`], [`add_trips`],
//! [`add_evaluation`] and [`add_uses`] put them on a page with their tables and words:
//!
//! ```no_run
//! # fn report(model: &kinds_model::Model, trips: &[kinds_trainer::TripKinds], evaluation: &kinds_trainer::Evaluation) {
//! use kinds_trainer::report::{Page, add_evaluation, add_model, add_trips};
//!
//! let mut page = Page::new("Kinds of crunch/ring");
//! add_model(&mut page, model, None, &[]);
//! add_trips(&mut page, model.register(), trips);
//! add_evaluation(&mut page, model.register(), evaluation);
//! for file in page.files() {
//!     // Write file.contents to file.name.
//! }
//! # }
//! ```
//!
//! Kinds have one look everywhere: a colour, and on the path a width, so that they are told apart without colour. They are
//! called by the numbers that they keep, and by their names where there is room for words ([`kinds_model::Register`]). Text
//! in figures is at least 11 px high on a page 400 px wide: panels are small and wrap.

mod axis;
mod canonical;
mod chart;
mod curves;
mod depth;
mod drawing;
mod embedding;
mod evaluation;
mod figure;
mod kind_style;
mod kinds_merged;
mod kinds_met;
mod kinds_tried;
mod markup;
mod matrix;
mod methods;
mod neighbors_tried;
mod page;
mod path;
mod policy;
mod rays;
mod registration;
mod scores;
mod sections;
mod segmentation;
mod sequences;
mod surfaces;
mod theme;
mod time;
mod topology;
mod uses;
mod views;

pub use curves::{residual_variance, spectrum};
pub use embedding::embedding;
pub use evaluation::{add_classified_trips, add_evaluation};
pub use figure::Figure;
pub use kinds_merged::kinds_merged;
pub use kinds_met::kinds_met;
pub use kinds_tried::kinds_tried;
pub(crate) use markup::escaped;
pub use methods::{add_methods, kinds_agreement, method_table};
pub use neighbors_tried::neighbors_tried;
pub use page::{Column, Page, ReportFile, Table};
pub use path::kinds_on_path;
pub use policy::{add_policy, commands, policy_table};
pub use registration::registration_errors;
pub use scores::{consistency, consistency_table};
pub use sections::{add_learnt_trips, add_model, add_trips, method_name};
pub use segmentation::{add_segmentation, names_and_kinds};
pub use sequences::{add_sequences, run_lengths, sequence_table, transitions};
pub use surfaces::consistency_surfaces;
pub use time::kinds_along_time;
pub use topology::{region_table, topological_map};
pub use uses::add_uses;
pub use views::canonical_views;

#[cfg(test)]
mod tests;
