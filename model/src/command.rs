//! Commands beside readings: what the robot was told to do, as further columns of each frame.
//!
//! The paper proposes to learn from both, so that places which look alike are told apart where the teleoperator acts
//! differently. A command has two components, speed forward and turn. Each becomes a column of counts, linearly between the
//! least and the greatest that training saw, and its squared difference is added to that of the readings with a weight of its
//! own. The weights are chosen when a model is fitted, and by what they do rather than in units of m/s and counts: the
//! commands' part in the mean squared distance between training frames is so many times that of the readings, half by speed
//! and half by turn. So one number means the same for 16 readings and for 19840, for a slow robot and for a fast one.
//!
//! Counts and weights are whole numbers, and so are squared distances with them: exact, and the same on every machine.

use std::fmt;

use serde::{Deserialize, Serialize};

use crate::frames::Frames;
use crate::metric::Metric;

/// A velocity that the robot was told to move with. The default is to stand still.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Command {
    /// Speed forward, metres per second.
    pub forward_m_s: f64,
    /// Turn counter-clockwise, radians per second.
    pub turn_rad_s: f64,
}

/// The commands that frames are compared by, beside their readings.
#[derive(Clone, Debug, PartialEq)]
pub struct Commands {
    /// Their part in the mean squared distance between frames, as a multiple of the readings' part: above 0.
    pub weight: f64,
    /// What the robot had been told when each frame was taken, shape `(n_frames,)`.
    pub of_frames: Vec<Command>,
}

/// Columns that a command adds to a frame: speed forward, then turn.
pub const N_COMMAND_COLUMNS: usize = 2;

/// Bits of a weight behind the point.
const WEIGHT_BITS: u32 = 32;

/// The greatest weight, 2²⁹ counts² of the response for one of the column: then both columns together are at most
/// `2 · 2²⁹ · (2¹⁶ − 1)²`, below 2⁶², and with the readings a squared distance stays below 2⁶⁴ for up to 2³¹ of them.
const WEIGHT_MAX: u64 = 1 << (29 + WEIGHT_BITS);

/// How commands become columns of counts, and what these weigh.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct CommandScale {
    /// What was asked for, see [`Commands::weight`].
    pub weight: f64,
    /// Speed forward, metres per second.
    pub forward: CommandColumn,
    /// Turn counter-clockwise, radians per second.
    pub turn: CommandColumn,
}

/// One component of commands as a column of counts.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct CommandColumn {
    /// The least in training: count 0, as all that is below.
    pub least: f64,
    /// The greatest in training: count 65535, as all that is above.
    pub greatest: f64,
    /// What a squared difference of one count weighs: 2⁻³² counts² of the response's scale. 0 where training saw one value
    /// only, which tells nothing apart.
    pub weight: u64,
}

impl CommandScale {
    /// The scale for the commands of training.
    ///
    /// * `mean_squared` — mean squared distance between two frames by their readings, counts²; see [`mean_squared_distance`]
    pub(crate) fn new(commands: &Commands, mean_squared: f64) -> Self {
        let column = |component: fn(&Command) -> f64| {
            let values: Vec<f64> = commands.of_frames.iter().map(component).collect();
            CommandColumn::new(&values, commands.weight / 2.0 * mean_squared)
        };
        Self {
            weight: commands.weight,
            forward: column(|command| command.forward_m_s),
            turn: column(|command| command.turn_rad_s),
        }
    }

    /// A command as columns of a frame, counts.
    pub fn counts(&self, command: &Command) -> [u16; N_COMMAND_COLUMNS] {
        [self.forward.count(command.forward_m_s), self.turn.count(command.turn_rad_s)]
    }

    /// Frames of readings and commands, from readings alone. In place, since these may be most of the memory there is.
    ///
    /// * `counts` — on the response's scale, shape `(n_frames, n_readings)`
    /// * `commands` — shape `(n_frames,)`
    pub(crate) fn append(&self, mut counts: Vec<u16>, n_readings: usize, commands: &[Command]) -> Frames {
        let n_columns = n_readings + N_COMMAND_COLUMNS;
        counts.resize(commands.len() * n_columns, 0);
        // The last first: its new place overlaps none that has yet to move but its own.
        for (frame_index, command) in commands.iter().enumerate().rev() {
            let to = frame_index * n_columns;
            counts.copy_within(frame_index * n_readings..(frame_index + 1) * n_readings, to);
            counts[to + n_readings..][..N_COMMAND_COLUMNS].copy_from_slice(&self.counts(command));
        }
        Frames::with_more_columns(n_readings, N_COMMAND_COLUMNS, counts)
    }

