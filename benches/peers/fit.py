"""Fits the same frames by scikit-learn and by `cargo bench --bench fit`, in turn, and prints the ratios.

    python -m venv peers && peers/bin/pip install -r benches/peers/requirements.txt
    peers/bin/python benches/peers/fit.py [--rounds 3] [--parts isomap mixture] [--folder DIR]

Each measurement is a process of its own, so that each has its own peak of memory, and reads its data before the clock starts. Beside the time
stands what all processors spent: on a machine with other work, the ratio of these is what can be trusted. Sizes come from the environment
as the bench says (`KINDS_BENCH_FRAMES`, `KINDS_BENCH_POINTS`).

What favours whom: scikit-learn gets frames as float32, mapped to the response's scale beforehand, and its own threads on all cores. Its Isomap
is timed with the eigensolver that it chooses and with ARPACK, and the better counts. Ours also maps the frames, computes 30 dimensions instead of
15 and their residual variance, and one kind. For mixtures scikit-learn keeps its tolerance of 1e-3 nats per frame, ours goes on to 1e-7; it adds to every
covariance what is the least eigenvalue of ours.
"""

import argparse
import json
import os
import re
import resource
import statistics
import subprocess
import sys
import time
from pathlib import Path

REPOSITORY = Path(__file__).resolve().parents[2]
N_NEIGHBORS = 12
N_DIMS = 15
N_KINDS_MAX = 20
N_STARTS = 5
COVARIANCE_FLOOR = 1e-3
SOLVERS = ["auto", "arpack"]


def size(name, usual):
    return int(os.environ.get(name, usual))


N_FRAMES = size("KINDS_BENCH_FRAMES", 6000)
N_TRAINED = size("KINDS_BENCH_TRAINED", 2000)
N_POINTS = size("KINDS_BENCH_POINTS", 20000)


def peer_isomap(folder, solver):
    """scikit-learn's full Isomap; there is none of landmarks."""
    import numpy
    from scipy.spatial.distance import pdist, squareform
    from sklearn.manifold import Isomap

    response = numpy.load(folder / "response.npy").astype(numpy.float32)
    frames = response[numpy.load(folder / "frames.npy", mmap_mode="r")[:N_FRAMES]]
    isomap = Isomap(n_neighbors=N_NEIGHBORS, n_components=N_DIMS, eigen_solver=solver, n_jobs=-1)
    clock = Clock()
    embedded = isomap.fit_transform(frames)
    taken = clock.taken()
    pairs = numpy.triu_indices(N_FRAMES, 1)
    geodesics = isomap.dist_matrix_[pairs]
    residual = [1 - numpy.corrcoef(geodesics, pdist(embedded[:, :d]))[0, 1] ** 2 for d in range(1, N_DIMS + 1)]
    eigenvalues = isomap.kernel_pca_.eigenvalues_.tolist()
    return taken | {"eigenvalues": eigenvalues, "residual variance": residual}


def peer_mixture(folder, _):
    import numpy
    from sklearn.mixture import GaussianMixture

    places = numpy.load(folder / "coordinates.npy")
    floor = COVARIANCE_FLOOR * places.var(axis=0).mean()
    log_likelihoods = []
    clock = Clock()
    for n_kinds in range(1, N_KINDS_MAX + 1):
        mixture = GaussianMixture(n_kinds, n_init=N_STARTS, reg_covar=floor, max_iter=1000, random_state=0)
        log_likelihoods.append(mixture.fit(places).score(places) * len(places))
    return clock.taken() | {"log-likelihoods": log_likelihoods}


class Clock:
    """What work takes from here on, and the most memory that this process has held."""

    def __init__(self):
        self.began = time.monotonic(), time.process_time()

    def taken(self):
        began, processors_began = self.began
        return {
            "s": time.monotonic() - began,
            "processors": time.process_time() - processors_began,
            "MB": resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024 / 1e6,
        }


def peer(folder, part, argument=""):
    """One measurement of scikit-learn's, in a process of its own."""
    command = [sys.executable, __file__, "--folder", folder, "--one", part, argument]
    return json.loads(subprocess.run(command, check=True, stdout=subprocess.PIPE, text=True).stdout)


