//! The network's library, zenoh: how it is set up, and what it is asked for.
//!
//! Its words name its own sources, so they go to the log at level debug, and ours to whoever started the program.

use std::net::TcpListener;

use kinds_messages::SensorName;
use zenoh::{Config, Session, Wait};

use crate::{BridgeError, Endpoint};

/// Silence after which the other end counts as gone. It says four times as often that it is there. Milliseconds.
const LEASE_MS: u32 = 2000;

/// Longest wait for a link that takes nothing, after which it counts as lost: longer than [`LEASE_MS`], which finds out before,
/// but where the other end still says that it is there. Microseconds.
const BLOCKED_US: u32 = 3_000_000;

/// What the system may keep of what has been sent, and the library before that: some reports. What waits there grows old
/// unseen. Bytes.
const SYSTEM_BUFFER_BYTES: u32 = 32_768;
const BATCH_BYTES: u32 = 8192;

/// Largest message that is taken from the other end: more than any report, and no danger to memory. Bytes.
const MESSAGE_BYTES_MAX: u32 = 65_536;

/// The shortest and the longest time between two tries to connect. Milliseconds.
const RETRY_MS: [u32; 2] = [100, 1000];

/// An end's place in the network. Dropped last: whatever was declared in it goes before.
#[derive(Debug)]
pub(crate) struct Link {
    session: Session,
    endpoint: Endpoint,
}

impl Link {
    /// Waits for other ends at an address.
    pub(crate) fn listen(endpoint: &Endpoint) -> Result<Self, BridgeError> {
        // So that the system's own words are at hand, for a port that is taken above all.
        let tried = TcpListener::bind(endpoint.address());
        tried.map_err(|error| BridgeError::Listen { endpoint: endpoint.clone(), error })?;
        Self::open(endpoint, "listen", "connect")
    }

    /// Looks for the other end at an address, until it is there and again whenever it is gone.
    pub(crate) fn connect(endpoint: &Endpoint) -> Result<Self, BridgeError> {
        Self::open(endpoint, "connect", "listen")
    }

    fn open(endpoint: &Endpoint, does: &'static str, does_not: &str) -> Result<Self, BridgeError> {
        let [retry_ms_min, retry_ms_max] = RETRY_MS;
        let mut config = Config::default();
        for (key, value) in [
            ("mode", "\"peer\"".to_string()),
            // Nobody is looked for and nobody told of others: two ends are named to each other by who set them up.
            ("scouting/multicast/enabled", "false".into()),
            ("scouting/gossip/enabled", "false".into()),
            (&format!("{does}/endpoints"), format!("[\"{endpoint}\"]")),
            (&format!("{does_not}/endpoints"), "[]".into()),
            // In the background, for ever.
            ("connect/timeout_ms", "-1".into()),
            ("connect/exit_on_failure", "false".into()),
            (
                "connect/retry",
                format!(
                    "{{period_init_ms: {retry_ms_min}, period_max_ms: {retry_ms_max}, period_increase_factor: 2}}"
                ),
            ),
            ("open/return_conditions/connect_scouted", "false".into()),
            ("transport/unicast/open_timeout", LEASE_MS.to_string()),
            ("transport/unicast/accept_timeout", LEASE_MS.to_string()),
            ("transport/link/tx/lease", LEASE_MS.to_string()),
            ("transport/link/tx/batch_size", BATCH_BYTES.to_string()),
            ("transport/link/tx/queue/congestion_control/block/wait_before_close", BLOCKED_US.to_string()),
            ("transport/link/tcp/so_sndbuf", SYSTEM_BUFFER_BYTES.to_string()),
            ("transport/link/rx/max_message_size", MESSAGE_BYTES_MAX.to_string()),
        ] {
            config.insert_json5(key, &value).unwrap_or_else(|error| panic!("{key} = {value}: {error}"));
        }
        let session = zenoh::open(config).wait().map_err(|error| failed(endpoint, does, error.as_ref()))?;
        Ok(Self { session, endpoint: endpoint.clone() })
    }

    pub(crate) fn session(&self) -> &Session {
        &self.session
    }

    pub(crate) fn endpoint(&self) -> &Endpoint {
        &self.endpoint
    }

    /// What becomes of an error of the library.
    pub(crate) fn error(&self, attempt: &'static str) -> impl Fn(zenoh::Error) -> BridgeError {
        let endpoint = self.endpoint.clone();
        move |error| failed(&endpoint, attempt, error.as_ref())
    }
}

/// What the reports of a sensor go under.
pub(crate) fn key(sensor: &SensorName) -> String {
    format!("kinds/{sensor}")
}

fn failed(endpoint: &Endpoint, attempt: &'static str, error: &dyn std::error::Error) -> BridgeError {
    tracing::debug!("{attempt} at {endpoint}: {error}");
    BridgeError::Link { attempt, endpoint: endpoint.clone() }
}
