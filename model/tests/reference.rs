//! Models that do not keep every frame that they were learnt from, and graphs with edges between frames that follow each
//! other: facts that hold exactly, on small made-up trips of whole numbers.

use std::sync::Arc;

use bytes::Bytes;
use kinds_model::autocorrelation::n_frames_effective;
use kinds_model::metric::{Euclidean, Metric};
use kinds_model::neighbors::length;
use kinds_model::{
    Classifier, Command, Commands, FitPlan, FrameSource, Method, Model, Origin, ResponsePlan, Scale,
    SensorLayout, Size, StreamError, file, fit, fit_stream, fit_with_commands, refit,
};
use rand::RngExt;
use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::SeedableRng;

const N_READINGS: usize = 6;
const N_TRAINED: usize = 240;
const N_DIMS: usize = 3;

/// Two trips of a robot that wanders between a narrow and a wide place, stands still for a while, and once sees something
/// that is nowhere else.
fn trips() -> Vec<u16> {
    let mut random = ChaCha8Rng::seed_from_u64(7);
    let mut counts = Vec::new();
    for index in 0..N_TRAINED {
        let phase = index.min(200) as f64 / 25.0;
        let width = 1500.0 + 1000.0 * phase.sin();
        for reading in 0..N_READINGS {
            let range = width * (1.2 + (phase + reading as f64).cos()) + random.random_range(-20.0..20.0);
            counts.push(if index == 71 { 3900 } else { range.max(1.0) as u16 });
        }
    }
    counts
}

fn plan(method: Method, n_frames_max: usize) -> FitPlan {
    FitPlan {
        n_frames_max,
        method,
        n_neighbors: Some(6),
        n_landmarks: 40,
        n_dims: Some(N_DIMS),
        n_kinds: Some(3),
        ..FitPlan::new(
            SensorLayout { rows: 1, columns: N_READINGS as u32, metres_per_count: 0.001 },
            ResponsePlan::new(Scale::Inverse, 4.0),
            1,
        )
    }
}

fn fitted(plan: &FitPlan) -> Model {
    let origin = Origin { n_frames: vec![130, N_TRAINED - 130], ..Origin::default() };
    fit(trips(), plan, origin, &mut |_, _, _| ()).unwrap()
}

/// A model that keeps every third frame.
fn thinned(method: Method) -> Model {
    fitted(&plan(method, N_TRAINED / 3))
}

fn place(model: &Model, index: usize) -> &[f64] {
    &model.coordinates()[index * N_DIMS..][..N_DIMS]
}

#[test]
fn where_every_frame_may_be_kept_the_limit_changes_nothing() {
    for method in [Method::Isomap, Method::Pca] {
        let [exact, ample] = [N_TRAINED, usize::MAX].map(|n_frames_max| fitted(&plan(method, n_frames_max)));
        let numbers = |model: &Model| {
            let mixture = model.mixture();
            [model.coordinates(), mixture.weights(), mixture.means(), mixture.covariances()].concat()
        };
        assert_eq!(numbers(&exact), numbers(&ample));
        assert_eq!(exact.squared_radii(), ample.squared_radii());
        let all: Vec<u32> = (0..N_TRAINED as u32).collect();
        assert_eq!((exact.references().indices(), exact.references().nearest()), (&all[..], &all[..]));
        assert_eq!(exact.manifest().provenance, ample.manifest().provenance);
        assert_eq!(exact.manifest().provenance.covering_radius, 0.0);
    }
}

#[test]
fn a_thinned_model_serves_every_trained_frame_at_its_coordinates_bit_for_bit_and_finds_few_novel() {
    for method in [Method::Isomap, Method::Pca] {
        let model = Arc::new(thinned(method));
        assert_eq!((model.manifest().n_trained, model.manifest().n_frames), (N_TRAINED, N_TRAINED / 3));
        assert_eq!(model.coordinates().len(), N_TRAINED * N_DIMS);
        let mut classifier = Classifier::new(Arc::clone(&model));
        let (novelty, mut n_novel) = (model.manifest().novelty, 0);
        for (index, frame) in trips().chunks_exact(N_READINGS).enumerate() {
            let found = classifier.classify(frame);
            assert_eq!(found.coordinates, place(&model, index), "{method:?}, frame {index}");
            n_novel += usize::from(novelty.is_novel(found.novelty));
        }
        // They are no farther from what is kept than when their part of the trip is hidden; their places differ, though.
        assert!(n_novel as f64 <= 0.05 * N_TRAINED as f64, "{method:?}: {n_novel}");
    }
}

