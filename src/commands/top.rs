//! `kinds top`: how all services of the domain fare, and who is connected; of those on other machines, as far as a bridge tells.

mod drift;
mod json;
mod observer;
mod passed_on;
mod screen;
mod table;

use std::io::IsTerminal;
use std::path::PathBuf;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

use crate::cli::TopArguments;
use crate::commands::top::observer::Observer;
use crate::failure::Failure;
use crate::kind_names::KindNames;
use crate::say::say;
use crate::stop;

/// How long a service's health is waited for: it gives the last one to whoever comes, within 50 ms.
const PATIENCE: Duration = Duration::from_secs(2);

/// Between two looks for health.
const LOOK: Duration = Duration::from_millis(10);

/// Between two looks at who is there. Services say how they fare as often.
const PERIOD: Duration = Duration::from_secs(1);

pub(crate) fn run(arguments: &TopArguments) -> Result<(), Failure> {
    let stop = stop::on_signals()?;
    let names = KindNames::read(arguments.model.iter().map(PathBuf::as_path))?;
    let observer = Observer::join(arguments.domain.domain(), names)?;
    if arguments.once || arguments.json || !std::io::stdout().is_terminal() {
        print(observer, arguments, &stop)
    } else {
        screen::show(observer, &stop)
    }
}

/// Prints what is seen, once or every second.
fn print(mut observer: Observer, arguments: &TopArguments, stop: &AtomicBool) -> Result<(), Failure> {
    while !stop.load(Ordering::Relaxed) {
        let start = Instant::now();
        observer.look()?;
        observer.receive();
        while observer.waits_for_first_words() && start.elapsed() < PATIENCE {
            std::thread::sleep(LOOK);
            observer.receive();
        }
        if arguments.json {
            say(json::line(&observer))?;
        } else {
            say(table::text(&observer).join("\n"))?;
        }
        if arguments.once {
            break;
        }
        while start.elapsed() < PERIOD && !stop.load(Ordering::Relaxed) {
            std::thread::sleep(LOOK);
            observer.receive();
        }
    }
    Ok(())
}
