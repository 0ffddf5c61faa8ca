//! What can be seen of the sensors of a domain, over time. Each health channel is opened once, and read as long as somebody
//! else has it open. Where there is no service, but an end of a bridge, kinds are read instead.

use std::collections::BTreeMap;
use std::time::{Duration, Instant};

use kinds_messages::{
    Census, Domain, FoundChannel, HealthReader, HealthReport, KindReport, Life, Node, Program, Purpose,
    ReportStatus, SensorName, monotonic_ns,
};

use crate::commands::BRIDGE;
use crate::commands::top::passed_on::{Bridged, PassedOn};
use crate::failure::Failure;
use crate::kind_names::KindNames;

/// As which this program joins. Programs of this name look on, and are not counted as connected.
const NAME: &str = "kinds-top";

/// How long a sensor is shown after its last program has gone.
const MEMORY: Duration = Duration::from_secs(60);

/// A service that has said nothing for so long stands still: it should have three times.
pub(crate) const SILENCE: Duration = Duration::from_secs(3);

/// Watches all sensors of a domain.
pub(crate) struct Observer {
    pub(crate) domain: Domain,
    /// Of kinds of models that may be in use.
    pub(crate) names: KindNames,
    node: Node,
    pub(crate) sensors: BTreeMap<SensorName, Seen>,
}

/// What is seen of a sensor.
pub(crate) struct Seen {
    /// Who lives and has a channel of it open, by process, onlookers left out.
    pub(crate) programs: Vec<Program>,
    /// The end at which its service is heard; an error in words if it cannot be opened or read, none where there is nobody to
    /// hear.
    reader: Option<Result<HealthReader, String>>,
    /// What the service that is there has said last.
    said: Option<Said>,
    /// The end at which the kinds of another machine's service are heard, likewise; none where one is here, or no bridge is.
    bridged: Option<Result<Bridged, String>>,
    last_inhabited: Instant,
}

/// What a service has said.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(crate) struct Said {
    pub(crate) health: HealthReport,
    /// What it had said before.
    pub(crate) before: Option<HealthReport>,
}

