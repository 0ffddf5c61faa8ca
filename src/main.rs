//! `kinds`: the one program. Glue over the libraries, and nothing else: it reads arguments, prints and exits.
#![allow(
    clippy::print_stdout,
    clippy::print_stderr,
    clippy::exit,
    reason = "only the program prints and exits"
)]

mod cli;
mod commands;
mod csv;
mod failure;
mod kind_names;
mod log;
mod model_file;
mod notify;
mod owner;
mod progress;
mod realtime;
mod report_folder;
mod ron_file;
mod say;
mod stop;
mod trip_file;
mod trip_folder;
mod whole_file;

use std::process::ExitCode;

use clap::Parser;

use crate::cli::{Cli, Verb};
use crate::failure::Failure;

fn main() -> ExitCode {
    let cli = Cli::parse();
    // A replay runs its service here: what that would tell the person who started it is of no interest.
    log::start(cli.log_format, if matches!(cli.verb, Verb::Replay(_)) { "warn" } else { "info" });
    match run(cli) {
        Ok(()) => ExitCode::SUCCESS,
        // Whoever read our output has seen enough.
        Err(Failure::OutputClosed) => ExitCode::SUCCESS,
        Err(failure) => {
            log::failure(&failure);
            failure.exit_code()
        }
    }
}

fn run(cli: Cli) -> Result<(), Failure> {
    match cli.verb {
        Verb::Demo(arguments) => commands::demo::run(&arguments),
        Verb::Train(arguments) => commands::train::run(*arguments),
        Verb::Evaluate(arguments) => commands::evaluate::run(&arguments),
        Verb::Inspect(arguments) => commands::inspect::run(&arguments),
        Verb::Name(arguments) => commands::name::run(&arguments),
        Verb::Update(arguments) => commands::update::run(&arguments),
        Verb::Publish(arguments) => commands::publish::run(&arguments),
        Verb::Join(arguments) => commands::join::run(&arguments),
        Verb::Serve(arguments) => commands::serve::run(&arguments),
        Verb::Reload(arguments) => commands::reload::run(&arguments),
        Verb::Watch(arguments) => commands::watch::run(&arguments),
        Verb::Top(arguments) => commands::top::run(&arguments),
        Verb::Record(arguments) => commands::record::run(&arguments),
        #[cfg(feature = "bridge")]
        Verb::Bridge(arguments) => commands::bridge::run(&arguments),
        Verb::Replay(arguments) => commands::replay::run(&arguments),
        Verb::Doctor(arguments) => commands::doctor::run(&arguments),
        Verb::Trips(arguments) => commands::trips::run(&arguments),
        Verb::Check(arguments) => commands::check::run(&arguments),
        Verb::Pages(arguments) => commands::pages::run(&arguments),
    }
}
