"""A sensor's frames."""

import ctypes
import os
from collections import deque
from types import TracebackType
from typing import Any, Deque, Dict, Iterator, Optional, Type, Union

import numpy as np

from ._layout import HAS_COMMAND, HAS_POSE, HAS_TRUE_POSE, Command, FrameHeaderFields, FramePlace, Pose
from ._library import LIBRARY, Handle, fail, wait, waiting


class FrameHeader(FrameHeaderFields):
    """Everything about a frame but its counts: a copy."""

    version: int
    flags: int
    run: int
    sequence: int
    captured_ns: int
    sent_monotonic_ns: int
    metres_per_count: float
    rows: int
    columns: int

    @property
    def pose(self) -> Optional[Pose]:
        """Where the robot takes itself to have been, if it knew."""
        return FrameHeaderFields.pose.__get__(self) if self.flags & HAS_POSE else None

    @property
    def command(self) -> Optional[Command]:
        """What the robot had been told to do, if it knew."""
        return FrameHeaderFields.command.__get__(self) if self.flags & HAS_COMMAND else None

    @property
    def true_pose(self) -> Optional[Pose]:
        """Where the robot was, told by somebody who need not guess, if there was one."""
        return FrameHeaderFields.true_pose.__get__(self) if self.flags & HAS_TRUE_POSE else None


class _Slot:
    """A frame in shared memory. Given back when nobody refers to it, which numpy's arrays of it do.

    That may be on any thread, in the middle of anything: it is only noted, and the reader gives back what is noted.
    """

    def __init__(self, place: FramePlace, handle: Handle, gone: Deque[FramePlace]) -> None:
        header = place.header.contents
        self._place, self._handle, self._gone = place, handle, gone
        self.__array_interface__: Dict[str, Any] = {
            "version": 3,
            "shape": (header.rows, header.columns),
            "typestr": "<u2",
            "data": (place.counts, True),
        }

    def __del__(self) -> None:
        self._gone.append(self._place)


class Frame:
    """A frame: its header, and its counts where the driver shim wrote them."""

    def __init__(self, header: FrameHeader, counts: "np.ndarray") -> None:
        self.header = header
        #: Raw counts, ``(rows, columns)``, in shared memory and not to be written; 0 for a reading without measurement. A reader
        #: holds at most two frames' counts: copy what is to be kept.
        self.counts = counts

    @property
    def sequence(self) -> int:
        """Number of the frame within its run."""
        return self.header.sequence

    def ranges_m(self) -> "np.ndarray":
        """The counts in metres, ``(rows, columns)``, NaN without measurement: a copy."""
        return np.where(self.counts == 0, np.nan, self.counts * self.header.metres_per_count)

    def __repr__(self) -> str:
        return f"<Frame {self.sequence} of {self.header.rows} × {self.header.columns} readings>"


class Frames:
    """A reader of a sensor's frames: goes on for ever in a ``for``, and waits for each frame.

    ``domain`` and ``polling``: as for :class:`natural_kinds.Kinds`.
    """

    def __init__(
        self, sensor: str, domain: "Union[str, os.PathLike[str], None]" = None, *, polling: bool = False
    ) -> None:
        self._handle: Optional[Handle] = Handle("frames", sensor, domain, waiting(polling))
        self._gone: Deque[FramePlace] = deque()

    def next(self, timeout_s: Optional[float] = None) -> Optional[Frame]:
        """The oldest frame that waits, or the next until the timeout (without one: for ever), or ``None``."""
        handle = self._handle
        if handle is None:
            raise ValueError("these frames are closed")
        place = FramePlace()

        def take(ms: int) -> int:
            self._give_back(handle)
            return int(LIBRARY.kinds_frames_next(handle.pointer, ms, ctypes.byref(place)))

        if not wait(timeout_s, take):
            return None
        header = FrameHeader.from_buffer_copy(place.header.contents)
        return Frame(header, np.asarray(_Slot(place, handle, self._gone)))

    def close(self) -> None:
        """Leaves the sensor, once the last array of its counts is gone."""
        self._handle = None

    def _give_back(self, handle: Handle) -> None:
        while self._gone:
            if LIBRARY.kinds_frames_release(handle.pointer, ctypes.byref(self._gone.popleft())) < 0:
                raise fail()

    def __iter__(self) -> Iterator[Frame]:
        return self

    def __next__(self) -> Frame:
        frame = self.next()
        assert frame is not None
        return frame

    def __enter__(self) -> "Frames":
        return self

    def __exit__(
        self, kind: Optional[Type[BaseException]], error: Optional[BaseException], trace: Optional[TracebackType]
    ) -> None:
        self.close()


def frames(
    sensor: str, domain: "Union[str, os.PathLike[str], None]" = None, *, polling: bool = False
) -> Frames:
    """The frames of a sensor, such as ``crunch/ring``, from now on: see :class:`Frames`."""
    return Frames(sensor, domain, polling=polling)
