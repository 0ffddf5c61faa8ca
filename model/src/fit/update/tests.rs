use std::convert::Infallible;

use proptest::prelude::*;

use super::*;
use crate::command::Commands;
use crate::fit::{fit, fit_with_commands};
use crate::frames::SensorLayout;
use crate::plan::Method;
use crate::response::{ResponsePlan, Scale};
use crate::stream::InMemory;
use crate::whitening::WhiteningPlan;
use crate::{Classifier, file};

/// What a sensor of four readings sees at some places, millimetres.
const PLACES: [[u16; 4]; 5] = [
    [500, 600, 500, 700],
    [2000, 500, 3000, 600],
    [3500, 3600, 500, 3500],
    [900, 3500, 2500, 600],
    [700, 900, 3600, 3700],
];

const N_AT_A_TIME: u16 = 40;

/// Frames of a robot that goes from place to place.
fn trip(places: &[usize], seed: u16) -> Vec<u16> {
    let frames = places.iter().flat_map(|&place| (0..N_AT_A_TIME).map(move |index| (PLACES[place], index)));
    let noise = |index: u16, reading: u16| {
        let mixed =
            u32::from(index).wrapping_mul(2_654_435_761) ^ u32::from(reading * 97 + seed * 193 + 1) << 7;
        (mixed.wrapping_mul(0x9e37_79b9) >> 24) as u16 % 60
    };
    let readings = |(place, index): ([u16; 4], u16)| {
        (0..4).map(move |reading: u16| place[usize::from(reading)] + noise(index, reading))
    };
    frames.flat_map(readings).collect()
}

fn plan(n_kinds: usize, n_frames_max: usize) -> FitPlan {
    FitPlan {
        method: Method::Pca,
        n_neighbors: Some(4),
        n_landmarks: 2000,
        n_dims: Some(2),
        n_kinds: Some(n_kinds),
        n_frames_max,
        ..FitPlan::new(
            SensorLayout { rows: 1, columns: 4, metres_per_count: 0.001 },
            ResponsePlan::new(Scale::Range, 4.0),
            0,
        )
    }
}

fn learnt(places: &[usize], n_frames_max: usize) -> Model {
    let origin = Origin { trips: vec!["first".to_string()], ..Origin::default() };
    let n_kinds = places.iter().max().unwrap() + 1;
    fit(trip(places, 0), &plan(n_kinds, n_frames_max), origin, &mut |_, _, _| ()).unwrap()
}

fn further(model: &Model, places: &[usize], seed: u16) -> Updated {
    let counts = trip(places, seed);
    let origin = Origin {
        trips: vec!["further".to_string()],
        n_frames: vec![counts.len() / 4],
        n_frames_invalid: 3,
        ..Origin::default()
    };
    let updated: Result<Updated, StreamError<Infallible>> =
        update(model, &mut InMemory::new(4, counts), None, origin, 1000, &mut |_, _, _| ());
    updated.unwrap()
}

/// The number of the kind of each place.
fn numbers(model: &Model) -> Vec<u32> {
    let mut classifier = Classifier::new(model.clone().into());
    let kinds = model.register().kinds();
    PLACES
        .iter()
        .map(|place| kinds[classifier.classify(&place.map(|count| count + 30)).kind].number)
        .collect()
}

fn names(model: &Model) -> Vec<(u32, &str)> {
    model.register().kinds().iter().map(|record| (record.number, &*record.name)).collect()
}

#[test]
fn an_update_with_the_trip_that_a_model_was_learnt_from_keeps_all_numbers() {
    for n_frames_max in [2000, 50] {
        let model = learnt(&[0, 1, 2, 1, 0, 2], n_frames_max);
        let Updated { model: updated, changes } = further(&model, &[0, 1, 2, 1, 0, 2], 0);
        assert_eq!(numbers(&updated)[..3], numbers(&model)[..3]);
        assert_eq!(updated.register(), model.register());
        for change in &changes {
            assert!(change.agreement.is_some_and(|agreement| agreement > 0.99), "{change:?}");
        }
        let sum = |share: fn(&KindChange) -> Option<f64>| changes.iter().filter_map(share).sum::<f64>();
        assert!((sum(|change| change.share_before) - 1.0).abs() < 1e-9);
        assert!((sum(|change| change.share_after) - 1.0).abs() < 1e-9);
    }
}

