"""Writes one trip as a ROS 2 bag (MCAP) and as ROS 1 bags of each compression, by rosbags: write_bags.py FOLDER"""

import struct
import sys
import zlib
from pathlib import Path

import numpy as np
from rosbags.rosbag1 import Writer as Writer1
from rosbags.rosbag2 import StoragePlugin
from rosbags.rosbag2 import Writer as Writer2
from rosbags.typesys import Stores, get_typestore


def png(rows):
    """An image of 16 bits of grey."""
    def chunk(name, data):
        return struct.pack(">I", len(data)) + name + data + struct.pack(">I", zlib.crc32(name + data))

    head = struct.pack(">IIBBBBB", len(rows[0]), len(rows), 16, 0, 0, 0, 0)
    lines = b"".join(b"\0" + struct.pack(f">{len(row)}H", *row) for row in rows)
    return b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", head) + chunk(b"IDAT", zlib.compress(lines)) + chunk(b"IEND", b"")


def messages(store, header):
    """Topic, type, time in ns, message."""
    T = store.types

    def vector(x, y, z):
        return T["geometry_msgs/msg/Vector3"](x, y, z)

    def twist(forward, turn):
        return T["geometry_msgs/msg/Twist"](vector(forward, 0.0, 0.0), vector(0.0, 0.0, turn))

    def floats(*numbers):
        return np.array(numbers, dtype=np.float32)

    def one_range(head, metres):
        kind = T["sensor_msgs/msg/Range"]
        fields = dict(header=head, radiation_type=0, field_of_view=0.5, min_range=0.1, max_range=4.0, range=metres)
        if "variance" in kind.__dataclass_fields__:
            fields["variance"] = 9.0
        return kind(**fields)

    def array(dimensions, numbers):
        dims = [T["std_msgs/msg/MultiArrayDimension"](*of) for of in dimensions]
        layout = T["std_msgs/msg/MultiArrayLayout"](dims, 0)
        return T["std_msgs/msg/Float32MultiArray"](layout, floats(*numbers))

    def cloud(head):
        # Six points of x, y, z and an intensity between y and z.
        points = np.zeros((2, 3, 4), dtype=np.float32)
        points[..., 0] = [[3, np.nan, 0], [0.6, np.inf, 1]]
        points[..., 1] = [[4, 0, 0], [0.8, 0, 0]]
        points[..., 3] = [[0, 0, 0], [0, 0, 2]]
        field = T["sensor_msgs/msg/PointField"]
        fields = [field("x", 0, 7, 1), field("y", 4, 7, 1), field("intensity", 8, 7, 1), field("z", 12, 7, 1)]
        data = np.frombuffer(points.tobytes(), dtype=np.uint8)
        return T["sensor_msgs/msg/PointCloud2"](head, 2, 3, fields, False, 16, 48, data, False)

    def compressed(head, form, parameters, rows):
        data = struct.pack("<Iff", 0, *parameters) + png(rows)
        data = np.frombuffer(data, dtype=np.uint8)
        return T["sensor_msgs/msg/CompressedImage"](head, form + "; compressedDepth", data)

    pose = T["geometry_msgs/msg/Pose"](
        T["geometry_msgs/msg/Point"](1.5, -2.5, 0.0), T["geometry_msgs/msg/Quaternion"](0.0, 0.0, 0.0, 1.0)
    )
    zeros = np.zeros(36)
    for index in range(3):
        ns = 1_000_000_000_000 + index * 100_000_000
        near = ns + 20_000_000
        with_pose = T["geometry_msgs/msg/PoseWithCovariance"](pose, zeros)
        with_twist = T["geometry_msgs/msg/TwistWithCovariance"](twist(0.0, 0.0), zeros)
        yield "/odom", "nav_msgs/msg/Odometry", ns, T["nav_msgs/msg/Odometry"](
            header(ns, "odom"), "base_link", with_pose, with_twist
        )
        yield "/truth", "geometry_msgs/msg/PoseStamped", ns, T["geometry_msgs/msg/PoseStamped"](
            header(ns, "map"), pose
        )
        yield "/cmd_vel", "geometry_msgs/msg/Twist", ns, twist(0.25, -1.5)
        yield "/cmd_vel_stamped", "geometry_msgs/msg/TwistStamped", ns, T["geometry_msgs/msg/TwistStamped"](
            header(ns, "base_link"), twist(0.5, 1.5)
        )
        yield "/scan", "sensor_msgs/msg/LaserScan", ns, T["sensor_msgs/msg/LaserScan"](
            header(ns, "laser"), 0.0, 1.0, 0.5, 0.0, 0.0, 0.1, 4.0, floats(np.nan, 1.25, np.inf), floats()
        )
        pixels = np.array([1, 2, 3, 4 + index], dtype="<u2").tobytes()
        yield "/depth", "sensor_msgs/msg/Image", ns, T["sensor_msgs/msg/Image"](
            header(ns, "camera"), 2, 2, "16UC1", 0, 4, np.frombuffer(pixels, dtype=np.uint8)
        )
        yield "/sonar_2", "sensor_msgs/msg/Range", ns, one_range(header(ns, "s2"), 1.0 + index)
        if index != 1:
            yield "/sonar_10", "sensor_msgs/msg/Range", near, one_range(header(near, "s10"), 0.5)
        yield "/numbers", "std_msgs/msg/Float32MultiArray", ns, array([("rows", 2, 4), ("columns", 2, 2)], [1, 2, 3, 4])
        yield "/row", "std_msgs/msg/Float32MultiArray", ns, array([], [0.5, np.inf])
        yield "/lidar", "sensor_msgs/msg/PointCloud2", ns, cloud(header(ns, "lidar"))
        yield "/points", "sensor_msgs/msg/PointCloud2", ns, cloud(header(ns, "camera_depth_optical_frame"))
        yield "/raw/compressedDepth", "sensor_msgs/msg/CompressedImage", ns, compressed(
            header(ns, "camera"), "16UC1", (0, 0), [[0, 1000], [258, 65535]]
        )
        # 10 / depth - 2: 2 m are 3, 0.5 m are 18.
        yield "/metric/compressedDepth", "sensor_msgs/msg/CompressedImage", ns, compressed(
            header(ns, "camera"), "32FC1", (10, -2), [[0, 3], [18, 18]]
        )


