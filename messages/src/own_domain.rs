//! A domain that nobody else knows, for as long as it is needed.

use std::io;
use std::ops::Deref;

use tempfile::TempDir;

use crate::Domain;

/// A domain in a temporary folder, for demonstrations and tests. When this is dropped the folder goes, and with it what the
/// transport leaves in shared memory: drop everything that was opened in it, and end all programs, before.
#[derive(Debug)]
pub struct OwnDomain {
    domain: Domain,
    _folder: TempDir,
}

impl OwnDomain {
    /// Makes a domain.
    ///
    /// # Errors
    /// If there is no temporary folder to make it in.
    pub fn make() -> io::Result<Self> {
        // A short name: sockets' paths have little room.
        let folder = tempfile::Builder::new().prefix("k").tempdir()?;
        Ok(Self { domain: Domain::in_folder(folder.path()), _folder: folder })
    }
}

impl Deref for OwnDomain {
    type Target = Domain;

    fn deref(&self) -> &Domain {
        &self.domain
    }
}

impl Drop for OwnDomain {
    fn drop(&mut self) {
        if let Err(error) = self.domain.remove_remains() {
            tracing::warn!("cannot clean up shared memory after {}: {error}", self.domain.root.display());
        }
    }
}
