//! Consumers and drivers in other languages: what the examples that README shows do beside a running service.
//!
//! Compilers and Python are found on the path. A test that lacks what it needs says that it was skipped.

#![allow(clippy::print_stderr, reason = "a test that is skipped says so")]

use std::io::Write;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};

use kinds_messages::{FrameHeader, FramePublisher, KindReport, Pose, Purpose};
use rustix::process::Signal;

use crate::robot::{MODEL, Robot, SECOND, SENSOR};
use crate::running::{Running, await_that};
use crate::world::{open_model, read_trip};

fn checkout(path: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join(path)
}

/// Where cargo has built the library for this test.
fn library_folder() -> PathBuf {
    Path::new(env!("CARGO_BIN_EXE_kinds")).with_file_name("deps")
}

/// A program of a robot, with all that it needs to find the library.
fn program(robot: &Robot, program: &Path, arguments: &[&str]) -> Command {
    let mut command = robot.command_of(program.to_str().unwrap(), arguments);
    command
        .env("LD_LIBRARY_PATH", library_folder())
        .env("NATURAL_KINDS_LIBRARY", library_folder().join("libnatural_kinds.so"))
        .env("PYTHONPATH", checkout("consumers/python/src"))
        .env("PYTHONDONTWRITEBYTECODE", "1");
    command
}

#[derive(Clone, Copy)]
enum Linked {
    Dynamically,
    Statically,
}

/// Compiles a program against the library, every warning an error. None, in words, where there is no compiler.
fn compiled(robot: &Robot, source: &str, linked: Linked) -> Option<PathBuf> {
    let (compiler, standard) = match source.ends_with(".cpp") {
        true => ("c++", "c++17"),
        false => ("cc", "gnu11"),
    };
    if Command::new(compiler).arg("--version").output().is_err() {
        eprintln!("skipped: there is no {compiler}");
        return None;
    }
    let output = robot.path(Path::new(source).file_name().unwrap().to_str().unwrap()).with_extension("out");
    let mut command = Command::new(compiler);
    command
        .args([&format!("-std={standard}"), "-Wall", "-Wextra", "-Wpedantic", "-Werror", "-O2", "-o"])
        .arg(&output)
        .arg("-I")
        .arg(checkout("consumers/c/include"))
        .arg("-I")
        .arg(checkout("consumers/cpp/include"))
        .arg(checkout(source));
    match linked {
        Linked::Dynamically => command.arg("-L").arg(library_folder()).arg("-lnatural_kinds"),
        Linked::Statically => {
            command.arg(library_folder().join("libnatural_kinds.a")).args(["-lpthread", "-ldl", "-lm"])
        }
    };
    let compiled = command.output().unwrap();
    assert!(compiled.status.success(), "{source}: {}", String::from_utf8_lossy(&compiled.stderr));
    Some(output)
}

/// Whether there is a Python that has these packages; says so if not.
fn has_python(packages: &str) -> bool {
    let probe = Command::new("python3").args(["-c", &format!("import {packages}")]).output();
    let has = probe.is_ok_and(|probe| probe.status.success());
    if !has {
        eprintln!("skipped: there is no python3 that has {packages}");
    }
    has
}

/// A Python program. None, in words, where Python lacks what it needs.
fn python(robot: &Robot, source: &str, arguments: &[&str], packages: &str) -> Option<Command> {
    let source = checkout(source);
    // Python takes Ctrl-C only if its parent did not ignore it, as shells do for what they run in the background.
    let arguments = [&["--default-signal=INT", "python3", source.to_str().unwrap()], arguments].concat();
    has_python(packages).then(|| program(robot, Path::new("env"), &arguments))
}

/// Waits until a program reads a channel.
pub(crate) fn await_reader(robot: &Robot, reader: &Running, purpose: Purpose) {
    await_that(|| {
        let census = robot.domain().census("test").unwrap();
        let channel = census.channel(&SENSOR.parse().unwrap(), purpose);
        channel.is_some_and(|channel| channel.readers.iter().any(|program| program.pid == Some(reader.pid())))
    });
}

