//! What must hold for whatever trip: the order of frames, their scale and offset and repeated frames change nothing that
//! they should not, and no trip makes a model of numbers that are none.

use std::sync::Arc;

use kinds_model::{
    Classifier, EmPlan, FitPlan, Method, Model, Origin, ResponsePlan, Scale, SensorLayout, fit,
};
use proptest::prelude::*;
use rand::RngExt;
use rand::seq::SliceRandom;
use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::SeedableRng;

const N_READINGS: usize = 4;
const N_FRAMES: usize = 60;

/// Ranges in mm, compared as they are: far below the longest, so that they can be scaled and moved.
fn plan(method: Method) -> FitPlan {
    FitPlan {
        method,
        n_neighbors: Some(5),
        n_dims: Some(2),
        n_kinds: Some(3),
        ..FitPlan::new(
            SensorLayout { rows: 1, columns: N_READINGS as u32, metres_per_count: 0.001 },
            ResponsePlan::new(Scale::Range, 65.535),
            1,
        )
    }
}

/// A trip through three places far apart, each with 20 frames that wander: no two frames and no two distances alike.
fn trip() -> impl Strategy<Value = Vec<[u16; N_READINGS]>> {
    any::<u64>().prop_map(|seed| {
        let mut random = ChaCha8Rng::seed_from_u64(seed);
        let place = |index: usize| {
            [[3000, 9000, 2000, 5000], [9000, 3000, 8000, 2500], [2500, 2500, 15_000, 12_000]][index]
        };
        (0..N_FRAMES)
            .map(|index| place(index * 3 / N_FRAMES).map(|range: u16| range + random.random_range(0..1500)))
            .collect()
    })
}

fn model(frames: &[[u16; N_READINGS]], method: Method) -> Model {
    fit(frames.concat(), &plan(method), Origin::default(), &mut |_, _, _| ())
        .expect("three places make a model")
}

/// The kind of every frame, numbered as they first occur.
fn kinds(model: &Model, frames: &[[u16; N_READINGS]]) -> Vec<usize> {
    let mut classifier = Classifier::new(Arc::new(model.clone()));
    let kinds: Vec<usize> = frames.iter().map(|frame| classifier.classify(frame).kind).collect();
    let mut met = Vec::new();
    for &kind in &kinds {
        if !met.contains(&kind) {
            met.push(kind);
        }
    }
    kinds.iter().map(|kind| met.iter().position(|other| other == kind).unwrap()).collect()
}

/// Coordinates are equal but for signs of whole dimensions. Relative to the largest coordinate.
fn check_places(found: &[f64], expected: &[f64], factor: f64, tolerance: f64) -> Result<(), TestCaseError> {
    let largest = expected.iter().fold(0.0, |most: f64, place| most.max(place.abs()));
    for dim in 0..2 {
        let of_dim = |places: &[f64]| places.iter().skip(dim).step_by(2).copied().collect::<Vec<f64>>();
        let (found, expected) = (of_dim(found), of_dim(expected));
        let agreement: f64 = found.iter().zip(&expected).map(|(a, b)| a * b).sum();
        for (found, expected) in found.iter().zip(&expected) {
            let error = (found - agreement.signum() * factor * expected).abs();
            prop_assert!(error <= tolerance * factor * largest, "{found} and {expected}");
        }
    }
    Ok(())
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(32))]

    #[test]
    fn frames_in_another_order_have_the_same_places_and_kinds(frames in trip(), seed in any::<u64>()) {
        for method in [Method::Isomap, Method::Pca] {
            let ordered = model(&frames, method);
            let mut order: Vec<usize> = (0..N_FRAMES).collect();
            order.shuffle(&mut ChaCha8Rng::seed_from_u64(seed));
            let shuffled: Vec<_> = order.iter().map(|&index| frames[index]).collect();
            let permuted = model(&shuffled, method);
            let expected: Vec<f64> =
                order.iter().flat_map(|&index| ordered.coordinates()[2 * index..][..2].to_vec()).collect();
            // Rounding of sums in another order, by the gap between eigenvalues.
            check_places(permuted.coordinates(), &expected, 1.0, 1e-6)?;
            prop_assert_eq!(kinds(&permuted, &frames), kinds(&ordered, &frames));
        }
    }

    #[test]
    fn ranges_in_another_unit_scale_the_places_and_change_no_kind(frames in trip(), factor in 2..4_u16) {
        for method in [Method::Isomap, Method::Pca] {
            let scaled: Vec<_> = frames.iter().map(|frame| frame.map(|range| factor * range)).collect();
            let (model, scaled_model) = (model(&frames, method), model(&scaled, method));
            // Lengths are rounded to 24 bits, each by itself.
            check_places(scaled_model.coordinates(), model.coordinates(), f64::from(factor), 1e-5)?;
            prop_assert_eq!(kinds(&scaled_model, &scaled), kinds(&model, &frames));
        }
    }

    #[test]
    fn a_frame_added_to_all_frames_changes_no_bit(
        frames in trip(),
        offset in prop::array::uniform4(0..20_000_u16),
    ) {
        for method in [Method::Isomap, Method::Pca] {
            let moved: Vec<[u16; N_READINGS]> = frames
                .iter()
                .map(|frame| std::array::from_fn(|reading| frame[reading] + offset[reading]))
                .collect();
            let (model, moved_model) = (model(&frames, method), model(&moved, method));
            prop_assert_eq!(moved_model.coordinates(), model.coordinates());
        }
    }

    #[test]
    fn a_frame_of_equal_readings_among_the_others_changes_none_of_their_kinds(
        frames in trip(),
        reading in 2500..15_000_u16,
        place in 0..N_FRAMES,
    ) {
        let mut more = frames.clone();
        more.insert(place, [reading; N_READINGS]);
        prop_assert_eq!(kinds(&model(&more, Method::Isomap), &frames), kinds(&model(&frames, Method::Isomap), &frames));
    }

    #[test]
    fn frames_that_occur_twice_have_one_place_and_change_no_kind(frames in trip()) {
        for method in [Method::Isomap, Method::Pca] {
            let twice: Vec<_> = frames.iter().chain(&frames).copied().collect();
            let doubled = model(&twice, method);
            let (first, second) = doubled.coordinates().split_at(2 * N_FRAMES);
            prop_assert_eq!(first, second);
            prop_assert_eq!(kinds(&doubled, &frames), kinds(&model(&frames, method), &frames));
        }
    }
}

