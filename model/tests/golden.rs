//! Against scikit-learn's numbers, which `tests/golden/make_golden.py` made.
//!
//! Those data are real numbers and ours are counts, so the steps after the neighbour search are fed graphs and
//! coordinates made here in `f64`.

use std::path::Path;

use kinds_model::em::dirichlet::{N_FRAMES_OF_KIND_MIN, fit_dirichlet_from};
use kinds_model::em::{fit_mixture, fit_mixture_from};
use kinds_model::geodesics::Geodesics;
use kinds_model::graph::{Edge, Graph};
use kinds_model::mds::{Embedding, MdsError, Spectrum};
use kinds_model::metric::Euclidean;
use kinds_model::mixture::{Mixture, most_probable};
use kinds_model::neighbors::nearest_of_each;
use kinds_model::residual_variance::{elbow, residual_variance};
use kinds_model::{
    Covariance, EmPlan, FitPlan, Frames, Method, Origin, ResponsePlan, Scale, SensorLayout, fit,
};
use safetensors::SafeTensors;

/// A file of golden arrays.
struct Golden {
    prefix: &'static str,
    bytes: Vec<u8>,
}

impl Golden {
    fn open(prefix: &'static str) -> Self {
        let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../tests/golden");
        let path = folder.join(format!("{prefix}.safetensors"));
        let bytes = std::fs::read(&path).unwrap_or_else(|error| panic!("{}: {error}", path.display()));
        Self { prefix, bytes }
    }

    fn raw<const SIZE: usize>(&self, name: &str) -> Vec<[u8; SIZE]> {
        let tensors = SafeTensors::deserialize(&self.bytes).unwrap();
        let tensor = tensors.tensor(&format!("{}/{name}", self.prefix)).unwrap();
        tensor.data().chunks_exact(SIZE).map(|number| number.try_into().unwrap()).collect()
    }

    fn f64s(&self, name: &str) -> Vec<f64> {
        self.raw(name).into_iter().map(f64::from_le_bytes).collect()
    }

    fn f32s(&self, name: &str) -> Vec<f64> {
        self.raw(name).into_iter().map(|number| f64::from(f32::from_le_bytes(number))).collect()
    }

    fn integers(&self, name: &str) -> Vec<usize> {
        self.raw(name).into_iter().map(|number| u64::from_le_bytes(number) as usize).collect()
    }

    fn bytes(&self, name: &str) -> Vec<u8> {
        self.raw::<1>(name).concat()
    }
}

fn check_relative(what: &str, found: &[f64], expected: &[f64], tolerance: f64) {
    assert_eq!(found.len(), expected.len(), "{what}");
    for (index, (found, expected)) in found.iter().zip(expected).enumerate() {
        let error = (found - expected).abs();
        assert!(error <= tolerance * expected.abs(), "{what}[{index}]: {found} instead of {expected}");
    }
}

/// Coordinates up to the sign of each dimension, against the largest coordinate.
fn check_up_to_sign(found: &[f64], expected: &[f64], n_dims: usize, tolerance: f64) {
    assert_eq!(found.len(), expected.len());
    let largest = expected.iter().fold(0.0_f64, |largest, place| largest.max(place.abs()));
    for dim in 0..n_dims {
        let along = |places: &[f64]| places.iter().skip(dim).step_by(n_dims).copied().collect::<Vec<_>>();
        let (found, expected) = (along(found), along(expected));
        let sign: f64 = found.iter().zip(&expected).map(|(a, b)| a * b).sum::<f64>().signum();
        for (index, (found, expected)) in found.iter().zip(&expected).enumerate() {
            let error = (sign * found - expected).abs();
            assert!(
                error <= tolerance * largest,
                "dimension {dim} of {index}: {found} instead of {expected}"
            );
        }
    }
}

/// Points in three dimensions.
fn points(golden: &Golden) -> Vec<[f64; 3]> {
    golden.f64s("points").chunks_exact(3).map(|point| point.try_into().unwrap()).collect()
}

fn distance(a: &[f64; 3], b: &[f64; 3]) -> f64 {
    a.iter().zip(b).map(|(a, b)| (a - b) * (a - b)).sum::<f64>().sqrt()
}

/// The `k` of `among` nearest to `point`, without the point at index `but`.
fn nearest(point: &[f64; 3], among: &[[f64; 3]], k: usize, but: Option<usize>) -> Vec<(usize, f64)> {
    let mut all: Vec<_> = among
        .iter()
        .map(|other| distance(point, other))
        .enumerate()
        .filter(|(index, _)| Some(*index) != but)
        .collect();
    all.sort_by(|a, b| a.1.total_cmp(&b.1));
    all.truncate(k);
    all
}