/// The lines that every example prints of these reports.
fn lines(reports: &[KindReport]) -> String {
    let line = |report: &KindReport| {
        let probability = report.probabilities()[report.kind as usize];
        format!("frame {}: kind {}, probability {probability:.6}\n", report.sequence, report.kind)
    };
    reports.iter().map(line).collect()
}

/// A consumer prints what a consumer in Rust gets, though it is stopped and continued while it waits.
fn check_consumer(start: impl FnOnce(&Robot) -> Option<Command>) {
    check_printed(start, lines);
}

/// * `expected` — what it prints of these reports
fn check_printed(
    start: impl FnOnce(&Robot) -> Option<Command>,
    expected: impl FnOnce(&[KindReport]) -> String,
) {
    let robot = Robot::trained();
    let service = robot.serve();
    let Some(mut command) = start(&robot) else { return };
    let consumer = robot.join();
    let watch = Running::start(&mut command);
    await_reader(&robot, &watch, Purpose::Kinds);
    watch.freeze();
    watch.signal(Signal::CONT);
    let reports = consumer.await_end_of(&mut robot.publish(SECOND, "max"));
    assert_eq!(reports.len(), 130);
    let outcome = watch.end();
    assert_eq!((outcome.code, outcome.stderr.as_str()), (Some(0), ""));
    assert_eq!(outcome.stdout, expected(&reports));
    service.stop(Signal::TERM);
}

/// What a program prints of these reports that takes the kinds most alike together until two are left.
fn levels(reports: &[KindReport]) -> String {
    let line = |report: &KindReport| {
        let level = report.at_level(2);
        let shares = level.probabilities().iter().chain(level.filtered()).map(|share| format!(" {share:.6}"));
        let groups = level.groups().iter().map(|group| format!(" {group}"));
        let numbers = report.numbers().iter().map(|number| format!(" {number}"));
        format!("frame {}:{}\n", report.sequence, shares.chain(groups).chain(numbers).collect::<String>())
    };
    reports.iter().map(line).collect()
}

fn check_compiled_consumer(source: &str, linked: Linked) {
    check_consumer(|robot| Some(program(robot, &compiled(robot, source, linked)?, &[SENSOR, "130"])));
}

#[test]
fn a_consumer_in_c_prints_what_one_in_rust_gets() {
    check_compiled_consumer("consumers/c/examples/watch.c", Linked::Dynamically);
}

#[test]
fn a_consumer_in_c_with_the_library_inside_prints_the_same() {
    check_compiled_consumer("consumers/c/examples/watch.c", Linked::Statically);
}

#[test]
fn a_consumer_in_cpp_prints_what_one_in_rust_gets() {
    check_compiled_consumer("consumers/cpp/examples/watch.cpp", Linked::Dynamically);
}

#[test]
fn fewer_kinds_in_cpp_are_those_in_rust() {
    let start = |robot: &Robot| {
        let program_path = compiled(robot, "consumers/cpp/tests/levels.cpp", Linked::Dynamically)?;
        Some(program(robot, &program_path, &[SENSOR, "130"]))
    };
    check_printed(start, levels);
}

#[test]
fn fewer_kinds_in_python_are_those_in_rust() {
    let start = |robot: &Robot| python(robot, "consumers/python/tests/levels.py", &[SENSOR, "130"], "numpy");
    check_printed(start, levels);
}

#[test]
fn a_consumer_in_python_prints_what_one_in_rust_gets() {
    check_consumer(|robot| python(robot, "consumers/python/examples/watch.py", &[SENSOR, "130"], "numpy"));
}

#[test]
fn a_consumer_with_the_transports_own_python_package_prints_the_same() {
    check_consumer(|robot| {
        let domain = robot.domain();
        let arguments = [domain.root.to_str().unwrap(), &domain.prefix, SENSOR, "130"];
        python(robot, "consumers/python/tests/iceoryx2_package.py", &arguments, "numpy, iceoryx2")
    });
}

