//! One module for each verb.

#[cfg(feature = "bridge")]
pub(crate) mod bridge;
pub(crate) mod check;
pub(crate) mod demo;
pub(crate) mod doctor;
pub(crate) mod evaluate;
pub(crate) mod inspect;
pub(crate) mod join;
pub(crate) mod name;
pub(crate) mod pages;
pub(crate) mod publish;
pub(crate) mod record;
pub(crate) mod reload;
pub(crate) mod replay;
pub(crate) mod serve;
pub(crate) mod top;
pub(crate) mod train;
pub(crate) mod trips;
pub(crate) mod update;
pub(crate) mod watch;

use kinds_messages::OwnDomain;

use crate::failure::Failure;

/// What an end of a bridge says that it is.
const BRIDGE: &str = "kinds-bridge";

/// A domain for programs that nobody else is to meet.
fn own_domain() -> Result<OwnDomain, Failure> {
    OwnDomain::make().map_err(|error| Failure::CouldNot(format!("cannot make a temporary folder: {error}")))
}
