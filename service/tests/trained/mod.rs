//! A classifier to serve with, of a trip of waves, and that trip.

use std::sync::Arc;

use kinds_model::{Classifier, EmPlan, FitPlan, Origin, ResponsePlan, Scale, SensorLayout, fit};

#[path = "../../../model/tests/waves/mod.rs"]
mod waves;

pub(crate) use self::waves::trip;

/// Frames of the trip.
pub(crate) const N_FRAMES: usize = 300;

/// Bytes that the transport takes for the loan of the next report, and gives back: a counted reference to the publisher and to the
/// slot, on the heap, until the loan is sent.
pub(crate) const LOAN_BYTES: usize = 48;

pub(crate) fn classifier(sensor: SensorLayout) -> Classifier {
    let plan = FitPlan {
        n_neighbors: Some(10),
        n_landmarks: 100,
        n_dims: Some(5),
        n_kinds: Some(3),
        em: EmPlan { n_starts: 1, ..EmPlan::new(0) },
        ..FitPlan::new(sensor, ResponsePlan::new(Scale::Inverse, 20.0), 0)
    };
    let model = fit(trip(sensor, N_FRAMES), &plan, Origin::default(), &mut |_, _, _| ()).unwrap();
    Classifier::new(Arc::new(model))
}