fn union_graph(points: &[[f64; 3]], k: usize) -> Graph {
    let edges = points.iter().enumerate().flat_map(|(a, point)| {
        let near = nearest(point, points, k, Some(a));
        near.into_iter().map(move |(b, length)| Edge { a: a as u32, b: b as u32, length: length as f32 })
    });
    Graph::new(points.len(), edges.collect::<Vec<_>>())
}

/// Shortest paths in `f64` over the edges of a graph, by Bellman and Ford with a queue: a second method.
fn geodesics_f64(graph: &Graph, points: &[[f64; 3]], source: usize) -> Vec<f64> {
    let mut lengths = vec![f64::INFINITY; points.len()];
    lengths[source] = 0.0;
    let mut queue = std::collections::VecDeque::from([source]);
    while let Some(vertex) = queue.pop_front() {
        for &(to, _) in graph.neighbors(vertex as u32) {
            let through = lengths[vertex] + distance(&points[vertex], &points[to as usize]);
            if through < lengths[to as usize] {
                lengths[to as usize] = through;
                queue.push_back(to as usize);
            }
        }
    }
    lengths
}

fn squared(lengths: &[f32]) -> Vec<f64> {
    lengths.iter().map(|&length| f64::from(length) * f64::from(length)).collect()
}

/// Scales the landmarks of a whole matrix of squared geodesics.
fn scaled(squared_geodesics: &[f64], n_dims: usize) -> Result<(Embedding, Spectrum), MdsError> {
    let n = squared_geodesics.len().isqrt();
    Embedding::fit(n, |i, j| squared_geodesics[i * n + j], n_dims, n_dims)
}

fn embed_all(embedding: &Embedding, squared_geodesics: &[f64]) -> Vec<f64> {
    let mut coordinates = vec![0.0; squared_geodesics.len() / embedding.n_landmarks() * embedding.n_dims()];
    let rows = squared_geodesics.chunks_exact(embedding.n_landmarks());
    rows.zip(coordinates.chunks_exact_mut(embedding.n_dims()))
        .for_each(|(row, place)| embedding.embed(row, place));
    coordinates
}

/// Full Isomap in `f32` geodesics: eigenvalues and residual variances. `tolerance` is for the eigenvalues: geodesics are
/// good to some 1e-6 after some ten to twenty roundings, their squares to twice that, relative to the *largest* eigenvalue.
fn check_manifold(prefix: &'static str) {
    let golden = Golden::open(prefix);
    let points = points(&golden);
    let graph = union_graph(&points, golden.integers("n_neighbors")[0]);
    assert_eq!(graph.n_edges(), golden.integers("n_edges")[0]);
    let all: Vec<u32> = (0..points.len() as u32).collect();
    let geodesics = Geodesics::measure(&graph, &all, &mut |_| ());
    let delta = squared(geodesics.lengths());
    let (embedding, spectrum) = scaled(&delta, 30).unwrap();
    let expected = golden.f64s("eigenvalues");
    for (found, wanted) in spectrum.eigenvalues.iter().zip(&expected) {
        assert!((found - wanted).abs() <= 4e-6 * expected[0], "{prefix}: {found} instead of {wanted}");
    }
    check_relative(prefix, &spectrum.eigenvalues[..3], &expected[..3], 1e-3);
    let coordinates = embed_all(&embedding, &delta);
    let residual =
        residual_variance(&coordinates, 30, &all, |frame, lane| f64::from(geodesics.row(frame)[lane]));
    check_relative(prefix, &residual[..3], &golden.f64s("residual_variances")[..3], 1e-3);
    assert_eq!(elbow(&residual), 2, "{prefix}: a sheet, rolled up or bent");
}

#[test]
fn swiss_roll_of_1000_has_scikit_learns_eigenvalues_and_residual_variance_and_two_dimensions() {
    check_manifold("swiss1000");
}

#[test]
fn swiss_roll_of_2000_has_scikit_learns_eigenvalues_and_residual_variance_and_two_dimensions() {
    check_manifold("swiss2000");
}

#[test]
fn s_curve_has_scikit_learns_eigenvalues_and_residual_variance_and_two_dimensions() {
    check_manifold("scurve1000");
}

