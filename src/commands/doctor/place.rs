//! The domain's place in the file system: is it there, whose is it, and may this user use it?

use std::fs::Metadata;
use std::io::ErrorKind;
use std::os::unix::fs::MetadataExt;
use std::path::Path;

use kinds_messages::{Domain, SHARED_MEMORY, user_name};
use rustix::fs::{Access, access};

use super::finding::{Finding, well, wrong};

const AS_ONE_USER: &str =
    "run all programs of a robot, this one too, as one user, or give each user another --domain";

pub(super) fn examine(domain: &Domain) -> Vec<Finding> {
    let own = rustix::process::geteuid().as_raw();
    let shared: Vec<u32> = owners_of_shared_memory(&domain.prefix);
    vec![on_root(&domain.root, own), on_files(own, &shared)]
}

fn on_root(root: &Path, own: u32) -> Finding {
    let folder = root.display();
    let metadata = match std::fs::metadata(root) {
        Ok(metadata) => metadata,
        Err(error) if error.kind() == ErrorKind::NotFound => {
            return wrong(
                "domain",
                format!(
                    "there is no folder {folder}: no program has been in this domain since the machine started"
                ),
                "start the programs, all with the same --domain or KINDS_DOMAIN as this one",
            );
        }
        Err(error) => {
            return wrong("domain", format!("{folder} cannot be looked at: {error}"), AS_ONE_USER);
        }
    };
    if !metadata.is_dir() {
        return wrong("domain", format!("{folder} is not a folder"), "choose another --domain, or remove it");
    }
    on_folder(root, &metadata, own)
}

fn on_folder(root: &Path, metadata: &Metadata, own: u32) -> Finding {
    let (folder, owner, mode) = (root.display(), user_name(metadata.uid()), metadata.mode() & 0o7777);
    if metadata.uid() != own {
        let what = format!(
            "{folder} belongs to user {owner} (mode {mode:o}), and this program runs as user {}",
            user_name(own)
        );
        return wrong("domain", what, AS_ONE_USER);
    }
    match access(root, Access::READ_OK | Access::WRITE_OK | Access::EXEC_OK) {
        Ok(()) => {
            well("domain", format!("{folder} belongs to user {owner} (mode {mode:o}), as this program"))
        }
        Err(error) => wrong(
            "domain",
            format!("user {owner} may not write in {folder} (mode {mode:o}): {error}"),
            format!("chmod u+rwx {folder}"),
        ),
    }
}

fn on_files(own: u32, owners: &[u32]) -> Finding {
    let others: Vec<String> =
        owners.iter().filter(|owner| **owner != own).map(|owner| user_name(*owner)).collect();
    match others.is_empty() {
        true => well("files", format!("no other user has files of this domain in {SHARED_MEMORY}")),
        false => wrong(
            "files",
            format!(
                "in {SHARED_MEMORY} there are files of this domain that belong to user {}, and this program runs as user {}",
                others.join(", "),
                user_name(own)
            ),
            AS_ONE_USER,
        ),
    }
}

/// Who has files of a domain in shared memory, each user once.
fn owners_of_shared_memory(prefix: &str) -> Vec<u32> {
    let files = std::fs::read_dir(SHARED_MEMORY).into_iter().flatten().flatten();
    let ours = files.filter(|file| file.file_name().to_string_lossy().starts_with(prefix));
    let mut owners: Vec<u32> =
        ours.filter_map(|file| file.metadata().ok()).map(|metadata| metadata.uid()).collect();
    owners.sort_unstable();
    owners.dedup();
    owners
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_folder_of_another_user_is_wrong_with_both_users() {
        let folder = tempfile::tempdir().unwrap();
        let own = rustix::process::geteuid().as_raw();
        let mode = folder.path().metadata().unwrap().mode() & 0o7777;
        assert!(on_root(folder.path(), own).well);
        let finding = on_root(folder.path(), own + 77_777);
        assert_eq!(
            finding.what,
            format!(
                "{} belongs to user {} (mode {mode:o}), and this program runs as user {}",
                folder.path().display(),
                user_name(own),
                own + 77_777
            )
        );
        assert_eq!(finding.cure.as_deref(), Some(AS_ONE_USER));
    }

    #[test]
    fn files_of_another_user_in_shared_memory_are_wrong() {
        assert!(on_files(7, &[]).well && on_files(7, &[7]).well);
        assert_eq!(
            on_files(77_777, &[77_777, 88_888]).what,
            "in /dev/shm there are files of this domain that belong to user 88888, and this program runs as user 77777"
        );
    }
}
