//! Neighbours and intrinsic dimension by evidence, where the truth is known.

use std::f64::consts::PI;

use kinds_model::graph::Graph;
use kinds_model::intrinsic_dims::{N_NEIGHBORS_USED, maximum_likelihood, two_nn};
use kinds_model::metric::{Euclidean, Metric};
use kinds_model::neighborhood::{
    N_NEIGHBORS_TRIED_MAX, candidates, chosen, runner_up, short_circuits, try_neighbors,
};
use kinds_model::neighbors::{NeighborLists, nearest_of_each};
use kinds_model::{
    FitPlan, Frames, LandmarkChoice, Method, Model, NeighborsTrial, Origin, ResponsePlan, Scale,
    SensorLayout, file, fit,
};
use proptest::prelude::*;
use rand::RngExt;
use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::SeedableRng;

/// Close to a normal distribution of variance 1 (Irwin & Hall: twelve even ones).
fn normal(random: &mut ChaCha8Rng) -> f64 {
    (0..12).map(|_| random.random::<f64>()).sum::<f64>() - 6.0
}

/// Frames from all over a cube, turned at random in a space of fifty readings; a side is about 30,000 counts long.
fn cube(n_dims: usize, n_frames: usize) -> Frames {
    let mut random = ChaCha8Rng::seed_from_u64(n_dims as u64);
    let axes: Vec<[f64; 50]> =
        (0..n_dims).map(|_| std::array::from_fn(|_| 4000.0 * normal(&mut random))).collect();
    let frame = |_| {
        let mut frame = [32_000.0; 50];
        for axis in &axes {
            let place = random.random::<f64>() - 0.5;
            frame.iter_mut().zip(axis).for_each(|(reading, along)| *reading += place * along);
        }
        frame.map(|reading: f64| reading as u16)
    };
    Frames::new(50, (0..n_frames).flat_map(frame).collect::<Vec<u16>>())
}

/// A sheet rolled up one and a half times, as scikit-learn rolls it, a thousand counts to its unit.
fn swiss_roll(n_frames: usize) -> Frames {
    let mut random = ChaCha8Rng::seed_from_u64(3);
    let frame = |_| {
        let angle = 1.5 * PI * (1.0 + 2.0 * random.random::<f64>());
        let along = 21.0 * random.random::<f64>();
        [angle * angle.cos() + 16.0, along, angle * angle.sin() + 16.0].map(|place| (1000.0 * place) as u16)
    };
    Frames::new(3, (0..n_frames).flat_map(frame).collect::<Vec<u16>>())
}

fn tried(frames: &Frames) -> Vec<NeighborsTrial> {
    let n_listed = N_NEIGHBORS_TRIED_MAX.min(frames.n_frames() - 1);
    let lists = nearest_of_each(frames, &Euclidean, n_listed, &mut |_| ());
    let landmarks: Vec<u32> = (0..frames.n_frames() as u32).step_by(5).collect();
    try_neighbors(frames, &Euclidean, &lists, &[], &landmarks, None, &mut |_, _| ())
}

fn numbers(trials: &[NeighborsTrial]) -> Vec<usize> {
    trials.iter().map(|trial| trial.n_neighbors).collect()
}

#[test]
fn a_roll_gets_too_few_neighbours_to_reach_from_one_turn_to_the_next() {
    // The ends of 500 frames' neighbourhoods come as far as the next turn with about eight neighbours.
    let trials = tried(&swiss_roll(500));
    let best = chosen(&trials).unwrap();
    assert!(best.residual_variance < 0.005, "{best:?}");
    let touching: Vec<_> = short_circuits(&trials).into_iter().map(|index| &trials[index]).collect();
    let first = touching.iter().find(|trial| trial.residual_variance > 0.03).expect("turns touch somewhere");
    assert!(best.n_neighbors < first.n_neighbors, "{best:?} {first:?}");
    // From there on the roll is lost.
    assert!(
        trials
            .iter()
            .all(|trial| (trial.n_neighbors < first.n_neighbors) == (trial.residual_variance < 0.005))
    );
}

#[test]
fn what_is_tried_begins_where_nearly_all_frames_are_on_one_island() {
    let frames = cube(3, 400);
    let trials = tried(&frames);
    assert_eq!(numbers(&trials), (trials[0].n_neighbors..=N_NEIGHBORS_TRIED_MAX).collect::<Vec<_>>());
    let lists = nearest_of_each(&frames, &Euclidean, N_NEIGHBORS_TRIED_MAX, &mut |_| ());
    let islands = |n_neighbors| Graph::union(&lists, n_neighbors, &[]).islands();
    let is_one = |islands: &[Vec<u32>]| islands.len() <= 4 && islands[0].len() >= 380;
    let fewest = trials[0].n_neighbors;
    assert!(fewest > 1 && is_one(&islands(fewest)), "{fewest}");
    assert!((1..fewest).all(|n_neighbors| !is_one(&islands(n_neighbors))));
}

