//! How long it takes from when a frame is due to its report in a consumer's hands, beside a Unix socket in the same run.
//!
//! `cargo bench --bench latency`, on frames of the simulated robots: Crunch's ring of 16 readings and Chew's camera of 19840.
//! Minutes, of which most is driving and learning; `KINDS_BENCH_FRAMES=500` learns from fewer frames than 2000,
//! `KINDS_BENCH_ROUNDS=3` measures fewer rounds than 11, `KINDS_BENCH_PERIOD_US=100` sends frames ten times as often.
//!
//! Two processes, each kept to one processor. This one publishes a frame when it is due, for which it looks at the clock all
//! the time, and then is the consumer: it waits for the report as the service waits for frames, by event or by polling. By
//! event the service is on the same processor or on another; who polls has a processor of its own. The service is `kinds
//! serve` itself, or what it is compared with:
//!
//! - *socket*: a process that gets the frame's counts as one datagram, classifies with the same model, and answers with as
//!   many bytes as a report has; the ordinary way;
//! - *channels alone*: our service with a classifier that answers at once;
//! - *one byte*: there and back by sockets, and by polling one number there and back between two threads: what the system
//!   and the processor take for nothing at all.
//!
//! A frame is due at its place in a fixed rhythm, whatever became of those before it: who is late is late for the next one
//! too (no coordinated omission). The ways take turns, and each is started anew in every round.
//!
//! Where the system allows it (`chrt`), both processes have real-time priority, so that what else the machine does does not
//! count. A round is shorter than the second after which the system gives others their turn all the same.
#![allow(clippy::print_stdout, reason = "a bench is there to print")]

mod child;
mod hop;
mod processors;
#[path = "../simulated/mod.rs"]
mod simulated;
mod trained;

use std::hint::black_box;
use std::time::Duration;

use kinds_messages::{Waiting, monotonic_ns};
use kinds_model::Classifier;

use crate::hop::{Channels, Condition, Hop, OneNumber, Socket};
use crate::simulated::{CAMERA, RING};
use crate::trained::Trained;

/// Frames of a round that are measured, after those that warm up.
const N_MEASURED: usize = 600;
const N_WARM_UP: usize = 50;
/// Before a round: others that want the processors get them.
const PAUSE: Duration = Duration::from_millis(100);
/// Before a frame is due, when this process stops sleeping and looks at the clock.
const AWAKE: Duration = Duration::from_micros(250);

const CONDITIONS: [Condition; 3] = [
    Condition { name: "by event, on one processor", waiting: Waiting::ByEvent, processor: 0 },
    Condition { name: "by event, on two processors", waiting: Waiting::ByEvent, processor: 1 },
    Condition { name: "polling, on two processors", waiting: Waiting::Polling, processor: 1 },
];

fn main() {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    if child::run_if_one(&arguments) {
        return;
    }
    let n_frames = asked("KINDS_BENCH_FRAMES").unwrap_or(2000);
    let n_rounds = asked("KINDS_BENCH_ROUNDS").unwrap_or(11);
    let period = Duration::from_micros(asked("KINDS_BENCH_PERIOD_US").unwrap_or(1000) as u64);
    // All that is learnt first: it would keep others off the processors for long.
    let all = [RING, CAMERA].map(|robot| Trained::on(&robot, n_frames));
    println!(
        "from when a frame is due to its report in a consumer's hands, µs; a frame every {} µs; real-time priority: {}\n\
         p50: the median of {n_rounds} rounds, with the least and the greatest; others: of all {} frames\n\
         beyond: less the p50 of classifying alone, back to back in one process",
        period.as_micros(),
        if processors::ask_for_priority() { "yes" } else { "no" },
        n_rounds * N_MEASURED,
    );
    let _pinned = processors::keep_to(0);
    for trained in &all {
        let alone = classify_alone(trained);
        let paced = classify_paced(trained, period);
        println!(
            "\n{}, {n_frames} reference frames; classifying alone: p50 {alone:.2}, at the bench's pace {paced:.2}",
            trained.title
        );
        for condition in CONDITIONS {
            println!("{:36} p50    (least … greatest)      p99    p99.9   beyond, p50", condition.name);
            table(trained, condition, alone, &Rounds { n: n_rounds, period });
        }
    }
}

/// How often is measured, and how often a frame is due.
struct Rounds {
    n: usize,
    period: Duration,
}

