//! Reports on disk: a folder of a page, its figures and their numbers, written whole or not at all.

use std::io;
use std::path::{Path, PathBuf};

use kinds_trainer::report::{Page, ReportFile};

use crate::failure::Failure;
use crate::whole_file::{Staged, stage, temporary_beside};

/// The file that a person opens.
const PAGE: &str = "report.html";

/// Finds out, before long work, whether a report can be written there.
pub(crate) fn check_writable(folder: &Path) -> Result<(), Failure> {
    // A folder that is not there is made in the nearest one that is.
    let there = folder.ancestors().find(|place| place.exists()).filter(|place| !place.as_os_str().is_empty());
    let place = there.unwrap_or(Path::new("."));
    let failed = |error: io::Error| Failure::file("write report into", folder, &error);
    if !place.is_dir() {
        let what = if place == folder { "it".to_string() } else { place.display().to_string() };
        return Err(failed(io::Error::new(io::ErrorKind::NotADirectory, format!("{what} is not a folder"))));
    }
    temporary_beside(&place.join(PAGE)).map(drop).map_err(failed)
}

/// Writes a report into a folder, which is made if it is not there. Returns the page's path.
///
/// No file takes its place before all are on disk, and the page is the last to do so.
pub(crate) fn write(folder: &Path, page: &Page) -> Result<PathBuf, Failure> {
    std::fs::create_dir_all(folder).map_err(|error| Failure::file("make folder", folder, &error))?;
    let failed = |path: &Path, error: io::Error| Failure::file("write", path, &error);
    let staged = page.files().into_iter().map(|ReportFile { name, contents }| {
        let path = folder.join(name);
        stage(&path, contents.as_bytes()).map_err(|error| failed(&path, error))
    });
    let mut staged = staged.collect::<Result<Vec<Staged>, Failure>>()?;
    staged.sort_by_key(|file| file.path().ends_with(PAGE));
    for file in staged {
        let path = file.path().to_path_buf();
        file.keep().map_err(|error| failed(&path, error))?;
    }
    Ok(folder.join(PAGE))
}
