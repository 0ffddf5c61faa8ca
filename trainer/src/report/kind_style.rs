//! How kinds look: a colour and a width for each, as in the paper, so that they are told apart without colour too.

use kinds_model::Register;

use super::chart::fitted;
use super::drawing::{Drawing, WIDTH_MAX};
use super::theme::N_COLOURS;
pub(super) use crate::runs::runs;

/// What the lines of a kind look like.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct KindStyle {
    /// One of [`N_COLOURS`], drawn by a class of `figure.css`.
    colour: usize,
    pub(super) width_px: f64,
    dash: Dash,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Dash {
    Solid,
    Dashed,
    Dotted,
}

const WIDTHS_PX: [f64; 8] = [1.6, 2.3, 3.0, 3.8, 4.6, 5.5, 6.5, 7.5];

/// Which width goes with a colour first. Colours that a colour-blind person sees nearest to each other (orange and
/// yellow, sky blue and reddish purple, vermillion and green) are far apart in width.
const FIRST_WIDTH: [usize; N_COLOURS] = [2, 6, 1, 3, 0, 5, 7, 4];

impl KindStyle {
    /// The style of a kind. All kinds that a model may have differ in colour or width; every eight also change between
    /// solid, dashed and dotted.
    pub(super) fn of(kind: usize) -> Self {
        let (round, colour) = (kind / N_COLOURS, kind % N_COLOURS);
        // 3 has no factor in common with 8: a colour meets each width once before any comes again.
        let width_px = WIDTHS_PX[(FIRST_WIDTH[colour] + 3 * round) % WIDTHS_PX.len()];
        let dash = [Dash::Solid, Dash::Dashed, Dash::Dotted][round % 3];
        Self { colour, width_px, dash }
    }

    /// Classes of `figure.css`.
    pub(super) fn class(&self) -> String {
        let ends = if self.dash == Dash::Dashed { "" } else { " round" };
        format!("line c{}{ends}", self.colour)
    }

    /// The class of the colour alone.
    pub(super) fn colour_class(&self) -> String {
        format!("c{}", self.colour)
    }

    /// Attributes of a line: its width and dashes.
    pub(super) fn attributes(&self) -> String {
        let width = self.width_px;
        match self.dash {
            Dash::Solid => format!("stroke-width=\"{width}\""),
            Dash::Dashed => {
                format!("stroke-width=\"{width}\" stroke-dasharray=\"{:.1} {:.1}\"", width + 4.0, 3.0)
            }
            Dash::Dotted => {
                format!("stroke-width=\"{width}\" stroke-dasharray=\"0.1 {:.1}\"", 1.5 * width + 1.0)
            }
        }
    }
}

/// Draws what each kind's lines look like.
///
/// * `names` — kind and what to say of it
pub(super) fn legend(names: &[(usize, String)]) -> Drawing {
    const SAMPLE_PX: f64 = 26.0;
    const ROW_PX: f64 = 22.0;
    let longest = names.iter().map(|(_, name)| name.chars().count()).max().unwrap_or(0);
    // Letters of 13 px are about 7 px wide.
    let entry_px = SAMPLE_PX + 14.0 + 7.0 * longest as f64;
    let columns = ((WIDTH_MAX / entry_px) as usize).clamp(1, names.len().max(1));
    let rows = names.len().div_ceil(columns);
    let label: Vec<&str> = names.iter().map(|(_, name)| name.as_str()).collect();
    let width = (columns as f64 * entry_px).min(WIDTH_MAX);
    let mut drawing = Drawing::new(width, ROW_PX * rows as f64, &format!("legend: {}", label.join(", ")));
    for (index, (kind, name)) in names.iter().enumerate() {
        let style = KindStyle::of(*kind);
        let x = (index % columns) as f64 * entry_px + 4.0;
        let y = (index / columns) as f64 * ROW_PX + ROW_PX / 2.0;
        drawing.path_with(&format!("M{x} {y}h{}", SAMPLE_PX - 4.0), &style.class(), &style.attributes());
        drawing.text((x + SAMPLE_PX + 4.0, y + 4.5), "", &fitted(name, WIDTH_MAX - SAMPLE_PX - 8.0));
    }
    drawing
}

/// What all kinds are called.
pub(super) fn names(register: &Register) -> Vec<(usize, String)> {
    (0..register.kinds().len()).map(|kind| (kind, called(register, kind))).collect()
}

/// `kind 3 (doorway)`
pub(super) fn called(register: &Register, kind: usize) -> String {
    format!("kind {}", register.label(kind))
}

/// The legend of a figure that has room for numbers alone; none where nobody has named a kind.
pub(super) fn legend_of_names(register: &Register) -> Option<Drawing> {
    let is_named = register.kinds().iter().any(|record| !record.name.is_empty());
    is_named.then(|| legend(&names(register)))
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeSet;

    use kinds_model::N_KINDS_MAX;

    use super::*;

    #[test]
    fn all_kinds_that_a_model_may_have_differ_in_colour_or_width() {
        let looks: BTreeSet<(usize, u64)> = (0..N_KINDS_MAX)
            .map(|kind| (KindStyle::of(kind).colour, KindStyle::of(kind).width_px.to_bits()))
            .collect();
        assert_eq!(looks.len(), N_KINDS_MAX);
    }

    #[test]
    fn the_first_eight_kinds_share_neither_colour_nor_width() {
        let styles: Vec<KindStyle> = (0..N_COLOURS).map(KindStyle::of).collect();
        for (index, style) in styles.iter().enumerate() {
            for other in &styles[..index] {
                assert!(
                    style.colour != other.colour && style.width_px != other.width_px,
                    "{style:?} {other:?}"
                );
            }
        }
    }
}
