//! The programs of a domain: who lives, who was killed, who stands still, and who cannot be seen.

use kinds_messages::{Census, Domain, Life, Program};

use super::finding::{Finding, listed, well, wrong};

pub(super) fn examine(domain: &Domain, census: &Census) -> Vec<Finding> {
    let of = |life: Life| census.programs.iter().filter(move |program| program.life == life);
    let mut findings = Vec::new();
    if census.programs.is_empty() {
        findings.push(wrong(
            "programs",
            format!("no program is in the domain {}", domain.root.display()),
            "start a driver shim (kinds publish) and a service (kinds serve), with the same --domain or KINDS_DOMAIN as this \
             program",
        ));
    } else {
        findings.push(well("programs", format!("in the domain: {}", listed(of(Life::Alive)))));
    }
    findings.extend(of(Life::Dead).map(|program| {
        wrong(
            "programs",
            format!("{program} was killed, and what it left is still there"),
            "start it again, or any program of this domain: each removes what killed ones left",
        )
    }));
    let unseen: Vec<&Program> = of(Life::Hidden).chain(of(Life::Unclear)).collect();
    if !unseen.is_empty() {
        findings.push(wrong(
            "programs",
            format!("{} cannot be asked whether it lives", listed(unseen)),
            "if it is another user's, run all programs of a robot, this one too, as one user; else stop all of them and remove \
             the domain's folder",
        ));
    }
    findings.extend(of(Life::Alive).filter(|program| program.pid.is_some_and(is_stopped)).map(|program| {
        wrong(
            "programs",
            format!("{program} is there but stopped: it does nothing until it is continued"),
            program.pid.map_or(String::new(), |pid| format!("kill -CONT {pid}")),
        )
    }));
    if census.n_unreadable > 0 {
        findings.push(wrong(
            "channels",
            format!(
                "{} channels under {} cannot be read: they were made with another version of the transport, or by another user",
                census.n_unreadable,
                domain.root.display()
            ),
            "stop all programs of this domain, and start them in the same version and as the same user as this one",
        ));
    }
    findings
}

/// Whether a process has been stopped, by a signal or a debugger.
fn is_stopped(pid: u32) -> bool {
    let state = std::fs::read_to_string(format!("/proc/{pid}/stat")).unwrap_or_default();
    // After the program's name, which stands in brackets and may hold anything.
    let state = state.rsplit_once(") ").map_or("", |(_, rest)| rest);
    state.starts_with(['T', 't'])
}
