//! Adjusted mutual information of two labellings.

/// Mutual information of two labellings of the same things, corrected for chance and scaled to at most 1.
///
/// Vinh, Epps & Bailey 2010, *Information theoretic measures for clusterings comparison*, eq. (24a) for the expectation,
/// normalised by the mean of the two entropies. 1 for equal labellings whatever the labels are called, about 0 for
/// unrelated ones. 1 also where both have a single label.
///
/// * `pairs` — labels from 0, few of them: a table of all pairs is made
///
/// O(n + labels² · √n).
pub fn adjusted_mutual_information(pairs: &[(usize, usize)]) -> f64 {
    let n_labels = pairs.iter().map(|(row, column)| 1 + row.max(column)).max().unwrap_or(0);
    let mut table = Contingency::new(n_labels);
    pairs.iter().for_each(|pair| table.count(*pair));
    table.adjusted_mutual_information()
}

/// How often each pair of labels occurs.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) struct Contingency {
    n_labels: usize,
    /// Shape `(n_labels, n_labels)`.
    cells: Vec<usize>,
}

impl Contingency {
    pub(crate) fn new(n_labels: usize) -> Self {
        Self { n_labels, cells: vec![0; n_labels * n_labels] }
    }

    /// Adds a pair of labels.
    pub(crate) fn count(&mut self, (row, column): (usize, usize)) {
        self.cells[row * self.n_labels + column] += 1;
    }

    /// Adds the counts of another table of as many labels.
    pub(crate) fn add(&mut self, other: &Self) {
        assert_eq!(self.n_labels, other.n_labels, "tables of the same labels");
        self.cells.iter_mut().zip(&other.cells).for_each(|(sum, cell)| *sum += cell);
    }

    /// Row by row.
    pub(crate) fn rows(&self) -> impl Iterator<Item = &[usize]> {
        self.cells.chunks(self.n_labels.max(1))
    }

    /// See [`adjusted_mutual_information`].
    pub(crate) fn adjusted_mutual_information(&self) -> f64 {
        let of_rows: Vec<usize> = self.rows().map(|row| row.iter().sum()).collect();
        let of_columns: Vec<usize> =
            (0..self.n_labels).map(|column| self.rows().map(|row| row[column]).sum()).collect();
        let n_used = |sizes: &[usize]| sizes.iter().filter(|size| **size > 0).count();
        if n_used(&of_rows) <= 1 && n_used(&of_columns) <= 1 {
            return 1.0;
        }
        let n = of_rows.iter().sum();
        let mean_entropy = 0.5 * (entropy(&of_rows, n) + entropy(&of_columns, n));
        let (mut found, mut expected) = (0.0, 0.0);
        for (row, &a) in self.rows().zip(&of_rows) {
            for (&cell, &b) in row.iter().zip(&of_columns) {
                found += information(cell, a, b, n);
                expected += expected_information(a, b, n);
            }
        }
        away_from_zero(found - expected) / away_from_zero(mean_entropy - expected)
    }
}

/// Rounding may bring the difference of equal numbers to either side of zero. Where numerator and denominator both vanish,
/// as for two frames of two kinds, no labelling could agree better by chance: that counts as 1.
fn away_from_zero(difference: f64) -> f64 {
    if difference < 0.0 { difference.min(-f64::EPSILON) } else { difference.max(f64::EPSILON) }
}

/// Nats.
fn entropy(sizes: &[usize], n: usize) -> f64 {
    let shares = sizes.iter().filter(|size| **size > 0).map(|&size| size as f64 / n as f64);
    -shares.map(|share| share * share.ln()).sum::<f64>()
}

/// What a cell adds to the mutual information, nats.
fn information(cell: usize, row: usize, column: usize, n: usize) -> f64 {
    if cell == 0 {
        return 0.0;
    }
    let (n, cell) = (n as f64, cell as f64);
    cell / n * (n * cell / (row as f64 * column as f64)).ln()
}

/// Mean of what a cell adds over all labellings with these sizes, nats.
///
/// The cell's count is hypergeometric. Its probabilities follow from each other, upwards and downwards from the most probable
/// count, whose own is what makes them sum to 1. They end where they vanish beside it: some standard deviations away.
fn expected_information(a: usize, b: usize, n: usize) -> f64 {
    const VANISHING: f64 = 1e-25;
    if a == 0 || b == 0 {
        return 0.0;
    }
    let (least, greatest) = ((a + b).saturating_sub(n), a.min(b));
    let mode = ((a + 1) * (b + 1) / (n + 2)).clamp(least, greatest);
    // p(cell + 1) / p(cell).
    let ratio = |cell: usize| {
        let (up, down) =
            ((a - cell) as f64 * (b - cell) as f64, (cell + 1) as f64 * (n + cell + 1 - a - b) as f64);
        up / down
    };
    let (mut total, mut expected) = (1.0, information(mode, a, b, n));
    let mut weight = 1.0;
    for cell in mode..greatest {
        weight *= ratio(cell);
        if weight < VANISHING {
            break;
        }
        total += weight;
        expected += weight * information(cell + 1, a, b, n);
    }
    weight = 1.0;
    for cell in (least..mode).rev() {
        weight /= ratio(cell);
        if weight < VANISHING {
            break;
        }
        total += weight;
        expected += weight * information(cell, a, b, n);
    }
    expected / total
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_cell_expects_the_mean_over_all_ways_to_draw_it() {
        // Of 5 things 3 are in the row and 2 in the column: 0, 1 or 2 in both, in 1, 6 and 3 of 10 ways.
        let expected = 0.6 * information(1, 3, 2, 5) + 0.3 * information(2, 3, 2, 5);
        assert!((expected_information(3, 2, 5) - expected).abs() < 1e-15);
        // Of 5 things 4 and 4: 3 or 4 in both, in 4 and 1 of 5 ways.
        let expected = 0.8 * information(3, 4, 4, 5) + 0.2 * information(4, 4, 4, 5);
        assert!((expected_information(4, 4, 5) - expected).abs() < 1e-15);
    }

    #[test]
    fn tables_of_parts_add_up_to_that_of_the_whole() {
        let pairs = [(0, 1), (2, 2), (0, 1), (1, 0)];
        let table = |pairs: &[(usize, usize)]| {
            let mut table = Contingency::new(3);
            pairs.iter().for_each(|pair| table.count(*pair));
            table
        };
        let mut sum = table(&pairs[..2]);
        sum.add(&table(&pairs[2..]));
        assert_eq!(sum, table(&pairs));
        assert_eq!(sum.rows().collect::<Vec<_>>(), [[0, 2, 0], [1, 0, 0], [0, 0, 1]]);
        assert_eq!(sum.adjusted_mutual_information(), adjusted_mutual_information(&pairs));
    }
}
