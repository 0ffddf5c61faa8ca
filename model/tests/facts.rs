//! Facts that hold exactly, on small made-up trips of whole numbers: fitting, classifying, and the model file.

use std::sync::Arc;

use bytes::Bytes;
use kinds_model::metric::{Euclidean, Metric};
use kinds_model::{
    Classifier, Command, Commands, Covariance, EmPlan, FitError, FitPlan, Frames, LandmarkChoice, Method,
    MetricPlan, Model, ModelFileError, Origin, ResponsePlan, Scale, SensorLayout, Size, Status, file, fit,
    fit_with_commands, refit,
};
use proptest::prelude::*;
use rand::RngExt;
use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::SeedableRng;

const N_READINGS: usize = 6;

/// A robot wanders between a narrow and a wide place: ranges in mm with noise, some invalid, some repeated frames.
fn trip(n_frames: usize, seed: u64) -> Vec<u16> {
    let mut random = ChaCha8Rng::seed_from_u64(seed);
    let mut counts = Vec::new();
    for index in 0..n_frames {
        let phase = index as f64 / 25.0;
        let width = 1500.0 + 1000.0 * phase.sin();
        for reading in 0..N_READINGS {
            let range = width * (1.2 + (phase + reading as f64).cos()) + random.random_range(-20.0..20.0);
            let invalid = random.random_range(0..20) == 0;
            counts.push(if invalid { 0 } else { range.max(1.0) as u16 });
        }
    }
    counts.extend_from_within(..3 * N_READINGS);
    counts
}

fn plan(method: Method) -> FitPlan {
    FitPlan {
        method,
        n_neighbors: Some(6),
        n_landmarks: 40,
        n_dims: Some(3),
        n_kinds: Some(3),
        ..FitPlan::new(
            SensorLayout { rows: 1, columns: N_READINGS as u32, metres_per_count: 0.001 },
            ResponsePlan::new(Scale::Inverse, 4.0),
            1,
        )
    }
}

fn model(method: Method) -> Model {
    model_by(MetricPlan::Euclidean, method)
}

fn model_by(metric: MetricPlan, method: Method) -> Model {
    let plan = FitPlan { metric, ..plan(method) };
    fit(trip(150, 3), &plan, Origin::default(), &mut |_, _, _| ()).unwrap()
}

/// A model of the readings as they are.
fn native() -> Model {
    let plan = FitPlan { n_dims: None, ..plan(Method::Native) };
    fit(trip(150, 3), &plan, Origin::default(), &mut |_, _, _| ()).unwrap()
}

/// A model for each metric and method.
fn models() -> impl Iterator<Item = Model> {
    let metrics = [
        MetricPlan::Euclidean,
        MetricPlan::Weighted(vec![0.3, 2.0, 0.0, 1.0, 1.0, 0.7]),
        MetricPlan::Ring { n_rings: 1 },
        MetricPlan::Ring { n_rings: 2 },
    ];
    metrics
        .into_iter()
        .flat_map(|metric| [Method::Isomap, Method::Pca].map(|method| model_by(metric.clone(), method)))
        .chain([native()])
}

#[test]
fn a_reference_frame_embeds_out_of_sample_to_its_in_sample_coordinates_bit_for_bit() {
    for model in models() {
        let model = Arc::new(model);
        let FitPlan { metric, method, .. } = &model.manifest().plan;
        let mut classifier = Classifier::new(Arc::clone(&model));
        let places = model.coordinates().chunks_exact(model.manifest().n_dims);
        for (frame, place) in trip(150, 3).chunks_exact(N_READINGS).zip(places) {
            let found = classifier.classify(frame);
            assert_eq!(found.coordinates, place, "{metric}, {method:?}");
        }
    }
}

#[test]
fn a_classifier_that_was_warmed_up_answers_alike_bit_for_bit() {
    for model in models() {
        let model = Arc::new(model);
        let mut cold = Classifier::new(Arc::clone(&model));
        let mut warm = Classifier::new(model);
        warm.warm_up();
        for frame in trip(150, 5).chunks_exact(N_READINGS) {
            assert_eq!(warm.classify(frame), cold.classify(frame));
            warm.warm_up();
        }
        assert_eq!(warm.classify(&[0; N_READINGS]).kind, cold.classify(&[0; N_READINGS]).kind);
    }
}

