//! What a kind looks like to the robot: the canonical view of the paper's Figures 4 and 5, with what it leaves out.
//!
//! The mean is weighted with the responsibilities and taken on the response's scale, on which frames are compared; then
//! it is mapped back to metres, if the response allows.

use kinds_model::mixture::most_probable;
use kinds_model::{Frames, Model, Response};

use super::kind_style::called;

/// A frame that weighs less than this in a kind's mean is passed over: it would move no reading by a visible amount.
const RESPONSIBILITY_MIN: f64 = 1e-6;

/// Least difference from the mean of all frames that is drawn in full size or colour, as a share of the longest reading.
pub(super) const DIFFERENCE_SHARE_MIN: f64 = 1e-3;

/// Canonical views of all kinds, in the units of [`Unit`].
pub(super) struct Views {
    pub(super) unit: Unit,
    pub(super) of_kinds: Vec<View>,
}

/// What one kind looks like.
pub(super) struct View {
    /// What the kind is called.
    pub(super) name: String,
    /// Its number.
    pub(super) number: u32,
    /// Share of the kind among the trained frames, 0…1: the mean of its responsibilities.
    pub(super) share: f64,
    /// Weighted mean, shape `(n_readings,)`.
    pub(super) mean: Vec<f64>,
    /// The mean less that of all frames, shape `(n_readings,)`.
    pub(super) difference: Vec<f64>,
    /// One standard deviation below and above the mean on the response's scale, the smaller first, shape
    /// `(n_readings,)`.
    pub(super) around: Vec<(f64, f64)>,
    /// The reference frame among those of this kind that is nearest to the mean: which of the trained frames that is.
    pub(super) medoid_frame: usize,
    /// Its readings, shape `(n_readings,)`.
    pub(super) medoid: Vec<f64>,
}

/// What the numbers of a view are.
pub(super) enum Unit {
    /// Ranges: the response has an inverse.
    Metres(Inverse),
    /// Counts on the response's scale.
    Counts,
}

/// From the response's scale back to ranges.
pub(super) struct Inverse {
    /// The response's table from raw count 1 on, negated where it falls: it never falls.
    rising: Vec<f64>,
    sign: f64,
    metres_per_count: f64,
}

/// Sums over the reference frames, weighted with how much they are of a kind.
struct Sums {
    weight: f64,
    /// Shape `(n_readings,)` each.
    counts: Vec<f64>,
    squares: Vec<f64>,
}

impl Unit {
    fn of(model: &Model) -> Self {
        match Inverse::of(model.response(), model.layout().metres_per_count) {
            Some(inverse) => Self::Metres(inverse),
            None => Self::Counts,
        }
    }

    fn value(&self, place: f64) -> f64 {
        match self {
            Self::Metres(inverse) => inverse.range_m(place),
            Self::Counts => place,
        }
    }

    /// As it stands after a number.
    pub(super) fn name(&self) -> &'static str {
        match self {
            Self::Metres(_) => "m",
            Self::Counts => "counts",
        }
    }
}

impl Inverse {
    /// `None` if different ranges cannot be told apart by the table, or it goes up and down.
    pub(super) fn of(response: &Response, metres_per_count: f64) -> Option<Self> {
        // Entry 0 is what invalid readings are taken for, not a range.
        let ranges = &response.table()[1..];
        let (first, last) = (*ranges.first()?, *ranges.last()?);
        let sign = if first < last { 1.0 } else { -1.0 };
        let rising: Vec<f64> = ranges.iter().map(|&place| sign * f64::from(place)).collect();
        (first != last && rising.is_sorted()).then_some(Self { rising, sign, metres_per_count })
    }

    /// The range whose place this is, between neighbouring counts by a straight line; the shortest where the scale
    /// does not tell ranges apart.
    pub(super) fn range_m(&self, place: f64) -> f64 {
        let place = self.sign * place;
        let above = self.rising.partition_point(|&other| other < place);
        let raw = match above {
            0 => 1.0,
            // Beyond the scale: its end.
            _ if above == self.rising.len() => {
                let end = self.rising[above - 1];
                1.0 + self.rising.partition_point(|&other| other < end) as f64
            }
            _ => {
                let (low, high) = (self.rising[above - 1], self.rising[above]);
                above as f64 + (place - low) / (high - low)
            }
        };
        raw * self.metres_per_count
    }
}

