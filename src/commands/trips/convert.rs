//! `kinds trips convert`: a trip of any sort as the recorder would have written it.

use kinds_driver_shim::Source;
use kinds_trips::TripReader;

use crate::cli::ConvertArguments;
use crate::commands::trips::check_is_new;
use crate::failure::Failure;
use crate::log;
use crate::say::mention;
use crate::trip_file::{Topics, TripFile};

pub(crate) fn run(arguments: &ConvertArguments) -> Result<(), Failure> {
    let ConvertArguments { from, to, .. } = arguments;
    check_is_new(to)?;
    let mut trip = TripReader::open(from, &arguments.selection())?;
    let layout = TripReader::layout(&trip);
    let mut counts = vec![0; layout.n_readings()];
    let (mut file, topics) = (TripFile::create(to)?, Topics::of_the_only_sensor());
    let (mut n_frames, mut n_poses, mut n_commands) = (0_u64, 0_u64, 0_u64);
    while let Some(capture) = trip.next(&mut counts).map_err(|error| Failure::CouldNot(error.to_string()))? {
        file.add_frame(&topics, layout, &counts, &capture)?;
        n_frames += 1;
        n_poses += u64::from(capture.pose.is_some());
        n_commands += u64::from(capture.command.is_some());
    }
    file.finish()?;
    for remark in trip.remarks() {
        log::notice(format!("trip {} {remark}", from.display()));
    }
    mention(format!(
        "converted {n_frames} frames of {layout} into {}, {n_poses} with a pose and {n_commands} with a command",
        to.display()
    ))
}
