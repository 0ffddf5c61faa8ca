//! What the robot was told to do in each kind: figure, tables, and the kinds in which that was of two sorts.

use std::fmt::Write;

use kinds_model::Register;
use kinds_trips::Command;

use super::axis::range;
use super::chart::{Axis, Chart, MARGINS_PX, X_PX_PER_TICK, Y_PX_PER_TICK};
use super::drawing::Drawing;
use super::evaluation::{elsewhere, file};
use super::figure::Figure;
use super::kind_style::{KindStyle, called};
use super::markup::{Csv, percent, px};
use super::page::{Column, Page, Table};
use super::scores::signed;
use crate::policy::{CommandSpread, KindCommands, Policy, Spell};
use crate::trip_kinds::TripKinds;

const SIZE_PX: (f64, f64) = (190.0, 130.0);

/// Dots that a panel shows; more would be one blot.
const N_DOTS_MAX: usize = 300;

/// Spells of one sort that the page lists.
const N_SPELLS_MAX: usize = 10;

/// Adds the commands given in each kind, of the trips through one space.
pub fn add_policy(page: &mut Page, space: usize, register: &Register, trips: &[TripKinds], policy: &Policy) {
    page.section(&elsewhere("What the robot was told to do", space));
    if !policy.has_commands() {
        page.paragraph(
            "Nobody knows: there are no commands without geometry_msgs/msg/Twist or geometry_msgs/msg/TwistStamped in the trips.",
        );
        return;
    }
    page.paragraph(
        "The mean command of each kind is a first-pass policy: what to do where the robot finds itself in it. A kind in which the \
         commands were of two sorts allows none: to the sensor its places are one, to whoever steered they were not (the paper's \
         dogs and wolves).",
    );
    page.table(&policy_table(register, policy));
    page.figure(commands(&file("commands", space), "Commands in each kind", register, trips, policy));
    for kind in policy.aliased() {
        add_aliased(page, register, kind);
    }
}

fn add_aliased(page: &mut Page, register: &Register, kind: &KindCommands) {
    page.paragraph(&format!(
        "Kind {} is perceptually aliased; this is where each sort of command shows:",
        register.label(kind.kind)
    ));
    let mut table = Table::new(vec![
        Column::text("command"),
        Column::text("trip"),
        Column::number("from"),
        Column::number("to"),
        Column::number("frames"),
    ]);
    for mode in &kind.modes {
        let command = format!("{}, {} of the frames", in_words(&mode.command), percent(mode.share));
        let mut spells: Vec<&Spell> = mode.spells.iter().collect();
        // The longest tell most; of equals the first.
        spells.sort_by_key(|spell| std::cmp::Reverse(spell.n_frames));
        for spell in spells.iter().take(N_SPELLS_MAX) {
            table.row(vec![
                command.clone(),
                spell.trip.clone(),
                format!("{:.1}\u{a0}s", spell.from_s),
                format!("{:.1}\u{a0}s", spell.to_s),
                spell.n_frames.to_string(),
            ]);
        }
        if spells.len() > N_SPELLS_MAX {
            let rest = format!("and {} shorter times", spells.len() - N_SPELLS_MAX);
            table.row(vec![command.clone(), rest, String::new(), String::new(), String::new()]);
        }
    }
    page.table(&table);
}

/// `0.50 m/s, turning 0.20 rad/s`
fn in_words(command: &CommandSpread) -> String {
    format!("{}\u{a0}m/s, turning {}\u{a0}rad/s", signed(command.forward_m_s), signed(command.turn_rad_s))
}

/// A row for each kind.
pub fn policy_table(register: &Register, policy: &Policy) -> Table {
    let numbers = ["frames", "forward, m/s", "turn, rad/s"].map(Column::number);
    let [first, last] = ["kind", "sorts of command"].map(Column::text);
    let mut table = Table::new([first].into_iter().chain(numbers).chain([last]).collect());
    for kind in &policy.kinds {
        let cells = match &kind.command {
            None => ["–".to_string(), "–".to_string()],
            Some(command) => {
                let [forward, turn] = command.deviations();
                [
                    format!("{} ± {forward:.2}", signed(command.forward_m_s)),
                    format!("{} ± {turn:.2}", signed(command.turn_rad_s)),
                ]
            }
        };
        let sorts = match &kind.modes[..] {
            [] if kind.command.is_none() => "none".to_string(),
            [] => "one".to_string(),
            modes => modes.iter().map(|mode| in_words(&mode.command)).collect::<Vec<_>>().join("; or "),
        };
        let [forward, turn] = cells;
        table.row(vec![register.label(kind.kind), kind.n_frames.to_string(), forward, turn, sorts]);
    }
    table
}

