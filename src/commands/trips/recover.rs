//! `kinds trips recover`: what is whole of a damaged recording, as a new one.

use std::path::Path;

use kinds_trips::{Salvage, salvage};

use crate::cli::RecoverArguments;
use crate::commands::trips::check_is_new;
use crate::failure::Failure;
use crate::say::mention;

pub(crate) fn run(arguments: &RecoverArguments) -> Result<(), Failure> {
    let RecoverArguments { from, to } = arguments;
    check_is_new(to)?;
    let saved = salvage(from, to)?;
    mention(describe(&saved, to))
}

fn describe(saved: &Salvage, to: &Path) -> String {
    let Salvage { n_messages, n_topics, n_losses, n_bytes_lost, losses, .. } = saved;
    let topics = if *n_topics == 1 { "topic" } else { "topics" };
    let of = saved.n_messages_recorded.map_or(String::new(), |recorded| format!(" of {recorded}"));
    let mut lines =
        vec![format!("saved {n_messages}{of} messages on {n_topics} {topics} into {}", to.display())];
    if *n_losses > 0 {
        let places = if *n_losses == 1 { "place" } else { "places" };
        lines.push(format!("lost {n_bytes_lost} bytes in {n_losses} {places}:"));
        lines.extend(losses.iter().map(|loss| format!("  {loss}")));
        let n_more = n_losses - losses.len() as u64;
        if n_more > 0 {
            lines.push(format!("  and {n_more} more"));
        }
    }
    if saved.n_messages_unknown > 0 {
        let n = saved.n_messages_unknown;
        lines.push(format!("lost {n} messages that are whole: what topic and type they are of is not"));
    }
    if saved.may_be_wrong {
        lines.push(
            "the checksum of all data differs: some message that was saved is not as it was recorded"
                .to_string(),
        );
    }
    lines.push(match (saved.was_closed, *n_losses + saved.n_messages_unknown) {
        (true, 0) => "nothing was lost".to_string(),
        (true, _) => "the recording was closed: everything else is there".to_string(),
        (false, _) => {
            "the recording was not closed: whether anything came after this, nobody can tell".to_string()
        }
    });
    lines.join("\n")
}