#[test]
fn places_that_have_nothing_in_common_are_bridged_whatever_the_number() {
    let (near, mut counts) = (cube(2, 100), Vec::new());
    for place in 0..3 {
        counts.extend(near.counts().iter().map(|count| count / 10 + 20_000 * place));
    }
    let trials = tried(&Frames::new(50, counts));
    assert_eq!(trials.last().unwrap().n_islands, 3);
    assert!(trials.iter().all(|trial| trial.bridges.len() == trial.n_islands - 1 && trial.n_islands <= 4));
    assert!(trials.iter().all(|trial| trial.bridges.is_sorted()));
}

proptest! {
    #[test]
    fn bridges_handed_up_are_those_of_joining_each_graph_anew(counts in prop::collection::vec(0..60_000_u16, 40..80)) {
        let frames = Frames::new(1, counts);
        let lists = nearest_of_each(&frames, &Euclidean, N_NEIGHBORS_TRIED_MAX, &mut |_| ());
        for trial in tried(&frames) {
            let mut graph = Graph::union(&lists, trial.n_neighbors, &[]);
            prop_assert_eq!(trial.n_islands, graph.islands().len());
            let squared = |a: u32, b: u32| Euclidean.squared_distance(frames.row(a as usize), frames.row(b as usize));
            let bridges: Vec<f32> = graph.join_islands(squared).iter().map(|bridge| bridge.length).collect();
            prop_assert_eq!(trial.bridges, bridges);
        }
    }
}

fn trial(n_neighbors: usize, residual_variance: f64, median_geodesic: f64) -> NeighborsTrial {
    NeighborsTrial {
        n_neighbors,
        n_islands: 1,
        bridges: vec![],
        n_dims: 3,
        residual_variance,
        median_geodesic,
    }
}

#[test]
fn the_fewest_neighbours_near_the_least_residual_variance_are_chosen_and_the_least_of_the_others_runs_up() {
    let trials = [trial(5, 0.3, 90.0), trial(6, 0.1, 89.0), trial(7, 0.2, 80.0), trial(8, 0.095, 79.0)];
    assert_eq!((chosen(&trials), runner_up(&trials)), (Some(&trials[1]), Some(&trials[3])));
    let trials = [trial(5, 0.3, 90.0), trial(6, 0.1, 89.0), trial(7, 0.2, 80.0), trial(8, 0.085, 79.0)];
    assert_eq!((chosen(&trials), runner_up(&trials)), (Some(&trials[3]), Some(&trials[1])));
    assert_eq!((chosen(&trials[..1]), runner_up(&trials[..1])), (Some(&trials[0]), None));
    assert_eq!((chosen(&[]), runner_up(&[])), (None, None));
    // 89 → 80 is just over a tenth, 90 → 89 and 80 → 79 are not; 0.1 → 0.2 is hardly twice.
    assert_eq!(
        short_circuits(&[trial(5, 0.3, 90.0), trial(6, 0.1, 89.0), trial(7, 0.2, 80.0), trial(8, 0.1, 79.0)]),
        [2]
    );
    assert_eq!(short_circuits(&[trial(5, 0.1, 90.0), trial(6, 0.201, 90.0)]), [1]);
    assert_eq!(short_circuits(&[]), [0; 0]);
}

#[test]
fn the_usual_number_is_the_fewest_that_is_chosen_unless_it_makes_a_short_circuit() {
    let check = |residual_variances: &[f64], expected: &[usize], best: usize| {
        let trials: Vec<_> = (8..)
            .zip(residual_variances)
            .map(|(n_neighbors, &share)| trial(n_neighbors, share, 90.0))
            .collect();
        assert_eq!(numbers(candidates(&trials)), expected, "{residual_variances:?}");
        assert_eq!(chosen(&trials).unwrap().n_neighbors, best, "{residual_variances:?}");
    };
    // The thread of a trip: the fewer neighbours, the more nearly a line.
    check(&[0.012, 0.016, 0.03, 0.028, 0.035], &[10, 11, 12], 10);
    check(&[0.01, 0.012, 0.06, 0.055, 0.04], &[8, 9], 8);
    check(&[0.01, 0.012, 0.02, 0.021, 0.06], &[10, 11], 10);
    // Twice nearly nothing is nearly nothing.
    check(&[0.001, 0.001, 0.003, 0.001, 0.006], &[10, 11, 12], 10);
    check(&[0.3, 0.2], &[8, 9], 9);
}

#[test]
fn a_trip_of_few_frames_is_tried_as_far_as_there_are_neighbours() {
    assert_eq!(numbers(&tried(&Frames::new(1, vec![0, 10, 20, 30]))).last(), Some(&3));
    // All alike: any number will do, and none is a reason to give up here.
    assert_eq!(chosen(&tried(&Frames::new(2, vec![7; 40]))).unwrap().residual_variance, 1.0);
}

