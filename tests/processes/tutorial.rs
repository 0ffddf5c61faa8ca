//! `docs/tutorial.md` and `examples/`: every command is run as it stands there, in one shell, and says what the page says it
//! does, but for numbers. The examples do what their first lines say.

#![allow(clippy::print_stderr, reason = "a test that is skipped says so")]

use std::io::Write;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::sync::atomic::{AtomicBool, Ordering};

use kinds_messages::Purpose;
use rustix::process::Signal;

use crate::novelty::send_with_novel;
use crate::robot::{Robot, SENSOR};
use crate::running::{Running, await_that};
use crate::world::read_trip;

#[path = "../../examples/novel_frames.rs"]
#[allow(dead_code, reason = "a program's, whose main is not called here")]
mod novel_frames;

fn checkout(path: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join(path)
}

fn page() -> String {
    std::fs::read_to_string(checkout("docs/tutorial.md")).unwrap()
}

/// What is typed, and what is printed then, line by line.
fn steps(page: &str) -> Vec<(String, Vec<String>)> {
    let mut steps: Vec<(String, Vec<String>)> = Vec::new();
    let mut is_console = false;
    for line in page.lines() {
        match line {
            "```console" => is_console = true,
            _ if line.starts_with("```") => is_console = false,
            _ if !is_console => {}
            _ => match line.strip_prefix("$ ") {
                Some(command) => steps.push((command.to_string(), Vec::new())),
                None => steps.last_mut().expect("nothing is printed before").1.push(line.to_string()),
            },
        }
    }
    steps
}

/// A line without what may differ from one machine to another: numbers, identities, bars and spaces between columns.
fn words(line: &str) -> String {
    let is_part = |c: char| c.is_ascii_alphanumeric();
    let mut words = String::new();
    for piece in line.split_inclusive(|c: char| !is_part(c)) {
        let (word, rest) = match piece.char_indices().last() {
            Some((at, last)) if !is_part(last) => piece.split_at(at),
            _ => (piece, ""),
        };
        let is_number =
            word.contains(|c: char| c.is_ascii_digit()) && word.chars().all(|c| c.is_ascii_hexdigit());
        words += if is_number { "#" } else { word };
        words += rest;
    }
    words.retain(|c| !"·▁▂▃▄▅▆▇█".contains(c));
    let words = words.split_whitespace().collect::<Vec<_>>().join(" ");
    words.replace("#.#", "#").replace("−#", "#").replace("-#", "#")
}

#[test]
fn numbers_are_all_that_a_line_may_differ_in() {
    for (one, other) in [
        ("learnt 5 kinds, residual variance 0.0778", "learnt 12 kinds, residual variance 1.2"),
        (
            "frame      7  kind  1   75 %  ▂▆  novelty 0.00      3.5 µs",
            "frame 2275 kind 10 9 % ▂▆·█ novelty 1.00 14.25 µs",
        ),
        ("wrote m.kinds (model 1f2e3d4c)", "wrote m.kinds (model 99)"),
        ("κ −0.01", "κ 0.51"),
    ] {
        assert_eq!(words(one), words(other));
    }
    assert_ne!(words("learnt 5 kinds"), words("learnt 5 kind"));
    assert_ne!(words("a face"), words("a fade"));
}

/// A shell as the page's reader has one, with the checkout where the page says.
fn shell(robot: &Robot) -> (Running, impl FnMut(&str)) {
    let built = Path::new(env!("CARGO_BIN_EXE_kinds"));
    let theirs = robot.path("natural-kinds");
    std::fs::create_dir_all(theirs.join("target/release")).unwrap();
    for (is, at) in [
        (built.to_path_buf(), "target/release/kinds"),
        (built.with_file_name("deps").join("libnatural_kinds.so"), "target/release/libnatural_kinds.so"),
        ("libnatural_kinds.so".into(), "target/release/libnatural_kinds.so.0.1"),
        (checkout("consumers"), "consumers"),
        (checkout("examples"), "examples"),
    ] {
        std::os::unix::fs::symlink(is, theirs.join(at)).unwrap();
    }
    let (reader, mut writer) = std::io::pipe().unwrap();
    let mut command = robot.command_of("bash", &["--noprofile", "--norc"]);
    command.env("HOME", robot.path("")).env("PYTHONDONTWRITEBYTECODE", "1").stdin(Stdio::from(reader));
    let shell = Running::start(&mut command);
    let mut type_in = move |line: &str| writeln!(writer, "{line}").unwrap();
    // What is in the background ends with the shell, and what it says comes where all else does.
    type_in("exec 2>&1; trap 'kill $(jobs -p)' EXIT");
    (shell, type_in)
}

#[test]
fn the_tutorials_commands_print_what_it_says() {
    for tool in ["bash", "c++"] {
        if Command::new(tool).arg("--version").output().is_err() {
            return eprintln!("skipped: there is no {tool}");
        }
    }
    let robot = Robot::new();
    let (shell, mut type_in) = shell(&robot);
    let steps = steps(&page());
    assert!(steps.len() > 12);
    for (index, (command, printed)) in steps.iter().enumerate() {
        let n_before = shell.n_out();
        type_in(command);
        for line in printed.iter().filter(|line| !line.is_empty() && *line != "…") {
            let expected = words(line);
            let (beginning, is_cut) =
                expected.strip_suffix('…').map_or((expected.as_str(), false), |line| (line, true));
            shell.await_line(n_before, &format!("{command}: {expected}"), |line| {
                let line = words(line);
                if is_cut { line.starts_with(beginning) } else { line == expected }
            });
        }
        type_in(&format!("echo \"step {index} ended with $?\""));
        let ended = shell.await_out(&format!("step {index} ended with "));
        assert!(ended.ends_with(" 0"), "{command}: {ended}");
    }
    type_in("exit");
    let outcome = shell.end();
    assert_eq!(outcome.code, Some(0), "{outcome:?}");
}

#[test]
fn the_tutorial_shows_the_example_as_it_is() {
    let source = std::fs::read_to_string(checkout("examples/slow_down.cpp")).unwrap();
    assert!(page().contains(&format!("```cpp\n{source}```\n")));
}

/// Tells the example that it is enough, also where a test fails: it would be waited for without end.
struct StopAtEnd<'a>(&'a AtomicBool);

impl Drop for StopAtEnd<'_> {
    fn drop(&mut self) {
        self.0.store(true, Ordering::Relaxed);
    }
}

#[test]
fn novel_frames_become_a_trip_to_learn_from() {
    let robot = Robot::trained();
    let service = robot.serve();
    let (domain, trip, stop) = (robot.domain().clone(), robot.path("novel.mcap"), AtomicBool::new(false));
    let (sensor, mut consumer) = (SENSOR.parse().unwrap(), robot.join());
    let novel = std::thread::scope(|scope| {
        let stop_at_end = StopAtEnd(&stop);
        let keeping = scope.spawn(|| novel_frames::keep_novel(&domain, SENSOR, &trip, &stop).unwrap());
        await_that(|| {
            let census = robot.domain().census("test").unwrap();
            // The service and the example.
            census.channel(&sensor, Purpose::Frames).is_some_and(|frames| frames.readers.len() == 2)
        });
        let novel = send_with_novel(&robot, &mut consumer);
        drop(stop_at_end);
        assert_eq!(keeping.join().unwrap(), novel.len());
        novel
    });
    let kept = read_trip(&trip).into_iter().map(|(frame, counts)| (frame.captured, counts));
    assert_eq!(kept.collect::<Vec<_>>(), novel);
    service.stop(Signal::TERM);
}
