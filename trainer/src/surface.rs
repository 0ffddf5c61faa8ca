//! Consistency whatever counts as a place: over a grid of radius and share, the paper's Figure 6.

use std::ops::Range;

use rayon::prelude::*;
use serde::Serialize;

use crate::consistency::{Counts, KindSums, Shifts, add_stretches};
use crate::places::{Places, SamePlace};

/// Circular shifts that chance is averaged over at each point of the grid, at most. One surface is hundreds of points, so
/// that fewer do than for a single one.
const N_SHIFTS_MAX: usize = 50;

/// Radii and shares that consistency is measured at.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Grid {
    /// R, ascending, metres, shape `(n_radii,)`.
    pub radii_m: Vec<f64>,
    /// Z, ascending, 0…1, shape `(n_shares,)`.
    pub shares: Vec<f64>,
}

impl Grid {
    /// Evenly spread radii up to the greatest, and shares from 0 to just below 1.
    ///
    /// * `n_radii`, `n_shares` — at least 1
    pub fn new(radius_m_max: f64, n_radii: usize, n_shares: usize) -> Self {
        Self {
            radii_m: (1..=n_radii).map(|step| radius_m_max * step as f64 / n_radii as f64).collect(),
            shares: (0..n_shares).map(|step| step as f64 / n_shares as f64).collect(),
        }
    }
}

/// Consistency over a grid.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Surface {
    /// C, shape `(n_radii, n_shares)`; none where nothing was revisited.
    pub consistency: Vec<Vec<Option<f64>>>,
    /// C₀, the same by chance.
    pub chance: Vec<Vec<Option<f64>>>,
    /// Mean of C over the grid, where it is known: the area under the surface, as a share of what it could be.
    pub area: Option<f64>,
    /// Mean of C₀ over the grid.
    pub chance_area: Option<f64>,
}

/// How often the frames of one block were consistent, at each point of a grid.
#[derive(Clone, Debug)]
pub(crate) struct GridCounts {
    n_shifts: usize,
    n_shares: usize,
    /// Shape `(n_radii, n_shares)`.
    counts: Vec<Counts>,
}

impl GridCounts {
    fn none(grid: &Grid, n_shifts: usize) -> Self {
        let n_shares = grid.shares.len();
        Self { n_shifts, n_shares, counts: vec![Counts::default(); grid.radii_m.len() * n_shares] }
    }

    /// The sum of at least one.
    pub(crate) fn sum<'a>(blocks: impl IntoIterator<Item = &'a Self>) -> Self {
        let mut blocks = blocks.into_iter();
        let mut sum = blocks.next().expect("a trip has a block").clone();
        for block in blocks {
            sum.counts.iter_mut().zip(&block.counts).for_each(|(sum, counts)| *sum += *counts);
        }
        sum
    }

    /// At each radius, frames that were revisited, and how often they were consistent over all shares, shape `(n_radii,)`: all that
    /// the area needs.
    pub(crate) fn by_radius(&self) -> Vec<[u64; 2]> {
        let sums = self.counts.chunks(self.n_shares).map(|row| {
            // The same frames are revisited whatever the share.
            [row[0].n_revisited, row.iter().map(|point| point.n_consistent).sum()]
        });
        sums.collect()
    }

    /// Consistency at each point.
    pub(crate) fn surface(&self) -> Surface {
        let points: Vec<_> = self.counts.iter().map(|counts| counts.consistency(self.n_shifts)).collect();
        let of = |value: fn(crate::Consistency) -> f64| -> Vec<Vec<Option<f64>>> {
            points
                .chunks(self.n_shares)
                .map(|row| row.iter().map(|point| point.map(value)).collect())
                .collect()
        };
        let consistency = of(|point| point.consistency);
        let chance = of(|point| point.chance);
        Surface { area: mean(&consistency), chance_area: mean(&chance), consistency, chance }
    }
}

/// The area under a surface, of sums of [`GridCounts::by_radius`].
pub(crate) fn area(by_radius: &[[u64; 2]], n_shares: usize) -> Option<f64> {
    let known = by_radius.iter().filter(|[n_revisited, _]| *n_revisited > 0);
    let shares: Vec<f64> = known
        .map(|[n_revisited, n_consistent]| *n_consistent as f64 / (*n_revisited as f64 * n_shares as f64))
        .collect();
    (!shares.is_empty()).then(|| shares.iter().sum::<f64>() / shares.len() as f64)
}

/// Mean of what is known.
fn mean(values: &[Vec<Option<f64>>]) -> Option<f64> {
    let known: Vec<f64> = values.iter().flatten().copied().flatten().collect();
    (!known.is_empty()).then(|| known.iter().sum::<f64>() / known.len() as f64)
}

