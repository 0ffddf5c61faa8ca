//! Which user a domain belongs to. The transport keeps what it makes to its user, and tells others next to nothing.

use std::fs::Metadata;
use std::os::unix::fs::{MetadataExt, PermissionsExt};
use std::path::Path;

use rustix::process::geteuid;

use crate::failure::Failure;

/// Refuses to join a domain that another user keeps to itself.
///
/// The superuser could join, and leave files there that stand in that user's way.
pub(crate) fn check_owner_of(root: &Path) -> Result<(), Failure> {
    let (Ok(metadata), own) = (std::fs::metadata(root), geteuid().as_raw()) else { return Ok(()) };
    if metadata.uid() == own || is_shared(&metadata) {
        return Ok(());
    }
    let [owner, own] = [metadata.uid(), own].map(name);
    Err(Failure::CouldNot(format!(
        "cannot join the channels under {}: they are those of user {owner}, and this program runs as {own}; run it as \
         {owner} (sudo -u {owner} kinds …; User={owner} in a systemd unit), or choose another domain",
        root.display()
    )))
}

/// Whether others may make files there.
fn is_shared(metadata: &Metadata) -> bool {
    metadata.permissions().mode() & 0o022 != 0
}

/// A user's name, or number where the system has no name for it in its file of users.
pub(crate) fn name(uid: u32) -> String {
    let users = std::fs::read_to_string("/etc/passwd").unwrap_or_default();
    name_among(&users, uid).unwrap_or_else(|| uid.to_string())
}

fn name_among(users: &str, uid: u32) -> Option<String> {
    users.lines().find_map(|line| {
        let mut fields = line.split(':');
        let name = fields.next()?;
        (fields.nth(1)?.parse() == Ok(uid)).then(|| name.to_owned())
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn users_have_names_where_the_system_lists_them() {
        let users = "root:x:0:0:root:/root:/bin/bash\nkinds:x:997:997::/var/lib/kinds:/usr/sbin/nologin\n";
        assert_eq!(name_among(users, 997), Some("kinds".to_string()));
        assert_eq!(name_among(users, 99), None);
        assert_eq!(name_among("", 0), None);
    }
}
