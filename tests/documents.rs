//! What people are told to do: the units that systemd is given, the manual, and the documents' claims about the sources.

#![allow(clippy::print_stderr, reason = "a test that is skipped says so")]

use std::collections::BTreeSet;
use std::path::{Path, PathBuf};
use std::process::{Command, Output};

fn root() -> &'static Path {
    Path::new(env!("CARGO_MANIFEST_DIR"))
}

fn read(path: impl AsRef<Path>) -> String {
    let path = root().join(path);
    std::fs::read_to_string(&path).unwrap_or_else(|error| panic!("{}: {error}", path.display()))
}

/// All files under a folder whose names end so.
fn files(folder: &Path, end: &str) -> Vec<PathBuf> {
    let entries = std::fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().path());
    let under = entries.flat_map(|path| if path.is_dir() { files(&path, end) } else { vec![path] });
    under.filter(|path| path.to_string_lossy().ends_with(end)).collect()
}

/// What stands in quotes in a source, with `…` for what is filled in.
fn sentences(source: &str) -> Vec<String> {
    let mut sentences = Vec::new();
    let mut characters = source.chars().peekable();
    while let Some(character) = characters.next() {
        if character == '/' && characters.peek() == Some(&'/') {
            while characters.next_if(|c| *c != '\n').is_some() {}
        }
        if character != '"' {
            continue;
        }
        let (mut sentence, mut depth) = (String::new(), 0);
        while let Some(character) = characters.next() {
            match character {
                '"' => break,
                '\\' => match characters.next() {
                    // A line that goes on.
                    Some('\n') => while characters.next_if(|c| c.is_whitespace()).is_some() {},
                    escaped => sentence.extend(escaped),
                },
                '{' => {
                    depth += 1;
                    sentence.push('…');
                }
                '}' => depth -= 1,
                _ if depth > 0 => {}
                _ => sentence.push(character),
            }
        }
        sentences.push(sentence);
    }
    sentences
}

#[test]
fn headings_of_the_troubleshooting_page_are_what_the_sources_say() {
    let crates =
        ["src", "messages/src", "service/src", "driver-shim/src", "model/src", "trips/src", "bridge/src"];
    let sources = crates.iter().flat_map(|folder| files(&root().join(folder), ".rs"));
    let said: Vec<String> = sources.flat_map(|path| sentences(&read(path))).collect();
    // What is filled in may be of any words, so names and numbers of a heading are as good as `…`.
    let is_said = |heading: &str| {
        let parts: Vec<&str> = heading.split('…').collect();
        said.iter().any(|sentence| {
            let Some(mut rest) = sentence.strip_prefix(parts[0]) else { return false };
            parts[1..].iter().all(|part| {
                let found = rest.find(part).map(|at| &rest[at + part.len()..]);
                rest = found.unwrap_or_default();
                found.is_some()
            })
        })
    };
    let page = read("docs/troubleshooting.md");
    let headings: Vec<&str> = page.lines().filter_map(|line| line.strip_prefix("### ")).collect();
    assert!(headings.len() > 30);
    let unsaid: Vec<&&str> = headings.iter().filter(|heading| !is_said(heading)).collect();
    assert_eq!(unsaid, [&""; 0], "nobody says these");
    assert!(!is_said("frames are late: … in the last second"), "what is not said is found to be so");
}

#[test]
fn readme_begins_on_the_robot_as_the_tested_page_does() {
    let commands = |page: &str, heading: &str| -> Vec<String> {
        let page = read(page);
        let (_, section) = page.split_once(&format!("\n## {heading}\n")).unwrap();
        let (_, block) = section.split_once("```console\n").unwrap();
        block.lines().take_while(|line| *line != "```").map(str::to_string).collect()
    };
    let tested = commands("deploy/README.md", "Try it, without a robot");
    assert_eq!(commands("README.md", "On the robot"), tested);
    assert!(tested.len() > 3 && tested.iter().all(|line| line.starts_with("$ ")));
}

/// The package's units, as they are when the program is where it was built. None where there is no systemd.
fn units(folder: &Path) -> Option<Vec<PathBuf>> {
    if Command::new("systemd-analyze").arg("--version").output().is_err() {
        eprintln!("skipped: there is no systemd-analyze");
        return None;
    }
    let units = files(&root().join("deploy/systemd"), ".service").into_iter().map(|path| {
        let unit = read(&path).replace("/usr/bin/kinds", env!("CARGO_BIN_EXE_kinds"));
        let instance = path.file_name().unwrap().to_string_lossy().replace('@', "@crunch");
        std::fs::write(folder.join(&instance), unit).unwrap();
        folder.join(instance)
    });
    Some(units.collect())
}