def main(folder):
    store2 = get_typestore(Stores.LATEST)
    T2 = store2.types

    def header2(ns, frame):
        return T2["std_msgs/msg/Header"](T2["builtin_interfaces/msg/Time"](ns // 10**9, ns % 10**9), frame)

    with Writer2(folder / "ros2", version=9, storage_plugin=StoragePlugin.MCAP) as writer:
        connections = {}
        for topic, kind, ns, message in messages(store2, header2):
            if topic not in connections:
                connections[topic] = writer.add_connection(topic, kind, typestore=store2)
            writer.write(connections[topic], ns, store2.serialize_cdr(message, kind))

    store1 = get_typestore(Stores.ROS1_NOETIC)
    T1 = store1.types

    def header1(ns, frame):
        return T1["std_msgs/msg/Header"](77, T1["builtin_interfaces/msg/Time"](ns // 10**9, ns % 10**9), frame)

    for name, compression in [("none", None), ("bz2", Writer1.CompressionFormat.BZ2), ("lz4", Writer1.CompressionFormat.LZ4)]:
        bag = Writer1(folder / f"{name}.bag")
        if compression:
            bag.set_compression(compression)
        with bag as writer:
            connections = {}
            for topic, kind, ns, message in messages(store1, header1):
                if topic not in connections:
                    connections[topic] = writer.add_connection(topic, kind, typestore=store1)
                writer.write(connections[topic], ns, store1.serialize_ros1(message, kind))


main(Path(sys.argv[1]))
