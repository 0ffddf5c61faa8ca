//! A model against a sensor: can it be opened, and does it understand the frames?

use std::path::Path;

use kinds_messages::{FrameHeader, KindReport};
use kinds_model::{Model, ModelId, SensorLayout};

use super::finding::{Finding, well, wrong};
use crate::model_file;

const RIGHT_MODEL: &str =
    "give the service a model that was trained on this sensor, or publish the right sensor under this name";

/// Opens a model, if it can be.
pub(super) fn examine(path: &Path) -> (Option<Model>, Finding) {
    match model_file::open(path) {
        Ok(model) => {
            let what = format!("{} is whole: {}, model {}", path.display(), model.layout(), model.id());
            (Some(model), well("model", what))
        }
        Err(error) => {
            let cure = "name the right file, copy it again, or train anew (kinds train)";
            (None, wrong("model", error.to_string(), cure))
        }
    }
}

/// Frames that nobody has received yet: their number of readings is all that is known.
pub(super) fn on_n_readings(model: &Model, n_readings: usize) -> Option<Finding> {
    let expected = model.layout().n_readings();
    (expected != n_readings).then(|| {
        wrong(
            "model",
            format!("frames have {n_readings} readings, and the model is for {expected}"),
            RIGHT_MODEL,
        )
    })
}

/// A frame that came, field by field.
pub(super) fn on_frame(model: &Model, header: &FrameHeader) -> Vec<Finding> {
    let expected = model.layout();
    let &FrameHeader { rows, columns, metres_per_count, .. } = header;
    let frames = SensorLayout { rows, columns, metres_per_count };
    let mut differences = Vec::new();
    if rows != expected.rows {
        differences.push(format!("{rows} rows instead of {}", expected.rows));
    }
    if columns != expected.columns {
        differences.push(format!("{columns} columns instead of {}", expected.columns));
    }
    if !frames.has_unit_of(&expected) {
        differences.push(format!("{metres_per_count} m a count instead of {}", expected.metres_per_count));
    }
    let mut findings = Vec::new();
    if !differences.is_empty() {
        let what = format!("frames are not of the model's sensor: {}", differences.join(", "));
        findings.push(wrong("model", what, RIGHT_MODEL));
    }
    if model.commands().is_some() && header.known_command().is_none() {
        findings.push(wrong(
            "model",
            "frames have no command, and the model compares commands beside readings: the robot is taken to stand still",
            "have the driver shim send commands with the frames, or train without --commands-weight",
        ));
    }
    if findings.is_empty() {
        findings.push(well("model", "it understands the frames"));
    }
    findings
}

/// What the service's reports say of its model.
pub(super) fn on_report(model: &Model, report: &KindReport) -> Option<Finding> {
    let served = ModelId(report.model_id);
    (served != model.id()).then(|| {
        wrong(
            "model",
            format!("the service has model {served}, and this one is {}", model.id()),
            "give the service this model: kinds reload --sensor NAME --model M.kinds",
        )
    })
}
