//! Too little shared memory, a full disk, and places where one may not write.

#![allow(clippy::print_stderr, reason = "a test that is skipped says so")]

use std::os::unix::fs::PermissionsExt;
use std::os::unix::process::CommandExt;
use std::process::Command;

use crate::robot::{FIRST, MODEL, Robot, SECOND, SENSOR, SIZE};
use crate::running::{Outcome, Running};

/// Runs a program where other file systems are mounted than for everybody else, by a shell's commands. `None`, in words,
/// where that is not allowed.
fn run_among_mounts(robot: &Robot, mounts: &str, arguments: &[&str]) -> Option<Outcome> {
    let probe = Command::new("unshare")
        .args(["--user", "--map-root-user", "--mount", "mount", "-t", "tmpfs", "tmpfs", "/dev/shm"])
        .output();
    if !probe.is_ok_and(|probe| probe.status.success()) {
        eprintln!("skipped: no file system can be mounted here, even for one program");
        return None;
    }
    let script = format!("{mounts}; exec \"$@\"");
    let kinds = env!("CARGO_BIN_EXE_kinds");
    let unshare = ["--user", "--map-root-user", "--mount", "sh", "-ec", &script, "sh", kinds];
    Some(Running::start(&mut robot.command_of("unshare", &[&unshare[..], arguments].concat())).end())
}

#[test]
fn too_little_shared_memory_is_refused_with_the_numbers_before_the_first_frame() {
    let robot = Robot::trained();
    for (arguments, channel, needed_kb) in [
        (["serve", "--model", MODEL, "--sensor", SENSOR], "kinds", 8355),
        (["publish", "--trip", SECOND, "--sensor", SENSOR], "frames", 563),
    ] {
        let small = "mount -t tmpfs -o size=500k tmpfs /dev/shm";
        let Some(outcome) = run_among_mounts(&robot, small, &arguments) else { return };
        assert_eq!((outcome.code, outcome.stdout.as_str()), (Some(1), ""), "{outcome:?}");
        let begins = format!(
            "kinds: channel natural-kinds/crunch/ring/{channel} needs {needed_kb} kB of shared memory and /dev/shm has "
        );
        let rest = outcome.stderr.strip_prefix(&begins).unwrap_or_else(|| panic!("{outcome:?}"));
        let (free_kb, cure) = rest.split_once(" kB free; ").unwrap();
        assert!(free_kb.parse::<u64>().unwrap() <= 512, "{rest}");
        assert_eq!(cure, "delete files there or enlarge it\n");
    }
}

#[test]
fn a_full_disk_is_a_sentence_with_the_path_and_leaves_no_part_of_a_file() {
    let robot = Robot::trained();
    std::fs::create_dir(robot.path("small")).unwrap();
    let small = "mount -t tmpfs -o size=40k tmpfs small";
    let train = [&["train", FIRST, "--output", "small/m.kinds"][..], &SIZE].concat();
    let listed = format!("{small}; trap 'ls -A small' EXIT; \"$@\"; false");
    let Some(outcome) = run_among_mounts(&robot, &listed, &train) else { return };
    assert_eq!(outcome.code, Some(1), "{outcome:?}");
    assert!(
        outcome.stderr.lines().last().unwrap().contains("small/m.kinds: No space left on device"),
        "{outcome:?}"
    );
    assert!(!outcome.stdout.contains("kinds-") && !outcome.stdout.contains("m.kinds"), "{outcome:?}");
    let shim = robot.start(&["publish", "--simulate", "crunch", "--sensor", SENSOR, "--speed", "100"]);
    // Otherwise it would wait for room.
    let record = ["record", "--sensor", SENSOR, "--output", "small/trip.mcap", "--free-mb-min", "0"];
    let outcome = run_among_mounts(&robot, &listed, &record).unwrap();
    assert_eq!((outcome.code, outcome.stdout.as_str()), (Some(1), ""), "{outcome:?}");
    assert!(outcome.stderr.contains("small/trip.mcap: "), "{outcome:?}");
    assert!(outcome.stderr.contains("No space left on device"), "{outcome:?}");
    drop(shim);
}

/// A place where nothing can be made, whoever asks.
const NOWHERE: &str = "/proc/kinds";

#[test]
fn a_domain_where_nothing_can_be_made_is_a_sentence_of_every_program() {
    let robot = Robot::trained();
    for verb in [
        &["serve", "--model", MODEL][..],
        &["publish", "--trip", SECOND],
        &["watch"],
        &["record", "--output", "trip.mcap"],
    ] {
        robot.refuse(
            &[verb, &["--sensor", SENSOR, "--domain", NOWHERE]].concat(),
            1,
            "cannot join the channels under /proc/kinds: files cannot be made there; run all programs of a robot as one \
             user, who may write there, or choose another root",
        );
    }
}

/// A user without rights.
const NOBODY: u32 = 65534;

#[test]
fn another_user_is_told_whose_files_are_in_the_way() {
    if !rustix::process::geteuid().is_root() {
        eprintln!("skipped: only root may run a program as another user");
        return;
    }
    let robot = Robot::trained();
    let service = robot.serve();
    // Its own copy of the program, in a folder that it may enter.
    let folder = tempfile::tempdir().unwrap();
    std::fs::set_permissions(folder.path(), std::fs::Permissions::from_mode(0o755)).unwrap();
    let kinds = folder.path().join("kinds");
    std::fs::copy(env!("CARGO_BIN_EXE_kinds"), &kinds).unwrap();
    let mut command = robot.command_of(kinds.to_str().unwrap(), &["watch", "--sensor", SENSOR]);
    let outcome = Running::start(command.current_dir("/").uid(NOBODY)).end();
    assert_eq!((outcome.code, outcome.stdout.as_str()), (Some(1), ""), "{outcome:?}");
    let root = robot.domain().root.display();
    assert_eq!(
        outcome.stderr,
        format!(
            "kinds: cannot join the channels under {root}: they are those of user root, and this program runs as nobody; run it \
             as root (sudo -u root …; User=root in a systemd unit), or choose another domain\n"
        )
    );
    service.stop(rustix::process::Signal::TERM);
}

#[test]
fn the_superuser_leaves_nothing_in_the_way_of_the_user_whose_domain_it_is() {
    if !rustix::process::geteuid().is_root() {
        eprintln!("skipped: only root may give a folder to another user");
        return;
    }
    let robot = Robot::trained();
    let root = &robot.domain().root;
    std::os::unix::fs::chown(root, Some(NOBODY), Some(NOBODY)).unwrap();
    let cure = "run it as nobody (sudo -u nobody …; User=nobody in a systemd unit), or choose another domain";
    for verb in [&["serve", "--model", MODEL][..], &["publish", "--trip", SECOND], &["watch"], &["reload"]] {
        robot.refuse_with(&[verb, &["--sensor", SENSOR]].concat(), 1, &[cure]);
    }
    assert_eq!(std::fs::read_dir(root).unwrap().count(), 0);
    // A folder for everybody is nobody's own.
    std::fs::set_permissions(root, std::fs::Permissions::from_mode(0o1777)).unwrap();
    robot.serve().stop(rustix::process::Signal::TERM);
}