/// Commands of each kind, a panel each: turn to the right, speed upwards.
///
/// * `name`, `title` — of the figure; its files have the name
pub fn commands(
    name: &str,
    title: &str,
    register: &Register,
    trips: &[TripKinds],
    policy: &Policy,
) -> Figure {
    let mut csv = Csv::new(&["trip", "frame", "kind", "forward_m_s", "turn_rad_s", "sort"]);
    let mut of_kinds: Vec<Vec<Command>> = vec![Vec::new(); policy.kinds.len()];
    for (trip, modes) in trips.iter().zip(&policy.modes) {
        let frames = trip.kinds.iter().zip(trip.commands).zip(modes).enumerate();
        for (frame, ((&kind, command), mode)) in frames {
            let Some(command) = command else { continue };
            let sort = mode.map_or(String::new(), |mode| mode.to_string());
            let number = register.number(kind);
            csv.line(&[&trip.title, &frame, &number, &command.forward_m_s, &command.turn_rad_s, &sort]);
            of_kinds[kind].push(*command);
        }
    }
    let all = || of_kinds.iter().flatten();
    let ranges =
        (range(all().map(|command| command.turn_rad_s)), range(all().map(|command| command.forward_m_s)));
    let panels = policy.kinds.iter().filter(|kind| kind.n_frames > 0);
    let heading = |kind: &KindCommands| {
        let sorts = if kind.is_aliased() { ", two sorts" } else { "" };
        format!("{}{sorts}", called(register, kind.kind))
    };
    let panels = panels.map(|kind| panel(&heading(kind), kind, &of_kinds[kind.kind], ranges)).collect();
    let caption = format!(
        "Each dot is a frame's command (of many frames {N_DOTS_MAX}, evenly taken), the cross the mean, the ellipse one standard \
         deviation. Of a kind whose commands are of two sorts, each sort has its own."
    );
    Figure::new(name, title, caption, None, panels, csv)
}

fn panel(
    heading: &str,
    kind: &KindCommands,
    commands: &[Command],
    (turn, forward): ((f64, f64), (f64, f64)),
) -> Drawing {
    let mut chart = Chart::new(
        (SIZE_PX.0 + MARGINS_PX.0, SIZE_PX.1 + MARGINS_PX.1),
        heading,
        // Counter-clockwise is to the left, as the robot sees it.
        Axis {
            title: "turn",
            unit: "rad/s",
            range: (turn.1, turn.0),
            step_min: 0.0,
            px_per_tick: X_PX_PER_TICK,
        },
        Axis { title: "forward", unit: "m/s", range: forward, step_min: 0.0, px_per_tick: Y_PX_PER_TICK },
    );
    let class = KindStyle::of(kind.kind).colour_class();
    let step = commands.len().div_ceil(N_DOTS_MAX).max(1);
    let dots = commands.iter().step_by(step).fold(String::new(), |mut dots, command| {
        let (x, y) = chart.at((command.turn_rad_s, command.forward_m_s));
        write!(dots, "M{} {}h0", px(x), px(y)).expect("a string takes all that is written");
        dots
    });
    chart.drawing.path_with(
        &dots,
        &format!("line round {class}"),
        "stroke-width=\"4\" stroke-opacity=\"0.45\"",
    );
    let spreads: Vec<&CommandSpread> = match &kind.modes[..] {
        [] => kind.command.iter().collect(),
        modes => modes.iter().map(|mode| &mode.command).collect(),
    };
    for spread in spreads {
        let (x, y) = chart.at((spread.turn_rad_s, spread.forward_m_s));
        chart.drawing.path(&format!("M{} {}h12m-6 -6v12", px(x - 6.0), px(y)), "mark", 2.0);
        chart.line(&ellipse(spread), "c0", 1.3);
    }
    chart.drawing
}

/// One standard deviation around the mean: turn and speed of places on it.
fn ellipse(spread: &CommandSpread) -> Vec<(f64, f64)> {
    const N_PLACES: usize = 48;
    let [[ff, ft], [_, tt]] = spread.covariance;
    // Cholesky's factor of the covariance takes a circle there.
    let a = ff.sqrt();
    let b = if a > 0.0 { ft / a } else { 0.0 };
    let c = (tt - b * b).max(0.0).sqrt();
    let place = |step: usize| {
        let (sin, cos) = (std::f64::consts::TAU * step as f64 / N_PLACES as f64).sin_cos();
        (spread.turn_rad_s + b * cos + c * sin, spread.forward_m_s + a * cos)
    };
    (0..=N_PLACES).map(place).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn places_of_the_ellipse_are_one_standard_deviation_away_in_every_direction() {
        let spread =
            CommandSpread { forward_m_s: 0.5, turn_rad_s: -0.2, covariance: [[0.04, -0.01], [-0.01, 0.09]] };
        let determinant = 0.04 * 0.09 - 0.0001;
        for (turn, forward) in ellipse(&spread) {
            let (f, t) = (forward - 0.5, turn + 0.2);
            let mahalanobis = (0.09 * f * f + 2.0 * 0.01 * f * t + 0.04 * t * t) / determinant;
            assert!((mahalanobis - 1.0).abs() < 1e-12, "{turn} {forward}");
        }
        let constant = CommandSpread { covariance: [[0.0; 2]; 2], ..spread };
        assert!(ellipse(&constant).iter().all(|place| *place == (-0.2, 0.5)));
    }
}
