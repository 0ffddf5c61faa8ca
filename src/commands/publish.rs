//! `kinds publish`: the driver shim of one sensor.

use std::path::Path;
use std::sync::Arc;
use std::sync::atomic::AtomicBool;

use kinds_driver_shim::simulated::{Chew, Crunch, Floor, Robot};
use kinds_driver_shim::{Faults, Faulty, Flow, Pace, Paced, Sensor, Shim, Source};
use kinds_messages::Node;
use kinds_trips::TripReader;

use crate::cli::{PublishArguments, RobotName};
use crate::failure::Failure;
use crate::say::mention;
use crate::{log, stop};

pub(crate) fn run(arguments: &PublishArguments) -> Result<(), Failure> {
    let stop = stop::on_signals()?;
    match (arguments.simulate, &arguments.trip) {
        (Some(name), trip) => {
            let robot = simulated(name, trip.as_deref(), arguments)?;
            publish(robot, arguments, &stop, |_| None)
        }
        (None, Some(path)) => {
            let trip = TripReader::open(path, &arguments.selection())?;
            publish(trip, arguments, &stop, |trip| {
                trip.truncation().map(|truncation| format!("trip {} {truncation}", path.display()))
            })
        }
        (None, None) => Err(Failure::AskedWrongly("say what to publish: --trip or --simulate".to_string())),
    }
}

fn simulated(
    name: RobotName,
    trip: Option<&Path>,
    arguments: &PublishArguments,
) -> Result<Box<dyn Robot>, Failure> {
    let text = trip.map_or_else(|| "1".into(), Path::to_string_lossy);
    let Ok(trip) = text.parse() else {
        return Err(Failure::AskedWrongly(format!(
            "with --simulate, --trip is the number of one of the robot's trips, such as 2; it is \"{text}\""
        )));
    };
    match (name, arguments.world) {
        (RobotName::Chew, Some(_)) => {
            Err(Failure::AskedWrongly("chew drives on its campus alone; leave out --world".to_string()))
        }
        (_, world) => Ok(robot(name, world.unwrap_or(Floor::Fourth), trip, arguments.seed)),
    }
}

/// A simulated robot at the start of a trip. Chew has no floor to drive on.
pub(crate) fn robot(name: RobotName, floor: Floor, trip: u32, seed: u64) -> Box<dyn Robot> {
    match name {
        RobotName::Crunch => Box::new(Crunch::new(floor, trip, seed)),
        RobotName::Chew => Box::new(Chew::new(trip, seed)),
    }
}

/// Publishes a source to its end, with faults if they are asked for, and then says what `remark` has to say of it.
fn publish<S: Source>(
    source: S,
    arguments: &PublishArguments,
    stop: &Arc<AtomicBool>,
    remark: impl Fn(&S) -> Option<String>,
) -> Result<(), Failure> {
    let device = Paced::new(source, arguments.speed);
    let Some(path) = &arguments.faults else {
        return publish_device(device, arguments, stop, |device| {
            remark(device.source()).into_iter().collect()
        });
    };
    let faulty = Faulty::new(device, read_faults(path)?);
    publish_device(faulty, arguments, stop, |faulty| {
        let injected = format!("faults were injected into {}", faulty.injected());
        remark(faulty.device().source()).into_iter().chain([injected]).collect()
    })
}

fn read_faults(path: &Path) -> Result<Faults, Failure> {
    let text = std::fs::read_to_string(path).map_err(|error| Failure::file("read faults", path, &error))?;
    Faults::from_ron(&text)
        .map_err(|error| Failure::AskedWrongly(format!("faults {}: {error}", path.display())))
}

/// Publishes a device to its end, and then says all that `remarks` has to say of it.
fn publish_device<S: Sensor>(
    device: S,
    arguments: &PublishArguments,
    stop: &Arc<AtomicBool>,
    remarks: impl Fn(&S) -> Vec<String>,
) -> Result<(), Failure> {
    let domain = arguments.domain.join(stop);
    let node = Node::open(&domain, "kinds-publish")?;
    let (sensor, pace) = (&arguments.sensor, arguments.speed);
    let flow = match pace {
        _ if arguments.follow => Flow::Followed,
        // A robot waits for nobody.
        Pace::Recorded(_) if arguments.simulate.is_some() => Flow::Live,
        pace => pace.flow(),
    };
    let mut shim = Shim::new(&node, sensor, device, flow)?;
    let summary = shim.run(stop, &mut |notice| log::notice(notice))?;
    for remark in remarks(shim.device()) {
        log::notice(remark);
    }
    let (n_frames, duration_s) = (summary.n_frames, summary.duration.as_secs_f64());
    mention(format!("published {n_frames} frames of {sensor} in {duration_s:.1} s"))?;
    if summary.n_unreported > 0 {
        return Err(Failure::CouldNot(format!(
            "the service left {} of {} frames of {sensor} unreported",
            summary.n_unreported, summary.n_frames
        )));
    }
    Ok(())
}
