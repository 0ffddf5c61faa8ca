"""Prints how messages lie in memory for this package, as consumers/layout.csv has it."""

import ctypes

from natural_kinds import _layout

print("type,field,offset,bytes")
for name, message in [
    ("kinds_pose", _layout.Pose),
    ("kinds_command", _layout.Command),
    ("kinds_frame_header", _layout.FrameHeaderFields),
    ("kinds_report", _layout.ReportFields),
]:
    for field, *_ in message._fields_:
        place = getattr(message, field)
        print(f"{name},{field},{place.offset},{place.size}")
    print(f"{name},,0,{ctypes.sizeof(message)}")
