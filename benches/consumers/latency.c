// Prints what each report took from when its frame was sent, ns: latency SENSOR N_REPORTS
#include <inttypes.h>
#include <natural_kinds.h>
#include <stdio.h>
#include <stdlib.h>
#include <time.h>

int main(int argc, char **argv) {
    if (argc != 3) return 2;
    kinds_reports *reports = kinds_reports_open(argv[1], NULL, KINDS_BY_EVENT);
    const kinds_report *report;
    for (long n_left = atol(argv[2]); reports != NULL && n_left > 0;) {
        if (kinds_reports_next(reports, 1000, &report) != KINDS_RECEIVED) continue;
        struct timespec now;
        clock_gettime(CLOCK_MONOTONIC, &now);
        printf("%" PRIu64 "\n", UINT64_C(1000000000) * now.tv_sec + now.tv_nsec - report->sent_monotonic_ns);
        n_left--;
    }
    kinds_reports_close(reports);
    return 0;
}