#[test]
fn geodesics_are_scikit_learns_to_a_millionth() {
    let golden = Golden::open("swiss1000");
    let points = points(&golden);
    let graph = union_graph(&points, golden.integers("n_neighbors")[0]);
    let landmarks: Vec<u32> =
        golden.integers("geodesics/vertices").iter().map(|&vertex| vertex as u32).collect();
    let geodesics = Geodesics::measure(&graph, &landmarks, &mut |_| ());
    for (lane, expected) in golden.f64s("geodesics/rows").chunks_exact(points.len()).enumerate() {
        let found: Vec<f64> = (0..points.len()).map(|frame| f64::from(geodesics.row(frame)[lane])).collect();
        check_relative("geodesics", &found, expected, 1e-6);
    }
}

#[test]
fn on_geodesics_in_f64_eigenvalues_and_coordinates_are_scikit_learns() {
    let golden = Golden::open("swiss1000");
    let points = points(&golden);
    let graph = union_graph(&points, golden.integers("n_neighbors")[0]);
    let delta: Vec<f64> = (0..points.len())
        .flat_map(|source| geodesics_f64(&graph, &points, source))
        .map(|length| length * length)
        .collect();
    let (embedding, spectrum) = scaled(&delta, 3).unwrap();
    check_relative("eigenvalues", &spectrum.eigenvalues[..5], &golden.f64s("eigenvalues"), 1e-8);
    check_up_to_sign(&embed_all(&embedding, &delta), &golden.f64s("coordinates"), 3, 1e-6);
}

#[test]
fn landmarks_embed_all_points_as_scikit_learn_does() {
    let golden = Golden::open("swiss1000");
    let points = points(&golden);
    let graph = union_graph(&points, golden.integers("n_neighbors")[0]);
    let landmarks: Vec<u32> =
        golden.integers("landmarks/indices").iter().map(|&index| index as u32).collect();
    let delta = squared(Geodesics::measure(&graph, &landmarks, &mut |_| ()).lengths());
    let n = landmarks.len();
    let block: Vec<f64> =
        landmarks.iter().flat_map(|&landmark| delta[landmark as usize * n..][..n].to_vec()).collect();
    let (embedding, spectrum) = scaled(&block, 3).unwrap();
    check_relative("eigenvalues", &spectrum.eigenvalues[..3], &golden.f64s("landmarks/eigenvalues"), 1e-5);
    check_up_to_sign(&embed_all(&embedding, &delta), &golden.f64s("landmarks/coordinates"), 3, 1e-5);
}

#[test]
fn new_points_embed_where_scikit_learns_transform_puts_them() {
    let golden = Golden::open("swiss1000");
    let points = points(&golden);
    let (known, new) = points.split_at(golden.integers("out_of_sample/n_frames")[0]);
    let k = golden.integers("n_neighbors")[0];
    let all: Vec<u32> = (0..known.len() as u32).collect();
    let geodesics = Geodesics::measure(&union_graph(known, k), &all, &mut |_| ());
    let (embedding, spectrum) = scaled(&squared(geodesics.lengths()), 3).unwrap();
    check_relative(
        "eigenvalues",
        &spectrum.eigenvalues[..3],
        &golden.f64s("out_of_sample/eigenvalues"),
        1e-5,
    );
    let mut lengths = vec![0.0; known.len()];
    let delta: Vec<f64> = new
        .iter()
        .flat_map(|point| {
            let near = nearest(point, known, k, None)
                .into_iter()
                .map(|(index, length)| (index as u32, length as f32));
            geodesics.through(near, &mut lengths);
            squared(&lengths)
        })
        .collect();
    check_up_to_sign(&embed_all(&embedding, &delta), &golden.f64s("out_of_sample/coordinates"), 3, 1e-5);
}

const DIGITS: SensorLayout = SensorLayout { rows: 8, columns: 8, metres_per_count: 1.0 };

/// Pixels as counts, compared as they are: range scale, one metre a count, up to 16 m. Pixel 0 reads as invalid, which is
/// taken for 0 m.
fn digits_plan(method: Method) -> FitPlan {
    FitPlan {
        method,
        n_neighbors: Some(10),
        n_dims: Some(8),
        n_kinds: Some(10),
        ..FitPlan::new(
            DIGITS,
            ResponsePlan { invalid_range_m: 0.0, ..ResponsePlan::new(Scale::Range, 16.0) },
            0,
        )
    }
}

fn digits(golden: &Golden) -> Vec<u16> {
    golden.bytes("points").into_iter().map(u16::from).collect()
}

#[test]
fn neighbours_of_digits_are_those_of_a_stable_sort_on_whole_numbers() {
    let golden = Golden::open("digits");
    let frames = Frames::new(64, digits(&golden));
    let found: Vec<u16> = nearest_of_each(&frames, &Euclidean, 10, &mut |_| ())
        .nearest(10)
        .flatten()
        .map(|near| near.frame_index as u16)
        .collect();
    let expected: Vec<u16> = golden.raw("neighbors").into_iter().map(u16::from_le_bytes).collect();
    assert_eq!(found, expected);
}

