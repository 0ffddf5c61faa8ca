"""Makes two trips of a ring of 16 range sensors: a made-up robot in a made-up building.

    python -m venv venv && venv/bin/pip install -r requirements.txt
    venv/bin/python make_ring.py

Writes ring1.mcap and ring2.mcap beside this script, by the independent package `rosbags`, so that our
reader is tried on recordings that we did not write. Seeded: on one machine every run writes the same bytes.

Lengths in metres, angles in radians, counter-clockwise from x, times in seconds; x forward, y left.
"""

import shutil
import tempfile
from collections.abc import Iterator
from dataclasses import dataclass
from datetime import datetime, timezone
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from rosbags.rosbag2 import CompressionFormat, CompressionMode, StoragePlugin, Writer
from rosbags.typesys import Stores, get_typestore
from rosbags.typesys.store import Typestore

HERE = Path(__file__).resolve().parent

# ---------------------------------------------------------------- the building

# Each wall is x0, y0, x1, y1. A corridor runs west to east along y = 0 … 1.5.
WALLS = np.array(
    [
        # Corridor: closed ends, north side with two openings, south side with one.
        (0.0, 0.0, 0.0, 1.5),
        (11.0, 0.0, 11.0, 1.5),
        (0.0, 1.5, 1.2, 1.5),
        (2.1, 1.5, 6.6, 1.5),
        (8.0, 1.5, 11.0, 1.5),
        (0.0, 0.0, 4.6, 0.0),
        (5.6, 0.0, 11.0, 0.0),
        # Office: small, north of the corridor, through the doorway at x = 1.2 … 2.1.
        (0.3, 1.5, 0.3, 4.1),
        (2.9, 1.5, 2.9, 4.1),
        (0.3, 4.1, 2.9, 4.1),
        # Workshop: large, south, doorway at x = 4.6 … 5.6, with a slanted corner and a pillar.
        (6.2, 0.0, 6.2, -4.6),
        (6.2, -4.6, 2.2, -4.6),
        (2.2, -4.6, 1.0, -3.4),
        (1.0, -3.4, 1.0, 0.0),
        (2.9, -2.7, 3.5, -2.7),
        (3.5, -2.7, 3.5, -2.1),
        (3.5, -2.1, 2.9, -2.1),
        (2.9, -2.1, 2.9, -2.7),
        # Side corridor: from the junction at x = 6.6 … 8.0 to the north.
        (6.6, 1.5, 6.6, 4.8),
        (8.0, 1.5, 8.0, 4.8),
        # Meeting room: at its end, through a narrower doorway.
        (5.2, 4.8, 6.8, 4.8),
        (7.8, 4.8, 9.0, 4.8),
        (9.0, 4.8, 9.0, 7.6),
        (9.0, 7.6, 5.2, 7.6),
        (5.2, 7.6, 5.2, 4.8),
    ]
)

# Office, workshop (once round the pillar), junction, meeting room (once round), and back to the office: both
# corridors are walked in both directions.
WAYPOINTS = np.array(
    [
        (2.5, 2.1), (2.4, 3.0), (1.7, 3.5), (1.2, 2.7), (1.6, 1.5), (2.1, 0.75), (3.5, 0.75), (4.7, 0.6),
        (5.1, -0.1), (5.2, -1.2), (4.9, -3.3), (3.2, -3.7), (1.9, -2.9), (1.9, -1.5), (3.2, -1.1),
        (4.6, -0.8), (5.1, 0.0), (5.6, 0.65), (6.5, 0.75), (7.2, 1.5), (7.3, 3.0), (7.3, 4.8),
        (6.7, 5.5), (6.0, 6.1), (6.3, 6.9), (7.7, 6.9), (8.2, 6.2), (7.5, 5.0), (7.3, 3.8),
        (7.3, 2.0), (6.7, 0.95), (5.5, 0.75), (3.5, 0.75), (2.1, 0.8), (1.65, 1.5), (1.8, 2.5),
        (1.5, 3.4), (0.7, 3.6),
    ]
)  # fmt: skip

