//! The four programs of a robot, and whatever may be done to them: killed and started in any order, at any moment.

use std::path::PathBuf;
use std::time::{Duration, Instant};

use kinds_messages::monotonic_ns;
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
    /// What the shim is told besides what it publishes.
    shim_flags: Vec<String>,
    random: ChaCha8Rng,
    running: [Option<Running>; 4],
    witness: Witness,
    /// When each program was killed, [`monotonic_ns`].
    pub(crate) kills_ns: [Vec<u64>; 4],
    /// Longest time from the last start until all did their part again.
    pub(crate) longest_return: Duration,
}

impl<'a> Ordeal<'a> {
    /// Starts all of them.
    ///
    /// * `speed` — multiple of the robot's ten frames a second
    pub(crate) fn begin(robot: &'a Robot, speed: &str, seed: u64) -> Self {
        let mut ordeal = Self {
            robot,
            shim_flags: ["--speed", speed].map(str::to_string).to_vec(),
            random: ChaCha8Rng::seed_from_u64(seed),
            running: [const { None }; 4],
            witness: Witness::of(robot.domain()),
            kills_ns: [const { Vec::new() }; 4],
            longest_return: Duration::ZERO,
        };
        for program in PROGRAMS.into_iter().rev() {
            ordeal.start(program);
            if program == Program::Service {
                // A shim publishes to whoever reads, and the witness does: what came before the service is nobody's loss.
                ordeal.await_serving();
            }
        }
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
        self.running[program as usize].take().unwrap().kill();
        self.kills_ns[program as usize].push(monotonic_ns());
    }

    /// Ends a program well, and returns what it printed.
    pub(crate) fn stop(&mut self, program: Program) -> String {
        self.running[program as usize].take().unwrap().stop(Signal::TERM)
    }

    /// Ends the shim well and starts it again with other flags.
    pub(crate) fn publish_with(&mut self, flags: &[&str]) {
        self.stop(Program::Shim);
        self.shim_flags = flags.iter().map(ToString::to_string).collect();
        self.start(Program::Shim);
    }

    /// Starts a program, and does not wait for it.
    pub(crate) fn start(&mut self, program: Program) {
        let mut arguments: Vec<&str> = match program {
            Program::Shim => vec!["publish", "--simulate", "crunch", "--sensor", SENSOR],
            Program::Service => vec!["serve", "--model", MODEL, "--sensor", SENSOR],
            Program::Consumer => vec!["watch", "--sensor", SENSOR, "--json"],
            Program::Recorder => vec!["record", "--sensor", SENSOR, "--output", RECORDED],
        };
        if program == Program::Shim {
            arguments.extend(self.shim_flags.iter().map(String::as_str));
        }
        self.running[program as usize] = Some(self.robot.start(&arguments));
    }

    /// Starts the shim again if its trip is over.
    fn renew_shim(&mut self) {
        let shim = &mut self.running[Program::Shim as usize];
        if shim.as_mut().is_some_and(Running::has_ended) {
            let outcome = shim.take().unwrap().end();
            assert_eq!(outcome.code, Some(0), "the shim said {:?}", outcome.stderr);
            self.start(Program::Shim);
        }
    }

    pub(crate) fn running(&self, program: Program) -> &Running {
        self.running[program as usize].as_ref().unwrap()
    }

    /// Waits until all four do their part, and asserts that from then on every frame is reported exactly once, in order.
    pub(crate) fn check_all_is_well(&mut self) {
        let n_before = self.await_all();
        let ledger = self.witness.ledger();
        let window = &ledger.reports[n_before..];
        let (run, first) = window[0].id;
        let expected: Vec<_> = (first..).map(|sequence| (run, sequence)).take(window.len()).collect();
        let found: Vec<_> = window.iter().map(|report| report.id).collect();
        assert_eq!(found, expected, "every frame is reported exactly once while all are up");
        assert!(window[1..].iter().all(|report| report.n_lost == 0), "{window:?}");
    }

    fn await_serving(&self) {
        self.running(Program::Service).await_out(&format!("serving {SENSOR}: "));
    }

    /// Waits until all four do their part and more reports have come. Returns how many there were when the last of the four
    /// did.
    #[track_caller]
    pub(crate) fn await_all(&mut self) -> usize {
        let start = Instant::now();
        self.await_serving();
        await_that(|| !recordings(self.robot).is_empty());
        // A consumer is shown the last report when it comes, whatever the others do: the second is news.
        await_that(|| self.running(Program::Consumer).n_out() > 1);
        // Whatever was on its way when the last of them came is seen by then.
        self.await_frames(2);
        self.longest_return = self.longest_return.max(start.elapsed());
        let (_, n_before) = self.witness.n_seen();
        await_that(|| {
            self.renew_shim();
            self.witness.n_seen().1 >= n_before + N_REPORTS
        });
        for program in PROGRAMS {
            let running = self.running[program as usize].as_mut().unwrap();
            assert!(!running.has_ended(), "{program:?} has ended: {:?}", running.err());
        }
        n_before
    }

    /// Waits for so many more frames.
    pub(crate) fn await_frames(&mut self, n_frames: usize) {
        let (n_before, _) = self.witness.n_seen();
        await_that(|| {
            self.renew_shim();
            self.witness.n_seen().0 >= n_before + n_frames
        });
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

    /// Chance, for whoever decides what is done to the programs.
    pub(crate) fn random(&mut self) -> &mut ChaCha8Rng {
        &mut self.random
    }

    /// Ends all of them well, and returns what the service and the recorder say at their end.
    pub(crate) fn end(mut self) -> [String; 2] {
        let told = [Program::Recorder, Program::Consumer, Program::Shim, Program::Service]
            .map(|program| self.stop(program));
        let [recorder, _, _, service] = told;
        [service, recorder]
    }
}

/// Recordings that are not complete, or never will be.
pub(crate) fn recordings(robot: &Robot) -> Vec<PathBuf> {
    let files = std::fs::read_dir(robot.path("")).unwrap().map(|entry| entry.unwrap().path());
    files.filter(|path| path.to_string_lossy().ends_with(".partial")).collect()
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
