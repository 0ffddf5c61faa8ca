"""Frames are read where they lie, two at a time, and as long as an array of them is there: in_place.py SENSOR, of four frames."""

import sys

import natural_kinds

LONG_S = 60.0


def lies_in_shared_memory(array):
    with open("/proc/self/maps") as maps:
        for line in maps:
            begin, end = (int(address, 16) for address in line.split()[0].split("-"))
            if "/dev/shm/" in line and begin <= array.ctypes.data < array.ctypes.data + array.nbytes <= end:
                return True
    return False


def is_refused(frames):
    try:
        frames.next(LONG_S)
    except natural_kinds.Error as error:
        return sys.argv[1] in str(error)
    return False


frames = natural_kinds.frames(sys.argv[1])
print("ready", flush=True)
first = frames.next(LONG_S)
assert lies_in_shared_memory(first.counts)
assert not first.counts.flags.writeable
assert first.header.pose.x_m == 1.5 and first.header.command is None and first.header.true_pose is None
assert first.counts.tolist() == [[0, 1], [2, 3]] and first.counts.dtype == "u2"
assert first.ranges_m()[0, 1] == 0.001 and first.ranges_m()[0, 0] != first.ranges_m()[0, 0]
second = frames.next(LONG_S)
assert is_refused(frames)
part = first.counts[1, 1:]
del first
assert is_refused(frames), "a part of a frame holds it"
assert part[0] == 3
del part
third = frames.next(LONG_S)
del second
fourth = frames.next(LONG_S)
assert [third.sequence, fourth.sequence] == [2, 3]
del third
assert frames.next(0.01) is None
frames.close()
assert fourth.counts.tolist() == [[0, 1], [2, 3]], "a frame outlives its reader"
try:
    frames.next(0.0)
except ValueError as error:
    assert str(error) == "these frames are closed"
print("done", flush=True)
