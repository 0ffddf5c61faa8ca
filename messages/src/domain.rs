//! Where channels live: programs meet when they name the same domain, and do not notice each other otherwise.

use std::fmt::Write as _;
use std::fs::DirEntry;
use std::io::ErrorKind;
use std::os::unix::ffi::OsStrExt;
use std::path::{Path, PathBuf};

use iceoryx2::config::Config;
use iceoryx2::prelude::{CallbackProgression, FileName, NodeState, SemanticString, ipc};

use crate::memory::SHARED_MEMORY;

/// Most bytes of a socket's path (`sockaddr_un`, without the final 0).
const SOCKET_PATH_MAX: usize = 107;
/// Events go through sockets named `ROOT/PREFIX<number>.event`. The number has 128 bits and grows with every port
/// opened since the machine's start, so a root that is a little too long would work at first.
const SOCKET_NAME_MAX: usize = "/".len() + 39 + ".event".len();
/// Most bytes of root and prefix together.
const ROOT_AND_PREFIX_MAX: usize = SOCKET_PATH_MAX - SOCKET_NAME_MAX;

/// Folder and prefix of everything that channels leave in the file system and in shared memory.
///
/// The default is iceoryx2's own, so that a Python program with iceoryx2's defaults finds our channels.
/// All programs of a domain must run as the same user.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Domain {
    /// Folder of sockets and small files; made when it is not there. An absolute path, short.
    pub root: PathBuf,
    /// Beginning of the names of all files, in the root and in /dev/shm.
    pub prefix: String,
}

impl Default for Domain {
    fn default() -> Self {
        let global = Config::default().global;
        // Without the slash that the transport ends paths with.
        let root = Path::new(&global.root_path().to_string()).components().collect();
        Self { root, prefix: global.prefix.to_string() }
    }
}

impl Domain {
    /// A domain of its own under a folder: programs that name the same folder meet, all others do not.
    ///
    /// For several robots on one machine, and for tests. The prefix follows from the folder's path.
    pub fn in_folder(root: &Path) -> Self {
        // FNV-1a: short, and the same in every build, which the standard hasher does not promise.
        let hash = root
            .as_os_str()
            .as_bytes()
            .iter()
            .fold(0x811c_9dc5_u32, |hash, byte| (hash ^ u32::from(*byte)).wrapping_mul(0x0100_0193));
        let mut prefix = String::from("k");
        write!(prefix, "{hash:08x}_").expect("a string takes any text");
        Self { root: root.to_path_buf(), prefix }
    }

    /// Removes all that the domain has in shared memory, unless programs are in it: what killed programs left, and the
    /// small file that the transport leaves by design.
    ///
    /// For domains that end for good, such as a test's.
    pub fn remove_remains(&self) -> std::io::Result<()> {
        if self.is_inhabited()? { Ok(()) } else { self.clear_shared_memory() }
    }

    /// Removes every file of the domain from shared memory, whoever may use it.
    fn clear_shared_memory(&self) -> std::io::Result<()> {
        self.shared_files()?.iter().try_for_each(std::fs::remove_file)
    }

    /// Removes the domain, with its root folder and all that is in it, unless programs are in it. Returns whether it is
    /// gone.
    ///
    /// For a domain whose maker was killed. May fail when another program does the same at this moment.
    pub fn remove_if_deserted(&self) -> std::io::Result<bool> {
        if self.is_inhabited()? {
            return Ok(false);
        }
        self.clear_shared_memory()?;
        match std::fs::remove_dir_all(&self.root) {
            Err(error) if error.kind() != ErrorKind::NotFound => Err(error),
            _ => Ok(true),
        }
    }

    /// Whether a program is in it that lives, or that another user's rights hide.
    ///
    /// Files in the root tell less: a program that is killed while it joins or leaves is half there, and stays so.
    fn is_inhabited(&self) -> std::io::Result<bool> {
        // Where no domain can be, nobody is.
        let Ok(config) = self.config() else { return Ok(false) };
        let mut is_inhabited = false;
        let listed = iceoryx2::node::Node::<ipc::Service>::list(&config, |node| {
            is_inhabited |= matches!(node, NodeState::Alive(_) | NodeState::Inaccessible(_));
            CallbackProgression::Continue
        });
        listed.map_err(|error| std::io::Error::other(format!("programs cannot be listed: {error:?}")))?;
        Ok(is_inhabited)
    }

    /// Files of which each stands for a service of the transport: a channel's messages, or its events.
    pub(crate) fn service_files(&self) -> Vec<PathBuf> {
        let is_service = |file: &DirEntry| {
            let name = file.file_name();
            let name = name.to_string_lossy();
            name.starts_with(&self.prefix) && name.ends_with(".service")
        };
        let files = std::fs::read_dir(self.root.join("services")).into_iter().flatten().flatten();
        files.filter(is_service).map(|file| file.path()).collect()
    }

    /// All that the domain has in shared memory.
    pub(crate) fn shared_files(&self) -> std::io::Result<Vec<PathBuf>> {
        let is_ours = |file: &DirEntry| file.file_name().as_bytes().starts_with(self.prefix.as_bytes());
        let files = std::fs::read_dir(SHARED_MEMORY)?.flatten();
        Ok(files.filter(is_ours).map(|file| file.path()).collect())
    }

