//! Files that are written whole or not at all.

use std::fs::{File, Permissions};
use std::io::{self, Write};
use std::os::unix::fs::PermissionsExt;
use std::path::{Path, PathBuf};

use tempfile::NamedTempFile;

use crate::failure::Failure;

/// A file that is on disk under a temporary name. Dropped before it is kept, it leaves nothing behind.
pub(crate) struct Staged {
    file: NamedTempFile,
    path: PathBuf,
}

impl Staged {
    /// Where it will be.
    pub(crate) fn path(&self) -> &Path {
        &self.path
    }

    /// Gives it its name, and takes that from another file if one has it.
    pub(crate) fn keep(self) -> io::Result<()> {
        self.file.persist(&self.path).map_err(|error| error.error)?;
        // The new name is in the folder, which is on disk when it has been synchronised too.
        File::open(folder_of(&self.path))?.sync_all()
    }
}

/// Writes under a temporary name, and renames when all is on disk.
pub(crate) fn write(path: &Path, bytes: &[u8]) -> io::Result<()> {
    stage(path, bytes)?.keep()
}

/// Finds out, before long work, whether a file can be written.
pub(crate) fn check_writable(path: &Path) -> Result<(), Failure> {
    stage(path, &[]).map(drop).map_err(|error| Failure::file("write", path, &error))
}

/// Writes under a temporary name.
pub(crate) fn stage(path: &Path, bytes: &[u8]) -> io::Result<Staged> {
    if path.is_dir() {
        return Err(io::Error::new(io::ErrorKind::IsADirectory, "it is a folder"));
    }
    let mut file = temporary_beside(path)?;
    file.write_all(bytes)?;
    file.as_file().sync_all()?;
    Ok(Staged { file, path: path.to_path_buf() })
}

pub(crate) fn temporary_beside(path: &Path) -> io::Result<NamedTempFile> {
    // Readable by whom the umask allows: who reads a file may be another user than who writes it.
    let mut builder = tempfile::Builder::new();
    builder.prefix(".kinds-").permissions(Permissions::from_mode(0o666));
    // The kind alone: the error names the temporary file, which nobody has asked for.
    builder.tempfile_in(folder_of(path)).map_err(|error| error.kind().into())
}

pub(crate) fn folder_of(path: &Path) -> &Path {
    match path.parent() {
        Some(folder) if !folder.as_os_str().is_empty() => folder,
        _ => Path::new("."),
    }
}
