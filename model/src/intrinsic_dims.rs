//! Intrinsic dimension: how many dimensions the frames fill near each frame, from distances to nearest neighbours alone.
//!
//! Two estimates beside the residual variance, which decides. They look closer: at the scale of nearest neighbours a trip
//! is a thread of consecutive frames with a sensor's noise around it, and the estimate says how much of each there is.
//! A dense cloud in ten or more dimensions is estimated too low, since nearly all its frames lie near its edge.

use serde::{Deserialize, Serialize};

use crate::neighbors::{Neighbor, NeighborLists};

/// Neighbours that both estimates can use. Lists should be as long where there are as many frames.
pub const N_NEIGHBORS_USED: usize = 20;

/// Fewest neighbours that maximum likelihood is averaged from, up to [`N_NEIGHBORS_USED`]: Levina and Bickel's choice.
const N_NEIGHBORS_FEWEST: usize = 10;

/// Share of the largest ratios that [`two_nn`] leaves out, as Facco et al. do: far out a trip is not evenly dense.
const SHARE_LEFT_OUT: f64 = 0.1;

/// Estimates of the intrinsic dimension on the response's scale; none where too few frames differ.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct IntrinsicDims {
    /// By two nearest neighbours.
    pub two_nn: Option<f64>,
    /// By maximum likelihood.
    pub maximum_likelihood: Option<f64>,
}

impl IntrinsicDims {
    /// Both estimates.
    pub fn estimate(lists: &NeighborLists) -> Self {
        Self { two_nn: two_nn(lists), maximum_likelihood: maximum_likelihood(lists) }
    }
}

/// By the ratio μ of each frame's second distance to its first, which is Pareto distributed where density changes little
/// between the two: the slope of `−ln(1 − F(μ))` over `ln μ` through the origin.
///
/// Facco, d'Errico, Rodriguez & Laio 2017, *Estimating the intrinsic dimension of datasets by a minimal neighborhood
/// information*, with the largest tenth of the ratios left out as there. Copies of a frame count once.
/// None if fewer than two ratios are left or none exceeds 1.
pub fn two_nn(lists: &NeighborLists) -> Option<f64> {
    let distinct = lists.nearest(lists.k()).map(distances);
    let mut ratios: Vec<f64> = distinct
        .filter_map(|mut distances| {
            let first = distances.next()?;
            Some((distances.next()? / first).ln())
        })
        .collect();
    ratios.sort_unstable_by(f64::total_cmp);
    let n = ratios.len() as f64;
    let n_kept = (n * (1.0 - SHARE_LEFT_OUT)).floor() as usize;
    if n_kept < 2 {
        return None;
    }
    let (mut xy, mut xx) = (0.0, 0.0);
    for (rank, x) in (1..).zip(&ratios[..n_kept]) {
        xy -= x * (1.0 - f64::from(rank) / n).ln();
        xx += x * x;
    }
    (xx > 0.0).then(|| xy / xx)
}

/// By the rate at which neighbours are met as a ball grows around each frame, averaged over balls that end at the 10th to
/// the 20th neighbour.
///
/// Levina & Bickel 2004, *Maximum likelihood estimation of intrinsic dimension*, with the average over
/// frames taken of inverses as MacKay & Ghahramani 2005, *Comments on "Maximum likelihood estimation of intrinsic
/// dimension"* show it must. Copies of a frame count once. None if no frame has ten
/// others in its list.
pub fn maximum_likelihood(lists: &NeighborLists) -> Option<f64> {
    let logarithms: Vec<Vec<f64>> =
        lists.nearest(lists.k()).map(|list| distances(list).map(f64::ln).collect()).collect();
    let at = |k: usize| {
        let (mut sum, mut n) = (0.0, 0);
        for list in logarithms.iter().filter(|list| list.len() >= k) {
            sum += list[..k - 1].iter().map(|logarithm| list[k - 1] - logarithm).sum::<f64>();
            n += k - 1;
        }
        (sum > 0.0).then(|| n as f64 / sum)
    };
    let estimates: Vec<f64> = (N_NEIGHBORS_FEWEST..=N_NEIGHBORS_USED).filter_map(at).collect();
    (!estimates.is_empty()).then(|| estimates.iter().sum::<f64>() / estimates.len() as f64)
}

/// Distances above 0, nearest first, counts, each once: frames equally far are copies of one, as a robot that stands still
/// takes.
fn distances(list: &[Neighbor]) -> impl Iterator<Item = f64> {
    let mut before = 0;
    let farther = list
        .iter()
        .filter(move |near| std::mem::replace(&mut before, near.squared_distance) < near.squared_distance);
    farther.map(|near| (near.squared_distance as f64).sqrt())
}
