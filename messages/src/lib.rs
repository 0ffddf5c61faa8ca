//! What processes agree on in shared memory: frames, kind reports and their channels.
//!
//! Two channels make up every sensor's way. The driver shim publishes frames on the first; the service reads them where
//! they lie and publishes a kind report for each on the second, for as many consumers as [`MAX_REPORT_READERS`]:
//!
//! ```text
//! FramePublisher ─ natural-kinds/SENSOR/frames ─▶ FrameReader    (service, recorder)
//! ReportPublisher ─ natural-kinds/SENSOR/kinds ─▶ ReportReader   (consumers)
//! ```
//!
//! Beside them, the service says on a third channel once a second how it fares ([`HealthReport`]), and is given other models
//! through two more ([`ReloadAsker`]).
//!
//! Either end may come first, leave, be killed and come back. Each channel has one publisher at a time; publishing never
//! waits for a reader: one that is slow loses its oldest messages first, and can tell how many by their sequence.
//! After opening, waiting and receiving allocate nothing. Sending does once: iceoryx2 keeps 48 bytes for a loan, whichever
//! way it is asked for, until that is sent. A report's is lent ahead, so that nothing is allocated before it is sent.
//!
//! This crate knows no mathematics, and is the only one of the project that knows iceoryx2. Errors are sentences
//! ([`ChannelError`]); the transport's own words for them are logged through `tracing`, at level debug.
//!
//! ```no_run
//! use kinds_messages::{Domain, Node, ReportReader, SensorName};
//! use std::time::Duration;
//!
//! let node = Node::open(&Domain::default(), "consumer")?;
//! let sensor: SensorName = "crunch/ring".parse().expect("a name as it should be");
//! let reports = ReportReader::open(&node, &sensor)?;
//! loop {
//!     while let Some(report) = reports.receive()? {
//!         println!("frame {}: kind {} of {:?}", report.sequence, report.kind, report.probabilities());
//!     }
//!     reports.wait(Duration::from_secs(1))?;
//! }
//! # #[allow(unreachable_code)]
//! # Ok::<(), kinds_messages::ChannelError>(())
//! ```
#![forbid(unsafe_code)]

mod census;
mod channel;
mod clock;
mod domain;
mod environment;
mod error;
mod fixed;
mod frame_header;
mod frames;
mod half_made;
mod health;
mod health_report;
mod kind_report;
mod level;
mod memory;
mod name;
mod node;
mod own_domain;
mod reload_messages;
mod reloads;
mod report_bytes;
mod reports;
mod spell;
mod sweeper;
#[cfg(test)]
mod testing;
#[cfg(test)]
mod tests;
mod user;

pub use census::{Census, Difference, FoundChannel, Life, Program, Publisher};
pub use channel::{
    FRAME_BUFFER, MAX_FRAME_READERS, MAX_HEALTH_READERS, MAX_REPORT_READERS, Purpose, REPORT_BUFFER, Waiting,
    WakeUp,
};
pub use clock::{monotonic_ns, ns_since_epoch};
pub use domain::{Domain, DomainError};
pub use error::ChannelError;
pub use frame_header::{Command, FrameHeader, Pose};
pub use frames::{Frame, FrameLoan, FramePublisher, FrameReader};
pub use health::{HealthPublisher, HealthReader};
pub use health_report::{Drift, HealthReport, Latency, StageLatencies};
pub use kind_report::{KindReport, MAX_DIMS, MAX_KINDS, ReportStatus};
pub use level::Level;
pub use memory::{
    SHARED_MEMORY, frames_memory_bytes, free_memory_bytes, reports_memory_bytes, service_memory_bytes,
};
pub use name::{SensorName, SensorNameError};
pub use node::Node;
pub use own_domain::OwnDomain;
pub use reload_messages::{ReloadAnswer, ReloadRequest};
pub use reloads::{ReloadAsker, ReloadDesk};
pub use report_bytes::ForeignReport;
pub use reports::{HeldReport, ReportPublisher, ReportReader, ServiceId};
pub use spell::Spell;
pub use user::user_name;
