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
use measures::{Cpu, disk_bytes, latency_line, latest_health, percentiles};
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
    let robot = Robot::crunch();
    robot.succeed(&[&["train", "drive.mcap", "--output", OTHER, "--seed", "1"][..], &SIZE].concat());
    let model = robot.read(MODEL);
    robot.write(BAD, &model[..model.len() - 1]);
    let model_kb = model.len() as u64 / 1024;

    let begun = Instant::now();
    let calm = Duration::from_secs((told.duration_s / 6).clamp(3, 120));
    let mut ordeal = Ordeal::begin(&robot, CALM, told.seed);
    let sluggard = Sluggard::of(robot.domain());
    let health = HealthReader::open(&robot.node(), &SENSOR.parse().unwrap()).unwrap();

    // Nothing but five frames a second.
    let cpu = Cpu::of(ordeal.running(Program::Service));
    std::thread::sleep(calm);
    let calm_share = cpu.share();
    let calm_health = latest_health(&health);
    let before = (ordeal.remains(), disk_bytes(&robot), ordeal.memory_kb());

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
    let last_health = latest_health(&health);
    let after_kb = ordeal.memory_kb();
    // Who was killed last is cleaned up after by those who live, every few seconds.
    await_that(|| {
        let (before, after) = (before.0, ordeal.remains());
        let n_files_more = LEFT_BY_A_BEGINNER.0 * troubles.n_killed_starting;
        let n_bytes_more = LEFT_BY_A_BEGINNER.1 * troubles.n_killed_starting as u64;
        after.0 <= before.0 + n_files_more
            && after.1 <= before.1 + n_bytes_more
            && after.2 <= before.2 + n_files_more
    });
    let after = (ordeal.remains(), disk_bytes(&robot), after_kb);

    ordeal.stop(Program::Shim);
    let is_reported = |ordeal: &Ordeal| {
        let ledger = ordeal.ledger();
        ledger.frames.last().map(|frame| frame.id) == ledger.reports.last().map(|report| report.id)
    };
    await_that(|| is_reported(&ordeal));
    let happened = Happened {
        shim_killed_ns: ordeal.kills_ns[Program::Shim as usize].clone(),
        service_killed_ns: ordeal.kills_ns[Program::Service as usize].clone(),
        service_still_ns: troubles.service_still_ns.clone(),
    };
    let ledger = ordeal.ledger();
    let account = Account::of(&ledger, &happened);
    let n_kills: usize = ordeal.kills_ns.iter().map(Vec::len).sum();
    let longest_return = ordeal.longest_return;
    let (n_taken, n_sluggard_lost) = sluggard.end();
    drop(health);
    ordeal.start(Program::Shim);
    ordeal.end();

    let ((shared_before, disk_before, before_kb), (shared_after, disk_after, after_kb)) = (before, after);
    eprintln!(
        "soak of {} s, seed {}: {} troubles, {n_kills} kills, {} of them of programs that were only starting",
        begun.elapsed().as_secs(),
        told.seed,
        told.troubles.len(),
        troubles.n_killed_starting
    );
    eprintln!("{}", troubles.tally());
    eprintln!("{account}");
    eprintln!(
        "  a consumer of one a second      {n_taken} reports taken, {n_sluggard_lost} lost to it alone"
    );
    eprintln!(
        "  memory of the service           {before_kb} kB before, {after_kb} kB after; most growth in one life {} kB; model {model_kb} kB",
        troubles.growth_kb_max()
    );
    eprintln!(
        "  /dev/shm                        {} files, {} bytes before; {} files, {} bytes after",
        shared_before.0, shared_before.1, shared_after.0, shared_after.1
    );
    eprintln!("  files of the domain             {} before, {} after", shared_before.2, shared_after.2);
    eprintln!("  disk, without recordings        {disk_before} bytes before, {disk_after} after");
    eprintln!("  the service's share of a core   {:.3} % at 5 Hz", 100.0 * calm_share);
    eprintln!("  frame to report                       p50     p90     p99   p99.9     max");
    eprintln!(
        "    at 5 Hz, before, µs           {}",
        latency_line(&calm_health.since_start.sent_to_reported)
    );
    eprintln!(
        "    the last service, µs          {}",
        latency_line(&last_health.since_start.sent_to_reported)
    );
    eprintln!("    through all troubles, µs      {}", percentiles(&ledger.reports));
    eprintln!("  longest until all were well again   {:.2} s", longest_return.as_secs_f64());

    account.check();
    assert_eq!(disk_after, disk_before);
    assert!(
        after_kb <= before_kb + GROWTH_KB_MAX,
        "the last service holds {after_kb} kB, the first held {before_kb}"
    );
    assert!(troubles.growth_kb_max() <= GROWTH_KB_MAX, "a service grew by {} kB", troubles.growth_kb_max());
    assert!(before_kb.max(after_kb) <= model_kb + BESIDE_MODEL_KB_MAX, "{before_kb} kB, {after_kb} kB");
    let n_left = robot.shared_memory().len();
    assert!(n_left <= LEFT_BY_A_BEGINNER.0 * troubles.n_killed_starting, "{:?}", robot.shared_memory());
}
