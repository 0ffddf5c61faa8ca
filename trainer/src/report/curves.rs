//! Figures of what the embedding was chosen by: residual variance, and the spectrum.

use kinds_model::{Model, Provenance};

use super::axis::range;
use super::chart::{Axis, Chart, X_PX_PER_TICK, Y_PX_PER_TICK};
use super::drawing::WIDTH_MAX;
use super::figure::Figure;
use super::markup::{Csv, percent};

const SIZE_PX: (f64, f64) = (WIDTH_MAX, 300.0);

/// Line of the method at an index: class and width.
const LINES: [(&str, f64); 4] = [("c5", 2.0), ("c6", 2.0), ("c3", 2.0), ("c0", 2.0)];

/// Residual variance over dimensions, with each curve's elbow and the dimensions kept.
///
/// * `models` — names, and models whose curves to draw: best by different methods on the same frames
pub fn residual_variance(models: &[(&str, &Model)]) -> Figure {
    let curves: Vec<Curve> = models.iter().map(|(name, model)| Curve::of(name, model)).collect();
    draw_residual_variance(&curves)
}

/// Residual variance of one model.
struct Curve<'a> {
    name: &'a str,
    /// For 1, 2, … dimensions.
    variances: &'a [f64],
    /// 0 if nobody has looked for it.
    elbow: usize,
    kept: usize,
}

impl<'a> Curve<'a> {
    fn of(name: &'a str, model: &'a Model) -> Self {
        let Provenance { residual_variance, elbow, .. } = &model.manifest().provenance;
        Self { name, variances: residual_variance, elbow: *elbow, kept: model.manifest().n_dims }
    }

    fn pairs(&self) -> Vec<(f64, f64)> {
        (1_u32..).map(f64::from).zip(self.variances.iter().copied()).collect()
    }

    fn sentence(&self) -> String {
        let Self { name, variances, elbow, kept } = self;
        let bends = if *elbow > 0 { format!("bends at {elbow}, ") } else { String::new() };
        let left =
            variances.get(kept.saturating_sub(1)).map(|variance| format!(", which leave {variance:.4}"));
        format!("{name}: {bends}{kept} kept{}.", left.unwrap_or_default())
    }
}

fn draw_residual_variance(curves: &[Curve]) -> Figure {
    let n_dims_max = curves.iter().map(|curve| curve.variances.len()).max().unwrap_or(0).max(2) as f64;
    let (_, highest) = range(curves.iter().flat_map(|curve| curve.variances).copied());
    let x = Axis {
        title: "dimensions",
        unit: "",
        range: (0.5, n_dims_max + 0.5),
        step_min: 1.0,
        px_per_tick: X_PX_PER_TICK,
    };
    let y = Axis {
        title: "1 − R² of distances before and after embedding",
        unit: "",
        range: (0.0, highest),
        step_min: 0.0,
        px_per_tick: Y_PX_PER_TICK,
    };
    let mut chart = Chart::new(SIZE_PX, "", x, y);
    let mut csv = Csv::new(&["method", "n_dims", "residual_variance", "is_elbow", "is_kept"]);
    for (row, curve) in curves.iter().enumerate() {
        let (class, width_px) = LINES[row % LINES.len()];
        chart.line(&curve.pairs(), class, width_px);
        for (n_dims, pair) in (1..).zip(curve.pairs()) {
            let (is_elbow, is_kept) = (n_dims == curve.elbow, n_dims == curve.kept);
            if is_elbow {
                let place = chart.at(pair);
                chart.drawing.circle(place, 7.5, &format!("line {class}"), 1.5);
            }
            chart.dot(pair, class, if is_kept { 10.0 } else { 4.5 });
            csv.line(&[&curve.name, &n_dims, &pair.1, &is_elbow, &is_kept]);
        }
        chart.name_line(row, curve.name, class, width_px);
    }
    let sentences: Vec<String> = curves.iter().map(Curve::sentence).collect();
    let ring = match curves.iter().any(|curve| curve.elbow > 0) {
        true => " Ring: elbow, where the curve bends.",
        false => "",
    };
    let caption = format!(
        "What the embedding leaves unexplained, by the number of its dimensions.{ring} Large dot: dimensions kept. {}",
        sentences.join(" ")
    );
    Figure::new("residual-variance", "Residual variance", caption, None, vec![chart.drawing], csv)
}

