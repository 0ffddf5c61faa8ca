"""Prints the kind of each frame: watch.py SENSOR N_REPORTS"""

import sys
from itertools import islice

import natural_kinds

for report in islice(natural_kinds.watch(sys.argv[1]), int(sys.argv[2])):
    probability = report.probabilities[report.kind]
    print(f"frame {report.sequence}: kind {report.kind}, probability {probability:.6f}", flush=True)
