//! Why an end of a bridge cannot be opened, or go on.

use kinds_messages::ChannelError;

use crate::Endpoint;

/// Why an end of a bridge cannot be opened, or go on.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum BridgeError {
    /// The kinds channel of this machine.
    #[error(transparent)]
    Channel(#[from] ChannelError),
    /// Nobody can be waited for there.
    #[error("cannot listen at {endpoint}: {error}")]
    Listen {
        /// Where.
        endpoint: Endpoint,
        /// What the system said.
        error: std::io::Error,
    },
    /// The network's own library, whose words for it are in the log at level debug.
    #[error("cannot {attempt} at {endpoint}: the network's library failed; KINDS_LOG=debug says more")]
    Link {
        /// What was attempted.
        attempt: &'static str,
        /// Where.
        endpoint: Endpoint,
    },
}
