"""Prints each frame's kinds where those most alike are taken together until two are left: levels.py SENSOR N_REPORTS"""

import sys
from itertools import islice

import natural_kinds

for report in islice(natural_kinds.watch(sys.argv[1]), int(sys.argv[2])):
    level = report.at_level(2)
    shares = [f"{probability:.6f}" for probability in [*level.probabilities, *level.filtered]]
    print(f"frame {report.sequence}:", *shares, *level.groups, *report.numbers, flush=True)
