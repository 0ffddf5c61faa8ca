"""The library under this package: where it is found, and how it is called."""

import ctypes
import os
import time
from pathlib import Path
from typing import Any, Callable, List, Optional, Union

from ._layout import FramePlace, LoanPlace, ReportFields

__version__ = "0.1.0"

_NAME = "libnatural_kinds.so"
# What the system finds it by: the name of its ABI.
_SONAME = "libnatural_kinds.so.0.1"

ERROR = -1
RECEIVED = 1
BY_EVENT = 0
POLLING = 1

# Longest stay in the library at a time. A signal that finds another thread does not end a wait, and Python looks at it after.
_SLICE_S = 0.25


class Error(RuntimeError):
    """What could not be done, and why, in words."""


class LibraryNotFound(ImportError):
    """The library is not there, or is of another version."""


def _candidates() -> List[str]:
    """Where the library may be; the first that is there is taken."""
    named = os.environ.get("NATURAL_KINDS_LIBRARY")
    if named:
        return [named]
    package = Path(__file__).resolve().parent
    beside = [package / _NAME]
    # In a checkout, this file is consumers/python/src/natural_kinds/_library.py.
    if package.parts[-4:-1] == ("consumers", "python", "src"):
        beside.append(package.parents[3] / "target" / "release" / _NAME)
    # By its name alone the system looks where it looks for all libraries.
    return [str(path) for path in beside[:1] if path.exists()] + [_SONAME] + [
        str(path) for path in beside[1:] if path.exists()
    ]


def _open() -> ctypes.CDLL:
    candidates = _candidates()
    reasons = []
    for candidate in candidates:
        try:
            return _declared(ctypes.CDLL(candidate), candidate)
        except OSError as reason:
            reasons.append(str(reason))
    raise LibraryNotFound(
        f"{_NAME} cannot be loaded ({'; '.join(reasons)}); install natural kinds, or build it in its checkout with "
        f"`cargo build --release -p kinds-c` and set NATURAL_KINDS_LIBRARY to the path of target/release/{_NAME}"
    )


def _declared(library: ctypes.CDLL, path: str) -> ctypes.CDLL:
    handle, text, number = ctypes.c_void_p, ctypes.c_char_p, ctypes.c_uint32
    for name, result, arguments in [
        ("kinds_version", text, []),
        ("kinds_last_error", text, []),
        ("kinds_reports_open", handle, [text, text, number]),
        ("kinds_reports_next", ctypes.c_int32, [handle, number, ctypes.POINTER(ctypes.POINTER(ReportFields))]),
        ("kinds_reports_is_served", ctypes.c_int32, [handle]),
        ("kinds_reports_close", None, [handle]),
        (
            "kinds_report_at_level",
            ctypes.c_int32,
            [ctypes.POINTER(ReportFields), number] + [ctypes.c_void_p] * 3,
        ),
        ("kinds_frames_open", handle, [text, text, number]),
        ("kinds_frames_next", ctypes.c_int32, [handle, number, ctypes.POINTER(FramePlace)]),
        ("kinds_frames_release", ctypes.c_int32, [handle, ctypes.POINTER(FramePlace)]),
        ("kinds_frames_close", None, [handle]),
        ("kinds_publisher_open", handle, [text, text, number, number, ctypes.c_double]),
        ("kinds_publisher_borrow", ctypes.c_int32, [handle, ctypes.POINTER(LoanPlace)]),
        ("kinds_publisher_send", ctypes.c_int32, [handle, ctypes.POINTER(LoanPlace)]),
        ("kinds_publisher_give_back", ctypes.c_int32, [handle, ctypes.POINTER(LoanPlace)]),
        ("kinds_publisher_update", ctypes.c_int32, [handle]),
        ("kinds_publisher_n_readers", ctypes.c_int32, [handle]),
        ("kinds_publisher_close", None, [handle]),
    ]:
        function = getattr(library, name, None)
        if function is None:
            raise LibraryNotFound(f"{path} is another library: it has no {name}")
        function.restype, function.argtypes = result, arguments
    version = library.kinds_version().decode()
    if version != __version__:
        raise LibraryNotFound(
            f"{path} is of version {version} and this package of {__version__}; install both in the same version"
        )
    return library


LIBRARY = _open()


def fail() -> Error:
    """The error that the library has just told this thread of."""
    return Error(LIBRARY.kinds_last_error().decode())


class Handle:
    """Something that the library opened, closed when nobody refers to it any more."""

    def __init__(
        self, kind: str, sensor: str, domain: "Union[str, os.PathLike[str], None]", *arguments: Any
    ) -> None:
        opened = getattr(LIBRARY, f"kinds_{kind}_open")
        folder = None if domain is None else os.fsencode(domain)
        self._close = getattr(LIBRARY, f"kinds_{kind}_close")
        self.pointer = opened(sensor.encode(), folder, *arguments)
        if not self.pointer:
            raise fail()

    def __del__(self) -> None:
        if getattr(self, "pointer", None):
            self._close(self.pointer)


def waiting(polling: bool) -> int:
    """How the library is to wait."""
    return POLLING if polling else BY_EVENT


def wait(timeout_s: Optional[float], take: Callable[[int], int]) -> bool:
    """Calls ``take`` with slices of the time, in ms, until it has received something; whether it has."""
    deadline = None if timeout_s is None else time.monotonic() + timeout_s
    while True:
        left_s = _SLICE_S if deadline is None else max(0.0, deadline - time.monotonic())
        came = take(int(1000 * min(left_s, _SLICE_S)))
        if came == ERROR:
            raise fail()
        if came == RECEIVED:
            return True
        if left_s < 0.001:
            return False
