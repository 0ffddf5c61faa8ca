"""Makes the golden data: public data sets, and what scikit-learn computes from them.

    python -m venv venv && venv/bin/pip install -r requirements.txt
    venv/bin/python make_golden.py

Writes one safetensors file per data set beside this script; README.md lists every array in them.
Every fact that our tests lean on (one island, distinct distances, the out-of-sample formula) is
asserted here, so that a newer scikit-learn that behaves otherwise stops this script and not a test.

Conventions
- Residual variance is 1 - r², r being Pearson's correlation between geodesics and Euclidean
  distances of the coordinates, over the N(N-1)/2 pairs i < j, no diagonal.
- Eigenvalues are those of B = -1/2 H D H, D the squared geodesics, H = I - 11ᵀ/n. PCA's explained
  variances are such eigenvalues for Euclidean distances, divided by N - 1.
- Coordinates have mean zero over the reference frames (over the landmarks, if not all frames are).
  Frames out of sample are not centred again.
- A column's sign is arbitrary; here its entry of largest magnitude in the sample is positive.
- Log-likelihoods are natural, and totals over all frames, not means.
"""

from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from safetensors.numpy import save
from scipy.sparse import csr_array
from scipy.sparse.csgraph import connected_components
from scipy.spatial.distance import pdist, squareform
from sklearn.cluster import KMeans
from sklearn.datasets import load_digits, load_iris, make_s_curve, make_swiss_roll
from sklearn.decomposition import PCA, KernelPCA
from sklearn.manifold import Isomap
from sklearn.metrics import (
    adjusted_mutual_info_score,
    adjusted_rand_score,
    normalized_mutual_info_score,
)
from sklearn.mixture import BayesianGaussianMixture, GaussianMixture
from threadpoolctl import threadpool_limits

HERE = Path(__file__).resolve().parent
Arrays = dict[str, NDArray]

# Residual variances are given for 1 to this many dimensions, and digits are embedded in as many.
N_DIMS = 8


def main() -> None:
    # One thread, so that sums are taken in one order and every run writes the same bytes.
    with threadpool_limits(1):
        data_sets = {
            "swiss1000": swiss1000(),
            "swiss2000": swiss2000(),
            "scurve1000": scurve1000(),
            "digits": digits(),
            "iris": iris(),
            "agreement": agreement(),
        }
    for name, arrays in data_sets.items():
        path = HERE / f"{name}.safetensors"
        named = {f"{name}/{key}": np.ascontiguousarray(value) for key, value in arrays.items()}
        path.write_bytes(save(named))
        print(f"{path.name}: {len(named)} arrays, {path.stat().st_size} bytes")


# ---------------------------------------------------------------- data sets


def swiss1000() -> Arrays:
    points, _ = make_swiss_roll(1000, random_state=0)
    isomap = fit_isomap(points, n_neighbors=7)
    vertices = np.array([0, 1, 250, 500, 999])
    return {
        **isomap_arrays(points, isomap),
        "coordinates": positive(isomap.embedding_[:, :3])[0],
        "geodesics/vertices": vertices.astype(np.uint64),
        "geodesics/rows": isomap.dist_matrix_[vertices],
        **prefixed("out_of_sample", out_of_sample(points[:800], points[800:], n_neighbors=7)),
        **prefixed("landmarks", landmarks(isomap, n_landmarks=100)),
    }


def swiss2000() -> Arrays:
    points, _ = make_swiss_roll(2000, random_state=0)
    return isomap_arrays(points, fit_isomap(points, n_neighbors=12))


def scurve1000() -> Arrays:
    points, _ = make_s_curve(1000, random_state=0)
    return isomap_arrays(points, fit_isomap(points, n_neighbors=10))