#[test]
fn a_frame_of_rings_is_classified_alike_whichever_way_the_robot_faces() {
    let turned = |frame: &[u16], n_rings: usize, turn: usize| {
        let mut frame = frame.to_vec();
        frame.chunks_exact_mut(N_READINGS / n_rings).for_each(|ring| ring.rotate_left(turn));
        frame
    };
    for method in [Method::Isomap, Method::Pca] {
        for n_rings in [1, 2] {
            let mut by_rings = Classifier::new(Arc::new(model_by(MetricPlan::Ring { n_rings }, method)));
            let mut by_readings = Classifier::new(Arc::new(model(method)));
            let mut n_changed = 0;
            for frame in trip(40, 9).chunks_exact(N_READINGS) {
                let ahead = by_rings.classify(frame).clone();
                let ahead_by_readings = by_readings.classify(frame).clone();
                for turn in 1..N_READINGS / n_rings {
                    let turned = turned(frame, n_rings, turn);
                    assert_eq!(*by_rings.classify(&turned), ahead, "{turned:?} {frame:?}");
                    n_changed += usize::from(*by_readings.classify(&turned) != ahead_by_readings);
                }
            }
            assert!(n_changed > 40, "other metrics see that it turned");
        }
    }
}

#[test]
fn native_space_is_the_readings_on_the_responses_scale_and_nothing_else() {
    let model = Arc::new(native());
    let manifest = model.manifest();
    assert_eq!((manifest.n_dims, model.landmarks().len()), (N_READINGS, 0));
    assert!(model.embedding().is_none() && model.geodesics().is_none());
    assert!(manifest.provenance.residual_variance.is_empty() && manifest.provenance.eigenvalues.is_empty());
    let counts: Vec<f64> = model.frames().counts().iter().map(|&count| f64::from(count)).collect();
    assert_eq!(model.coordinates(), counts);

    let mut classifier = Classifier::new(Arc::clone(&model));
    let mut n_frames_of = [0; 3];
    let frames = trip(150, 3);
    frames.chunks_exact(N_READINGS).for_each(|frame| n_frames_of[classifier.classify(frame).kind] += 1);
    let largest = *n_frames_of.iter().max().unwrap();
    assert_eq!(manifest.provenance.largest_kind_share, f64::from(largest) / 153.0);
    assert_eq!(classifier.classify(&[10, 4000, 10, 4000, 10, 4000]).novelty, 1.0);
}

#[test]
fn refitting_native_space_with_the_same_kinds_asks_the_evidence_for_dimensions() {
    let native = native();
    let isomap = refit(&native, Method::Isomap, Size::SameKinds, &mut |_, _, _| ()).unwrap();
    let manifest = isomap.manifest();
    assert_eq!((manifest.n_kinds, manifest.n_dims), (3, manifest.provenance.elbow + 2));
    assert_eq!((manifest.n_neighbors, isomap.landmarks().len()), (6, 40));
    let again = refit(&isomap, Method::Native, Size::SameKinds, &mut |_, _, _| ()).unwrap();
    assert_eq!(again.mixture().means(), native.mixture().means());
}

#[test]
fn weights_that_are_all_equal_change_nothing_but_the_plan() {
    for method in [Method::Isomap, Method::Pca] {
        let (plain, weighted) =
            (model(method), model_by(MetricPlan::Weighted(vec![3.0; N_READINGS]), method));
        assert_eq!(weighted.coordinates(), plain.coordinates());
        assert_eq!(weighted.squared_radii(), plain.squared_radii());
        assert_ne!(weighted.id(), plain.id());
    }
}

#[test]
fn a_reading_without_weight_changes_no_classification() {
    let weights = vec![1.0, 1.0, 0.0, 1.0, 1.0, 1.0];
    for method in [Method::Isomap, Method::Pca] {
        let mut classifier =
            Classifier::new(Arc::new(model_by(MetricPlan::Weighted(weights.clone()), method)));
        for frame in trip(40, 9).chunks_exact(N_READINGS) {
            let mut other = frame.to_vec();
            other[2] = 4321 - other[2].min(4000);
            let found = classifier.classify(frame).clone();
            let n_invalid = found.n_invalid - usize::from(frame[2] == 0);
            assert_eq!(*classifier.classify(&other), kinds_model::Classification { n_invalid, ..found });
        }
    }
}

