//! The reference set: which of the frames that kinds are learnt from a model keeps, where it is not to hold them all.
//!
//! *Trained frame*: a frame that kinds are learnt from. *Reference frame*: one of them that is kept, a vertex of the graph.
//! Each trained frame is stood for by the reference frame nearest to it.
//!
//! Reference frames are chosen by farthest point (Gonzalez 1985, *Clustering to minimize the maximum intercluster
//! distance*): each is the frame farthest from all chosen before. So no place is lost that a trip saw only once, a robot that
//! stands still takes up one frame, and no two reference frames are nearer to each other than the *covering radius*, the
//! farthest that any trained frame is from one. A trained frame is therefore never novel to the model. Frames at random lose
//! rare places: every second frame of a recorded trip of 16 readings left a radius eight times as large, or more.

use rayon::prelude::*;

use crate::array::Array;
use crate::frames::Frames;
use crate::landmarks::Cover;
use crate::metric::Metric;
use crate::neighbors::length;

/// Which of the trained frames are reference frames, and which of these is nearest to each.
#[derive(Clone, Debug)]
pub struct ReferenceSet {
    /// Among the trained frames, ascending, shape `(n_frames,)`.
    indices: Array<u32>,
    /// Among the reference frames, shape `(n_trained,)`.
    nearest: Array<u32>,
}

impl ReferenceSet {
    /// Every trained frame is a reference frame.
    fn all(n_trained: usize) -> Self {
        let indices: Array<u32> = (0..n_trained as u32).collect::<Vec<u32>>().into();
        Self { nearest: indices.clone(), indices }
    }

    /// Chooses `n_frames` that cover the trained ones, from the first of them on. All if there are no more.
    ///
    /// * `n_frames` — at least 1
    /// * `done` — told the number of frames chosen
    ///
    /// The same on any number of threads. O(n_frames · n_trained) distances at worst; on trips a quarter to a half of these are
    /// measured ([`Cover`]).
    pub(crate) fn choose(
        trained: &Frames,
        metric: &impl Metric,
        n_frames: usize,
        done: &mut dyn FnMut(usize),
    ) -> Self {
        let n_trained = trained.n_frames();
        if n_frames >= n_trained {
            return Self::all(n_trained);
        }
        let mut cover = Cover::new(trained, metric);
        let mut indices = Vec::with_capacity(n_frames);
        for n_done in 1..=n_frames {
            // Of none chosen, the first frame is farthest.
            let farthest = cover.farthest();
            cover.choose(farthest);
            indices.push(farthest);
            done(n_done);
        }
        indices.sort_unstable();
        Self { indices: indices.into(), nearest: cover.nearest().into() }
    }

    /// Takes what a file holds. The caller asks whether it [`fits`](Self::fits).
    pub(crate) fn from_parts(indices: Array<u32>, nearest: Array<u32>) -> Self {
        Self { indices, nearest }
    }

    /// Whether indices ascend, every reference frame stands for itself, and only reference frames stand for any.
    pub(crate) fn fits(&self) -> bool {
        let stands_for_itself = |(reference, &index): (u32, &u32)| {
            self.nearest.get(index as usize).is_some_and(|&nearest| nearest == reference)
        };
        self.indices.is_sorted()
            && (0..).zip(self.indices.iter()).all(stands_for_itself)
            && self.nearest.iter().all(|&reference| (reference as usize) < self.n_frames())
    }

    /// Which of the trained frames the reference frames are, ascending, shape `(n_frames,)`.
    pub fn indices(&self) -> &[u32] {
        &self.indices
    }

    /// Which of the reference frames is nearest to each trained frame, of equals the first, shape `(n_trained,)`. To a
    /// reference frame that is itself.
    pub fn nearest(&self) -> &[u32] {
        &self.nearest
    }

    /// N.
    pub fn n_frames(&self) -> usize {
        self.indices.len()
    }

    /// Frames that kinds are learnt from.
    pub fn n_trained(&self) -> usize {
        self.nearest.len()
    }

    /// Whether all trained frames are reference frames.
    pub fn is_all(&self) -> bool {
        self.n_frames() == self.n_trained()
    }

    /// The reference frames themselves. Copies them unless they are all.
    pub(crate) fn of(&self, trained: &Frames) -> Frames {
        if self.is_all() { trained.clone() } else { trained.select(&self.indices) }
    }

    /// Farthest that a trained frame is from the nearest reference frame, counts.
    pub(crate) fn covering_radius(&self, trained: &Frames, metric: &impl Metric) -> f32 {
        let squared = |(index, &nearest): (usize, &u32)| {
            metric.squared_distance(trained.row(index), trained.row(self.indices[nearest as usize] as usize))
        };
        length(self.nearest.par_iter().enumerate().map(squared).max().unwrap_or(0))
    }