    /// The transport's configuration for this domain. Passing one keeps it from looking for configuration files.
    pub(crate) fn config(&self) -> Result<Config, DomainError> {
        let root = || self.root.clone();
        if !self.root.is_absolute() {
            return Err(DomainError::RootNotAbsolute { root: root() });
        }
        let length = self.root.as_os_str().len() + self.prefix.len();
        if length > ROOT_AND_PREFIX_MAX {
            return Err(DomainError::TooLong { root: root(), prefix: self.prefix.clone(), length });
        }
        let mut config = Config::default();
        let path = iceoryx2::prelude::Path::new(self.root.as_os_str().as_bytes())
            .map_err(|_| DomainError::RootCharacters { root: root() })?;
        config.global.set_root_path(&path);
        config.global.prefix = FileName::new(self.prefix.as_bytes())
            .map_err(|_| DomainError::Prefix { prefix: self.prefix.clone() })?;
        Ok(config)
    }
}

/// Why channels cannot live there.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum DomainError {
    /// The root is not absolute.
    #[error(
        "channels cannot live under {}: programs started in other folders would not find them; \
         give the root as an absolute path", root.display()
    )]
    RootNotAbsolute {
        /// The root as given.
        root: PathBuf,
    },
    /// The sockets' paths would be longer than the system allows.
    #[error(
        "channels cannot live under {} with prefix \"{prefix}\": together these have {length} bytes, and the \
         system's limit on socket paths leaves {ROOT_AND_PREFIX_MAX}; choose a shorter root, such as /run/kinds",
        root.display()
    )]
    TooLong {
        /// The root as given.
        root: PathBuf,
        /// The prefix as given.
        prefix: String,
        /// Bytes of both.
        length: usize,
    },
    /// The root has characters that the transport does not take.
    #[error("channels cannot live under {}: use only printable ASCII characters in the root", root.display())]
    RootCharacters {
        /// The root as given.
        root: PathBuf,
    },
    /// The prefix cannot begin a file name.
    #[error(
        "channels cannot have the prefix \"{prefix}\": use one or more printable ASCII characters without '/'"
    )]
    Prefix {
        /// The prefix as given.
        prefix: String,
    },
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::OwnDomain;
    use crate::{FrameReader, Node};

    fn error(root: &str, prefix: &str) -> String {
        let domain = Domain { root: root.into(), prefix: prefix.into() };
        Node::open(&domain, "test").unwrap_err().to_string()
    }

    #[test]
    fn default_is_where_programs_with_the_transports_defaults_are() {
        let domain = Domain::default();
        assert_eq!((domain.root.to_str().unwrap(), domain.prefix.as_str()), ("/tmp/iceoryx2", "iox2_"));
    }

    #[test]
    fn folders_make_domains_that_do_not_depend_on_the_build() {
        let domain = Domain::in_folder(Path::new("/run/kinds"));
        assert_eq!(domain.prefix, "ke9ada18b_");
        assert_ne!(domain.prefix, Domain::in_folder(Path::new("/run/kinds2")).prefix);
    }

    #[test]
    fn longest_root_allowed_takes_sockets() {
        let test = OwnDomain::make().unwrap();
        let n_fill = ROOT_AND_PREFIX_MAX - test.root.as_os_str().len() - test.prefix.len() - 1;
        let domain = Domain { root: test.root.join("x".repeat(n_fill)), prefix: test.prefix.clone() };
        let node = Node::open(&domain, "test").unwrap();
        FrameReader::open(&node, &"ring".parse().unwrap()).unwrap();
    }

    #[test]
    fn a_domain_is_removed_when_nobody_is_in_it_and_not_before() {
        let folder = tempfile::Builder::new().prefix("k").tempdir().unwrap();
        let domain = Domain::in_folder(folder.path());
        let in_shared_memory = || {
            let names = std::fs::read_dir(SHARED_MEMORY).unwrap().map(|entry| entry.unwrap().file_name());
            names.filter(|name| name.to_string_lossy().starts_with(&domain.prefix)).count()
        };
        let node = Node::open(&domain, "test").unwrap();
        let reader = FrameReader::open(&node, &"ring".parse().unwrap()).unwrap();
        let n_files = in_shared_memory();
        assert!(!domain.remove_if_deserted().unwrap());
        assert_eq!((in_shared_memory(), folder.path().exists()), (n_files, true));
        drop((reader, node));
        // What a program leaves that is killed while it joins: a node's folder that no other program sees.
        std::fs::create_dir(folder.path().join("nodes/1")).unwrap();
        std::fs::write(Path::new(SHARED_MEMORY).join(format!("{}half", domain.prefix)), "").unwrap();
        assert!(domain.remove_if_deserted().unwrap());
        assert_eq!((in_shared_memory(), folder.path().exists()), (0, false));
    }

    #[test]
    fn domains_that_cannot_be_are_refused_in_words() {
        let long = format!("/run/{}", "x".repeat(52));
        for (root, prefix, sentence) in [
            (
                "run/kinds",
                "k_",
                "channels cannot live under run/kinds: programs started in other folders would not find them; \
                 give the root as an absolute path"
                    .to_owned(),
            ),
            (
                &long,
                "iox2_",
                format!(
                    "channels cannot live under {long} with prefix \"iox2_\": together these have 62 bytes, and the \
                     system's limit on socket paths leaves 61; choose a shorter root, such as /run/kinds"
                ),
            ),
            (
                "/run/k\tinds",
                "k_",
                "channels cannot live under /run/k\tinds: use only printable ASCII characters in the root".to_owned(),
            ),
            (
                "/run/kinds",
                "a/b",
                "channels cannot have the prefix \"a/b\": use one or more printable ASCII characters without '/'"
                    .to_owned(),
            ),
        ] {
            assert_eq!(error(root, prefix), sentence);
        }
    }
}