impl Views {
    /// Computes all views. O(n_frames · n_readings · kinds that a frame is shared by).
    pub(super) fn of(model: &Model) -> Self {
        let (frames, trained) = (&model.seen(), model.references().indices());
        let (responsibilities, kinds) = responsibilities(model);
        let n_kinds = model.mixture().n_kinds();
        let weights = weights(model, &responsibilities);
        let sums = sums(frames, &weights, n_kinds);
        let unit = Unit::of(model);
        let n_trained = kinds.len() as f64;
        let of_all: Vec<f64> = (0..frames.n_readings())
            .map(|reading| unit.value(sums.iter().map(|sum| sum.counts[reading]).sum::<f64>() / n_trained))
            .collect();
        let of_kinds = sums
            .iter()
            .enumerate()
            .map(|(kind, sum)| {
                let place: Vec<f64> = sum.mean();
                let mean: Vec<f64> = place.iter().map(|place| unit.value(*place)).collect();
                let difference = mean.iter().zip(&of_all).map(|(mean, of_all)| mean - of_all).collect();
                let around = place
                    .iter()
                    .zip(sum.deviation())
                    .map(|(place, deviation)| {
                        let (a, b) = (unit.value(place - deviation), unit.value(place + deviation));
                        (a.min(b), a.max(b))
                    })
                    .collect();
                let of_kind = |frame: &usize| kinds[trained[*frame] as usize] == kind;
                let weight = |frame: usize| weights[frame * n_kinds + kind];
                let medoid = nearest((0..frames.n_frames()).filter(of_kind), frames, &place)
                    // A kind that is nowhere the most probable: the frame that is most of it.
                    .or_else(|| (0..frames.n_frames()).max_by(|a, b| weight(*a).total_cmp(&weight(*b))))
                    .unwrap_or(0);
                let medoid_frame = trained[medoid] as usize;
                let medoid =
                    frames.readings(medoid).iter().map(|&count| unit.value(f64::from(count))).collect();
                let (name, number) = (called(model.register(), kind), model.register().number(kind));
                let share = sum.weight / n_trained;
                View { name, number, share, mean, difference, around, medoid_frame, medoid }
            })
            .collect();
        Self { unit, of_kinds }
    }
}

impl Sums {
    fn mean(&self) -> Vec<f64> {
        self.counts.iter().map(|sum| sum / self.weight.max(f64::MIN_POSITIVE)).collect()
    }

    fn deviation(&self) -> impl Iterator<Item = f64> {
        let weight = self.weight.max(f64::MIN_POSITIVE);
        self.counts.iter().zip(&self.squares).map(move |(sum, squares)| {
            let mean = sum / weight;
            // Rounding may leave a little less than nothing.
            (squares / weight - mean * mean).max(0.0).sqrt()
        })
    }
}

/// Responsibilities of the trained frames, shape `(n_trained, n_kinds)`, and their most probable kinds.
pub(super) fn responsibilities(model: &Model) -> (Vec<f64>, Vec<usize>) {
    let mixture = model.mixture();
    let n_kinds = mixture.n_kinds();
    let places = model.coordinates().chunks_exact(mixture.n_dims());
    let mut all = vec![0.0; places.len() * n_kinds];
    let kinds = places
        .zip(all.chunks_exact_mut(n_kinds))
        .map(|(place, probabilities)| {
            mixture.posterior(place, probabilities);
            most_probable(probabilities)
        })
        .collect();
    (all, kinds)
}