    /// Pairs of different reference frames that stand for frames which follow each other in a trip.
    ///
    /// Not of reference frames that follow each other: between two of these a robot may have been to many places, all of
    /// which look like some that it saw before, and an edge would be a short circuit past them.
    ///
    /// * `trips` — trained frames of each trip, in their order
    pub(crate) fn consecutive<'a>(&'a self, trips: &'a [usize]) -> impl Iterator<Item = (u32, u32)> + 'a {
        let mut left = self.nearest();
        let of_trip = move |n_frames: &usize| {
            let (of_trip, of_others) = left.split_at(*n_frames);
            left = of_others;
            of_trip.windows(2).map(|pair| (pair[0], pair[1]))
        };
        trips.iter().flat_map(of_trip).filter(|(before, after)| before != after)
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;
    use crate::metric::Euclidean;

    fn chosen(frames: &Frames, n_frames: usize) -> ReferenceSet {
        ReferenceSet::choose(frames, &Euclidean, n_frames, &mut |_| ())
    }

    /// Few different counts make ties and frames that are alike common.
    fn frames() -> impl Strategy<Value = (Frames, usize)> {
        (1..4_usize, 2..60_usize).prop_flat_map(|(n_readings, n_trained)| {
            let counts = prop::collection::vec(prop_oneof![0..6_u16, 0..2000_u16], n_readings * n_trained);
            (counts.prop_map(move |counts| Frames::new(n_readings, counts)), 1..=n_trained)
        })
    }

    proptest! {
        #[test]
        fn every_frame_is_within_the_covering_radius_of_its_nearest_and_no_two_reference_frames_are_nearer(
            (frames, n_frames) in frames(),
        ) {
            let references = chosen(&frames, n_frames);
            prop_assert!(references.fits());
            prop_assert_eq!((references.n_frames(), references.n_trained()), (n_frames, frames.n_frames()));
            let squared = |a: u32, b: u32| Euclidean.squared_distance(frames.row(a as usize), frames.row(b as usize));
            let mut squared_radius = 0;
            for (index, &nearest) in (0..).zip(references.nearest()) {
                // The plainest way: all distances, of equals the first, but a reference frame stands for itself.
                let to_each = references.indices().iter().map(|&other| (squared(index, other), other != index));
                let expected = (0..).zip(to_each).min_by_key(|&(reference, distance)| (distance, reference)).unwrap();
                prop_assert_eq!(nearest, expected.0);
                squared_radius = squared_radius.max(expected.1.0);
            }
            prop_assert_eq!(references.covering_radius(&frames, &Euclidean), length(squared_radius));
            for (place, &a) in references.indices().iter().enumerate() {
                for &b in &references.indices()[..place] {
                    prop_assert!(squared(a, b) >= squared_radius);
                }
            }
        }
    }

    #[test]
    fn as_many_frames_as_there_are_or_more_are_all_kept() {
        let frames = Frames::new(1, vec![5, 5, 9]);
        for n_frames in [3, 4, usize::MAX] {
            let references = chosen(&frames, n_frames);
            assert!(references.is_all());
            assert_eq!((references.indices(), references.nearest()), (&[0, 1, 2][..], &[0, 1, 2][..]));
            assert_eq!(references.of(&frames).counts().as_ptr(), frames.counts().as_ptr());
        }
    }

    #[test]
    fn a_robot_that_stands_still_takes_up_one_frame_and_a_place_seen_once_is_kept() {
        let frames = Frames::new(1, [vec![700; 50], vec![3000], vec![700; 9], vec![800]].concat());
        let references = chosen(&frames, 3);
        assert_eq!(references.indices(), [0, 50, 60]);
        assert_eq!(references.of(&frames).counts(), [700, 3000, 800]);
        assert_eq!((references.nearest()[49], references.nearest()[55]), (0, 0));
        assert_eq!(references.covering_radius(&frames, &Euclidean), 0.0);
    }

    #[test]
    fn pairs_stand_for_frames_that_follow_each_other_and_no_trip_goes_on_in_the_next() {
        let frames = Frames::new(1, vec![0, 10, 1000, 1010, 0, 3000, 3000, 1001]);
        let references = chosen(&frames, 3);
        assert_eq!(
            (references.indices(), references.nearest()),
            (&[0, 3, 5][..], &[0, 0, 1, 1, 0, 2, 2, 1][..])
        );
        let pairs = |trips: &[usize]| references.consecutive(trips).collect::<Vec<_>>();
        assert_eq!(pairs(&[8]), [(0, 1), (1, 0), (0, 2), (2, 1)]);
        assert_eq!(pairs(&[2, 3, 0, 3]), [(1, 0), (2, 1)]);
    }

    #[test]
    fn arrays_that_do_not_fit_each_other_are_seen() {
        let fits = |indices: &[u32], nearest: &[u32]| {
            ReferenceSet::from_parts(indices.to_vec().into(), nearest.to_vec().into()).fits()
        };
        assert!(fits(&[1, 2], &[0, 0, 1, 1]));
        assert!(!fits(&[2, 1], &[0, 1, 0, 1]), "not ascending");
        assert!(!fits(&[1, 2], &[0, 1, 0, 1]), "stands for another");
        assert!(!fits(&[1, 4], &[0, 0, 1, 1]), "beyond the trained frames");
        assert!(!fits(&[1, 2], &[2, 0, 1, 1]), "beyond the reference frames");
    }
}
