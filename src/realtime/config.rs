//! What a file of real-time settings says.

use rustix::thread::CpuSet;
use serde::Deserialize;

/// What is asked of the system for a service. Every field may be left out, and is not asked for then.
#[derive(Clone, Debug, Default, PartialEq, Eq, Deserialize)]
#[serde(default, deny_unknown_fields, rename = "Realtime")]
pub(crate) struct Realtime {
    /// Processors that it may run on, by their number from 0.
    #[serde(deserialize_with = "processors")]
    pub(crate) cpus: Vec<usize>,
    /// Real-time priority (`SCHED_FIFO`), 1 to 99: who has a lower one, or none, waits.
    #[serde(deserialize_with = "priority")]
    pub(crate) priority: Option<u8>,
    /// Whether its memory is never to be paged out.
    pub(crate) lock_memory: bool,
}

fn processors<'de, D: serde::Deserializer<'de>>(deserializer: D) -> Result<Vec<usize>, D::Error> {
    let cpus = Vec::<usize>::deserialize(deserializer)?;
    let last = CpuSet::MAX_CPU - 1;
    match cpus.iter().find(|&&cpu| cpu > last) {
        Some(cpu) => Err(serde::de::Error::custom(format!(
            "cpus has {cpu}; processors are numbered from 0 to at most {last}"
        ))),
        None if cpus.is_empty() => Err(serde::de::Error::custom(
            "cpus is empty; name the processors to run on, or leave it out to run on all",
        )),
        None => Ok(cpus),
    }
}

fn priority<'de, D: serde::Deserializer<'de>>(deserializer: D) -> Result<Option<u8>, D::Error> {
    let priority = i64::deserialize(deserializer)?;
    match u8::try_from(priority) {
        Ok(priority @ 1..=99) => Ok(Some(priority)),
        _ => Err(serde::de::Error::custom(format!(
            "priority is {priority}; it must be between 1 and 99, or left out for none"
        ))),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::ron_file::parse;

    #[test]
    fn settings_are_read_and_what_is_left_out_is_not_asked_for() {
        assert_eq!(parse("()"), Ok(Realtime::default()));
        assert_eq!(
            parse("(cpus: [2, 3], priority: 50, lock_memory: true)"),
            Ok(Realtime { cpus: vec![2, 3], priority: Some(50), lock_memory: true })
        );
    }

    #[test]
    fn what_cannot_be_is_refused_with_its_place() {
        for (text, sentence) in [
            (
                "(cpus: [])",
                "line 1, column 9: cpus is empty; name the processors to run on, or leave it out to run on all",
            ),
            (
                "(cpus: [0, 1024])",
                "line 1, column 16: cpus has 1024; processors are numbered from 0 to at most 1023",
            ),
            (
                "(\n priority: 0)",
                "line 2, column 12: priority is 0; it must be between 1 and 99, or left out for none",
            ),
            (
                "(priority: 100)",
                "line 1, column 12: priority is 100; it must be between 1 and 99, or left out for none",
            ),
            (
                "(prio: 5)",
                "line 1, column 2: there is no field prio; the fields are cpus, priority, lock_memory",
            ),
        ] {
            assert_eq!(parse::<Realtime>(text), Err(sentence.to_string()));
        }
    }
}
