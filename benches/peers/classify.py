"""Classifies the same frames by scikit-learn, by faiss and by `cargo bench --bench classify`, in turn, and prints the ratios.

    python -m venv peers && peers/bin/pip install -r benches/peers/requirements.txt
    peers/bin/python benches/peers/classify.py [--rounds 3] [--sensors ring camera] [--frames 2000]

What each does with one frame on one core:
- ours: maps raw counts, finds the 10 nearest of the reference frames, embeds the frame, and tells the probabilities of 8 kinds;
- scikit-learn: `Isomap.transform`, then `GaussianMixture.predict_proba`, of frames that were mapped beforehand, as float32. Also of 30 frames
  at once, by the frame: what it is made for;
- faiss: the 10 nearest alone, by `IndexFlatL2`, of frames that were mapped beforehand, as float32. Its distances are rounded.

The times are medians over frames of a trip that none of the reference frames are of. Each peer is warm, and asked from this process;
scikit-learn's time has that of its Python in it, which for 16 readings is most of it.
"""

import argparse
import os
import re
import statistics
import subprocess
import time
from pathlib import Path

import faiss
import numpy
from sklearn.manifold import Isomap
from sklearn.mixture import GaussianMixture
from threadpoolctl import threadpool_limits

REPOSITORY = Path(__file__).resolve().parents[2]
FOLDER = Path(os.environ.get("KINDS_BENCH_FOLDER", REPOSITORY / "target" / "tmp" / "classify"))
N_NEIGHBORS = 10
N_DIMS = {"ring": 8, "camera": 15}
N_KINDS = 8
COVARIANCE_FLOOR = 1e-3
N_BATCH = 30
N_QUERIES = {"scikit-learn": 20, "faiss": 60}


def ours(sensor, n_frames):
    """Median and 99.9th percentile of a frame, µs."""
    command = ["cargo", "bench", "--quiet", "--bench", "classify", "--", sensor, str(n_frames)]
    environment = dict(os.environ, KINDS_BENCH_FOLDER=str(FOLDER))
    printed = subprocess.run(
        command, check=True, stdout=subprocess.PIPE, text=True, cwd=REPOSITORY, env=environment
    ).stdout
    row = re.search(rf"^ +{n_frames} +([\d.]+) +([\d.]+) ", printed, re.MULTILINE)
    return float(row[1]), float(row[2])


def median_us(work, frames, n_at_once=1):
    """Median time of some frames, by the frame, µs."""
    taken = []
    for begin in range(0, len(frames) - n_at_once + 1, n_at_once):
        some = frames[begin : begin + n_at_once]
        began = time.perf_counter()
        work(some)
        taken.append((time.perf_counter() - began) * 1e6 / n_at_once)
    return statistics.median(taken)


def compare(sensor, n_frames, n_rounds):
    of_ours = [ours(sensor, n_frames)]
    response = numpy.load(FOLDER / f"{sensor}-response.npy").astype(numpy.float32)
    frames = response[numpy.load(FOLDER / f"{sensor}-frames-{n_frames}.npy")]
    queries = response[numpy.load(FOLDER / f"{sensor}-queries-800.npy")]
    queries = queries[:: len(queries) // (N_BATCH * 2)]
    with threadpool_limits(1):
        faiss.omp_set_num_threads(1)
        isomap = Isomap(n_neighbors=N_NEIGHBORS, n_components=N_DIMS[sensor], eigen_solver="arpack")
        places = isomap.fit_transform(frames).astype(numpy.float64)
        # Its own floor is absolute, and nothing beside coordinates in counts; ours is this share of the mean variance.
        floor = COVARIANCE_FLOOR * places.var(axis=0).mean()
        mixture = GaussianMixture(N_KINDS, reg_covar=floor, random_state=0).fit(places)
        index = faiss.IndexFlatL2(frames.shape[1])
        index.add(frames)
        ways = {
            "scikit-learn, one frame": lambda: median_us(
                lambda some: mixture.predict_proba(isomap.transform(some)), queries[: N_QUERIES["scikit-learn"]]
            ),
            f"scikit-learn, {N_BATCH} frames": lambda: median_us(
                lambda some: mixture.predict_proba(isomap.transform(some)), queries, N_BATCH
            ),
            "faiss, nearest alone": lambda: median_us(
                lambda some: index.search(some, N_NEIGHBORS), queries[: N_QUERIES["faiss"]]
            ),
        }
        taken = {name: [] for name in ways}
        for round in range(n_rounds + 1):
            for name, way in ways.items():
                taken[name].append(way())
            if round < n_rounds:
                of_ours.append(ours(sensor, n_frames))
    # The first round warms up.
    of_ours = of_ours[1:]
    medians = [p50 for p50, _ in of_ours]
    print(f"\n{sensor}, {n_frames} reference frames; {n_rounds} rounds: median (least … greatest)\n")
    print("| | µs a frame | ratio to ours |\n|---|---|---|")
    print(f"| ours, p50 | {spread(medians)} | |")
    print(f"| ours, p99.9 | {spread([p999 for _, p999 in of_ours])} | |")
    for name, values in taken.items():
        ratios = [value / our for value, our in zip(values[1:], medians)]
        print(f"| {name} | {spread(values[1:])} | {spread(ratios)} |", flush=True)


def spread(values):
    low, middle, high = min(values), statistics.median(values), max(values)
    return f"{middle:.1f} ({low:.1f} … {high:.1f})"


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--rounds", type=int, default=3)
    parser.add_argument("--sensors", nargs="+", choices=list(N_DIMS), default=list(N_DIMS))
    parser.add_argument("--frames", nargs="+", type=int, default=[2000])
    arguments = parser.parse_args()
    for sensor in arguments.sensors:
        for n_frames in arguments.frames:
            compare(sensor, n_frames, arguments.rounds)


if __name__ == "__main__":
    main()