    /// Whether all numbers can be, in a file that somebody else's program wrote.
    pub(crate) fn is_sound(&self) -> bool {
        let is_sound = |column: &CommandColumn| {
            column.least.is_finite()
                && column.greatest.is_finite()
                && column.least <= column.greatest
                && column.weight <= WEIGHT_MAX
        };
        self.weight > 0.0 && self.weight.is_finite() && is_sound(&self.forward) && is_sound(&self.turn)
    }
}

/// `0.1 times as much as readings: half 0.00 to 0.50 m/s forward, half -0.80 to 0.80 rad/s of turn`
impl fmt::Display for CommandScale {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { weight, forward, turn } = self;
        write!(
            f,
            "{weight} times as much as readings: half {:.2} to {:.2} m/s forward, half {:.2} to {:.2} rad/s of turn",
            forward.least, forward.greatest, turn.least, turn.greatest
        )
    }
}

impl CommandColumn {
    /// * `values` — of training
    /// * `part` — in the mean squared distance between two frames, counts² of the response's scale
    fn new(values: &[f64], part: f64) -> Self {
        let least = values.iter().copied().fold(f64::INFINITY, f64::min);
        let greatest = values.iter().copied().fold(f64::NEG_INFINITY, f64::max);
        let unweighted = Self { least, greatest, weight: 0 };
        let counts: Vec<u16> = values.iter().map(|&value| unweighted.count(value)).collect();
        let mean_squared = mean_squared_difference(&counts);
        if mean_squared == 0.0 {
            return unweighted;
        }
        let units = part / mean_squared * 2_f64.powi(WEIGHT_BITS as i32);
        // Beyond 2⁶⁴ a cast stays there.
        Self { weight: (units.round() as u64).min(WEIGHT_MAX), ..unweighted }
    }

    /// Whether training saw more than one value.
    pub fn varied(&self) -> bool {
        self.least < self.greatest
    }

    fn count(&self, value: f64) -> u16 {
        if !self.varied() {
            return 0;
        }
        let share = (value - self.least) / (self.greatest - self.least);
        // Casts saturate at both ends; what is no number is 0.
        (share * f64::from(u16::MAX)).round() as u16
    }
}

/// Mean of `(a − b)²` over all pairs of counts: `Σ_{i<j} (a_i − a_j)² = N Σ a² − (Σ a)²`.
fn mean_squared_difference(counts: &[u16]) -> f64 {
    let n = counts.len() as u128;
    let sum: u128 = counts.iter().map(|&count| u128::from(count)).sum();
    let squares: u128 = counts.iter().map(|&count| u128::from(count).pow(2)).sum();
    let n_pairs = n * n.saturating_sub(1) / 2;
    (n * squares - sum * sum) as f64 / n_pairs.max(1) as f64
}

/// Frames that the mean distance between readings is taken over: enough for a weight to the percent, and of cameras too
/// a matter of some tenths of a second.
const N_FRAMES_COMPARED: usize = 256;

/// Which of a trip's frames are compared for the weight of commands: at most [`N_FRAMES_COMPARED`] at even steps, ascending.
pub(crate) fn compared(n_frames: usize) -> Vec<usize> {
    let n_compared = n_frames.min(N_FRAMES_COMPARED);
    (0..n_compared).map(|index| index * n_frames / n_compared).collect()
}

/// Mean squared distance over all pairs of frames, counts².
///
/// * `counts` — of those that are [`compared`], on the response's scale, shape `(n, n_readings)`
pub(crate) fn mean_squared_distance(counts: &[u16], n_readings: usize, metric: &impl Metric) -> f64 {
    let rows: Vec<&[u16]> = counts.chunks_exact(n_readings).collect();
    let (mut sum, mut n_pairs) = (0.0, 0_u32);
    for (index, row) in rows.iter().enumerate() {
        for other in &rows[..index] {
            sum += metric.squared_distance(row, other) as f64;
            n_pairs += 1;
        }
    }
    sum / f64::from(n_pairs.max(1))
}

/// Evaluates an expression with the metric that it is, beside commands where frames have them: compiled for each by itself.
macro_rules! with_metric {
    ($any:expr, $commands:expr, |$metric:ident| $body:expr) => {{
        use $crate::metric::AnyMetric::{Euclidean, Ring, Weighted};
        let commands: Option<&$crate::command::CommandScale> = $commands;
        match ($any, commands) {
            (Euclidean($metric), None) => $body,
            (Weighted($metric), None) => $body,
            (Ring($metric), None) => $body,
            (Euclidean(readings), Some(scale)) => {
                let $metric = &$crate::command::WithCommands::new(readings, scale);
                $body
            }
            (Weighted(readings), Some(scale)) => {
                let $metric = &$crate::command::WithCommands::new(readings, scale);
                $body
            }
            (Ring(readings), Some(scale)) => {
                let $metric = &$crate::command::WithCommands::new(readings, scale);
                $body
            }
        }
    }};
}
pub(crate) use with_metric;