#[test]
fn time_in_each_kind_is_that_of_the_reports() {
    let robot = Robot::trained();
    let service = robot.serve();
    let script = "examples/time_in_kinds.py";
    let Some(mut command) = python(&robot, script, &[SENSOR, "130"], "numpy") else { return };
    let consumer = robot.join();
    let counting = Running::start(&mut command);
    await_reader(&robot, &counting, Purpose::Kinds);
    let reports = consumer.await_end_of(&mut robot.publish(SECOND, "max"));
    let n_kinds = reports[0].filtered().len();
    let (mut seconds, mut visits) = (vec![0.0; n_kinds], vec![0; n_kinds]);
    let mut changes = vec![vec![0; n_kinds]; n_kinds];
    let kind = |report: &KindReport| report.filtered_kind as usize;
    visits[kind(&reports[0])] += 1;
    for pair in reports.windows(2) {
        let [from, to] = [kind(&pair[0]), kind(&pair[1])];
        seconds[from] += (pair[1].captured_ns - pair[0].captured_ns) as f64 * 1e-9;
        visits[to] += usize::from(from != to);
        changes[from][to] += usize::from(from != to);
    }
    let outcome = counting.end();
    assert_eq!((outcome.code, outcome.stderr.as_str()), (Some(0), ""));
    let rows: Vec<Vec<f64>> = outcome
        .stdout
        .lines()
        .skip(1)
        .map(|row| row.split_whitespace().map(|number| number.parse().unwrap()).collect())
        .collect();
    assert_eq!(rows.len(), n_kinds);
    for (kind, row) in rows.iter().enumerate() {
        assert!((row[1] - seconds[kind]).abs() < 0.051, "{row:?}: {} s", seconds[kind]);
        let expected: Vec<f64> = [visits[kind]].iter().chain(&changes[kind]).map(|n| *n as f64).collect();
        assert_eq!((row[0], &row[2..]), (kind as f64, &expected[..]));
    }
    service.stop(Signal::TERM);
}

/// What drivers are told on the command line: the sensor, rows, columns, metres per count.
const DRIVEN: [&str; 4] = [SENSOR, "1", "16", "0.001"];

/// A driver's frames, from its standard input, are classified as those of our own shim.
fn check_driver(start: impl FnOnce(&Robot) -> Option<Command>) {
    let robot = Robot::trained();
    let service = robot.serve();
    let Some(mut command) = start(&robot) else { return };
    let ours = robot.join().await_end_of(&mut robot.publish(SECOND, "max"));

    let frames = robot.join_frames();
    let mut consumer = robot.join();
    let (reader, mut writer) = std::io::pipe().unwrap();
    let driver = Running::start(command.stdin(Stdio::from(reader)));
    drop(command);
    for (sequence, (_, counts)) in (0..).zip(read_trip(&robot.path(SECOND))) {
        writer.write_all(bytemuck::cast_slice(&counts)).unwrap();
        // The last report of our own shim's run came first.
        await_that(|| {
            consumer.take_one().is_some_and(|report| report.run != ours[0].run && check(&report, &ours))
        });
        let frame = frames.receive().unwrap().expect("a frame that is reported has come");
        let FrameHeader { rows, columns, metres_per_count, .. } = *frame.header();
        assert_eq!((rows, columns, metres_per_count, frame.counts()), (1, 16, 0.001, &counts[..]));
        assert_eq!(frame.header().sequence, sequence);
        let command = frame.header().known_command().unwrap();
        assert_eq!((command.forward_m_s, command.turn_rad_s), (0.2, 0.0));
    }
    drop(writer);
    let outcome = driver.end();
    assert_eq!((outcome.code, outcome.stderr.as_str()), (Some(0), ""));
    service.stop(Signal::TERM);
}

