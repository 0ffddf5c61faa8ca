//! The project's absences, checked: who may know whom, and who may speak.
//!
//! Reads the manifests, the lock file and the sources; starts no process and knows no shared memory.

use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};

/// The arrows between the crates of this workspace, without tests' own. Nothing else.
const ARROWS: [(&str, &[&str]); 9] = [
    ("kinds-messages", &[]),
    ("kinds-c", &["kinds-messages"]),
    ("kinds-bridge", &["kinds-messages"]),
    ("kinds-trips", &[]),
    ("kinds-model", &[]),
    ("kinds-driver-shim", &["kinds-messages", "kinds-trips"]),
    ("kinds-service", &["kinds-messages", "kinds-model"]),
    ("kinds-trainer", &["kinds-model", "kinds-trips"]),
    (
        "natural-kinds",
        &[
            "kinds-bridge",
            "kinds-driver-shim",
            "kinds-messages",
            "kinds-model",
            "kinds-service",
            "kinds-trainer",
            "kinds-trips",
        ],
    ),
];

fn root() -> &'static Path {
    Path::new(env!("CARGO_MANIFEST_DIR"))
}

fn read(path: impl AsRef<Path>) -> String {
    let path = root().join(path);
    std::fs::read_to_string(&path).unwrap_or_else(|error| panic!("{}: {error}", path.display()))
}

/// The lines of a table of a manifest: those after `[name]`, up to the next table.
fn table<'a>(manifest: &'a str, name: &str) -> Vec<&'a str> {
    let heading = format!("[{name}]");
    let after = manifest.lines().skip_while(|line| *line != heading).skip(1);
    after.take_while(|line| !line.starts_with('[')).collect()
}

/// What a line of a manifest gives a value to, if it does.
fn key(line: &str) -> Option<&str> {
    let (key, _) = line.split_once('=').filter(|_| !line.starts_with('#'))?;
    Some(key.split('.').next().unwrap_or(key).trim())
}

/// The folders of the crates, and the workspace's own.
fn members() -> Vec<PathBuf> {
    let manifest = read("Cargo.toml");
    let members =
        table(&manifest, "workspace").into_iter().find(|line| key(line) == Some("members")).unwrap();
    let quoted = members.split('"').skip(1).step_by(2).map(PathBuf::from);
    quoted.chain([PathBuf::new()]).collect()
}

/// The name of the crate in a folder, and its manifest.
fn manifest(member: &Path) -> (String, String) {
    let manifest = read(member.join("Cargo.toml"));
    let line = table(&manifest, "package").into_iter().find(|line| key(line) == Some("name")).unwrap();
    (line.split('"').nth(1).unwrap().to_string(), manifest)
}

fn manifests() -> BTreeMap<String, String> {
    members().iter().map(|member| manifest(member)).collect()
}

/// What every package in the lock file depends on directly, tests included.
fn locked() -> BTreeMap<String, BTreeSet<String>> {
    let lock = read("Cargo.lock");
    let package = |text: &str| {
        let name = text.lines().find_map(|line| line.strip_prefix("name = ")).unwrap().trim_matches('"');
        let dependencies = text.lines().filter_map(|line| line.strip_prefix(" \""));
        // Where there are several versions, or sources, these follow the name.
        let names = dependencies.map(|line| line.split([' ', '"']).next().unwrap().to_string());
        (name.to_string(), names.collect::<Vec<_>>())
    };
    let mut graph: BTreeMap<String, BTreeSet<String>> = BTreeMap::new();
    for (name, dependencies) in lock.split("[[package]]").skip(1).map(package) {
        graph.entry(name).or_default().extend(dependencies);
    }
    graph
}

/// All that a package comes to depend on, by any way.
fn reach(graph: &BTreeMap<String, BTreeSet<String>>, from: &str) -> BTreeSet<String> {
    let mut reached = BTreeSet::new();
    let mut next = vec![from.to_string()];
    while let Some(name) = next.pop() {
        let dependencies = graph.get(&name).unwrap_or_else(|| panic!("the lock file has no package {name}"));
        next.extend(dependencies.iter().filter(|name| reached.insert((*name).clone())).cloned());
    }
    reached
}

#[test]
fn crates_know_each_other_along_the_arrows_and_nowhere_else() {
    let manifests = manifests();
    let known: Vec<&str> = manifests.keys().map(String::as_str).collect();
    let mut named = ARROWS.map(|(name, _)| name);
    named.sort_unstable();
    assert_eq!(known, named, "every crate has its arrows, and every crate with arrows is there");
    for (name, expected) in ARROWS {
        let ours = |line: &&str| line.starts_with("kinds-");
        let lines = table(&manifests[name], "dependencies");
        let mut found: Vec<&str> = lines.iter().filter_map(|line| key(line)).filter(ours).collect();
        found.sort_unstable();
        assert_eq!(found, expected, "{name}");
    }
}

#[test]
fn some_crates_never_come_to_know_others_by_any_way() {
    let graph = locked();
    assert!(reach(&graph, "natural-kinds").contains("iceoryx2"), "the graph is read as it should be");
    for (name, absent) in [
        ("kinds-model", &["iceoryx2", "kinds-messages", "kinds-trips", "mcap"][..]),
        ("kinds-trips", &["iceoryx2", "kinds-messages", "kinds-model", "faer"]),
        ("kinds-messages", &["faer", "nalgebra", "kinds-model", "kinds-trips", "mcap", "zenoh"]),
        ("kinds-driver-shim", &["kinds-model", "faer", "zenoh"]),
        ("kinds-service", &["kinds-trips", "mcap", "zenoh"]),
        ("kinds-trainer", &["kinds-messages", "iceoryx2", "zenoh"]),
        ("kinds-bridge", &["kinds-model", "kinds-trips", "faer", "mcap"]),
        ("kinds-c", &["kinds-model", "kinds-trips", "faer", "mcap", "zenoh"]),
    ] {
        let reached = reach(&graph, name);
        for absent in absent {
            assert!(graph.contains_key(*absent), "there is no {absent} whose absence could be checked");
            assert!(!reached.contains(*absent), "{name} has come to know {absent}");
        }
    }
    let knows_transport = |(_, manifest): &(&String, &String)| {
        table(manifest, "dependencies")
            .iter()
            .any(|line| key(line).is_some_and(|key| key.starts_with("iceoryx2")))
    };
    let manifests = manifests();
    let who: Vec<&String> = manifests.iter().filter(knows_transport).map(|(name, _)| name).collect();
    assert_eq!(who, ["kinds-messages"]);
}

