//! `kinds publish`: the driver shim of one sensor.

use kinds_driver_shim::{Flow, Replay, Shim};
use kinds_messages::Node;
use kinds_trips::TripReader;

use crate::cli::PublishArguments;
use crate::failure::Failure;
use crate::stop;

pub(crate) fn run(arguments: &PublishArguments) -> Result<(), Failure> {
    let stop = stop::on_signals()?;
    let trip = TripReader::open(&arguments.trip, &arguments.selection())?;
    let node = Node::open(&arguments.domain.domain(), "kinds-publish")?;
    let (sensor, pace) = (&arguments.sensor, arguments.speed);
    let flow = if arguments.follow { Flow::Followed } else { pace.flow() };
    let mut shim = Shim::new(&node, sensor, Replay::new(trip, pace), flow)?;
    let summary = shim.run(&stop, &mut |notice| eprintln!("kinds: {notice}"))?;
    if let Some(truncation) = shim.device().source().truncation() {
        eprintln!("kinds: trip {} {truncation}", arguments.trip.display());
    }
    println!("published {} frames of {sensor} in {:.1} s", summary.n_frames, summary.duration.as_secs_f64());
    if summary.n_unreported > 0 {
        return Err(Failure::CouldNot(format!(
            "the service left {} of {} frames of {sensor} unreported",
            summary.n_unreported, summary.n_frames
        )));
    }
    Ok(())
}
