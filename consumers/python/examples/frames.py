"""Prints how near the nearest thing is in each frame: frames.py SENSOR N_FRAMES"""

import sys
from itertools import islice

import natural_kinds

for frame in islice(natural_kinds.frames(sys.argv[1]), int(sys.argv[2])):
    counts = frame.counts[frame.counts > 0]  # in shared memory; 0 is a reading without measurement
    nearest_m = counts.min() * frame.header.metres_per_count if counts.size else float("inf")
    print(f"frame {frame.sequence}: {frame.header.rows} × {frame.header.columns}, nearest {nearest_m:.3f} m", flush=True)
