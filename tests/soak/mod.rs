//! A robot's four programs over hours, and one trouble after another, from a seed.
//!
//! `SOAK_S` is how many seconds it lasts (20 without it), `SOAK_SEED` where its chance begins. What was done and what came of it is
//! told in a table at the end:
//!
//!     SOAK_S=3600 cargo test --release --test processes soak -- --nocapture
//!
//! Every frame must be reported once, or the cause must have a name (`account.rs`); memory, disk and shared memory must not
//! grow. How fast it was is shown and not judged.

#![allow(clippy::print_stderr, reason = "a soak ends with a table")]

mod account;
mod measures;
mod sluggard;
mod troubles;

use std::str::FromStr;
use std::time::{Duration, Instant};

use kinds_messages::HealthReader;

use crate::ordeal::{Ordeal, Program};
use crate::robot::{MODEL, Robot, SENSOR, SIZE};
use crate::running::await_that;

use account::{Account, Happened};
use measures::{Cpu, Held, held_table, latency_line, latest_latency, percentiles};
use sluggard::Sluggard;
use troubles::{BAD, CALM, NORMAL, OTHER, Troubles, choose};

/// How much more memory a service may hold than when it began: another model while it is exchanged, and what an allocator keeps.
const GROWTH_KB_MAX: u64 = 4096;

/// What the transport may leave for good of a program that is killed in the first milliseconds of its life: files in shared
/// memory, and as many under the domain's root; and bytes in shared memory. No place in a channel.
const LEFT_BY_A_BEGINNER: (usize, u64) = (4, 20_000);

/// What a service may hold beside its model.
const BESIDE_MODEL_KB_MAX: u64 = 20 * 1024;

fn from_environment<T: FromStr>(name: &str, otherwise: T) -> T {
    let Ok(text) = std::env::var(name) else { return otherwise };
    text.parse().unwrap_or_else(|_| panic!("{name} is {text:?}, and not a number"))
}

/// Says of a soak that failed how to see it again, and what was done last.
struct Told {
    seed: u64,
    duration_s: u64,
    troubles: Vec<String>,
}

impl Drop for Told {
    fn drop(&mut self) {
        if std::thread::panicking() {
            let Self { seed, duration_s, troubles } = self;
            let last = &troubles[troubles.len().saturating_sub(10)..];
            eprintln!(
                "again with SOAK_SEED={seed} SOAK_S={duration_s}; after {} troubles, the last: {last:?}",
                troubles.len()
            );
        }
    }
}

