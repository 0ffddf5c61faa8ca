//! Which user a domain belongs to. The transport keeps what it makes to its user, and tells others next to nothing.

use std::fs::Metadata;
use std::os::unix::fs::{MetadataExt, PermissionsExt};
use std::path::Path;

use rustix::process::geteuid;

use crate::ChannelError;

/// Refuses to join a domain that another user keeps to itself.
///
/// The superuser could join, and leave files there that stand in that user's way.
pub(crate) fn check_owner_of(root: &Path) -> Result<(), ChannelError> {
    let (Ok(metadata), own) = (std::fs::metadata(root), geteuid().as_raw()) else { return Ok(()) };
    if metadata.uid() == own || is_shared(&metadata) {
        return Ok(());
    }
    let [owner, own] = [metadata.uid(), own].map(user_name);
    Err(ChannelError::OtherUser { root: root.to_owned(), owner, own })
}

/// Whether others may make files there.
fn is_shared(metadata: &Metadata) -> bool {
    metadata.permissions().mode() & 0o022 != 0
}

/// A user's name, or number where the system has no name for it in its file of users.
pub fn user_name(uid: u32) -> String {
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
    use crate::{Node, OwnDomain};

    #[test]
    fn a_domain_that_another_user_keeps_to_itself_is_refused_with_both_and_stays_as_it_is() {
        if !geteuid().is_root() {
            // Only root may give a folder to another user.
            return;
        }
        let test = OwnDomain::make().unwrap();
        std::os::unix::fs::chown(&test.root, Some(65534), None).unwrap();
        let [owner, own] = [65534, 0].map(user_name);
        assert_eq!(
            Node::open(&test, "test").unwrap_err().to_string(),
            format!(
                "cannot join the channels under {}: they are those of user {owner}, and this program runs as {own}; run it as \
                 {owner} (sudo -u {owner} …; User={owner} in a systemd unit), or choose another domain",
                test.root.display()
            )
        );
        assert_eq!(std::fs::read_dir(&test.root).unwrap().count(), 0);
        std::fs::set_permissions(&test.root, PermissionsExt::from_mode(0o777)).unwrap();
        Node::open(&test, "test").unwrap();
    }

    #[test]
    fn users_have_names_where_the_system_lists_them() {
        let users = "root:x:0:0:root:/root:/bin/bash\nkinds:x:997:997::/var/lib/kinds:/usr/sbin/nologin\n";
        assert_eq!(name_among(users, 997), Some("kinds".to_string()));
        assert_eq!(name_among(users, 99), None);
        assert_eq!(name_among("", 0), None);
    }
}
