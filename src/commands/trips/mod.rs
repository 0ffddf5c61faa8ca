//! `kinds trips`: recordings looked into, converted, and saved from.

mod convert;
mod info;
mod recover;

use std::path::Path;

use crate::cli::{TripsArguments, TripsVerb};
use crate::failure::Failure;

pub(crate) fn run(arguments: &TripsArguments) -> Result<(), Failure> {
    match &arguments.verb {
        TripsVerb::Info(arguments) => info::run(arguments),
        TripsVerb::Convert(arguments) => convert::run(arguments),
        TripsVerb::Recover(arguments) => recover::run(arguments),
    }
}

/// Refuses to write over a file.
fn check_is_new(path: &Path) -> Result<(), Failure> {
    match path.exists() {
        true => Err(Failure::CouldNot(format!(
            "cannot write {}: it is there already; choose another name",
            path.display()
        ))),
        false => Ok(()),
    }
}