/// How a sensor is served.
#[derive(Debug, PartialEq)]
pub(crate) enum Service<'a> {
    /// By nobody.
    None,
    /// By one whose health, or kinds, cannot be read: why, in words.
    Unreadable(&'a str),
    /// By one that has said nothing yet.
    Mute,
    /// By one that has, and when that was.
    Heard { said: &'a Said, age: Duration },
    /// By one on another machine.
    Elsewhere(&'a PassedOn),
}

/// What is known of the last frame.
#[derive(Debug, PartialEq)]
pub(crate) struct LastFrame {
    pub(crate) model_id: [u8; 16],
    pub(crate) status: ReportStatus,
    /// The kind's number.
    pub(crate) kind: u32,
    pub(crate) probability: f64,
    pub(crate) novelty: f64,
}

impl LastFrame {
    pub(crate) fn of_health(health: &HealthReport) -> Option<Self> {
        health.last_status().map(|status| Self {
            model_id: health.model_id,
            status,
            kind: health.last_kind,
            probability: health.last_probability,
            novelty: health.last_novelty,
        })
    }

    pub(crate) fn of_report(report: &KindReport) -> Self {
        Self {
            model_id: report.model_id,
            status: report.status(),
            kind: report.number(report.kind),
            probability: report.probabilities().get(report.kind as usize).copied().unwrap_or_default(),
            novelty: report.novelty,
        }
    }
}

impl Service<'_> {
    /// What is known of the last frame, if there was one.
    pub(crate) fn last_frame(&self) -> Option<LastFrame> {
        match self {
            Self::Heard { said, .. } => LastFrame::of_health(&said.health),
            Self::Elsewhere(passed_on) => passed_on.last().map(LastFrame::of_report),
            Self::None | Self::Unreadable(_) | Self::Mute => None,
        }
    }
}

impl Observer {
    pub(crate) fn join(domain: Domain, names: KindNames) -> Result<Self, Failure> {
        let node = Node::open(&domain, NAME)?;
        Ok(Self { domain, names, node, sensors: BTreeMap::new() })
    }

    /// Looks who is there.
    pub(crate) fn look(&mut self) -> Result<(), Failure> {
        // A service that was killed counts as there until somebody has cleaned up after it.
        self.node.clean_up_dead_nodes();
        let census = self.domain.roll_call()?;
        for channel in &census.channels {
            self.sensors.entry(channel.sensor.clone()).or_insert_with(Seen::nothing);
        }
        for (sensor, seen) in &mut self.sensors {
            seen.look(&self.node, &census, sensor);
        }
        self.sensors.retain(|_, seen| seen.last_inhabited.elapsed() < MEMORY);
        Ok(())
    }

    /// Takes what services have said.
    pub(crate) fn receive(&mut self) {
        self.sensors.values_mut().for_each(Seen::receive);
    }

    /// Whether a service is there that has said nothing yet, or of which nobody can tell yet how much it says.
    pub(crate) fn waits_for_first_words(&self) -> bool {
        self.sensors.values().any(|seen| match seen.service() {
            Service::Mute => true,
            Service::Elsewhere(passed_on) => passed_on.rate_hz(Instant::now()).is_none(),
            Service::None | Service::Unreadable(_) | Service::Heard { .. } => false,
        })
    }
}

impl Seen {
    fn nothing() -> Self {
        // Of a sensor whose only channels are left over, nothing is shown.
        let long_ago = Instant::now().checked_sub(MEMORY).unwrap_or_else(Instant::now);
        Self { programs: Vec::new(), reader: None, said: None, bridged: None, last_inhabited: long_ago }
    }

    fn look(&mut self, node: &Node, census: &Census, sensor: &SensorName) {
        self.programs = connected(census.channels_of(sensor).flat_map(|channel| &channel.programs));
        if !self.programs.is_empty() {
            self.last_inhabited = Instant::now();
        }
        let who_has = |purpose| census.channel(sensor, purpose).map_or(Vec::new(), others);
        if who_has(Purpose::Health).is_empty() {
            // Nobody else needs the channel: it goes with our end.
            (self.reader, self.said) = (None, None);
        } else if self.reader.is_none() {
            self.reader = Some(HealthReader::open(node, sensor).map_err(|error| error.to_string()));
        }
        // One at the robot's end only reads the kinds: whether they come from there, their channel tells.
        let is_bridge = |program: &Program| program.name.as_deref() == Some(BRIDGE);
        let is_served_here = matches!(&self.reader, Some(Ok(reader)) if reader.is_published());
        if is_served_here || !who_has(Purpose::Kinds).iter().any(is_bridge) {
            self.bridged = None;
        } else if self.bridged.is_none() {
            self.bridged = Some(Bridged::open(node, sensor));
        }
    }

    fn receive(&mut self) {
        if let Some(Ok(bridged)) = &mut self.bridged
            && let Err(error) = bridged.receive()
        {
            self.bridged = Some(Err(error));
        }
        while let Some(Ok(reader)) = &self.reader {
            match reader.receive() {
                Ok(Some(health)) => self.hear(health),
                Ok(None) if reader.is_published() => break,
                Ok(None) => {
                    // Last words of one that is gone.
                    self.said = None;
                    break;
                }
                Err(error) => self.reader = Some(Err(error.to_string())),
            }
        }
    }

    fn hear(&mut self, health: HealthReport) {
        // Another service counts anew.
        let before = self.said.map(|said| said.health).filter(|before| before.uptime_ns < health.uptime_ns);
        self.said = Some(Said { health, before });
    }

    pub(crate) fn service(&self) -> Service<'_> {
        match (self.service_here(), &self.bridged) {
            (Service::None, Some(Ok(bridged))) if bridged.is_there() => {
                Service::Elsewhere(&bridged.passed_on)
            }
            (Service::None, Some(Err(error))) => Service::Unreadable(error),
            (here, _) => here,
        }
    }

    fn service_here(&self) -> Service<'_> {
        match (&self.reader, &self.said) {
            (None, _) => Service::None,
            (Some(Err(error)), _) => Service::Unreadable(error),
            (Some(Ok(reader)), None) if !reader.is_published() => Service::None,
            (Some(Ok(_)), None) => Service::Mute,
            (Some(Ok(_)), Some(said)) => {
                let age_ns = monotonic_ns().saturating_sub(said.health.sent_monotonic_ns);
                Service::Heard { said, age: Duration::from_nanos(age_ns) }
            }
        }
    }
}

/// Who else has a channel open.
fn others(channel: &FoundChannel) -> Vec<Program> {
    connected(&channel.programs)
}

/// Those that live and do not just look on, by process.
fn connected<'a>(programs: impl IntoIterator<Item = &'a Program>) -> Vec<Program> {
    let is_connected =
        |program: &&Program| program.life == Life::Alive && program.name.as_deref() != Some(NAME);
    let mut connected: Vec<Program> = programs.into_iter().filter(is_connected).cloned().collect();
    connected.sort_by_key(|program| program.pid);
    connected.dedup();
    connected
}