#[test]
fn isomap_of_digits_has_scikit_learns_eigenvalues_residual_variance_and_coordinates() {
    let golden = Golden::open("digits");
    let model =
        fit(digits(&golden), &digits_plan(Method::Isomap), Origin::default(), &mut |_, _, _| ()).unwrap();
    let provenance = &model.manifest().provenance;
    assert_eq!(provenance.islands, [1797]);
    check_relative("eigenvalues", &provenance.eigenvalues[..5], &golden.f64s("eigenvalues"), 1e-5);
    check_relative("residual", &provenance.residual_variance[..8], &golden.f64s("residual_variances"), 1e-4);
    check_up_to_sign(model.coordinates(), &golden.f32s("isomap/coordinates"), 8, 1e-4);
    // The printed level, as a second witness: .0777 at 8 dimensions, within 2 %.
    assert!((provenance.residual_variance[7] / 0.0777 - 1.0).abs() < 0.02);
    let agreement = adjusted_rand(&kinds(&model), &golden.bytes("labels"));
    // Other optima of the mixture span .71 to .81.
    assert!(agreement > 0.70, "adjusted Rand index {agreement}");
}

#[test]
fn euclidean_distances_give_the_principal_components() {
    let golden = Golden::open("digits");
    let model =
        fit(digits(&golden), &digits_plan(Method::Pca), Origin::default(), &mut |_, _, _| ()).unwrap();
    let expected: Vec<f64> =
        golden.f64s("pca/explained_variances").iter().map(|variance| 1796.0 * variance).collect();
    check_relative("eigenvalues", &model.manifest().provenance.eigenvalues[..8], &expected, 1e-8);
    check_up_to_sign(model.coordinates(), &golden.f32s("pca/coordinates"), 8, 1e-6);
}

fn kinds(model: &kinds_model::Model) -> Vec<usize> {
    let mut probabilities = vec![0.0; model.mixture().n_kinds()];
    let places = model.coordinates().chunks_exact(model.manifest().n_dims);
    places
        .map(|place| {
            model.mixture().posterior(place, &mut probabilities);
            most_probable(&probabilities)
        })
        .collect()
}

/// Hubert & Arabie 1985, *Comparing partitions*, eq. (5), by counting pairs of things one after the other.
fn adjusted_rand(kinds: &[usize], labels: &[u8]) -> f64 {
    let (mut together, mut same_kind, mut same_label, mut all) = (0.0, 0.0, 0.0, 0.0);
    for a in 0..kinds.len() {
        for b in 0..a {
            let (kind, label) = (kinds[a] == kinds[b], labels[a] == labels[b]);
            together += f64::from(u8::from(kind && label));
            same_kind += f64::from(u8::from(kind));
            same_label += f64::from(u8::from(label));
            all += 1.0;
        }
    }
    let expected = same_kind * same_label / all;
    (together - expected) / (0.5 * (same_kind + same_label) - expected)
}

/// No floor to speak of, to convergence.
fn exact(covariance: Covariance) -> EmPlan {
    EmPlan {
        covariance,
        covariance_floor: 1e-300,
        tolerance: 1e-12,
        n_iterations_max: 5000,
        ..EmPlan::new(0)
    }
}

#[test]
fn iris_has_scikit_learns_bic_for_one_two_and_three_kinds() {
    let golden = Golden::open("iris");
    let flowers = golden.f64s("points");
    for (n_kinds, expected) in (1..=3).zip(golden.f64s("bic")) {
        let fit = fit_mixture(&flowers, 4, n_kinds, &exact(Covariance::Full), &mut |_| ()).unwrap();
        let bic = bic(*fit.log_likelihoods.last().unwrap(), &fit.mixture, Covariance::Full, 150);
        assert!((bic - expected).abs() <= 1e-5 * expected, "{n_kinds} kinds: {bic} instead of {expected}");
    }
}

fn bic(log_likelihood: f64, mixture: &Mixture, covariance: Covariance, n_frames: usize) -> f64 {
    let n_parameters = covariance.n_parameters(mixture.n_kinds(), mixture.n_dims());
    -2.0 * log_likelihood + n_parameters as f64 * (n_frames as f64).ln()
}

/// Where each shape of covariances stands in the files: after the name of the mixture.
const SHAPES: [(&str, Covariance); 4] = [
    ("", Covariance::Full),
    ("_tied", Covariance::Tied),
    ("_diag", Covariance::Diagonal),
    ("_spherical", Covariance::Spherical),
];