/// What the robot was told on its trip: to turn one way and the other, faster and faster; nothing for the last three frames.
fn commands() -> Vec<Option<Command>> {
    let told = |index: u32| {
        let index = f64::from(index);
        Some(Command { forward_m_s: 0.01 * index, turn_rad_s: (index / 9.0).sin() })
    };
    (0..150).map(told).chain([None; 3]).collect()
}

fn commanded(method: Method, metric: MetricPlan) -> Model {
    let of_frames = commands().into_iter().map(Option::unwrap_or_default).collect();
    let plan = FitPlan { metric, ..plan(method) };
    let commands = Commands { weight: 0.5, of_frames };
    fit_with_commands(trip(150, 3), &commands, &plan, Origin::default(), &mut |_, _, _| ()).unwrap()
}

#[test]
fn a_reference_frame_with_its_command_embeds_to_its_coordinates_bit_for_bit_by_every_metric_and_from_a_file()
{
    let weights = MetricPlan::Weighted(vec![1.0, 2.0, 3.0, 1.0, 2.0, 3.0]);
    for metric in [MetricPlan::Euclidean, weights, MetricPlan::Ring { n_rings: 1 }] {
        for method in [Method::Isomap, Method::Pca] {
            let model = commanded(method, metric.clone());
            let read = file::from_bytes(&Bytes::from(file::to_bytes(&model))).unwrap();
            assert_eq!(read.id(), model.id());
            let mut classifier = Classifier::new(Arc::new(read));
            let frames = trip(150, 3);
            let frames = frames.chunks_exact(N_READINGS).zip(commands());
            let mut n_moved = 0;
            for ((frame, command), place) in frames.zip(model.coordinates().chunks_exact(3)) {
                let found = classifier.classify_commanded(frame, command);
                assert_eq!(found.coordinates, place, "{method:?} {metric:?}");
                let still = classifier.classify(frame).coordinates.clone();
                n_moved += usize::from(still != place);
            }
            // All that were told anything but to stand still: the first was told to.
            assert_eq!(n_moved, 149, "{method:?} {metric:?}");
        }
    }
}

#[test]
fn a_model_that_does_not_compare_commands_is_deaf_to_them() {
    let mut classifier = Classifier::new(Arc::new(model(Method::Isomap)));
    let frame = &trip(150, 3)[..N_READINGS];
    let without = classifier.classify(frame).clone();
    assert_eq!(classifier.classify_commanded(frame, commands()[149]), &without);
}

#[test]
fn native_space_refuses_commands_in_words() {
    let plan = FitPlan { n_dims: None, ..plan(Method::Native) };
    let commands = Commands { weight: 0.25, of_frames: vec![Command::default(); 153] };
    let refusal = fit_with_commands(trip(150, 3), &commands, &plan, Origin::default(), &mut |_, _, _| ());
    assert_eq!(
        refusal.unwrap_err().to_string(),
        "native space has no distances, so that kinds would not follow commands of weight 0.25; use isomap or pca, or a \
         commands weight of 0"
    );
}

#[test]
fn a_refit_compares_commands_as_the_model_does() {
    let isomap = commanded(Method::Isomap, MetricPlan::Euclidean);
    let pca = refit(&isomap, Method::Pca, Size::Matched, &mut |_, _, _| ()).unwrap();
    assert_eq!(pca.commands(), isomap.commands());
    assert_eq!(pca.coordinates(), commanded(Method::Pca, MetricPlan::Euclidean).coordinates());
}