#[test]
fn every_version_stands_once_with_its_reason_and_is_used() {
    let root_manifest = read("Cargo.toml");
    let mut used = BTreeSet::new();
    for (name, manifest) in manifests() {
        for kind in ["dependencies", "dev-dependencies", "build-dependencies"] {
            for line in table(&manifest, kind).into_iter().filter(|line| key(line).is_some()) {
                assert!(line.replace(' ', "").contains("workspace=true"), "{name}: {line}");
                used.insert(key(line).unwrap().to_string());
            }
        }
    }
    let mut n_since_reason = usize::MAX;
    for line in table(&root_manifest, "workspace.dependencies") {
        let Some(name) = key(line) else {
            n_since_reason = if line.starts_with('#') { 0 } else { usize::MAX };
            continue;
        };
        assert!(used.contains(name), "nobody uses {name}");
        if line.contains("path =") {
            continue;
        }
        // A reason may be that of a few which belong together.
        assert!(n_since_reason < 3, "no reason beside {name}");
        n_since_reason += 1;
    }
}

/// Sources of a crate, without its tests: path, and lines with their numbers.
fn sources(member: &Path) -> Vec<(PathBuf, Vec<(usize, String)>)> {
    let mut sources = Vec::new();
    let mut folders = vec![root().join(member).join("src")];
    while let Some(folder) = folders.pop() {
        for entry in std::fs::read_dir(&folder).unwrap() {
            let path = entry.unwrap().path();
            if path.is_dir() {
                folders.push(path);
            } else if !["tests.rs", "testing.rs"].iter().any(|name| path.ends_with(name))
                && path.extension().is_some_and(|extension| extension == "rs")
            {
                sources.push((path.clone(), code(&std::fs::read_to_string(path).unwrap())));
            }
        }
    }
    sources
}

/// Lines of a source before its tests and without comments.
fn code(source: &str) -> Vec<(usize, String)> {
    let lines = source.lines().zip(1..);
    // Tests are the last module of a file. A `#[cfg(test)]` before a single line is passed over with what it is about.
    let before_tests = lines.take_while(|(line, _)| !line.starts_with("mod tests {"));
    let code = before_tests.filter(|(line, _)| !line.trim_start().starts_with("//"));
    code.map(|(line, number)| (number, line.to_string())).collect()
}

/// Places where a crate's code has one of these words.
fn occurrences(member: &Path, words: &[&str]) -> Vec<String> {
    let mut found = Vec::new();
    for (path, lines) in sources(member) {
        let path = path.strip_prefix(root()).unwrap().display().to_string();
        let with_word = lines.iter().filter(|(_, line)| words.iter().any(|word| line.contains(word)));
        found.extend(with_word.map(|(number, line)| format!("{path}:{number}: {}", line.trim())));
    }
    found
}

#[test]
fn no_library_prints_reads_arguments_or_exits() {
    let words = [
        "println!",
        "print!(",
        "eprintln!",
        "eprint!(",
        "dbg!",
        "stdout()",
        "stderr()",
        "env::args",
        "process::exit",
        "process::abort",
    ];
    for member in members().iter().filter(|member| **member != Path::new("")) {
        assert_eq!(occurrences(member, &words), [""; 0]);
    }
    assert_ne!(occurrences(Path::new(""), &words), [""; 0], "the program does, and it is seen");
}

#[test]
fn the_mathematics_know_no_clock_file_log_or_thread() {
    let words = [
        "SystemTime",
        "Instant",
        "std::fs",
        "File::",
        "tracing",
        "log::",
        "thread::",
        "std::net",
        "std::env",
    ];
    assert_eq!(occurrences(Path::new("model"), &words), [""; 0]);
}

#[test]
fn the_memory_map_instructions_the_scheduler_cameras_and_what_c_calls_are_the_only_unsafe_code() {
    let words = ["unsafe {", "unsafe fn", "unsafe impl", "unsafe extern", "unsafe(", "allow(unsafe_code"];
    let places: Vec<String> = members()
        .iter()
        // Made to be called with pointers.
        .filter(|member| **member != Path::new("consumers/c"))
        .flat_map(|member| occurrences(member, &words))
        .map(|place| place.split(':').next().unwrap().to_string())
        .collect();
    let places = BTreeSet::from_iter(places.iter().map(String::as_str));
    assert_eq!(
        places,
        BTreeSet::from([
            "driver-shim/src/v4l2/kernel.rs",
            "model/src/simd.rs",
            "src/model_file.rs",
            "src/realtime/scheduler.rs"
        ])
    );
    // The others do not even ask for an exception from what the workspace denies.
    let excepted = ["", "model", "consumers/c", "driver-shim"];
    for member in members().iter().filter(|member| !excepted.contains(&member.to_str().unwrap())) {
        let library = read(member.join("src/lib.rs"));
        assert!(library.contains("\n#![forbid(unsafe_code)]\n"), "{}", member.display());
    }
}
