//! Classifying allocates nothing. Alone in its program, since the allocator counts for all tests of one.

mod waves;

use std::sync::Arc;

use kinds_model::{
    Classifier, Command, Commands, EmPlan, FitPlan, Method, MetricPlan, Origin, ResponsePlan, Scale,
    SensorLayout, Status, fit, fit_with_commands,
};
use peak_alloc::PeakAlloc;

use crate::waves::trip;

#[global_allocator]
static ALLOCATOR: PeakAlloc = PeakAlloc;

const N_FRAMES: usize = 300;

fn plan(sensor: SensorLayout, method: Method, metric: MetricPlan) -> FitPlan {
    FitPlan {
        metric,
        method,
        n_neighbors: Some(10),
        n_landmarks: 100,
        n_dims: if method == Method::Native { None } else { Some(5) },
        n_kinds: Some(3),
        em: EmPlan { n_starts: 1, ..EmPlan::new(0) },
        ..FitPlan::new(sensor, ResponsePlan::new(Scale::Inverse, 20.0), 0)
    }
}

/// Classifies what is like the trip, unlike it, and invalid, and checks that memory in use never rose meanwhile.
fn check(what: &str, mut classifier: Classifier, sensor: SensorLayout) {
    let n = sensor.n_readings();
    let mut frames = trip(sensor, N_FRAMES);
    frames.extend((0..20 * n).map(|index| (index * 7907 % 65_536) as u16));
    frames.extend(vec![u16::MAX; n]);
    frames.extend(vec![0; n]);
    // Whether a processor has an instruction is asked once in a program's life.
    classifier.classify(&frames[..n]);
    let before = ALLOCATOR.current_usage();
    ALLOCATOR.reset_peak_usage();
    let mut n_classified = 0;
    for (index, frame) in frames.chunks_exact(n).enumerate() {
        let command = Command { forward_m_s: index as f64 / 100.0, turn_rad_s: 0.1 };
        let found = classifier.classify_commanded(frame, Some(command));
        n_classified += usize::from(found.status == Status::Classified);
        classifier.half_split_error();
    }
    assert_eq!(n_classified, N_FRAMES + 21, "{what}");
    assert_eq!(ALLOCATOR.peak_usage(), before, "{what}");
}

#[test]
fn no_frame_takes_memory() {
    let ring = SensorLayout { rows: 1, columns: 16, metres_per_count: 0.001 };
    let camera = SensorLayout { rows: 124, columns: 160, metres_per_count: 0.001 };
    let weights = MetricPlan::Weighted((0..16).map(f64::from).collect());
    for (what, sensor, method, metric) in [
        ("a ring", ring, Method::Isomap, MetricPlan::Euclidean),
        ("a camera", camera, Method::Isomap, MetricPlan::Euclidean),
        ("straight distances", ring, Method::Pca, MetricPlan::Euclidean),
        ("native space", ring, Method::Native, MetricPlan::Euclidean),
        ("weights", ring, Method::Isomap, weights),
        ("turns", ring, Method::Isomap, MetricPlan::Ring { n_rings: 1 }),
    ] {
        let plan = plan(sensor, method, metric);
        let model = fit(trip(sensor, N_FRAMES), &plan, Origin::default(), &mut |_, _, _| ()).expect(what);
        check(what, Classifier::new(Arc::new(model)), sensor);
    }
    let told = |index: usize| Command { forward_m_s: (index % 7) as f64, turn_rad_s: (index % 3) as f64 };
    let commands = Commands { weight: 0.3, of_frames: (0..N_FRAMES).map(told).collect() };
    let plan = plan(camera, Method::Isomap, MetricPlan::Euclidean);
    let frames = trip(camera, N_FRAMES);
    let model = fit_with_commands(frames, &commands, &plan, Origin::default(), &mut |_, _, _| ());
    check("commands", Classifier::new(Arc::new(model.expect("commands"))), camera);
}
