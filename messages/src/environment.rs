//! The domain that a program is in, where nothing else tells it.

use std::path::Path;

use crate::Domain;

/// Names the domain's folder.
const VARIABLE: &str = "KINDS_DOMAIN";

impl Domain {
    /// The domain of the folder that `KINDS_DOMAIN` names, and the default one where it names none.
    pub fn of_environment() -> Self {
        match std::env::var_os(VARIABLE).filter(|folder| !folder.is_empty()) {
            Some(folder) => Self::in_folder(Path::new(&folder)),
            None => Self::default(),
        }
    }
}
