//! Lines for whoever started the program.

use std::fmt::Display;
use std::io::Write;

use crate::failure::Failure;

/// Prints a line on standard output. That nobody reads any more is [`Failure::OutputClosed`], where `println` would panic.
pub(crate) fn say(line: impl Display) -> Result<(), Failure> {
    let mut out = std::io::stdout().lock();
    writeln!(out, "{line}")?;
    Ok(out.flush()?)
}

/// Prints a line for whom it may interest: that nobody reads it is no reason to stop.
pub(crate) fn mention(line: impl Display) -> Result<(), Failure> {
    match say(line) {
        Err(Failure::OutputClosed) => Ok(()),
        said => said,
    }
}