#[test]
fn soak_explains_every_frame_and_grows_nowhere() {
    let mut told = Told {
        seed: from_environment("SOAK_SEED", 1),
        duration_s: from_environment("SOAK_S", 20),
        troubles: Vec::new(),
    };
    let (robot, model_kb) = robot_with_models();
    let begun = Instant::now();
    let calm = Duration::from_secs((told.duration_s / 6).clamp(3, 120));
    let mut ordeal = Ordeal::begin(&robot, CALM, told.seed);
    let sluggard = Sluggard::of(robot.domain());
    let health = HealthReader::open(&robot.node(), &SENSOR.parse().unwrap()).unwrap();

    // Nothing but five frames a second.
    let cpu = Cpu::of(ordeal.running(Program::Service));
    std::thread::sleep(calm);
    let calm_share = cpu.share();
    let calm_latency = latest_latency(&health);
    let before = Held::by(&ordeal, &robot);

    ordeal.publish_with(NORMAL);
    let mut troubles = Troubles::of(&robot);
    while begun.elapsed() + calm < Duration::from_secs(told.duration_s) {
        let (trouble, program) = choose(&mut ordeal);
        told.troubles.push(format!("{trouble:?} {program:?}"));
        troubles.make(trouble, program, &mut ordeal);
    }

    ordeal.publish_with(&["--speed", CALM]);
    ordeal.await_all();
    std::thread::sleep(calm);
    let last_latency = latest_latency(&health);
    // Who was killed last is cleaned up after by those who live, every few seconds.
    await_that(|| has_not_grown(&before, &Held::by(&ordeal, &robot), troubles.n_killed_starting));
    let after = Held::by(&ordeal, &robot);
    ordeal.stop(Program::Shim);
    await_that(|| {
        let ledger = ordeal.ledger();
        ledger.frames.last().map(|frame| frame.id) == ledger.reports.last().map(|report| report.id)
    });
    let ledger = ordeal.ledger();
    let account = Account::of(&ledger, &happened(&ordeal, &troubles));
    let (n_taken, n_not_taken) = sluggard.end();
    drop(health);
    for program in [Program::Recorder, Program::Consumer, Program::Service] {
        ordeal.stop(program);
    }

    let n_kills: usize = ordeal.kills_ns.iter().map(Vec::len).sum();
    eprintln!(
        "soak of {} s, seed {}: {} troubles",
        begun.elapsed().as_secs(),
        told.seed,
        told.troubles.len()
    );
    eprintln!(
        "  {n_kills} kills, {} of them of programs that were only starting",
        troubles.n_killed_starting
    );
    eprintln!("  {}", troubles.tally());
    eprintln!("{account}");
    eprintln!("  a consumer of one a second      {n_taken} reports taken, {n_not_taken} lost to it alone");
    eprintln!("{}", held_table(&before, &after));
    eprintln!("  model                           {model_kb} kB");
    eprintln!("  most growth of one service      {} kB", troubles.growth_kb_max());
    eprintln!("  the service's share of a core   {:.3} % at 5 Hz", 100.0 * calm_share);
    eprintln!("  frame to report, µs                   p50     p90     p99   p99.9     max");
    eprintln!("    at 5 Hz, before               {}", latency_line(&calm_latency));
    eprintln!("    the last service              {}", latency_line(&last_latency));
    eprintln!("    through all troubles          {}", percentiles(&ledger.reports));
    eprintln!(
        "  until all were well again       {:.2} s at the longest",
        ordeal.longest_return.as_secs_f64()
    );

    account.check();
    assert_eq!(after.disk_bytes, before.disk_bytes);
    let growth_kb = after.memory_kb.saturating_sub(before.memory_kb).max(troubles.growth_kb_max());
    assert!(growth_kb <= GROWTH_KB_MAX, "the service grew by {growth_kb} kB");
    let most_kb = after.memory_kb.max(before.memory_kb);
    assert!(most_kb <= model_kb + BESIDE_MODEL_KB_MAX, "the service holds {most_kb} kB");
    let left = robot.shared_memory();
    assert!(left.len() <= LEFT_BY_A_BEGINNER.0 * troubles.n_killed_starting, "{left:?}");
}

/// A robot with a model, another one and a bad one, and how large the first is.
fn robot_with_models() -> (Robot, u64) {
    let robot = Robot::crunch();
    robot.succeed(&[&["train", "drive.mcap", "--output", OTHER, "--seed", "1"][..], &SIZE].concat());
    let model = robot.read(MODEL);
    robot.write(BAD, &model[..model.len() - 1]);
    (robot, model.len() as u64 / 1024)
}

/// Whether there is no more in shared memory and in the domain's folder than before, but for what so many programs may have
/// left that were killed while they started.
fn has_not_grown(before: &Held, after: &Held, n_killed_starting: usize) -> bool {
    let (n_files, n_bytes) = LEFT_BY_A_BEGINNER;
    after.n_shared_files <= before.n_shared_files + n_files * n_killed_starting
        && after.shared_bytes <= before.shared_bytes + n_bytes * n_killed_starting as u64
        && after.n_domain_files <= before.n_domain_files + n_files * n_killed_starting
}

fn happened(ordeal: &Ordeal, troubles: &Troubles) -> Happened {
    Happened {
        shim_killed_ns: ordeal.kills_ns[Program::Shim as usize].clone(),
        service_killed_ns: ordeal.kills_ns[Program::Service as usize].clone(),
        service_still_ns: troubles.service_still_ns.clone(),
    }
}
