//! What the robot was told to do, kind by kind: a first-pass policy, and the kinds that allow none.
//!
//! A kind whose commands are of two sorts is *perceptually aliased*: to the sensor the places are one, to the person who
//! steered they were not. No policy that maps kinds to commands can then imitate that person (Grollman, Jenkins & Wood's
//! dogs and wolves; Grollman & Jenkins 2010, *Incremental learning of subtasks from unsegmented demonstration*). [`modes`]
//! says when commands count as of two sorts.
//!
//! Something done once is an event, not an ambiguity. So each sort must come back: at most [`LARGEST_SPELL_MAX`] of its
//! frames may lie in one *spell*, which is what stretches of it less than [`SPELL_GAP_S`] apart are together. Spells are
//! counted, not visits to the kind: who weaves left and right along one corridor is as ambiguous within one visit as who
//! turns left on the first and right on the second.

mod modes;

use std::ops::Range;

use kinds_model::Register;
use kinds_trips::Command;
use serde::{Deserialize, Serialize};

use self::modes::{n_independent, two_modes};
use crate::trip_kinds::TripKinds;

/// Stretches of one sort of command that are nearer than this are one event, seconds.
const SPELL_GAP_S: f64 = 1.0;

/// Most of a sort's frames that one spell may have.
const LARGEST_SPELL_MAX: f64 = 0.9;

/// The commands given within each kind.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Policy {
    /// Titles of the trips.
    pub trips: Vec<String>,
    /// Frames for which nobody knows a command.
    pub n_frames_without_command: usize,
    /// By kind, shape `(n_kinds,)`.
    pub kinds: Vec<KindCommands>,
    /// Of every trip's every frame, the sort of its command, where its kind is aliased. Scripts read spells.
    #[serde(skip)]
    pub modes: Vec<Vec<Option<usize>>>,
}

/// The commands given within one kind.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct KindCommands {
    /// Which kind.
    pub kind: usize,
    /// Frames of it with a command.
    pub n_frames: usize,
    /// As many frames are worth: those whose commands are as good as independent of each other; 0 without frames.
    pub n_frames_effective: f64,
    /// Mean and covariance; `None` without frames.
    pub command: Option<CommandSpread>,
    /// The two sorts of an aliased kind, the more frequent first; empty for any other.
    pub modes: Vec<CommandMode>,
}

/// Mean and covariance of commands.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct CommandSpread {
    /// Mean speed forward, metres per second.
    pub forward_m_s: f64,
    /// Mean turn counter-clockwise, radians per second.
    pub turn_rad_s: f64,
    /// Covariance, divided by the number of frames, shape `(2, 2)`: forward then turn, in the squares and the product
    /// of their units.
    pub covariance: [[f64; 2]; 2],
}

/// One of the two sorts of an aliased kind's commands.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct CommandMode {
    /// Frames.
    pub n_frames: usize,
    /// Their share of the kind's frames.
    pub share: f64,
    /// Mean and covariance of their commands.
    pub command: CommandSpread,
    /// When it shows, in order of time.
    pub spells: Vec<Spell>,
}

/// Frames of one kind and one sort of command that are near each other in time.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Spell {
    /// The trip's title.
    pub trip: String,
    /// When it begins, seconds.
    pub from_s: f64,
    /// When the turn of its last frame is over, seconds.
    pub to_s: f64,
    /// Its first frame.
    pub first_frame_index: usize,
    /// Its last frame.
    pub last_frame_index: usize,
    /// Frames between these that are of the kind and the sort, themselves included.
    pub n_frames: usize,
}

impl Policy {
    /// Finds what was commanded within each kind, over all trips.
    ///
    /// * `seed` — of the fits
    ///
    /// The same on every run for a seed. O(frames) fits of one and two Gaussians for each kind.
    pub fn of(trips: &[TripKinds], n_kinds: usize, seed: u64) -> Self {
        let n_frames: usize = trips.iter().map(TripKinds::n_frames).sum();
        let commands: Vec<Command> = trips.iter().flat_map(|trip| trip.commands).copied().flatten().collect();
        let deviations = CommandSpread::of(&commands).map_or([0.0; 2], |all| all.deviations());
        let mut modes: Vec<Vec<Option<usize>>> =
            trips.iter().map(|trip| vec![None; trip.n_frames()]).collect();
        let kinds = (0..n_kinds)
            .map(|kind| {
                let seen = Seen::of(trips, kind);
                let (of_kind, of_frames) = seen.commands(trips, kind, deviations, seed);
                for (&(trip, frame), mode) in seen.frames.iter().zip(of_frames) {
                    modes[trip][frame] = Some(mode);
                }
                of_kind
            })
            .collect();
        Self {
            trips: trips.iter().map(|trip| trip.title.to_string()).collect(),
            n_frames_without_command: n_frames - commands.len(),
            kinds,
            modes,
        }
    }

    /// Whether any frame has a command.
    pub fn has_commands(&self) -> bool {
        self.kinds.iter().any(|kind| kind.n_frames > 0)
    }

