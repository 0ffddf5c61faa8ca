"""Prints what each report took from when its frame was sent, ns: latency.py SENSOR N_REPORTS"""

import sys
import time
from itertools import islice

import natural_kinds

for report in islice(natural_kinds.watch(sys.argv[1]), int(sys.argv[2])):
    print(time.monotonic_ns() - report.sent_monotonic_ns)
