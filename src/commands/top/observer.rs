//! What can be seen of the sensors of a domain, over time. Each health channel is opened once, and read as long as somebody
//! else has it open.

use std::collections::BTreeMap;
use std::time::{Duration, Instant};

use kinds_messages::{
    Census, Domain, HealthReader, HealthReport, Life, Node, Program, Purpose, SensorName, monotonic_ns,
};

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
    /// By one whose health cannot be read: why, in words.
    Unreadable(&'a str),
    /// By one that has said nothing yet.
    Mute,
    /// By one that has, and when that was.
    Heard { said: &'a Said, age: Duration },
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

    /// Whether a service is there that has said nothing yet.
    pub(crate) fn waits_for_first_words(&self) -> bool {
        self.sensors.values().any(|seen| seen.service() == Service::Mute)
    }
}

impl Seen {
    fn nothing() -> Self {
        // Of a sensor whose only channels are left over, nothing is shown.
        let long_ago = Instant::now().checked_sub(MEMORY).unwrap_or_else(Instant::now);
        Self { programs: Vec::new(), reader: None, said: None, last_inhabited: long_ago }
    }

    fn look(&mut self, node: &Node, census: &Census, sensor: &SensorName) {
        self.programs = connected(census.channels_of(sensor).flat_map(|channel| &channel.programs));
        if !self.programs.is_empty() {
            self.last_inhabited = Instant::now();
        }
        let health = census.channel(sensor, Purpose::Health);
        let is_open_elsewhere = health.is_some_and(|channel| !connected(&channel.programs).is_empty());
        if !is_open_elsewhere {
            // Nobody else needs the channel: it goes with our end.
            (self.reader, self.said) = (None, None);
        } else if self.reader.is_none() {
            self.reader = Some(HealthReader::open(node, sensor).map_err(|error| error.to_string()));
        }
    }

    fn receive(&mut self) {
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
    use kinds_messages::{HealthPublisher, OwnDomain};

    use super::*;

    fn look(observer: &mut Observer) {
        observer.look().unwrap();
        observer.receive();
    }

    fn health(uptime_ns: u64, n_lost: u64) -> HealthReport {
        HealthReport { uptime_ns, n_lost, sent_monotonic_ns: monotonic_ns(), ..HealthReport::default() }
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
