//! How sensitive consistency is to where the poses say the robot was: the paper's registration errors, put in on purpose.

use kinds_trips::Pose;
use rand::RngExt;
use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::SeedableRng;
use rayon::prelude::*;
use serde::Serialize;

use crate::consistency::{Revisits, kappa};
use crate::places::{Places, SamePlace};

/// Standard deviations of the errors, as multiples of the radius.
const SIGMAS_PER_RADIUS: [f64; 5] = [0.1, 0.25, 0.5, 1.0, 2.0];

/// How often each is drawn.
const N_DRAWS: u64 = 4;

/// Consistency with errors of one size in the second trip's poses.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct RegistrationScores {
    /// σ of the errors, along x and along y, metres.
    pub sigma_m: f64,
    /// Each pose is off by an error of its own.
    pub each_pose: Option<Jittered>,
    /// The whole trip is off by one error, as where two maps were laid over each other by hand.
    pub whole_trip: Option<Jittered>,
}

/// Scores over several draws of the errors.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Jittered {
    /// Mean C.
    pub consistency: f64,
    /// Mean κ.
    pub kappa: f64,
    /// Least and greatest κ.
    pub kappa_range: [f64; 2],
}

/// Measures consistency with errors of several sizes.
///
/// * `kinds` — of the frames of the first trip and of the second
///
/// Draws in which the trips do not meet any more are passed over. O(draws) times what it takes to find where trips meet, on the
/// threads of whoever calls.
pub(crate) fn scores(
    places: [&Places; 2],
    kinds: [&[usize]; 2],
    same_place: &SamePlace,
    share: f64,
    seed: u64,
    done: &(dyn Fn() + Sync),
) -> Vec<RegistrationScores> {
    let measured = |sigma_m: f64, each: bool| -> Option<Jittered> {
        let kappas: Vec<(f64, f64)> = (0..N_DRAWS)
            .into_par_iter()
            .filter_map(|draw| {
                let second = Places::new(jittered(places[1].poses(), sigma_m, each, seed.wrapping_add(draw)));
                let revisits = Revisits::find(places[0], &second, same_place);
                let found = revisits.consistency(kinds[0], kinds[1], share);
                done();
                found.map(|found| (found.consistency, kappa(found)))
            })
            .collect();
        let mean = |of: fn(&(f64, f64)) -> f64| kappas.iter().map(of).sum::<f64>() / kappas.len() as f64;
        let least = kappas.iter().map(|(_, kappa)| *kappa).fold(f64::INFINITY, f64::min);
        let greatest = kappas.iter().map(|(_, kappa)| *kappa).fold(f64::NEG_INFINITY, f64::max);
        (!kappas.is_empty()).then(|| Jittered {
            consistency: mean(|(consistency, _)| *consistency),
            kappa: mean(|(_, kappa)| *kappa),
            kappa_range: [least, greatest],
        })
    };
    SIGMAS_PER_RADIUS
        .iter()
        .map(|multiple| {
            let sigma_m = multiple * same_place.radius_m;
            let [each_pose, whole_trip] = [true, false].map(|each| measured(sigma_m, each));
            RegistrationScores { sigma_m, each_pose, whole_trip }
        })
        .collect()
}

/// How many times `done` is told.
pub(crate) const N_STEPS: u64 = SIGMAS_PER_RADIUS.len() as u64 * 2 * N_DRAWS;

/// * `each` — whether every pose is off by an error of its own, or all by one
fn jittered(poses: &[Pose], sigma_m: f64, each: bool, seed: u64) -> Vec<Pose> {
    let mut random = ChaCha8Rng::seed_from_u64(seed);
    let mut error = normal_pair(&mut random);
    let moved = poses.iter().enumerate().map(|(index, pose)| {
        if each && index > 0 {
            error = normal_pair(&mut random);
        }
        Pose { x_m: pose.x_m + sigma_m * error.0, y_m: pose.y_m + sigma_m * error.1, yaw_rad: pose.yaw_rad }
    });
    moved.collect()
}

/// Two independent normal deviates, by Box & Muller 1958, *A note on the generation of random normal deviates*.
fn normal_pair(random: &mut ChaCha8Rng) -> (f64, f64) {
    // Never 0, whose logarithm there is not.
    let radius = (-2.0 * (1.0 - random.random::<f64>()).ln()).sqrt();
    let (sine, cosine) = (std::f64::consts::TAU * random.random::<f64>()).sin_cos();
    (radius * cosine, radius * sine)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn errors_have_the_deviation_that_is_asked_for_and_a_whole_trip_has_one() {
        let poses = vec![Pose { x_m: 5.0, y_m: -1.0, yaw_rad: 0.5 }; 20_000];
        let each = jittered(&poses, 0.2, true, 1);
        let variance =
            |of: fn(&Pose) -> f64| each.iter().map(|pose| of(pose).powi(2)).sum::<f64>() / 20_000.0;
        // The variance of 20,000 deviates is known to 1 %.
        assert!((variance(|pose| pose.x_m - 5.0) / 0.04 - 1.0).abs() < 0.04);
        assert!((variance(|pose| pose.y_m + 1.0) / 0.04 - 1.0).abs() < 0.04);
        let whole = jittered(&poses, 0.2, false, 1);
        assert!(whole.iter().all(|pose| *pose == whole[0]) && whole[0] != poses[0]);
        assert_eq!(jittered(&poses, 0.2, true, 1), each, "the seed decides");
        assert_ne!(jittered(&poses, 0.2, true, 2), each);
    }

    #[test]
    fn small_errors_do_little_harm_and_large_ones_more() {
        // 40 m of path in kinds of 2 m, passed by twice.
        let line = |offset_m: f64| -> Vec<Pose> {
            (0..400)
                .map(|frame| Pose { x_m: f64::from(frame) / 10.0 + offset_m, y_m: 0.0, yaw_rad: 0.0 })
                .collect()
        };
        let kinds: Vec<usize> = (0..400).map(|frame| frame / 20 % 4).collect();
        let (first, second) = (Places::new(line(0.0)), Places::new(line(0.0)));
        let found = scores([&first, &second], [&kinds, &kinds], &SamePlace::within(0.3), 0.5, 0, &|| ());
        assert_eq!(found.len(), 5);
        assert!((found[0].sigma_m - 0.03).abs() < 1e-12 && (found[4].sigma_m - 0.6).abs() < 1e-12);
        let each: Vec<f64> = found.iter().map(|scores| scores.each_pose.unwrap().kappa).collect();
        let whole: Vec<f64> = found.iter().map(|scores| scores.whole_trip.unwrap().kappa).collect();
        // Off by less than the 10 cm between frames, at most one frame of the twenty of a kind changes sides: C is at least
        // 0.95, and κ at least 1 − 0.05 / 0.75, chance being about a quarter.
        assert!(each[0] > 0.93 && whole[0] > 0.93, "{each:?} {whole:?}");
        assert!(each[4] < each[0] && whole[4] < whole[0], "{each:?} {whole:?}");
        for scores in found.iter().filter_map(|scores| scores.whole_trip) {
            let [least, greatest] = scores.kappa_range;
            assert!(least <= scores.kappa + 1e-12 && scores.kappa <= greatest + 1e-12);
        }
    }
}
