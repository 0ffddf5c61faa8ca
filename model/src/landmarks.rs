//! Landmarks: the reference frames that geodesics are measured from.

use rand::seq::index;
use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::SeedableRng;

/// Chooses `n_landmarks` of `n_frames` frames at random, by rising index. All of them if there are no more.
pub fn choose(n_frames: usize, n_landmarks: usize, seed: u64) -> Vec<u32> {
    if n_landmarks >= n_frames {
        return (0..n_frames as u32).collect();
    }
    let mut random = ChaCha8Rng::seed_from_u64(seed);
    let mut landmarks: Vec<u32> =
        index::sample(&mut random, n_frames, n_landmarks).into_iter().map(|index| index as u32).collect();
    landmarks.sort_unstable();
    landmarks
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn landmarks_are_distinct_frames_that_follow_from_the_seed() {
        let chosen = choose(1000, 100, 7);
        assert_eq!(chosen.len(), 100);
        assert!(chosen.windows(2).all(|pair| pair[0] < pair[1]) && chosen[99] < 1000);
        assert_eq!(chosen, choose(1000, 100, 7));
        assert_ne!(chosen, choose(1000, 100, 8));
    }

    #[test]
    fn every_frame_is_a_landmark_when_as_many_are_asked_for() {
        assert_eq!(choose(5, 9, 0), [0, 1, 2, 3, 4]);
    }
}