#[cfg(test)]
mod tests {
    use kinds_messages::{HealthPublisher, OwnDomain, ReportPublisher, ReportReader};

    use super::*;

    fn look(observer: &mut Observer) {
        observer.look().unwrap();
        observer.receive();
    }

    fn health(uptime_ns: u64, n_lost: u64) -> HealthReport {
        HealthReport { uptime_ns, n_lost, sent_monotonic_ns: monotonic_ns(), ..HealthReport::default() }
    }

    #[test]
    fn a_sensor_is_served_elsewhere_where_an_end_of_a_bridge_has_the_services_place() {
        let domain = OwnDomain::make().unwrap();
        let sensor: SensorName = "crunch/ring".parse().unwrap();
        let mut observer = Observer::join((*domain).clone(), KindNames::default()).unwrap();
        let node = Node::open(&domain, BRIDGE).unwrap();

        // The robot's end reads kinds before there are any.
        let near = ReportReader::open(&node, &sensor).unwrap();
        look(&mut observer);
        assert_eq!(observer.sensors[&sensor].service(), Service::None);

        let far = ReportPublisher::create(&node, &sensor).unwrap();
        let mut report = KindReport::default();
        (report.status, report.novelty, report.model_id) = (KindReport::CLASSIFIED, 0.5, [3; 16]);
        report.set_kinds([4, 9].into_iter(), [(0, 1)].into_iter());
        report.set_probabilities(&[0.25, 0.75], &[0.25, 0.75]);
        report.kind = 1;
        far.pass_on(&report).unwrap();
        look(&mut observer);
        let seen = &observer.sensors[&sensor];
        let Service::Elsewhere(passed_on) = seen.service() else { panic!("{:?}", seen.service()) };
        assert_eq!(passed_on.last().map(KindReport::as_bytes), Some(report.as_bytes()));
        let status = ReportStatus::Classified;
        let last = LastFrame { model_id: [3; 16], status, kind: 9, probability: 0.75, novelty: 0.5 };
        assert_eq!(seen.service().last_frame(), Some(last));
        assert!(observer.waits_for_first_words(), "nobody can tell its rate yet");

        // A service that is here itself is heard before the bridge.
        let health_of_own = HealthPublisher::create(&node, &sensor).unwrap();
        look(&mut observer);
        assert_eq!(observer.sensors[&sensor].service(), Service::Mute);
        look(&mut observer);
        assert!(observer.sensors[&sensor].bridged.is_none());

        drop((near, far, health_of_own, node));
        look(&mut observer);
        assert_eq!(observer.sensors[&sensor].service(), Service::None);
        look(&mut observer);
        assert!(domain.roll_call().unwrap().channels.is_empty(), "no channel is kept for its own sake");
    }

    #[test]
    fn a_service_is_heard_while_it_is_there_and_its_sensor_remembered_when_it_is_gone() {
        let domain = OwnDomain::make().unwrap();
        let sensor: SensorName = "crunch/ring".parse().unwrap();
        let mut observer = Observer::join((*domain).clone(), KindNames::default()).unwrap();
        look(&mut observer);
        assert!(observer.sensors.is_empty());

        let node = Node::open(&domain, "service").unwrap();
        let service = HealthPublisher::create(&node, &sensor).unwrap();
        look(&mut observer);
        assert_eq!(observer.sensors[&sensor].service(), Service::Mute);
        assert!(observer.waits_for_first_words());
        let [first, second] = [health(1, 0), health(2, 3)];
        for (said, before) in [(first, None), (second, Some(first))] {
            service.send(&said).unwrap();
            observer.receive();
            let Service::Heard { said: heard, .. } = observer.sensors[&sensor].service() else {
                panic!("the service is not heard")
            };
            assert_eq!(*heard, Said { health: said, before });
        }
        look(&mut observer);
        let names =
            |seen: &Seen| seen.programs.iter().map(|program| program.name.clone()).collect::<Vec<_>>();
        assert_eq!(names(&observer.sensors[&sensor]), [Some("service".to_string())]);

        // Another one of the same sensor counts anew.
        drop(service);
        let service = HealthPublisher::create(&node, &sensor).unwrap();
        service.send(&first).unwrap();
        look(&mut observer);
        assert_eq!(observer.sensors[&sensor].said, Some(Said { health: first, before: None }));

        drop((service, node));
        look(&mut observer);
        let gone = &observer.sensors[&sensor];
        assert_eq!((gone.service(), gone.programs.len()), (Service::None, 0));
        look(&mut observer);
        assert!(domain.roll_call().unwrap().channels.is_empty(), "the channel is not kept for its own sake");
    }
}
