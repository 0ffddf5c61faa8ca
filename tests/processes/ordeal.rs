//! The four programs of a robot, and whatever may be done to them: killed and started in any order, at any moment.

use std::time::{Duration, Instant};

use rand::RngExt;
use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::SeedableRng;
use rustix::process::Signal;

use crate::robot::{MODEL, Robot, SENSOR};
use crate::running::{Running, await_that};
use crate::witness::{Ledger, Witness};

pub(crate) const RECORDED: &str = "recorded.mcap";

/// One of the programs.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Program {
    Shim,
    Service,
    Consumer,
    Recorder,
}

pub(crate) const PROGRAMS: [Program; 4] =
    [Program::Shim, Program::Service, Program::Consumer, Program::Recorder];

/// Reports that must come in a row for all to be well.
const N_REPORTS: usize = 5;

/// A robot whose four programs run, and a witness of all that they say.
pub(crate) struct Ordeal<'a> {
    robot: &'a Robot,
    /// Multiple of the robot's ten frames a second.
    speed: &'a str,
    random: ChaCha8Rng,
    running: [Option<Running>; 4],
    witness: Witness,
    pub(crate) n_kills: [u64; 4],
    /// Longest time from the last start until all did their part again.
    pub(crate) longest_return: Duration,
}

impl<'a> Ordeal<'a> {
    /// Starts all of them.
    pub(crate) fn begin(robot: &'a Robot, speed: &'a str, seed: u64) -> Self {
        let mut ordeal = Self {
            robot,
            speed,
            random: ChaCha8Rng::seed_from_u64(seed),
            running: [const { None }; 4],
            witness: Witness::of(robot.domain()),
            n_kills: [0; 4],
            longest_return: Duration::ZERO,
        };
        PROGRAMS.into_iter().rev().for_each(|program| ordeal.start(program));
        ordeal.check_all_is_well();
        ordeal
    }

    /// The programs in a random order.
    pub(crate) fn shuffled(&mut self) -> [Program; 4] {
        let mut programs = PROGRAMS;
        for index in (1..programs.len()).rev() {
            programs.swap(index, self.random.random_range(0..=index));
        }
        programs
    }

    /// Lets a random while pass, up to so many milliseconds.
    pub(crate) fn pause(&mut self, at_most_ms: u64) {
        std::thread::sleep(Duration::from_micros(self.random.random_range(0..=1000 * at_most_ms)));
    }

    pub(crate) fn kill(&mut self, program: Program) {
        self.n_kills[program as usize] += 1;
        self.running[program as usize].take().unwrap().kill();
    }

    /// Starts a program, and does not wait for it.
    pub(crate) fn start(&mut self, program: Program) {
        let speed = self.speed;
        let arguments: &[&str] = match program {
            Program::Shim => &["publish", "--simulate", "crunch", "--sensor", SENSOR, "--speed", speed],
            Program::Service => &["serve", "--model", MODEL, "--sensor", SENSOR],
            Program::Consumer => &["watch", "--sensor", SENSOR, "--json"],
            Program::Recorder => &["record", "--sensor", SENSOR, "--output", RECORDED],
        };
        self.running[program as usize] = Some(self.robot.start(arguments));
    }

    pub(crate) fn running(&self, program: Program) -> &Running {
        self.running[program as usize].as_ref().unwrap()
    }

    /// Waits until all four do their part, and asserts that from then on every frame is reported exactly once, in order.
    pub(crate) fn check_all_is_well(&mut self) {
        let start = Instant::now();
        self.running(Program::Service).await_out(&format!("serving {SENSOR}: "));
        let has_recording = || {
            let files = self.robot.files();
            files.keys().any(|path| path.to_string_lossy().ends_with(".partial"))
        };
        await_that(has_recording);
        // A consumer is shown the last report when it comes, whatever the others do: the second is news.
        await_that(|| self.running(Program::Consumer).out().len() > 1);
        // Whatever was on its way when the last of them came is seen by then.
        let (n_frames, _) = self.witness.n_seen();
        await_that(|| self.witness.n_seen().0 >= n_frames + 2);
        self.longest_return = self.longest_return.max(start.elapsed());
        let (_, n_before) = self.witness.n_seen();
        await_that(|| self.witness.n_seen().1 >= n_before + N_REPORTS);
        let ledger = self.witness.ledger();
        let window = &ledger.reports[n_before..];
        let (run, first) = window[0].id;
        let expected: Vec<_> = (first..).map(|sequence| (run, sequence)).take(window.len()).collect();
        let found: Vec<_> = window.iter().map(|report| report.id).collect();
        assert_eq!(found, expected, "every frame is reported exactly once while all are up");
        assert!(window[1..].iter().all(|report| report.n_lost == 0), "{window:?}");
        for program in PROGRAMS {
            let running = self.running[program as usize].as_mut().unwrap();
            assert!(!running.has_ended(), "{program:?} has ended: {:?}", running.err());
        }
    }

    /// Files and bytes in shared memory, and files under the domain's root.
    pub(crate) fn remains(&self) -> (usize, u64, usize) {
        let domain = self.robot.domain();
        let entries = std::fs::read_dir("/dev/shm").unwrap().flatten();
        let ours = entries.filter(|entry| entry.file_name().to_string_lossy().starts_with(&domain.prefix));
        // A file may go while it is looked at.
        let sizes: Vec<u64> =
            ours.filter_map(|entry| entry.metadata().ok()).map(|metadata| metadata.len()).collect();
        (sizes.len(), sizes.iter().sum(), n_files(&domain.root))
    }

    pub(crate) fn ledger(&self) -> Ledger {
        self.witness.ledger()
    }

    /// Ends all of them well, and returns what the service and the recorder say at their end.
    pub(crate) fn end(mut self) -> [String; 2] {
        let told = [Program::Recorder, Program::Consumer, Program::Shim, Program::Service]
            .map(|program| self.running[program as usize].take().unwrap().stop(Signal::TERM));
        let [recorder, _, _, service] = told;
        [service, recorder]
    }
}

/// Files under a folder, at any depth.
fn n_files(folder: &std::path::Path) -> usize {
    let Ok(entries) = std::fs::read_dir(folder) else { return 0 };
    entries
        .flatten()
        .map(|entry| entry.path())
        .map(|path| if path.is_dir() { n_files(&path) } else { 1 })
        .sum()
}