#[test]
fn the_old_trips_count_for_all_that_their_reference_frames_stand_for() {
    let model = learnt(&[0, 1, 2, 1, 0, 2], 50);
    assert_eq!((model.manifest().n_trained, model.manifest().n_frames), (240, 50));
    let Updated { model: updated, .. } = further(&model, &[0, 1], 5);
    let manifest = updated.manifest();
    assert_eq!((manifest.n_trained, manifest.n_frames), (320, 50));
    let origin = &manifest.provenance.origin;
    assert_eq!(
        (&origin.trips[..], &origin.n_frames[..]),
        (&["first".to_string(), "further".to_string()][..], &[240, 80][..])
    );
    assert_eq!(origin.n_frames_invalid, 3);
    let weight = |place: usize| {
        let number = numbers(&updated)[place];
        let kind = updated.register().kinds().iter().position(|record| record.number == number).unwrap();
        (320.0 * updated.mixture().weights()[kind]).round()
    };
    assert_eq!([0, 1, 2].map(weight), [120.0, 120.0, 80.0]);
    let bytes = bytes::Bytes::from(file::to_bytes(&updated));
    assert_eq!(file::from_bytes(&bytes).unwrap().id(), updated.id());
}

#[test]
fn where_the_number_is_left_to_the_evidence_a_new_place_makes_one_more_kind_and_a_known_one_none() {
    let mut model = learnt(&[0, 1, 2, 1, 0, 2], 2000);
    model.manifest.plan.n_kinds = None;
    let Updated { model: again, .. } = further(&model, &[2, 0, 1, 2, 0, 1], 1);
    assert_eq!((again.register(), &numbers(&again)[..3]), (model.register(), &numbers(&model)[..3]));
    let Updated { model: more, changes } = further(&model, &[0, 3, 1, 3], 1);
    assert_eq!(numbers(&more)[..4], [&numbers(&model)[..3], &[3]].concat());
    let agreements: Vec<Option<f64>> = changes.iter().map(|change| change.agreement).collect();
    assert!(agreements[..3].iter().all(|agreement| agreement.is_some_and(|agreement| agreement > 0.99)));
    assert_eq!(agreements[3..], [None]);
}

#[test]
fn new_kinds_get_numbers_that_none_had_and_lost_ones_are_never_given_again() {
    let mut model = learnt(&[0, 1, 2, 1, 0, 2], 2000);
    let doorway = numbers(&model)[1];
    model.name_kind(doorway, Some("doorway"), Some("of the hall")).unwrap();

    model.manifest.plan.n_kinds = Some(4);
    let Updated { model: mut four, changes } = further(&model, &[3, 0, 3], 1);
    assert_eq!(numbers(&four)[..4], [&numbers(&model)[..3], &[3]].concat());
    let new: Vec<&KindChange> = changes.iter().filter(|change| change.share_before.is_none()).collect();
    assert_eq!((new.len(), new[0].record.number, new[0].agreement), (1, 3, None));
    assert!(names(&four).contains(&(doorway, "doorway")));

    // Fewer kinds: one is lost at least.
    four.manifest.plan.n_kinds = Some(2);
    let Updated { model: mut two, changes } = further(&four, &[0, 0], 2);
    let lost: Vec<u32> = changes
        .iter()
        .filter(|change| change.share_after.is_none())
        .map(|change| change.record.number)
        .collect();
    assert_eq!(lost.len(), 2);
    assert_eq!(two.register().retired().iter().map(|record| record.number).collect::<Vec<_>>(), lost);

    two.manifest.plan.n_kinds = Some(5);
    let Updated { model: five, .. } = further(&two, &[4, 1, 4], 3);
    let before: Vec<u32> = [names(&two), names(&four)].concat().iter().map(|(number, _)| *number).collect();
    for (number, _) in names(&five) {
        assert!(names(&two).iter().any(|(kept, _)| *kept == number) || !before.contains(&number), "{number}");
    }
    let of_all = |name: &str| {
        let records = five.register().kinds().iter().chain(five.register().retired());
        records.filter(|record| record.name == name).count()
    };
    assert_eq!(of_all("doorway"), 1, "kept or retired");
}