/// How much each reference frame is of each kind, shape `(n_frames, n_kinds)`: the sum over all trained frames that it
/// stands for. So kinds look as they do on the trips, however the reference frames are spread.
///
/// * `responsibilities` — of the trained frames, shape `(n_trained, n_kinds)`
fn weights(model: &Model, responsibilities: &[f64]) -> Vec<f64> {
    let n_kinds = model.mixture().n_kinds();
    let mut weights = vec![0.0; model.frames().n_frames() * n_kinds];
    for (shares, &frame) in responsibilities.chunks_exact(n_kinds).zip(model.references().nearest()) {
        let weights = &mut weights[frame as usize * n_kinds..][..n_kinds];
        weights.iter_mut().zip(shares).for_each(|(weight, share)| *weight += share);
    }
    weights
}

/// * `weights` — of the frames, shape `(n_frames, n_kinds)`
fn sums(frames: &Frames, weights: &[f64], n_kinds: usize) -> Vec<Sums> {
    let zeros = || vec![0.0; frames.n_readings()];
    let mut sums: Vec<Sums> =
        (0..n_kinds).map(|_| Sums { weight: 0.0, counts: zeros(), squares: zeros() }).collect();
    for (frame, shares) in weights.chunks_exact(n_kinds).enumerate() {
        for (sum, &share) in sums.iter_mut().zip(shares).filter(|(_, share)| **share >= RESPONSIBILITY_MIN) {
            sum.weight += share;
            for ((counts, squares), &count) in
                sum.counts.iter_mut().zip(&mut sum.squares).zip(frames.readings(frame))
            {
                let count = f64::from(count);
                *counts += share * count;
                *squares += share * count * count;
            }
        }
    }
    sums
}

/// The frame nearest to a place on the response's scale, the first of equals.
fn nearest(candidates: impl Iterator<Item = usize>, frames: &Frames, place: &[f64]) -> Option<usize> {
    let squared_distance = |frame: usize| -> f64 {
        frames
            .readings(frame)
            .iter()
            .zip(place)
            .map(|(&count, place)| (f64::from(count) - place).powi(2))
            .sum()
    };
    let distances = candidates.map(|frame| (squared_distance(frame), frame));
    distances.min_by(|a, b| a.0.total_cmp(&b.0)).map(|(_, frame)| frame)
}

#[cfg(test)]
mod tests {
    use kinds_model::{ResponsePlan, Scale};

    use super::*;

    const MM: f64 = 0.001;

    #[test]
    fn every_range_maps_back_to_itself_as_far_as_the_scale_tells_it_from_others() {
        for scale in [Scale::Range, Scale::Log, Scale::Inverse] {
            let response = Response::new(&ResponsePlan::new(scale, 6.0), MM).unwrap();
            let inverse = Inverse::of(&response, MM).unwrap();
            for raw in 1..=6000_usize {
                let place = response.table()[raw];
                // Raw counts that share a place are not told apart.
                let n_equal = response.table()[1..6001].iter().filter(|&&other| other == place).count();
                let error = (inverse.range_m(f64::from(place)) / MM - raw as f64).abs();
                assert!(error < n_equal as f64, "{scale:?}: {raw} mm came back {error} mm away");
            }
            // Places beyond the ends are the ends.
            let (near, far) = (
                inverse.range_m(f64::from(response.table()[1])),
                inverse.range_m(f64::from(response.table()[6000])),
            );
            for beyond in [-1e6, 1e6] {
                let range_m = inverse.range_m(beyond);
                assert!(range_m == near || range_m == far, "{scale:?}: {range_m} m");
            }
        }
    }

    #[test]
    fn a_place_between_two_counts_is_a_range_between_theirs() {
        let response = Response::new(&ResponsePlan::new(Scale::Range, 6.0), MM).unwrap();
        let range_m = Inverse::of(&response, MM).unwrap().range_m(2500.25);
        assert!((range_m - 2.50025).abs() < 1e-12, "{range_m}");
    }

    #[test]
    fn a_table_that_goes_up_and_down_or_nowhere_has_no_inverse() {
        for place in [|raw: u32| (raw % 100) as u16, |_| 7] {
            let response = Response::from_table((0..65_536).map(place).collect::<Vec<u16>>().into()).unwrap();
            assert!(Inverse::of(&response, MM).is_none());
        }
    }
}
