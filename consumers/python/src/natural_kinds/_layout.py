"""How messages lie in memory: the same for every language, as ``consumers/layout.csv`` says."""

import ctypes

MAX_KINDS = 64
MAX_DIMS = 32

# Flags of a frame's header.
HAS_POSE = 1
HAS_COMMAND = 2
HAS_TRUE_POSE = 4


class Pose(ctypes.Structure):
    """Place of the robot on the floor, in the frame that it calls fixed."""

    x_m: float
    y_m: float
    yaw_rad: float
    _fields_ = [("x_m", ctypes.c_double), ("y_m", ctypes.c_double), ("yaw_rad", ctypes.c_double)]


class Command(ctypes.Structure):
    """What the robot had been told to do."""

    forward_m_s: float
    turn_rad_s: float
    _fields_ = [("forward_m_s", ctypes.c_double), ("turn_rad_s", ctypes.c_double)]


class FrameHeaderFields(ctypes.Structure):
    """Everything about a frame but its counts."""

    _fields_ = [
        ("version", ctypes.c_uint32),
        ("flags", ctypes.c_uint32),
        ("run", ctypes.c_uint64),
        ("sequence", ctypes.c_uint64),
        ("captured_ns", ctypes.c_int64),
        ("sent_monotonic_ns", ctypes.c_uint64),
        ("metres_per_count", ctypes.c_double),
        ("rows", ctypes.c_uint32),
        ("columns", ctypes.c_uint32),
        ("pose", Pose),
        ("command", Command),
        ("true_pose", Pose),
    ]


class ReportFields(ctypes.Structure):
    """What a service says about one frame."""

    _fields_ = [
        ("version", ctypes.c_uint32),
        ("status", ctypes.c_uint32),
        ("kind", ctypes.c_uint32),
        ("filtered_kind", ctypes.c_uint32),
        ("n_kinds", ctypes.c_uint32),
        ("n_dims", ctypes.c_uint32),
        ("n_invalid", ctypes.c_uint32),
        ("n_filtered", ctypes.c_uint32),
        ("run", ctypes.c_uint64),
        ("sequence", ctypes.c_uint64),
        ("n_lost", ctypes.c_uint64),
        ("captured_ns", ctypes.c_int64),
        ("sent_monotonic_ns", ctypes.c_uint64),
        ("received_monotonic_ns", ctypes.c_uint64),
        ("reported_monotonic_ns", ctypes.c_uint64),
        ("model_id", ctypes.c_uint8 * 16),
        ("log_likelihood", ctypes.c_double),
        ("novelty", ctypes.c_double),
        ("probabilities", ctypes.c_double * MAX_KINDS),
        ("filtered", ctypes.c_double * MAX_KINDS),
        ("coordinates", ctypes.c_double * MAX_DIMS),
        ("numbers", ctypes.c_uint32 * MAX_KINDS),
        ("merges", (ctypes.c_uint8 * 2) * MAX_KINDS),
    ]


class FramePlace(ctypes.Structure):
    """Where a frame lies (``kinds_frame``)."""

    _fields_ = [
        ("header", ctypes.POINTER(FrameHeaderFields)),
        ("counts", ctypes.c_void_p),
        ("n_readings", ctypes.c_size_t),
    ]


class LoanPlace(ctypes.Structure):
    """Where a frame that is being filled lies, and what will be said of it (``kinds_loan``)."""

    _fields_ = [
        ("header", FrameHeaderFields),
        ("counts", ctypes.c_void_p),
        ("n_readings", ctypes.c_size_t),
    ]
