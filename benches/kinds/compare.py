"""Compares our kinds with those that others would find: how consistent are they on a second trip through the same place?

    cargo build --release
    python -m venv target/kinds-venv && target/kinds-venv/bin/pip install -r benches/kinds/requirements.txt
    target/kinds-venv/bin/python benches/kinds/compare.py [--seeds 5] [--simulate crunch chew] \
        [--pair NAME TRIP1 TRIP2 RADIUS_M]... [--output target/kinds]

Each pair of trips is learnt from the first and judged on both:
- ours: `kinds train TRIP1 --seed S` and nothing else; filtered kinds, as reports have them, and those of each frame by itself;
- ours with `--response inverse`: on one scale, whatever the trip, filtered;
- Isomap and PCA by scikit-learn on ranges, with its GaussianMixture, of as many dimensions and kinds as our first model has; out of
  sample by their `transform`;
- k-means by scikit-learn on ranges, of as many kinds.

`kappa` and AMI are those of `kinds evaluate`: a frame is consistent if over half of the second trip's frames within the radius have
its kind; chance is the second trip's kinds shifted in time; AMI is between a frame's kind and that of the nearest frame of the
second trip. They are medians over seeds, with the least and the greatest; `blocks` is the interval that 95 % of resampled blocks of
the first trip give kappa at the first seed. Switches are of the second trip, by the second. One table for each pair, all of it as
kinds.json, and kinds.svg with kappa and AMI.
"""

import argparse
import csv
import json
import os
import signal
import statistics
import subprocess
import tempfile
from pathlib import Path

import matplotlib
import numpy
from rosbags.highlevel import AnyReader
from rosbags.typesys import Stores, get_typestore
from sklearn.cluster import KMeans
from sklearn.decomposition import PCA
from sklearn.manifold import Isomap
from sklearn.metrics import adjusted_mutual_info_score
from sklearn.mixture import GaussianMixture
from sklearn.neighbors import KDTree
from threadpoolctl import threadpool_limits

matplotlib.use("svg")
from matplotlib import pyplot  # noqa: E402  (after the choice of what draws)

REPOSITORY = Path(__file__).resolve().parents[2]
KINDS = REPOSITORY / "target" / "release" / "kinds"
SHARE = 0.5
N_SHIFTS = 60
N_BLOCKS = 20
N_RESAMPLES = 200
N_FRAMES_ISOMAP_MAX = 2500
"""Frames that scikit-learn's Isomap is given of a camera's trip, evenly spaced: it holds all of their distances."""
SIMULATED = {
    "crunch": [("fourth-floor", 0), ("fifth-floor", 0), ("fourth-floor", 1), ("fifth-floor", 1)],
    "chew": [(None, 0), (None, 1)],
}
RADIUS_M = {"crunch": 0.5, "chew": 0.75}


class Trip:
    """Frames as ranges in metres, and where each was taken.

    Ranges have the shape ``(n_frames, n_readings)``, infinite where there was none; places ``(n_frames, 2)``, metres; times seconds.
    """

    def __init__(self, path):
        self.path = Path(path)
        frames, times, poses, pose_times = [], [], [], []
        with AnyReader([self.path], default_typestore=get_typestore(Stores.ROS2_HUMBLE)) as reader:
            topics = {connection.topic for connection in reader.connections}
            poses_topic = "/ground_truth" if "/ground_truth" in topics else None
            for connection, _, raw in reader.messages():
                name = connection.msgtype.rsplit("/", 1)[-1]
                is_pose = connection.topic == poses_topic if poses_topic else name in ("Odometry", "PoseStamped")
                if not is_pose and name not in ("LaserScan", "Image"):
                    continue
                message = reader.deserialize(raw, connection.msgtype)
                at = message.header.stamp.sec + message.header.stamp.nanosec * 1e-9
                if is_pose:
                    pose = message.pose.pose if name == "Odometry" else message.pose
                    poses.append((pose.position.x, pose.position.y))
                    pose_times.append(at)
                else:
                    frames.append(ranges_of(message, name))
                    times.append(at)
        order = numpy.argsort(pose_times, kind="stable")
        pose_times, poses = numpy.array(pose_times)[order], numpy.array(poses)[order]
        self.ranges, self.times = numpy.array(frames, numpy.float32), numpy.array(times)
        self.places = numpy.stack([numpy.interp(times, pose_times, poses[:, axis]) for axis in (0, 1)], 1)

    def plain(self, range_m_max):
        """Ranges with the farthest where there was none."""
        return numpy.minimum(numpy.where(numpy.isfinite(self.ranges), self.ranges, range_m_max), range_m_max)


def ranges_of(message, name):
    if name == "LaserScan":
        ranges = numpy.array(message.ranges, numpy.float32)
        return numpy.where(numpy.isfinite(ranges), ranges, numpy.inf)
    if message.encoding == "32FC1":
        ranges = message.data.view(numpy.float32)
        return numpy.where(numpy.isfinite(ranges), ranges, numpy.inf)
    counts = message.data.view(numpy.uint16)
    return numpy.where((counts == 0) | (counts == 65535), numpy.inf, counts * 1e-3).astype(numpy.float32)


