//! Dimensions and kinds by evidence, where the truth is known.

use kinds_model::autocorrelation::n_frames_effective;
use kinds_model::em::dirichlet::{DirichletFit, fit_dirichlet, likeliest};
use kinds_model::evidence::{
    N_KINDS_TRIED_MAX, best_by_bic_neff, best_by_bound, best_by_held_out, of_at_least, runner_up_by_bound,
    try_kinds,
};
use kinds_model::{
    EmPlan, FitPlan, KindsBy, KindsTrial, Method, Model, Origin, ResponsePlan, Scale, SensorLayout, Size,
    file, fit, refit,
};
use rand::RngExt;
use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::SeedableRng;

/// Close to a normal distribution of variance 1 (Irwin & Hall: twelve even ones).
fn normal(random: &mut ChaCha8Rng) -> f64 {
    (0..12).map(|_| random.random::<f64>()).sum::<f64>() - 6.0
}

const N_READINGS: usize = 50;

/// Frames from all over a cube of some dimensions, turned at random in a space of fifty: a side is 8000 counts long, and
/// every reading has noise of 40.
fn cube(n_dims: usize, n_frames: usize) -> Vec<u16> {
    let mut random = ChaCha8Rng::seed_from_u64(n_dims as u64);
    // Nearly orthogonal, as random directions of many dimensions are.
    let axes: Vec<[f64; N_READINGS]> = (0..n_dims)
        .map(|_| {
            let axis: [f64; N_READINGS] = std::array::from_fn(|_| normal(&mut random));
            let length = axis.iter().map(|along| along * along).sum::<f64>().sqrt();
            axis.map(|along| 8000.0 * along / length)
        })
        .collect();
    (0..n_frames)
        .flat_map(|_| {
            let mut frame =
                [0.0; N_READINGS].map(|centre: f64| centre + 30_000.0 + 40.0 * normal(&mut random));
            for axis in &axes {
                let place = random.random::<f64>();
                frame.iter_mut().zip(axis).for_each(|(reading, along)| *reading += place * along);
            }
            frame.map(|reading| reading as u16)
        })
        .collect()
}

/// Counts compared as they are: a metre each.
fn as_they_are(n_readings: usize) -> FitPlan {
    FitPlan {
        n_neighbors: Some(10),
        n_landmarks: 500,
        ..FitPlan::new(
            SensorLayout { rows: 1, columns: n_readings as u32, metres_per_count: 1.0 },
            ResponsePlan::new(Scale::Range, 65_535.0),
            1,
        )
    }
}

fn fitted(counts: Vec<u16>, plan: &FitPlan) -> Model {
    fit(counts, plan, Origin::default(), &mut |_, _, _| ()).unwrap()
}

#[test]
fn cubes_of_three_five_and_eight_dimensions_have_their_elbow_there_and_two_more_are_kept() {
    for n_dims in [3, 5, 8] {
        let plan = FitPlan { n_kinds: Some(1), ..as_they_are(N_READINGS) };
        let model = fitted(cube(n_dims, 1000), &plan);
        let provenance = &model.manifest().provenance;
        assert_eq!(provenance.elbow, n_dims, "{:?}", provenance.residual_variance);
        assert_eq!(model.manifest().n_dims, n_dims + 2);
    }
}

#[test]
fn no_more_dimensions_are_kept_than_there_are() {
    // Three readings: the elbow and two more would be one too many.
    let counts: Vec<u16> =
        cube(2, 200).chunks_exact(N_READINGS).flat_map(|frame| frame[..3].to_vec()).collect();
    let plan = FitPlan { method: Method::Pca, n_kinds: Some(1), ..as_they_are(3) };
    let model = fitted(counts, &plan);
    assert_eq!((model.manifest().provenance.elbow, model.manifest().n_dims), (2, 3));
}

const N_DIMS: usize = 8;

/// Draws from kinds far apart, of unlike spread in every direction, in random order.
fn draws(n_kinds: usize, n_draws: usize) -> Vec<[f64; N_DIMS]> {
    let mut random = ChaCha8Rng::seed_from_u64(n_kinds as u64);
    let kinds: Vec<([f64; N_DIMS], [f64; N_DIMS])> = (0..n_kinds)
        .map(|_| {
            let centre = std::array::from_fn(|_| 10_000.0 * normal(&mut random));
            (centre, std::array::from_fn(|_| random.random_range(500.0..2000.0)))
        })
        .collect();
    let draw = |_| {
        let (centre, spread) = kinds[random.random_range(0..n_kinds)];
        std::array::from_fn(|dim| centre[dim] + spread[dim] * normal(&mut random))
    };
    (0..n_draws).map(draw).collect()
}