/// Counts consistent frames over a grid, for several ways of finding kinds at once: where frames are near each other does
/// not depend on their kinds, and is found once.
///
/// * `heading_tolerance_rad` — as in [`SamePlace`]
/// * `methods` — each the kinds of all frames of the first and of the second trip
/// * `blocks` — frames of the first trip that follow each other
/// * `done` — told the number of frames of each block that is done with
///
/// Shape of the result `(n_methods, n_blocks)`. O(n_methods · n_radii · n_shifts · number of stretches), on the threads of
/// whoever calls.
pub(crate) fn count(
    places: [&Places; 2],
    heading_tolerance_rad: Option<f64>,
    methods: &[[&[usize]; 2]],
    grid: &Grid,
    blocks: &[Range<usize>],
    done: &(dyn Fn(u64) + Sync),
) -> Vec<Vec<GridCounts>> {
    let [first, second] = places;
    let shifts = Shifts::of(second.n_frames(), N_SHIFTS_MAX);
    let kinds: Vec<(&[usize], KindSums)> = methods
        .iter()
        .map(|[first, second]| (*first, KindSums::of(second, 1 + first.iter().copied().max().unwrap_or(0))))
        .collect();
    let radius_m = grid.radii_m.iter().copied().fold(0.0, f64::max);
    let widest = SamePlace { radius_m, heading_tolerance_rad };
    let of_blocks: Vec<Vec<GridCounts>> = blocks
        .par_iter()
        .map(|block| {
            let mut counts = vec![GridCounts::none(grid, shifts.n()); methods.len()];
            let (mut near, mut stretches) = (Vec::new(), Vec::new());
            for frame_index in block.clone() {
                second.near(&first.poses()[frame_index], &widest, &mut near);
                for (radius, radius_m) in grid.radii_m.iter().enumerate() {
                    stretches.clear();
                    let n_near = add_stretches(&near, *radius_m, &mut stretches);
                    if n_near == 0 {
                        continue;
                    }
                    for (counts, (first, sums)) in counts.iter_mut().zip(&kinds) {
                        let row = &mut counts.counts[radius * counts.n_shares..][..counts.n_shares];
                        // Consistent for as many of the shares, from the least, as the frames of the same kind exceed.
                        let n_passed = |shift| {
                            let n_same = f64::from(sums.count(first[frame_index], &stretches, shift));
                            grid.shares.partition_point(|share| n_same > share * f64::from(n_near))
                        };
                        row.iter_mut().for_each(|point| point.n_revisited += 1);
                        row[..n_passed(0)].iter_mut().for_each(|point| point.n_consistent += 1);
                        for shift in shifts.iter() {
                            row[..n_passed(shift)].iter_mut().for_each(|point| point.n_by_chance += 1);
                        }
                    }
                }
            }
            done(block.len() as u64);
            counts
        })
        .collect();
    (0..methods.len()).map(|method| of_blocks.iter().map(|counts| counts[method].clone()).collect()).collect()
}

#[cfg(test)]
mod tests {
    use kinds_trips::Pose;
    use proptest::prelude::*;

    use super::*;
    use crate::consistency::Revisits;

    fn trip() -> impl Strategy<Value = (Places, Vec<usize>)> {
        prop::collection::vec((0..12_u32, 0..3_usize), 1..50).prop_map(|frames| {
            let at = |place: u32| Pose { x_m: f64::from(place) / 4.0, y_m: 0.0, yaw_rad: 0.0 };
            let (poses, kinds) = frames.into_iter().map(|(place, kind)| (at(place), kind)).unzip();
            (Places::new(poses), kinds)
        })
    }

    proptest! {
        #[test]
        fn every_point_of_a_surface_is_what_is_measured_there_alone(first in trip(), second in trip(), cut in 0.0..1.0_f64) {
            let grid = Grid::new(1.0, 4, 5);
            let n_first = first.1.len();
            let cut = (cut * n_first as f64) as usize;
            let others = vec![0; second.1.len()];
            let methods = [[&first.1[..], &second.1[..]], [&first.1[..], &others[..]]];
            let found = count([&first.0, &second.0], None, &methods, &grid, &[0..cut, cut..n_first], &|_| ());
            for (kinds, blocks) in methods.iter().zip(&found) {
                let sum = GridCounts::sum(blocks);
                let surface = sum.surface();
                let by_radius = area(&sum.by_radius(), grid.shares.len());
                prop_assert_eq!(by_radius.is_some(), surface.area.is_some());
                prop_assert!((by_radius.unwrap_or(0.0) - surface.area.unwrap_or(0.0)).abs() < 1e-12);
                for (radius, radius_m) in grid.radii_m.iter().enumerate() {
                    let revisits = Revisits::find(&first.0, &second.0, &SamePlace::within(*radius_m));
                    for (point, share) in grid.shares.iter().enumerate() {
                        let all = 0..n_first;
                        let alone = revisits.counts(kinds[0], kinds[1], *share, N_SHIFTS_MAX, std::slice::from_ref(&all))[0];
                        let alone = alone.consistency(Shifts::of(second.1.len(), N_SHIFTS_MAX).n());
                        prop_assert_eq!(surface.consistency[radius][point], alone.map(|alone| alone.consistency));
                        prop_assert_eq!(surface.chance[radius][point], alone.map(|alone| alone.chance));
                    }
                }
            }
        }
    }

    #[test]
    fn a_grid_ends_at_the_greatest_radius_and_below_a_share_of_1_and_has_the_usual_point_on_it() {
        let grid = Grid::new(0.6, 20, 20);
        assert_eq!((grid.radii_m[9], grid.radii_m[19]), (0.3, 0.6));
        assert_eq!((grid.shares[0], grid.shares[10], grid.shares[19]), (0.0, 0.5, 0.95));
    }

    #[test]
    fn an_area_is_the_mean_over_what_is_known() {
        assert_eq!(mean(&[vec![None, Some(1.0)], vec![Some(0.5), None]]), Some(0.75));
        assert_eq!(mean(&[vec![None]]), None);
    }
}