#[test]
fn every_trained_frame_is_within_the_covering_radius_of_the_reference_frame_that_stands_for_it() {
    let model = thinned(Method::Isomap);
    let mut mapped = trips();
    model.response().map_in_place(&mut mapped);
    let (references, frames) = (model.references(), model.frames());
    let distances = mapped.chunks_exact(N_READINGS).zip(references.nearest());
    let distances: Vec<f32> = distances
        .map(|(frame, &near)| length(Euclidean.squared_distance(frame, frames.row(near as usize))))
        .collect();
    let farthest = distances.iter().copied().fold(0.0, f32::max);
    assert_eq!(model.manifest().provenance.covering_radius, farthest);
    assert!(farthest > 0.0);
    for (row, &index) in references.indices().iter().enumerate() {
        assert_eq!(frames.row(row), &mapped[index as usize * N_READINGS..][..N_READINGS]);
    }
    // What was seen once is kept.
    assert!(references.indices().contains(&71));
}

#[test]
fn kinds_and_independent_frames_are_of_all_trained_frames_and_landmarks_of_those_that_are_kept() {
    let model = thinned(Method::Isomap);
    let (manifest, mixture) = (model.manifest(), model.mixture());
    let mut probabilities = [0.0; 3];
    let log_likelihood: f64 = model
        .coordinates()
        .chunks_exact(N_DIMS)
        .map(|place| mixture.posterior(place, &mut probabilities))
        .sum();
    // Sums of 240 numbers in another order.
    assert!((log_likelihood / manifest.provenance.log_likelihood - 1.0).abs() < 1e-12);
    let n_effective = n_frames_effective(model.coordinates(), N_DIMS, &[130, N_TRAINED - 130]);
    assert_eq!(manifest.provenance.n_frames_effective, n_effective);
    assert_eq!(model.landmarks().len(), 40);
    assert!(model.landmarks().iter().all(|&landmark| (landmark as usize) < manifest.n_frames));
    let all = fitted(&FitPlan { n_landmarks: usize::MAX, ..plan(Method::Isomap, 50) });
    assert_eq!(all.manifest().plan.n_landmarks, 50);
}

#[test]
fn thinning_does_not_change_what_dimensions_the_frames_fill() {
    let of = |model: &Model| model.manifest().provenance.intrinsic_dims;
    let (few, all) = (thinned(Method::Isomap), fitted(&plan(Method::Isomap, usize::MAX)));
    assert_eq!(of(&few), of(&all));
    assert!(of(&few).two_nn.is_some());
}

#[test]
fn a_thinned_model_is_the_same_bytes_on_one_thread_and_on_two() {
    for method in [Method::Isomap, Method::Pca] {
        let on = |n_threads| {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(n_threads).build().unwrap();
            pool.install(|| file::to_bytes(&thinned(method)))
        };
        assert!(on(1) == on(2), "{method:?}");
    }
}