# ---------------------------------------------------------------- the robot

N_READINGS = 16
FRAME_RATE_HZ = 10.0
RANGE_M_MIN, RANGE_M_MAX = 0.02, 4.0
# Standard deviation of a reading: so much, and so much more for each metre.
NOISE_M, NOISE_PER_M = 0.005, 0.015
DROP_OUT_SHARE = 0.006

ODOMETRY_RATE_HZ = 20.0
# Odometry is not in step with the sensor, so that poses must be interpolated.
ODOMETRY_LEAD_S = 0.037
ODOMETRY_NOISE_M, ODOMETRY_NOISE_RAD = 0.004, 0.004

# The robot keeps at least this far from walls, or the building above is wrong.
CLEARANCE_M = 0.15


@dataclass(frozen=True)
class Trip:
    name: str
    start: datetime
    n_frames: int
    seed: int


TRIPS = [
    Trip("ring1", datetime(2025, 6, 2, 9, 0, tzinfo=timezone.utc), n_frames=900, seed=1),
    Trip("ring2", datetime(2025, 6, 2, 14, 30, tzinfo=timezone.utc), n_frames=600, seed=2),
]


@dataclass(frozen=True)
class Track:
    """Where the robot is, finely spaced in time: columns of x, y and unwrapped yaw."""

    times: NDArray
    poses: NDArray

    def at(self, times: NDArray) -> NDArray:
        return np.stack([np.interp(times, self.times, column) for column in self.poses.T], axis=1)


def main() -> None:
    for trip in TRIPS:
        random = np.random.default_rng(trip.seed)
        track = drive(trip, random)
        path = HERE / f"{trip.name}.mcap"
        record(trip, track, path, random)
        print(f"{path.name}: {trip.n_frames} frames, {path.stat().st_size} bytes")


# ---------------------------------------------------------------- driving


def drive(trip: Trip, random: np.random.Generator) -> Track:
    """Once along the waypoints in the trip's time, at a pace and a course that wander."""
    duration = trip.n_frames / FRAME_RATE_HZ
    # A second more at either end, so that every frame lies between two messages of odometry.
    times = np.arange(-1.0, duration + 1.0, 0.01)
    pace = 1 + 0.25 * smooth_noise(len(times), 300, random)
    travelled = np.cumsum(pace)
    travelled = (travelled - travelled[0]) / (travelled[-1] - travelled[0])

    course = smooth_course(WAYPOINTS + random.normal(0, 0.05, WAYPOINTS.shape))
    along = np.linspace(0, 1, len(course))
    centre = np.stack([np.interp(travelled, along, column) for column in course.T], axis=1)

    ahead = np.gradient(centre, axis=0)
    ahead /= np.linalg.norm(ahead, axis=1, keepdims=True)
    leftwards = np.stack([-ahead[:, 1], ahead[:, 0]], axis=1)
    positions = centre + 0.06 * smooth_noise(len(times), 120, random)[:, None] * leftwards

    steps = np.gradient(positions, axis=0)
    yaw = np.unwrap(np.arctan2(steps[:, 1], steps[:, 0]))
    yaw += 0.04 * smooth_noise(len(times), 100, random)
    assert distance_to_walls(positions) > CLEARANCE_M, "the robot would scrape along a wall"
    return Track(times, np.column_stack([positions, yaw]))


def smooth_course(waypoints: NDArray) -> NDArray:
    """The polyline through the waypoints, points 1 cm apart, its corners rounded over about half a metre."""
    lengths = np.linalg.norm(np.diff(waypoints, axis=0), axis=1)
    at = np.concatenate([[0], np.cumsum(lengths)])
    along = np.arange(0, at[-1], 0.01)
    polyline = np.stack([np.interp(along, at, column) for column in waypoints.T], axis=1)
    rounded = np.stack([blur(column, 25) for column in polyline.T], axis=1)
    # Rounding shortened the corners: space the points evenly again.
    at = np.concatenate([[0], np.cumsum(np.linalg.norm(np.diff(rounded, axis=0), axis=1))])
    along = np.arange(0, at[-1], 0.01)
    return np.stack([np.interp(along, at, column) for column in rounded.T], axis=1)


