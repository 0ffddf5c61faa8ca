//! Figure of where the trained frames lie on the manifold.

use kinds_model::Model;
use kinds_model::mixture::most_probable;

use super::axis::range;
use super::chart::{Axis, Chart, X_PX_PER_TICK, Y_PX_PER_TICK};
use super::drawing::Drawing;
use super::figure::Figure;
use super::kind_style::{KindStyle, legend, names};
use super::markup::{Csv, px};

/// Dots that a picture can show and a file should hold.
const N_POINTS_MAX: usize = 1500;

/// Three stand side by side on a wide page.
const SIZE_PX: (f64, f64) = (282.0, 290.0);

/// Trained frames that are drawn, evenly taken from all: places, shape `(n, n_dims)`, and kinds.
struct Points<'a> {
    frames: Vec<usize>,
    places: Vec<&'a [f64]>,
    kinds: Vec<usize>,
}

/// The embedding in its first three dimensions, seen along each of them, coloured by kind.
pub fn embedding(model: &Model) -> Figure {
    let n_dims = model.manifest().n_dims;
    let points = Points::of(model);
    let pairs: &[(usize, usize)] = match n_dims {
        1 => &[(0, 0)],
        2 => &[(0, 1)],
        _ => &[(0, 1), (0, 2), (1, 2)],
    };
    let panels = pairs.iter().map(|pair| projection(model, &points, *pair)).collect();
    let n_shown = n_dims.min(3);
    let titles = ["frame", "kind", "dimension_1_counts", "dimension_2_counts", "dimension_3_counts"];
    let mut csv = Csv::new(&titles[..2 + n_shown]);
    for ((frame, kind), place) in points.frames.iter().zip(&points.kinds).zip(&points.places) {
        let number = model.register().number(*kind);
        let mut cells: Vec<&dyn std::fmt::Display> = vec![frame, &number];
        cells.extend(place[..n_shown].iter().map(|coordinate| coordinate as &dyn std::fmt::Display));
        csv.line(&cells);
    }
    let (n_trained, n_drawn) = (model.manifest().n_trained, points.frames.len());
    let which = match n_drawn == n_trained {
        true => format!("All {n_trained} frames"),
        false => format!("{n_drawn} of the {n_trained} frames, evenly taken,"),
    };
    let caption = format!(
        "{which} in the first {n_shown} of {n_dims} dimensions, each dot with the colour of its most probable kind. Numbers \
         stand at the means of the kinds. Frames near each other looked alike to the robot."
    );
    let legend = legend(&names(model.register()));
    Figure::new("embedding", "Embedding", caption, Some(legend), panels, csv)
}

impl<'a> Points<'a> {
    fn of(model: &'a Model) -> Self {
        let n_trained = model.manifest().n_trained;
        let n_drawn = n_trained.min(N_POINTS_MAX);
        let frames: Vec<usize> = (0..n_drawn).map(|index| index * n_trained / n_drawn).collect();
        let n_dims = model.manifest().n_dims;
        let places: Vec<&[f64]> =
            frames.iter().map(|frame| &model.coordinates()[frame * n_dims..][..n_dims]).collect();
        let mut probabilities = vec![0.0; model.mixture().n_kinds()];
        let kind = |place: &&[f64]| {
            model.mixture().posterior(place, &mut probabilities);
            most_probable(&probabilities)
        };
        let kinds = places.iter().map(kind).collect();
        Self { frames, places, kinds }
    }
}

fn projection(model: &Model, points: &Points, (across, up): (usize, usize)) -> Drawing {
    let along = |dim: usize| range(points.places.iter().map(move |place| place[dim]));
    let (x_title, y_title) = (format!("dimension {}", across + 1), format!("dimension {}", up + 1));
    let x = Axis {
        title: &x_title,
        unit: "counts",
        range: along(across),
        step_min: 0.0,
        px_per_tick: X_PX_PER_TICK,
    };
    let y =
        Axis { title: &y_title, unit: "counts", range: along(up), step_min: 0.0, px_per_tick: Y_PX_PER_TICK };
    let mut chart = Chart::new(SIZE_PX, &format!("Dimensions {} and {}", across + 1, up + 1), x, y);
    for kind in 0..model.mixture().n_kinds() {
        let of_kind = points.places.iter().zip(&points.kinds).filter(|(_, of)| **of == kind);
        // Lines of no length with round ends: dots, in a third of the bytes.
        let dots: String = of_kind
            .map(|(place, _)| {
                let (x, y) = chart.at((place[across], place[up]));
                format!("M{} {}h0", px(x), px(y))
            })
            .collect();
        if !dots.is_empty() {
            let class = format!("line round {}", KindStyle::of(kind).colour_class());
            chart.drawing.path(&dots, &class, 3.2);
        }
    }
    let n_dims = model.mixture().n_dims();
    for (kind, mean) in model.mixture().means().chunks_exact(n_dims).enumerate() {
        let (x, y) = chart.at((mean[across], mean[up]));
        chart.drawing.text((x, y + 4.5), "name middle halo", &model.register().number(kind).to_string());
    }
    chart.drawing
}