/// Whether a report says what the one on our own shim's frame of the same number says.
fn check(report: &KindReport, ours: &[KindReport]) -> bool {
    let expected = &ours[report.sequence as usize];
    assert_eq!((report.kind, report.probabilities()), (expected.kind, expected.probabilities()));
    assert_eq!(report.coordinates(), expected.coordinates());
    true
}

fn check_compiled_driver(source: &str) {
    check_driver(|robot| Some(program(robot, &compiled(robot, source, Linked::Dynamically)?, &DRIVEN)));
}

#[test]
fn frames_of_a_driver_in_c_are_classified_as_our_own_shims() {
    check_compiled_driver("consumers/c/examples/driver.c");
}

#[test]
fn frames_of_a_driver_in_cpp_are_classified_as_our_own_shims() {
    check_compiled_driver("consumers/cpp/examples/driver.cpp");
}

#[test]
fn frames_of_a_driver_in_python_are_classified_as_our_own_shims() {
    check_driver(|robot| python(robot, "consumers/python/examples/driver.py", &DRIVEN, "numpy"));
}

#[test]
fn frames_from_python_come_as_they_were_sent_and_what_is_no_frame_is_refused() {
    let robot = Robot::new();
    let script = "consumers/python/tests/publish.py";
    let Some(mut command) = python(&robot, script, &[SENSOR], "numpy") else { return };
    let outcome = Running::start(&mut command).end();
    assert_eq!((outcome.code, outcome.stdout.as_str(), outcome.stderr.as_str()), (Some(0), "done\n", ""));
}

/// Starts a reader of frames in Python, and publishes frames of four counts to it, one when it has printed a line for the last.
fn publish_to_python(robot: &Robot, mut command: Command, n_frames: u64, line: impl Fn(u64) -> String) {
    let reader = Running::start(&mut command);
    await_reader(robot, &reader, Purpose::Frames);
    let publisher = FramePublisher::create(&robot.node(), &SENSOR.parse().unwrap(), 4).unwrap();
    for sequence in 0..n_frames {
        let mut loan = publisher.loan().unwrap();
        loan.counts_mut().copy_from_slice(&[0, 1, 2, 3]);
        let header =
            FrameHeader { sequence, rows: 2, columns: 2, metres_per_count: 0.001, ..FrameHeader::default() };
        loan.send(&header.with_pose(Some(Pose { x_m: 1.5, ..Pose::default() }))).unwrap();
        reader.await_out(&line(sequence));
    }
    let outcome = reader.end();
    assert_eq!((outcome.code, outcome.stderr.as_str()), (Some(0), ""));
}

#[test]
fn frames_in_python_are_read_where_they_lie_and_as_long_as_an_array_of_them_is_there() {
    let robot = Robot::new();
    let script = "consumers/python/tests/in_place.py";
    let Some(command) = python(&robot, script, &[SENSOR], "numpy") else { return };
    publish_to_python(&robot, command, 4, |sequence| if sequence < 3 { "ready" } else { "done" }.to_string());
}

#[test]
fn frames_in_python_come_one_by_one() {
    let robot = Robot::new();
    let script = "consumers/python/examples/frames.py";
    let Some(command) = python(&robot, script, &[SENSOR, "20"], "numpy") else { return };
    publish_to_python(&robot, command, 20, |sequence| format!("frame {sequence}: 2 × 2, nearest 0.001 m"));
}

#[test]
fn a_wait_in_python_ends_by_ctrl_c() {
    let robot = Robot::new();
    let script = "consumers/python/examples/watch.py";
    let Some(mut command) = python(&robot, script, &[SENSOR, "1"], "numpy") else { return };
    let watch = Running::start(&mut command);
    await_reader(&robot, &watch, Purpose::Kinds);
    watch.signal(Signal::INT);
    let outcome = watch.end();
    assert!(outcome.stderr.ends_with("KeyboardInterrupt\n"), "{outcome:?}");
    assert_eq!(robot.shared_memory(), [""; 0]);
}