def smooth_noise(n: int, width: int, random: np.random.Generator) -> NDArray:
    """Gaussian noise of mean 0 and standard deviation 1 that changes over about `width` entries."""
    noise = blur(random.normal(size=n), width)
    return (noise - noise.mean()) / noise.std()


def blur(values: NDArray, width: int) -> NDArray:
    """Convolves with a Gaussian whose standard deviation is `width` entries; the ends are prolonged."""
    offsets = np.arange(-4 * width, 4 * width + 1)
    kernel = np.exp(-0.5 * (offsets / width) ** 2)
    padded = np.pad(values, 4 * width, mode="edge")
    return np.convolve(padded, kernel / kernel.sum(), mode="valid")


def distance_to_walls(positions: NDArray) -> float:
    start, along = WALLS[:, :2], WALLS[:, 2:] - WALLS[:, :2]
    from_start = positions[:, None] - start
    share = np.clip((from_start * along).sum(axis=2) / (along**2).sum(axis=1), 0, 1)
    return float(np.linalg.norm(from_start - share[:, :, None] * along, axis=2).min())


# ---------------------------------------------------------------- sensing


def measure(poses: NDArray, random: np.random.Generator) -> NDArray:
    """What the ring of range sensors reads, (n_frames, N_READINGS): whole millimetres as f32 metres, +Inf
    where nothing is in reach, NaN where a sensor failed to answer."""
    bearings = poses[:, 2:] + 2 * np.pi / N_READINGS * np.arange(N_READINGS)
    ranges = cast_rays(poses[:, None, :2], bearings)
    ranges += random.normal(size=ranges.shape) * (NOISE_M + NOISE_PER_M * np.minimum(ranges, RANGE_M_MAX))
    ranges = np.round(ranges, 3)
    ranges[ranges > RANGE_M_MAX] = np.inf
    ranges[random.random(ranges.shape) < DROP_OUT_SHARE] = np.nan
    assert not (ranges < RANGE_M_MIN).any()
    return ranges.astype(np.float32)


def cast_rays(origins: NDArray, bearings: NDArray) -> NDArray:
    """Distance to the nearest wall along each bearing."""
    origins = origins[..., None, :]
    direction = np.stack([np.cos(bearings), np.sin(bearings)], axis=-1)[..., None, :]
    start, along = WALLS[:, :2], WALLS[:, 2:] - WALLS[:, :2]
    # origin + distance * direction = start + share * along, by Cramer's rule.
    with np.errstate(divide="ignore", invalid="ignore"):
        determinant = cross(direction, along)
        distance = cross(start - origins, along) / determinant
        share = cross(start - origins, direction) / determinant
    hit = (distance > 0) & (share >= 0) & (share <= 1)
    return np.where(hit, distance, np.inf).min(axis=-1)


def cross(a: NDArray, b: NDArray) -> NDArray:
    return a[..., 0] * b[..., 1] - a[..., 1] * b[..., 0]


# ---------------------------------------------------------------- recording


def record(trip: Trip, track: Track, path: Path, random: np.random.Generator) -> None:
    types = get_typestore(Stores.ROS2_JAZZY)
    frame_times = np.arange(trip.n_frames) / FRAME_RATE_HZ
    n_odometry = round(trip.n_frames * ODOMETRY_RATE_HZ / FRAME_RATE_HZ) + 1
    odometry_times = np.arange(n_odometry) / ODOMETRY_RATE_HZ - ODOMETRY_LEAD_S
    messages = [
        *scans(types, trip, frame_times, measure(track.at(frame_times), random)),
        *odometry(types, trip, odometry_times, track, random),
    ]
    # A message is recorded a few milliseconds after what it tells of.
    latencies_ns = random.integers(2_000_000, 6_000_000, len(messages))
    recorded = sorted(
        (stamp_ns(message.header.stamp) + int(latency), topic, message)
        for (topic, message), latency in zip(messages, latencies_ns, strict=True)
    )

    # rosbags writes a folder with the recording and a metadata.yaml, which MCAP holds already.
    with tempfile.TemporaryDirectory() as folder:
        writer = Writer(Path(folder) / path.stem, version=9, storage_plugin=StoragePlugin.MCAP)
        writer.set_compression(CompressionMode.STORAGE, CompressionFormat.ZSTD)
        with writer:
            connections = {
                topic: writer.add_connection(topic, message_type, typestore=types)
                for topic, message_type in (
                    ("/ranges", "sensor_msgs/msg/LaserScan"),
                    ("/odom", "nav_msgs/msg/Odometry"),
                )
            }
            for recorded_ns, topic, message in recorded:
                connection = connections[topic]
                writer.write(connection, recorded_ns, types.serialize_cdr(message, connection.msgtype))
        shutil.copyfile(Path(folder) / path.stem / path.name, path)