#[test]
fn a_rival_of_a_thinned_model_counts_each_reference_frame_for_all_that_it_stands_for() {
    let model = thinned(Method::Isomap);
    let rival = refit(&model, Method::Pca, Size::Matched, &mut |_, _, _| ()).unwrap();
    let (references, manifest) = (rival.references(), rival.manifest());
    assert_eq!((manifest.n_trained, manifest.n_frames), (N_TRAINED, N_TRAINED / 3));
    for (index, &nearest) in references.nearest().iter().enumerate() {
        let stands_for_it = references.indices()[nearest as usize] as usize;
        assert_eq!(place(&rival, index), place(&rival, stands_for_it), "frame {index}");
    }
    // As one fitted to the frames themselves, but for the places of those that are gone.
    let own = thinned(Method::Pca);
    for &index in references.indices() {
        assert_eq!(place(&rival, index as usize), place(&own, index as usize));
    }
    assert_eq!(manifest.provenance.covering_radius, model.manifest().provenance.covering_radius);
    assert_eq!(manifest.provenance.intrinsic_dims, model.manifest().provenance.intrinsic_dims);
    // A rival of the rival is fitted to the same.
    let again = refit(&rival, Method::Pca, Size::Matched, &mut |_, _, _| ()).unwrap();
    assert_eq!(again.id(), rival.id());
}

#[test]
fn a_thinned_model_read_from_its_bytes_is_the_same_and_one_cut_off_or_with_a_flipped_bit_is_refused() {
    for method in [Method::Isomap, Method::Pca] {
        let model = thinned(method);
        let bytes = file::to_bytes(&model);
        let read = file::from_bytes(&Bytes::from(bytes.clone())).unwrap();
        assert_eq!((read.id(), read.manifest()), (model.id(), model.manifest()));
        assert_eq!(read.references().indices(), model.references().indices());
        assert_eq!(read.references().nearest(), model.references().nearest());
        assert_eq!(read.coordinates(), model.coordinates());
        assert_eq!(file::to_bytes(&read), bytes);
        let header = 8 + u64::from_le_bytes(bytes[..8].try_into().unwrap()) as usize;
        for place in (header..bytes.len()).step_by(37) {
            assert!(file::from_bytes(&Bytes::from(bytes[..place].to_vec())).is_err());
            let mut flipped = bytes.clone();
            flipped[place] ^= 1 << (place % 8);
            if let Ok(read) = file::from_bytes(&Bytes::from(flipped)) {
                assert_eq!(read.id(), model.id(), "byte {place} changed the model and its name did not");
            }
        }
    }
}

#[test]
fn reference_frames_that_are_too_few_are_refused_in_words() {
    let refuse =
        |plan: FitPlan| fit(trips(), &plan, Origin::default(), &mut |_, _, _| ()).unwrap_err().to_string();
    assert_eq!(
        refuse(plan(Method::Isomap, 6)),
        "6 reference frames are too few for 6 neighbours each; ask for fewer neighbours or keep more of the 240 frames"
    );
    assert_eq!(
        refuse(FitPlan { n_neighbors: None, ..plan(Method::Isomap, 1) }),
        "1 reference frames are too few for 1 neighbours each; ask for fewer neighbours or keep more of the 240 frames"
    );
    assert!(refuse(plan(Method::Isomap, 0)).starts_with("0 reference frames were asked for; "));
}

/// A robot is in one room for thirty frames, then in another for thirty, which looks wholly different.
fn two_rooms() -> Vec<u16> {
    let frame = |index: u16| {
        let room = if index < 30 { 500 } else { 3000 };
        (0..N_READINGS as u16).map(move |reading| room + (index * 37 + reading * 11 * index) % 97)
    };
    (0..60).flat_map(frame).collect()
}

fn of_two_rooms(plan: &FitPlan, n_frames: Vec<usize>) -> Model {
    fit(two_rooms(), plan, Origin { n_frames, ..Origin::default() }, &mut |_, _, _| ()).unwrap()
}