fn asked(variable: &str) -> Option<usize> {
    std::env::var(variable).ok().and_then(|text| text.parse().ok())
}

/// Measures all ways, which take turns, and prints a line for each.
fn table(trained: &Trained, condition: Condition, alone: f64, asked: &Rounds) {
    type Begin<'a> = Box<dyn Fn() -> Box<dyn Hop + 'a> + 'a>;
    let one: Begin = match condition.waiting {
        Waiting::ByEvent => Box::new(|| Box::new(Socket::of_one_byte(condition))),
        Waiting::Polling => Box::new(|| Box::new(OneNumber::begin())),
    };
    let ways: [(&str, f64, Begin); 4] = [
        ("kinds serve", alone, Box::new(|| Box::new(Channels::to_kinds(trained, condition)))),
        ("socket", alone, Box::new(|| Box::new(Socket::to_classifier(trained, condition)))),
        ("channels alone", 0.0, Box::new(|| Box::new(Channels::to_nothing(trained, condition)))),
        ("one byte", 0.0, one),
    ];
    let mut rounds = [const { Vec::new() }; 4];
    for _ in 0..asked.n {
        for ((_, _, begin), rounds) in ways.iter().zip(&mut rounds) {
            std::thread::sleep(PAUSE);
            rounds.push(measure(&mut *begin(), &trained.queries, asked.period));
        }
    }
    for ((name, without, _), rounds) in ways.iter().zip(&rounds) {
        let mut medians: Vec<f64> = rounds.iter().map(|round| quantile(round, 0.5)).collect();
        medians.sort_by(f64::total_cmp);
        let pooled = rounds.concat();
        let p50 = medians[asked.n / 2];
        println!(
            "  {name:29} {p50:9.2}  ({:8.2} … {:8.2}) {:8.1} {:8.1} {:13.2}",
            medians[0],
            medians[asked.n - 1],
            quantile(&pooled, 0.99),
            quantile(&pooled, 0.999),
            p50 - without,
        );
    }
}

/// Latencies from when each frame was due, µs.
fn measure(hop: &mut dyn Hop, queries: &[Vec<u16>], period: Duration) -> Vec<f64> {
    let period_ns = period.as_nanos() as u64;
    let start_ns = monotonic_ns() + period_ns;
    let mut latencies = Vec::with_capacity(N_MEASURED);
    for index in 0..N_WARM_UP + N_MEASURED {
        let due_ns = start_ns + index as u64 * period_ns;
        let mut until_due = || {
            let ahead_ns = due_ns.saturating_sub(monotonic_ns());
            std::thread::sleep(Duration::from_nanos(ahead_ns).saturating_sub(AWAKE));
            while monotonic_ns() < due_ns {
                std::hint::spin_loop();
            }
        };
        hop.there_and_back(index as u64, &queries[index % queries.len()], &mut until_due);
        let latency_ns = monotonic_ns() - due_ns;
        if index >= N_WARM_UP {
            latencies.push(latency_ns as f64 / 1e3);
        }
    }
    latencies
}

/// Median of classifying in this process, one frame after the other, µs.
fn classify_alone(trained: &Trained) -> f64 {
    let mut classifier = Classifier::new(trained.model.clone());
    let mut took = Vec::new();
    for query in trained.queries.iter().chain(&trained.queries) {
        let began_ns = monotonic_ns();
        black_box(classifier.classify(query));
        took.push((monotonic_ns() - began_ns) as f64 / 1e3);
    }
    quantile(&took[trained.queries.len()..], 0.5)
}

/// The same with the bench's pause between frames.
fn classify_paced(trained: &Trained, period: Duration) -> f64 {
    let mut classifier = Classifier::new(trained.model.clone());
    struct Alone<'a>(&'a mut Classifier);
    impl Hop for Alone<'_> {
        fn there_and_back(&mut self, _: u64, counts: &[u16], until_due: &mut dyn FnMut()) {
            until_due();
            black_box(self.0.classify(counts));
        }
    }
    quantile(&measure(&mut Alone(&mut classifier), &trained.queries, period), 0.5)
}

fn quantile(values: &[f64], share: f64) -> f64 {
    let mut sorted = values.to_vec();
    sorted.sort_by(f64::total_cmp);
    sorted[((sorted.len() - 1) as f64 * share).round() as usize]
}