def scans(
    types: Typestore, trip: Trip, times: NDArray, ranges: NDArray
) -> Iterator[tuple[str, Any]]:
    increment = 2 * np.pi / N_READINGS
    for time, readings in zip(times, ranges, strict=True):
        yield "/ranges", types.types["sensor_msgs/msg/LaserScan"](
            header=header(types, trip, time, "range_ring"),
            angle_min=0.0,
            angle_max=increment * (N_READINGS - 1),
            angle_increment=increment,
            time_increment=0.0,
            scan_time=1 / FRAME_RATE_HZ,
            range_min=RANGE_M_MIN,
            range_max=RANGE_M_MAX,
            ranges=readings,
            intensities=np.zeros(0, np.float32),
        )


def odometry(
    types: Typestore, trip: Trip, times: NDArray, track: Track, random: np.random.Generator
) -> Iterator[tuple[str, Any]]:
    poses = track.at(times)
    # Central differences over a tenth of a second.
    velocities = (track.at(times + 0.05) - track.at(times - 0.05)) / 0.1
    speeds = np.linalg.norm(velocities[:, :2], axis=1)
    noise = [ODOMETRY_NOISE_M, ODOMETRY_NOISE_M, ODOMETRY_NOISE_RAD]
    poses = poses + random.normal(size=poses.shape) * noise

    message = {name: types.types[f"geometry_msgs/msg/{name}"] for name in (
        "Point", "Pose", "PoseWithCovariance", "Quaternion", "Twist", "TwistWithCovariance", "Vector3",
    )}  # fmt: skip
    covariance = np.zeros((6, 6))
    covariance[[0, 1, 5], [0, 1, 5]] = np.square(noise)
    for time, (x, y, yaw), speed, turn_rate in zip(times, poses, speeds, velocities[:, 2], strict=True):
        position = message["Point"](x=x, y=y, z=0.0)
        orientation = message["Quaternion"](x=0.0, y=0.0, z=np.sin(yaw / 2), w=np.cos(yaw / 2))
        twist = message["Twist"](
            linear=message["Vector3"](x=speed, y=0.0, z=0.0),
            angular=message["Vector3"](x=0.0, y=0.0, z=turn_rate),
        )
        yield "/odom", types.types["nav_msgs/msg/Odometry"](
            header=header(types, trip, time, "odom"),
            child_frame_id="base_link",
            pose=message["PoseWithCovariance"](
                pose=message["Pose"](position=position, orientation=orientation),
                covariance=covariance.ravel(),
            ),
            twist=message["TwistWithCovariance"](twist=twist, covariance=np.zeros(36)),
        )


def header(types: Typestore, trip: Trip, time: float, frame_id: str) -> Any:
    nanoseconds = round(trip.start.timestamp()) * 10**9 + round(time * 1e9)
    seconds, rest = divmod(nanoseconds, 10**9)
    stamp = types.types["builtin_interfaces/msg/Time"](sec=seconds, nanosec=rest)
    return types.types["std_msgs/msg/Header"](stamp=stamp, frame_id=frame_id)


def stamp_ns(stamp: Any) -> int:
    return stamp.sec * 10**9 + stamp.nanosec


if __name__ == "__main__":
    main()
