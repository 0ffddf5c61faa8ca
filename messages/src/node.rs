//! This process as a member of a domain.

use std::fs::File;
use std::io::Write as _;
use std::os::fd::AsRawFd as _;
use std::rc::Rc;
use std::sync::{Arc, Once};

use iceoryx2::config::Config;
use iceoryx2::prelude::{
    FilePath, LogLevel, NodeBuilder, NodeName, SemanticString as _, SignalHandlingMode, ipc, set_log_level,
};
use rustix::fs::{MemfdFlags, memfd_create};
use tracing::level_filters::LevelFilter;

use crate::sweeper::Sweeper;
use crate::user::check_owner_of;
use crate::{ChannelError, Domain};

/// This process as a member of a domain: what channels are opened with. A clone is the same member.
///
/// Stays with the thread that opened it, like everything opened with it; another thread opens its own.
#[derive(Clone, Debug)]
pub struct Node {
    pub(crate) inner: Rc<iceoryx2::node::Node<ipc::Service>>,
    pub(crate) domain: Domain,
    /// After the node: to leave may mean to wait for what a killed program left half made. None where all stays as it is.
    pub(crate) sweeper: Option<Arc<Sweeper>>,
}

impl Node {
    /// Joins a domain under a name for people, such as the program's, and removes what killed programs left behind.
    ///
    /// Signals are left to the caller: a wait that one interrupts says so.
    ///
    /// # Errors
    /// If the domain is no place for channels, another user's, or none can be made there.
    pub fn open(domain: &Domain, process_name: &str) -> Result<Self, ChannelError> {
        check_owner_of(&domain.root)?;
        let config = domain.config()?;
        // Before all else: to join may mean to wait as well.
        let sweeper = Some(Arc::new(Sweeper::of(domain)));
        let node = Self::join(domain, &config, sweeper, process_name)?;
        node.clean_up_dead_nodes();
        Ok(node)
    }

    /// Joins a domain to look around in it: what killed programs left behind stays as it is.
    pub fn visit(domain: &Domain, process_name: &str) -> Result<Self, ChannelError> {
        let mut config = domain.config()?;
        config.global.node.cleanup_dead_nodes_on_creation = false;
        config.global.node.cleanup_dead_nodes_on_destruction = false;
        config.global.service.cleanup_dead_nodes_on_open = false;
        Self::join(domain, &config, None, process_name)
    }

    fn join(
        domain: &Domain,
        config: &Config,
        sweeper: Option<Arc<Sweeper>>,
        process_name: &str,
    ) -> Result<Self, ChannelError> {
        let name = NodeName::new(process_name).map_err(|_| ChannelError::ProcessName {
            name: process_name.to_owned(),
            limit: NodeName::max_len(),
        })?;
        set_log_level(log_level());
        tell_transport(domain);
        let inner = NodeBuilder::new()
            .name(&name)
            .config(config)
            .signal_handling_mode(SignalHandlingMode::Disabled)
            .create::<ipc::Service>()
            .map_err(|error| ChannelError::node(error, domain))?;
        Ok(Self { inner: Rc::new(inner), domain: domain.clone(), sweeper })
    }

    /// Removes what killed programs left behind in this domain, and returns how many there were.
    ///
    /// Nobody learns of a killed peer, and its place is not free, until somebody calls this: call it every few
    /// seconds. Costs about 0.1 ms and allocates.
    pub fn clean_up_dead_nodes(&self) -> u64 {
        self.inner.try_cleanup_dead_nodes().cleanups
    }
}

/// Makes the first domain that this process joins the transport's default.
///
/// iceoryx2 0.10.0 removes what a killed node left by the configuration in the node's own file, and once that is gone, by the
/// default one: what is left where a program was killed while it removed another's remains would stay for good elsewhere,
/// and keep places in the channels taken. The default can only come from a file, so it is one without a place on a disk.
fn tell_transport(domain: &Domain) {
    static TOLD: Once = Once::new();
    TOLD.call_once(|| {
        if let Err(reason) = try_tell_transport(domain) {
            tracing::debug!("what a killed program was removing will stay: {reason}");
        }
    });
}

fn try_tell_transport(domain: &Domain) -> Result<(), String> {
    let root =
        domain.root.to_str().filter(|root| !root.contains('\'')).ok_or("the root's name cannot be quoted")?;
    let text = format!("[global]\nroot-path = '{root}'\nprefix = '{}'\n", domain.prefix);
    let file = memfd_create("domain", MemfdFlags::CLOEXEC).map_err(|error| error.to_string())?;
    let mut file = File::from(file);
    file.write_all(text.as_bytes()).map_err(|error| error.to_string())?;
    let path = format!("/proc/self/fd/{}", file.as_raw_fd());
    let path = FilePath::new(path.as_bytes()).map_err(|error| format!("{error:?}"))?;
    Config::setup_global_config_from_file(&path).map_err(|error| format!("{error:?}"))?;
    Ok(())
}

/// The transport warns of its own affairs in its own words, which belong in nobody's terminal: errors pass, the rest is
/// there for whoever asks `tracing` for debug. Read once per node, so subscribers are to be installed before.
fn log_level() -> LogLevel {
    match LevelFilter::current() {
        LevelFilter::TRACE => LogLevel::Trace,
        LevelFilter::DEBUG => LogLevel::Debug,
        LevelFilter::OFF => LogLevel::Fatal,
        _ => LogLevel::Error,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::OwnDomain;

    #[test]
    fn root_where_nothing_can_be_made_is_refused_in_words() {
        let test = OwnDomain::make().unwrap();
        let file = test.root.join("file");
        std::fs::write(&file, "").unwrap();
        let domain = Domain { root: file.join("root"), prefix: test.prefix.clone() };
        assert_eq!(
            Node::open(&domain, "test").unwrap_err().to_string(),
            format!(
                "cannot join the channels under {}/root: files cannot be made there; run all programs of a robot as \
                 one user, who may write there, or choose another root",
                file.display()
            )
        );
    }

    #[test]
    fn process_name_that_is_too_long_is_refused_in_words() {
        let test = OwnDomain::make().unwrap();
        let name = "x".repeat(200);
        assert_eq!(
            Node::open(&test, &name).unwrap_err().to_string(),
            format!("process name \"{name}\" cannot be used; give at most 128 ASCII characters")
        );
    }
}