    /// Kinds whose commands are of two sorts.
    pub fn aliased(&self) -> impl Iterator<Item = &KindCommands> {
        self.kinds.iter().filter(|kind| kind.is_aliased())
    }

    /// What a robot may be given to begin with.
    ///
    /// * `model` — id of the model whose kinds these are
    /// * `register` — its register
    pub fn table(&self, model: &str, register: &Register) -> PolicyTable {
        let kinds = self.kinds.iter().map(|kind| KindPolicy::of(kind, register)).collect();
        PolicyTable { model: model.to_string(), trips: self.trips.clone(), kinds }
    }

    /// The table as RON, with what it means.
    pub fn to_ron(&self, model: &str, register: &Register) -> String {
        let pretty = ron::ser::PrettyConfig::new().depth_limit(3).compact_arrays(true).new_line("\n");
        let table = ron::ser::to_string_pretty(&self.table(model, register), pretty)
            .expect("text and numbers are RON");
        format!("{TABLE_IN_WORDS}{table}\n")
    }
}

const TABLE_IN_WORDS: &str = "\
// A first-pass policy: what the robot was told to do, in the mean, within each kind of place.
//
// kind                                         its number, which an update of the model does not change
// forward_m_s, turn_rad_s                      mean speed forward (m/s) and turn counter-clockwise (rad/s)
// forward_deviation_m_s, turn_deviation_rad_s  standard deviations about them (m/s, rad/s)
// n_frames                                     frames of the kind with a command; command: None without any
// aliased                                      true: two sorts of commands were given (modes, with their shares of the
//                                              frames), and their mean is neither; choose one, or tell the kinds apart
";

/// A policy by kind, for a robot to begin with: RON that reads back.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct PolicyTable {
    /// Id of the model whose kinds these are.
    pub model: String,
    /// Titles of the trips that it was taken from.
    pub trips: Vec<String>,
    /// By kind, shape `(n_kinds,)`.
    pub kinds: Vec<KindPolicy>,
}

/// What to do in one kind.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct KindPolicy {
    /// Number of the kind, which an update does not change.
    pub kind: u32,
    /// Frames that say so.
    pub n_frames: usize,
    /// The mean command; `None` where no frame has one.
    pub command: Option<PolicyCommand>,
    /// Whether two sorts of commands were given.
    pub aliased: bool,
    /// Share of the frames and mean command of each sort; empty where there is one.
    pub modes: Vec<(f64, PolicyCommand)>,
}

/// A mean command and how far others were from it.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct PolicyCommand {
    /// Speed forward, metres per second.
    pub forward_m_s: f64,
    /// Turn counter-clockwise, radians per second.
    pub turn_rad_s: f64,
    /// Standard deviation of the speed, metres per second.
    pub forward_deviation_m_s: f64,
    /// Standard deviation of the turn, radians per second.
    pub turn_deviation_rad_s: f64,
}

impl KindPolicy {
    fn of(kind: &KindCommands, register: &Register) -> Self {
        Self {
            kind: register.number(kind.kind),
            n_frames: kind.n_frames,
            command: kind.command.as_ref().map(PolicyCommand::of),
            aliased: kind.is_aliased(),
            modes: kind.modes.iter().map(|mode| (mode.share, PolicyCommand::of(&mode.command))).collect(),
        }
    }
}

impl PolicyCommand {
    fn of(spread: &CommandSpread) -> Self {
        let &CommandSpread { forward_m_s, turn_rad_s, .. } = spread;
        let [forward_deviation_m_s, turn_deviation_rad_s] = spread.deviations();
        Self { forward_m_s, turn_rad_s, forward_deviation_m_s, turn_deviation_rad_s }
    }
}

impl KindCommands {
    /// Whether its commands are of two sorts.
    pub fn is_aliased(&self) -> bool {
        !self.modes.is_empty()
    }
}

impl CommandSpread {
    /// Mean and covariance; `None` without commands.
    pub fn of(commands: &[Command]) -> Option<Self> {
        let n = commands.len() as f64;
        let mean = |of: fn(&Command) -> f64| commands.iter().map(of).sum::<f64>() / n;
        let (forward_m_s, turn_rad_s) =
            (mean(|command| command.forward_m_s), mean(|command| command.turn_rad_s));
        let mut covariance = [[0.0; 2]; 2];
        for command in commands {
            let from_mean = [command.forward_m_s - forward_m_s, command.turn_rad_s - turn_rad_s];
            for (row, a) in covariance.iter_mut().zip(from_mean) {
                row.iter_mut().zip(from_mean).for_each(|(entry, b)| *entry += a * b / n);
            }
        }
        (n > 0.0).then_some(Self { forward_m_s, turn_rad_s, covariance })
    }

    /// Standard deviations of forward, metres per second, and turn, radians per second.
    pub fn deviations(&self) -> [f64; 2] {
        [self.covariance[0][0].sqrt(), self.covariance[1][1].sqrt()]
    }
}

/// The frames of one kind with a command, over all trips.
struct Seen {
    /// Trip and frame.
    frames: Vec<(usize, usize)>,
    commands: Vec<Command>,
}