/// EM from the same start, for each shape of covariances: step by step, and at its fixpoint.
fn check_em(golden: &Golden, name: &str, coordinates: &[f64], n_dims: usize) {
    for (suffix, covariance) in SHAPES {
        let what = |of: &str| format!("{of} of {covariance:?}");
        let array = |array: &str| golden.f64s(&format!("{name}{suffix}/{array}"));
        let start =
            Mixture::new(n_dims, array("start/weights"), array("start/means"), array("start/covariances"))
                .unwrap();
        let fit = fit_mixture_from(coordinates, start, &exact(covariance)).unwrap();
        assert!(fit.converged);
        check_relative(&what("steps"), &fit.log_likelihoods[..10], &array("log_likelihoods"), 1e-9);
        let end = fit.log_likelihoods[fit.log_likelihoods.len() - 1];
        check_relative(&what("end"), &[end], &array("log_likelihood"), 1e-6);
        let bic = bic(end, &fit.mixture, covariance, coordinates.len() / n_dims);
        check_relative(&what("BIC"), &[bic], &array("bic"), 1e-6);
        check_relative(&what("weights"), fit.mixture.weights(), &array("weights"), 1e-4);
        check_relative(&what("means"), fit.mixture.means(), &array("means"), 1e-3);
        check_covariances(&what("covariances"), fit.mixture.covariances(), &array("covariances"));
    }
}

/// Against the largest entry: those beside the diagonal may be nearly nothing.
fn check_covariances(what: &str, found: &[f64], expected: &[f64]) {
    assert_eq!(found.len(), expected.len(), "{what}");
    let largest = expected.iter().fold(0.0_f64, |largest, entry| largest.max(entry.abs()));
    for (index, (found, expected)) in found.iter().zip(expected).enumerate() {
        let error = (found - expected).abs();
        assert!(error <= 1e-3 * largest, "{what}[{index}]: {found} instead of {expected}");
    }
}

#[test]
fn em_on_iris_takes_scikit_learns_steps_and_reaches_its_fixpoint() {
    let golden = Golden::open("iris");
    check_em(&golden, "mixture3", &golden.f64s("points"), 4);
}

#[test]
fn em_on_digits_takes_scikit_learns_steps_and_reaches_its_fixpoint() {
    let golden = Golden::open("digits");
    check_em(&golden, "pca/mixture5", &golden.f32s("pca/coordinates"), 8);
}

#[test]
fn a_dirichlet_process_on_iris_takes_scikit_learns_steps_and_reaches_its_fixpoint() {
    let golden = Golden::open("iris");
    let array = |name: &str| golden.f64s(&format!("dirichlet6/{name}"));
    let n_frames = array("n_frames");
    let mut responsibilities = vec![0.0; n_frames.len() * 150];
    for (index, kind) in golden.bytes("dirichlet6/kinds").into_iter().enumerate() {
        responsibilities[usize::from(kind) * 150 + index] = 1.0;
    }
    let plan = exact(Covariance::Full);
    let fit = fit_dirichlet_from(&golden.f64s("points"), 4, responsibilities, 150.0, &plan).unwrap();
    assert!(fit.converged);
    // scikit-learn's bound lacks constants, so it is compared by what it rises.
    let rises = |bounds: &[f64]| bounds.windows(2).map(|pair| pair[1] - pair[0]).collect::<Vec<_>>();
    let expected = array("lower_bounds");
    for (step, (found, expected)) in
        rises(&fit.lower_bounds[..expected.len()]).iter().zip(rises(&expected)).enumerate()
    {
        // Both are differences of bounds of some 1000 nats.
        assert!((found - expected).abs() < 1e-9, "step {step}: {found} instead of {expected}");
    }
    for (found, expected) in fit.n_frames_of_kinds.iter().zip(&n_frames) {
        assert!((found - expected).abs() < 1e-3, "{found} frames instead of {expected}");
    }
    let n_stay = n_frames.iter().filter(|n_frames| **n_frames >= N_FRAMES_OF_KIND_MIN).count();
    assert_eq!((fit.mixture.n_kinds(), n_stay), (4, 4));
    let sum: f64 = array("weights")[..n_stay].iter().sum();
    let weights: Vec<f64> = array("weights")[..n_stay].iter().map(|weight| weight / sum).collect();
    check_relative("weights", fit.mixture.weights(), &weights, 1e-5);
    check_relative("means", fit.mixture.means(), &array("means")[..4 * n_stay], 1e-5);
    let covariances = &array("covariances")[..16 * n_stay];
    check_covariances("covariances", fit.mixture.covariances(), covariances);
}
