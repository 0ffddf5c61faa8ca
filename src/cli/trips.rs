//! What can be asked of `kinds trips`.

use std::path::PathBuf;

use clap::{Args, Subcommand};
use kinds_trips::Selection;

use super::ReadingArguments;

#[derive(Args, Debug)]
pub(crate) struct TripsArguments {
    #[command(subcommand)]
    pub(crate) verb: TripsVerb,
}

#[derive(Debug, Subcommand)]
pub(crate) enum TripsVerb {
    /// Say what is in a recording: topics, rates, gaps, what could be a frame, and how to train on it
    Info(InfoArguments),
    /// Write a trip as `kinds record` would have: frames as depth images, poses, commands
    Convert(ConvertArguments),
    /// Save what is whole of a damaged or cut-off recording (MCAP), all topics of it
    Recover(RecoverArguments),
}

#[derive(Args, Debug)]
pub(crate) struct InfoArguments {
    /// Recorded trip
    #[arg(value_name = "TRIP")]
    pub(crate) trip: PathBuf,
    /// Print one JSON object
    #[arg(long)]
    pub(crate) json: bool,
}

#[derive(Args, Debug)]
pub(crate) struct ConvertArguments {
    /// Recorded trip
    #[arg(value_name = "IN")]
    pub(crate) from: PathBuf,
    /// ROS 2 bag (MCAP) to write: it must not be there yet
    #[arg(value_name = "OUT.mcap")]
    pub(crate) to: PathBuf,
    #[command(flatten)]
    reading: ReadingArguments,
}

impl ConvertArguments {
    pub(crate) fn selection(&self) -> Selection {
        self.reading.selection(None)
    }
}

#[derive(Args, Debug)]
pub(crate) struct RecoverArguments {
    /// Damaged recording; it is only read
    #[arg(value_name = "IN")]
    pub(crate) from: PathBuf,
    /// MCAP file to write: it must not be there yet
    #[arg(value_name = "OUT.mcap")]
    pub(crate) to: PathBuf,
}
