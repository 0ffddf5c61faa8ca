"""Frames that this package sends arrive as they were sent, and what no frame is is refused in words: publish.py SENSOR"""

import gc
import sys

import natural_kinds
import numpy as np

LONG_S = 60.0
SENSOR = sys.argv[1]


def refusal(error, call):
    try:
        call()
    except error as refused:
        return str(refused)
    raise AssertionError("it is not refused")


def received(frames):
    frame = frames.next(LONG_S)
    assert frame is not None
    return frame.header, frame.counts.tolist()


frames = natural_kinds.frames(SENSOR)
whole = [[1, 2, 3], [4, 5, 65535]]
with natural_kinds.publish(SENSOR, rows=2, columns=3, metres_per_count=0.001) as shim:
    assert shim.n_readers == 1 and shim.shape == (2, 3)
    # A copy, of all that are whole numbers.
    for counts in [whole, sum(whole, []), np.array(whole, np.uint16), np.array(whole, np.int64), np.array(whole, ">u2")]:
        shim.send(counts)
        header, came = received(frames)
        assert came == whole
        assert (header.rows, header.columns, header.metres_per_count) == (2, 3, 0.001)
        assert header.captured_ns > 0 and header.pose is None and header.command is None and header.true_pose is None
    assert header.sequence == 4
    shim.send(np.array(whole)[:, ::-1], captured_ns=np.int64(-5), sequence=7)
    header, came = received(frames)
    assert (came, header.captured_ns, header.sequence) == ([[3, 2, 1], [65535, 5, 4]], -5, 7)

    # In place.
    loan = shim.borrow()
    counts = loan.counts
    assert counts.tolist() == [[0] * 3] * 2 and counts.dtype == "u2"
    counts[1] = [7, 8, 9]
    loan.send(
        pose=natural_kinds.Pose(x_m=1.5, y_m=2.5, yaw_rad=0.5),
        command=natural_kinds.Command(forward_m_s=0.25, turn_rad_s=-1.0),
        true_pose=natural_kinds.Pose(x_m=1.0, y_m=2.0, yaw_rad=0.0),
    )
    frame = frames.next(LONG_S)
    header = frame.header
    assert (frame.counts.tolist(), header.sequence) == ([[0, 0, 0], [7, 8, 9]], 8)
    assert (header.pose.x_m, header.pose.yaw_rad, header.true_pose.x_m) == (1.5, 0.5, 1.0)
    assert (header.command.forward_m_s, header.command.turn_rad_s) == (0.25, -1.0)

    # A frame that is sent is its readers'.
    assert "read-only" in refusal(ValueError, lambda: counts.fill(1))
    over = "this frame is sent or given back already; borrow the next one"
    assert refusal(ValueError, lambda: loan.counts) == over
    assert refusal(ValueError, loan.send) == over
    loan.give_back()
    assert frame.counts.tolist() == [[0, 0, 0], [7, 8, 9]]
    del frame

    # One at a time, until nobody refers to it, nor to a part of it.
    loan = shim.borrow()
    assert SENSOR in refusal(natural_kinds.Error, shim.borrow)
    part = loan.counts[1, 1:]
    part[0] = 3
    del loan
    gc.collect()
    assert SENSOR in refusal(natural_kinds.Error, shim.borrow), "a part of a frame holds its memory"
    del part
    gc.collect()
    loan = shim.borrow()
    loan.give_back()
    assert shim.borrow().counts.tolist() == [[0] * 3] * 2

    # What cannot be leaves the publisher as it was.
    for counts, error, sentence in [
        ([1, 2, 3], ValueError, "counts are of shape (3,); a frame of this sensor is of (2, 3)"),
        (np.array(whole).T, ValueError, "counts are of shape (3, 2); a frame of this sensor is of (2, 3)"),
        ([[0, 0, 0], [0, 0, 65536]], ValueError, "a count is 65536; it must be from 0 to 65535"),
        ([[0, -1, 0], [0, 0, 0]], ValueError, "a count is -1; it must be from 0 to 65535"),
        (
            np.zeros((2, 3)),
            TypeError,
            "counts are of type float64; give whole numbers, such as ranges divided by metres_per_count and rounded, and "
            "0 where there is no measurement",
        ),
    ]:
        assert refusal(error, lambda: shim.send(counts)) == sentence
    for arguments, error, sentence in [
        ({"captured_ns": 1.5}, TypeError, "captured_ns is 1.5; give a whole number"),
        ({"sequence": -1}, ValueError, "sequence is -1; it must be from 0 to 18446744073709551615"),
    ]:
        assert refusal(error, lambda: shim.send(whole, **arguments)) == sentence
    for arguments, sentence in [
        ({"rows": 0, "columns": 3}, "rows is 0; it must be from 1 to 4294967295"),
        ({"rows": 2**32 + 2, "columns": 3}, "rows is 4294967298; it must be from 1 to 4294967295"),
    ]:
        assert refusal(ValueError, lambda: natural_kinds.publish(SENSOR, metres_per_count=1, **arguments)) == sentence
    sentence = "a sensor of 1 × 16 readings of 0 m each count cannot be; all must be above 0, and the readings at most 67108864"
    assert refusal(natural_kinds.Error, lambda: natural_kinds.publish(SENSOR, columns=16, metres_per_count=0)) == sentence
    another = refusal(natural_kinds.Error, lambda: natural_kinds.publish(SENSOR, columns=16, metres_per_count=1))
    assert SENSOR in another, another
    assert frames.next(0.0) is None
    loan = shim.borrow()
    counts = loan.counts
    loan.send()
    shim.send(whole)
# What was sent last is still there, and the place is free for the next once the last array is gone.
assert received(frames)[1] == [[0] * 3] * 2
assert received(frames)[1] == whole
assert refusal(ValueError, lambda: shim.send(whole)) == "this publisher is closed"
assert SENSOR in refusal(natural_kinds.Error, lambda: natural_kinds.publish(SENSOR, columns=16, metres_per_count=1))
assert counts.shape == (2, 3)
del counts
with natural_kinds.publish(SENSOR, columns=16, metres_per_count=1) as shim:
    assert shim.shape == (1, 16)
    shim.update()
print("done", flush=True)
