//! Memory, disk, processor time and latencies, as the system and the service tell them.

use std::time::Instant;

use kinds_messages::{HealthReader, Latency};

use crate::ordeal::{Ordeal, Program, RECORDED, recordings};
use crate::robot::Robot;
use crate::running::{Running, await_that};
use crate::witness::SeenReport;

impl Ordeal<'_> {
    /// Memory that the service holds, its model's pages and shared memory included, kB.
    pub(crate) fn memory_kb(&self) -> u64 {
        let told = self.running(Program::Service).status("VmRSS:");
        told.trim_end_matches(" kB").parse().unwrap()
    }
}

/// What a robot's programs hold.
pub(crate) struct Held {
    pub(crate) n_shared_files: usize,
    pub(crate) shared_bytes: u64,
    pub(crate) n_domain_files: usize,
    pub(crate) disk_bytes: u64,
    /// The service alone.
    pub(crate) memory_kb: u64,
}

impl Held {
    pub(crate) fn by(ordeal: &Ordeal, robot: &Robot) -> Self {
        let (n_shared_files, shared_bytes, n_domain_files) = ordeal.remains();
        let (disk_bytes, memory_kb) = (disk_bytes(robot), ordeal.memory_kb());
        Self { n_shared_files, shared_bytes, n_domain_files, disk_bytes, memory_kb }
    }
}

pub(crate) fn held_table(before: &Held, after: &Held) -> String {
    let rows = [
        ("memory of the service, kB", before.memory_kb, after.memory_kb),
        ("/dev/shm, bytes", before.shared_bytes, after.shared_bytes),
        ("/dev/shm, files", before.n_shared_files as u64, after.n_shared_files as u64),
        ("the domain's folder, files", before.n_domain_files as u64, after.n_domain_files as u64),
        ("disk without recordings, bytes", before.disk_bytes, after.disk_bytes),
    ];
    let rows = rows.map(|(what, before, after)| format!("  {what:31} {before} before, {after} after"));
    rows.join("\n")
}

/// Bytes of the robot's files, without recordings.
fn disk_bytes(robot: &Robot) -> u64 {
    let recordings = recordings(robot);
    let files = std::fs::read_dir(robot.path("")).unwrap().map(|entry| entry.unwrap());
    let others = files.filter(|file| !recordings.contains(&file.path()) && file.file_name() != RECORDED);
    others.map(|file| file.metadata().unwrap().len()).sum()
}

/// A program's use of the processor since some moment.
pub(crate) struct Cpu {
    pid: u32,
    since: Instant,
    used_ns: u64,
}

impl Cpu {
    pub(crate) fn of(program: &Running) -> Self {
        let pid = program.pid();
        Self { pid, since: Instant::now(), used_ns: used_ns(pid) }
    }

    /// Share of one core.
    pub(crate) fn share(&self) -> f64 {
        (used_ns(self.pid) - self.used_ns) as f64 / self.since.elapsed().as_nanos() as f64
    }
}

/// Time on a processor of all of a program's threads, as the scheduler counts it.
fn used_ns(pid: u32) -> u64 {
    let threads = std::fs::read_dir(format!("/proc/{pid}/task")).unwrap().map(|entry| entry.unwrap().path());
    let used = threads.map(|thread| std::fs::read_to_string(thread.join("schedstat")).unwrap());
    used.map(|told| told.split(' ').next().unwrap().parse::<u64>().unwrap()).sum()
}

/// From frame to report since a service began, as it says next.
pub(crate) fn latest_latency(reader: &HealthReader) -> Latency {
    // What waits may be old.
    while reader.receive().unwrap().is_some() {}
    let mut latency = Latency::default();
    await_that(|| {
        let report = reader.receive().unwrap();
        latency = report.map_or(latency, |report| report.since_start.sent_to_reported);
        latency.n_frames > 0
    });
    latency
}

pub(crate) fn latency_line(latency: &Latency) -> String {
    let Latency { p50_ns, p90_ns, p99_ns, p999_ns, max_ns, .. } = *latency;
    line([p50_ns, p90_ns, p99_ns, p999_ns, max_ns])
}

/// The same of reports.
pub(crate) fn percentiles(reports: &[SeenReport]) -> String {
    let mut ns: Vec<u64> =
        reports.iter().map(|report| report.reported_ns.saturating_sub(report.sent_ns)).collect();
    ns.sort_unstable();
    line([0.5, 0.9, 0.99, 0.999, 1.0].map(|share| ns[((ns.len() - 1) as f64 * share) as usize]))
}

fn line(ns: [u64; 5]) -> String {
    ns.map(|ns| format!("{:7.0}", ns as f64 / 1e3)).join(" ")
}
