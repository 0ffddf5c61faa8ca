"""What does the median over time do to kinds where readings drop out, and where they do not?

    cargo build --release
    python -m venv target/kinds-venv && target/kinds-venv/bin/pip install -r benches/kinds/requirements.txt
    target/kinds-venv/bin/python benches/kinds/drop_outs.py [--seeds 3] [--percent 0 1 2 4 6 10] \
        --pair NAME TRIP1 TRIP2 RADIUS_M [--pair …]

Of both trips of a pair so many of the readings are spoilt, each by itself: they are *missing*, or *nearer*, at a place between the
sensor and what is there. A model is learnt from the first with `--median 1`, and one with `--median 3`; filtered kinds are judged as
compare.py judges them. A row for each share, medians over seeds (of spoiling and of training). `alone` is the share of readings of the
first trip that stand alone in time, as trainer/src/drop_outs.rs has it, `by default` for how many seeds `kinds train` takes the median
unasked.
"""

import argparse
import statistics
import tempfile
from pathlib import Path

import numpy
from rosbags.highlevel import AnyReader
from rosbags.rosbag2 import StoragePlugin, Writer
from rosbags.typesys import Stores, get_typestore

from compare import Revisits, Trip, ours

MEDIANS = {"Off": "1", "Three": "3"}
"""As models have them, and as they are asked for."""
RANGE_M_NO_RETURN = 65.535


def spoiled(path, folder, percent, how, seed):
    """Copies a trip, and spoils so many of its readings. Returns where it is, and the share of its readings that stand alone."""
    frames = []
    types, random = get_typestore(Stores.ROS2_HUMBLE), numpy.random.default_rng(seed)
    copy = folder / f"{path.stem}-{how}-{percent}-{seed}"
    with AnyReader([path], default_typestore=types) as reader, Writer(
        copy, version=9, storage_plugin=StoragePlugin.MCAP
    ) as writer:
        topics = {
            connection.id: writer.add_connection(connection.topic, connection.msgtype, typestore=types)
            for connection in reader.connections
        }
        for connection, time_ns, raw in reader.messages():
            name = connection.msgtype.rsplit("/", 1)[-1]
            if name in ("LaserScan", "Image"):
                message = reader.deserialize(raw, connection.msgtype)
                frames.append(spoil(message, name, percent, how, random))
                raw = types.serialize_cdr(message, connection.msgtype)
            writer.write(topics[connection.id], time_ns, raw)
    return next(copy.glob("*.mcap")), alone(numpy.stack(frames))


def spoil(message, name, percent, how, random):
    """In place; returns the readings in metres, not a number where they are missing. What sees nothing cannot see something nearer."""
    is_scan = name == "LaserScan"
    kind = numpy.float32 if is_scan or message.encoding == "32FC1" else numpy.uint16
    readings = numpy.array(message.ranges if is_scan else message.data.view(kind), kind)
    invalid = kind(0) if kind is numpy.uint16 else kind(numpy.nan)
    is_spoilt = random.random(readings.size) < percent / 100
    if how == "nearer":
        is_spoilt &= numpy.isfinite(readings) & (readings > 0)
        readings[is_spoilt] = (random.uniform(0, 1, readings.size) * readings)[is_spoilt].astype(kind)
    else:
        readings[is_spoilt] = invalid
    if is_scan:
        message.ranges = readings
    else:
        message.data = readings.view(numpy.uint8)
    if kind is numpy.uint16:
        return numpy.where(readings == 0, numpy.nan, readings * 1e-3)
    return numpy.minimum(readings, RANGE_M_NO_RETURN)


def alone(ranges_m):
    """Share of readings that are missing or far off for one frame alone."""
    past, present, following = ranges_m[:-2], ranges_m[1:-1], ranges_m[2:]
    mean = (past + following) / 2
    is_far_off = (abs(past - following) <= 0.1 * numpy.minimum(past, following)) & (abs(present - mean) > 0.3 * mean)
    return (numpy.isfinite(mean) & (numpy.isnan(present) | is_far_off)).mean()


def judge(paths, radius_m, percent, how, seed):
    """Scores by median, whether the trainer takes one unasked, and the share of readings that stand alone."""
    with tempfile.TemporaryDirectory() as folder:
        folder = Path(folder)
        copies = [spoiled(path, folder, percent, how, 2 * seed + trip) for trip, path in enumerate(paths)]
        trips = [Trip(path) for path, _ in copies]
        revisits = Revisits(*trips, radius_m)
        kinds, _, manifest = ours(trips, seed, folder)
        taken = manifest["plan"]["median"]
        scores = {taken: revisits.score(*kinds, trips[1].times)}
        (other,) = MEDIANS.keys() - {taken}
        kinds, _, _ = ours(trips, seed, folder, "--median", MEDIANS[other])
        scores[other] = revisits.score(*kinds, trips[1].times)
        return scores, taken == "Three", copies[0][1]


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--seeds", type=int, default=3)
    parser.add_argument("--percent", type=float, nargs="+", default=[0, 1, 2, 4, 6, 10])
    parser.add_argument(
        "--pair", nargs=4, action="append", required=True, metavar=("NAME", "TRIP1", "TRIP2", "RADIUS_M")
    )
    arguments = parser.parse_args()
    print("| | spoilt | alone | κ, AMI without | κ, AMI with the median | by default |\n|---|---|---|---|---|---|")
    for name, first, second, radius_m in arguments.pair:
        for how in ("missing", "nearer"):
            # Of nothing spoilt there are not two sorts.
            for percent in arguments.percent if how == "missing" else filter(None, arguments.percent):
                paths, seeds = [Path(first), Path(second)], range(arguments.seeds)
                row = told([judge(paths, float(radius_m), percent, how, seed) for seed in seeds])
                spoilt = f"{percent:g} % {how}" if percent else "none"
                print(f"| {' | '.join([name, spoilt, *row])} |", flush=True)


def told(judged):
    """Cells of a row."""
    scores = [
        ", ".join(f"{statistics.median(scores[median][what] for scores, _, _ in judged):.2f}" for what in ("kappa", "ami"))
        for median in MEDIANS
    ]
    n_taken = sum(is_taken for _, is_taken, _ in judged)
    return f"{statistics.median(share for _, _, share in judged):.1%}", *scores, f"{n_taken} of {len(judged)}"


if __name__ == "__main__":
    main()
