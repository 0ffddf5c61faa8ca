"""The way in for drivers: a sensor's frames, filled where readers will read them."""

import ctypes
import operator
import os
import time
from collections import deque
from types import TracebackType
from typing import Any, Deque, Dict, Optional, Sequence, SupportsFloat, SupportsIndex, Tuple, Type, Union

import numpy as np

from ._layout import HAS_COMMAND, HAS_POSE, HAS_TRUE_POSE, Command, LoanPlace, Pose
from ._library import LIBRARY, Handle, fail

_COUNT_MAX = 65535

# How long readers have to look at the last frame, which goes with its publisher: as long as the library's header asks for.
_LINGER_S = 0.1


class _Slot:
    """Memory lent for a frame. It stays the frame's as long as somebody refers to it, which numpy's arrays of it do.

    Unsent, it is given back after that. That may be on any thread, in the middle of anything: it is only noted, and the publisher
    gives back what is noted.
    """

    def __init__(self, place: LoanPlace, handle: Handle, gone: Deque[LoanPlace]) -> None:
        self.place, self.handle, self._gone = place, handle, gone
        self.is_lent = True
        self.__array_interface__: Dict[str, Any] = {
            "version": 3,
            "shape": (place.header.rows, place.header.columns),
            "typestr": "<u2",
            "data": (place.counts, False),
        }

    def __del__(self) -> None:
        if self.is_lent:
            self._gone.append(self.place)


class Loan:
    """The memory of the next frame: fill :attr:`counts`, then :meth:`send`. One that nobody refers to any more is given back."""

    def __init__(self, publisher: "FramePublisher", slot: _Slot) -> None:
        self._publisher = publisher
        self._slot: Optional[_Slot] = slot
        self._counts = np.asarray(slot)

    @property
    def counts(self) -> "np.ndarray":
        """Raw counts, ``(rows, columns)``, in shared memory, all 0 (no measurement) as lent. Once sent they are the readers'."""
        self._lent()
        return self._counts

    def send(
        self,
        *,
        captured_ns: Optional[SupportsIndex] = None,
        sequence: Optional[SupportsIndex] = None,
        pose: Optional[Pose] = None,
        command: Optional[Command] = None,
        true_pose: Optional[Pose] = None,
    ) -> None:
        """Sends the frame, and wakes its readers; waits for none of them. The loan is over.

        ``captured_ns``: since the epoch; if not said, when it was borrowed. ``sequence``: higher than the next to leave a gap.
        ``pose``, ``command``: where the robot took itself to be and what it had been told to do, where it knows; ``true_pose``:
        where somebody knows who need not guess.
        """
        header = self._lent().place.header
        if captured_ns is not None:
            header.captured_ns = _whole("captured_ns", captured_ns, -(2**63), 2**63 - 1)
        if sequence is not None:
            header.sequence = _whole("sequence", sequence, 0, 2**64 - 1)
        if pose is not None:
            header.pose, header.flags = pose, header.flags | HAS_POSE
        if command is not None:
            header.command, header.flags = command, header.flags | HAS_COMMAND
        if true_pose is not None:
            header.true_pose, header.flags = true_pose, header.flags | HAS_TRUE_POSE
        self._publisher._sent_s = time.monotonic()
        self._end(LIBRARY.kinds_publisher_send)

    def give_back(self) -> None:
        """Gives the memory back, unsent. Nothing to do once it is sent."""
        if self._slot is not None:
            self._end(LIBRARY.kinds_publisher_give_back)

    def _end(self, how: Any) -> None:
        slot = self._lent()
        self._slot = None
        # The array may still be referred to; what it shows is no longer this program's.
        self._counts.flags.writeable = False
        self._counts = np.empty(0, np.uint16)
        if how(slot.handle.pointer, ctypes.byref(slot.place)) < 0:
            raise fail()
        slot.is_lent = False

    def _lent(self) -> _Slot:
        self._publisher._open()
        if self._slot is None:
            raise ValueError("this frame is sent or given back already; borrow the next one")
        return self._slot


