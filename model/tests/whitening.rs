//! Models that compare slow directions of frames: facts that hold exactly, on small made-up trips.

use std::sync::Arc;

use bytes::Bytes;
use kinds_model::{
    Classifier, FitError, FitPlan, Method, MetricPlan, Model, Origin, ResponsePlan, Scale, SensorLayout,
    Size, WhiteningPlan, file, fit, refit,
};
use rand::RngExt;
use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::SeedableRng;

const N_READINGS: usize = 60;
const N_TRAINED: usize = 240;
const N_DIMS: usize = 2;

/// A robot that goes to and fro between a narrow and a wide place, seen through noise.
fn trip() -> Vec<u16> {
    let mut random = ChaCha8Rng::seed_from_u64(7);
    let mut counts = Vec::new();
    for index in 0..N_TRAINED {
        let phase = index as f64 / 25.0;
        for reading in 0..N_READINGS {
            let range = 1500.0 + 600.0 * phase.sin() * (1.2 + (phase.cos() + reading as f64 / 9.0).cos());
            counts.push((range + random.random_range(-500.0..500.0)) as u16);
        }
    }
    counts
}

fn plan(whitening: Option<WhiteningPlan>, n_frames_max: usize) -> FitPlan {
    FitPlan {
        whitening,
        n_frames_max,
        n_neighbors: Some(6),
        n_landmarks: 40,
        n_dims: Some(N_DIMS),
        n_kinds: Some(3),
        ..FitPlan::new(
            SensorLayout { rows: 6, columns: 10, metres_per_count: 0.001 },
            ResponsePlan::new(Scale::Inverse, 4.0),
            1,
        )
    }
}

const THREE: Option<WhiteningPlan> = Some(WhiteningPlan { n_components: 12, n_directions: 3 });

fn fitted(whitening: Option<WhiteningPlan>, n_frames_max: usize) -> Model {
    fit(trip(), &plan(whitening, n_frames_max), Origin::default(), &mut |_, _, _| ()).unwrap()
}

#[test]
fn every_trained_frame_is_served_at_its_coordinates_bit_for_bit_whether_kept_or_not() {
    for n_frames_max in [N_TRAINED, N_TRAINED / 3] {
        let model = Arc::new(fitted(THREE, n_frames_max));
        assert_eq!((model.manifest().n_frames, model.frames().n_columns()), (n_frames_max, 3));
        let mut classifier = Classifier::new(Arc::clone(&model));
        for (frame, place) in trip().chunks_exact(N_READINGS).zip(model.coordinates().chunks_exact(N_DIMS)) {
            assert_eq!(classifier.classify(frame).coordinates, place);
        }
    }
}

#[test]
fn a_model_read_from_its_bytes_is_the_same() {
    let model = fitted(THREE, N_TRAINED);
    let bytes = Bytes::from(file::to_bytes(&model));
    let read = file::from_bytes(&bytes).unwrap();
    assert_eq!((read.id(), read.manifest()), (model.id(), model.manifest()));
    assert_eq!(file::to_bytes(&read), bytes);
    assert_eq!(read.seen().counts(), model.seen().counts());
    let (mut first, mut second) = (Classifier::new(Arc::new(model)), Classifier::new(Arc::new(read)));
    for frame in trip().chunks_exact(N_READINGS) {
        assert_eq!(first.classify(frame), second.classify(frame));
    }
}

#[test]
fn results_do_not_depend_on_the_number_of_threads() {
    let ids = [1, 2, 5].map(|n_threads| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(n_threads).build().unwrap();
        pool.install(|| fitted(THREE, N_TRAINED / 2).id())
    });
    assert!(ids.iter().all(|id| *id == ids[0]), "{ids:?}");
}

#[test]
fn the_other_method_is_fitted_to_the_same_directions() {
    let model = fitted(THREE, N_TRAINED);
    let other = refit(&model, Method::Pca, Size::Matched, &mut |_, _, _| ()).unwrap();
    assert_eq!(other.frames().counts(), model.frames().counts());
    let frame = &trip()[..N_READINGS];
    let place = &other.coordinates()[..N_DIMS];
    assert_eq!(Classifier::new(Arc::new(other.clone())).classify(frame).coordinates, place);
}

#[test]
fn directions_that_there_cannot_be_are_refused_in_words() {
    let refuse = |counts: Vec<u16>, plan: FitPlan| {
        fit(counts, &plan, Origin::default(), &mut |_, _, _| ()).unwrap_err()
    };
    let weighted = MetricPlan::Weighted(vec![1.0; N_READINGS]);
    assert_eq!(refuse(trip(), FitPlan { metric: weighted, ..plan(THREE, N_TRAINED) }), FitError::Whitened);
    let none = Some(WhiteningPlan { n_components: 12, n_directions: 0 });
    assert!(refuse(trip(), plan(none, N_TRAINED)).to_string().contains("slow directions"));
    assert_eq!(
        refuse(vec![700; 20 * N_READINGS], plan(THREE, N_TRAINED)).to_string(),
        "3 slow directions were asked for and the trip has fewer: its frames are too much alike, or too few follow each other; ask \
         for fewer"
    );
    let apart = Origin { n_frames: vec![1; N_TRAINED], ..Origin::default() };
    let refused = fit(trip(), &plan(THREE, N_TRAINED), apart, &mut |_, _, _| ()).unwrap_err();
    assert!(refused.to_string().contains("too few follow each other"), "{refused}");
}