#[test]
fn euclidean_distances_between_all_frames_are_kept_by_all_components() {
    // A second method: as many components as readings keep every distance on the response's scale.
    let all = FitPlan { n_landmarks: usize::MAX, n_dims: Some(N_READINGS), ..plan(Method::Pca) };
    let model = fit(trip(60, 5), &all, Origin::default(), &mut |_, _, _| ()).unwrap();
    let place = |index: usize| &model.coordinates()[index * N_READINGS..][..N_READINGS];
    for a in 0..60 {
        for b in 0..60 {
            let expected = Euclidean.squared_distance(model.frames().row(a), model.frames().row(b)) as f64;
            let found: f64 = place(a).iter().zip(place(b)).map(|(a, b)| (a - b) * (a - b)).sum();
            assert!(
                (found - expected).abs() <= 1e-9 * expected.max(1e6),
                "{a} {b}: {found} instead of {expected}"
            );
        }
    }
}

#[test]
fn the_same_frames_and_plan_give_the_same_bytes() {
    assert_eq!(file::to_bytes(&model(Method::Isomap)), file::to_bytes(&model(Method::Isomap)));
}

#[test]
fn refitting_by_the_same_method_gives_the_same_model() {
    let model = model(Method::Isomap);
    let again = refit(&model, Method::Isomap, Size::Matched, &mut |_, _, _| ()).unwrap();
    assert_eq!(again.id(), model.id());
}

#[test]
fn refitting_at_matched_size_keeps_neighbours_dimensions_and_kinds_and_at_its_own_asks_what_the_plan_asked() {
    let by_evidence = |method| FitPlan { n_neighbors: None, n_dims: None, n_kinds: None, ..plan(method) };
    let fitted = |plan| fit(trip(150, 3), &plan, Origin::default(), &mut |_, _, _| ()).unwrap();
    let isomap = fitted(by_evidence(Method::Isomap));
    let size = |model: &Model| (model.manifest().n_dims, model.mixture().n_kinds());
    let matched = refit(&isomap, Method::Pca, Size::Matched, &mut |_, _, _| ()).unwrap();
    assert_eq!(size(&matched), size(&isomap));
    assert_eq!(matched.manifest().n_neighbors, isomap.manifest().n_neighbors);
    assert!(matched.manifest().provenance.kinds_tried.is_empty());
    let own = |model: &Model| refit(model, Method::Pca, Size::Own, &mut |_, _, _| ()).unwrap();
    assert_eq!(own(&isomap).id(), fitted(by_evidence(Method::Pca)).id());
    // What was asked for is asked for again.
    assert_eq!(own(&model(Method::Isomap)).id(), model(Method::Pca).id());
}

#[test]
fn an_invalid_frame_is_answered_with_the_mixing_weights_and_says_so() {
    let model = Arc::new(model(Method::Isomap));
    let mut classifier = Classifier::new(Arc::clone(&model));
    let found = classifier.classify(&[0; N_READINGS]);
    assert_eq!((found.status, found.n_invalid, found.novelty), (Status::Invalid, N_READINGS, 1.0));
    assert_eq!(found.probabilities, model.mixture().weights());
    assert!(found.log_likelihood.is_nan());
}

#[test]
fn a_frame_unlike_any_seen_is_novel_and_a_slightly_changed_one_is_not() {
    let model = Arc::new(model(Method::Isomap));
    let mut classifier = Classifier::new(model);
    assert_eq!(classifier.classify(&[10, 4000, 10, 4000, 10, 4000]).novelty, 1.0);
    let mut near = trip(150, 3)[..N_READINGS].to_vec();
    near[2] += 1;
    let novelty = classifier.classify(&near).novelty;
    assert!(!classifier.model().manifest().novelty.is_novel(novelty), "{novelty}");
}

proptest! {
    #[test]
    fn probabilities_are_finite_and_sum_to_one_for_any_frame(frame in prop::collection::vec(any::<u16>(), N_READINGS)) {
        thread_local! {
            static CLASSIFIERS: std::cell::RefCell<[Classifier; 3]> =
                [model(Method::Isomap), model(Method::Pca), native()].map(|model| Classifier::new(Arc::new(model))).into();
        }
        CLASSIFIERS.with_borrow_mut(|classifiers| {
            for classifier in classifiers {
                let found = classifier.classify(&frame);
                prop_assert!(found.probabilities.iter().all(|p| (0.0..=1.0).contains(p)));
                prop_assert!((found.probabilities.iter().sum::<f64>() - 1.0).abs() < 1e-12);
                prop_assert!((0.0..=1.0).contains(&found.novelty));
                let highest = found.probabilities.iter().copied().fold(0.0, f64::max);
                prop_assert_eq!(found.probabilities[found.kind], highest);
            }
            Ok(())
        })?;
    }
}