class Revisits:
    """Which frames of a second trip are near each frame of a first one."""

    def __init__(self, first, second, radius_m):
        tree = KDTree(second.places)
        near = tree.query_radius(first.places, radius_m)
        self.revisited = numpy.array([index for index, frames in enumerate(near) if len(frames)])
        self.near = numpy.concatenate([near[index] for index in self.revisited])
        counts = [len(near[index]) for index in self.revisited]
        self.of = numpy.repeat(numpy.arange(len(self.revisited)), counts)
        self.n_near = numpy.array(counts)
        self.nearest = tree.query(first.places[self.revisited], 1)[1][:, 0]

    def consistent(self, kinds, others):
        """Whether each revisited frame is."""
        same = others[self.near] == kinds[self.revisited][self.of]
        return numpy.bincount(self.of, same, len(self.revisited)) / self.n_near > SHARE

    def kappa(self, kinds, others):
        """Kappa, and the 95 % interval over blocks."""
        shifts = numpy.linspace(0, len(others), N_SHIFTS + 2)[1:-1].astype(int)
        consistent = self.consistent(kinds, others)
        by_chance = numpy.mean([self.consistent(kinds, numpy.roll(others, shift)) for shift in shifts], 0)
        blocks = numpy.array_split(numpy.arange(len(consistent)), N_BLOCKS)
        random = numpy.random.default_rng(0)

        def of(indices):
            share, chance = consistent[indices].mean(), by_chance[indices].mean()
            return (share - chance) / (1 - chance) if chance < 1 else 0.0

        picks = [random.integers(0, len(blocks), len(blocks)) for _ in range(N_RESAMPLES)]
        resampled = [of(numpy.concatenate([blocks[block] for block in pick])) for pick in picks]
        return of(numpy.arange(len(consistent))), numpy.quantile(resampled, [0.025, 0.975])

    def score(self, kinds, others, times):
        """All that is told of one labelling."""
        kappa, interval = self.kappa(kinds, others)
        largest = max(numpy.bincount(trip).max() / len(trip) for trip in (kinds, others))
        return {
            "kappa": float(kappa),
            "blocks": [float(end) for end in interval],
            "ami": float(adjusted_mutual_info_score(kinds[self.revisited], others[self.nearest])),
            "largest": float(largest),
            "switches": float((numpy.diff(others) != 0).sum() / (times[-1] - times[0])),
        }


def ours(trips, seed, folder, *more):
    """Filtered kinds and those of each frame by itself for both trips, and the model's numbers."""
    model = folder / "model.kinds"
    run("train", trips[0].path, "--seed", str(seed), "--output", model, *more)
    manifest = json.loads(run("inspect", model, "--json"))
    filtered, by_itself = [], []
    for trip in trips:
        table = folder / "kinds.csv"
        run("replay", trip.path, "--model", model, "--bless", table)
        with open(table, newline="") as file:
            rows = list(csv.DictReader(file))
        assert len(rows) == len(trip.times), "a report for each frame"
        filtered.append(numpy.array([int(row["filtered_kind"]) for row in rows]))
        by_itself.append(numpy.array([int(row["kind"]) for row in rows]))
    return filtered, by_itself, manifest