/// Trips in which everything degenerate is common: few values, invalid readings, the ends of what a count can be.
fn any_trip() -> impl Strategy<Value = Vec<u16>> {
    let reading = prop_oneof![Just(0_u16), 1..4_u16, Just(u16::MAX), any::<u16>()];
    (0..30_usize, 1..12_usize).prop_flat_map(move |(n_frames, n_repeats)| {
        prop::collection::vec(reading.clone(), N_READINGS * n_frames)
            .prop_map(move |counts| counts.repeat(n_repeats))
    })
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(48))]

    #[test]
    fn any_trip_makes_a_model_of_finite_numbers_or_is_refused_in_words(
        counts in any_trip(),
        method in prop::sample::select(&[Method::Isomap, Method::Pca]),
        scale in prop::sample::select(&[Scale::Range, Scale::Log, Scale::Inverse]),
        left_to_the_evidence in any::<bool>(),
    ) {
        let asked = |number| if left_to_the_evidence { None } else { Some(number) };
        let plan = FitPlan {
            response: ResponsePlan::new(scale, 10.0),
            n_neighbors: asked(2),
            n_dims: asked(1),
            n_kinds: asked(2),
            em: EmPlan { n_starts: 2, ..EmPlan::new(0) },
            ..plan(method)
        };
        match fit(counts.clone(), &plan, Origin::default(), &mut |_, _, _| ()) {
            Ok(model) => {
                let mixture = model.mixture();
                let numbers = [model.coordinates(), mixture.weights(), mixture.means(), mixture.covariances()];
                prop_assert!(numbers.iter().all(|numbers| numbers.iter().all(|number| number.is_finite())));
                let mut classifier = Classifier::new(Arc::new(model));
                for frame in counts.chunks_exact(N_READINGS) {
                    let sum: f64 = classifier.classify(frame).probabilities.iter().sum();
                    prop_assert!((sum - 1.0).abs() < 1e-9);
                }
            }
            Err(error) => {
                let words = error.to_string();
                prop_assert!(words.contains(' ') && !words.contains("::") && !words.contains("NaN"), "{words}");
            }
        }
    }
}

#[test]
fn a_robot_that_never_leaves_its_place_has_a_single_kind_by_evidence() {
    let mut random = ChaCha8Rng::seed_from_u64(4);
    // Twelve draws are as good as normal.
    let mut noise = move || (0..12).map(|_| random.random_range(-5.0..5.0)).sum::<f64>();
    let counts: Vec<u16> = (0..400 * N_READINGS).map(|_| (3000.0 + noise()) as u16).collect();
    // By principal components: geodesics through a cloud of noise bend it into what no single Gaussian is.
    let plan = FitPlan { n_neighbors: None, n_dims: None, n_kinds: None, ..plan(Method::Pca) };
    let model = fit(counts, &plan, Origin::default(), &mut |_, _, _| ()).unwrap();
    assert_eq!(model.mixture().n_kinds(), 1);
}

#[test]
fn a_reading_that_never_changes_tells_nothing_and_does_no_harm() {
    let mut random = ChaCha8Rng::seed_from_u64(5);
    let frames: Vec<[u16; N_READINGS]> = (0..N_FRAMES)
        .map(|index| [4000, 2000 + 3000 * (index as u16 * 3 / 60) + random.random_range(0..300), 4000, 0])
        .collect();
    for method in [Method::Isomap, Method::Pca] {
        let kinds = kinds(
            &fit(
                frames.concat(),
                &FitPlan { n_dims: Some(1), ..plan(method) },
                Origin::default(),
                &mut |_, _, _| (),
            )
            .unwrap(),
            &frames,
        );
        let expected: Vec<usize> = (0..N_FRAMES).map(|index| index * 3 / N_FRAMES).collect();
        assert_eq!(kinds, expected, "{method:?}");
    }
}
