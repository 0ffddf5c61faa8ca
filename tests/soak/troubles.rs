//! What may be done to a robot's programs, one thing after another, by chance.

use std::collections::BTreeMap;
use std::time::Duration;

use kinds_messages::monotonic_ns;
use rand::RngExt;
use rustix::process::Signal;

use crate::ordeal::{Ordeal, PROGRAMS, Program, recordings};
use crate::robot::{MODEL, Robot, SENSOR};

pub(crate) const OTHER: &str = "other.kinds";
/// A model that is cut off.
pub(crate) const BAD: &str = "bad.kinds";

/// Five frames a second.
pub(crate) const CALM: &str = "0.5";
/// Ten.
pub(crate) const NORMAL: &[&str] = &["--speed", "1"];
/// Ten times as many.
const FAST: &[&str] = &["--speed", "10"];

const FAULTS: &str = "faults.ron";

/// One of the things that may be done.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(crate) enum Trouble {
    Kill,
    KillAll,
    /// Killed, and again as soon as it is started, a few times.
    KillStarting,
    /// Stopped for a while, and let go on.
    Freeze,
    Reload,
    ReloadBad,
    SpoilFrames,
    FastSensor,
}

/// Those that are done to one program come to all four.
const TROUBLES: [(Trouble, usize); 8] = [
    (Trouble::Kill, 4),
    (Trouble::KillAll, 1),
    (Trouble::KillStarting, 4),
    (Trouble::Freeze, 4),
    (Trouble::Reload, 2),
    (Trouble::ReloadBad, 1),
    (Trouble::SpoilFrames, 1),
    (Trouble::FastSensor, 1),
];

/// Does one thing after another, and takes note.
pub(crate) struct Troubles<'a> {
    robot: &'a Robot,
    n_done: BTreeMap<Trouble, u64>,
    pub(crate) n_killed_starting: usize,
    /// When the service stood still.
    pub(crate) service_still_ns: Vec<(u64, u64)>,
    /// Process of the service, and its memory when it was first looked at.
    life: Option<(u32, u64)>,
    growth_kb_max: u64,
}

impl<'a> Troubles<'a> {
    pub(crate) fn of(robot: &'a Robot) -> Self {
        Self {
            robot,
            n_done: BTreeMap::new(),
            n_killed_starting: 0,
            service_still_ns: Vec::new(),
            life: None,
            growth_kb_max: 0,
        }
    }

    /// Does a thing, and waits until all are well again.
    pub(crate) fn make(&mut self, trouble: Trouble, program: Program, ordeal: &mut Ordeal) {
        ordeal.pause(50);
        match trouble {
            Trouble::Kill => {
                ordeal.kill(program);
                ordeal.pause(50);
                ordeal.start(program);
            }
            Trouble::KillAll => {
                ordeal.shuffled().into_iter().for_each(|program| ordeal.kill(program));
                ordeal.shuffled().into_iter().for_each(|program| ordeal.start(program));
            }
            Trouble::KillStarting => {
                ordeal.kill(program);
                for _ in 0..5 {
                    ordeal.start(program);
                    ordeal.pause(30);
                    ordeal.kill(program);
                    self.n_killed_starting += 1;
                }
                ordeal.start(program);
            }
            Trouble::Freeze => self.freeze(ordeal, program),
            Trouble::Reload => {
                let model = if ordeal.random().random() { OTHER } else { MODEL };
                self.robot.succeed(&["reload", "--sensor", SENSOR, "--model", model]);
            }
            Trouble::ReloadBad => {
                let outcome = self.robot.run(&["reload", "--sensor", SENSOR, "--model", BAD]);
                assert_eq!(outcome.code, Some(1), "{outcome:?}");
            }
            Trouble::SpoilFrames => {
                let seed: u32 = ordeal.random().random();
                self.robot.write(FAULTS, spoilt(seed));
                let flags = [NORMAL, &["--faults", FAULTS]].concat();
                publish_for_a_while(ordeal, &flags, 40);
                std::fs::remove_file(self.robot.path(FAULTS)).unwrap();
            }
            Trouble::FastSensor => publish_for_a_while(ordeal, FAST, 200),
        }
        ordeal.await_all();
        self.look_at_memory(ordeal);
        // A recorder that was killed leaves what it had written, by intent. The last is the one at work.
        if !ordeal.kills_ns[Program::Recorder as usize].is_empty() {
            self.clear_recordings();
        }
        *self.n_done.entry(trouble).or_default() += 1;
    }

    fn freeze(&mut self, ordeal: &mut Ordeal, program: Program) {
        ordeal.running(program).freeze();
        let since_ns = monotonic_ns();
        let pause_ms = ordeal.random().random_range(0..3000);
        std::thread::sleep(Duration::from_millis(pause_ms));
        if program == Program::Service {
            self.service_still_ns.push((since_ns, monotonic_ns()));
        }
        ordeal.running(program).signal(Signal::CONT);
    }

    fn look_at_memory(&mut self, ordeal: &Ordeal) {
        let (process, memory_kb) = (ordeal.running(Program::Service).pid(), ordeal.memory_kb());
        match self.life {
            Some((known, first_kb)) if known == process => {
                self.growth_kb_max = self.growth_kb_max.max(memory_kb.saturating_sub(first_kb));
            }
            _ => self.life = Some((process, memory_kb)),
        }
    }

    fn clear_recordings(&self) {
        let mut recordings = recordings(self.robot);
        recordings.sort_by_key(|path| path.metadata().and_then(|metadata| metadata.modified()).ok());
        recordings.pop();
        recordings.iter().for_each(|path| std::fs::remove_file(path).unwrap());
    }

    /// The most that a service grew while it lived.
    pub(crate) fn growth_kb_max(&self) -> u64 {
        self.growth_kb_max
    }

    /// How often each was done.
    pub(crate) fn tally(&self) -> String {
        let done: Vec<_> = self.n_done.iter().map(|(trouble, n)| format!("{n} {trouble:?}")).collect();
        done.join(", ")
    }
}

/// What is done next, and to whom.
pub(crate) fn choose(ordeal: &mut Ordeal) -> (Trouble, Program) {
    let program = PROGRAMS[ordeal.random().random_range(0..PROGRAMS.len())];
    let often: Vec<Trouble> =
        TROUBLES.iter().flat_map(|&(trouble, n)| std::iter::repeat_n(trouble, n)).collect();
    (often[ordeal.random().random_range(0..often.len())], program)
}

fn spoilt(seed: u32) -> String {
    format!(
        "(seed: {seed}, drop: 0.08, repeat: 0.08, reorder: 0.08, delay: 0.08, delay_ms: 150, flip_bit: 0.08, invalid: 0.08, wrong_length: 0.08)"
    )
}

fn publish_for_a_while(ordeal: &mut Ordeal, flags: &[&str], n_frames: usize) {
    ordeal.publish_with(flags);
    ordeal.await_frames(n_frames);
    ordeal.publish_with(NORMAL);
}