def ours(folder, part):
    """One measurement of ours: what the bench prints, by name."""
    command = ["cargo", "bench", "--quiet", "--bench", "fit", "--", part]
    environment = dict(os.environ, KINDS_BENCH_FOLDER=str(folder))
    printed = subprocess.run(
        command, check=True, stdout=subprocess.PIPE, text=True, cwd=REPOSITORY, env=environment
    ).stdout
    values = {}
    for line in printed.splitlines():
        if timed := re.match(r"^ +(Isomap|mixtures) +([\d.]+) s +([\d.]+) s of processors$", line):
            values |= {"s": float(timed[2]), "processors": float(timed[3])}
        elif peak := re.match(r"^ +peak memory +([\d.]+) MB$", line):
            values["MB"] = float(peak[1])
        elif listed := re.match(r"^ +(islands|eigenvalues|residual variance) (\[.*\])$", line):
            values[listed[1]] = json.loads(listed[2])
        elif likely := re.match(r"^ +(\d+) kinds, log-likelihood (\S+) after", line):
            values.setdefault("log-likelihoods", {})[int(likely[1])] = float(likely[2])
    return values


def spread(values):
    low, middle, high = min(values), statistics.median(values), max(values)
    return f"{middle:9.2f} ({low:.2f} … {high:.2f})"


def rows(what, theirs, our):
    """Both sides' spread, and that of the ratios of each round."""
    for key, unit in [("s", "s"), ("processors", "s of processors"), ("MB", "peak MB")]:
        their_values, our_values = [run[key] for run in theirs], [run[key] for run in our]
        ratios = [a / b for a, b in zip(their_values, our_values)]
        print(f"| {what}, {unit} | {spread(their_values)} | {spread(our_values)} | {spread(ratios)} |")


def compare_isomap(folder, n_rounds):
    theirs, full, landmarks = [], [], []
    for _ in range(n_rounds):
        full.append(ours(folder, "full"))
        solved = {solver: peer(folder, "isomap", solver) for solver in SOLVERS}
        print("scikit-learn, seconds by solver:", {name: round(run["s"], 1) for name, run in solved.items()})
        theirs.append(min(solved.values(), key=lambda run: run["processors"]))
        landmarks.append(ours(folder, "landmarks"))
    print(f"\nIsomap of {N_FRAMES} frames, {N_NEIGHBORS} neighbours, {N_DIMS} dimensions; {n_rounds} rounds\n")
    print("| | scikit-learn | ours | ratio |\n|---|---|---|---|")
    for what, our in [("all frames landmarks", full), ("500 landmarks", landmarks)]:
        rows(what, theirs, our)
    their, our = theirs[-1], full[-1]
    print(f"\nislands of the graph: {our['islands']} (where there are several, the two join them differently)")
    differences = [abs(a / b - 1) for a, b in zip(our["eigenvalues"], their["eigenvalues"])]
    print(f"eigenvalues differ by at most {max(differences):.1e} of themselves")
    for name, run in [("ours", our), ("scikit-learn's", their), ("ours, 500 landmarks", landmarks[-1])]:
        chosen = ", ".join(f"{run['residual variance'][d - 1]:.5f}" for d in (1, 2, 5, 10, 15))
        print(f"residual variance in 1, 2, 5, 10, 15 dimensions: {chosen} ({name})")


def compare_mixture(folder, n_rounds):
    our, theirs = [], []
    for _ in range(n_rounds):
        our.append(ours(folder, "mixture"))
        theirs.append(peer(folder, "mixture"))
    print(f"\nMixtures of 1 to {N_KINDS_MAX} kinds, {N_POINTS} × {N_DIMS}, {N_STARTS} starts; {n_rounds} rounds\n")
    print("| | scikit-learn | ours | ratio |\n|---|---|---|---|")
    rows("all", theirs, our)
    print("\n| kinds | scikit-learn's log-likelihood | ours | ours more by |\n|---|---|---|---|")
    for n_kinds, their in enumerate(theirs[-1]["log-likelihoods"], 1):
        found = our[-1]["log-likelihoods"].get(n_kinds)
        print(f"| {n_kinds} | {their:.1f} | " + (f"{found:.1f} | {found - their:+.1f} |" if found else "none | |"))


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    usual = REPOSITORY / "target" / "tmp" / f"fit-{N_FRAMES}-{N_TRAINED}-{N_POINTS}"
    parser.add_argument("--folder", type=Path, default=usual)
    parser.add_argument("--rounds", type=int, default=1)
    parser.add_argument("--parts", nargs="+", choices=["isomap", "mixture"], default=["isomap", "mixture"])
    parser.add_argument("--one", nargs=2, help=argparse.SUPPRESS)
    arguments = parser.parse_args()
    if arguments.one:
        part, argument = arguments.one
        measure = {"isomap": peer_isomap, "mixture": peer_mixture}[part]
        print(json.dumps(measure(arguments.folder, argument)))
        return
    ours(arguments.folder, "nothing")
    for part in arguments.parts:
        {"isomap": compare_isomap, "mixture": compare_mixture}[part](arguments.folder, arguments.rounds)


if __name__ == "__main__":
    main()