/// Every draw is looked at for a while, by a sensor that has a little noise.
fn slow(n_kinds: usize) -> Vec<f64> {
    let mut random = ChaCha8Rng::seed_from_u64(7);
    draws(n_kinds, 70 * n_kinds)
        .into_iter()
        .flat_map(|draw| vec![draw; 12])
        .flat_map(|draw| draw.map(|place| place + 50.0 * normal(&mut random)))
        .collect()
}

fn tried(coordinates: &[f64]) -> Vec<KindsTrial> {
    let n_effective = n_frames_effective(coordinates, N_DIMS, &[coordinates.len() / N_DIMS]);
    try_kinds(coordinates, N_DIMS, n_effective, &EmPlan::new(1), &mut |_| ()).unwrap()
}

fn best_by_bic(trials: &[KindsTrial]) -> usize {
    trials.iter().min_by(|a, b| a.bic.total_cmp(&b.bic)).unwrap().n_kinds
}

#[test]
fn kinds_far_apart_are_counted_right_by_all_evidence_where_frames_are_independent() {
    for n_kinds in [3, 5, 8] {
        let trials = tried(&draws(n_kinds, 1200).concat());
        assert_eq!(best_by_bic_neff(&trials).unwrap().n_kinds, n_kinds);
        assert_eq!(best_by_held_out(&trials).unwrap().n_kinds, n_kinds);
        assert_eq!(best_by_bic(&trials), n_kinds);
    }
}

#[test]
fn kinds_far_apart_are_counted_right_on_a_slow_trip_where_plain_bic_goes_to_its_cap() {
    for n_kinds in [3, 5, 8] {
        let trials = tried(&slow(n_kinds));
        assert_eq!(best_by_bic_neff(&trials).unwrap().n_kinds, n_kinds);
        // Where it may not be so few, the fewest that it may be: each more costs more. Beyond all trials, the last.
        let of_more = |n_kinds_min| best_by_bic_neff(of_at_least(&trials, n_kinds_min)).unwrap().n_kinds;
        let found = [0, 1, n_kinds, n_kinds + 1, N_KINDS_TRIED_MAX + 9].map(of_more);
        assert_eq!(found, [n_kinds, n_kinds, n_kinds, n_kinds + 1, N_KINDS_TRIED_MAX]);
        assert_eq!(best_by_bic(&trials), N_KINDS_TRIED_MAX);
    }
}

fn by_dirichlet(coordinates: &[f64], n_effective: f64) -> DirichletFit {
    let fits = fit_dirichlet(coordinates, N_DIMS, n_effective, &EmPlan::new(1), &mut |_| ()).unwrap();
    likeliest(fits).unwrap()
}

#[test]
fn a_dirichlet_process_counts_kinds_far_apart_right_where_frames_are_independent() {
    for n_kinds in [3, 5, 8] {
        let fit = by_dirichlet(&draws(n_kinds, 1200).concat(), 1200.0);
        assert_eq!(fit.mixture.n_kinds(), n_kinds, "{:?}", fit.n_frames_of_kinds);
        assert!(fit.converged && fit.mixture.weights().is_sorted_by(|a, b| a >= b));
    }
}

#[test]
fn a_dirichlet_process_counts_right_on_a_slow_trip_where_frames_that_all_count_would_make_more() {
    for n_kinds in [3, 5, 8] {
        let slow = slow(n_kinds);
        let n_frames = slow.len() / N_DIMS;
        let fit = by_dirichlet(&slow, n_frames_effective(&slow, N_DIMS, &[n_frames]));
        assert_eq!(fit.mixture.n_kinds(), n_kinds, "{:?}", fit.n_frames_of_kinds);
        let n_found = by_dirichlet(&slow, n_frames as f64).mixture.n_kinds();
        assert!(n_found > n_kinds, "{n_found} instead of {n_kinds}");
    }
}

/// A robot between three places, each frame of six readings with noise.
fn three_places(n_frames: usize) -> Vec<u16> {
    let mut random = ChaCha8Rng::seed_from_u64(4);
    (0..n_frames)
        .flat_map(|index| {
            let place = (index / 15) % 3;
            let reading = |reading: usize| 2000 + 900 * ((place * reading) % 5) + random.random_range(0..300);
            (0..6).map(reading).map(|count| count as u16).collect::<Vec<_>>()
        })
        .collect()
}

#[test]
fn evidence_and_model_are_the_same_on_one_thread_and_on_two() {
    let on = |n_threads| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(n_threads).build().unwrap();
        pool.install(|| file::to_bytes(&fitted(three_places(180), &as_they_are(6))))
    };
    assert!(on(1) == on(2));
}

