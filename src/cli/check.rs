//! What can be asked of `kinds check`.

use std::path::PathBuf;

use clap::{Args, ValueEnum};

#[derive(Args, Debug)]
pub(crate) struct CheckArguments {
    /// Configuration files (RON). Each says what it is for by its first word, as in Serve( … )
    #[arg(required = true, value_name = "FILE.ron")]
    pub(crate) files: Vec<PathBuf>,
    /// What files are for that do not say it
    #[arg(long = "as", value_enum, value_name = "WHAT")]
    pub(crate) sort: Option<Sort>,
}

/// What a configuration file is for.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub(crate) enum Sort {
    /// kinds serve --config
    Serve,
    /// kinds publish --config
    Publish,
    /// kinds join --config
    Join,
    /// kinds record --config
    Record,
    /// kinds bridge --config
    #[cfg(feature = "bridge")]
    Bridge,
    /// kinds train --config
    Train,
    /// kinds publish --faults
    Faults,
    /// kinds serve --realtime
    Realtime,
}

impl Sort {
    /// The word that a file of this sort may begin with.
    pub(crate) fn word(self) -> &'static str {
        match self {
            Self::Serve => "Serve",
            Self::Publish => "Publish",
            Self::Join => "Join",
            Self::Record => "Record",
            #[cfg(feature = "bridge")]
            Self::Bridge => "Bridge",
            Self::Train => "Train",
            Self::Faults => "Faults",
            Self::Realtime => "Realtime",
        }
    }
}
