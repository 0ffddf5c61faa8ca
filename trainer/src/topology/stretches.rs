//! Cuts a trip into stretches of one kind, none of them too small to be a place.

use std::collections::{BTreeMap, BTreeSet};

use super::Extent;
use crate::trip_kinds::TripKinds;

/// Successive frames of a trip that are one place of one kind, but for a few. Frames between the first and the last whose
/// place is not known are no part of it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Stretch {
    /// The first frame; its place is known, as is the last one's.
    pub(super) first: usize,
    pub(super) last: usize,
    pub(super) kind: usize,
    pub(super) extent: Extent,
}

impl Stretch {
    /// Diagonal of the box around it, metres: the length of a straight stretch in whatever direction, and unlike the length
    /// of the path not made longer by the noise in the poses of a robot that stands still.
    fn size_m(&self) -> f64 {
        let (width_m, height_m) = self.extent.size_m();
        width_m.hypot(height_m)
    }

    /// By size, and of equals by the number of frames.
    fn rank(&self) -> (u64, usize) {
        // No size is negative, and the bits of such numbers have their order.
        (self.size_m().to_bits(), self.last - self.first)
    }

    /// All from the first to the last frame of both, with its own kind.
    fn and(self, other: Self) -> Self {
        Self {
            first: self.first.min(other.first),
            last: self.last.max(other.last),
            extent: self.extent.and(other.extent),
            ..self
        }
    }
}

/// Cuts a trip into stretches that are at least so large, in order of time; neighbours differ in kind. None if no place is
/// known, one if the whole trip is smaller.
///
/// Of runs of one kind that are too small the smallest is absorbed first (of equals that of fewer frames, then the earlier), by the larger of its
/// neighbours (of equals that of more frames, then the earlier), and by both where they have the same kind: so a flicker within one place is mended before it can cut it,
/// and one at a border goes to a side.
///
/// O(n log n).
pub(super) fn cut(trip: &TripKinds, size_m_min: f64) -> Vec<Stretch> {
    // By first frame: neighbours are found without a chain of links.
    let mut stretches: BTreeMap<usize, Stretch> =
        runs(trip).into_iter().map(|run| (run.first, run)).collect();
    let ranked = |stretch: &Stretch| (stretch.rank(), stretch.first);
    let mut smallest: BTreeSet<((u64, usize), usize)> = stretches.values().map(ranked).collect();
    while let Some((_, first)) = smallest.pop_first() {
        let small = stretches[&first];
        let before = stretches.range(..first).next_back().map(|(_, stretch)| *stretch);
        let after = stretches.range(first + 1..).next().map(|(_, stretch)| *stretch);
        let neighbours = [after, before].into_iter().flatten();
        // The last of equals: the earlier.
        let Some(larger) = neighbours.clone().max_by_key(Stretch::rank) else { break };
        if small.size_m() >= size_m_min {
            break;
        }
        let mut whole = Stretch { kind: larger.kind, ..small };
        stretches.remove(&first);
        for neighbour in neighbours.filter(|neighbour| neighbour.kind == larger.kind) {
            smallest.remove(&ranked(&neighbour));
            stretches.remove(&neighbour.first);
            whole = whole.and(neighbour);
        }
        smallest.insert(ranked(&whole));
        stretches.insert(whole.first, whole);
    }
    stretches.into_values().collect()
}

/// The longest stretches of one kind, of whatever size.
fn runs(trip: &TripKinds) -> Vec<Stretch> {
    let (n_frames, n_poses) = (trip.kinds.len(), trip.poses.len());
    assert_eq!((trip.seconds.len(), n_poses), (n_frames, n_frames), "one time and pose for each kind");
    let mut runs: Vec<Stretch> = Vec::new();
    for (frame, (pose, &kind)) in trip.poses.iter().zip(trip.kinds).enumerate() {
        let Some(pose) = pose else { continue };
        let here = Stretch { first: frame, last: frame, kind, extent: Extent::of(pose) };
        match runs.last_mut() {
            Some(run) if run.kind == kind => *run = run.and(here),
            _ => runs.push(here),
        }
    }
    runs
}
