"""A sensor's kinds."""

import ctypes
import os
from types import TracebackType
from typing import Iterator, NamedTuple, Optional, Type, Union

import numpy as np

from ._layout import MAX_KINDS, ReportFields
from ._library import LIBRARY, Handle, fail, wait, waiting

_CLASSIFIED = 0


class Level(NamedTuple):
    """The kinds of a report with those most alike taken together: groups, numbered from 0 in the order of their first kinds."""

    probabilities: "np.ndarray"
    """Probability of each group, of the frame by itself, ``(n_groups,)``."""
    filtered: "np.ndarray"
    """Probability of each group given all frames of the run so far, ``(n_groups,)``."""
    groups: "np.ndarray"
    """Which group each kind is of, by index, ``(n_kinds,)``."""


class Report(ReportFields):
    """What the service says about one frame: a copy, to be kept as long as it is wanted."""

    version: int
    status: int
    kind: int
    filtered_kind: int
    n_kinds: int
    n_dims: int
    n_invalid: int
    n_filtered: int
    run: int
    sequence: int
    n_lost: int
    captured_ns: int
    sent_monotonic_ns: int
    received_monotonic_ns: int
    reported_monotonic_ns: int
    log_likelihood: float
    novelty: float

    @property
    def is_classified(self) -> bool:
        """False for a frame that told nothing: probabilities are then no answer to it."""
        return self.status == _CLASSIFIED

    @property
    def probabilities(self) -> "np.ndarray":
        """Probability of each kind, of the frame by itself, ``(n_kinds,)``."""
        return self._numbers(ReportFields.probabilities.offset, self.n_kinds)

    @property
    def filtered(self) -> "np.ndarray":
        """Probability of each kind given all frames of the run so far, ``(n_kinds,)``."""
        return self._numbers(ReportFields.filtered.offset, self.n_kinds)

    @property
    def coordinates(self) -> "np.ndarray":
        """Place of the frame in the embedding, ``(n_dims,)``."""
        return self._numbers(ReportFields.coordinates.offset, self.n_dims)

    @property
    def numbers(self) -> "np.ndarray":
        """Number of each kind, ``(n_kinds,)``: its own for ever, while indices are those of one model."""
        return np.frombuffer(memoryview(self), np.uint32, self.n_kinds, ReportFields.numbers.offset)

    def at_level(self, n_kinds: int) -> Level:
        """The kinds with those most alike taken together until so many are left; at least 1, and at most all."""
        level = Level(np.empty(MAX_KINDS), np.empty(MAX_KINDS), np.empty(MAX_KINDS, np.uint8))
        places = [array.ctypes.data for array in level]
        n_groups = LIBRARY.kinds_report_at_level(ctypes.byref(self), max(n_kinds, 1), *places)
        if n_groups < 0:
            raise fail()
        return Level(level.probabilities[:n_groups], level.filtered[:n_groups], level.groups[: self.n_kinds])

    @property
    def model_id(self) -> str:
        """Identity of the model, in hexadecimal digits."""
        offset = ReportFields.model_id.offset
        return bytes(self)[offset : offset + ReportFields.model_id.size].hex()

    def _numbers(self, offset: int, n: int) -> "np.ndarray":
        return np.frombuffer(memoryview(self), np.float64, n, offset)

    def __repr__(self) -> str:
        return f"<Report on frame {self.sequence}: kind {self.kind}, probabilities {self.probabilities}>"


class Kinds:
    """A reader of a sensor's kinds: goes on for ever in a ``for``, and waits for each report.

    ``domain``: the folder that the robot's programs meet in; without it ``KINDS_DOMAIN``'s, or else the default one. ``polling``:
    look again and again instead of sleeping, which takes one processor core.
    """

    def __init__(
        self, sensor: str, domain: "Union[str, os.PathLike[str], None]" = None, *, polling: bool = False
    ) -> None:
        self._handle: Optional[Handle] = Handle("reports", sensor, domain, waiting(polling))

    def next(self, timeout_s: Optional[float] = None) -> Optional[Report]:
        """The oldest report that waits, or the next until the timeout (without one: for ever), or ``None``."""
        handle = self._open()
        place = ctypes.POINTER(ReportFields)()
        if not wait(timeout_s, lambda ms: LIBRARY.kinds_reports_next(handle.pointer, ms, ctypes.byref(place))):
            return None
        return Report.from_buffer_copy(place.contents)

    @property
    def is_served(self) -> bool:
        """Whether a service is there. One that was killed is found out within seconds."""
        served = LIBRARY.kinds_reports_is_served(self._open().pointer)
        if served < 0:
            raise fail()
        return bool(served)

    def close(self) -> None:
        """Leaves the sensor."""
        self._handle = None

    def _open(self) -> Handle:
        if self._handle is None:
            raise ValueError("these kinds are closed")
        return self._handle

    def __iter__(self) -> Iterator[Report]:
        return self

    def __next__(self) -> Report:
        report = self.next()
        assert report is not None
        return report

    def __enter__(self) -> "Kinds":
        return self

    def __exit__(
        self, kind: Optional[Type[BaseException]], error: Optional[BaseException], trace: Optional[TracebackType]
    ) -> None:
        self.close()


def watch(
    sensor: str, domain: "Union[str, os.PathLike[str], None]" = None, *, polling: bool = False
) -> Kinds:
    """The kinds of a sensor, such as ``crunch/ring``, from the last report on: see :class:`Kinds`."""
    return Kinds(sensor, domain, polling=polling)
