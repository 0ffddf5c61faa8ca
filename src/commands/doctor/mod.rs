//! `kinds doctor`: why nothing arrives.

mod arrivals;
mod clock;
mod finding;
mod members;
mod memory;
mod model;
mod place;
mod sensor;

use std::collections::BTreeSet;
use std::io::Write;

use kinds_messages::{Census, Domain, SensorName};

use self::finding::{Finding, wrong};
use crate::cli::DoctorArguments;
use crate::failure::Failure;

pub(crate) fn run(arguments: &DoctorArguments) -> Result<(), Failure> {
    let domain = arguments.domain.domain();
    let findings = examine(&domain, arguments);
    let n_wrong = findings.iter().filter(|finding| !finding.well).count();
    let mut out = std::io::stdout().lock();
    if arguments.json {
        let report = serde_json::json!({ "domain": domain.root, "well": n_wrong == 0, "findings": findings });
        writeln!(out, "{}", serde_json::to_string_pretty(&report).expect("findings are plain data"))?;
    } else {
        findings.iter().try_for_each(|finding| write!(out, "{finding}"))?;
    }
    match n_wrong {
        0 => Ok(()),
        _ => Err(Failure::CouldNot(format!("{n_wrong} of {} findings are wrong", findings.len()))),
    }
}

/// All that can be found, in the order in which it matters: what is wrong first explains what is wrong later.
fn examine(domain: &Domain, arguments: &DoctorArguments) -> Vec<Finding> {
    let mut findings = place::examine(domain);
    findings.push(clock::examine());
    let (model, on_model) = arguments.model.as_deref().map(model::examine).unzip();
    let model = model.flatten();
    findings.extend(on_model);
    let census = match domain.census("kinds-doctor") {
        Ok(census) => census,
        Err(error) => {
            findings.push(wrong("programs", error.to_string(), "see what is wrong with the domain, above"));
            return findings;
        }
    };
    findings.extend(members::examine(domain, &census));
    let sensors = sensors(&census, arguments.sensor.as_ref());
    findings.push(memory::examine(&census, &sensors, model.as_ref()));
    for sensor in &sensors {
        findings.extend(sensor::examine(domain, &census, sensor, model.as_ref(), arguments.wait_s));
    }
    if sensors.is_empty() && !census.programs.is_empty() {
        findings.push(wrong(
            "channels",
            format!("no sensor has a channel under {}", domain.root.display()),
            "start a driver shim (kinds publish) and a service (kinds serve), with the same --domain or KINDS_DOMAIN as this \
             program",
        ));
    }
    findings
}

/// The sensor that is asked about, or all that there are.
fn sensors(census: &Census, asked: Option<&SensorName>) -> BTreeSet<SensorName> {
    match asked {
        Some(sensor) => BTreeSet::from([sensor.clone()]),
        None => census.channels.iter().map(|channel| channel.sensor.clone()).collect(),
    }
}