#[test]
fn a_models_arrays_in_python_are_those_of_the_model() {
    let robot = Robot::trained();
    let script = "consumers/python/tests/model.py";
    let Some(mut command) = python(&robot, script, &[MODEL], "numpy") else { return };
    let outcome = Running::start(&mut command).end();
    assert_eq!((outcome.code, outcome.stderr.as_str()), (Some(0), ""));
    let model = open_model(&robot.path(MODEL));
    let (weights, radii) = (model.mixture().weights(), model.squared_radii());
    for part in [
        format!("id {}\n", model.id()),
        "frames uint16 [160, 16]\n".to_string(),
        "geodesics float32 [160, 160]\n".to_string(),
        format!("\n{weights:?}\n{radii:?}\n"),
    ] {
        assert!(outcome.stdout.contains(&part), "{part} in {outcome:?}");
    }

    robot.write("cut.kinds", &robot.read(MODEL)[..5000]);
    let mut command = python(&robot, script, &["cut.kinds"], "numpy").unwrap();
    let outcome = Running::start(&mut command).end();
    let said = "ValueError: cut.kinds is not a whole model file; copy it again or train anew\n";
    assert!(outcome.stderr.ends_with(said), "{outcome:?}");
}

#[test]
fn messages_lie_in_memory_as_the_table_says_in_c_and_in_python() {
    let robot = Robot::new();
    let table = std::fs::read_to_string(checkout("consumers/layout.csv")).unwrap();
    let c = compiled(&robot, "consumers/c/tests/layout.c", Linked::Dynamically);
    let c = c.map(|path| program(&robot, &path, &[]));
    let python = python(&robot, "consumers/python/tests/layout.py", &[], "numpy");
    for mut command in c.into_iter().chain(python) {
        assert_eq!(Running::start(&mut command).end().stdout, table, "{command:?}");
    }
}

#[test]
fn a_library_that_is_not_there_is_a_sentence_in_python() {
    let robot = Robot::new();
    let script = "consumers/python/tests/layout.py";
    let Some(mut command) = python(&robot, script, &[], "numpy") else { return };
    let outcome = Running::start(command.env("NATURAL_KINDS_LIBRARY", "/nowhere/libnatural_kinds.so")).end();
    let said = "install natural kinds, or build it in its checkout with `cargo build --release -p kinds-c` and set \
                NATURAL_KINDS_LIBRARY to the path of target/release/libnatural_kinds.so\n";
    assert!(outcome.stderr.contains("libnatural_kinds.so cannot be loaded (/nowhere/"), "{outcome:?}");
    assert!(outcome.stderr.ends_with(said), "{outcome:?}");
}

#[test]
fn the_package_installs_from_the_checkout_and_is_of_the_librarys_version() {
    let robot = Robot::new();
    let manifest = std::fs::read_to_string(checkout("consumers/python/pyproject.toml")).unwrap();
    assert!(manifest.contains(concat!("\nversion = \"", env!("CARGO_PKG_VERSION"), "\"\n")));
    if !has_python("numpy, setuptools.command.bdist_wheel, pip") {
        return;
    }
    // A copy, since building leaves folders beside the sources.
    let copy =
        Command::new("cp").arg("-r").args([checkout("consumers/python"), robot.path("package")]).status();
    assert!(copy.unwrap().success());
    let install = ["-m", "pip", "install", "--quiet", "--no-deps", "--no-build-isolation", "--no-index"];
    let to = [Path::new("--target"), &robot.path("site"), &robot.path("package")];
    let installed = Command::new("python3").args(install).args(to).output().unwrap();
    assert!(installed.status.success(), "{}", String::from_utf8_lossy(&installed.stderr));
    let mut command =
        program(&robot, Path::new("python3"), &["-c", "import natural_kinds; print(natural_kinds.__file__)"]);
    // Nobody names the library: it is found as any other, by its soname.
    command.env("PYTHONPATH", robot.path("site")).env_remove("NATURAL_KINDS_LIBRARY");
    let outcome = Running::start(&mut command).end();
    assert_eq!(outcome.stderr, "");
    assert!(Path::new(outcome.stdout.trim_end()).starts_with(robot.path("site")), "{outcome:?}");
    assert!(robot.path("site/natural_kinds/py.typed").exists());
}