#[test]
fn rooms_that_follow_each_other_in_time_need_no_bridge_and_two_trips_are_not_tied() {
    let all_landmarks = FitPlan { n_landmarks: usize::MAX, n_kinds: Some(2), ..plan(Method::Isomap, 100) };
    let tied = FitPlan { consecutive_edges: true, ..all_landmarks.clone() };
    for n_frames_max in [100, 40] {
        let model = |plan: &FitPlan, n_frames: &[usize]| {
            of_two_rooms(&FitPlan { n_frames_max, ..plan.clone() }, n_frames.to_vec())
        };
        let islands = |model: &Model| {
            let provenance = &model.manifest().provenance;
            (provenance.islands.len(), provenance.bridges.len())
        };
        assert_eq!(islands(&model(&all_landmarks, &[60])), (2, 1));
        assert_eq!(islands(&model(&tied, &[60])), (1, 0));
        assert_eq!(islands(&model(&tied, &[])), (1, 0), "all frames are of one trip");
        assert_eq!(islands(&model(&tied, &[30, 30])), (2, 1));
    }
    // The edge is as long as the frames are apart, and the only way from one room to the other.
    let model = of_two_rooms(&tied, vec![60]);
    let geodesics = model.geodesics().unwrap();
    let apart = length(Euclidean.squared_distance(model.frames().row(29), model.frames().row(30)));
    assert_eq!(geodesics.row(29)[30], apart);
    assert!((30..60).all(|index| geodesics.row(index)[29] >= apart));
}

#[test]
fn the_scan_of_neighbours_sees_edges_in_time() {
    let plan = FitPlan { n_neighbors: None, n_kinds: Some(2), ..plan(Method::Isomap, 100) };
    let tried = |consecutive_edges| {
        let model = of_two_rooms(&FitPlan { consecutive_edges, ..plan.clone() }, vec![60]);
        model.manifest().provenance.neighbors_tried.clone()
    };
    // Rooms are of thirty frames: only a graph of thirty neighbours leaves one.
    let (apart, tied) = (tried(false), tried(true));
    assert!(apart[..apart.len() - 1].iter().all(|trial| trial.n_islands > 1 && !trial.bridges.is_empty()));
    assert!(tied.iter().all(|trial| trial.n_islands == 1 && trial.bridges.is_empty()));
    // Every frame is linked with the next: the fewest neighbours that can be are few enough.
    assert_eq!(tied[0].n_neighbors, 1);
}

/// The same trips, read one frame after the other; fails at a frame, if told to.
struct Reader {
    counts: Vec<u16>,
    next: usize,
    n_passes: usize,
    fails_in_pass: Option<usize>,
}

impl Reader {
    fn of_trips(fails_in_pass: Option<usize>) -> Self {
        Self { counts: trips(), next: 0, n_passes: 0, fails_in_pass }
    }
}

impl FrameSource for Reader {
    type Error = String;

    fn n_frames(&self) -> usize {
        self.counts.len() / N_READINGS
    }

    fn rewind(&mut self) -> Result<(), String> {
        self.n_passes += 1;
        self.next = 0;
        Ok(())
    }

    fn read(&mut self, counts: &mut [u16]) -> Result<(), String> {
        if self.fails_in_pass == Some(self.n_passes) && self.next == 200 {
            return Err("the disk is on fire".to_string());
        }
        counts.copy_from_slice(&self.counts[self.next * N_READINGS..][..N_READINGS]);
        self.next += 1;
        Ok(())
    }
}

#[test]
fn frames_that_are_read_make_the_model_that_they_make_in_memory_in_as_many_passes_as_are_needed() {
    let command = |index: usize| Command { forward_m_s: (index % 7) as f64, turn_rad_s: 0.1 };
    let commands = Commands { weight: 0.2, of_frames: (0..N_TRAINED).map(command).collect() };
    let check = |plan: FitPlan, commands: Option<&Commands>, n_passes: usize| {
        let (mut reader, origin) = (Reader::of_trips(None), Origin::default());
        let read = fit_stream(&mut reader, commands, &plan, origin.clone(), &mut |_, _, _| ()).unwrap();
        let held = match commands {
            Some(commands) => fit_with_commands(trips(), commands, &plan, origin, &mut |_, _, _| ()),
            None => fit(trips(), &plan, origin, &mut |_, _, _| ()),
        };
        assert_eq!(read.id(), held.unwrap().id());
        assert_eq!(reader.n_passes, n_passes, "{plan:?}");
    };
    for method in [Method::Isomap, Method::Pca] {
        check(plan(method, N_TRAINED), None, 1);
        check(plan(method, N_TRAINED / 3), None, 2);
        check(plan(method, N_TRAINED), Some(&commands), 1);
        check(plan(method, N_TRAINED / 3), Some(&commands), 3);
    }
    check(FitPlan { consecutive_edges: true, ..plan(Method::Isomap, N_TRAINED / 3) }, None, 3);
    check(FitPlan { n_dims: None, ..plan(Method::Native, N_TRAINED / 3) }, None, 2);
}

