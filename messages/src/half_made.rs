//! Channels that a killed program left half made, which nobody can open and the transport does not clean up.

use std::fs::Metadata;
use std::os::unix::fs::MetadataExt as _;
use std::path::{Path, PathBuf};
use std::time::{Duration, SystemTime};

use crate::Domain;

/// What a channel's file may be used for while it is being written; whoever has written it takes the right to write away.
const MODE_IN_MAKING: u32 = 0o600;

/// No channel is half made so long, unless its maker is gone: a few times what a slow disk takes to write a small file, and
/// less than [`crate::channel`] has patience.
const MAKING: Duration = Duration::from_millis(100);

/// Removes the channels' files that no living program is making, and returns how many there were.
///
/// iceoryx2 0.10.0 makes a channel's file under its final name, and gives it its final permissions when it is whole. Of a program
/// that is killed in between there stays a file that all others take for a channel in the making, for good.
pub(crate) fn remove(domain: &Domain) -> usize {
    let abandoned = domain.service_files().into_iter().filter(|path| is_abandoned(path));
    abandoned.filter(|path| std::fs::remove_file(path).is_ok()).count()
}

/// Whether the file is half made, has been so for long, and no program has it open.
fn is_abandoned(path: &Path) -> bool {
    let Some(before) = in_making(path) else { return false };
    // A clock that was set back makes the file look newer than it is: then the next attempt looks again.
    let is_old = before
        .modified()
        .is_ok_and(|made| SystemTime::now().duration_since(made).is_ok_and(|age| age >= MAKING));
    // Its maker has it open until it is whole. So if it is the same file, and as little finished, after all programs were
    // looked at, none of them was making it.
    is_old && !is_open(&before) && in_making(path).is_some_and(|after| is_same(&before, &after))
}

fn in_making(path: &Path) -> Option<Metadata> {
    let metadata = std::fs::symlink_metadata(path).ok()?;
    (metadata.is_file() && metadata.mode() & 0o777 == MODE_IN_MAKING).then_some(metadata)
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
    use crate::{FramePublisher, FrameReader, Node, OwnDomain};

    /// Where the files of a sensor's frames lie while they are used.
    fn files_in_use(domain: &Domain) -> Vec<PathBuf> {
        let node = Node::open(domain, "test").unwrap();
        let _reader = FrameReader::open(&node, &"ring".parse().unwrap()).unwrap();
        domain.service_files()
    }

    /// A channel's file as it is while it is being made, begun an hour ago.
    fn begin(path: &Path) -> File {
        let file = File::create(path).unwrap();
        file.set_permissions(Permissions::from_mode(MODE_IN_MAKING)).unwrap();
        file.set_modified(SystemTime::now() - Duration::from_secs(3600)).unwrap();
        file
    }

    #[test]
    fn a_channel_that_a_killed_program_left_half_made_is_made_anew() {
        let domain = OwnDomain::make().unwrap();
        let files = files_in_use(&domain);
        assert_eq!(files.len(), 2, "messages and events");
        for path in &files {
            drop(begin(path));
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
        let maker = begin(held);
        begin(finished).set_permissions(Permissions::from_mode(0o400)).unwrap();
        let others = held.with_extension("other");
        drop(begin(&others));
        let young = held.with_file_name(format!("{}young.service", domain.prefix));
        begin(&young).set_modified(SystemTime::now() + Duration::from_secs(3600)).unwrap();
        assert_eq!(remove(&domain), 0);
        drop(maker);
        assert_eq!(remove(&domain), 1);
        assert_eq!([held, finished, &others, &young].map(|path| path.exists()), [false, true, true, true]);
    }
}
