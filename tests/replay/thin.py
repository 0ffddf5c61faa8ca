"""Every so many frames of a recorded trip, as a trip: what a committed recording of a camera is made of.

    python thin.py TRIP.mcap EVERY COUNT THINNED.mcap

Frames keep their bytes and stamps; nothing else is kept.
"""

import shutil
import sys
import tempfile
from itertools import islice
from pathlib import Path

from rosbags.highlevel import AnyReader
from rosbags.rosbag2 import CompressionFormat, CompressionMode, StoragePlugin, Writer
from rosbags.typesys import Stores, get_typestore


def thin(trip: Path, every: int, count: int, thinned: Path) -> None:
    store = get_typestore(Stores.ROS2_HUMBLE)
    with tempfile.TemporaryDirectory() as folder:
        bag = Path(folder) / thinned.stem
        with AnyReader([trip], default_typestore=store) as reader:
            (frames,) = (topic for topic in reader.connections if topic.topic == "/frames")
            writer = Writer(bag, version=9, storage_plugin=StoragePlugin.MCAP)
            writer.set_compression(CompressionMode.STORAGE, CompressionFormat.ZSTD)
            with writer:
                written = writer.add_connection(frames.topic, frames.msgtype, typestore=store)
                messages = reader.messages(connections=[frames])
                for _, logged, raw in islice(messages, 0, every * count, every):
                    writer.write(written, logged, raw)
        shutil.copyfile(bag / f"{bag.name}.mcap", thinned)


if __name__ == "__main__":
    _, trip, every, count, thinned = sys.argv
    thin(Path(trip), int(every), int(count), Path(thinned))