def digits() -> Arrays:
    data = load_digits()
    neighbors, graph = graph_with_ties(data.data.astype(np.int64), n_neighbors=10)
    isomap = Isomap(
        n_neighbors=10, n_components=N_DIMS, eigen_solver="dense", metric="precomputed"
    ).fit(graph)
    assert n_islands(isomap) == 1
    pca = PCA(N_DIMS, svd_solver="full").fit(data.data)

    # Both are inputs of mixtures: rounded to f32 first, so that the mixtures were fitted on exactly
    # what the file holds.
    isomap_coordinates = positive(isomap.embedding_)[0].astype(np.float32)
    pca_coordinates = positive(pca.transform(data.data))[0].astype(np.float32)
    return {
        **isomap_arrays(data.data.astype(np.uint8), isomap),
        "labels": data.target.astype(np.uint8),
        "neighbors": neighbors.astype(np.uint16),
        "isomap/coordinates": isomap_coordinates,
        "pca/coordinates": pca_coordinates,
        "pca/explained_variances": pca.explained_variance_,
        **mixtures_from_start("pca/mixture5", pca_coordinates, n_kinds=5),
        **prefixed("isomap/mixture10", mixture_against_labels(isomap_coordinates, data.target)),
        **prefixed("pca/mixture10", mixture_against_labels(pca_coordinates, data.target)),
    }


def iris() -> Arrays:
    points = load_iris().data
    return {
        "points": points,
        "bic": np.array([best_mixture(points, n_kinds).bic(points) for n_kinds in (1, 2, 3)]),
        **mixtures_from_start("mixture3", points, n_kinds=3),
        **prefixed("dirichlet6", dirichlet_from_start(points, n_kinds=6)),
    }


def agreement() -> Arrays:
    """Pairs of labellings: pair i is first[offsets[i]:offsets[i + 1]], second[likewise]."""
    pairs = degenerate_pairs() + random_pairs(n_pairs=36)
    lengths = [len(first) for first, _ in pairs]
    return {
        "first": np.concatenate([first for first, _ in pairs]).astype(np.uint8),
        "second": np.concatenate([second for _, second in pairs]).astype(np.uint8),
        "offsets": np.cumsum([0, *lengths]).astype(np.uint64),
        "adjusted_mutual_info": np.array([adjusted_mutual_info_score(*pair) for pair in pairs]),
        "adjusted_rand": np.array([adjusted_rand_score(*pair) for pair in pairs]),
    }


# ---------------------------------------------------------------- Isomap


def fit_isomap(points: NDArray, n_neighbors: int) -> Isomap:
    """Isomap with every frame a landmark, on a graph that leaves nothing to chance."""
    isomap = Isomap(n_neighbors=n_neighbors, n_components=N_DIMS, eigen_solver="dense").fit(points)
    assert n_islands(isomap) == 1, "scikit-learn joins islands by other rules than ours"
    # No frame's last neighbour is nearly as far as the next frame, so every correct search finds the
    # same graph.
    distances, _ = isomap.nbrs_.kneighbors(n_neighbors=n_neighbors + 1)
    assert (distances[:, -1] - distances[:, -2]).min() > 1e-6
    return isomap


def graph_with_ties(counts: NDArray, n_neighbors: int) -> tuple[NDArray, csr_array]:
    """Nearest neighbours of whole-number frames, the lower index first among equals.

    Distances between digits are roots of whole numbers, and many are equal. scikit-learn's own search
    lets ties fall by accident, even by the number of threads (the largest eigenvalue moves by 4e-3), so
    it is given this graph instead. The graph holds every frame as its own first neighbour, as
    scikit-learn wants it.
    """
    norms = (counts**2).sum(axis=1)
    squared = norms[:, None] + norms - 2 * counts @ counts.T
    indices = np.argsort(squared, axis=1, kind="stable")[:, : n_neighbors + 1]
    n_frames = len(counts)
    assert (indices[:, 0] == np.arange(n_frames)).all(), "two frames are equal"
    distances = np.sqrt(np.take_along_axis(squared, indices, axis=1).astype(np.float64))
    starts = np.arange(n_frames + 1) * (n_neighbors + 1)
    graph = csr_array((distances.ravel(), indices.ravel(), starts), shape=(n_frames, n_frames))
    return indices[:, 1:], graph


def n_islands(isomap: Isomap) -> int:
    return connected_components(isomap.nbrs_.kneighbors_graph(), directed=False)[0]


def isomap_arrays(points: NDArray, isomap: Isomap) -> Arrays:
    return {
        "points": points,
        "n_neighbors": scalar(isomap.n_neighbors),
        "n_edges": scalar(n_edges(isomap)),
        "eigenvalues": isomap.kernel_pca_.eigenvalues_[:5],
        "residual_variances": residual_variances(isomap.dist_matrix_, isomap.embedding_),
    }


