//! What a service asks of the system, so that frames wait for as little else as can be: processors, priority, and that its
//! memory stays. What is not allowed is told with its cure, and the service serves without it.

mod config;
mod memory;
mod scheduler;

use std::fmt::Write as _;
use std::io;

use rustix::process::{Resource, getrlimit};
use rustix::thread::{CpuSet, sched_getaffinity, sched_setaffinity};

pub(crate) use self::config::Realtime;

/// What came of what was asked.
enum Outcome {
    Applied(String),
    /// In a few words, and with why and the cure.
    NotApplied(String, String),
}

impl Realtime {
    /// Asks the system for all of it, for this thread. Returns what came of it, to be said at the start: nothing if nothing
    /// was asked.
    ///
    /// Last before frames are served: what is mapped later may not be locked. Threads that are started later run on the same
    /// processors unless they [return](return_to), and have no priority.
    pub(crate) fn apply(&self) -> String {
        let outcomes = [
            self.lock_memory.then(lock_memory),
            (!self.cpus.is_empty()).then(|| move_to(&self.cpus)),
            self.priority.map(raise),
        ];
        let mut told = String::new();
        for outcome in outcomes.into_iter().flatten() {
            let words = match outcome {
                Outcome::Applied(words) => words,
                Outcome::NotApplied(words, why) => {
                    tracing::warn!("{why}");
                    words
                }
            };
            write!(told, "; {words}").expect("a string takes any text");
        }
        told
    }

    /// Locks memory that was mapped since, such as another model's, where that is asked for and allowed.
    pub(crate) fn lock_what_came(&self) {
        if self.lock_memory
            && let Outcome::NotApplied(_, why) = lock_memory()
        {
            tracing::warn!("{why}");
        }
    }
}

fn lock_memory() -> Outcome {
    match memory::lock() {
        Ok(()) => Outcome::Applied("memory is locked".to_string()),
        Err(not_locked) => Outcome::NotApplied("memory is not locked".to_string(), not_locked.to_string()),
    }
}

/// Runs this thread, and those that it starts, on these processors alone.
fn move_to(cpus: &[usize]) -> Outcome {
    let mut asked = CpuSet::new();
    cpus.iter().for_each(|&cpu| asked.set(cpu));
    let moved = sched_setaffinity(None, &asked);
    let now = sched_getaffinity(None).map(|now| members(&now)).unwrap_or_default();
    let (asked, now_on) = (listed(&members(&asked)), listed(&now));
    match moved {
        Ok(()) if asked == now_on => Outcome::Applied(format!("on processors {now_on}")),
        Ok(()) => Outcome::NotApplied(
            format!("on processors {now_on}"),
            format!(
                "of the processors {asked}, only {now_on} are there and allowed to this program; name these alone, or allow it \
                 more (AllowedCPUs in a systemd unit)"
            ),
        ),
        Err(error) => Outcome::NotApplied(
            format!("on processors {now_on} as before"),
            format!(
                "cannot run on processors {asked} ({}); this program runs on {now_on}: name some of these, or allow it more \
                 (AllowedCPUs in a systemd unit); serving on",
                io::Error::from(error)
            ),
        ),
    }
}

fn raise(priority: u8) -> Outcome {
    let Err(error) = scheduler::run_before_others(priority) else {
        return Outcome::Applied(format!("real-time priority {priority}"));
    };
    let limit = match getrlimit(Resource::Rtprio).current {
        Some(limit) => limit.to_string(),
        None => "none".to_string(),
    };
    Outcome::NotApplied(
        "no real-time priority".to_string(),
        format!(
            "cannot run at real-time priority {priority}: the limit is {limit} ({error}); raise it, with ulimit -r in a shell or \
             LimitRTPRIO={priority} in a systemd unit; serving on, though frames may wait for other programs"
        ),
    )
}

/// Where this thread may run.
pub(crate) fn processors() -> Option<CpuSet> {
    sched_getaffinity(None).ok()
}

/// Lets this thread run where another could, whatever the thread that started it asked for.
pub(crate) fn return_to(processors: Option<CpuSet>) {
    // Where that fails this thread stays beside the one that it is not to disturb, which has priority.
    let _ = processors.map(|processors| sched_setaffinity(None, &processors));
}

fn members(set: &CpuSet) -> Vec<usize> {
    (0..CpuSet::MAX_CPU).filter(|&cpu| set.is_set(cpu)).collect()
}

/// Numbers with runs of them as one, as the system lists processors: `0-2,5`.
fn listed(cpus: &[usize]) -> String {
    let mut runs: Vec<[usize; 2]> = Vec::new();
    for &cpu in cpus {
        match runs.last_mut() {
            Some([_, last]) if *last + 1 == cpu => *last = cpu,
            _ => runs.push([cpu; 2]),
        }
    }
    let words: Vec<_> = runs
        .into_iter()
        .map(|[first, last]| if first == last { first.to_string() } else { format!("{first}-{last}") })
        .collect();
    words.join(",")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn processors_are_listed_as_the_system_does() {
        for (cpus, list) in
            [(&[][..], ""), (&[3], "3"), (&[0, 1, 2, 5], "0-2,5"), (&[0, 2, 3, 1023], "0,2-3,1023")]
        {
            assert_eq!(listed(cpus), list);
        }
    }
}
