//! Figure of which kinds are most alike: a tree whose leaves are the kinds.

use kinds_model::hierarchy::Merge;
use kinds_model::{Model, Register};

use super::chart::fitted;
use super::drawing::{Drawing, WIDTH_MAX};
use super::figure::Figure;
use super::kind_style::{KindStyle, called};
use super::markup::{Csv, px};

const TOP_PX: f64 = 44.0;
const ROW_PX: f64 = 22.0;
const STEP_PX_MAX: f64 = 46.0;
const SAMPLE_PX: f64 = 22.0;
/// Of the widest letters that a name is fitted by.
const LETTER_PX: f64 = 8.0;
const NAMES_PX_MAX: f64 = 180.0;

/// The tree in which kinds come together, those that frames tell apart least first.
///
/// `None` of a single kind.
pub fn kinds_merged(model: &Model) -> Option<Figure> {
    let merges = &model.manifest().merges;
    let last = merges.len().checked_sub(1)?;
    let register = model.register();
    let mut csv = Csv::new(&["n_groups_left", "first_kind_of_group", "first_kind_of_group_that_joins_it"]);
    for (index, &(into, from)) in merges.iter().enumerate() {
        csv.line(&[&(last + 1 - index), &register.number(into), &register.number(from)]);
    }
    let caption = "From left to right those two groups of kinds come together that the frames tell apart least: by which the entropy \
                   of the responsibilities falls most. A program may ask for the probabilities of as many groups as it wants."
        .to_string();
    Some(Figure::new(
        "kinds-merged",
        "Which kinds are most alike",
        caption,
        None,
        vec![draw(register, merges)],
        csv,
    ))
}

fn draw(register: &Register, merges: &[Merge]) -> Drawing {
    let n_kinds = merges.len() + 1;
    let labels: Vec<String> = (0..n_kinds).map(|kind| called(register, kind)).collect();
    let longest = labels.iter().map(|label| label.chars().count()).max().unwrap_or(0);
    let names_px = (LETTER_PX * longest as f64 + 18.0).min(NAMES_PX_MAX);
    let begin_px = names_px + SAMPLE_PX;
    let step_px = ((WIDTH_MAX - begin_px - 4.0) / merges.len() as f64).min(STEP_PX_MAX);
    let name = "Kinds and groups of them";
    let mut drawing = Drawing::new(WIDTH_MAX, TOP_PX + ROW_PX * n_kinds as f64, name);
    drawing.text((0.0, 13.0), "name", name);
    drawing.text((begin_px, 33.0), "quiet", "fewer and fewer groups →");

    // Where the line of each group ends so far.
    let mut ends = vec![(0.0, 0.0); n_kinds];
    for (row, kind) in leaves(n_kinds, merges).into_iter().enumerate() {
        let y = TOP_PX + ROW_PX * (row as f64 + 0.5);
        drawing.text((names_px - 8.0, y + 4.5), "end", &fitted(&labels[kind], names_px - 8.0));
        let style = KindStyle::of(kind);
        let sample = format!("M{} {}h{}", px(names_px), px(y), px(SAMPLE_PX - 4.0));
        drawing.path_with(&sample, &style.class(), &style.attributes());
        ends[kind] = (begin_px, y);
    }
    for (index, &(into, from)) in merges.iter().enumerate() {
        let x = begin_px + step_px * (index + 1) as f64;
        let ((x_into, y_into), (x_from, y_from)) = (ends[into], ends[from]);
        let [x_into, y_into, x_from, y_from, at] = [x_into, y_into, x_from, y_from, x].map(px);
        drawing.path(&format!("M{x_into} {y_into}H{at}V{y_from}H{x_from}"), "mark", 1.4);
        ends[into] = (x, 0.5 * (ends[into].1 + ends[from].1));
    }
    drawing
}

/// Kinds in an order in which no lines cross: groups that come together stand side by side.
fn leaves(n_kinds: usize, merges: &[Merge]) -> Vec<usize> {
    let mut groups: Vec<Vec<usize>> = (0..n_kinds).map(|kind| vec![kind]).collect();
    for &(into, from) in merges {
        let joined = std::mem::take(&mut groups[from]);
        groups[into].extend(joined);
    }
    groups.swap_remove(0)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn groups_that_come_together_stand_side_by_side() {
        assert_eq!(leaves(1, &[]), [0]);
        assert_eq!(leaves(5, &[(1, 4), (0, 2), (1, 3), (0, 1)]), [0, 2, 1, 4, 3]);
    }
}