/// The largest eigenvalues of the landmarks' centred products, and the share of the negative ones in all.
pub fn spectrum(model: &Model) -> Figure {
    let provenance = &model.manifest().provenance;
    let (eigenvalues, kept) = (&provenance.eigenvalues, model.manifest().n_dims);
    let (low, high) = range(eigenvalues.iter().copied().chain([0.0]));
    let low = if low < -0.05 * high { low } else { 0.0 };
    let mut chart = Chart::new(
        SIZE_PX,
        "",
        Axis {
            title: "rank",
            unit: "",
            range: (0.5, eigenvalues.len().max(2) as f64 + 0.5),
            step_min: 1.0,
            px_per_tick: X_PX_PER_TICK,
        },
        Axis {
            title: "eigenvalue",
            unit: "counts²",
            range: (low, high),
            step_min: 0.0,
            px_per_tick: Y_PX_PER_TICK,
        },
    );
    let mut csv = Csv::new(&["rank", "eigenvalue_counts2", "is_kept"]);
    for (rank, eigenvalue) in (1..).zip(eigenvalues) {
        let is_kept = rank <= kept;
        let (foot, head) =
            (chart.at((f64::from(rank as u32), 0.0)), chart.at((f64::from(rank as u32), *eigenvalue)));
        let class = if is_kept { "line c5" } else { "line spread" };
        chart.drawing.path_with(
            &super::markup::polyline([foot, head]),
            class,
            if is_kept { "stroke-width=\"6\"" } else { "stroke-width=\"2\"" },
        );
        csv.line(&[&rank, eigenvalue, &is_kept]);
    }
    let caption = format!(
        "Each eigenvalue is the spread of the landmarks along one dimension, the largest {} of {} landmarks; thick: the {kept} \
         dimensions kept. Negative eigenvalues hold {} of the sum of all magnitudes: so far are the distances from those of \
         any flat space.",
        eigenvalues.len(),
        model.landmarks().len(),
        share_in_words(provenance.negative_share)
    );
    Figure::new("spectrum", "Eigenvalue spectrum", caption, None, vec![chart.drawing], csv)
}

/// A share that may be small.
fn share_in_words(share: f64) -> String {
    if share > 0.0 && share < 0.01 { format!("{:.2}\u{a0}%", 100.0 * share) } else { percent(share) }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn elbow_is_ringed_and_the_dimensions_kept_have_the_large_dot() {
        let curve = Curve { name: "Isomap", variances: &[0.5, 0.2, 0.1, 0.09, 0.08], elbow: 3, kept: 5 };
        let figure = draw_residual_variance(&[curve]);
        let svg = figure.to_svg();
        let document = roxmltree::Document::parse(&svg).unwrap();
        let (left, right) = (52.0, WIDTH_MAX - 14.0);
        let n_dims_at = |x: &str| (0.5 + (x.parse::<f64>().unwrap() - left) / (right - left) * 5.0).round();
        let rings: Vec<f64> =
            document.descendants().filter_map(|node| node.attribute("cx")).map(n_dims_at).collect();
        assert_eq!(rings, [3.0]);
        let large = document.descendants().filter(|node| node.attribute("stroke-width") == Some("10"));
        let large: Vec<f64> = large
            .map(|node| n_dims_at(node.attribute("d").unwrap()[1..].split(' ').next().unwrap()))
            .collect();
        assert_eq!(large, [5.0]);
        assert_eq!(
            figure.caption(),
            "What the embedding leaves unexplained, by the number of its dimensions. Ring: elbow, where the curve bends. \
             Large dot: dimensions kept. Isomap: bends at 3, 5 kept, which leave 0.0800."
        );
        assert_eq!(figure.csv().lines().nth(3), Some("Isomap,3,0.1,true,false"));
    }
}
