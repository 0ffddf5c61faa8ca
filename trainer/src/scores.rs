//! How well kinds repeat where one trip revisits another, method by method.

use std::ops::Range;

use kinds_model::Method;
use serde::Serialize;

use crate::agreement::Contingency;
use crate::bootstrap::{Resamples, blocks};
use crate::consistency::{Consistency, Counts, N_SHIFTS_MAX, Revisits, kappa};
use crate::places::Places;
use crate::rivals::Methods;
use crate::surface::{self, Grid, GridCounts, Surface};

/// How consistent one method's kinds are.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct MethodScores {
    /// d; 0 for random kinds.
    pub n_dims: usize,
    /// J.
    pub n_kinds: usize,
    /// C: share of the revisited frames that are consistent.
    pub consistency: f64,
    /// C₀: the same by chance.
    pub chance: f64,
    /// κ = (C − C₀) / (1 − C₀).
    pub kappa: f64,
    /// Adjusted mutual information between a frame's kind and its nearest frame's.
    pub ami: f64,
    /// Share of the most frequent kind among the frames of both trips: one giant kind is consistent and useless.
    pub largest_kind_share: f64,
    /// Mean of C over the grid of radii and shares: the area under its surface.
    pub area: Option<f64>,
    /// The same by chance.
    pub chance_area: Option<f64>,
    /// How far the scores could have come out otherwise. None of a path too short for blocks.
    pub confidence: Option<Confidence>,
}

/// The middle 95 % of each score over resampled blocks of the path: least and greatest.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Confidence {
    /// Of C.
    pub consistency: [f64; 2],
    /// Of κ.
    pub kappa: [f64; 2],
    /// Of the adjusted mutual information.
    pub ami: [f64; 2],
    /// Of the area under the surface.
    pub area: Option<[f64; 2]>,
}

/// How much more consistent Isomap's kinds are than those of principal components, on the same resampled blocks.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct KappaLead {
    /// κ of Isomap less κ of principal components.
    pub isomap_over_pca: f64,
    /// The middle 95 % of it.
    pub confidence: Option<[f64; 2]>,
}

/// How well the kinds of one trip repeat on another that revisits it.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Scores {
    /// R, metres.
    pub radius_m: f64,
    /// Z.
    pub share: f64,
    /// Share of the first trip's frames that the second revisited.
    pub revisited: f64,
    /// By method.
    pub methods: Methods<MethodScores>,
}

/// The same, with all that it rests on.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct DirectedScores {
    /// The scores at one radius and share.
    #[serde(flatten)]
    pub scores: Scores,
    /// Share of the first trip's frames that the second never came near.
    pub never_revisited: f64,
    /// Length of the blocks that confidence is from, metres.
    pub block_m: f64,
    /// How many there are.
    pub n_blocks: usize,
    /// Whether one method is ahead of the other; none where there is no other.
    pub kappa_lead: Option<KappaLead>,
    /// Frames of the first trip whose nearest of the second has which kind, by the model's own method: shape
    /// `(n_kinds, n_kinds)`, a row for each kind of the first.
    pub kinds_met: Vec<Vec<usize>>,
    /// Consistency whatever counts as a place, by method.
    pub surfaces: Methods<Surface>,
}

/// A method's kinds of two trips.
pub(crate) struct MethodKinds {
    /// None of random kinds.
    pub(crate) method: Option<Method>,
    pub(crate) n_dims: usize,
    pub(crate) n_kinds: usize,
    /// Of the frames whose place is known, of the first trip and of the second.
    pub(crate) kinds: [Vec<usize>; 2],
}

/// What is to be scored, and how.
pub(crate) struct Comparison<'a> {
    pub(crate) places: [&'a Places; 2],
    pub(crate) revisits: &'a Revisits,
    pub(crate) radius_m: f64,
    pub(crate) heading_tolerance_rad: Option<f64>,
    pub(crate) share: f64,
    pub(crate) grid: &'a Grid,
    pub(crate) n_resamples: usize,
    pub(crate) seed: u64,
}

/// What one block of the path has of one method.
struct Block {
    counts: Counts,
    pairs: Contingency,
    grid: GridCounts,
    /// The same, summed over shares.
    by_radius: Vec<[u64; 2]>,
}

