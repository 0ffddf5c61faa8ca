// Prints the kind of each frame: watch SENSOR N_REPORTS
#include <inttypes.h>
#include <natural_kinds.h>
#include <stdio.h>
#include <stdlib.h>

int main(int argc, char **argv) {
    if (argc != 3) return 2;
    kinds_reports *reports = kinds_reports_open(argv[1], NULL, KINDS_BY_EVENT);
    int came = reports ? KINDS_NOTHING : KINDS_ERROR;
    for (long n_left = atol(argv[2]); n_left > 0 && came != KINDS_ERROR;) {
        const kinds_report *report; // in shared memory, until the next one is asked for
        came = kinds_reports_next(reports, 1000, &report);
        if (came != KINDS_RECEIVED) continue;
        printf("frame %" PRIu64 ": kind %" PRIu32 ", probability %.6f\n", report->sequence, report->kind,
               report->probabilities[report->kind]);
        fflush(stdout);
        n_left--;
    }
    if (came == KINDS_ERROR) fprintf(stderr, "%s\n", kinds_last_error());
    kinds_reports_close(reports);
    return came == KINDS_ERROR;
}