fn analyze(arguments: &[&str], units: &[PathBuf]) -> Output {
    Command::new("systemd-analyze").arg("--no-pager").args(arguments).args(units).output().unwrap()
}

#[test]
fn systemd_has_nothing_to_say_against_the_units() {
    let folder = tempfile::tempdir().unwrap();
    let Some(units) = units(folder.path()) else { return };
    assert_eq!(units.len(), 4);
    // As a robot's own driver changes one.
    let drop_in = folder.path().join("kinds-publish@crunch.service.d");
    std::fs::create_dir(&drop_in).unwrap();
    let own = read("deploy/examples/own-driver.conf").replace("/opt/crunch/driver", "/bin/true");
    for with_drop_in in [false, true] {
        if with_drop_in {
            std::fs::write(drop_in.join("own-driver.conf"), &own).unwrap();
        }
        let verified = analyze(&["verify", "--man=no"], &units);
        let said = String::from_utf8_lossy(&verified.stderr);
        // Of the machine's other units there may be something to say.
        let ours: Vec<&str> = said.lines().filter(|line| line.contains("kinds-")).collect();
        assert_eq!(ours, [""; 0]);
        assert!(verified.status.success(), "{said}");
    }
}

#[test]
fn units_may_do_little_else_than_their_task() {
    let folder = tempfile::tempdir().unwrap();
    let Some(units) = units(folder.path()) else { return };
    // Tenths of what 10 is the most of.
    let exposed = analyze(&["security", "--offline=true", "--threshold=25"], &units);
    assert!(exposed.status.success(), "{}", String::from_utf8_lossy(&exposed.stdout));
    let free = folder.path().join("free.service");
    std::fs::write(&free, "[Service]\nExecStart=/bin/true\n").unwrap();
    assert!(!analyze(&["security", "--offline=true", "--threshold=25"], &[free]).status.success());
}

#[test]
fn units_say_what_they_must() {
    for path in files(&root().join("deploy/systemd"), ".service") {
        let unit = read(&path);
        for line in
            ["Type=notify", "Restart=always", "WatchdogSec=10", "User=kinds", "RuntimeDirectory=kinds"]
        {
            assert!(unit.lines().any(|found| found == line), "{} without {line}", path.display());
        }
    }
    let folder = kinds_messages::Domain::in_folder(Path::new("/run/kinds"));
    let removed = format!("/dev/shm/{}*", folder.prefix);
    assert!(read("deploy/debian/postrm").contains(&removed), "the package leaves {removed}");
}

#[test]
fn the_manual_and_completions_have_every_verb() {
    let folder = tempfile::tempdir().unwrap();
    let kinds = || Command::new(env!("CARGO_BIN_EXE_kinds"));
    assert!(kinds().arg("pages").arg(folder.path()).status().unwrap().success());
    let help = String::from_utf8(kinds().arg("--help").output().unwrap().stdout).unwrap();
    let listed = help.lines().skip_while(|line| *line != "Commands:").skip(1);
    let verbs: BTreeSet<String> = listed
        .take_while(|line| !line.is_empty())
        .filter(|line| line.starts_with("  ") && !line.starts_with("    "))
        .map(|line| line.split_whitespace().next().unwrap().to_string())
        .filter(|verb| verb != "help")
        .collect();
    assert!(verbs.contains("serve") && verbs.contains("check"), "{verbs:?}");
    let pages = files(&folder.path().join("man"), ".1");
    let names = pages.iter().map(|page| page.file_stem().unwrap().to_string_lossy().to_string());
    let of_verbs: BTreeSet<String> =
        names.filter_map(|name| name.strip_prefix("kinds-").map(str::to_string)).collect();
    // What a verb has under it has pages of its own.
    let (under, top): (BTreeSet<String>, _) = of_verbs.into_iter().partition(|name| name.contains('-'));
    assert_eq!(top, verbs);
    assert!(under.contains("trips-recover"), "{under:?}");
    let serve = std::fs::read_to_string(folder.path().join("man/kinds-serve.1")).unwrap();
    assert!(serve.contains("Classify every frame of a sensor and publish its kind"));
    assert!(serve.contains("prometheus") || serve.contains("Prometheus"));
    assert!(!std::fs::read_to_string(folder.path().join("man/kinds.1")).unwrap().contains("pages"));
    for name in ["kinds.bash", "_kinds", "kinds.fish"] {
        let completions = std::fs::read_to_string(folder.path().join("completions").join(name)).unwrap();
        for verb in &verbs {
            assert!(completions.contains(verb.as_str()), "{name} without {verb}");
        }
    }
    let bash = folder.path().join("completions/kinds.bash");
    if Command::new("bash").arg("-n").arg(&bash).status().is_ok_and(|status| !status.success()) {
        panic!("bash cannot read {}", bash.display());
    }
}