class FramePublisher:
    """The publisher of a sensor's frames: the only one at a time. Takes the place of one that was killed.

    ``domain``: as for :class:`natural_kinds.Kinds`. ``rows``: 1 for a ring. ``metres_per_count``: what a count stands for.
    """

    def __init__(
        self,
        sensor: str,
        domain: "Union[str, os.PathLike[str], None]" = None,
        *,
        rows: SupportsIndex = 1,
        columns: SupportsIndex,
        metres_per_count: SupportsFloat,
    ) -> None:
        n_rows, n_columns = _whole("rows", rows, 1, 2**32 - 1), _whole("columns", columns, 1, 2**32 - 1)
        self._shape = (n_rows, n_columns)
        self._handle: Optional[Handle] = Handle(
            "publisher", sensor, domain, n_rows, n_columns, float(metres_per_count)
        )
        self._gone: Deque[LoanPlace] = deque()
        self._sent_s = -_LINGER_S

    @property
    def shape(self) -> Tuple[int, int]:
        """Rows and columns of a frame."""
        return self._shape

    def send(
        self,
        counts: "Union[np.ndarray, Sequence[int], Sequence[Sequence[int]]]",
        *,
        captured_ns: Optional[SupportsIndex] = None,
        sequence: Optional[SupportsIndex] = None,
        pose: Optional[Pose] = None,
        command: Optional[Command] = None,
        true_pose: Optional[Pose] = None,
    ) -> None:
        """Copies the counts into shared memory and sends them as a frame: whole numbers, ``(rows, columns)`` or row by row.

        The rest is as for :meth:`Loan.send`. Who can write into a given array saves the copy: see :meth:`borrow`.
        """
        checked = self._checked(counts)
        loan = self.borrow()
        try:
            loan.counts[...] = checked
            loan.send(
                captured_ns=captured_ns, sequence=sequence, pose=pose, command=command, true_pose=true_pose
            )
        finally:
            loan.give_back()

    def borrow(self) -> Loan:
        """Borrows the memory of the next frame, one at a time: to be filled and sent, or given back."""
        handle = self._open()
        while self._gone:
            # Of one whose sending failed it may be over already.
            LIBRARY.kinds_publisher_give_back(handle.pointer, ctypes.byref(self._gone.popleft()))
        place = LoanPlace()
        if LIBRARY.kinds_publisher_borrow(handle.pointer, ctypes.byref(place)) < 0:
            raise fail()
        return Loan(self, _Slot(place, handle, self._gone))

    def update(self) -> None:
        """Lets readers that came since the last frame connect: to be called some twenty times a second while no frames are sent."""
        if LIBRARY.kinds_publisher_update(self._open().pointer) < 0:
            raise fail()

    @property
    def n_readers(self) -> int:
        """How many programs read the frames. One that was killed counts until it is cleaned up."""
        n_readers = int(LIBRARY.kinds_publisher_n_readers(self._open().pointer))
        if n_readers < 0:
            raise fail()
        return n_readers

    def close(self) -> None:
        """Leaves the sensor, once readers have had a tenth of a second for the last frame, and a loan's last array is gone."""
        handle, self._handle = self._handle, None
        if handle is not None:
            time.sleep(max(0.0, self._sent_s + _LINGER_S - time.monotonic()))

    def _open(self) -> Handle:
        if self._handle is None:
            raise ValueError("this publisher is closed")
        return self._handle

    def _checked(self, counts: Any) -> "np.ndarray":
        array = np.asarray(counts)
        rows, columns = self._shape
        if array.shape not in (self._shape, (rows * columns,)):
            raise ValueError(f"counts are of shape {array.shape}; a frame of this sensor is of {self._shape}")
        if array.dtype.kind not in "iu":
            raise TypeError(
                f"counts are of type {array.dtype}; give whole numbers, such as ranges divided by metres_per_count and "
                "rounded, and 0 where there is no measurement"
            )
        if array.dtype != np.uint16:
            for count in (array.min(), array.max()):
                if not 0 <= count <= _COUNT_MAX:
                    raise ValueError(f"a count is {count}; it must be from 0 to {_COUNT_MAX}")
        return array.reshape(self._shape)

    def __enter__(self) -> "FramePublisher":
        return self

    def __exit__(
        self, kind: Optional[Type[BaseException]], error: Optional[BaseException], trace: Optional[TracebackType]
    ) -> None:
        self.close()


def publish(
    sensor: str,
    domain: "Union[str, os.PathLike[str], None]" = None,
    *,
    rows: SupportsIndex = 1,
    columns: SupportsIndex,
    metres_per_count: SupportsFloat,
) -> FramePublisher:
    """Opens a sensor, such as ``crunch/ring``, for its driver to send frames: see :class:`FramePublisher`."""
    return FramePublisher(sensor, domain, rows=rows, columns=columns, metres_per_count=metres_per_count)


def _whole(what: str, value: SupportsIndex, least: int, most: int) -> int:
    """A whole number, numpy's too, that ctypes would otherwise cut down to its bits."""
    try:
        number = operator.index(value)
    except TypeError:
        raise TypeError(f"{what} is {value!r}; give a whole number") from None
    if not least <= number <= most:
        raise ValueError(f"{what} is {number}; it must be from {least} to {most}")
    return number