#[test]
fn what_cannot_be_fitted_is_refused_in_words() {
    let refuse = |counts: Vec<u16>, plan: FitPlan| {
        fit(counts, &plan, Origin::default(), &mut |_, _, _| ()).unwrap_err()
    };
    let isomap = plan(Method::Isomap);
    assert_eq!(
        refuse(trip(3, 0), isomap.clone()).to_string(),
        "6 frames are too few for 6 neighbours each; ask for fewer neighbours or record a longer trip"
    );
    assert_eq!(
        refuse(trip(5, 0), FitPlan { n_kinds: Some(9), ..isomap.clone() }).to_string(),
        "8 frames cannot make 9 kinds; ask for fewer kinds or record a longer trip"
    );
    assert_eq!(
        refuse(vec![700; 20 * N_READINGS], isomap.clone()).to_string(),
        "all 20 frames are equal on the response's scale; there is nothing to tell kinds by"
    );
    assert_eq!(
        refuse(trip(20, 0), FitPlan { n_dims: Some(40), ..isomap.clone() }).to_string(),
        "40 dimensions were asked for; there must be between 1 and 32"
    );
    assert!(matches!(
        refuse(trip(20, 0), FitPlan { n_dims: Some(20), n_landmarks: 10, ..isomap.clone() }),
        FitError::Mds(_)
    ));
    assert_eq!(
        refuse(trip(20, 0), FitPlan { metric: MetricPlan::Weighted(vec![1.0; 5]), ..isomap.clone() })
            .to_string(),
        "metric: 5 weights were given and the sensor has 6 readings; give one weight for each"
    );
    let native = FitPlan { method: Method::Native, ..isomap.clone() };
    assert_eq!(
        refuse(trip(20, 0), native.clone()).to_string(),
        "native space has a dimension for each of the 6 readings and 3 were asked for; ask for no number, or use isomap"
    );
    let native = FitPlan { n_dims: None, ..native };
    assert_eq!(
        refuse(trip(20, 0), FitPlan { metric: MetricPlan::Ring { n_rings: 2 }, ..native.clone() })
            .to_string(),
        "native space has no distances, so that kinds would not follow the metric: least distances over all turns of 2 rings; use \
         isomap or the euclidean metric"
    );
    assert_eq!(
        refuse(vec![700; 20 * N_READINGS], native.clone()).to_string(),
        "all 20 frames are equal on the response's scale; there is nothing to tell kinds by"
    );
    let camera = SensorLayout { rows: 124, columns: 160, metres_per_count: 0.001 };
    assert_eq!(
        refuse(vec![1; 19840 * 20], FitPlan { sensor: camera, ..native }).to_string(),
        "native space is for sensors of at most 32 readings and this one has 19840: the full covariance of one kind would have \
         19840·19841/2 = 196822720 parameters, and there are 20 frames; use isomap"
    );
    let ring = FitPlan { metric: MetricPlan::Ring { n_rings: 1 }, ..isomap };
    assert_eq!(
        refuse(trip(60, 0), FitPlan { landmark_choice: LandmarkChoice::KMeans, ..ring }).to_string(),
        "landmarks by k-means need means of frames, and frames that are compared at their nearest turn have none; choose random \
         landmarks or the farthest"
    );
}

#[test]
fn a_model_read_from_its_bytes_is_the_same_and_its_frames_lie_in_them() {
    for model in models() {
        let bytes = Bytes::from(file::to_bytes(&model));
        let read = file::from_bytes(&bytes).unwrap();
        assert_eq!((read.id(), read.manifest()), (model.id(), model.manifest()));
        assert_eq!(file::to_bytes(&read), bytes);
        let within = bytes.as_ptr_range();
        assert!(within.contains(&read.frames().counts().as_ptr().cast()));
        let (mut first, mut second) = (Classifier::new(Arc::new(model)), Classifier::new(Arc::new(read)));
        for frame in trip(40, 9).chunks_exact(N_READINGS) {
            assert_eq!(first.classify(frame), second.classify(frame));
        }
    }
}