/// Both estimates of frames.
fn intrinsic(frames: &Frames) -> [f64; 2] {
    let lists = nearest_of_each(frames, &Euclidean, N_NEIGHBORS_USED, &mut |_| ());
    [two_nn(&lists).unwrap(), maximum_likelihood(&lists).unwrap()]
}

#[test]
fn planes_rolls_and_cubes_have_the_dimensions_that_they_have() {
    // A frame near an edge has its neighbours on one side, and is taken for one of fewer dimensions: with 2000 frames the
    // estimates fall short of 3 by up to a tenth and of 5 by up to a sixth, and do not exceed either by more than chance,
    // whose standard error is d / √N for two neighbours.
    for (frames, n_dims, short) in [
        (cube(2, 2000), 2.0, 0.1),
        (swiss_roll(2000), 2.0, 0.1),
        (cube(3, 2000), 3.0, 0.1),
        (cube(5, 2000), 5.0, 1.0 / 6.0),
    ] {
        for found in intrinsic(&frames) {
            let chance = 3.0 * n_dims / (2000.0_f64).sqrt();
            assert!(found > (1.0 - short) * n_dims && found < n_dims + chance, "{found} instead of {n_dims}");
        }
    }
}

#[test]
fn frames_seen_twice_change_no_estimate() {
    let once = cube(3, 300);
    let twice = Frames::new(50, [once.counts(), once.counts()].concat());
    let lists = |frames: &Frames, k| nearest_of_each(frames, &Euclidean, k, &mut |_| ());
    let relative = |of: fn(&NeighborLists) -> Option<f64>| {
        // A frame's other self, and those of its twenty neighbours.
        (of(&lists(&twice, 41)).unwrap() / of(&lists(&once, 20)).unwrap() - 1.0).abs()
    };
    assert!(relative(maximum_likelihood) < 1e-12);
    // The ratios are the same, and their ranks differ by half a step.
    assert!(relative(two_nn) < 0.01, "{}", relative(two_nn));
    // Nothing but copies says nothing.
    let copies = Frames::new(1, vec![5; 30]);
    assert_eq!((two_nn(&lists(&copies, 20)), maximum_likelihood(&lists(&copies, 20))), (None, None));
    assert_eq!(maximum_likelihood(&lists(&Frames::new(1, (0..8).collect::<Vec<u16>>()), 7)), None);
}

/// Counts compared as they are: a metre each.
fn as_they_are(landmark_choice: LandmarkChoice, n_neighbors: Option<usize>) -> FitPlan {
    FitPlan {
        n_neighbors,
        n_landmarks: 60,
        landmark_choice,
        n_kinds: Some(2),
        ..FitPlan::new(
            SensorLayout { rows: 1, columns: 50, metres_per_count: 1.0 },
            ResponsePlan::new(Scale::Range, 65_535.0),
            1,
        )
    }
}

fn fitted(plan: &FitPlan) -> Model {
    fit(cube(3, 300).counts().to_vec(), plan, Origin::default(), &mut |_, _, _| ()).unwrap()
}

#[test]
fn a_model_has_the_number_of_neighbours_that_is_best_and_says_what_was_tried() {
    let model = fitted(&as_they_are(LandmarkChoice::Random, None));
    let manifest = model.manifest();
    let best = chosen(&manifest.provenance.neighbors_tried).unwrap();
    assert_eq!((manifest.n_neighbors, manifest.plan.n_neighbors), (best.n_neighbors, None));
    assert!(manifest.provenance.intrinsic_dims.two_nn.is_some_and(|n_dims| (2.0..4.0).contains(&n_dims)));
    // The same number asked for makes the same model, but for what it says of itself.
    let given = fitted(&as_they_are(LandmarkChoice::Random, Some(best.n_neighbors)));
    assert_eq!((given.coordinates(), given.squared_radii()), (model.coordinates(), model.squared_radii()));
    assert!(given.manifest().provenance.neighbors_tried.is_empty());
    // Without a graph there is nothing to choose by.
    let plan = FitPlan { method: Method::Pca, ..as_they_are(LandmarkChoice::Random, None) };
    let pca = fitted(&plan);
    assert_eq!((pca.manifest().n_neighbors, pca.manifest().provenance.neighbors_tried.len()), (10, 0));
}

#[test]
fn landmarks_and_neighbours_are_the_same_bytes_on_one_thread_and_on_two() {
    for choice in [LandmarkChoice::Random, LandmarkChoice::Farthest, LandmarkChoice::KMeans] {
        let on = |n_threads| {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(n_threads).build().unwrap();
            pool.install(|| file::to_bytes(&fitted(&as_they_are(choice, None))))
        };
        assert!(on(1) == on(2), "{choice:?}");
    }
}
