//! How long steps take, on the clock and on all processors, and how much memory.

use std::path::Path;
use std::time::{Duration, Instant};

use kinds_model::Model;
use kinds_trainer::{Config, Stage, train};
use rustix::time::{ClockId, Timespec, clock_gettime};

/// Trains on a trip, and prints what each step took.
pub(crate) fn training(trip: &Path, config: &Config) -> Model {
    let mut steps = Steps::new();
    let trained = train(&[trip.to_path_buf()], config, &mut |stage, _, _| match stage {
        Stage::Fitting(step) => steps.at(format!("{step:?}")),
        _ => steps.at("Reading".to_string()),
    });
    let trained = trained.expect("a simulated trip makes a model");
    steps.print("training");
    peak();
    trained.model
}

/// How long each step took: what passed until its last word belongs to it.
pub(crate) struct Steps {
    clock: Clock,
    taken: Vec<(String, Taken)>,
}

impl Steps {
    pub(crate) fn new() -> Self {
        Self { clock: Clock::start(), taken: Vec::new() }
    }

    pub(crate) fn at(&mut self, step: String) {
        let at = self.clock.taken();
        match self.taken.last_mut() {
            Some((last, until)) if *last == step => *until = at,
            _ => self.taken.push((step, at)),
        }
    }

    pub(crate) fn print(self, what: &str) {
        told(what, self.clock.taken());
        let mut before = Taken::default();
        for (step, until) in self.taken {
            let Taken { wall, processors } = until;
            let of_step = Taken { wall: wall - before.wall, processors: processors - before.processors };
            told(&format!("  until the last of {step}"), of_step);
            before = until;
        }
    }
}

/// Two clocks: on a machine that has other work too, only the second is to be trusted.
pub(crate) struct Clock {
    began: Instant,
    processors_began: Duration,
}

/// What passed, and what all processors spent on this process.
#[derive(Clone, Copy, Default)]
pub(crate) struct Taken {
    wall: Duration,
    processors: Duration,
}

impl Clock {
    pub(crate) fn start() -> Self {
        Self { began: Instant::now(), processors_began: processors() }
    }

    pub(crate) fn taken(&self) -> Taken {
        Taken { wall: self.began.elapsed(), processors: processors() - self.processors_began }
    }
}

fn processors() -> Duration {
    let Timespec { tv_sec, tv_nsec } = clock_gettime(ClockId::ProcessCPUTime);
    Duration::new(tv_sec as u64, tv_nsec as u32)
}

/// Prints a line.
pub(crate) fn told(what: &str, Taken { wall, processors }: Taken) {
    println!("  {what:<40} {:9.3} s {:9.3} s of processors", wall.as_secs_f64(), processors.as_secs_f64());
}

/// Prints the most memory that this process has held.
pub(crate) fn peak() {
    let status = std::fs::read_to_string("/proc/self/status").expect("Linux tells of a process");
    let line = status.lines().find_map(|line| line.strip_prefix("VmHWM:")).expect("with its peak");
    let kib: f64 = line.trim().trim_end_matches(" kB").parse().expect("in kB");
    println!("  {:<40} {:9.0} MB", "peak memory", kib * 1024.0 / 1e6);
}