#[test]
fn the_library_is_known_by_its_abi_to_programs_header_and_package() {
    let robot = Robot::new();
    if Command::new("readelf").arg("--version").output().is_err() {
        eprintln!("skipped: there is no readelf");
        return;
    }
    let dynamic_section = |path: &Path| {
        let output = Command::new("readelf").arg("-dW").arg(path).output().unwrap();
        assert!(output.status.success(), "{output:?}");
        String::from_utf8(output.stdout).unwrap()
    };
    let version = env!("CARGO_PKG_VERSION");
    let abi = concat!(env!("CARGO_PKG_VERSION_MAJOR"), ".", env!("CARGO_PKG_VERSION_MINOR"));
    let soname = format!("libnatural_kinds.so.{abi}");
    let library = dynamic_section(&library_folder().join("libnatural_kinds.so"));
    assert!(library.contains(&format!("Library soname: [{soname}]")), "{library}");
    if let Some(watch) = compiled(&robot, "consumers/c/examples/watch.c", Linked::Dynamically) {
        let program = dynamic_section(&watch);
        assert!(program.contains(&format!("Shared library: [{soname}]")), "{program}");
    }
    for (path, part) in [
        ("consumers/c/include/natural_kinds.h", format!(" {soname}.\n")),
        ("consumers/python/src/natural_kinds/_library.py", format!("_SONAME = \"{soname}\"\n")),
        ("Cargo.toml", format!("\"usr/lib/libnatural_kinds.so.{version}\"")),
        ("Cargo.toml", format!("dest = \"usr/lib/{soname}\", link_name = \"libnatural_kinds.so.{version}\"")),
        ("Cargo.toml", format!("dest = \"usr/lib/libnatural_kinds.so\", link_name = \"{soname}\"")),
    ] {
        assert!(std::fs::read_to_string(checkout(path)).unwrap().contains(&part), "{part} in {path}");
    }
}

#[test]
fn the_pkg_config_file_says_how_to_compile() {
    let robot = Robot::new();
    if Command::new("pkg-config").arg("--version").output().is_err() {
        eprintln!("skipped: there is no pkg-config");
        return;
    }
    let template = std::fs::read_to_string(checkout("consumers/c/natural-kinds.pc.in")).unwrap();
    let file = template.replace("@PREFIX@", "/usr").replace("@VERSION@", env!("CARGO_PKG_VERSION"));
    robot.write("natural-kinds.pc", file);
    let mut command = robot.command_of("pkg-config", &["--cflags", "--libs", "--static", "natural-kinds"]);
    command.env("PKG_CONFIG_PATH", robot.path("")).env("PKG_CONFIG_ALLOW_SYSTEM_CFLAGS", "1");
    let outcome = Running::start(command.env("PKG_CONFIG_ALLOW_SYSTEM_LIBS", "1")).end();
    assert_eq!(outcome.stdout.trim(), "-I/usr/include -L/usr/lib -lnatural_kinds -lpthread -ldl -lm");
}

#[test]
fn readme_shows_the_examples_as_they_are() {
    let readme = std::fs::read_to_string(checkout("README.md")).unwrap();
    for (example, language) in [
        ("c/examples/watch.c", "c"),
        ("c/examples/driver.c", "c"),
        ("cpp/examples/watch.cpp", "cpp"),
        ("python/examples/watch.py", "python"),
        ("python/examples/frames.py", "python"),
        ("python/examples/driver.py", "python"),
    ] {
        let source = std::fs::read_to_string(checkout("consumers").join(example)).unwrap();
        assert!(source.lines().count() <= 25, "{example}");
        assert!(readme.contains(&format!("```{language}\n{source}```\n")), "{example}");
    }
}
