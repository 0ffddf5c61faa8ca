//! Two channels by which a running service is given another model: requests to it, and its answers.
//!
//! One program asks at a time. It opens the answers before it asks, so that none is missed, and stays until its answer is
//! there: a request goes with the program that made it.

use std::path::Path;

use crate::channel::{Channel, Purpose};
use crate::fixed::{Inlet, Outlet};
use crate::{ChannelError, Node, ReloadAnswer, ReloadRequest, SensorName, monotonic_ns};

/// The service's end.
#[derive(Debug)]
pub struct ReloadDesk {
    requests: Inlet<ReloadRequest>,
    answers: Outlet<ReloadAnswer>,
}

/// The end of a program that asks.
#[derive(Debug)]
pub struct ReloadAsker {
    answers: Inlet<ReloadAnswer>,
    requests: Outlet<ReloadRequest>,
}

impl ReloadDesk {
    /// Opens both channels. Fails when another program serves this sensor.
    pub fn open(node: &Node, sensor: &SensorName) -> Result<Self, ChannelError> {
        let requests = Inlet::open(node, Channel::new(node, sensor, Purpose::ReloadRequests))?;
        let answers = Outlet::create(node, Channel::new(node, sensor, Purpose::ReloadAnswers))?;
        Ok(Self { requests, answers })
    }

    /// The oldest request that waits, if any.
    pub fn receive(&self) -> Result<Option<ReloadRequest>, ChannelError> {
        self.requests.receive()
    }

    /// Answers a request.
    pub fn answer(&self, answer: &ReloadAnswer) -> Result<(), ChannelError> {
        self.answers.send(answer)
    }
}

impl ReloadAsker {
    /// Opens both channels, whether or not a service is there. Fails when another program is asking.
    pub fn open(node: &Node, sensor: &SensorName) -> Result<Self, ChannelError> {
        let answers = Inlet::open(node, Channel::new(node, sensor, Purpose::ReloadAnswers))?;
        let requests = Outlet::create(node, Channel::new(node, sensor, Purpose::ReloadRequests))?;
        Ok(Self { answers, requests })
    }

    /// Whether a service is there that answers, or was killed and not yet cleaned up.
    pub fn is_heard(&self) -> bool {
        self.answers.is_published()
    }

    /// Asks for the model of a file, by its absolute path, or for the one in use to be read again. Returns the request's
    /// number, or none where the path is longer than the system allows.
    pub fn ask(&self, path: Option<&Path>) -> Result<Option<u64>, ChannelError> {
        let Some(request) = ReloadRequest::new(monotonic_ns(), path) else { return Ok(None) };
        self.requests.send(&request)?;
        Ok(Some(request.id))
    }

    /// The answer to a request, if it is there.
    pub fn answer_to(&self, id: u64) -> Result<Option<ReloadAnswer>, ChannelError> {
        while let Some(answer) = self.answers.receive()? {
            if answer.id == id {
                return Ok(Some(answer));
            }
        }
        Ok(None)
    }
}
