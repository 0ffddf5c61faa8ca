//! `kinds publish`: the driver shim of one sensor.

use std::fmt::Display;
use std::sync::Arc;
use std::sync::atomic::AtomicBool;

use kinds_driver_shim::simulated::{Chew, Crunch, Floor, Robot};
use kinds_driver_shim::v4l2::DepthCamera;
use kinds_driver_shim::wire::Wired;
use kinds_driver_shim::{DeviceAddress, Faulty, Flow, Pace, Paced, Sensor, Shim, Summary};
use kinds_messages::{Node, SensorName};
use kinds_trips::TripReader;

use crate::cli::{PublishArguments, PublishPlan, RobotName, SourcePlan};
use crate::failure::Failure;
use crate::notify::Supervisor;
use crate::say::mention;
use crate::{log, stop};

pub(crate) fn run(arguments: &PublishArguments) -> Result<(), Failure> {
    let stop = stop::on_signals()?;
    let plan = arguments.plan()?;
    match &plan.source {
        &SourcePlan::Robot { name, floor, trip, seed } => {
            let device = Paced::new(robot(name, floor, trip, seed), plan.pace);
            publish(device, arguments, &plan, &stop, |_| None)
        }
        SourcePlan::Trip { path, selection } => {
            let device = Paced::new(TripReader::open(path, selection)?, plan.pace);
            publish(device, arguments, &plan, &stop, |device| {
                let truncation = device.source().truncation();
                truncation.map(|truncation| format!("trip {} {truncation}", path.display()))
            })
        }
        SourcePlan::Device { address: DeviceAddress::Wire(address), layout } => {
            let device = Wired::open(address.clone(), *layout)
                .map_err(|error| Failure::CouldNot(error.to_string()))?;
            publish(device, arguments, &plan, &stop, |device| left_out(address, device.left_out()))
        }
        SourcePlan::Device { address: DeviceAddress::Camera(address), layout } => {
            let device = DepthCamera::new(address.clone(), *layout)
                .map_err(|error| Failure::CouldNot(error.to_string()))?;
            publish(device, arguments, &plan, &stop, |device| left_out(address, device.left_out()))
        }
    }
}

/// What there is to say of a device's frames that were left out, if any were.
fn left_out<T: Default + PartialEq + Display>(address: &impl Display, left_out: T) -> Option<String> {
    (left_out != T::default()).then(|| format!("of what {address} sent, were left out: {left_out}"))
}

/// A simulated robot at the start of a trip. Chew has no floor to drive on.
pub(crate) fn robot(name: RobotName, floor: Floor, trip: u32, seed: u64) -> Box<dyn Robot> {
    match name {
        RobotName::Crunch => Box::new(Crunch::new(floor, trip, seed)),
        RobotName::Chew => Box::new(Chew::new(trip, seed)),
    }
}

/// Publishes a device to its end, with faults if they are asked for, and then says what `remark` has to say of it.
fn publish<S: Sensor>(
    device: S,
    arguments: &PublishArguments,
    plan: &PublishPlan,
    stop: &Arc<AtomicBool>,
    remark: impl Fn(&S) -> Option<String>,
) -> Result<(), Failure> {
    let Some(faults) = &plan.faults else {
        return publish_device(device, arguments, plan, stop, |device| remark(device).into_iter().collect());
    };
    let faulty = Faulty::new(device, faults.clone());
    publish_device(faulty, arguments, plan, stop, |faulty| {
        let injected = format!("faults were injected into {}", faulty.injected());
        remark(faulty.device()).into_iter().chain([injected]).collect()
    })
}

/// Publishes a device to its end, and then says all that `remarks` has to say of it.
fn publish_device<S: Sensor>(
    device: S,
    arguments: &PublishArguments,
    plan: &PublishPlan,
    stop: &Arc<AtomicBool>,
    remarks: impl Fn(&S) -> Vec<String>,
) -> Result<(), Failure> {
    let supervisor = Supervisor::from_environment();
    let domain = arguments.domain.join(stop);
    let node = Node::open(&domain, "kinds-publish")?;
    let sensor = &plan.sensor;
    let flow = match (plan.pace, &plan.source) {
        _ if plan.follow => Flow::Followed,
        // A robot waits for nobody.
        (_, SourcePlan::Device { .. }) | (Pace::Recorded(_), SourcePlan::Robot { .. }) => Flow::Live,
        (pace, _) => pace.flow(),
    };
    let summary = publish_until_stopped(&node, sensor, device, flow, stop, &supervisor, remarks)?;
    if summary.n_unreported > 0 {
        return Err(Failure::CouldNot(format!(
            "the service left {} of {} frames of {sensor} unreported",
            summary.n_unreported, summary.n_frames
        )));
    }
    Ok(())
}

/// Publishes a device until it ends or is to stop, then says all that `remarks` has to say of it, and what was done.
pub(crate) fn publish_until_stopped<S: Sensor>(
    node: &Node,
    sensor: &SensorName,
    device: S,
    flow: Flow,
    stop: &AtomicBool,
    supervisor: &Supervisor,
    remarks: impl Fn(&S) -> Vec<String>,
) -> Result<Summary, Failure> {
    let mut shim = Shim::new(node, sensor, device, flow)?;
    let status = format!("publishing {sensor}");
    supervisor.ready(&status);
    let watched = supervisor.clone();
    shim.listen_to_turns(move || watched.alive(&status));
    let published = shim.run(stop, &mut |notice| log::notice(notice));
    supervisor.stopping();
    let summary = published?;
    for remark in remarks(shim.device()) {
        log::notice(remark);
    }
    let (n_frames, duration_s) = (summary.n_frames, summary.duration.as_secs_f64());
    mention(format!("published {n_frames} frames of {sensor} in {duration_s:.1} s"))?;
    Ok(summary)
}