#[test]
fn frames_that_cannot_be_read_end_the_fit_in_whichever_pass() {
    let refusal = |n_frames_max, fails_in_pass| {
        let mut reader = Reader::of_trips(Some(fails_in_pass));
        let plan = plan(Method::Isomap, n_frames_max);
        fit_stream(&mut reader, None, &plan, Origin::default(), &mut |_, _, _| ()).unwrap_err()
    };
    for (n_frames_max, fails_in_pass) in [(N_TRAINED, 1), (80, 1), (80, 2)] {
        assert_eq!(
            refusal(n_frames_max, fails_in_pass),
            StreamError::Read("the disk is on fire".to_string())
        );
    }
}

#[test]
fn a_model_larger_than_memory_is_refused_with_its_numbers_before_a_frame_is_read() {
    struct Endless;
    impl FrameSource for Endless {
        type Error = String;

        fn n_frames(&self) -> usize {
            1 << 40
        }

        fn rewind(&mut self) -> Result<(), String> {
            panic!("nothing is to be read")
        }

        fn read(&mut self, _: &mut [u16]) -> Result<(), String> {
            panic!("nothing is to be read")
        }
    }
    let plan = FitPlan { n_landmarks: 1 << 30, ..plan(Method::Isomap, usize::MAX) };
    let refusal = fit_stream(&mut Endless, None, &plan, Origin::default(), &mut |_, _, _| ()).unwrap_err();
    assert_eq!(
        refusal.to_string(),
        "1099511627776 reference frames of 6 counts each, with 1073741824 landmarks, take 18446744073.7 GB to fit, which this \
         machine does not have; ask for fewer reference frames or fewer landmarks"
    );
}

/// A robot that goes on to places which it has not seen before, for longer than can be held.
fn long_trip() -> Vec<u16> {
    let mut random = ChaCha8Rng::seed_from_u64(8);
    let mut counts = Vec::new();
    for index in 0..1700 {
        let phase = f64::from(index) / 40.0;
        for reading in 0..N_READINGS {
            let range = 1500.0 + 800.0 * (phase + reading as f64).sin() + 30.0 * phase * (reading % 3) as f64;
            counts.push((range + random.random_range(-25.0..25.0)) as u16);
        }
    }
    counts
}

#[test]
fn a_trip_that_is_thinned_as_it_passes_makes_the_same_model_on_any_number_of_threads_and_serves_its_frames_there()
 {
    let plan = plan(Method::Isomap, 60);
    let on = |n_threads| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(n_threads).build().unwrap();
        pool.install(|| fit(long_trip(), &plan, Origin::default(), &mut |_, _, _| ()).unwrap())
    };
    let model = Arc::new(on(1));
    assert_eq!(model.id(), on(2).id());
    let references = model.references();
    assert_eq!((references.n_frames(), references.n_trained()), (60, 1700));
    let mut classifier = Classifier::new(Arc::clone(&model));
    let mut squared_radius = 0;
    for (index, frame) in long_trip().chunks_exact(N_READINGS).enumerate() {
        assert_eq!(classifier.classify(frame).coordinates, place(&model, index), "frame {index}");
        let mut mapped = frame.to_vec();
        model.response().map_in_place(&mut mapped);
        // The plainest way: all distances, of equals the first.
        let squared = |reference: usize| Euclidean.squared_distance(&mapped, model.frames().row(reference));
        let nearest = (0..60).min_by_key(|&reference| squared(reference)).unwrap();
        assert_eq!(references.nearest()[index] as usize, nearest, "frame {index}");
        squared_radius = squared_radius.max(squared(nearest));
    }
    assert_eq!(model.manifest().provenance.covering_radius, length(squared_radius));
}
