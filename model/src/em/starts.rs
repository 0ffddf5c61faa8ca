//! Where fits of a mixture begin: k-means from k-means++ seeds (Arthur & Vassilvitskii 2007), each frame wholly its nearest
//! centre's.

use nalgebra::DMatrix;
use rand::RngExt;
use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::SeedableRng;
use serde::{Deserialize, Serialize};

use super::steps::{Blocks, mean_and_covariance};
use super::{EmPlan, Points};
use crate::mixture::{LANES, Lanes};
use crate::simd::Instructions;

/// Which coordinates starts cluster. Kinds are fitted to the coordinates as they are, whichever it is.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub enum StartsOn {
    /// Those that there are.
    #[default]
    #[serde(alias = "plain")]
    Plain,
    /// Turned and scaled to unit covariance, so that every dimension has as much to say.
    #[serde(alias = "whitened")]
    Whitened,
    /// The one and the other in turn.
    #[serde(alias = "both")]
    Both,
}

/// Rounds of Lloyd's algorithm at most, before the fit itself takes over.
const N_LLOYD_ROUNDS_MAX: usize = 100;

/// Starts of fits to the same frames.
pub(super) struct Starts<'a> {
    plain: Points<'a>,
    /// None where no start needs them.
    whitened: Option<Vec<f64>>,
    on: StartsOn,
    seed: u64,
}

impl<'a> Starts<'a> {
    pub(super) fn new(points: Points<'a>, plan: &EmPlan) -> Self {
        let whitened = (plan.starts_on != StartsOn::Plain).then(|| whiten(points));
        Self { plain: points, whitened, on: plan.starts_on, seed: plan.seed }
    }

    /// Responsibilities of 0 and 1, shape `(n_kinds, n_frames)`: always the same for a number of kinds and a start's index.
    pub(super) fn responsibilities(&self, n_kinds: usize, start_index: u64) -> Vec<f64> {
        let points = self.clustered(start_index);
        let mut random = ChaCha8Rng::seed_from_u64(self.seed);
        random.set_stream(start_index);
        let blocks = Blocks::new(points);
        let mut centres = k_means_plus_plus(points, &blocks, n_kinds, &mut random);
        for _ in 0..N_LLOYD_ROUNDS_MAX {
            let moved = move_to_means(points, &blocks, &centres);
            if std::mem::replace(&mut centres, moved.clone()) == moved {
                break;
            }
        }
        let mut responsibilities = vec![0.0; n_kinds * points.n()];
        for (index, nearest) in nearest_centres(&blocks, &centres).into_iter().enumerate() {
            responsibilities[nearest * points.n() + index] = 1.0;
        }
        responsibilities
    }

    fn clustered(&self, start_index: u64) -> Points<'_> {
        match &self.whitened {
            Some(coordinates) if self.on == StartsOn::Whitened || start_index % 2 == 1 => {
                Points { coordinates, ..self.plain }
            }
            _ => self.plain,
        }
    }
}

/// Share of the largest variance below which a direction is taken for none: what varies along it is rounding.
const VARIANCE_SHARE_MIN: f64 = 1e-12;

/// The coordinates turned to their principal directions and scaled to unit variance along each.
fn whiten(points: Points) -> Vec<f64> {
    let (_, covariance) = mean_and_covariance(&Blocks::new(points));
    let eigen = covariance.symmetric_eigen();
    let least = VARIANCE_SHARE_MIN * eigen.eigenvalues.max();
    let scales = eigen.eigenvalues.map(|variance| if variance > least { 1.0 / variance.sqrt() } else { 0.0 });
    let whitening = DMatrix::from_diagonal(&scales) * eigen.eigenvectors.transpose();
    let whitened = whitening * DMatrix::from_column_slice(points.n_dims, points.n(), points.coordinates);
    whitened.as_slice().to_vec()
}

fn k_means_plus_plus(
    points: Points,
    blocks: &Blocks,
    n_centres: usize,
    random: &mut ChaCha8Rng,
) -> Vec<Vec<f64>> {
    let mut centres = vec![points.row(random.random_range(0..points.n())).to_vec()];
    let mut squared: Vec<f64> = vec![f64::INFINITY; points.n()];
    while centres.len() < n_centres {
        let newest = &centres[centres.len() - 1];
        lessen(&mut squared, blocks, newest);
        let mut left = random.random::<f64>() * squared.iter().sum::<f64>();
        let drawn = squared.iter().position(|squared| {
            left -= squared;
            left < 0.0
        });
        // Where all frames coincide with a centre, any will do: the kind will lose its frames, and that is reported.
        centres.push(points.row(drawn.unwrap_or(points.n() - 1)).to_vec());
    }
    centres
}