#[test]
fn kinds_have_the_shape_that_was_asked_for_and_a_file_says_which() {
    for covariance in [Covariance::Full, Covariance::Tied, Covariance::Diagonal, Covariance::Spherical] {
        let plan = FitPlan { em: EmPlan { covariance, ..EmPlan::new(1) }, ..plan(Method::Isomap) };
        let model = fit(trip(150, 3), &plan, Origin::default(), &mut |_, _, _| ()).unwrap();
        let read = file::from_bytes(&Bytes::from(file::to_bytes(&model))).unwrap();
        assert_eq!(read.manifest().plan.em.covariance, covariance);
        let matrices: Vec<&[f64]> = read.mixture().covariances().chunks_exact(9).collect();
        let is_diagonal = |matrix: &&[f64]| (0..9).all(|index| index % 4 == 0 || matrix[index] == 0.0);
        let is_ball =
            |matrix: &&[f64]| is_diagonal(matrix) && matrix[0] == matrix[4] && matrix[4] == matrix[8];
        assert_eq!(matrices.iter().all(|matrix| *matrix == matrices[0]), covariance == Covariance::Tied);
        let is_along = [Covariance::Diagonal, Covariance::Spherical].contains(&covariance);
        assert_eq!(matrices.iter().all(is_diagonal), is_along);
        assert_eq!(matrices.iter().all(is_ball), covariance == Covariance::Spherical);
    }
}

#[test]
fn a_model_cut_off_anywhere_is_refused() {
    let bytes = Bytes::from(file::to_bytes(&model(Method::Isomap)));
    for length in (0..bytes.len()).step_by(7) {
        let error = file::from_bytes(&bytes.slice(..length)).unwrap_err();
        assert!(
            matches!(error, ModelFileError::Container { n_bytes, .. } if n_bytes == length),
            "{length}: {error}"
        );
    }
}

#[test]
fn a_model_with_a_flipped_bit_is_refused_or_still_the_same_model() {
    let model = model(Method::Isomap);
    let whole = file::to_bytes(&model);
    let header = 8 + u64::from_le_bytes(whole[..8].try_into().unwrap()) as usize;
    // Every byte of the header, and a stride through the arrays.
    for place in (0..header).chain((header..whole.len()).step_by(101)) {
        let mut bytes = whole.clone();
        bytes[place] ^= 1 << (place % 8);
        match file::from_bytes(&Bytes::from(bytes)) {
            Err(error) => assert!(!error.to_string().is_empty()),
            Ok(read) => {
                assert_eq!(read.id(), model.id(), "byte {place} changed the model and its name did not");
            }
        }
    }
}

#[test]
fn files_that_are_no_models_are_refused_in_words() {
    let refuse = |bytes: Vec<u8>| file::from_bytes(&Bytes::from(bytes)).unwrap_err().to_string();
    assert!(
        refuse(Vec::new())
            .starts_with("not a whole model file: 0 bytes do not hold what their header announces")
    );
    let none: [(&str, safetensors::tensor::TensorView); 0] = [];
    assert_eq!(
        refuse(safetensors::serialize(none, None).unwrap()),
        "not a model of natural kinds: its metadata has no manifest"
    );
    let text = file::to_bytes(&model(Method::Pca));
    let other = replace_once(&text, b"format: 5,", b"format: 4,");
    assert_eq!(
        refuse(other),
        "model file of format 4; this program reads format 5: train anew, or use the program that made it"
    );
    let damaged = replace_once(&text, b"n_neighbors: 6,", b"n_neighbors: 5,");
    assert!(refuse(damaged).starts_with("the model file is damaged: its contents have digest "));
}

fn replace_once(bytes: &[u8], from: &[u8], to: &[u8]) -> Vec<u8> {
    let place = bytes.windows(from.len()).position(|window| window == from).expect("it is in there");
    [&bytes[..place], to, &bytes[place + from.len()..]].concat()
}

#[test]
fn frames_are_counted_by_rows() {
    assert_eq!(Frames::new(N_READINGS, trip(10, 0)).n_frames(), 13);
}