def n_edges(isomap: Isomap) -> int:
    """Edges of the undirected neighbour graph: the union of both directions."""
    directed = isomap.nbrs_.kneighbors_graph()
    return int(directed.maximum(directed.T).nnz) // 2


def residual_variances(geodesics: NDArray, coordinates: NDArray) -> NDArray:
    geodesics = squareform(geodesics, checks=False)
    return np.array(
        [
            1 - np.corrcoef(geodesics, pdist(coordinates[:, :n_dims]))[0, 1] ** 2
            for n_dims in range(1, N_DIMS + 1)
        ]
    )


def out_of_sample(reference: NDArray, new: NDArray, n_neighbors: int) -> Arrays:
    """Isomap of `reference`, and `new` placed in it by scikit-learn's `transform`.

    Our own formula, e(p) = c - P δ(p), is computed beside it in numpy. Here they agree to 4e-15 of
    the largest coordinate; likewise reference frames embedded as if new, against their own
    coordinates, at 4e-15.
    """
    isomap = fit_isomap(reference, n_neighbors)
    in_sample, signs = positive(isomap.embedding_[:, :3])
    embedded = isomap.transform(new)[:, :3] * signs

    squared_geodesics = isomap.dist_matrix_**2
    eigenvalues = isomap.kernel_pca_.eigenvalues_[:3]
    # In-sample coordinates are √λ_k V_ik, so P = ½ Λ^(-½) Vᵀ is half of them over λ.
    projection = (in_sample / eigenvalues / 2).T
    offset = projection @ squared_geodesics.mean(axis=0)

    def embed(frames: NDArray) -> NDArray:
        distances, indices = isomap.nbrs_.kneighbors(frames)
        geodesics = (distances[:, :, None] + isomap.dist_matrix_[indices]).min(axis=1)
        return offset - geodesics**2 @ projection.T

    scale = np.abs(in_sample).max()
    assert np.abs(embed(new) - embedded).max() < 1e-13 * scale
    assert np.abs(embed(reference) - in_sample).max() < 1e-13 * scale
    return {
        "n_frames": scalar(len(reference)),
        "eigenvalues": eigenvalues,
        "coordinates": embedded,
    }


def landmarks(isomap: Isomap, n_landmarks: int) -> Arrays:
    """Landmark MDS over the geodesics of `isomap`.

    scikit-learn has none, but its kernel PCA is the same thing: fitted on the landmarks' block of
    -½ D, it transforms the other frames' rows by Bengio et al. 2004, equation (2).
    """
    n_frames = len(isomap.dist_matrix_)
    indices = np.sort(np.random.default_rng(0).choice(n_frames, n_landmarks, replace=False))
    kernel = -0.5 * isomap.dist_matrix_[:, indices] ** 2
    mds = KernelPCA(3, kernel="precomputed", eigen_solver="dense").fit(kernel[indices])
    in_sample, signs = positive(mds.transform(kernel[indices]))
    coordinates = mds.transform(kernel) * signs
    assert np.abs(in_sample.mean(axis=0)).max() < 1e-12 * np.abs(in_sample).max()
    return {
        "indices": indices.astype(np.uint64),
        "eigenvalues": mds.eigenvalues_,
        "coordinates": coordinates,
    }


# ---------------------------------------------------------------- mixtures


def best_mixture(points: NDArray, n_kinds: int) -> GaussianMixture:
    """The likeliest of ten seeded starts, with scikit-learn's covariance floor of 1e-6."""
    return GaussianMixture(n_kinds, n_init=10, tol=1e-9, max_iter=5000, random_state=0).fit(points)


def mixture_against_labels(coordinates: NDArray, labels: NDArray) -> Arrays:
    """Ten kinds of digits, compared with what the digits are. Our own starts differ, so this is a
    level to reach and not a number to hit."""
    coordinates = coordinates.astype(np.float64)
    mixture = best_mixture(coordinates, n_kinds=10)
    kinds = mixture.predict(coordinates)
    return {
        "kinds": kinds.astype(np.uint8),
        "log_likelihood": scalar(total_log_likelihood(mixture, coordinates)),
        "adjusted_rand": scalar(adjusted_rand_score(labels, kinds)),
        "normalized_mutual_info": scalar(normalized_mutual_info_score(labels, kinds)),
    }


