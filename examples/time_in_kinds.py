"""Says how long a robot stays in each kind, and which kind follows which: time_in_kinds.py SENSOR N_REPORTS

Ends after so many reports, or by Ctrl-C, and prints a table: seconds, visits, and how often each other kind came next.
"""

import sys
from itertools import islice

import numpy as np

import natural_kinds

MAX_KINDS = 64
GAP_S = 1.0  # reports that are farther apart say nothing of the time between them


def main(sensor: str, n_reports: int) -> None:
    seconds = np.zeros(MAX_KINDS)
    changes = np.zeros((MAX_KINDS, MAX_KINDS), int)  # from the kind of a row to that of a column
    visits = np.zeros(MAX_KINDS, int)
    n_kinds, last = 0, None
    try:
        for report in islice(natural_kinds.watch(sensor), n_reports):
            if not report.is_classified:
                continue
            n_kinds, kind = max(n_kinds, report.n_kinds), report.filtered_kind
            follows = last is not None and report.run == last.run
            if follows:
                elapsed_s = (report.captured_ns - last.captured_ns) * 1e-9
                if elapsed_s < GAP_S:
                    seconds[last.filtered_kind] += elapsed_s
            if not follows or kind != last.filtered_kind:
                visits[kind] += 1
                if follows:
                    changes[last.filtered_kind, kind] += 1
            last = report
    except KeyboardInterrupt:
        pass
    print("kind  seconds  visits  then", *(f"{kind:5}" for kind in range(n_kinds)))
    for kind in range(n_kinds):
        then = (f"{n:5}" for n in changes[kind, :n_kinds])
        print(f"{kind:4}  {seconds[kind]:7.1f}  {visits[kind]:6}      ", *then)


if __name__ == "__main__":
    main(sys.argv[1], int(sys.argv[2]))