/// A metric between readings, and beside it the weighted differences of commands.
///
/// The triangle inequality holds up to rounding weighted differences to whole counts², once for each distance.
#[derive(Clone, Debug)]
pub struct WithCommands<'a, M> {
    readings: &'a M,
    weights: [u64; N_COMMAND_COLUMNS],
}

impl<'a, M> WithCommands<'a, M> {
    pub(crate) fn new(readings: &'a M, scale: &CommandScale) -> Self {
        Self { readings, weights: [scale.forward.weight, scale.turn.weight] }
    }
}

impl<M> WithCommands<'_, M> {
    /// Counts² between two commands.
    fn between_commands(&self, a: &[u16], b: &[u16]) -> u64 {
        let weighted = a.iter().zip(b).zip(self.weights).map(|((&a, &b), weight)| {
            let difference = u128::from(a.abs_diff(b));
            u128::from(weight) * difference * difference
        });
        let rounded = (weighted.sum::<u128>() + (1 << (WEIGHT_BITS - 1))) >> WEIGHT_BITS;
        // Below 2⁶², see [`WEIGHT_MAX`].
        rounded as u64
    }
}

impl<M: Metric> Metric for WithCommands<'_, M> {
    fn squared_distance(&self, a: &[u16], b: &[u16]) -> u64 {
        let [squared] = self.squared_distances(a, [b]);
        squared
    }

    fn squared_distances<const R: usize>(&self, from: &[u16], to: [&[u16]; R]) -> [u64; R] {
        let n_readings = from.len() - N_COMMAND_COLUMNS;
        let mut squared =
            self.readings.squared_distances(&from[..n_readings], to.map(|to| &to[..n_readings]));
        for (squared, to) in squared.iter_mut().zip(to) {
            *squared += self.between_commands(&from[n_readings..], &to[n_readings..]);
        }
        squared
    }

    const IS_EUCLIDEAN_OR_MORE: bool = M::IS_EUCLIDEAN_OR_MORE;
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;
    use crate::metric::Euclidean;

    fn command(forward_m_s: f64, turn_rad_s: f64) -> Command {
        Command { forward_m_s, turn_rad_s }
    }

    /// Readings of `n_readings` a frame, a command for each frame, and a weight.
    fn commanded_frames() -> impl Strategy<Value = (usize, Vec<u16>, Commands)> {
        (1..5_usize, 2..30_usize, 0.01..3.0_f64).prop_flat_map(|(n_readings, n_frames, weight)| {
            let commands = prop::collection::vec((-2.0..2.0_f64, -1.0..1.0_f64), n_frames);
            let of_frames = commands.prop_map(|all| all.into_iter().map(|(a, b)| command(a, b)).collect());
            let commands = of_frames.prop_map(move |of_frames| Commands { weight, of_frames });
            (Just(n_readings), prop::collection::vec(any::<u16>(), n_readings * n_frames), commands)
        })
    }

    /// Mean over all pairs of frames.
    fn mean_over_pairs(n_frames: usize, of_pair: impl Fn(usize, usize) -> f64) -> f64 {
        let pairs = (0..n_frames).flat_map(|a| (0..a).map(move |b| (a, b)));
        pairs.map(|(a, b)| of_pair(a, b)).sum::<f64>() / (n_frames * (n_frames - 1) / 2) as f64
    }

    proptest! {
        #[test]
        fn commands_have_the_weight_that_was_asked_for_and_speed_and_turn_half_of_it_each(
            (n_readings, counts, commands) in commanded_frames(),
        ) {
            let n_frames = commands.of_frames.len();
            let readings = |index: usize| &counts[index * n_readings..][..n_readings];
            let squared = |a: usize, b: usize| Euclidean.squared_distance(readings(a), readings(b)) as f64;
            let of_readings = mean_over_pairs(n_frames, squared);
            let found = mean_squared_distance(&counts, n_readings, &Euclidean);
            prop_assert!((found - of_readings).abs() <= 1e-12 * of_readings);
            prop_assume!(of_readings > 0.0);

            let scale = CommandScale::new(&commands, found);
            let frames = scale.append(counts.clone(), n_readings, &commands.of_frames);
            for (column, weight) in [scale.forward.weight, scale.turn.weight].into_iter().enumerate() {
                let count = |index: usize| f64::from(frames.row(index)[n_readings + column]);
                let mean = mean_over_pairs(n_frames, |a, b| (count(a) - count(b)).powi(2));
                let (part, unit) = (mean * weight as f64 / 2_f64.powi(32), mean / 2_f64.powi(32));
                let expected = commands.weight / 2.0 * of_readings;
                // The weight is rounded to a whole unit.
                prop_assert!((part - expected).abs() <= 0.5 * unit + 1e-9 * expected, "{} {}", part, expected);
            }
        }

        #[test]
        fn distances_with_commands_are_the_formula_rounded_once_and_nothing_else_changes(
            (n_readings, counts, commands) in commanded_frames(),
        ) {
            let scale = CommandScale::new(&commands, mean_squared_distance(&counts, n_readings, &Euclidean));
            let frames = scale.append(counts.clone(), n_readings, &commands.of_frames);
            let metric = WithCommands::new(&Euclidean, &scale);
            prop_assert_eq!((frames.n_readings(), frames.n_columns()), (n_readings, n_readings + 2));
            for (index, command) in commands.of_frames.iter().enumerate() {
                prop_assert_eq!(frames.readings(index), &counts[index * n_readings..][..n_readings]);
                prop_assert_eq!(&frames.row(index)[n_readings..], &scale.counts(command)[..]);
                let (a, b) = (frames.row(index), frames.row(0));
                let weighted = |column: usize, weight: u64| {
                    let difference = f64::from(a[n_readings + column]) - f64::from(b[n_readings + column]);
                    weight as f64 / 2_f64.powi(32) * difference * difference
                };
                let expected = weighted(0, scale.forward.weight) + weighted(1, scale.turn.weight);
                let of_readings = Euclidean.squared_distance(frames.readings(index), frames.readings(0));
                let found = metric.squared_distance(a, b);
                prop_assert!(((found - of_readings) as f64 - expected).abs() <= 0.5 + 1e-12 * expected);
                prop_assert_eq!(found, metric.squared_distance(b, a));
                prop_assert_eq!(metric.squared_distance(a, a), 0);
            }
        }
    }

    #[test]
    fn what_training_never_saw_is_the_nearest_of_what_it_saw() {
        let of_frames = vec![command(-0.5, 1.0), command(1.5, 1.0), command(0.5, 1.0)];
        let scale = CommandScale::new(&Commands { weight: 1.0, of_frames }, 100.0);
        let check = |forward_m_s: f64, expected: u16| {
            assert_eq!(scale.counts(&command(forward_m_s, 7.0)), [expected, 0], "{forward_m_s} m/s");
        };
        check(-0.5, 0);
        check(0.5, 32768);
        check(1.5, u16::MAX);
        check(-9.0, 0);
        check(9.0, u16::MAX);
        check(f64::INFINITY, u16::MAX);
        check(f64::NAN, 0);
    }

    #[test]
    fn a_component_that_never_varied_weighs_nothing_and_leaves_the_other_its_half() {
        let scale = |forward: [f64; 2]| {
            let of_frames = vec![command(forward[0], -1.0), command(forward[1], 1.0)];
            CommandScale::new(&Commands { weight: 0.5, of_frames }, 65535.0 * 65535.0)
        };
        let (one, both) = (scale([0.25, 0.25]), scale([0.25, 0.5]));
        assert_eq!((one.forward.varied(), one.forward.weight), (false, 0));
        // Two frames: a quarter of their squared distance, which is that of the whole range of counts.
        assert_eq!((one.turn.varied(), one.turn.weight), (true, 1 << 30));
        assert_eq!((both.forward.weight, both.turn.weight), (1 << 30, 1 << 30));
    }

    #[test]
    fn the_largest_possible_distances_do_not_overflow() {
        let of_frames = vec![command(0.0, 0.0), command(1.0, 1.0)];
        let scale = CommandScale::new(&Commands { weight: f64::MAX, of_frames }, f64::MAX);
        assert_eq!(scale.forward.weight, WEIGHT_MAX);
        let metric = WithCommands::new(&Euclidean, &scale);
        let (black, white) = (vec![0; 19842], vec![u16::MAX; 19842]);
        let most = (19840 + 2 * (1 << 29)) * 65535_u64.pow(2);
        assert_eq!(metric.squared_distance(&black, &white), most);
    }

    #[test]
    fn numbers_that_cannot_be_are_not_sound() {
        let of_frames = vec![command(0.0, 0.0), command(1.0, 1.0)];
        let sound = CommandScale::new(&Commands { weight: 0.1, of_frames }, 100.0);
        assert!(sound.is_sound());
        let column = |change: fn(&mut CommandColumn)| {
            let mut scale = sound;
            change(&mut scale.turn);
            scale.is_sound()
        };
        assert!(!column(|turn| turn.least = 2.0));
        assert!(!column(|turn| turn.greatest = f64::NAN));
        assert!(!column(|turn| turn.weight = WEIGHT_MAX + 1));
        for weight in [0.0, -1.0, f64::NAN, f64::INFINITY] {
            assert!(!CommandScale { weight, ..sound }.is_sound());
        }
    }
}