impl Comparison<'_> {
    /// Scores methods.
    ///
    /// * `methods` — Isomap first
    /// * `own` — which of them is the model's own
    /// * `done` — told the number of frames of each block of the path that is done with
    pub(crate) fn score(
        &self,
        methods: &[MethodKinds],
        own: usize,
        done: &(dyn Fn(u64) + Sync),
    ) -> DirectedScores {
        let (block_m, ranges) = self.blocks(&methods[0].kinds[0]);
        let kinds: Vec<[&[usize]; 2]> =
            methods.iter().map(|method| method.kinds.each_ref().map(Vec::as_slice)).collect();
        let grids = surface::count(self.places, self.heading_tolerance_rad, &kinds, self.grid, &ranges, done);
        let blocks: Vec<Vec<Block>> =
            methods.iter().zip(grids).map(|(method, grids)| self.count(method, &ranges, grids)).collect();
        let resamples = Resamples::draw(ranges.len(), self.n_resamples, self.seed);
        let scored: Vec<MethodScores> = methods
            .iter()
            .zip(&blocks)
            .map(|(method, blocks)| self.method_scores(method, blocks, resamples.as_ref()))
            .collect();
        let n_shifts = self.revisits.n_shifts();
        let kappa_of =
            |method: usize, draw: &[usize]| counts(&blocks[method], draw).consistency(n_shifts).map(kappa);
        let place_of = |method| methods.iter().position(|of| of.method == Some(method));
        let kappa_lead = place_of(Method::Isomap).zip(place_of(Method::Pca)).map(|(isomap, pca)| {
            let lead_of = |draw: &[usize]| Some(kappa_of(isomap, draw)? - kappa_of(pca, draw)?);
            KappaLead {
                isomap_over_pca: scored[isomap].kappa - scored[pca].kappa,
                confidence: resamples.as_ref().and_then(|resamples| resamples.interval(lead_of)),
            }
        });
        let kinds_met = all_pairs(&blocks[own]).rows().map(<[usize]>::to_vec).collect();
        let revisited = self.revisits.share_revisited();
        DirectedScores {
            never_revisited: 1.0 - revisited,
            block_m,
            n_blocks: ranges.len(),
            kappa_lead,
            kinds_met,
            surfaces: by_method(methods, blocks.iter().map(|blocks| grid(blocks).surface())),
            scores: Scores {
                radius_m: self.radius_m,
                share: self.share,
                revisited,
                methods: by_method(methods, scored),
            },
        }
    }

    /// Blocks of the first trip's path: as long as a kind's usual stretch and the places about its two ends, since what is taken
    /// for another kind is so for a stretch or at its ends. By Isomap's kinds, whichever method is evaluated.
    fn blocks(&self, kinds: &[usize]) -> (f64, Vec<Range<usize>>) {
        let travelled_m = self.places[0].travelled_m();
        let length_m = travelled_m.last().copied().unwrap_or(0.0);
        let n_stretches = kinds.chunk_by(|a, b| a == b).count().max(1);
        let block_m = 2.0 * self.radius_m + length_m / n_stretches as f64;
        (block_m, blocks(&travelled_m, block_m))
    }

    fn count(&self, method: &MethodKinds, ranges: &[Range<usize>], grids: Vec<GridCounts>) -> Vec<Block> {
        let [first, second] = &method.kinds;
        let of_blocks = self.revisits.counts(first, second, self.share, N_SHIFTS_MAX, ranges);
        let blocks = ranges.iter().zip(of_blocks).zip(grids);
        blocks
            .map(|((range, counts), grid)| {
                let mut pairs = Contingency::new(method.n_kinds);
                self.revisits.pairs(first, second, range).for_each(|pair| pairs.count(pair));
                Block { counts, pairs, by_radius: grid.by_radius(), grid }
            })
            .collect()
    }

    fn method_scores(
        &self,
        method: &MethodKinds,
        blocks: &[Block],
        resamples: Option<&Resamples>,
    ) -> MethodScores {
        let n_shifts = self.revisits.n_shifts();
        let all: Vec<usize> = (0..blocks.len()).collect();
        let measured = |draw: &[usize]| counts(blocks, draw).consistency(n_shifts);
        let found = measured(&all).expect("the trips meet");
        let surface = grid(blocks).surface();
        let confidence = resamples.and_then(|resamples| {
            Some(Confidence {
                consistency: resamples.interval(|draw| measured(draw).map(|found| found.consistency))?,
                kappa: resamples.interval(|draw| measured(draw).map(kappa))?,
                ami: resamples.interval(|draw| {
                    let pairs = pairs(blocks, draw);
                    measured(draw).map(|_| pairs.adjusted_mutual_information())
                })?,
                area: resamples.interval(|draw| area(blocks, draw, self.grid.shares.len())),
            })
        });
        let Consistency { consistency, chance } = found;
        MethodScores {
            n_dims: method.n_dims,
            n_kinds: method.n_kinds,
            consistency,
            chance,
            kappa: kappa(found),
            ami: all_pairs(blocks).adjusted_mutual_information(),
            largest_kind_share: largest_kind_share(method.kinds.iter().flatten().copied(), method.n_kinds),
            area: surface.area,
            chance_area: surface.chance_area,
            confidence,
        }
    }
}