impl Seen {
    fn of(trips: &[TripKinds], kind: usize) -> Self {
        let of_trip = |(trip_index, trip): (usize, &TripKinds)| {
            assert_eq!(trip.commands.len(), trip.n_frames(), "a command, or none, for each frame");
            let both = trip.kinds.iter().zip(trip.commands).enumerate();
            let of_kind = both.filter(|(_, (of, _))| **of == kind);
            of_kind
                .filter_map(|(frame, (_, command))| Some(((trip_index, frame), (*command)?)))
                .collect::<Vec<_>>()
        };
        let (frames, commands) = trips.iter().enumerate().flat_map(of_trip).unzip();
        Self { frames, commands }
    }

    /// What was commanded, and the sort of each frame; no sorts if there is one.
    fn commands(
        &self,
        trips: &[TripKinds],
        kind: usize,
        deviations: [f64; 2],
        seed: u64,
    ) -> (KindCommands, Vec<usize>) {
        let n_frames = self.frames.len();
        let command = CommandSpread::of(&self.commands);
        if n_frames == 0 {
            return (
                KindCommands { kind, n_frames, n_frames_effective: 0.0, command, modes: Vec::new() },
                Vec::new(),
            );
        }
        let points = self.scaled(deviations);
        let n_frames_effective = n_independent(
            &points,
            &self.parts(|a, b| a.0 == b.0 && a.1 + 1 == b.1),
            &self.parts(|a, b| a.0 == b.0),
        );
        let (modes, of_frames) = two_modes(&points, n_frames_effective, seed)
            .and_then(|found| self.recurring(trips, found))
            .unzip();
        let modes = modes.unwrap_or_default();
        (KindCommands { kind, n_frames, n_frames_effective, command, modes }, of_frames.unwrap_or_default())
    }

    /// Each component in deviations of all commands, shape `(n_frames, 2)`. One that never changes says nothing.
    fn scaled(&self, deviations: [f64; 2]) -> Vec<f64> {
        let scaled = |value: f64, deviation: f64| if deviation > 0.0 { value / deviation } else { 0.0 };
        let both = |command: &Command| {
            [scaled(command.forward_m_s, deviations[0]), scaled(command.turn_rad_s, deviations[1])]
        };
        self.commands.iter().flat_map(both).collect()
    }

    /// Numbers of frames that hang together.
    fn parts(&self, hangs: fn(&(usize, usize), &(usize, usize)) -> bool) -> Vec<usize> {
        self.frames.chunk_by(hangs).map(<[_]>::len).collect()
    }

    /// The two sorts, the more frequent first, and which is each frame's; `None` if one of them does not come back.
    fn recurring(
        &self,
        trips: &[TripKinds],
        mut found: Vec<usize>,
    ) -> Option<(Vec<CommandMode>, Vec<usize>)> {
        if 2 * found.iter().sum::<usize>() > found.len() {
            found.iter_mut().for_each(|mode| *mode = 1 - *mode);
        }
        let modes: Vec<CommandMode> =
            (0..2).map(|mode| self.mode(trips, &found, mode)).collect::<Option<_>>()?;
        let recurs = |mode: &CommandMode| {
            let largest = mode.spells.iter().map(|spell| spell.n_frames).max().unwrap_or(0);
            largest as f64 <= LARGEST_SPELL_MAX * mode.n_frames as f64
        };
        modes.iter().all(recurs).then_some((modes, found))
    }

    fn mode(&self, trips: &[TripKinds], of_frames: &[usize], mode: usize) -> Option<CommandMode> {
        let is_of = |index: &usize| of_frames[*index] == mode;
        let members: Vec<usize> = (0..self.frames.len()).filter(is_of).collect();
        let commands: Vec<Command> = members.iter().map(|&index| self.commands[index]).collect();
        let frames: Vec<(usize, usize)> = members.iter().map(|&index| self.frames[index]).collect();
        Some(CommandMode {
            n_frames: members.len(),
            share: members.len() as f64 / self.frames.len() as f64,
            command: CommandSpread::of(&commands)?,
            spells: spells(trips, &frames),
        })
    }
}

/// Cuts frames of one sort, in order of trip and time, where more than [`SPELL_GAP_S`] passes between two.
fn spells(trips: &[TripKinds], frames: &[(usize, usize)]) -> Vec<Spell> {
    let is_near = |a: &(usize, usize), b: &(usize, usize)| {
        let gap_s = || trips[b.0].seconds[b.1] - trips[a.0].turn_s(a.1 + 1);
        a.0 == b.0 && (a.1 + 1 == b.1 || gap_s() < SPELL_GAP_S)
    };
    let spell = |part: &[(usize, usize)]| {
        let (trip, Range { start, end }) = (&trips[part[0].0], part[0].1..part[part.len() - 1].1 + 1);
        Spell {
            trip: trip.title.to_string(),
            from_s: trip.seconds[start],
            to_s: trip.turn_s(end),
            first_frame_index: start,
            last_frame_index: end - 1,
            n_frames: part.len(),
        }
    };
    frames.chunk_by(is_near).map(spell).collect()
}

#[cfg(test)]
mod tests;
