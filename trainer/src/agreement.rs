//! Adjusted mutual information of two labellings.

use std::collections::BTreeMap;

/// Mutual information of two labellings of the same things, corrected for chance and scaled to at most 1.
///
/// Vinh, Epps & Bailey 2010, *Information theoretic measures for clusterings comparison*, eq. (24a) for the expectation,
/// normalised by the mean of the two entropies. 1 for equal labellings whatever the labels are called, about 0 for
/// unrelated ones. 1 also where both have a single label.
///
/// O(n + labels² · n).
pub fn adjusted_mutual_information(pairs: &[(usize, usize)]) -> f64 {
    let table = Contingency::count(pairs);
    if table.rows.len() == table.columns.len() && table.rows.len() <= 1 {
        return 1.0;
    }
    let mean_entropy = 0.5 * (table.entropy(&table.rows) + table.entropy(&table.columns));
    let expected = table.expected_mutual_information();
    away_from_zero(table.mutual_information() - expected) / away_from_zero(mean_entropy - expected)
}

/// Rounding may bring the difference of equal numbers to either side of zero. Where numerator and denominator both vanish,
/// as for two frames of two kinds, no labelling could agree better by chance: that counts as 1.
fn away_from_zero(difference: f64) -> f64 {
    if difference < 0.0 { difference.min(-f64::EPSILON) } else { difference.max(f64::EPSILON) }
}

/// How often each pair of labels occurs.
struct Contingency {
    n: usize,
    rows: BTreeMap<usize, usize>,
    columns: BTreeMap<usize, usize>,
    cells: BTreeMap<(usize, usize), usize>,
}

impl Contingency {
    fn count(pairs: &[(usize, usize)]) -> Self {
        let (mut rows, mut columns, mut cells) = (BTreeMap::new(), BTreeMap::new(), BTreeMap::new());
        for &(row, column) in pairs {
            *rows.entry(row).or_default() += 1;
            *columns.entry(column).or_default() += 1;
            *cells.entry((row, column)).or_default() += 1;
        }
        Self { n: pairs.len(), rows, columns, cells }
    }

    /// Nats.
    fn entropy(&self, sizes: &BTreeMap<usize, usize>) -> f64 {
        let n = self.n as f64;
        -sizes.values().map(|&size| size as f64 / n * (size as f64 / n).ln()).sum::<f64>()
    }

    /// Nats.
    fn mutual_information(&self) -> f64 {
        let term = |((row, column), &cell): (&(usize, usize), &usize)| {
            self.information(cell, self.rows[row], self.columns[column])
        };
        self.cells.iter().map(term).sum()
    }

    /// Mean of the mutual information over all labellings with these sizes, nats: cells are hypergeometric.
    fn expected_mutual_information(&self) -> f64 {
        let log_factorials = log_factorials(self.n);
        let log_factorial = |n: usize| log_factorials[n];
        let mut expected = 0.0;
        for &a in self.rows.values() {
            for &b in self.columns.values() {
                let fixed = log_factorial(a)
                    + log_factorial(b)
                    + log_factorial(self.n - a)
                    + log_factorial(self.n - b)
                    - log_factorial(self.n);
                for cell in (a + b).saturating_sub(self.n).max(1)..=a.min(b) {
                    let log_probability = fixed
                        - log_factorial(cell)
                        - log_factorial(a - cell)
                        - log_factorial(b - cell)
                        - log_factorial(self.n + cell - a - b);
                    expected += self.information(cell, a, b) * log_probability.exp();
                }
            }
        }
        expected
    }

    /// What a cell adds to the mutual information, nats.
    fn information(&self, cell: usize, row: usize, column: usize) -> f64 {
        let (n, cell) = (self.n as f64, cell as f64);
        cell / n * (n * cell / (row as f64 * column as f64)).ln()
    }
}

/// ln 0!, ln 1!, … ln n!
fn log_factorials(n: usize) -> Vec<f64> {
    let mut sum = 0.0;
    let later = (1..=n).map(|factor| {
        sum += (factor as f64).ln();
        sum
    });
    std::iter::once(0.0).chain(later).collect()
}
