//! `kinds reload`: another model for a running service.

use std::path::Path;
use std::sync::atomic::Ordering;
use std::time::{Duration, Instant};

use kinds_messages::{Node, ReloadAnswer, ReloadAsker, SensorName};

use crate::cli::ReloadArguments;
use crate::failure::Failure;
use crate::say::mention;
use crate::{log, stop};

/// How long an answer is waited for: the largest models are read in seconds.
const PATIENCE: Duration = Duration::from_secs(60);

/// Silence after which it is said that an answer is waited for.
const SILENCE: Duration = Duration::from_secs(3);

/// Between two looks for the answer.
const LOOK: Duration = Duration::from_millis(10);

/// How often what killed programs left is looked for: a service that was killed counts as there until then.
const CLEAN_UP_PERIOD: Duration = Duration::from_secs(2);

pub(crate) fn run(arguments: &ReloadArguments) -> Result<(), Failure> {
    let (sensor, model) = arguments.asked()?;
    // The service may work in another folder.
    let path = model
        .as_deref()
        .map(|path| std::path::absolute(path).map_err(|error| Failure::file("find model", path, &error)));
    let answer = ask(arguments, &sensor, path.transpose()?.as_deref())?;
    match answer.is_taken() {
        true => mention(answer.words()),
        false => Err(Failure::CouldNot(answer.words())),
    }
}

fn ask(
    arguments: &ReloadArguments,
    sensor: &SensorName,
    path: Option<&Path>,
) -> Result<ReloadAnswer, Failure> {
    let stop = stop::on_signals()?;
    let node = Node::open(&arguments.domain.domain(), "kinds-reload")?;
    let asker = ReloadAsker::open(&node, sensor)?;
    if !asker.is_heard() {
        return Err(Failure::CouldNot(format!(
            "there is no service for {sensor} that could be given a model; start one (kinds serve --sensor {sensor} --model …)"
        )));
    }
    let Some(id) = asker.ask(path)? else {
        return Err(Failure::AskedWrongly("the model's path is longer than the system allows".to_string()));
    };
    let start = Instant::now();
    let mut last_clean_up = start;
    let mut is_said = false;
    loop {
        // In this order: an answer may be a service's last word.
        let is_heard = asker.is_heard();
        if let Some(answer) = asker.answer_to(id)? {
            return Ok(answer);
        }
        let trouble = if !is_heard {
            "the service has ended without an answer".to_string()
        } else if stop.load(Ordering::Relaxed) {
            "stopped before the service has answered; it may still take the model into use".to_string()
        } else if start.elapsed() > PATIENCE {
            format!("the service has not answered for {} s; if it hangs, start it again", PATIENCE.as_secs())
        } else {
            std::thread::sleep(LOOK);
            if !is_said && start.elapsed() > SILENCE {
                log::notice(format!("waiting for the service of {sensor} to answer"));
                is_said = true;
            }
            if last_clean_up.elapsed() >= CLEAN_UP_PERIOD {
                node.clean_up_dead_nodes();
                last_clean_up = Instant::now();
            }
            continue;
        };
        return Err(Failure::CouldNot(format!("cannot reload {sensor}: {trouble}")));
    }
}
