//! What was found, and what to do about it.

use std::fmt;

use kinds_messages::Program;
use serde::Serialize;

/// One thing that was looked at.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub(super) struct Finding {
    /// What was looked at, in a word.
    pub(super) check: &'static str,
    pub(super) well: bool,
    /// How it is.
    pub(super) what: String,
    /// What to do, where it is not well.
    pub(super) cure: Option<String>,
}

pub(super) fn well(check: &'static str, what: impl Into<String>) -> Finding {
    Finding { check, well: true, what: what.into(), cure: None }
}

pub(super) fn wrong(check: &'static str, what: impl Into<String>, cure: impl Into<String>) -> Finding {
    Finding { check, well: false, what: what.into(), cure: Some(cure.into()) }
}

impl fmt::Display for Finding {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let state = if self.well { "well" } else { "WRONG" };
        writeln!(f, "{state:5}  {:9} {}", self.check, self.what)?;
        match &self.cure {
            Some(cure) => writeln!(f, "{:16} → {cure}", ""),
            None => Ok(()),
        }
    }
}

/// Programs in the order of their processes, or that there are none.
pub(super) fn listed<'a>(programs: impl IntoIterator<Item = &'a Program>) -> String {
    let mut programs: Vec<&Program> = programs.into_iter().collect();
    programs.sort_by_key(|program| program.pid);
    programs.dedup();
    match programs.is_empty() {
        true => "nobody".to_owned(),
        false => programs.into_iter().map(Program::to_string).collect::<Vec<_>>().join(", "),
    }
}