/// One round of Lloyd's algorithm; a centre without frames stays where it is.
fn move_to_means(points: Points, blocks: &Blocks, centres: &[Vec<f64>]) -> Vec<Vec<f64>> {
    let mut sums = vec![vec![0.0; points.n_dims]; centres.len()];
    let mut counts = vec![0_usize; centres.len()];
    for (point, nearest) in points.rows().zip(nearest_centres(blocks, centres)) {
        counts[nearest] += 1;
        sums[nearest].iter_mut().zip(point).for_each(|(sum, place)| *sum += place);
    }
    for ((sum, &count), centre) in sums.iter_mut().zip(&counts).zip(centres) {
        match count {
            0 => sum.clone_from(centre),
            _ => sum.iter_mut().for_each(|sum| *sum /= count as f64),
        }
    }
    sums
}

/// Which centre each frame is nearest to, the first of equals.
fn nearest_centres(blocks: &Blocks, centres: &[Vec<f64>]) -> Vec<usize> {
    Instructions::widest().run(
        #[inline(always)]
        || nearest_centres_plainly(blocks, centres),
    )
}

/// Inlined, as all that it calls, so that it is compiled for the instructions of whoever calls.
#[inline(always)]
fn nearest_centres_plainly(blocks: &Blocks, centres: &[Vec<f64>]) -> Vec<usize> {
    let mut of_all = Vec::with_capacity(blocks.n_frames() + LANES);
    for places in blocks.iter() {
        let mut least = [f64::INFINITY; LANES];
        let mut nearest = [0; LANES];
        for (index, centre) in centres.iter().enumerate() {
            let squared = squared_distances(places, centre);
            for lane in 0..LANES {
                let is_nearer = squared[lane] < least[lane];
                least[lane] = if is_nearer { squared[lane] } else { least[lane] };
                nearest[lane] = if is_nearer { index } else { nearest[lane] };
            }
        }
        of_all.extend_from_slice(&nearest);
    }
    of_all.truncate(blocks.n_frames());
    of_all
}

/// Takes a new centre for each frame's nearest, where it is.
fn lessen(squared: &mut [f64], blocks: &Blocks, centre: &[f64]) {
    Instructions::widest().run(
        #[inline(always)]
        || {
            for (least, places) in squared.chunks_mut(LANES).zip(blocks.iter()) {
                let squared = squared_distances(places, centre);
                least.iter_mut().zip(squared).for_each(|(least, squared)| *least = least.min(squared));
            }
        },
    );
}

#[inline(always)]
fn squared_distances(places: &[Lanes], centre: &[f64]) -> Lanes {
    let mut squared = [0.0; LANES];
    for (place, centre) in places.iter().zip(centre) {
        for lane in 0..LANES {
            squared[lane] += (place[lane] - centre) * (place[lane] - centre);
        }
    }
    squared
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Two rows of places along the first dimension, which is a thousand times as long as the second. What tells the rows
    /// apart is the second.
    fn rows() -> Vec<f64> {
        (0..40)
            .flat_map(|index| [f64::from(index / 2) * 1000.0, f64::from(index % 2) + 0.01 * f64::from(index)])
            .collect()
    }

    fn kinds(on: StartsOn, start_index: u64) -> Vec<bool> {
        let coordinates = rows();
        let points = Points { n_dims: 2, coordinates: &coordinates };
        let plan = EmPlan { starts_on: on, ..EmPlan::new(2) };
        let responsibilities = Starts::new(points, &plan).responsibilities(2, start_index);
        (0..40).map(|index| responsibilities[index] == responsibilities[0]).collect()
    }

    #[test]
    fn whitened_starts_find_what_a_longer_dimension_hides_and_both_take_turns() {
        let along: Vec<bool> = kinds(StartsOn::Plain, 0);
        assert!(along.is_sorted_by(|a, b| a >= b), "halves of the length: {along:?}");
        let across: Vec<bool> = (0..40).map(|index| index % 2 == 0).collect();
        assert_eq!(kinds(StartsOn::Whitened, 1), across);
        assert_eq!(kinds(StartsOn::Both, 0), kinds(StartsOn::Plain, 0));
        assert_eq!(kinds(StartsOn::Both, 1), kinds(StartsOn::Whitened, 1));
    }

    #[test]
    fn whitened_coordinates_have_unit_covariance_and_nothing_where_nothing_varies() {
        let flat: Vec<f64> = rows().chunks_exact(2).flat_map(|place| [place[0], place[1], 7.0]).collect();
        let whitened = whiten(Points { n_dims: 3, coordinates: &flat });
        let points = Points { n_dims: 3, coordinates: &whitened };
        let (_, covariance) = mean_and_covariance(&Blocks::new(points));
        // One direction has no variance, in whichever place. Of the others the smaller variance is 1e-8 of the larger, whose
        // rounding it bears.
        let found = covariance.diagonal();
        assert!((found.sum() - 2.0).abs() < 1e-7 && found.min().abs() < 1e-7, "{covariance}");
        assert!((&covariance - DMatrix::from_diagonal(&found)).abs().max() < 1e-7, "{covariance}");
    }
}
