//! Figure of the canonical view of each kind: rays for rings of ranges, images for cameras.

use kinds_model::{Model, ResponsePlan, SensorLayout};

use super::canonical::{Unit, View, Views};
use super::chart::fitted;
use super::drawing::Drawing;
use super::figure::Figure;
use super::markup::{Csv, percent};
use super::{depth, rays};

/// What each kind looks like to the robot: mean, difference from the mean of all frames, spread and medoid.
pub fn canonical_views(model: &Model) -> Figure {
    let (layout, views) = (model.layout(), Views::of(model));
    let unit = views.unit.name();
    let (legend, panels, how) = match layout.has_rings() {
        true => rays::draw(layout, &views),
        false => depth::draw(layout, &views),
    };
    let frame = match model.references().is_all() {
        true => "frame",
        false => "frame (seen as the reference frame nearest to it)",
    };
    let scale = scale_in_words(&views.unit, &model.manifest().plan.response);
    let known = match model.whitening() {
        None => "",
        Some(_) => {
            " The model keeps slow directions of frames, not their readings: a frame is drawn as far as these say what it \
             looked like."
        }
    };
    let caption = format!(
        "{how} The mean weighs every {frame} with its probability of being of the kind, the medoid is the real frame of \
         the kind that is nearest to it.{known} {scale}"
    );
    let csv = table(unit, layout, &views);
    Figure::new("canonical-views", "What each kind looks like", caption, Some(legend), panels, csv)
}

fn scale_in_words(unit: &Unit, plan: &ResponsePlan) -> String {
    let (longest_m, invalid_m) = (short(plan.range_m_max), short(plan.invalid_range_m));
    match unit {
        Unit::Metres(_) => format!(
            "Means are taken on the scale on which frames are compared and mapped back to metres; readings beyond \
             {longest_m} m stand for {longest_m} m, invalid ones for {invalid_m} m."
        ),
        Unit::Counts => {
            "Numbers are counts on the scale on which frames are compared, which does not map back to metres."
                .to_string()
        }
    }
}

/// An empty panel with its heading, which leaves room for a few words beside it: `kind 3 (doorway) · 24 %`.
pub(super) fn panel((width, height): (f64, f64), view: &View) -> Drawing {
    const NAME_PX: f64 = 220.0;
    let heading = |name: &str| format!("{name} · {}", percent(view.share));
    let says = format!("{}: mean, difference, spread and medoid", heading(&view.name));
    let mut drawing = Drawing::new(width, height, &says);
    drawing.text((0.0, 13.0), "name", &heading(&fitted(&view.name, NAME_PX)));
    drawing
}

/// At most two decimals, and none for nothing.
fn short(value: f64) -> String {
    super::markup::px(value)
}

fn table(unit: &str, layout: SensorLayout, views: &Views) -> Csv {
    let titles = ["mean", "difference", "low", "high", "medoid"].map(|title| format!("{title}_{unit}"));
    let mut all = vec!["kind", "row", "column"];
    all.extend(titles.iter().map(String::as_str));
    let mut csv = Csv::new(&all);
    let columns = layout.columns as usize;
    // A tenth of a millimetre is less than any sensor's count; full digits would make megabytes of a camera's table.
    let cell = |value: f64| format!("{value:.4}");
    for view in &views.of_kinds {
        for reading in 0..layout.n_readings() {
            let (low, high) = view.around[reading];
            csv.line(&[
                &view.number,
                &(reading / columns),
                &(reading % columns),
                &cell(view.mean[reading]),
                &cell(view.difference[reading]),
                &cell(low),
                &cell(high),
                &cell(view.medoid[reading]),
            ]);
        }
    }
    csv
}

#[cfg(test)]
mod tests {
    use kinds_model::Scale;

    use super::*;

    #[test]
    fn numbers_that_are_no_ranges_are_said_to_be_counts() {
        assert_eq!(
            scale_in_words(&Unit::Counts, &ResponsePlan::new(Scale::Range, 4.0)),
            "Numbers are counts on the scale on which frames are compared, which does not map back to metres."
        );
    }
}
