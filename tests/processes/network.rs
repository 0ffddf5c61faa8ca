//! Two hosts that a wire joins: two network namespaces of this machine.

#![allow(clippy::print_stderr, reason = "a test that is skipped says so")]

use std::net::Ipv4Addr;
use std::process::Command;
use std::sync::atomic::{AtomicUsize, Ordering};

use crate::robot::Robot;
use crate::running::Running;

/// The address of the robot's end of the wire.
pub(crate) const ROBOT: Ipv4Addr = Ipv4Addr::new(10, 77, 0, 1);
const OTHER: Ipv4Addr = Ipv4Addr::new(10, 77, 0, 2);

/// The name of the wire in both.
const WIRE: &str = "wire";

/// A robot, another machine, and the wire between them. Gone with what runs there.
pub(crate) struct Network {
    /// Names of the namespaces.
    robot: String,
    other: String,
}

/// One of the two.
#[derive(Clone, Copy)]
pub(crate) enum Host {
    Robot,
    Other,
}

impl Network {
    /// None, in words, where namespaces may not be made.
    pub(crate) fn make() -> Option<Self> {
        static N_MADE: AtomicUsize = AtomicUsize::new(0);
        let name = format!("kinds-{}-{}", std::process::id(), N_MADE.fetch_add(1, Ordering::Relaxed));
        let network = Self { robot: format!("{name}-robot"), other: format!("{name}-other") };
        match network.join() {
            Ok(()) => Some(network),
            Err(reason) => {
                eprintln!("skipped: no two hosts can be made here: {reason}");
                None
            }
        }
    }

    fn join(&self) -> Result<(), String> {
        let Self { robot, other } = self;
        for namespace in [robot, other] {
            ip(&["netns", "add", namespace])?;
            ip(&["-n", namespace, "link", "set", "lo", "up"])?;
        }
        ip(&["-n", robot, "link", "add", WIRE, "type", "veth", "peer", "name", WIRE, "netns", other])?;
        for (namespace, address) in [(robot, ROBOT), (other, OTHER)] {
            ip(&["-n", namespace, "address", "add", &format!("{address}/24"), "dev", WIRE])?;
            ip(&["-n", namespace, "link", "set", WIRE, "up"])?;
        }
        Ok(())
    }

    fn namespace(&self, host: Host) -> &str {
        match host {
            Host::Robot => &self.robot,
            Host::Other => &self.other,
        }
    }

    /// Starts `kinds` on a host.
    pub(crate) fn start(&self, host: Host, robot: &Robot, arguments: &[&str]) -> Running {
        let there = ["netns", "exec", self.namespace(host), env!("CARGO_BIN_EXE_kinds")];
        Running::start(&mut robot.command_of("ip", &[&there[..], arguments].concat()))
    }

    /// Cuts the wire at the robot.
    pub(crate) fn cut(&self) {
        ip(&["-n", &self.robot, "link", "set", WIRE, "down"]).unwrap();
    }

    /// Mends it.
    pub(crate) fn mend(&self) {
        ip(&["-n", &self.robot, "link", "set", WIRE, "up"]).unwrap();
    }
}

impl Drop for Network {
    fn drop(&mut self) {
        // What was never made is not there; a wire goes with its ends.
        for namespace in [&self.robot, &self.other] {
            let _ = ip(&["netns", "delete", namespace]);
        }
    }
}

fn ip(arguments: &[&str]) -> Result<(), String> {
    let output = Command::new("ip").args(arguments).output().map_err(|error| format!("ip: {error}"))?;
    match output.status.success() {
        true => Ok(()),
        false => {
            let said = String::from_utf8_lossy(&output.stderr);
            Err(format!("ip {}: {}", arguments.join(" "), said.trim()))
        }
    }
}
