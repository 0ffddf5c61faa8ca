//! Model files on disk: opened by memory map, written whole or not at all.

use std::fs::File;
use std::io;
use std::path::{Path, PathBuf};

use bytes::Bytes;
use kinds_model::{Model, ModelFileError, file};
use memmap2::Mmap;

use crate::whole_file::{self, folder_of, temporary_beside};

/// Why a model file cannot be used.
#[derive(Debug, thiserror::Error)]
pub(crate) enum ModelFailure {
    #[error("no model at {}: there is no such file", path.display())]
    Missing { path: PathBuf },
    #[error("cannot write model {}: there is no folder {}; make it first", path.display(), folder.display())]
    NoFolder { path: PathBuf, folder: PathBuf },
    #[error("cannot {attempt} model {}: {error}", path.display())]
    Io { attempt: &'static str, path: PathBuf, error: io::Error },
    #[error("cannot open model {}: {error}", path.display())]
    Contents { path: PathBuf, error: ModelFileError },
}

/// Opens a model. Its large arrays stay in the file's pages, which all programs that use it share.
pub(crate) fn open(path: &Path) -> Result<Model, ModelFailure> {
    let failed = |error: io::Error| match error.kind() {
        io::ErrorKind::NotFound => ModelFailure::Missing { path: path.to_path_buf() },
        _ => ModelFailure::Io { attempt: "open", path: path.to_path_buf(), error },
    };
    let file = File::open(path).map_err(failed)?;
    if !file.metadata().map_err(failed)?.is_file() {
        return Err(failed(io::Error::new(io::ErrorKind::InvalidInput, "it is not a file")));
    }
    let bytes = map(&file).map_err(failed)?;
    file::from_bytes(&bytes).map_err(|error| ModelFailure::Contents { path: path.to_path_buf(), error })
}

/// Maps a file's pages.
#[allow(unsafe_code, reason = "the one memory map")]
fn map(file: &File) -> io::Result<Bytes> {
    // SAFETY: the pages must not change while they are borrowed. Model files are never written in place: `write` gives a
    // new file the old one's name, and a file that has lost its name keeps its pages. Somebody who overwrites or
    // truncates a model by other means while it is served breaks this, as with any mapped program or library.
    let map = unsafe { Mmap::map(file)? };
    Ok(Bytes::from_owner(map))
}

/// Finds out, before long work, whether a model can be written there.
pub(crate) fn check_writable(path: &Path) -> Result<(), ModelFailure> {
    if path.is_dir() {
        return Err(unwritable(path, io::Error::new(io::ErrorKind::IsADirectory, "it is a folder")));
    }
    let folder = folder_of(path);
    if !folder.is_dir() {
        return Err(ModelFailure::NoFolder { path: path.to_path_buf(), folder: folder.to_path_buf() });
    }
    temporary_beside(path).map(drop).map_err(|error| unwritable(path, error))
}

/// Writes a model, whole or not at all. Returns its length in bytes.
pub(crate) fn write(path: &Path, model: &Model) -> Result<usize, ModelFailure> {
    let bytes = file::to_bytes(model);
    whole_file::write(path, &bytes).map_err(|error| unwritable(path, error))?;
    Ok(bytes.len())
}

fn unwritable(path: &Path, error: io::Error) -> ModelFailure {
    ModelFailure::Io { attempt: "write", path: path.to_path_buf(), error }
}