def theirs(trips, n_dims, n_kinds, range_m_max, seed):
    """Kinds of both trips by each of the others."""
    first, second = (trip.plain(range_m_max) for trip in trips)
    step = max(1, -(-len(first) // N_FRAMES_ISOMAP_MAX))
    found = {}
    embeddings = {
        "Isomap": (Isomap(n_neighbors=12, n_components=n_dims), first[::step]),
        "PCA": (PCA(n_dims, random_state=seed), first),
    }
    for name, (embedding, learnt) in embeddings.items():
        embedding.fit(learnt)
        places = [embedding.transform(frames) for frames in (first, second)]
        floor = 1e-3 * places[0].var(0).mean()
        mixture = GaussianMixture(n_kinds, n_init=5, random_state=seed, reg_covar=floor).fit(places[0])
        found[f"scikit-learn {name}, mixture"] = [mixture.predict(place) for place in places]
    means = KMeans(n_kinds, n_init=5, random_state=seed).fit(first)
    found["scikit-learn k-means"] = [means.predict(frames) for frames in (first, second)]
    return found


def compare(name, paths, radius_m, n_seeds, folder):
    """Prints a table, and returns its rows."""
    trips = [Trip(path) for path in paths]
    revisits = Revisits(*trips, radius_m)
    scores, sizes = {}, []
    for seed in range(n_seeds):
        filtered, by_itself, manifest = ours(trips, seed, folder)
        found = {"ours": filtered, "ours, each frame by itself": by_itself}
        found["ours, --response inverse"], _, _ = ours(trips, seed, folder, "--response", "inverse")
        n_dims, n_kinds = manifest["n_dims"], manifest["n_kinds"]
        sizes.append((n_dims, n_kinds))
        range_m_max = manifest["plan"]["response"]["range_m_max"]
        found.update(theirs(trips, n_dims, n_kinds, range_m_max, seed))
        for method, kinds in found.items():
            scores.setdefault(method, []).append(revisits.score(*kinds, trips[1].times))
    n_kinds = statistics.median_low(n_kinds for _, n_kinds in sizes)
    print(f"\n**{name}**: {n_seeds} seeds, {n_kinds} kinds in {sizes[0][0]} dimensions\n")
    print("| | κ | 95 % over blocks | AMI | largest kind | switches a second |\n|---|---|---|---|---|---|")
    rows = []
    for method, of_seeds in scores.items():
        row = {"pair": name, "method": method, "sizes": sizes, "seeds": of_seeds}
        rows.append(row)
        kappa, ami = (told(of_seeds, what) for what in ("kappa", "ami"))
        low, high = of_seeds[0]["blocks"]
        largest, switches = (statistics.median(seed[what] for seed in of_seeds) for what in ("largest", "switches"))
        print(f"| {method} | {kappa} | {low:.2f} … {high:.2f} | {ami} | {largest:.0%} | {switches:.2f} |", flush=True)
    return rows


def told(of_seeds, what):
    values = [seed[what] for seed in of_seeds]
    return f"{statistics.median(values):.2f} ({min(values):.2f} … {max(values):.2f})"


def draw(rows, path):
    """κ and AMI of each method on each pair: the median, and a line from the least to the greatest."""
    pairs, methods = (list(dict.fromkeys(row[key] for row in rows)) for key in ("pair", "method"))
    figure, sides = pyplot.subplots(1, 2, sharey=True, figsize=(9, 1.2 + 0.9 * len(pairs)))
    for side, what, title in zip(sides, ("kappa", "ami"), ("κ", "AMI")):
        for row in rows:
            values = [seed[what] for seed in row["seeds"]]
            method = methods.index(row["method"])
            height = -pairs.index(row["pair"]) - 0.15 * (method - (len(methods) - 1) / 2)
            side.plot([min(values), max(values)], [height, height], color=f"C{method}", linewidth=2)
            label = row["method"] if row["pair"] == pairs[0] else None
            side.plot(statistics.median(values), height, "o", color=f"C{method}", label=label)
        side.set_xlabel(title)
        side.set_xlim(-0.1, 1.02)
        side.grid(axis="x", alpha=0.3)
    sides[0].set_yticks([-index for index in range(len(pairs))], pairs)
    figure.legend(*sides[0].get_legend_handles_labels(), loc="upper center", ncols=3, frameon=False)
    figure.tight_layout(rect=(0, 0, 1, 1 - 0.6 / figure.get_figheight()))
    # Without a date: the same numbers are the same file.
    figure.savefig(path, metadata={"Date": None})


def run(*arguments):
    finished = subprocess.run([KINDS, *arguments], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    if finished.returncode != 0:
        raise SystemExit(f"kinds {arguments[0]} failed: {finished.stderr.strip()}")
    return finished.stdout


def drive(robot, world, seed, trip, path):
    """Records a simulated trip, unless it is there already."""
    if path.exists():
        return path
    with tempfile.TemporaryDirectory(prefix="k") as domain:
        environment = dict(os.environ, KINDS_DOMAIN=domain)
        sensor = ["--sensor", "bench/frames"]
        recorder = subprocess.Popen([KINDS, "record", *sensor, "--output", path], env=environment)
        simulation = ["--simulate", robot, "--trip", str(trip), "--seed", str(seed), "--speed", "20"]
        simulation += ["--world", world] if world else []
        subprocess.run([KINDS, "publish", *sensor, *simulation], env=environment, check=True)
        recorder.send_signal(signal.SIGINT)
        if recorder.wait() != 0:
            raise SystemExit(f"{path} could not be recorded")
    return path


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--seeds", type=int, default=5)
    parser.add_argument("--simulate", nargs="*", choices=SIMULATED, default=[])
    parser.add_argument("--pair", nargs=4, action="append", default=[], metavar=("NAME", "TRIP1", "TRIP2", "RADIUS_M"))
    parser.add_argument("--output", type=Path, default=REPOSITORY / "target" / "kinds")
    arguments = parser.parse_args()
    arguments.output.mkdir(parents=True, exist_ok=True)
    pairs = [(name, [first, second], float(radius_m)) for name, first, second, radius_m in arguments.pair]
    for robot in arguments.simulate:
        for world, seed in SIMULATED[robot]:
            name = f"{robot} {world or 'campus'} {seed}"
            path = lambda trip: arguments.output / f"{name.replace(' ', '-')}-{trip}.mcap"
            pairs.append((name, [drive(robot, world, seed, trip, path(trip)) for trip in (1, 2)], RADIUS_M[robot]))
    if not pairs:
        parser.error("no trips: give --pair or --simulate")
    rows = []
    with tempfile.TemporaryDirectory() as folder, threadpool_limits(2):
        for name, paths, radius_m in pairs:
            rows += compare(name, paths, radius_m, arguments.seeds, Path(folder))
    (arguments.output / "kinds.json").write_text(json.dumps(rows, indent=1))
    draw(rows, arguments.output / "kinds.svg")


if __name__ == "__main__":
    main()
