//! What a killed program left half made, which the transport does not clean up: files under their final names, with the
//! permissions that they have while they are written.

use std::fs::Metadata;
use std::os::unix::fs::MetadataExt as _;
use std::path::{Path, PathBuf};
use std::time::{Duration, SystemTime};

use crate::Domain;

/// What a channel's file may be used for while it is being written; whoever has written it takes the right to write away.
const CHANNEL_IN_MAKING: u32 = 0o600;
/// The same of shared memory, which its maker grants the right to read in the end.
const MEMORY_IN_MAKING: u32 = 0o200;

/// Nothing is half made so long, unless its maker is gone: a few times what a slow disk takes to write a small file, and less than
/// [`crate::channel`] has patience.
pub(crate) const MAKING: Duration = Duration::from_millis(100);

/// Removes the files that no living program is making. Returns whether others are left, which may become such.
///
/// iceoryx2 0.10.0 makes a channel's file, and shared memory, under its final name, and gives it its final permissions when it is
/// whole. Of a program that is killed in between there stays what all others take for something in the making, for good.
pub(crate) fn remove(domain: &Domain) -> bool {
    let channels = domain.service_files().into_iter().map(|path| (path, CHANNEL_IN_MAKING));
    // Where it cannot be listed, there is none to remove.
    let memory = domain.shared_files().unwrap_or_default().into_iter().map(|path| (path, MEMORY_IN_MAKING));
    let mut are_left = false;
    for (path, mode) in channels.chain(memory) {
        if let Some(begun) = in_making(&path, mode) {
            are_left |= !(is_abandoned(&path, mode, &begun) && std::fs::remove_file(&path).is_ok());
        }
    }
    are_left
}

/// Whether a file that was seen half made has been so for long, and no program has it open.
fn is_abandoned(path: &Path, mode_in_making: u32, begun: &Metadata) -> bool {
    // A clock that was set back makes the file look newer than it is: then the next attempt looks again.
    let is_old = begun
        .modified()
        .is_ok_and(|made| SystemTime::now().duration_since(made).is_ok_and(|age| age >= MAKING));
    // Its maker has it open until it is whole. So if it is the same file, and as little finished, after all programs were
    // looked at, none of them was making it.
    is_old && !is_open(begun) && in_making(path, mode_in_making).is_some_and(|after| is_same(begun, &after))
}

fn in_making(path: &Path, mode_in_making: u32) -> Option<Metadata> {
    let metadata = std::fs::symlink_metadata(path).ok()?;
    (metadata.is_file() && metadata.mode() & 0o777 == mode_in_making).then_some(metadata)
}

fn is_same(one: &Metadata, other: &Metadata) -> bool {
    (one.dev(), one.ino()) == (other.dev(), other.ino())
}

/// Whether a program that may be looked at has the file open: those of the same user, as all of a domain are.
fn is_open(file: &Metadata) -> bool {
    let entries = |folder: PathBuf| std::fs::read_dir(folder).into_iter().flatten().flatten();
    let programs = entries(PathBuf::from("/proc"));
    let mut open = programs.flat_map(|program| entries(program.path().join("fd")));
    open.any(|link| std::fs::metadata(link.path()).is_ok_and(|open| is_same(file, &open)))
}

#[cfg(test)]
mod tests {
    use std::fs::{File, Permissions};
    use std::os::unix::fs::PermissionsExt as _;

    use super::*;
    use crate::memory::SHARED_MEMORY;
    use crate::{FramePublisher, FrameReader, Node, OwnDomain};

    /// Where the files of a sensor's frames lie while they are used.
    fn files_in_use(domain: &Domain) -> Vec<PathBuf> {
        let node = Node::open(domain, "test").unwrap();
        let _reader = FrameReader::open(&node, &"ring".parse().unwrap()).unwrap();
        domain.service_files()
    }

    /// A file that was begun an hour ago, and got as far as these permissions.
    fn begin(path: &Path, mode: u32) -> File {
        let file = File::create(path).unwrap();
        file.set_permissions(Permissions::from_mode(mode)).unwrap();
        file.set_modified(SystemTime::now() - Duration::from_secs(3600)).unwrap();
        file
    }

    #[test]
    fn a_channel_that_a_killed_program_left_half_made_is_made_anew() {
        let domain = OwnDomain::make().unwrap();
        let files = files_in_use(&domain);
        assert_eq!(files.len(), 2, "messages and events");
        for path in &files {
            drop(begin(path, CHANNEL_IN_MAKING));
        }
        let node = Node::open(&domain, "test").unwrap();
        let reader = FrameReader::open(&node, &"ring".parse().unwrap()).unwrap();
        let publisher = FramePublisher::create(&node, &"ring".parse().unwrap(), 4).unwrap();
        publisher.loan().unwrap().send(&crate::testing::header(3)).unwrap();
        assert_eq!(reader.receive().unwrap().unwrap().header().sequence, 3);
        assert_eq!(domain.service_files().len(), 2);
    }

    #[test]
    fn only_what_nobody_is_making_is_removed() {
        let domain = OwnDomain::make().unwrap();
        let files = files_in_use(&domain);
        let (held, finished) = (&files[0], &files[1]);
        let maker = begin(held, CHANNEL_IN_MAKING);
        begin(finished, 0o400);
        let others = held.with_extension("other");
        begin(&others, CHANNEL_IN_MAKING);
        let young = held.with_file_name(format!("{}young.service", domain.prefix));
        let hour = Duration::from_secs(3600);
        begin(&young, CHANNEL_IN_MAKING).set_modified(SystemTime::now() + hour).unwrap();
        let memory = |name: &str| Path::new(SHARED_MEMORY).join(format!("{}{name}", domain.prefix));
        let (without_size, shared) = (memory("a.connection"), memory("b.data"));
        begin(&without_size, MEMORY_IN_MAKING);
        begin(&shared, 0o600);
        let files = [&without_size, held, &young, finished, &others, &shared];
        assert!(remove(&domain));
        assert_eq!(files.map(|path| path.exists()), [false, true, true, true, true, true]);
        drop(maker);
        assert!(remove(&domain));
        assert_eq!(files.map(|path| path.exists()), [false, false, true, true, true, true]);
        std::fs::remove_file(&young).unwrap();
        assert!(!remove(&domain));
        assert_eq!(files.map(|path| path.exists()), [false, false, false, true, true, true]);
    }
}