fn by_method<T>(methods: &[MethodKinds], of_each: impl IntoIterator<Item = T>) -> Methods<T> {
    Methods::from_list(methods.iter().map(|of| of.method).zip(of_each))
}

fn counts(blocks: &[Block], draw: &[usize]) -> Counts {
    draw.iter().fold(Counts::default(), |mut sum, &block| {
        sum += blocks[block].counts;
        sum
    })
}

fn pairs(blocks: &[Block], draw: &[usize]) -> Contingency {
    let mut sum = blocks[draw[0]].pairs.clone();
    draw[1..].iter().for_each(|&block| sum.add(&blocks[block].pairs));
    sum
}

fn all_pairs(blocks: &[Block]) -> Contingency {
    pairs(blocks, &(0..blocks.len()).collect::<Vec<_>>())
}

fn grid(blocks: &[Block]) -> GridCounts {
    GridCounts::sum(blocks.iter().map(|block| &block.grid))
}

fn area(blocks: &[Block], draw: &[usize], n_shares: usize) -> Option<f64> {
    let mut sums = vec![[0; 2]; blocks[0].by_radius.len()];
    for &block in draw {
        for (sum, counts) in sums.iter_mut().zip(&blocks[block].by_radius) {
            *sum = [sum[0] + counts[0], sum[1] + counts[1]];
        }
    }
    surface::area(&sums, n_shares)
}

/// Share of the most frequent kind among frames; 0 without frames.
fn largest_kind_share(kinds: impl Iterator<Item = usize>, n_kinds: usize) -> f64 {
    let mut n_frames_of = vec![0_usize; n_kinds];
    kinds.for_each(|kind| n_frames_of[kind] += 1);
    let n_frames: usize = n_frames_of.iter().sum();
    let largest = n_frames_of.into_iter().max().unwrap_or(0);
    largest as f64 / n_frames.max(1) as f64
}

#[cfg(test)]
mod tests {
    use kinds_trips::Pose;

    use super::*;
    use crate::places::SamePlace;

    #[test]
    fn the_largest_kind_is_counted_and_a_kind_without_frames_does_no_harm() {
        assert_eq!(largest_kind_share([0, 2, 2, 2].into_iter(), 4), 0.75);
    }

    /// A robot that goes up and down a line of 60 m, over and over, with a kind for each 10 m.
    fn up_and_down(n_frames: usize, offset: usize) -> (Places, Vec<usize>) {
        let place = |frame: usize| {
            let around = (frame + offset) % 120;
            if around < 60 { around } else { 119 - around }
        };
        let poses = (0..n_frames).map(|frame| Pose { x_m: place(frame) as f64, y_m: 0.0, yaw_rad: 0.0 });
        (Places::new(poses.collect()), (0..n_frames).map(|frame| place(frame) / 10 % 3).collect())
    }