def mixtures_from_start(name: str, points: NDArray, n_kinds: int) -> Arrays:
    """A mixture of each shape: full under `name`, the others beside it."""
    shapes = {name: "full"} | {f"{name}_{kind}": kind for kind in ("tied", "diag", "spherical")}
    arrays = {}
    for prefix, covariance_type in shapes.items():
        arrays |= prefixed(prefix, mixture_from_start(points, n_kinds, covariance_type))
    return arrays


def mixture_from_start(points: NDArray, n_kinds: int, covariance_type: str) -> Arrays:
    """EM from a stated start to its fixpoint, without a covariance floor: deterministic.

    The start is the mixture whose responsibilities are k-means' labels, 1 or 0, with covariances of
    the shape. They are written as one full matrix for each kind, whatever the shape.
    `log_likelihoods[i]` belongs to the parameters after i steps; `log_likelihood` and `bic` to the
    final ones.
    """
    points = points.astype(np.float64)
    kinds = KMeans(n_kinds, n_init=10, random_state=0).fit_predict(points)
    start = hard_mixture(points, kinds, covariance_type)
    mixture = GaussianMixture(
        n_kinds,
        covariance_type=covariance_type,
        reg_covar=0,
        tol=1e-12,
        max_iter=5000,
        weights_init=start["weights"],
        means_init=start["means"],
        precisions_init=own_form(np.linalg.inv(start["covariances"]), covariance_type),
    ).fit(points)
    assert mixture.converged_
    return {
        **prefixed("start", start),
        "weights": mixture.weights_,
        "means": mixture.means_,
        "covariances": full_matrices(mixture),
        "log_likelihoods": np.array(mixture.lower_bounds_[:10]) * len(points),
        "log_likelihood": scalar(total_log_likelihood(mixture, points)),
        "bic": scalar(float(mixture.bic(points))),
    }


def dirichlet_from_start(points: NDArray, n_kinds: int) -> Arrays:
    """A Dirichlet process from a stated start to its fixpoint, without a covariance floor.

    The start is k-means' labels. The steps are scikit-learn's own, called one by one: between them
    kinds are put in falling order of frames, which its stick depends on and `fit` has no way to do.
    `lower_bounds[i]` belongs to what is believed after i + 1 maximisations and lacks constants.
    """
    kinds = KMeans(n_kinds, n_init=10, random_state=0).fit_predict(points)
    mixture = BayesianGaussianMixture(
        n_components=n_kinds,
        covariance_type="full",
        weight_concentration_prior_type="dirichlet_process",
        weight_concentration_prior=1.0,
        mean_precision_prior=1.0,
        mean_prior=points.mean(axis=0),
        degrees_of_freedom_prior=points.shape[1],
        covariance_prior=np.cov(points.T, bias=True),
        reg_covar=0,
    )
    mixture._check_parameters(points)
    with np.errstate(divide="ignore"):
        log_responsibilities = np.log(np.eye(n_kinds)[kinds])
    lower_bounds = [-np.inf, lower_bound_after_step(mixture, points, log_responsibilities)]
    while lower_bounds[-1] - lower_bounds[-2] > 1e-12 * abs(lower_bounds[-1]):
        _, log_responsibilities = mixture._e_step(points)
        lower_bounds.append(lower_bound_after_step(mixture, points, log_responsibilities))
    # Works out the expected weights.
    mixture._set_parameters(mixture._get_parameters())
    return {
        "kinds": kinds.astype(np.uint8),
        "lower_bounds": np.array(lower_bounds[1:31]),
        "n_frames": mixture.weight_concentration_[0] - 1,
        "weights": mixture.weights_,
        "means": mixture.means_,
        "covariances": mixture.covariances_,
    }


def lower_bound_after_step(
    mixture: BayesianGaussianMixture, points: NDArray, log_responsibilities: NDArray
) -> float:
    n_frames = np.exp(log_responsibilities).sum(axis=0)
    ordered = log_responsibilities[:, np.argsort(-n_frames, kind="stable")]
    mixture._m_step(points, ordered)
    # 0 ln 0 is 0, which floating-point numbers do not know.
    return float(mixture._compute_lower_bound(np.maximum(ordered, -700.0), None))


