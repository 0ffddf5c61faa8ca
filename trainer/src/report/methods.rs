//! Models of the same frames by different methods, side by side: the paper's Table 1, and how alike their kinds are.

use kinds_model::{Model, Provenance};

use super::canonical::responsibilities;
use super::page::{Column, Page, Table};
use crate::agreement::adjusted_mutual_information;
use crate::runs::Runs;

/// Adds models of the same frames side by side.
///
/// * `models` — names, and models; the first is the one that others are compared with
pub fn add_methods(page: &mut Page, models: &[(&str, &Model)]) {
    page.section("By method");
    page.paragraph(
        "Residual variance is that of each method's own distances: along the manifold for Isomap, straight for PCA. A kind \
         lasts for the mean number of successive frames of one kind. AMI is the adjusted mutual information between a \
         method's kinds and the first one's: 0 where they agree by chance alone, 1 where they are the same by other names.",
    );
    page.table(&method_table(models));
}

/// The table of [`add_methods`].
pub fn method_table(models: &[(&str, &Model)]) -> Table {
    let mut table = Table::new(vec![
        Column::text("method"),
        Column::number("readings"),
        Column::number("dimensions"),
        Column::number("kinds"),
        Column::number("residual variance"),
        Column::number("largest kind"),
        Column::number("a kind lasts"),
        Column::number("AMI"),
    ]);
    let kinds: Vec<Vec<usize>> = models.iter().map(|(_, model)| responsibilities(model).1).collect();
    for (row, ((name, model), of_frames)) in models.iter().zip(&kinds).enumerate() {
        let (n_dims, n_kinds) = (model.manifest().n_dims, model.mixture().n_kinds());
        let Provenance { residual_variance, largest_kind_share, .. } = &model.manifest().provenance;
        let residual_variance = residual_variance.get(n_dims - 1);
        table.row(vec![
            name.to_string(),
            model.layout().n_readings().to_string(),
            n_dims.to_string(),
            n_kinds.to_string(),
            residual_variance.map_or("–".to_string(), |variance| format!("{variance:.4}")),
            format!("{:.1}\u{a0}%", 100.0 * largest_kind_share),
            format!("{:.1} frames", Runs::of(of_frames).mean_length),
            if row == 0 { "–".to_string() } else { format!("{:.2}", agreement(&kinds[0], of_frames)) },
        ]);
    }
    table
}

/// Adjusted mutual information between the kinds that two models have for the same trained frames: 1 if they are the
/// same by other names, 0 if no more alike than by chance.
///
/// # Panics
/// If the models are not of equally many frames: a bug of the caller.
pub fn kinds_agreement(a: &Model, b: &Model) -> f64 {
    agreement(&responsibilities(a).1, &responsibilities(b).1)
}

fn agreement(a: &[usize], b: &[usize]) -> f64 {
    assert_eq!(a.len(), b.len(), "models of the same frames");
    adjusted_mutual_information(&a.iter().copied().zip(b.iter().copied()).collect::<Vec<_>>())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn other_names_for_the_same_kinds_agree_wholly() {
        assert!((agreement(&[0, 0, 1, 1, 2], &[2, 2, 0, 0, 1]) - 1.0).abs() < 1e-12);
        assert!(agreement(&[0, 0, 1, 1], &[0, 1, 0, 1]) < 0.01);
    }
}
