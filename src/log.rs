//! What the program tells on standard error while it runs: logs of the libraries, and notices of its own. Lines for a person,
//! or a JSON object each for a machine.

use std::fmt::Display;
use std::io::IsTerminal;
use std::sync::OnceLock;

use clap::ValueEnum;
use tracing_subscriber::EnvFilter;
use tracing_subscriber::filter::LevelFilter;

use crate::failure::Failure;

/// How the lines are written.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub(crate) enum Format {
    /// For a person
    Text,
    /// One JSON object a line, with its time
    Json,
}

/// Settled once, at the start.
static FORMAT: OnceLock<Format> = OnceLock::new();

/// Starts to write logs.
///
/// * `usual` — the least level that is written, unless the environment variable `KINDS_LOG` says which (as in
///   `KINDS_LOG=debug`)
pub(crate) fn start(format: Format, usual: &str) {
    let mut filter = EnvFilter::try_from_env("KINDS_LOG").unwrap_or_else(|_| EnvFilter::new(usual));
    if filter.max_level_hint() < Some(LevelFilter::DEBUG) {
        // The network's library warns of its own affairs in its own words, which belong in nobody's terminal.
        filter = filter.add_directive("zenoh=off".parse().expect("a directive as it should be"));
    }
    let log =
        tracing_subscriber::fmt().with_env_filter(filter).with_writer(std::io::stderr).with_target(false);
    match FORMAT.get_or_init(|| format) {
        Format::Text => log.without_time().with_ansi(std::io::stderr().is_terminal()).init(),
        Format::Json => log.json().flatten_event(true).with_current_span(false).init(),
    }
}

/// Tells whoever started the program something in passing.
pub(crate) fn notice(words: impl Display) {
    match FORMAT.get() {
        Some(Format::Json) => tracing::info!("{words}"),
        _ => eprintln!("kinds: {words}"),
    }
}

/// Tells why the program ends.
pub(crate) fn failure(failure: &Failure) {
    match FORMAT.get() {
        Some(Format::Json) => tracing::error!("{failure}"),
        _ => eprintln!("kinds: {failure}"),
    }
}
