//! `kinds bridge`: an end of the way on which a sensor's kinds come to another machine.

use kinds_bridge::{Arrived, FarEnd, NearEnd, Sent};
use kinds_messages::Node;

use crate::cli::{BridgeArguments, BridgePlan, End};
use crate::commands::BRIDGE;
use crate::failure::Failure;
use crate::notify::Supervisor;
use crate::say::mention;
use crate::{log, stop};

pub(crate) fn run(arguments: &BridgeArguments) -> Result<(), Failure> {
    let stop = stop::on_signals()?;
    let BridgePlan { sensor, end } = arguments.plan()?;
    let supervisor = Supervisor::from_environment();
    let node = Node::open(&arguments.domain.domain(), BRIDGE)?;
    let mut tell = |words: String| log::notice(words);
    let said = match &end {
        End::Near(endpoint) => {
            let mut near = NearEnd::listen(&node, &sensor, endpoint)?;
            begin(&supervisor, format!("sending the kinds of {sensor} to whoever connects to {endpoint}"))?;
            let sent = near.run(&stop, &mut tell, &mut |sent| supervisor.alive(words_on_sent(sent)));
            sent.map(|sent| words_on_sent(&sent))
        }
        End::Far(endpoint) => {
            let mut far = FarEnd::connect(&node, &sensor, endpoint)?;
            begin(&supervisor, format!("passing on the kinds of {sensor} from {endpoint}"))?;
            let arrived =
                far.run(&stop, &mut tell, &mut |arrived| supervisor.alive(words_on_arrived(arrived)));
            arrived.map(|arrived| words_on_arrived(&arrived))
        }
    };
    supervisor.stopping();
    mention(said?)
}

fn begin(supervisor: &Supervisor, does: String) -> Result<(), Failure> {
    supervisor.ready(&does);
    mention(does)
}

fn words_on_sent(sent: &Sent) -> String {
    let Sent { n_sent, n_left_out } = sent;
    format!("sent {n_sent} reports; {n_left_out} were left out, since the link would not take them in time")
}

fn words_on_arrived(arrived: &Arrived) -> String {
    let Arrived { n_passed_on, n_lost, n_refused } = arrived;
    format!("passed on {n_passed_on} reports; {n_lost} were lost on the way, {n_refused} were refused")
}
