"""Writes depth images beside what two independent programs make of them in RVL, by rosbags: write_rvl.py FOLDER"""

import struct
import sys
from pathlib import Path

import numpy as np
import pyrvl
import rvl
from rosbags.rosbag2 import StoragePlugin, Writer
from rosbags.typesys import Stores, get_typestore

ROWS, COLUMNS = 37, 53

store = get_typestore(Stores.LATEST)
T = store.types
random = np.random.default_rng(7)


def picture():
    """A surface with noise, an object before it, shadows without measurement, and a few wild pixels."""
    rows, columns = np.mgrid[:ROWS, :COLUMNS]
    depth = 2000 + 40 * rows + 9 * columns + random.integers(-20, 20, (ROWS, COLUMNS))
    depth[10:20, 15:30] -= 1200
    depth[random.random(depth.shape) < 0.2] = 0
    depth[10:20, 30:34] = 0
    wild = random.random(depth.shape) < 0.02
    depth[wild] = random.integers(0, 65536, wild.sum())
    return depth.astype("<u2")


def words(pixels, program):
    """Both put something of their own before the words: the number of pixels, and rows and columns."""
    coded = rvl.compress(pixels.tobytes()) if program is rvl else pyrvl.compress(pixels)
    return coded[4:]


def message(kind, topic, writer, connections, ns, *fields):
    if topic not in connections:
        connections[topic] = writer.add_connection(topic, kind, typestore=store)
    header = T["std_msgs/msg/Header"](T["builtin_interfaces/msg/Time"](ns // 10**9, ns % 10**9), "camera")
    writer.write(connections[topic], ns, store.serialize_cdr(T[kind](header, *fields), kind))


with Writer(Path(sys.argv[1]) / "rvl", version=9, storage_plugin=StoragePlugin.MCAP) as writer:
    connections = {}
    for index in range(6):
        ns = 1_000_000_000_000 + index * 100_000_000
        pixels = [picture(), np.zeros((ROWS, COLUMNS), "<u2"), np.full((ROWS, COLUMNS), 65535, "<u2")][index % 3]
        image = np.frombuffer(pixels.tobytes(), dtype=np.uint8)
        fields = (ROWS, COLUMNS, "16UC1", 0, 2 * COLUMNS, image)
        message("sensor_msgs/msg/Image", "/depth", writer, connections, ns, *fields)
        for name, program in [("rvl", rvl), ("pyrvl", pyrvl)]:
            data = struct.pack("<IffII", 0, 0, 0, COLUMNS, ROWS) + words(pixels, program)
            fields = ("16UC1; compressedDepth rvl", np.frombuffer(data, dtype=np.uint8))
            topic = f"/{name}/compressedDepth"
            message("sensor_msgs/msg/CompressedImage", topic, writer, connections, ns, *fields)