def hard_mixture(points: NDArray, kinds: NDArray, covariance_type: str) -> Arrays:
    members = [points[kinds == kind] for kind in range(kinds.max() + 1)]
    weights = np.array([len(m) / len(points) for m in members])
    scatters = np.array([np.cov(m.T, bias=True) for m in members])
    unit = np.eye(points.shape[1])
    if covariance_type == "tied":
        within = np.einsum("k,kij->ij", weights, scatters)
        scatters = np.array([within for _ in members])
    elif covariance_type == "diag":
        scatters = scatters * unit
    elif covariance_type == "spherical":
        scatters = np.array([np.trace(s) / len(unit) * unit for s in scatters])
    means = np.array([m.mean(axis=0) for m in members])
    return {"weights": weights, "means": means, "covariances": scatters}


def own_form(matrices: NDArray, covariance_type: str) -> NDArray:
    """One full matrix for each kind as scikit-learn wants a shape's."""
    if covariance_type == "tied":
        return matrices[0]
    if covariance_type == "diag":
        return np.diagonal(matrices, axis1=1, axis2=2).copy()
    if covariance_type == "spherical":
        return matrices[:, 0, 0].copy()
    return matrices


def full_matrices(mixture: GaussianMixture) -> NDArray:
    """The covariances of a shape as one full matrix for each kind."""
    n_kinds, n_dims = mixture.means_.shape
    covariances = mixture.covariances_
    if mixture.covariance_type == "tied":
        return np.array([covariances for _ in range(n_kinds)])
    if mixture.covariance_type == "diag":
        return np.array([np.diag(c) for c in covariances])
    if mixture.covariance_type == "spherical":
        return np.array([c * np.eye(n_dims) for c in covariances])
    return covariances


def total_log_likelihood(mixture: GaussianMixture, points: NDArray) -> float:
    return float(mixture.score_samples(points).sum())


# ---------------------------------------------------------------- pairs of labellings


def degenerate_pairs() -> list[tuple[NDArray, NDArray]]:
    alternating = np.arange(60) % 3
    one_kind = np.zeros(60, dtype=int)
    all_different = np.arange(60)
    return [
        (alternating, alternating),
        (alternating, (alternating + 1) % 3),  # the same but for names
        (alternating, alternating * 100),  # names with gaps
        (one_kind, one_kind),
        (one_kind, alternating),
        (alternating, one_kind),
        (all_different, all_different),
        (all_different, one_kind),
        (all_different, alternating),
        (alternating, np.arange(60) // 20),  # independent to the last frame
        (np.array([0]), np.array([0])),
        (np.array([0, 1]), np.array([0, 0])),
        (np.array([0, 1]), np.array([1, 0])),
    ]


def random_pairs(n_pairs: int) -> list[tuple[NDArray, NDArray]]:
    """From independent to nearly identical, 3 to 1500 frames, 2 to 20 kinds, uneven shares."""
    random = np.random.default_rng(0)
    pairs = []
    for i in range(n_pairs):
        n_frames = int(np.round(3 * 500 ** (i / (n_pairs - 1))))
        n_kinds = random.integers(2, 21, size=2)
        first = random.choice(n_kinds[0], n_frames, p=random.dirichlet(np.ones(n_kinds[0])))
        second = random.choice(n_kinds[1], n_frames, p=random.dirichlet(np.ones(n_kinds[1])))
        share_copied = (0.0, 0.3, 0.7, 0.95)[i % 4]
        second = np.where(random.random(n_frames) < share_copied, first, second)
        pairs.append((first, second))
    return pairs


# ---------------------------------------------------------------- arrays


def positive(columns: NDArray) -> tuple[NDArray, NDArray]:
    """The columns with their entry of largest magnitude made positive, and the signs that did it."""
    largest = columns[np.abs(columns).argmax(axis=0), np.arange(columns.shape[1])]
    signs = np.sign(largest)
    return columns * signs, signs


def scalar(value: float | int) -> NDArray:
    """One value as an array of shape (1,): u64 for counts, f64 for measures."""
    return np.array([value], dtype=np.uint64 if isinstance(value, int) else np.float64)


def prefixed(prefix: str, arrays: Arrays) -> Arrays:
    return {f"{prefix}/{key}": value for key, value in arrays.items()}


if __name__ == "__main__":
    main()
