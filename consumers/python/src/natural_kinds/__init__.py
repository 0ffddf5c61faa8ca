"""Kinds of places, and the frames that they are told from, through shared memory.

    for report in natural_kinds.watch("crunch/ring"):
        print(report.kind, report.probabilities)

    with natural_kinds.publish("crunch/ring", columns=16, metres_per_count=0.001) as shim:
        shim.send(counts)

Pure Python over the library ``libnatural_kinds.so``, which natural kinds' own programs bring along. One thread at a time may use
what it opened; two at once get an error. Ctrl-C ends a wait as it ends everything.
"""

from ._layout import Command, Pose
from ._library import Error, LibraryNotFound, __version__
from .frames import Frame, FrameHeader, Frames, frames
from .model import Model, load_model
from .publisher import FramePublisher, Loan, publish
from .reports import Kinds, Level, Report, watch

__all__ = [
    "Command",
    "Error",
    "Frame",
    "FrameHeader",
    "FramePublisher",
    "Frames",
    "Kinds",
    "Level",
    "LibraryNotFound",
    "Loan",
    "Model",
    "Pose",
    "Report",
    "__version__",
    "frames",
    "load_model",
    "publish",
    "watch",
]