    fn compare(
        first: &(Places, Vec<usize>),
        second: &(Places, Vec<usize>),
        methods: &[[&[usize]; 2]],
    ) -> DirectedScores {
        let places = [&first.0, &second.0];
        let comparison = Comparison {
            places,
            revisits: &Revisits::find(places[0], places[1], &SamePlace::within(0.5)),
            radius_m: 0.5,
            heading_tolerance_rad: None,
            share: 0.5,
            grid: &Grid::new(1.0, 4, 4),
            n_resamples: 200,
            seed: 3,
        };
        let named = [Some(Method::Isomap), Some(Method::Pca), None].into_iter().zip(methods);
        let kinds = |(method, [first, second]): (Option<Method>, &[&[usize]; 2])| MethodKinds {
            method,
            n_dims: 2,
            n_kinds: 3,
            kinds: [first.to_vec(), second.to_vec()],
        };
        comparison.score(&named.map(kinds).collect::<Vec<_>>(), 0, &|_| ())
    }

    #[test]
    fn perfect_kinds_leave_no_doubt_and_worse_ones_have_an_interval_around_their_score() {
        let (first, second) = (up_and_down(600, 0), up_and_down(500, 37));
        // Every fourth stretch of ten metres of the second trip is taken for another kind.
        let mistaken: Vec<usize> = second
            .1
            .iter()
            .enumerate()
            .map(|(frame, kind)| (kind + usize::from(frame / 10 % 4 == 0)) % 3)
            .collect();
        let constant = [vec![0; 600], vec![0; 500]];
        let found = compare(
            &first,
            &second,
            &[[&first.1, &second.1], [&first.1, &mistaken], [&constant[0], &constant[1]]],
        );
        let Methods { isomap, pca, random, .. } = found.scores.methods;
        assert_eq!((isomap.consistency, isomap.kappa, isomap.ami), (1.0, 1.0, 1.0));
        // At a radius of 1 m the next places count as well: of the ten places where kinds meet, of 60, a third of the frames near
        // are of the other kind, which is too many where more than three quarters are asked for. One point of sixteen.
        assert!((isomap.area.unwrap() - (1.0 - 1.0 / 16.0 / 6.0)).abs() < 1e-12);
        let sure = isomap.confidence.unwrap();
        assert_eq!((sure.consistency, sure.kappa), ([1.0, 1.0], [1.0, 1.0]));
        assert!(sure.ami.iter().all(|ami| (ami - 1.0).abs() < 1e-12), "{:?}", sure.ami);
        let pca = pca.unwrap();
        let doubt = pca.confidence.unwrap();
        for (score, [low, high]) in [
            (pca.consistency, doubt.consistency),
            (pca.kappa, doubt.kappa),
            (pca.ami, doubt.ami),
            (pca.area.unwrap(), doubt.area.unwrap()),
        ] {
            assert!(low < score && score < high && high - low < 0.8, "{low} {score} {high}");
        }
        assert_eq!((random.kappa, random.chance_area, random.largest_kind_share), (0.0, Some(1.0), 1.0));
        let lead = found.kappa_lead.unwrap();
        let [low, high] = lead.confidence.unwrap();
        assert!(0.0 < low && low < lead.isomap_over_pca && lead.isomap_over_pca < high);
        assert_eq!((found.never_revisited, found.scores.revisited), (0.0, 1.0));
        // Stretches are 10 m, but for those where the robot turns back: two of them one after the other.
        assert!(found.block_m > 11.0 && found.n_blocks > 40, "{} {}", found.block_m, found.n_blocks);
        // The nearest frame is always one at the same place.
        let n_met: usize = found.kinds_met.iter().flatten().sum();
        let diagonal: usize = (0..3).map(|kind| found.kinds_met[kind][kind]).sum();
        assert_eq!((n_met, diagonal), (600, 600));
    }

    #[test]
    fn of_a_robot_that_stands_still_nothing_is_said_about_confidence() {
        let still = (Places::new(vec![Pose { x_m: 0.0, y_m: 0.0, yaw_rad: 0.0 }; 50]), vec![1; 50]);
        let kinds: [&[usize]; 2] = [&still.1, &still.1];
        let found = compare(&still, &still, &[kinds, kinds, kinds]);
        assert_eq!((found.n_blocks, found.scores.methods.isomap.confidence), (1, None));
        assert_eq!(found.kappa_lead, Some(KappaLead { isomap_over_pca: 0.0, confidence: None }));
    }
}