#[test]
fn slow_directions_and_commands_stay_those_of_the_model() {
    let whitening = Some(WhiteningPlan { n_components: 4, n_directions: 2 });
    let whitened = FitPlan { whitening, ..plan(3, 2000) };
    let counts = trip(&[0, 1, 2, 1, 0, 2], 0);
    let model = fit(counts.clone(), &whitened, Origin::default(), &mut |_, _, _| ()).unwrap();
    let Updated { model: updated, .. } = further(&model, &[2, 0, 1], 1);
    assert_eq!(
        updated.whitening().map(|whitening| whitening.weights.to_vec()),
        model.whitening().map(|whitening| whitening.weights.to_vec())
    );
    assert_eq!(numbers(&updated)[..3], numbers(&model)[..3]);
    // What is usual is learnt from frames whose readings are known.
    let mut classifier = Classifier::new(updated.into());
    let n_novel = |classifier: &mut Classifier, counts: &[u16]| {
        counts.chunks_exact(4).filter(|frame| classifier.classify(frame).novelty >= 0.99).count()
    };
    assert!(n_novel(&mut classifier, &trip(&[2, 0, 1], 1)) <= 6, "of 120");

    let command = |index: usize| Command { forward_m_s: 0.1 * (index / 40 % 3) as f64, turn_rad_s: 0.0 };
    let commands = Commands { weight: 0.1, of_frames: (0..240).map(command).collect() };
    let model =
        fit_with_commands(counts, &commands, &plan(3, 50), Origin::default(), &mut |_, _, _| ()).unwrap();
    let of_further: Vec<Command> = (0..80).map(command).collect();
    let mut source = InMemory::new(4, trip(&[0, 1], 1));
    let updated = update(
        &model,
        &mut source,
        Some(&of_further),
        Origin { n_frames: vec![80], ..Origin::default() },
        1000,
        &mut |_, _, _| (),
    );
    let updated = updated.unwrap().model;
    assert_eq!(updated.commands(), model.commands());
    assert_eq!(updated.manifest().n_trained, 320);
}

#[test]
fn landmarks_are_all_frames_where_they_were_and_there_are_not_too_many() {
    let model = learnt(&[0, 1, 2], 2000);
    assert_eq!(model.manifest().plan.n_landmarks, 120);
    assert_eq!(further(&model, &[0, 1], 1).model.manifest().plan.n_landmarks, 200);
    let few = fit(
        trip(&[0, 1, 2], 0),
        &FitPlan { n_landmarks: 30, ..plan(3, 2000) },
        Origin::default(),
        &mut |_, _, _| (),
    );
    assert_eq!(further(&few.unwrap(), &[0, 1], 1).model.manifest().plan.n_landmarks, 30);
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 12, ..ProptestConfig::default() })]

    #[test]
    fn in_which_order_kinds_stand_in_a_model_does_not_matter(
        order in Just(vec![0_usize, 1, 2, 3]).prop_shuffle(), places in prop::collection::vec(0..4_usize, 1..6), seed in 1..50_u16,
    ) {
        let model = learnt(&[0, 1, 2, 3, 1, 0, 2, 3], 2000);
        let mut other = model.clone();
        other.mixture = model.mixture.in_order(&order);
        let (one, two) = (further(&model, &places, seed).model, further(&other, &places, seed).model);
        // A number of the other model's is a place in the order.
        let renamed: Vec<u32> = numbers(&two)[..4].iter().map(|&number| order[number as usize] as u32).collect();
        prop_assert_eq!(&numbers(&one)[..4], renamed);
    }

    #[test]
    fn over_a_chain_of_updates_no_number_is_ever_used_twice(
        steps in prop::collection::vec((2..6_usize, prop::collection::vec(0..5_usize, 1..4)), 1..5),
    ) {
        let mut model = learnt(&[0, 1, 2, 1, 0, 2], 150);
        let mut gone: Vec<u32> = Vec::new();
        let mut highest = 2;
        for (seed, (n_kinds, places)) in (1..).zip(steps) {
            model.manifest.plan.n_kinds = Some(n_kinds);
            let before: Vec<u32> = names(&model).iter().map(|(number, _)| *number).collect();
            model = further(&model, &places, seed).model;
            let after: Vec<u32> = names(&model).iter().map(|(number, _)| *number).collect();
            prop_assert!(after.is_sorted() && after.len() == n_kinds);
            for number in &after {
                prop_assert!(before.contains(number) || *number > highest, "{} of {:?} after {:?}", number, after, before);
                prop_assert!(!gone.contains(number));
            }
            gone.extend(before.iter().filter(|number| !after.contains(number)));
            highest = highest.max(*after.last().unwrap());
            let retired: Vec<u32> = model.register().retired().iter().map(|record| record.number).collect();
            prop_assert_eq!(&retired, &gone);
            prop_assert!(model.register().fits(n_kinds));
        }
    }
}
