//! `kinds pages`: the manual and what shells complete, made from the command line as it is.

use std::path::{Path, PathBuf};

use clap::CommandFactory;
use clap_complete::Shell;

use crate::cli::{Cli, PagesArguments};
use crate::failure::Failure;

pub(crate) fn run(arguments: &PagesArguments) -> Result<(), Failure> {
    let output = &arguments.output;
    let failed = |error| Failure::file("write pages into", output, &error);
    // Global flags and usage lines are known to subcommands only once it is built.
    let mut command = Cli::command().disable_help_subcommand(true);
    command.build();
    let manual = folder(output, "man")?;
    clap_mangen::generate_to(command.clone(), &manual).map_err(failed)?;
    let completions = folder(output, "completions")?;
    for shell in [Shell::Bash, Shell::Zsh, Shell::Fish] {
        clap_complete::generate_to(shell, &mut command, "kinds", &completions).map_err(failed)?;
    }
    Ok(())
}

fn folder(output: &Path, name: &str) -> Result<PathBuf, Failure> {
    let folder = output.join(name);
    std::fs::create_dir_all(&folder).map_err(|error| Failure::file("make folder", &folder, &error))?;
    Ok(folder)
}
