//! On recorded trips, where they are at hand: `KINDS_TRIPS_DIR`, or `../shared/trips` beside the project.

use std::path::PathBuf;

use kinds_trainer::{
    Config, Evaluation, EvaluationPlan, Meetings, MethodChoice, MethodScores, Methods, Rivals, ScaleChoice,
    evaluate, load, train,
};
use kinds_trips::Selection;

/// The trips of a sensor, or nothing and a note.
fn trips(sensor: &str) -> Option<[PathBuf; 2]> {
    let beside = || PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("../../shared/trips");
    let folder = std::env::var_os("KINDS_TRIPS_DIR").map_or_else(beside, PathBuf::from);
    let trips = [1, 2].map(|trip| folder.join(format!("{sensor}-trip{trip}.mcap")));
    let found = trips.iter().all(|trip| trip.is_file());
    if !found {
        #[allow(clippy::print_stderr, reason = "whoever runs the tests should know what they did not show")]
        {
            eprintln!("skipped: no recorded trips of {sensor} in {}", folder.display());
        }
    }
    found.then_some(trips)
}

fn learn_and_evaluate(trips: &[PathBuf; 2], config: &Config, radius_m: f64) -> Evaluation {
    let trained = train(&trips[..1], config, &mut |_, _, _| ()).unwrap();
    let trips = [0, 1].map(|trip| load(&trips[trip], &Selection::default(), &mut |_, _, _| ()).unwrap());
    let plan = EvaluationPlan { radius_m, ..EvaluationPlan::default() };
    let meetings = Meetings::find(trained.model.layout(), &[&trips], &plan.same_place()).unwrap();
    let rivals = Rivals::of(trained.model, &mut |_, _, _| ()).unwrap();
    evaluate(&rivals, &meetings, &plan, &mut |_, _, _| ()).unwrap()
}

fn methods(evaluation: &Evaluation) -> &Methods<MethodScores> {
    &evaluation.pairs[0].forward.scores.methods
}

fn median(mut values: Vec<f64>) -> f64 {
    values.sort_by(f64::total_cmp);
    values[values.len() / 2]
}

/// Median κ over five seeds of Isomap and PCA, at 8 dimensions and 8 kinds.
fn kappas(trips: &[PathBuf; 2], response: ScaleChoice) -> [f64; 2] {
    let evaluations: Vec<Evaluation> = (0..5)
        .map(|seed| {
            let config = Config {
                response: Some(response),
                method: Some(MethodChoice::Isomap),
                dims: Some(8),
                kinds: Some(8),
                seed: Some(seed),
                ..Config::default()
            };
            learn_and_evaluate(trips, &config, 0.15)
        })
        .collect();
    let of = |method: fn(&Evaluation) -> f64| median(evaluations.iter().map(method).collect());
    [
        of(|evaluation| methods(evaluation).isomap.kappa),
        of(|evaluation| methods(evaluation).pca.unwrap().kappa),
    ]
}

#[test]
fn maze_kinds_are_as_consistent_as_scikit_learns() {
    let Some(trips) = trips("maze-tof16") else { return };
    let [isomap, pca] = kappas(&trips, ScaleChoice::Range);
    assert!(isomap >= 0.60 && pca >= 0.60, "range: Isomap {isomap}, PCA {pca}");
    let [isomap, _] = kappas(&trips, ScaleChoice::Inverse);
    assert!(isomap >= 0.85, "inverse range: Isomap {isomap}");
}

#[test]
fn untuned_training_makes_three_to_twelve_kinds_that_are_consistent_on_both_sensors() {
    for (sensor, radius_m, least) in [("maze-tof16", 0.15, 0.9), ("chess-depth19840", 0.1, 0.7)] {
        let Some(trips) = trips(sensor) else { continue };
        let evaluation = learn_and_evaluate(&trips, &Config::default(), radius_m);
        let isomap = methods(&evaluation).isomap;
        assert!((3..=12).contains(&isomap.n_kinds), "{sensor}: {} kinds", isomap.n_kinds);
        assert!(isomap.kappa >= least, "{sensor}: {isomap:?}");
    }
}

#[test]
fn random_kinds_are_worth_nothing() {
    let Some(trips) = trips("maze-tof16") else { return };
    let config = Config { starts: Some(1), kinds: Some(5), ..Config::default() };
    let evaluation = learn_and_evaluate(&trips, &config, 0.15);
    assert_eq!(
        evaluation.trips.iter().map(|trip| trip.kinds.len()).collect::<Vec<_>>(),
        [1379, 621],
        "both trips have poses throughout"
    );
    let random = methods(&evaluation).random;
    assert!(random.kappa.abs() < 0.05 && random.ami.abs() < 0.05, "{random:?}");
    // scikit-learn's exploration revisits the same share of the maze.
    let revisited = evaluation.pairs[0].forward.scores.revisited;
    assert!((revisited - 0.436).abs() < 0.001, "{revisited}");
}