#[test]
fn a_model_says_what_was_tried_and_has_the_best() {
    let model = fitted(three_places(180), &as_they_are(6));
    let provenance = &model.manifest().provenance;
    let numbers: Vec<usize> = provenance.kinds_tried.iter().map(|trial| trial.n_kinds).collect();
    assert_eq!(numbers, (1..=numbers.len()).collect::<Vec<_>>());
    let best = best_by_bic_neff(&provenance.kinds_tried).unwrap();
    assert_eq!((model.manifest().n_kinds, model.mixture().n_kinds()), (best.n_kinds, best.n_kinds));
    assert_eq!((provenance.log_likelihood, provenance.bic), (best.log_likelihood, best.bic));
    let n_effective = provenance.n_frames_effective;
    assert!(n_effective > 1.0 && n_effective < 180.0, "{n_effective}");
    for trial in &provenance.kinds_tried {
        let (j, d) = (trial.n_kinds as f64, model.manifest().n_dims as f64);
        let n_parameters = (j - 1.0) + j * d + j * d * (d + 1.0) / 2.0;
        let expected = [
            -2.0 * trial.log_likelihood + n_parameters * 180_f64.ln(),
            -2.0 * trial.log_likelihood + n_parameters * (180_f64.ln() + 1.0),
            -2.0 * n_effective / 180.0 * trial.log_likelihood + n_parameters * n_effective.ln(),
        ];
        for (found, expected) in [trial.bic, trial.caic, trial.bic_neff].iter().zip(expected) {
            assert!((found - expected).abs() < 1e-9 * expected.abs(), "{found} instead of {expected}");
        }
    }

    let given = fitted(three_places(180), &FitPlan { n_kinds: Some(4), ..as_they_are(6) });
    assert_eq!((given.mixture().n_kinds(), given.manifest().provenance.kinds_tried.len()), (4, 0));
    assert_eq!(given.manifest().provenance.n_frames_effective, n_effective);
}

#[test]
fn the_number_of_kinds_is_chosen_by_what_the_plan_names() {
    let model = |kinds_by| fitted(three_places(180), &FitPlan { kinds_by, ..as_they_are(6) });
    let held_out = model(KindsBy::HeldOut);
    let tried = &held_out.manifest().provenance.kinds_tried;
    assert_eq!(held_out.mixture().n_kinds(), best_by_held_out(tried).unwrap().n_kinds);
    assert_eq!(held_out.manifest().provenance.dirichlet, None);

    let found = model(KindsBy::Dirichlet);
    let provenance = &found.manifest().provenance;
    let process = provenance.dirichlet.as_ref().unwrap();
    let best = best_by_bound(&process.trials).unwrap();
    assert_eq!((found.mixture().n_kinds(), found.manifest().n_kinds), (best.n_kinds, best.n_kinds));
    assert_eq!((provenance.kinds_tried.len(), process.concentration), (0, 1.0));
    let begun: Vec<usize> = process.trials.iter().map(|trial| trial.n_kinds_begun).collect();
    assert_eq!(begun, (1..=N_KINDS_TRIED_MAX).collect::<Vec<_>>());
    let other = runner_up_by_bound(&process.trials).unwrap();
    assert!(other.n_kinds != best.n_kinds && other.lower_bound < best.lower_bound, "{other:?} {best:?}");
    let n_frames: f64 = process.n_frames_of_kinds.iter().sum();
    assert!((n_frames - provenance.n_frames_effective).abs() < 1e-9, "{n_frames}");
    // Asked for as many, it is a mixture like any other.
    let again = refit(&found, Method::Isomap, Size::Matched, &mut |_, _, _| ()).unwrap();
    assert_eq!(again.mixture().n_kinds(), best.n_kinds);
    assert_eq!(again.manifest().provenance.dirichlet, None);
}

#[test]
fn the_largest_kinds_share_is_that_of_the_frames_most_probably_its() {
    let model = fitted(three_places(180), &FitPlan { n_kinds: Some(3), ..as_they_are(6) });
    // Fifteen frames in each of three places in turn.
    assert_eq!(model.manifest().provenance.largest_kind_share, 1.0 / 3.0);
}

#[test]
fn a_trip_too_short_for_many_kinds_ends_what_is_tried_and_not_the_training() {
    let model = fitted(three_places(14), &as_they_are(6));
    let n_tried = model.manifest().provenance.kinds_tried.len();
    assert!((1..14).contains(&n_tried), "{n_tried}");
    assert!(model.mixture().n_kinds() <= n_tried);
}
